# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
How many road samples a pixel takes, and where inside the pixel.

A pixel shows the mean of the road over its footprint. Near the camera a footprint is smaller
than a cell of the world, and one sample is enough. Far away it is metres long and centimetres
wide. Therefore each pixel is divided into nu x nv strata, and the samples are read from a level
of an image pyramid that is no coarser than half of the footprint's short side. This module does
not use bird's-eye views: the renderer must not share a simplification with the code that it tests.

"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gip_localizer.core.camera.model import CameraModel
from gip_localizer.synthetic.pixel_grid import PixelGrid

Floats = NDArray[np.float64]
Floats32 = NDArray[np.float32]
Ints = NDArray[np.int64]

_STEPS = np.array([1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 256, 512, 1024])
"""Allowed numbers of strata per side; chosen, and few, so that many pixels share a group."""
_ROW = 1024
"""Samples in a row of `SampleGroup.rays`; below OpenCV's limit of 32767 for an image side."""
_SKY = 0.03
"""Largest nominal elevation, in rad, of sampled rays: suspension may lower them; chosen."""
_HAZE = -0.004
"""Elevation, in rad, above which one sample is enough (375 m away from 1.5 m up); chosen."""


@dataclass(frozen=True)
class Quality:
    """
    Sampling density of the road.

    Attributes
    ----------
    spacing : float
        Largest distance of neighbouring samples, in cells of the pyramid level that is read.
    short_side : float
        Least number of cells of that level along the short side of a footprint (levels above 0).
    least : int
        Least number of strata along each side of a pixel.
    most : int
        Largest number of samples per pixel. If more were needed, a coarser level is used; at the
        coarsest level the samples are reduced.
    max_level : int
        Coarsest level of the pyramid.

    """

    spacing: float
    short_side: float
    least: int
    most: int
    max_level: int


FAST = Quality(spacing=0.75, short_side=2.0, least=1, most=48, max_level=5)
"""Density for live use; chosen, and compared with `EXACT` in test/test_synthetic_renderer.py."""
EXACT = Quality(spacing=0.5, short_side=2.0, least=3, most=600, max_level=0)
"""Density for reference images: two samples per cell of the world along each side; chosen."""


@dataclass(frozen=True, eq=False)
class SampleGroup:
    """
    Pixels with the same number of samples and the same pyramid level.

    Attributes
    ----------
    pixels : (m,) int64
        Flat indices in the image.
    samples : int
        Samples per pixel, n.
    level : int
        Pyramid level that is read.
    rays : (rows, 1024, 2) float32
        Undistorted normalised coordinates of the n x m samples, sample by sample. They are
        arranged in rows because OpenCV limits the sides of an image; the last sample is repeated
        to fill the last row.

    """

    pixels: Ints
    samples: int
    level: int
    rays: Floats32


def sample_groups(
    grid: PixelGrid, camera: CameraModel, cell: float, quality: Quality, *, chunk: int = 1 << 40
) -> Iterator[SampleGroup]:
    """
    Yield the pixels that can see the road, grouped by number of samples and pyramid level.

    Parameters
    ----------
    grid : PixelGrid
        Rays of the camera's pixels.
    camera : CameraModel
        Camera whose nominal pose determines the numbers of samples.
    cell : float
        Side of a cell of the world, metres.
    quality : Quality
        Sampling density.
    chunk : int
        Largest number of samples in one group.

    """
    along_u, along_v, rise = grid.footprints(camera)
    candidates = np.flatnonzero((rise < _SKY) & grid.visible.ravel())
    far = rise[candidates] > _HAZE
    sides = [np.where(far, 0.0, side[candidates]) for side in (along_u, along_v)]
    level, nu, nv = _strata(sides[0], sides[1], cell, quality)
    keys = (level * 4096 + nu) * 4096 + nv
    for key in np.unique(keys):
        members = candidates[keys == key]
        at, strata = int(key >> 24), (int(key >> 12) & 4095, int(key) & 4095)
        most = max(1, chunk // (strata[0] * strata[1]))
        for start in range(0, len(members), most):
            pixels = members[start : start + most]
            spread_u = _spread(along_u[pixels] / cell, strata[0], at)
            spread_v = _spread(along_v[pixels] / cell, strata[1], at)
            rays = _in_rows(grid.rays_in(pixels, strata, (spread_u, spread_v)).reshape(-1, 2))
            yield SampleGroup(pixels, strata[0] * strata[1], at, rays)


def _strata(
    along_u: Floats, along_v: Floats, cell: float, quality: Quality
) -> tuple[Ints, Ints, Ints]:
    """Return level, nu and nv for footprints with the given sides."""
    short = np.maximum(np.minimum(along_u, along_v) / (cell * quality.short_side), 1.0)
    level = np.minimum(np.log2(short).astype(np.int64), quality.max_level)
    nu, nv = (_count(side, level, cell, quality) for side in (along_u, along_v))
    for _ in range(quality.max_level):
        level = np.where((nu * nv > quality.most) & (level < quality.max_level), level + 1, level)
        nu, nv = (_count(side, level, cell, quality) for side in (along_u, along_v))
    nu = np.minimum(nu, quality.most)
    return level, nu, np.minimum(nv, quality.most // nu)


def _count(side: Floats, level: Ints, cell: float, quality: Quality) -> Ints:
    """Return the number of strata that keeps the spacing, rounded up to one of `_STEPS`."""
    needed = np.ceil(side / (quality.spacing * cell * 2.0**level) - 1e-9)
    needed = np.maximum(needed, quality.least)
    return _STEPS[np.minimum(np.searchsorted(_STEPS, needed), len(_STEPS) - 1)]


def _spread(side: Floats, strata: int, level: int) -> Floats:
    """
    Return the factor on sample offsets that gives the samples the footprint's second moment.

    The second moment of n samples is side²/12 · (1 - 1/n²). A level above 0 adds to it: its cells
    are box means, and the interpolation between them is bilinear, as in the world itself.

    Parameters
    ----------
    side : (m,) float64
        Sides of the footprints, in cells of the world.
    strata : int
        Samples along that side, n.
    level : int
        Pyramid level that is read.

    """
    if strata == 1:
        return np.ones(len(side))
    joined = 4.0**level
    blur = (joined - 1.0) / 12.0 + (joined - 1.0) / 6.0
    wanted = np.maximum(side**2 / 12.0 - blur, 0.0)
    return np.sqrt(wanted / (np.maximum(side, 1e-9) ** 2 / 12.0 * (1.0 - strata**-2)))


def _in_rows(rays: Floats32) -> Floats32:
    """Return rays (n, 2) as (rows, 1024, 2); the last ray is repeated to fill the last row."""
    missing = -len(rays) % _ROW
    filled = np.concatenate([rays, np.repeat(rays[-1:], missing, axis=0)])
    return filled.reshape(-1, _ROW, 2)
