# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of a localizer for a synthetic drive: its camera, a visible view and a prior."""

from __future__ import annotations

import numpy as np

from gip_localizer.core.birdseye.view_choice import choose_view
from gip_localizer.core.pose import Pose2
from gip_localizer.parameters import Birdseye, Parameters
from gip_localizer.synthetic.drive import SyntheticDrive

_STREAM = 7101
"""Number of the prior's random stream (no unit); chosen: no other stream uses it."""
CAR_VIEW = Birdseye(near=2.5, far=12.5, half_width=4.0, resolution=0.05)
"""View of a camera 1.5 m above the road and 15 degrees down, for suites, demo and benchmark, whose
published numbers hold for it; chosen."""
LEAST_COMMON = 0.7
"""Least share of `CAR_VIEW` that the camera must see well for it to be used; chosen."""


def view_settings(view: Birdseye) -> dict[str, object]:
    """Return a view as parameters by name."""
    return {f'birdseye.{name}': value for name, value in vars(view).items()}


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
        'initial_pose.yaw': start.yaw, **view_settings(_view(drive)),
    }
    return Parameters.from_dict(values)


def _perturbed(truth: Pose2, seed: int) -> Pose2:
    prior = Parameters().initial_pose
    sigma = np.array([prior.sigma_xy, prior.sigma_xy, prior.sigma_yaw])
    draw = np.clip(np.random.default_rng([seed, _STREAM]).standard_normal(3), -2.0, 2.0)
    x, y, yaw = (float(value) for value in np.array(truth) + sigma * draw)
    return Pose2(round(x, 3), round(y, 3), round(yaw, 4))


def _view(drive: SyntheticDrive) -> Birdseye:
    """Return the view of a car if the camera sees most of it, else the view that suits it."""
    chosen = choose_view(drive.camera, drive.raster_map.resolution)
    common = min(chosen.far, CAR_VIEW.far) - max(chosen.near, CAR_VIEW.near)
    return CAR_VIEW if common > LEAST_COMMON * (CAR_VIEW.far - CAR_VIEW.near) else chosen
