# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Suite `rectify`: footprint means of an image, compared with one interpolating warp."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from gip_localizer.benchmark.rows import compared_row, interleaved, median, Row, spread
from gip_localizer.benchmark.scene import camera
from gip_localizer.core.birdseye.rectifier import Rectifier
from gip_localizer.synthetic.localizer_parameters import CAR_VIEW

BASELINE = 'cv2.warpPerspective(INTER_LINEAR)'


def rectify_suite(rounds: int) -> tuple[list[Row], dict[str, Any]]:
    """Return the row, and the noise of the cells relative to its law (paper, SNR)."""
    model = camera()
    rectifier = Rectifier(model, CAR_VIEW)
    grid = rectifier.grid
    image = np.random.default_rng(0).integers(0, 256, (model.height, model.width), np.uint8)
    near = grid.far - grid.rows * grid.resolution
    road = np.array([[grid.far, grid.left], [grid.far, -grid.left],
                     [near, grid.left], [near, -grid.left]])
    seen, _ = model.project(road)
    size = (grid.cols, grid.rows)
    view = np.array([[0, 0], [size[0], 0], [0, size[1]], size], np.float32)
    homography = cv2.getPerspectiveTransform(view, seen.astype(np.float32))
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    threads = cv2.getNumThreads()
    cv2.setNumThreads(cv2.getNumberOfCPUs())  # the baseline is faster with all cores
    times = interleaved({
        'ours': lambda: rectifier.rectify(image),
        'peer': lambda: cv2.warpPerspective(image, homography, size, flags=flags),
    }, rounds, warm=10)
    cv2.setNumThreads(threads)
    row = compared_row('rectify', '1280x720 to 200x160 cells', median(times['ours']), BASELINE,
                 median(times['peer']))
    details = {name: {'median_ms': median(t), 'spread_ms': spread(t)} for name, t in times.items()}
    return [row], {**details, 'variance_over_law': _variance_over_law(rectifier)}


def _variance_over_law(rectifier: Rectifier) -> dict[str, float]:
    """Return the mean over cells of variance times footprint, for white noise of variance 1."""
    rng = np.random.default_rng(1)
    model = rectifier.camera
    views = np.stack([
        rectifier.rectify(rng.standard_normal((model.height, model.width), np.float32)).patch
        for _ in range(200)
    ])
    share = views.var(axis=0) * rectifier.footprint
    bands = {'2 to 10 px': (2.0, 10.0), '10 to 40 px': (10.0, 40.0), 'above 40 px': (40.0, 1e9)}
    return {
        name: float(share[rectifier.valid & (rectifier.footprint >= low)
                          & (rectifier.footprint < high)].mean())
        for name, (low, high) in bands.items()
    }
