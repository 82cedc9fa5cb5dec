# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The noise of a pixel, estimated from one frame."""

from __future__ import annotations

import numpy as np

from gip_localizer.core.arrays import Grey, upper_median, WHITE
from gip_localizer.core.gramian import NOISE_FLOOR

# Number of bands of three rows, spread over the image, in which the noise is measured (design
# choice: 12, because more take longer and do not change the median).
NOISE_BANDS = 12


def estimate_pixel_noise(image: Grey) -> float:
    """
    Standard deviation of the pixel noise, from one frame.

    The median of the second difference in both directions (Immerkær's mask), which straight
    edges and gradients leave at zero; texture at pixel scale counts as noise.

    Parameters
    ----------
    image : (h, w) uint8, uint16 or float32
        Grey image.

    Returns
    -------
    float
        Grey levels of [0, 1], at least `NOISE_FLOOR`.

    """
    if min(image.shape) < 5:
        return NOISE_FLOOR
    above, middle, below = _bands(image)
    down = above - 2 * middle + below
    response = np.abs(down[:, :-2] - 2 * down[:, 1:-1] + down[:, 2:])
    usual = _integer_median(response) if image.dtype == np.uint8 else upper_median(response)
    # a Gaussian's median absolute value is 0.6745 σ, and the mask's gain is 6
    sigma = usual / (0.6745 * 6.0) / WHITE.get(image.dtype, 1.0)
    return max(sigma, NOISE_FLOOR)


def _bands(image: Grey) -> tuple[Grey, Grey, Grey]:
    """Return three neighbouring rows of about `NOISE_BANDS` bands, (bands, w) int16 or float32."""
    step = max(image.shape[0] // NOISE_BANDS, 3)
    kind = np.int16 if image.dtype == np.uint8 else np.float32
    last = image.shape[0] - 2
    above, middle, below = (image[k : last + k : step].astype(kind) for k in range(3))
    return above, middle, below


def _integer_median(values: Grey) -> float:
    """Upper median of integers from 0 on, as `upper_median` gives it, by counting them."""
    counts = np.cumsum(np.bincount(values.ravel()))
    return float(np.searchsorted(counts, values.size // 2, side='right'))
