# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
The groups of parameters that decide on the match: default, unit, bounds and meaning, each once.

A new parameter is one line here and `make params`. The groups that tie the node into a stack are
in `integration.py`.

"""

from __future__ import annotations

from dataclasses import dataclass
import math

from gip_localizer.parameters.spec import parameter as p
from gip_localizer.parameters.spec import ParameterGroup

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
