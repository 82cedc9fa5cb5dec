# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""16 bit pictures of which only the lower 8, 10, 12 or 14 bits are used."""

from __future__ import annotations

import numpy as np

from gip_localizer.core.arrays import Grey

DEPTHS = (8, 10, 12, 14, 16)
"""Bit depths of common image sensors (bits)."""


def bits_used(image: Grey) -> int:
    """Return the least depth of `DEPTHS` that holds the largest value of an image."""
    largest = int(image.max(initial=0))
    return next(bits for bits in DEPTHS if largest < 1 << bits)


def at_full_scale(image: Grey, bits: int) -> Grey:
    """Return a uint16 image whose values take `bits` bits at the scale of its type, or uint8."""
    if bits == 8:
        return image.astype(np.uint8)
    return image if bits == 16 else image << np.uint16(16 - bits)


class BitDepth:
    """
    The bit depth of a camera, from all its images, so that a dark one is not brightened.

    Attributes
    ----------
    bits : int
        Largest depth so far; 0 before the first 16 bit image.

    """

    def __init__(self) -> None:
        self.bits = 0

    def scaled(self, image: Grey) -> Grey:
        """Return a (height, width) image at full scale; uint16 may become uint8."""
        if image.dtype != np.uint16:
            return image
        if self.bits < DEPTHS[-1]:
            self.bits = max(self.bits, bits_used(image))
        return at_full_scale(image, self.bits)

    def note(self, image: Grey) -> str:
        """Return a remark on an unscaled image; empty if all bits are used."""
        if image.dtype != np.uint16 or self.bits in (0, DEPTHS[-1]):
            return ''
        return (f'16 bit images use {self.bits} bits (largest value {int(image.max())}) and are '
                f'scaled by 2^{16 - self.bits}')
