# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Benchmark suite `node`: camera, localizer and echo as separate processes over DDS."""

from __future__ import annotations

from dataclasses import dataclass, field
import os
from pathlib import Path
import tempfile
import time
from typing import Any

from geometry_msgs.msg import PoseStamped
import numpy as np
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions

from gip_localizer.benchmark.frames import images, straight, tracking_parameters
from gip_localizer.benchmark.rows import Row
from gip_localizer.benchmark.scene import camera, CELL
from gip_localizer.core.pose import Pose2
from gip_localizer.errors import GipError
from gip_localizer.io.map_files import save_map
from gip_localizer.io.messages import planar_pose, stamp_ns
from gip_localizer.ros.middleware import image_environment, private_graph
from gip_localizer.ros.processes import NodeProcesses
from gip_localizer.synthetic.worlds import road_world

START_WITHIN = 60.0
"""Longest time (s) until the first poses; chosen."""
SETTLE = 3.0
"""Time (s) of operation before the measurement; chosen."""
FRAMES = 24
"""Number of images, which are repeated in a loop; chosen."""
NS = 1_000_000_000
"""Nanoseconds per second."""


@dataclass(frozen=True)
class Setting:
    """Images of the camera: size (px), encoding and rate (Hz)."""

    width: int
    height: int
    encoding: str
    rate: float = 30.0

    def __str__(self) -> str:
        """Return a text like `1280x720 mono8 at 30 Hz`."""
        return f'{self.width}x{self.height} {self.encoding} at {self.rate:g} Hz'


SETTINGS = (Setting(1280, 720, 'mono8'), Setting(1920, 1080, 'bgr8'))
"""Measured settings; chosen: common grey and colour cameras."""


@dataclass
class _Received:
    """Arrivals (ns of the system clock) by stamp, and errors (m) of the poses."""

    sent: dict[int, Pose2] = field(default_factory=dict)
    poses: dict[int, tuple[int, Pose2]] = field(default_factory=dict)
    echoes: dict[int, int] = field(default_factory=dict)


def node_suite(seconds: float) -> tuple[list[Row], dict[str, Any]]:
    """Return a row per setting: latency from stamp to pose, and that of the echo."""
    rows, details = [], {}
    for setting in SETTINGS:
        with tempfile.TemporaryDirectory(prefix='gip_bench_') as folder:
            found = _run(setting, Path(folder), seconds)
        details[str(setting)] = found
        rows.append(Row(
            'node', f'{setting}, stamp to pose, p50', found['pose_ms']['p50'],
            'echo of the image, p50', found['echo_ms']['p50'],
            found['echo_ms']['p50'] / found['pose_ms']['p50'],
        ))
    return rows, details


def _run(setting: Setting, folder: Path, seconds: float) -> dict[str, Any]:
    parameters = _prepare(setting, folder)
    environment = {**image_environment(), **private_graph(os.getpid() % 100 + 1)}
    os.environ.update(environment)
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    node = Node('bench', enable_rosout=False, start_parameter_services=False)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    received = _listen(node)
    try:
        with NodeProcesses(folder, environment) as nodes:
            localizer = nodes.start('localizer', parameters)
            nodes.start('bench_echo', {})
            nodes.start('bench_camera', {
                'folder': str(folder), 'rate': setting.rate, 'encoding': setting.encoding,
            })
            _spin(executor, nodes, until=lambda: len(received.poses) > 5, seconds=START_WITHIN)
            if not received.poses:
                output = nodes.last_words('localizer')
                raise GipError(
                    f'no pose within {START_WITHIN:g} s; last output of the localizer: {output}'
                )
            _spin(executor, nodes, until=lambda: False, seconds=SETTLE)
            for record in (received.sent, received.poses, received.echoes):
                record.clear()
            figures = _watch(executor, nodes, localizer.pid, seconds)
            nodes.end('bench_camera')
            _spin(executor, nodes, until=lambda: False, seconds=1.0)
    finally:
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()
    return {**_summary(received), **figures}


