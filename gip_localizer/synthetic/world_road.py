# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
A closed two-lane road of about 60 x 40 m: straights, bends, an S-curve, paint and wear.

Sizes (metres) and reflectances are chosen like those of a European city street.

"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gip_localizer.synthetic import asphalt, markings
from gip_localizer.synthetic.canvas import Canvas, paint
from gip_localizer.synthetic.paths import Path, rounded_loop
from gip_localizer.synthetic.texture import smooth_step, value_noise

Floats = NDArray[np.float64]
Floats32 = NDArray[np.float32]

LANE = 3.5
"""Width of a lane, metres; chosen."""
PAINT = 0.78
"""Reflectance of road paint, in [0, 1]; chosen."""
OUTLINE = np.array([
    [0.40, 0.20], [0.84, 0.20], [0.84, 0.78], [0.68, 0.78], [0.54, 0.66], [0.42, 0.66],
    [0.28, 0.78], [0.15, 0.78], [0.15, 0.20],
])
"""Corners of the centre line, as fractions of the world's width and height; chosen."""


def centre_line(width: float, height: float) -> Path:
    """Return the road's closed centre line in the grid frame, counter-clockwise."""
    return rounded_loop(OUTLINE * np.array([width, height]), 0.11 * min(width, height))


def road(width: float, height: float, resolution: float, *, seed: int) -> tuple[Floats32, Path]:
    """
    Return the world and the centre of its right lane.

    Parameters
    ----------
    width, height : float
        Size of the world, metres.
    resolution : float
        Metres per cell.
    seed : int
        Same seed, same world.

    Returns
    -------
    grey : (rows, cols) float32
        Reflectance in [0, 1]; row 0 is the top.
    lane : Path
        Centre of the lane to drive, in the grid frame (origin in the lower-left corner).

    """
    rng = np.random.default_rng([seed, 1])
    canvas = Canvas.of_size(width, height, resolution)
    centre = centre_line(width, height)
    grey = _surface(canvas, centre, rng)
    _wear_and_repairs(grey, canvas, centre, rng)
    coverage = canvas.polygons(_paintwork(centre))
    wear = value_noise(canvas.shape, resolution, 0.06, rng)
    wear += value_noise(canvas.shape, resolution, 0.8, rng)
    strength = 0.25 + 0.7 * smooth_step(wear, -2.2, 0.2)
    paint(grey, np.asarray(coverage * strength, np.float32), PAINT)
    return np.clip(grey, 0.02, 0.98), centre.shifted(-0.5 * LANE)


def _surface(canvas: Canvas, centre: Path, rng: np.random.Generator) -> Floats32:
    """Return the surface of verge, kerb and asphalt with darker wheel tracks."""
    grey = asphalt.verge(canvas, rng)
    surface = asphalt.asphalt(canvas, rng)
    paint(grey, canvas.polygons(markings.solid_line(centre, 0.0, 2 * LANE + 1.6)), 0.42)
    grain = value_noise(canvas.shape, canvas.resolution, 0.02, rng)
    road_mask = canvas.polygons(markings.solid_line(centre, 0.0, 2 * LANE + 1.2))
    grey += np.float32(0.02) * grain * (1.0 - road_mask)
    paint(grey, road_mask, surface)
    tracks = [
        outline
        for d in (-2.55, -0.95, 0.95, 2.55)
        for outline in markings.solid_line(centre, d, 0.45)
    ]
    grey -= np.float32(0.025) * canvas.polygons(tracks)
    return grey


def _wear_and_repairs(
    grey: Floats32, canvas: Canvas, centre: Path, rng: np.random.Generator
) -> None:
    """Add patches, stains, cracks and manholes along the road, in place."""
    places, yaws = _scatter(centre, centre.length / 8.0, rng)
    asphalt.add_patches(grey, canvas, places, yaws, rng)
    places, _ = _scatter(centre, centre.length / 2.0, rng)
    asphalt.add_stains(grey, canvas, places, rng)
    places, yaws = _scatter(centre, centre.length / 3.0, rng)
    asphalt.add_cracks(grey, canvas, places, yaws + rng.normal(0.0, 0.7, len(yaws)), rng)
    places, _ = _scatter(centre, centre.length / 18.0, rng)
    asphalt.add_manholes(grey, canvas, places)


def _scatter(
    centre: Path, count: float, rng: np.random.Generator
) -> tuple[Floats, Floats]:
    """Return random places (n, 2), one per section of the road, and the headings (n,) there."""
    number = round(count)
    stretch = centre.length / number
    arcs = stretch * (np.arange(number) + rng.uniform(0.1, 0.9, number))
    return centre.offset_positions(arcs, rng.uniform(-LANE, LANE, number)), centre.heading(arcs)


def _paintwork(centre: Path) -> list[Floats]:
    """Return the outlines of all road markings."""
    length = centre.length
    outlines = markings.dashed_line(centre, 0.0)
    for side in (-1.0, 1.0):
        outlines += markings.solid_line(centre, side * (LANE - 0.1))
    for share, half in ((0.10, LANE), (0.62, LANE)):
        outlines += markings.crosswalk(centre, share * length, half)
        outlines += markings.stop_line(centre, share * length - 1.5, -LANE + 0.2, -0.1)
        outlines += markings.stop_line(centre, share * length + 4.1, 0.1, LANE - 0.2)
    arrows = ((0.04, markings.STRAIGHT_ARROW), (0.3, markings.LEFT_ARROW),
              (0.47, markings.STRAIGHT_ARROW), (0.57, markings.LEFT_ARROW),
              (0.8, markings.STRAIGHT_ARROW))
    for share, outline in arrows:
        outlines.append(markings.symbol(centre, outline, share * length, -0.5 * LANE))
        place = (share + 0.09) * length
        outlines.append(markings.symbol(centre, outline, place, 0.5 * LANE, flip=True))
    return outlines + markings.parking_bays(centre, 0.01 * length, 3, LANE + 1.9)
