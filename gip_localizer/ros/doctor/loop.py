# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""A short loop of synthetic camera, node and observer over DDS, as three processes."""

from __future__ import annotations

from collections.abc import Callable
import os
from pathlib import Path
import tempfile
import time

import numpy as np

from gip_localizer.core.pose import difference
from gip_localizer.errors import GipError
from gip_localizer.evaluation.demo import ReceivedMessages
from gip_localizer.evaluation.demo_scene import demo_scene
from gip_localizer.parameters import Parameters
from gip_localizer.ros.demo_observer import DemoObserver
from gip_localizer.ros.doctor.check import Check
from gip_localizer.ros.middleware import image_environment, private_graph
from gip_localizer.ros.processes import NodeProcesses

NAME = 'loop'
WORLD = 'tiles'
"""World of the loop: it is generated in 0.3 s."""
RATE = 5.0
"""Images per second; chosen."""
SPEED = 0.2
"""Speed, m/s: the initial pose is still right when the last process has joined; chosen."""
LEAST_POSES = 3
"""Poses after which the loop ends; chosen."""
MOST_ERROR = 0.03
"""Largest error of a pose, metres, as for `gip demo`."""
MOST_LOAD = 1.5
"""Processes per core above which a loop that comes too late is the load's fault; chosen."""
TICK = 0.1
"""Seconds between two looks at the processes; chosen."""


def loop_check(seconds: float, progress: Callable[[float], object]) -> Check:
    """
    Drive a synthetic camera past a localizer, and compare its poses with the truth.

    Parameters
    ----------
    seconds : float
        Longest time until the last pose.
    progress : callable
        Called with the seconds so far.

    """
    with tempfile.TemporaryDirectory(prefix='gip_doctor_') as folder:
        scene = demo_scene(WORLD, Path(folder), rate=RATE, metric=Parameters().score.metric)
        environment = {**image_environment(), **private_graph(os.getpid() % 100 + 1)}
        os.environ.update(environment)
        camera = {**scene.camera.to_dict(), 'drive.speed': SPEED}
        with NodeProcesses(Path(folder), environment) as nodes, DemoObserver() as observer:
            began = time.monotonic()
            nodes.start('localizer', scene.localizer.to_dict())
            nodes.start('synthetic_camera', camera)
            try:
                while not _enough(observer.received) and time.monotonic() - began < seconds:
                    nodes.check()
                    observer.listen_for(TICK)
                    progress(time.monotonic() - began)
            except GipError as error:
                return Check(NAME, str(error), 'see the lines of the node above')
            return _judged(observer.received, time.monotonic() - began)


def _enough(received: ReceivedMessages) -> bool:
    return len(received.poses.keys() & received.truth.keys()) >= LEAST_POSES


def _judged(received: ReceivedMessages, seconds: float) -> Check:
    common = sorted(received.poses.keys() & received.truth.keys())
    if len(common) < LEAST_POSES:
        return _too_few(received, len(common), seconds)
    apart = [difference(received.poses[stamp][0], received.truth[stamp]) for stamp in common]
    error = max(float(np.hypot(one[0], one[1])) for one in apart)
    found = (
        f'{len(common)} poses in {seconds:.1f} s, largest error {1e3 * error:.1f} mm, latency '
        f'{received.latency_ms() or 0.0:.0f} ms'
    )
    if error <= MOST_ERROR:
        return Check(NAME, found)
    return Check(NAME, found, 'poses are wrong on this machine: run make test, and report the '
                 'first test that fails')


def _too_few(received: ReceivedMessages, poses: int, seconds: float) -> Check:
    """Name the part of the loop that is missing."""
    found = f'{poses} of {len(received.truth)} frames gave a pose in {seconds:.0f} s'
    if busy := _busy():
        return Check(NAME, f'{found}; {busy}',
                     'the machine is too busy: stop other programs, and repeat')
    if not received.truth and not received.diagnostics:
        return Check(NAME, f'nothing was heard over DDS in {seconds:.0f} s', (
            'a firewall or a container keeps processes of this machine apart: allow UDP on the '
            'loopback interface, and see the check of the shared memory'
        ))  # fmt: skip
    if poses:
        return Check(NAME, found, 'images are lost: see the check of the shared memory')
    said = received.diagnostics[-1][1] if received.diagnostics else 'nothing'
    return Check(NAME, f'{found}; the node says: {said}',
                 'images do not arrive or cannot be used: see the checks above, and gip demo')


def _busy() -> str:
    """Return the load of the machine where it is too large for a loop; else nothing."""
    load, cores = os.getloadavg()[0], os.cpu_count() or 1
    return f'{load:.1f} processes compete for {cores} cores' if load > MOST_LOAD * cores else ''
