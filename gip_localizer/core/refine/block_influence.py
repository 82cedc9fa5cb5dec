# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Influence of each block of road on an estimate, for a covariance without a noise model."""

from __future__ import annotations

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.refine.symmetric_systems import inverse_root

# Largest leverage of a block (no unit, 0..1) that is corrected for (design choice: 0.98, because
# the correction of a block that alone determines an unknown would be unlimited).
MAX_LEVERAGE = 0.98


def effective_blocks(influence: Floats, covariance: Floats) -> float:
    """
    Return the effective number of blocks that determine a covariance.

    With few blocks the covariance may be too small by chance.

    Parameters
    ----------
    influence : (blocks, 3)
        Influence of each block on the pose.
    covariance : (3, 3)
        Sum of the outer products of the influences.

    """
    shares = np.einsum('ij,ij->i', influence @ np.linalg.pinv(covariance), influence)
    return float(shares.sum() ** 2 / max(float((shares**2).sum()), 1e-30))


def influences(total: Floats, matrices: Floats, gradients: Floats) -> Floats:
    """
    Return the influence (blocks, p) of each block on the estimate, corrected for its leverage.

    The residuals of a block are reduced by the fit: along an axis with leverage h, an eigenvalue
    of `A^-1/2 A_b A^-1/2`, the share 1 - h of their variance remains. The gradient of the block is
    divided by the square root of this share (Bell and McCaffrey 2002).

    Parameters
    ----------
    total : (p, p)
        A, the matrix of the least-squares problem.
    matrices : (blocks, p, p)
        A_b, the part of A from each block.
    gradients : (blocks, p)
        g_b, the gradient of each block.

    """
    root = inverse_root(total)
    leverage, axes = np.linalg.eigh(root.T @ matrices @ root)
    along = (axes.swapaxes(-1, -2) @ (gradients @ root)[..., None])[..., 0]
    along /= np.sqrt(1.0 - np.clip(leverage, 0.0, MAX_LEVERAGE))
    return np.asarray((axes @ along[..., None])[..., 0] @ root.T)
