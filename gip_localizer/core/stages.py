# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The stages of the refinement: which cells it looks at, coarse to fine."""

from __future__ import annotations

import numpy as np
from scipy import sparse

from gip_localizer.core.arrays import Floats
from gip_localizer.core.birdseye import Rectifier, View
from gip_localizer.core.camera import CameraModel
from gip_localizer.core.camera_sway import CameraSway
from gip_localizer.core.edge_noise import PixelSteps
from gip_localizer.core.levels import coarsened
from gip_localizer.core.robust import block_sums

STAGES = ((4, 6), (2, 6), (1, 12))  # cells joined per side, and the most steps
PLAIN_STEPS = 2  # of the first stage, before outliers are told from misalignment
LEAST_SCALE_SQ = 0.5  # residuals this small against the noise model are never outliers
PATTERN_SIDES = (1.0, 1.0)  # m: blocks that agree with the map, or do not
LEAST_CELLS = 200  # joined cells that a stage must have
OPTICAL_TERMS = 5


def make_stages(rectifier: Rectifier) -> list[Stage]:
    """Return the stages that the view has cells for; the last looks at all of them."""
    cells = int(np.count_nonzero(rectifier.valid))
    return [
        Stage(rectifier, factor, steps) for factor, steps in STAGES
        if factor == 1 or cells >= LEAST_CELLS * factor**2
    ]


class Stage:
    """The cells of one stage: joined by a factor, or all of them with the pixel blur."""

    def __init__(self, rectifier: Rectifier, factor: int, steps: int) -> None:
        self.factor = factor
        self.steps = steps
        self.plain = PLAIN_STEPS if factor == STAGES[0][0] else 0
        self.least_scale_sq = LEAST_SCALE_SQ * factor**2
        weight = rectifier.valid.astype(np.float32)
        blank = View(weight, rectifier.footprint, rectifier.valid, rectifier.grid)
        view, _ = coarsened(blank, weight, factor)
        self.resolution = view.grid.resolution
        self.index = np.flatnonzero(view.valid)
        points = view.grid.points() if factor > 1 else rectifier.centroids
        self.sway = CameraSway(rectifier.camera, points[self.index])
        self.blocks = block_sums(self.sway.x, self.sway.y, PATTERN_SIDES)
        self.optical = optical_basis(rectifier.camera, points[self.index])
        self.blur: sparse.csr_matrix | None = rectifier.pixel_blur if factor == 1 else None

        self.pixel_steps: PixelSteps | None = None
        if factor == 1:
            footprint = rectifier.footprint.ravel()[self.index]
            self.pixel_steps = PixelSteps(rectifier.camera, points[self.index], footprint)

    def blurred(self, columns: Floats) -> Floats:
        """Return columns behind the pixel blur."""
        return columns if self.blur is None else np.asarray(self.blur @ columns)


def optical_basis(camera: CameraModel, points: Floats) -> Floats:
    """Smooth functions (n, 5) of the pixels that see road points, of order one, mean zero."""
    uv, _ = camera.project(points.astype(np.float64))
    u = uv[:, 0] / (0.5 * camera.width) - 1.0
    v = uv[:, 1] / (0.5 * camera.width) - camera.height / camera.width
    basis = np.nan_to_num(np.stack([u, v, u * u, u * v, v * v], axis=1))
    return (basis - basis.mean(axis=0)).astype(np.float32)
