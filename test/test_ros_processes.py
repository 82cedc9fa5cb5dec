# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Nodes that are started as children end with their parent, whatever ends it."""

from importlib import import_module
import re
import signal
import subprocess
import sys
import time

import psutil
import pytest

pytest.importorskip('rclpy')

import numpy as np
from ros_scene import *  # noqa: F403 - fixtures and the world
from ros_scene import camera_info, frames, initial_pose, parameters, START, WORLD
from ros_support import GRAPH, PATIENCE
from std_msgs.msg import Float64

from gip_localizer.cli.parameter_pages import tree_of
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.errors import GipError
from gip_localizer.io.map_files import save_map
from gip_localizer.ros.processes import NodeProcesses

pytestmark = pytest.mark.ros

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


@pytest.mark.parametrize('node', ['localizer', 'bag_player', 'synthetic_camera'])
def test_nodes_answer_help_by_example(node, capsys):
    module = import_module(f'gip_localizer.ros.{node}_node')
    assert module.main(['--help']) == 0
    said = capsys.readouterr().out
    assert said.startswith(f'usage: {node} [--ros-args')
    names = {spec.name for spec in tree_of(node).specs()}
    shown = re.findall(r'-p (\S+):=[^.\s]', said)
    assert names.issuperset(set(shown) - {'NAME'})
    assert len(shown) > 1


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


SNOW = np.random.default_rng(2).integers(0, 256, (240, 320), np.uint8)


def busy_searching(tester, process, image):
    """Have the whole map searched; return when that has taken a second of computing."""
    tester.trigger('/localizer/relocalize')
    began = sum(psutil.Process(process.pid).cpu_times()[:2])

    def at_work():
        tester.info.publish(camera_info())
        tester.image.publish(next(image))
        return sum(psutil.Process(process.pid).cpu_times()[:2]) > began + 1.0

    tester.until(at_work, 'the search', alive=process)


@pytest.fixture
def searching(nodes, tester, tmp_path):
    """A node with a large map, whose search takes seconds."""
    path = tmp_path / 'large.yaml'
    save_map(RasterMap(np.tile(WORLD.grey, (6, 6)), WORLD.resolution, WORLD.origin), path)
    process = nodes.start('localizer', parameters(path))
    tester.until(tester.matched, 'the localizer to join', alive=process)
    return process


def test_amid_a_search_services_parameters_and_diagnostics_are_answered(searching, tester):
    done = []
    tester.create_subscription(Float64, '/localizer/execution_time_ms', done.append, 10)
    assert tester.get('search.x') == 0.75
    images = frames(SNOW)
    busy_searching(tester, searching, images)
    tester.initial.publish(initial_pose(START))
    received = len(tester.diagnostics)
    assert tester.set('search.x', 0.5).successful
    assert tester.switch('/localizer/enable', True).success
    tester.until(lambda: len(tester.diagnostics) > received, 'diagnostics')
    assert not done, 'the search was over before the answers came'

    def all_taken():
        figures = {one.key: one.value for one in tester.status('prior').values}
        return done and figures['initialposes'] == '1'

    tester.until(all_taken, 'the end of the search, and what waited for it', alive=searching)
    assert tester.get('search.x') == 0.5


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_node_in_order_amid_a_search(searching, tester, tmp_path, number):
    process = searching
    busy_searching(tester, process, frames(SNOW))
    for _ in range(3):  # who waits presses Ctrl-C again
        process.send_signal(number)
    code = process.wait(PATIENCE)
    log = (tmp_path / 'localizer.log').read_text()
    assert code == 0, log
    assert 'Traceback' not in log
