# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""World, camera and localizer of the demo; the initial pose has a known error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math
from pathlib import Path
from typing import Any

from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.pose import Pose2
from gip_localizer.evaluation.demo import ReceivedMessages
from gip_localizer.evaluation.run import FrameExhibit, Run
from gip_localizer.io.map_files import save_map
from gip_localizer.parameters import Parameters
from gip_localizer.synthetic.drive import SyntheticDrive
from gip_localizer.synthetic.localizer_parameters import CAR_VIEW, view_settings
from gip_localizer.synthetic.parameters import SyntheticCameraParameters
from gip_localizer.synthetic.worlds import NAMES

START_ERROR = Pose2(0.3, -0.2, math.radians(1.5))
"""Error of the initial pose, relative to the true one (metres and radians); chosen."""
CAMERA = {
    'camera.z': 1.5, 'camera.pitch': math.radians(15.0),
    'camera.x': 0.2, 'camera.roll': 0.01, 'camera.yaw': -0.02,
    'lens.width': 640, 'lens.height': 480, 'lens.focal': 450.0, 'lens.k1': -0.1, 'lens.k2': 0.01,
}  # fmt: skip
"""
Camera of the demo, in the units of its parameters; chosen like a camera in a small car.

It has a small roll and yaw, and a lens with distortion.

"""


@dataclass(frozen=True)
class DemoScene:
    """
    Settings of the demo's nodes, and the evaluation of a run.

    Attributes
    ----------
    camera : SyntheticCameraParameters
        Parameters of the node `synthetic_camera`.
    localizer : Parameters
        Parameters of the node `localizer`.
    raster_map : RasterMap
        The map that the localizer reads.

    """

    camera: SyntheticCameraParameters
    localizer: Parameters
    raster_map: RasterMap

    def judged(
        self, received: ReceivedMessages, exhibits: Sequence[FrameExhibit], seconds: float
    ) -> Run:
        """Return the received messages as a run."""
        sources: dict[str, Any] = {
            'world': self.camera.world.name, 'rate': self.camera.rate, 'middleware': 'DDS',
        }
        return Run(
            title=f'Demo: {Path(self.camera.world.name).stem}, three processes over DDS',
            estimates=received.frames(), parameters=self.localizer, truth=received.trajectory(),
            raster_map=self.raster_map, exhibits=exhibits, wall_seconds=seconds, sources=sources,
            keep_map=True,
        )  # fmt: skip


def demo_scene(world: str, folder: Path, *, rate: float, metric: str) -> DemoScene:
    """
    Generate a world and write its map.

    Parameters
    ----------
    world : str
        road, tiles, or the YAML file of a map.
    folder : Path
        Folder of the map to write.
    rate : float
        Images per second.
    metric : str
        Metric with which the localizer scores candidates.

    Returns
    -------
    DemoScene
        Settings of both nodes.

    Raises
    ------
    GipError
        The map or a setting cannot be used.

    """
    name = world if world in NAMES else str(Path(world).absolute())
    camera = SyntheticCameraParameters.from_dict({**CAMERA, 'world.name': name, 'rate': rate})
    drive = SyntheticDrive(camera)
    map_file = folder / 'map.yaml'
    save_map(drive.raster_map, map_file)
    start = drive.truth(0) @ START_ERROR
    held = {key: value for key, value in camera.to_dict().items() if key.startswith('camera.')}
    localizer = Parameters.from_dict({
        **held, **view_settings(CAR_VIEW), 'map_file': str(map_file), 'score.metric': metric,
        'initial_pose.set': True,
        'initial_pose.x': start.x, 'initial_pose.y': start.y, 'initial_pose.yaw': start.yaw,
    })  # fmt: skip
    return DemoScene(camera, localizer, drive.raster_map)
