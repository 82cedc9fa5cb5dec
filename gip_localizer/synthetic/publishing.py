# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Parameters that the node `synthetic_camera` has beyond those of the camera itself."""

from __future__ import annotations

from dataclasses import dataclass

from gip_localizer.parameter_specs import group
from gip_localizer.parameter_specs import parameter as p
from gip_localizer.synthetic.parameters import SyntheticCameraParameters


@dataclass(frozen=True)
class Publishing:
    """How frames go out."""

    transport: str = p('raw', 'Which topic carries the images: image, or image/compressed.',
                       choices=('raw', 'compressed'), read_only=True)
    jpeg_quality: int = p(90, 'Quality of compressed images.', low=1, high=100)
    wait: bool = p(False, 'Set out when someone listens to image, camera_info and odom.',
                   read_only=True)


@dataclass(frozen=True)
class CameraNodeParameters(SyntheticCameraParameters):
    """All parameters of the node `synthetic_camera`."""

    publish: Publishing = group(Publishing)
