# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Nodes as forks of a process that has done the imports, which take most of a node's start.

Each is a process of its own, in a session of its own, as nodes that `NodeProcesses` starts are.

"""

from __future__ import annotations

import contextlib
import ctypes
from functools import cache
from importlib import import_module
import multiprocessing
import os
import signal
import subprocess
import sys

IMPORTED = (
    'gip_localizer.ros.localizer_node', 'gip_localizer.ros.bag_player_node',
    'rosbags.typesys.stores.ros2_jazzy',
)  # fmt: skip
PR_SET_PDEATHSIG = 1


class ForkedProcess:
    """A fork with the methods of `subprocess.Popen` that tests and `NodeProcesses` call."""

    def __init__(self, process):
        self._process = process
        self.pid = process.pid

    def poll(self):
        return self._process.exitcode

    def wait(self, timeout=None):
        self._process.join(timeout)
        if self.poll() is None:
            raise subprocess.TimeoutExpired(self._process.name, timeout)
        return self.poll()

    def send_signal(self, number):
        with contextlib.suppress(ProcessLookupError):
            os.kill(self.pid, number)

    def kill(self):
        self.send_signal(signal.SIGKILL)


def fork(name, arguments, log, environment):
    """Start a node, as `launch_interpreter` does."""
    log.write_bytes(b'')
    process = _server().Process(
        target=_become, args=(name, list(arguments), str(log), dict(environment)), daemon=True
    )
    process.start()
    return ForkedProcess(process)


@cache
def _server():
    """The process that is forked, one per test process; it ends with it."""
    context = multiprocessing.get_context('forkserver')
    context.set_forkserver_preload(list(IMPORTED))
    return context


def _become(name, arguments, log, environment):
    """Be the node, in the fork."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    os.setsid()
    out = os.open(log, os.O_WRONLY | os.O_APPEND)
    for stream in (1, 2):
        os.dup2(out, stream)
    sys.stdout, sys.stderr = (open(stream, 'w', buffering=1) for stream in (1, 2))  # noqa: PTH123, SIM115
    os.environ.clear()
    os.environ.update(environment)
    sys.exit(import_module(f'gip_localizer.ros.{name}_node').main(arguments))
