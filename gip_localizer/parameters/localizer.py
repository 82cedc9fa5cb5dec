# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Every tunable of the localizer, once: default, unit, bounds and meaning.

The node's declarations, `config/localizer.yaml`, `docs/parameters.md` and the command line's
`--set` are made from it. A new parameter is one line here and `make params`.

"""

from __future__ import annotations

from dataclasses import dataclass
import math
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
from gip_localizer.parameters.spec import dump_ros_yaml, group, load_ros_yaml, ParameterGroup
from gip_localizer.parameters.spec import parameter as p

METRICS = ('gip', 'gip_normalized', 'euclidean', 'euclidean_normalized')


@dataclass(frozen=True)
class Camera:
    """Pose of the camera in the base frame, and what its images are."""

    x: float = p(0.0, 'Camera position ahead of base_link.', unit='m', low=-50.0, high=50.0)
    y: float = p(0.0, 'Camera position left of base_link.', unit='m', low=-50.0, high=50.0)
    z: float = p(1.5, 'Camera height above the road.', unit='m', low=0.01, high=100.0)
    roll: float = p(0.0, 'Rotation about the forward axis.', unit='rad', low=-3.2, high=3.2)
    pitch: float = p(
        math.radians(15.0), 'Rotation about the left axis; nose down is positive.',
        unit='rad', low=-1.6, high=1.6,
    )
    yaw: float = p(0.0, 'Rotation about the up axis.', unit='rad', low=-3.2, high=3.2)
    rectified: bool = p(
        False, 'True: the images are rectified already (use P, no distortion); false: raw (K, D).'
    )


@dataclass(frozen=True)
class MountedCamera(Camera):
    """A camera in a vehicle, whose pose may also come from TF."""

    from_tf: bool = p(
        False, 'Take the pose of the camera from /tf_static (base to the frame of the image) '
        'instead of the six numbers (needs tf2_msgs).', read_only=True,
    )
    sigma_yaw: float = p(
        0.0035, 'Standard deviation of the calibrated yaw (0.2 degrees): no frame shows this '
        'error, and all share it. 0: the yaw is exact.', unit='rad', low=0.0, high=0.2,
    )


@dataclass(frozen=True)
class Birdseye:
    """The patch of road that is matched, in the base frame."""

    near: float = p(0.0, 'Nearest edge ahead of base_link; 0: automatic.', unit='m', low=-100.0,
                    high=200.0)
    far: float = p(0.0, 'Farthest edge ahead of base_link; 0: automatic.', unit='m', low=-100.0,
                   high=200.0)
    half_width: float = p(0.0, 'Half of the width, left and right; 0: automatic.', unit='m',
                          low=0.0, high=100.0)
    resolution: float = p(0.0, 'Side of a cell, at least 0.001; 0: automatic.', unit='m', low=0.0,
                          high=2.0)

    @property
    def automatic(self) -> tuple[str, ...]:
        """Names of the values that are chosen from camera and map: those that are 0."""
        return tuple(name for name, value in vars(self).items() if value == 0.0)


@dataclass(frozen=True)
class Search:
    """The window of candidates around the prior."""

    x: float = p(0.75, 'Half-width ahead and behind.', unit='m', low=0.0, high=1000.0)
    y: float = p(0.75, 'Half-width left and right.', unit='m', low=0.0, high=1000.0)
    yaw: float = p(0.07, 'Half-width in heading.', unit='rad', low=0.0, high=3.1416)
    yaw_step: float = p(0.00875, 'Step in heading.', unit='rad', low=1e-4, high=0.5)


@dataclass(frozen=True)
class Score:
    """How a candidate is scored."""

    metric: str = p(
        'gip_normalized',
        'Norm: gip (Gramian-weighted), gip_normalized (gain and offset profiled out), '
        'euclidean and euclidean_normalized (equal weights, the baselines).',
        choices=METRICS,
    )
    min_overlap: float = p(
        0.5, 'Least share of the weight that must fall on known map cells.', low=0.05, high=1.0
    )
    pixel_noise: float = p(
        0.0, 'Noise of a pixel, grey levels of [0, 1]; 0: estimated from each frame.',
        low=0.0, high=1.0,
    )
    map_noise: float = p(
        0.02, 'Noise of a map cell that no footprint averages away, grey levels of [0, 1].',
        low=0.0, high=1.0,
    )
    robust: bool = p(True, 'Down-weight cells that disagree with the map (cars, shadows).')

    @property
    def normalized(self) -> bool:
        """Whether the metric profiles gain and offset out."""
        return self.metric.endswith('normalized')


@dataclass(frozen=True)
class Motion:
    """Motion between frames: noise of the odometry, and growth of the uncertainty with time."""

    sigma_xy_per_m: float = p(0.05, 'Odometry drift per metre driven.', unit='m/m', low=0.0,
                              high=1.0)
    sigma_yaw_per_m: float = p(0.005, 'Odometry drift in heading per metre driven.',
                               unit='rad/m', low=0.0, high=1.0)
    sigma_xy_per_s: float = p(0.05, 'Growth of the position uncertainty with time.',
                              unit='m/s', low=0.0, high=100.0)
    sigma_yaw_per_s: float = p(0.01, 'Growth of the heading uncertainty with time.',
                               unit='rad/s', low=0.0, high=10.0)
    max_gap: float = p(0.5, 'Longest gap of odometry that is bridged.', unit='s', low=0.01,
                       high=60.0)
    max_speed: float = p(70.0, 'Faster motion in odometry is refused as a jump.', unit='m/s',
                         low=0.1, high=400.0)
    fuse: bool = p(True, 'Fuse each match with the prediction; false: publish the match alone.')


@dataclass(frozen=True)
class CameraMotion:
    """How far the suspension moves the camera from its calibration."""

    sigma_pitch: float = p(0.005, 'Pitch about its calibrated value; 0: fixed.', unit='rad',
                           low=0.0, high=0.1)
    sigma_roll: float = p(0.001, 'Roll about its calibrated value; 0: fixed.', unit='rad',
                          low=0.0, high=0.1)
    sigma_height: float = p(0.003, 'Height about its calibrated value; 0: fixed.', unit='m',
                            low=0.0, high=0.5)


@dataclass(frozen=True)
class Integrity:
    """Limits below or above which a match is not published."""

    min_confidence: float = p(
        0.9, 'Least probability that a match is at the right place, to be published.',
        low=0.0, high=1.0,
    )
    min_confidence_tracking: float = p(
        0.35, 'The same for a match that lies where earlier fixes and the motion predict it.',
        low=0.0, high=1.0,
    )
    min_winner_mass: float = p(
        0.9, 'Least share of the posterior in the winning mode, unless its margin is large.',
        low=0.0, high=1.0,
    )
    min_contrast: float = p(
        0.002, 'Least weighted standard deviation of the view, grey levels of [0, 1].', low=0.0,
        high=1.0,
    )
    max_sigma_xy: float = p(0.5, 'Largest standard deviation that is published.', unit='m',
                            low=1e-3, high=100.0)
    max_sigma_yaw: float = p(0.05, 'Largest heading standard deviation that is published.',
                             unit='rad', low=1e-4, high=3.2)
    risk: float = p(1e-5, 'Probability with which an error may exceed the protection level.',
                    low=1e-9, high=0.1)
    alert_ahead: float = p(0.0, 'Largest protection level along the vehicle that counts as '
                           'valid; 0: any.', unit='m', low=0.0, high=1000.0)
    alert_left: float = p(0.0, 'The same across the vehicle; 0: any.', unit='m', low=0.0,
                          high=1000.0)
    alert_yaw: float = p(0.0, 'The same in heading; 0: any.', unit='rad', low=0.0, high=3.2)
    lost_after: int = p(5, 'Frames in a row without a fix after which the node is lost.', low=1,
                        high=10000)


@dataclass(frozen=True)
class Recovery:
    """Search of the whole map after a loss."""

    automatic: bool = p(True, 'Search the whole map when lost; false: only on request.')
    period: float = p(1.0, 'Least time between two automatic searches.', unit='s', low=0.0,
                      high=3600.0)
    confirm_frames: int = p(3, 'Frames that must agree before a found pose is published.', low=1,
                            high=1000)
    yaw_step: float = p(0.035, 'Step in heading of the search.', unit='rad', low=0.01, high=0.5)
    cell: float = p(0.2, 'Side of the smallest cells of the search, coarse to fine.', unit='m',
                    low=0.01, high=5.0)


@dataclass(frozen=True)
class MapErrors(ParameterGroup):
    """Accuracy of the map; the larger value counts where its YAML file names it too."""

    sigma_xy: float = p(
        0.0, 'Standard deviation of x and of y at which the map shows a part of the road. It '
        'does not average out over frames.', unit='m', low=0.0, high=10.0,
    )
    sigma_yaw: float = p(0.0, 'The same of the direction of the road.', unit='rad', low=0.0,
                         high=0.1)


@dataclass(frozen=True)
class Parameters(ParameterGroup):
    """All parameters of the node `localizer`."""

    map_file: str = p('', 'Map: a nav2 map_server YAML file; another one may be set while the '
                      'node runs, and is refused where it cannot be read.')
    map_keeps_pose: bool = p(True, 'What becomes of the pose when map_file changes. True: it is '
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
