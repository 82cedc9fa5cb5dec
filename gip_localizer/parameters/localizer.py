# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
All parameters of the localizer: groups of `matching.py` and `integration.py`, and single ones.

The node's declarations, `config/localizer.yaml`, `docs/parameters.md` and the command line's
`--set` are made from it.

"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from gip_localizer.errors import ParameterError
from gip_localizer.parameters.integration import (
    Attitude,
    Diagnostics,
    Frames,
    InitialPose,
    MaskTopic,
    State,
    Transforms,
)
from gip_localizer.parameters.matching import (
    Birdseye,
    CameraMotion,
    Integrity,
    MapErrors,
    Motion,
    MountedCamera,
    Recovery,
    Score,
    Search,
)
from gip_localizer.parameters.ros_yaml import dump_ros_yaml, load_ros_yaml
from gip_localizer.parameters.spec import group, ParameterGroup
from gip_localizer.parameters.spec import parameter as p


@dataclass(frozen=True)
class Parameters(ParameterGroup):
    """All parameters of the node `localizer`."""

    map_file: str = p('', 'Map: a nav2 map_server YAML file; another one may be set while the '
                      'node runs, and is refused where it cannot be read.')
    map_keeps_pose: bool = p(True, 'The pose when map_file changes. True: it is '
                             'carried over (same frame); false: the node starts anew.')
    mask_file: str = p(
        '', 'Image of the camera\'s size, black where it sees its own vehicle.', read_only=True
    )
    image_transport: str = p(
        'raw', 'Which image topic is read: image, image/compressed, or image/foxglove '
        '(foxglove_msgs/CompressedVideo).',
        choices=('raw', 'compressed', 'foxglove'), read_only=True,
    )
    image_reliability: str = p(
        'best_effort', 'Requested QoS reliability of the image; with reliable no large frames are '
        'lost, if the camera publishes reliably.', choices=('best_effort', 'reliable'),
        read_only=True,
    )
    lifecycle: bool = p(False, 'Start unconfigured, as a managed (lifecycle) node.',
                        read_only=True)
    autostart_node: bool = p(False, 'A managed node configures and activates itself at the start.',
                             read_only=True)
    bond_heartbeat_period: float = p(
        0.1, "Time between two messages on the topic bond, by which nav2's lifecycle manager "
        'watches a managed node (needs the package bond); 0: none.', unit='s', low=0.0, high=4.0,
        read_only=True,
    )
    state_file: str = p('', 'Where the last pose is kept for a restart; empty: nowhere.',
                        read_only=True)
    frames: Frames = group(Frames)
    camera: MountedCamera = group(MountedCamera)
    mask: MaskTopic = group(MaskTopic)
    initial_pose: InitialPose = group(InitialPose)
    map: MapErrors = group(MapErrors)
    birdseye: Birdseye = group(Birdseye)
    search: Search = group(Search)
    score: Score = group(Score)
    motion: Motion = group(Motion)
    camera_motion: CameraMotion = group(CameraMotion)
    integrity: Integrity = group(Integrity)
    recovery: Recovery = group(Recovery)
    attitude: Attitude = group(Attitude)
    tf: Transforms = group(Transforms)
    state: State = group(State)
    diagnostics: Diagnostics = group(Diagnostics)

    def check(self) -> None:
        """Check what depends on several parameters (raises ParameterError)."""
        self._check_view()
        self._check_size()

    def _check_view(self) -> None:
        view = self.birdseye
        side = view.resolution or LEAST_CELL
        if side < LEAST_CELL:
            raise ParameterError(
                f'birdseye.resolution ({side:g} m) must be at least {LEAST_CELL:g} m, or 0: '
                'automatic'
            )
        if view.near and view.far and view.far - view.near < 2.0 * side:
            raise ParameterError(
                f'birdseye.far ({view.far:g} m) must exceed birdseye.near ({view.near:g} m) '
                f'by at least two cells of {side:g} m'
            )
        if view.half_width and view.half_width < side:
            raise ParameterError('birdseye.half_width must be at least birdseye.resolution')

    def _check_size(self) -> None:
        view, search = self.birdseye, self.search
        if not view.automatic:
            cells = (view.far - view.near) * 2.0 * view.half_width / view.resolution**2
            if cells > MAX_VIEW_CELLS:
                raise ParameterError(
                    f'the bird\'s-eye view would have {cells:.3g} cells, more than '
                    f'{MAX_VIEW_CELLS:.0e}: raise birdseye.resolution or shrink the view'
                )
        side = 2.0 / (view.resolution or ASSUMED_CELL)
        candidates = (1.0 + side * search.x) * (1.0 + side * search.y) * (
            1.0 + 2.0 * search.yaw / search.yaw_step
        )
        if candidates > MAX_CANDIDATES:
            raise ParameterError(
                f'the search window would have {candidates:.3g} candidates, more than '
                f'{MAX_CANDIDATES:.0e}: shrink search.x, search.y or search.yaw, or raise '
                'search.yaw_step or birdseye.resolution'
            )


ASSUMED_CELL = 0.05
"""Side of a cell with which a window is checked before an automatic one is chosen, metres; chosen:
that of a usual map of roads. The window is checked again with the chosen one."""
LEAST_CELL = 0.001
"""Least side of a given cell of the view, metres; chosen."""
MAX_VIEW_CELLS = 4e6
"""Largest number of cells of a view; chosen, so that it needs less than about 100 MB."""
MAX_CANDIDATES = 2e9
"""Largest number of poses in a window; chosen, so that its scores need less than 10 GB."""


def load_parameter_file(path: Path | str) -> Parameters:
    """Read a ROS parameter file (raises ParameterError naming the file and the fault)."""
    try:
        return Parameters.from_dict(load_ros_yaml(path))
    except ParameterError as error:
        if str(path) in str(error):
            raise
        raise ParameterError(f'parameter file {path}: {error}') from None


def dump_parameter_file(parameters: Parameters) -> str:
    """Return the parameters as a ROS parameter file."""
    return dump_ros_yaml(parameters.to_dict())
