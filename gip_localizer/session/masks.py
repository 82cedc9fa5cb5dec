# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Masks for the localizer: the fixed one of `mask_file`, and those of messages."""

from __future__ import annotations

from typing import Any

import numpy as np

from gip_localizer.core.arrays import Grey
from gip_localizer.core.birdseye.rectifier import MASK_USED
from gip_localizer.errors import ImageError
from gip_localizer.io.images import grey_image

MASK_ENCODINGS = ('mono8', '8UC1')


class MaskError(ImageError):
    """A mask message cannot be used."""


def mask_image(message: Any, shape: tuple[int, int]) -> Grey:
    """
    Return the mask of a sensor_msgs/Image.

    Parameters
    ----------
    message : sensor_msgs/Image
        mono8 or 8UC1; pixels of 128 and above are used.
    shape : (height, width)
        Of the image that the mask belongs to.

    Returns
    -------
    (height, width) uint8
        A view of the message's data.

    Raises
    ------
    MaskError
        Another encoding or size, damaged data, or class numbers instead of black and white.

    """
    encoding = str(message.encoding)
    if encoding not in MASK_ENCODINGS:
        raise MaskError(f'mask encoding {encoding!r}; expected {" or ".join(MASK_ENCODINGS)}')
    try:
        mask = grey_image(message)
    except ImageError as error:
        raise MaskError(f'mask: {error}') from None
    if mask.shape != shape:
        (rows, cols), (height, width) = mask.shape, shape
        raise MaskError(f'mask is {cols}x{rows}, the image {width}x{height}; resize the mask')
    largest = int(mask.max())
    if 0 < largest < MASK_USED:
        raise MaskError(
            f'the largest value of the mask is {largest}; expected 255 on the road '
            'and 0 elsewhere, not class numbers'
        )
    return mask


def both(first: Grey | None, second: Grey | None) -> Grey | None:
    """Return the mask of pixels that both masks use; None is a mask that uses all pixels."""
    if first is None or second is None:
        return first if second is None else second
    return np.minimum(first, second)


def fitting(mask: Grey | None, image: Grey) -> Grey | None:
    """Return the mask of `mask_file`; raise ImageError if its size differs from the image."""
    if mask is not None and mask.shape != image.shape:
        (rows, cols), (height, width) = mask.shape, image.shape
        raise ImageError(
            f'mask_file is {cols}x{rows}, the image {width}x{height}; '
            'draw the mask on an image of this camera'
        )
    return mask
