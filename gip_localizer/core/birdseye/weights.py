# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Step 2: noise of a frame, and the weight of each cell of its bird's-eye view."""

from __future__ import annotations

from dataclasses import dataclass

from gip_localizer.core.arrays import Floats, Grey
from gip_localizer.core.birdseye.pixel_noise import estimate_pixel_noise
from gip_localizer.core.birdseye.rectifier import View
from gip_localizer.core.gramian import gramian, most_gain
from gip_localizer.parameters import Score


@dataclass(frozen=True)
class NoiseLevels:
    """
    Standard deviations of a frame, in grey levels of [0, 1] of the view.

    Attributes
    ----------
    pixel : float
        Of the image's pixels.
    map : float
        Of the map's cells.

    """

    pixel: float
    map: float


def noise_levels(
    view: View, image: Grey, score: Score, *, gain: float | None, map_contrast: float
) -> NoiseLevels:
    """
    Return the noise of a frame.

    Parameters
    ----------
    view : View
        Bird's-eye view of the image.
    image : (height, width) uint8, uint16 or float32
        Grey image.
    score : Score
        Noise of pixels (0: estimated) and of the map; metric.
    gain : float or None
        Of the image relative to the map; None: the largest that the view allows.
    map_contrast : float
        Standard deviation of the map, grey levels of [0, 1].

    """
    pixel = score.pixel_noise or estimate_pixel_noise(image)
    gain = gain or most_gain(
        view.patch, view.footprint, pixel_noise=pixel, map_contrast=map_contrast
    )
    return NoiseLevels(pixel, score.map_noise * (gain if score.normalized else 1.0))


def cell_weights(view: View, noise: NoiseLevels, score: Score) -> Floats:
    """Return the Gramian's diagonal (rows, cols); equal weights for a Euclidean metric."""
    weight = gramian(view.footprint, pixel_noise=noise.pixel, map_noise=noise.map)
    if score.metric.startswith('euclidean'):
        return view.valid * weight[view.valid].mean()
    return weight
