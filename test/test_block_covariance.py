# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The covariance of a fit, estimated from its residuals by blocks of road."""

from __future__ import annotations

import numpy as np
import pytest

from gip_localizer.core.refine.blocks import Blocks
from gip_localizer.core.refine.least_squares import LeastSquaresProblem
from gip_localizer.core.refine.smooth_errors import GEOMETRY

SIDE, UNKNOWNS = 28, 8


def problem(slopes, residual):
    """Return the problem after a fit, with weights of one and no prior."""
    ones, zeros = np.ones(len(residual), np.float32), np.zeros(UNKNOWNS)
    return LeastSquaresProblem(
        instruments=slopes, slopes=slopes, exact=lambda: slopes, scales=np.ones(UNKNOWNS),
        residual=residual, weights=ones, curvature=ones, all_weights=ones, predicted=ones,
        pattern=lambda: ones, gain=1.0, offset=0.0, scale_sq=1.0, pose_scale_sq=1.0,
        prior=zeros, prior_offset=zeros,
    )


@pytest.mark.parametrize('within', [0.0, 1.0])
def test_it_is_that_of_the_errors(within):
    # A few blocks hold more information than the others; `within`: errors common to a block.
    rng = np.random.default_rng(5)
    x, y = (np.indices((SIDE, SIDE)).reshape(2, -1) + 0.5).astype(np.float32)
    blocks = Blocks(x, y, (4.0, 4.0), (1, 1))
    x, y = x[blocks.order], y[blocks.order]
    block = (x // 4.0 * 7 + y // 4.0).astype(int)
    slopes = rng.normal(size=(UNKNOWNS, 49))[:, block] * rng.uniform(0.2, 2.0, 49)[block]
    slopes = (slopes + 0.3 * rng.normal(size=slopes.shape)).astype(np.float32)
    inverse = np.linalg.inv(slopes @ slopes.T)
    errors, estimated = [], []
    for _ in range(400):
        noise = rng.normal(size=len(x)) + within * rng.normal(size=49)[block]
        error = inverse @ (slopes @ noise)
        fit = problem(slopes, (noise - error @ slopes).astype(np.float32))
        errors.append(error[:GEOMETRY])
        estimated.append(np.diag(fit.block_covariance(fit.sums(blocks))))
    ratio = np.mean(estimated, axis=0) / np.mean(np.square(errors), axis=0)
    assert ratio.min() > 0.8
    assert ratio.max() < 1.25
