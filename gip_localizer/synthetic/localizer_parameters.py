# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of a localizer for a synthetic drive: its camera, a visible view and a prior."""

from __future__ import annotations

import numpy as np

from gip_localizer.core.camera.model import CameraModel
from gip_localizer.core.pose import Pose2
from gip_localizer.errors import CalibrationError
from gip_localizer.parameters import Birdseye, Parameters
from gip_localizer.synthetic.drive import SyntheticDrive

_STREAM = 7101
"""Seed of the prior's random stream (no unit); any number that no other stream uses."""
LONGEST = 10.0
"""Largest length of the view, metres: that of the default view (2.5 to 12.5 m ahead)."""
FINE_VIEW = 4.0
"""Views shorter than this, in metres, get cells of half the default size; chosen."""


def localizer_parameters(drive: SyntheticDrive, *, compressed: bool = False) -> Parameters:
    """
    Return parameters with which a localizer can follow a drive.

    The initial pose is the true start plus a random error that is drawn with the standard
    deviations of the prior.

    Parameters
    ----------
    drive : SyntheticDrive
        The drive whose camera, frame names and start are used.
    compressed : bool
        True: the images are published compressed.

    Raises
    ------
    CalibrationError
        The camera sees no road.

    """
    values: dict[str, object] = {
        name: value for name, value in drive.parameters.to_dict().items()
        if name.startswith(('camera.', 'frames.'))
    }
    start = _perturbed(drive.truth(0), drive.parameters.seed)
    values |= {
        'camera.sigma_yaw': 0.0,  # the simulated mount is exact
        'image_transport': 'compressed' if compressed else 'raw',
        'initial_pose.set': True, 'initial_pose.x': start.x, 'initial_pose.y': start.y,
        'initial_pose.yaw': start.yaw, **_view(drive.camera),
    }
    return Parameters.from_dict(values)


def _perturbed(truth: Pose2, seed: int) -> Pose2:
    prior = Parameters().initial_pose
    sigma = np.array([prior.sigma_xy, prior.sigma_xy, prior.sigma_yaw])
    draw = np.clip(np.random.default_rng([seed, _STREAM]).standard_normal(3), -2.0, 2.0)
    x, y, yaw = (float(value) for value in np.array(truth) + sigma * draw)
    return Pose2(round(x, 3), round(y, 3), round(yaw, 4))


def _view(camera: CameraModel) -> dict[str, object]:
    """Return no change if the camera sees 70 % of the default view, else the view that it sees."""
    near, far, half_width = _seen(camera)
    usual = Birdseye()
    if min(far, usual.far) - max(near, usual.near) > 0.7 * (usual.far - usual.near):
        return {}
    far = min(far, near + LONGEST)
    resolution = usual.resolution if far - near > FINE_VIEW else 0.5 * usual.resolution
    return {
        'birdseye.near': round(near, 2), 'birdseye.far': round(far, 2),
        'birdseye.half_width': round(min(half_width, usual.half_width), 2),
        'birdseye.resolution': resolution,
    }


def _seen(camera: CameraModel) -> tuple[float, float, float]:
    """Nearest and farthest road in the middle column, and half the width there, metres."""
    rows = np.linspace(0.0, camera.height - 1.0, 200)
    middle = np.stack([np.full(200, (camera.width - 1) / 2.0), rows], axis=1)
    xy, valid = camera.road_points(middle)
    if not valid.any():
        raise CalibrationError('the synthetic camera sees no road; pitch it down')
    x = np.clip(xy[valid, 0], None, 100.0)
    edge, seen = camera.road_points(np.array([[0.0, rows[valid][np.argmax(x)]]]))
    half_width = abs(float(edge[0, 1])) if seen[0] else Birdseye().half_width
    return float(x.min()), float(x.max()), half_width
