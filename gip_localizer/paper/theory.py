# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Footprint, SNR, Gramian and probability of error (paper, section on image acquisition and noise).

Vectors hold one amplitude per square along the last axis. Φ is the standard normal law; its
complement 1 − Φ(t) is computed as Φ(−t), which is accurate in the tail.

"""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr

from gip_localizer.core.arrays import Floats
from gip_localizer.paper.geometry import PaperCamera


def gramian(width: Floats, z_near: Floats, z_far: Floats) -> Floats:
    """
    Diagonal of the Gramian, equation Gramian: `(xu − xl)/2 · (1/zl² − 1/zu²)`.

    Parameters
    ----------
    width : array of float64
        Lateral extent xu − xl of each rectangle, cm.
    z_near, z_far : array of float64
        Depths zl and zu of its near and far edge, cm.

    Returns
    -------
    array of float64
        `G_kk = Ã_k / (f² h secθ)`, 1/cm.

    """
    return 0.5 * width * (1.0 / z_near**2 - 1.0 / z_far**2)


def footprint(camera: PaperCamera, width: Floats, z_near: Floats, z_far: Floats) -> Floats:
    """Area on the focal plane, equation TildeA: `f² h secθ · G_kk`, cm²."""
    return camera.area_constant * gramian(width, z_near, z_far)


def snr(camera: PaperCamera, amplitude: Floats, footprint: Floats) -> Floats:
    """Signal-to-noise ratio of a square, equation SNR: `a² Ã / N0`."""
    return amplitude**2 * footprint / camera.noise_density


def inner(first: Floats, second: Floats, weight: Floats) -> Floats:
    """Return the generalized inner product ⟨first, second⟩_G for G = diag(weight)."""
    return np.asarray((first * second) @ weight)


def norm(vector: Floats, weight: Floats) -> Floats:
    """Return the norm ‖vector‖_G induced by G = diag(weight)."""
    return np.sqrt(inner(vector, vector, weight))


def weighted_cdf(truth: Floats, other: Floats, weight: Floats, snr_constant: float) -> Floats:
    """
    Probability that the generalized inner product errs, equation WeightedCDF.

    As printed, `1 − Φ(√(f² h secθ / N0) · ⟨u*−û, u*⟩_G / ‖u*−û‖_G)`. It holds for vectors of
    equal G-norm, such as amplitudes ±a, because the condition above it in the paper omits the
    difference of the norms. `error_generalized` holds without this restriction.

    Parameters
    ----------
    truth, other : (..., m) float64
        u* and û.
    weight : (m,) float64
        Diagonal of G.
    snr_constant : float
        `f² h secθ / N0`.

    Returns
    -------
    (...) float64
        Probability; one half where u* and û are the same.

    """
    difference = truth - other
    return _complement(
        inner(difference, truth, weight), norm(difference, weight), snr_constant
    )


def unweighted_cdf(truth: Floats, other: Floats, weight: Floats, snr_constant: float) -> Floats:
    """
    Probability that the standard inner product errs, equation UnweightedCDF.

    As printed, `1 − Φ(√(f² h secθ / N0) · ⟨u*−û, u*⟩ / ‖u*−û‖_{G⁻¹})`, for vectors of equal
    Euclidean norm, such as amplitudes ±a. Parameters and result as in `weighted_cdf`.

    """
    difference = truth - other
    plain = inner(difference, truth, np.ones_like(weight))
    return _complement(plain, norm(difference, 1.0 / weight), snr_constant)


def error_generalized(
    truth: Floats, other: Floats, weight: Floats, snr_constant: float
) -> Floats:
    """
    Probability that ‖v−û‖_G < ‖v−u*‖_G for any u* and û: `1 − Φ(√(…) · ½‖u*−û‖_G)`.

    The paper's condition below OptimalClassifierSquared, with the mean that it has in general:
    `½‖u*−û‖²_G` in place of `⟨u*−û, u*⟩_G`. Parameters and result as in `weighted_cdf`.

    """
    difference = truth - other
    half = 0.5 * inner(difference, difference, weight)
    return _complement(half, norm(difference, weight), snr_constant)


def error_standard(truth: Floats, other: Floats, weight: Floats, snr_constant: float) -> Floats:
    """
    Probability that ‖v−û‖ < ‖v−u*‖ for any u* and û, with the standard inner product.

    `1 − Φ(√(…) · ½‖u*−û‖² / ‖u*−û‖_{G⁻¹})`. Parameters and result as in `weighted_cdf`.

    """
    difference = truth - other
    half = 0.5 * inner(difference, difference, np.ones_like(weight))
    return _complement(half, norm(difference, 1.0 / weight), snr_constant)


def _complement(mean: Floats, deviation: Floats, snr_constant: float) -> Floats:
    """Return `1 − Φ(√snr_constant · mean / deviation)`; one half for 0 / 0."""
    ratio = np.divide(mean, deviation, out=np.zeros_like(mean), where=deviation > 0.0)
    return np.asarray(ndtr(-np.sqrt(snr_constant) * ratio))