def _prepare(setting: Setting, folder: Path) -> dict[str, Any]:
    """Write the map and the images; return the localizer's parameters."""
    world = road_world(seed=0, resolution=CELL)
    save_map(world.raster, folder / 'map.yaml')
    model = camera(setting.width, setting.height)
    x, y = world.lane.position(np.array([5.0]))[0]
    start = Pose2(float(x), float(y), float(world.lane.heading(np.array([5.0]))[0]))
    poses = straight(start, FRAMES, 0.05)
    pixels = np.stack(images(world.raster, model, poses))
    if setting.encoding == 'bgr8':
        pixels = np.repeat(pixels[..., None], 3, axis=3)
    np.savez(folder / 'drive.npz', images=pixels, poses=np.array(poses), K=model.calibration.K)
    settings = tracking_parameters(model, start).to_dict()
    return {**settings, 'map_file': str(folder / 'map.yaml')}


def _listen(node: Node) -> _Received:
    received = _Received()

    def now() -> int:
        return int(node.get_clock().now().nanoseconds)

    def on_truth(message: PoseStamped) -> None:
        received.sent[stamp_ns(message.header)] = planar_pose(message.pose)

    def on_pose(message: PoseStamped) -> None:
        received.poses[stamp_ns(message.header)] = (now(), planar_pose(message.pose))

    def on_echo(message: PoseStamped) -> None:
        received.echoes[stamp_ns(message.header)] = now()

    queue = QoSProfile(depth=100)
    node.create_subscription(PoseStamped, 'ground_truth', on_truth, queue)
    node.create_subscription(PoseStamped, 'pose', on_pose, queue)
    node.create_subscription(PoseStamped, 'echo', on_echo, queue)
    return received


def _spin(executor: SingleThreadedExecutor, nodes: NodeProcesses, *, until: Any,
          seconds: float) -> None:
    end = time.monotonic() + seconds
    while (left := end - time.monotonic()) > 0.0 and not until():
        nodes.check()
        executor.spin_once(timeout_sec=min(left, 0.2))


def _watch(executor: SingleThreadedExecutor, nodes: NodeProcesses, pid: int,
           seconds: float) -> dict[str, Any]:
    """Receive messages; return processor time per second and memory of the localizer."""
    memory = [_resident_mib(pid)]
    began, spent = time.monotonic(), _processor_s(pid)
    for _ in range(10):
        _spin(executor, nodes, until=lambda: False, seconds=seconds / 10)
        memory.append(_resident_mib(pid))
    elapsed = time.monotonic() - began
    return {
        'seconds': elapsed, 'cores': (_processor_s(pid) - spent) / elapsed, 'memory_mib': memory,
    }


def _processor_s(pid: int) -> float:
    text = Path(f'/proc/{pid}/stat').read_text()
    fields = text[text.rindex(')') + 2 :].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def _resident_mib(pid: int) -> float:
    pages = int(Path(f'/proc/{pid}/statm').read_text().split()[1])
    return pages * os.sysconf('SC_PAGE_SIZE') / 2**20


def _summary(received: _Received) -> dict[str, Any]:
    stamps = sorted(received.sent)
    poses = [received.poses[s] for s in stamps if s in received.poses]
    pose_ms = [1e-6 * (received.poses[s][0] - s) for s in stamps if s in received.poses]
    echo_ms = [1e-6 * (received.echoes[s] - s) for s in stamps if s in received.echoes]
    errors = [
        float(np.hypot(p.x - received.sent[s].x, p.y - received.sent[s].y))
        for s in stamps if s in received.poses for p in [received.poses[s][1]]
    ]
    if not poses or not echo_ms:
        raise GipError(
            f'{len(poses)} poses and {len(echo_ms)} echoes of {len(stamps)} images; expected at '
            'least one of each; run the benchmark on an idle machine'
        )
    span = (stamps[-1] - stamps[0]) / NS
    return {
        'sent': len(stamps), 'poses': len(poses), 'echoes': len(echo_ms),
        'poses_per_second': len(poses) / span, 'worst_error_m': max(errors),
        'pose_ms': _percentiles(pose_ms), 'echo_ms': _percentiles(echo_ms),
    }


def _percentiles(values: list[float]) -> dict[str, float]:
    return {f'p{q}': float(np.percentile(values, q)) for q in (50, 95, 99)}
