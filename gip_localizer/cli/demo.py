# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""`gip demo`: camera, node and observer as three processes over DDS."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
import signal
import sys
import tempfile
import time
from typing import Any, TYPE_CHECKING

from gip_localizer.cli.settings import ctrl_c
from gip_localizer.errors import GipError
from gip_localizer.parameters import METRICS, Parameters
from gip_localizer.parameters.yaml_files import user_path

if TYPE_CHECKING:
    from gip_localizer.evaluation.run import Run
    from gip_localizer.ros.demo_observer import DemoObserver
    from gip_localizer.ros.processes import NodeProcesses

START_WITHIN = 30.0
"""Time, in seconds, within which the first pose must arrive; chosen."""
DRAIN = 1.0
"""Time, in seconds, for the last poses to arrive after the drive; chosen."""
TICK = 0.2
"""Period of the progress line, seconds; chosen."""


def add_parser(verbs: Any) -> None:
    """Add the verb to the parser of `gip`."""
    parser = verbs.add_parser(
        'demo', help='camera, node and observer over DDS; fails if a bound is missed',
        description='Run a synthetic camera, the node and an observer as three processes over '
                    'DDS, and compare the poses with the truth. Exit status 1 if a bound is '
                    'missed.',
    )
    parser.add_argument(
        '--world', default='road', help='road, tiles or a map YAML (default: road)'
    )
    parser.add_argument(
        '--rate', type=_positive, default=5.0, help='images per second (default: 5)'
    )
    parser.add_argument(
        '--seconds', type=_positive, default=20.0, help='length of the drive (default: 20)'
    )
    parser.add_argument(
        '--metric', choices=METRICS, default=Parameters().score.metric,
        help='metric for scoring candidates (default: %(default)s)',
    )
    parser.add_argument('--out', type=user_path, default=Path('results/demo'),
                        help='results folder')
    parser.add_argument('--force', action='store_true', help='replace existing results')
    parser.set_defaults(run=run)


def _positive(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0.0 < value < 1e5:
        raise argparse.ArgumentTypeError(f'expected a number above 0, got {text}')
    return value


def run(args: argparse.Namespace) -> int:
    """Run the demo, write the results folder and print missed bounds."""
    from gip_localizer.evaluation.demo import missed_bounds, overload
    from gip_localizer.evaluation.metrics import format_table, table_rows
    from gip_localizer.evaluation.results import check_output, write_results

    check_output(args.out, args.force)
    # A plain `kill` must end the children too, as Ctrl-C does.
    for request in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(request, lambda number, _: sys.exit(128 + number))
    with ctrl_c(interrupts=True), tempfile.TemporaryDirectory(prefix='gip_demo_') as folder:
        finished = _drive(args, Path(folder))
    metrics = write_results(args.out, finished, args.force)
    print(format_table(table_rows(metrics)))
    print(f'report: {args.out / "report.html"}')
    missed = missed_bounds(metrics)
    for line in missed:
        print(f'gip demo: missed: {line}', file=sys.stderr)
    if missed and (advice := overload(metrics, args.rate)):
        print(f'gip demo: {advice}', file=sys.stderr)
    return 1 if missed else 0


def _drive(args: argparse.Namespace, folder: Path) -> Run:
    from gip_localizer.evaluation.demo_scene import demo_scene
    from gip_localizer.ros.demo_observer import DemoObserver
    from gip_localizer.ros.middleware import image_environment, private_graph
    from gip_localizer.ros.processes import NodeProcesses

    print(f'generating the world {args.world} ...', flush=True)
    scene = demo_scene(args.world, folder, rate=args.rate, metric=args.metric)
    environment = {**image_environment(), **private_graph(os.getpid() % 100 + 1)}
    os.environ.update(environment)
    with NodeProcesses(folder, environment) as nodes, DemoObserver() as observer:
        nodes.start('localizer', scene.localizer.to_dict())
        nodes.start('synthetic_camera', {**scene.camera.to_dict(), 'publish.wait': True})
        _await_first_pose(nodes, observer)
        observer.look()
        seconds = _watch(nodes, observer, args.seconds)
        nodes.end('synthetic_camera')
        observer.listen_for(DRAIN)
    return scene.judged(observer.received, observer.exhibits(), seconds)


def _await_first_pose(nodes: NodeProcesses, observer: DemoObserver) -> None:
    print('starting camera and localizer ...', flush=True)
    until = time.monotonic() + START_WITHIN
    while not observer.received.poses:
        nodes.check()
        if time.monotonic() > until:
            diagnostics = observer.received.diagnostics
            reason = diagnostics[-1][1] if diagnostics else nodes.last_words('localizer')
            raise GipError(f'no pose within {START_WITHIN:g} s; the localizer reports: {reason}')
        observer.listen_for(TICK)


def _watch(nodes: NodeProcesses, observer: DemoObserver, seconds: float) -> float:
    """Receive messages during the drive, with a progress line; return the duration, seconds."""
    from gip_localizer.cli.progress import progress

    received = observer.received
    began = time.monotonic()
    form = '{desc} {percentage:3.0f}%|{bar:20}| {elapsed} {postfix}'
    with progress(seconds, 'driving', bar_format=form) as bar:
        while (elapsed := time.monotonic() - began) < seconds:
            nodes.check()
            observer.listen_for(min(TICK, seconds - elapsed))
            error, latency = received.newest_error_m(), received.latency_ms()
            bar.set_postfix_str(
                f'{len(received.poses)}/{len(received.truth)} frames'
                + (f', error {1e3 * error:.0f} mm' if error is not None else '')
                + (f', latency {latency:.0f} ms' if latency is not None else '')
            )
            bar.update(min(time.monotonic() - began, seconds) - bar.n)
    return time.monotonic() - began
