# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether an image and its mask fit the camera."""

from __future__ import annotations

import numpy as np

from gip_localizer.core.arrays import Grey
from gip_localizer.core.camera.model import CameraModel


def image_fault(image: Grey, mask: Grey | None, camera: CameraModel) -> str:
    """Return why an image or its mask cannot be used; empty where they can."""
    size = (camera.height, camera.width)
    for name, pixels in (('image', image), ('mask', mask)):
        if pixels is not None and pixels.shape != size:
            return (
                f'the {name} has shape {pixels.shape}; expected grey of the camera\'s {size}'
            )
    if image.dtype.kind == 'f' and not np.isfinite(image).all():
        return 'the image holds NaN or infinity'
    return ''
