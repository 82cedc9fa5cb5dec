# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Nodes that are started as children end with their parent, whatever ends it."""

import signal
import subprocess
import sys
import time

import psutil
import pytest

pytest.importorskip('rclpy')

from ros_support import GRAPH

from gip_localizer.errors import GipError
from gip_localizer.ros.processes import NodeProcesses

pytestmark = pytest.mark.ros

PATIENCE = 20.0
PARENT = """
import signal, sys, time
signal.signal(signal.SIGINT, signal.default_int_handler)
from pathlib import Path
from gip_localizer.ros.processes import NodeProcesses
with NodeProcesses(Path(sys.argv[1]), {}) as nodes:
    child = nodes.start('synthetic_camera', {'width': 64, 'height': 48, 'rate': 1.0})
    print(child.pid, flush=True)
    while True:
        time.sleep(0.1)
"""


def gone(pid):
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        if not psutil.pid_exists(pid) or psutil.Process(pid).status() == psutil.STATUS_ZOMBIE:
            return True
        time.sleep(0.05)
    return False


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGKILL])
def test_children_end_when_their_parent_does(tmp_path, number):
    parent = subprocess.Popen(
        [sys.executable, '-c', PARENT, str(tmp_path)],
        stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
    )  # fmt: skip
    try:
        child = int(parent.stdout.readline())
        assert psutil.pid_exists(child)
        parent.send_signal(number)
        parent.wait(PATIENCE)
        assert gone(child)
    finally:
        parent.kill()
        parent.wait()
        parent.stdout.close()


def test_a_node_that_ends_is_reported_with_its_last_words(tmp_path):
    with NodeProcesses(tmp_path, GRAPH) as nodes:
        nodes.start('localizer', {'map_file': '/nowhere/map.yaml'}).wait(PATIENCE)
        with pytest.raises(GipError, match=r'(?s)localizer ended with code 1.*/nowhere/map\.yaml'):
            nodes.check()
