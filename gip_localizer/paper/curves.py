# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The numbers of the simulated figure: exact, sampled and printed, for each amplitude."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm

from gip_localizer.core.arrays import Floats
from gip_localizer.errors import ParameterError
from gip_localizer.paper.exact import exact_error, gain_db
from gip_localizer.paper.geometry import PaperCamera
from gip_localizer.paper.printed import printed_points, PRINTED_SAMPLES
from gip_localizer.paper.sampling import sampled_errors
from gip_localizer.paper.squares import Squares, visible_squares
from gip_localizer.paper.standard_error import pair_law

AMPLITUDES = np.arange(1, 101) / 10.0
"""Amplitudes a of the squares, 0.1 to 10 in the paper's unit, as in its figure."""
BAND_999 = float(norm.ppf(0.9995))
"""Half-width of the two-sided 99.9 % band of a single point, in standard errors."""
GAIN_AT = (0.3, 0.01, 1e-4)
"""Probabilities of error for which the gain in signal is computed; chosen."""
NAMES = ('standard', 'generalized')
Progress = Callable[[Iterable[float]], Iterable[float]]


@dataclass(frozen=True, eq=False)
class Curve:
    """
    One of the two curves, (amplitudes,) each.

    Attributes
    ----------
    exact, sampled : (n,) float64
        Probability of error over all pairs, and over the sampled pairs.
    error : (n,) float64
        Standard error of `sampled` about `exact`.
    printed : (n,) float64
        Points printed in the paper; NaN for a camera that differs from the paper's.
    printed_error : (n,) float64
        Standard error of the paper's 10,000 pairs about `exact`.

    """

    exact: Floats
    sampled: Floats
    error: Floats
    printed: Floats
    printed_error: Floats

    @property
    def outside(self) -> int:
        """Number of sampled points outside their 99.9 % band."""
        return int((np.abs(self.sampled - self.exact) > BAND_999 * self.error).sum())

    @property
    def printed_rms(self) -> float:
        """Root mean square of (printed − exact) / standard error; NaN without printed points."""
        return float(np.sqrt(np.mean(((self.printed - self.exact) / self.printed_error) ** 2)))


@dataclass(frozen=True, eq=False)
class Curves:
    """The simulated figure: camera, squares, and the curves by name of `NAMES`."""

    camera: PaperCamera
    squares: Squares
    samples: int
    amplitudes: Floats
    standard: Curve
    generalized: Curve
    gains_db: tuple[float, ...]

    @property
    def is_paper(self) -> bool:
        """True for the paper's camera, to which the printed points apply."""
        return self.camera == PaperCamera()


def compute_curves(
    camera: PaperCamera, samples: int, seed: int, progress: Progress = iter
) -> Curves:
    """
    Compute both curves, exactly and with the paper's sampling.

    Parameters
    ----------
    camera : PaperCamera
        Camera, noise and squares.
    samples : int
        Random pairs per amplitude.
    seed : int
        Seed of the pairs.
    progress : callable
        Wraps the iteration over amplitudes.

    Returns
    -------
    Curves
        For a = 0.1, 0.2, … 10.

    Raises
    ------
    ParameterError
        No samples, a negative seed, or a camera that sees no square.

    """
    if samples < 1:
        raise ParameterError(f'samples is {samples}; give --samples 1 or more (paper: 10000)')
    if seed < 0:
        raise ParameterError(f'seed is {seed}; give --seed 0 or more')
    squares = visible_squares(camera)
    _check_signal(camera, squares)
    rng = np.random.default_rng(seed)
    constant = camera.snr_constant
    sampled = np.array([
        sampled_errors(a, squares.gramian, constant, samples, rng) for a in progress(AMPLITUDES)
    ]).T
    standard, generalized = (
        _curve(camera, squares, samples, values, name)
        for name, values in zip(NAMES, sampled, strict=True)
    )
    gains = tuple(gain_db(probability, squares, constant) for probability in GAIN_AT)
    return Curves(camera, squares, samples, AMPLITUDES, standard, generalized, gains)


def _check_signal(camera: PaperCamera, squares: Squares) -> None:
    """Refuse noise that is so weak or strong that the curves are flat for a = 0.1 … 10."""
    weakest, strongest = camera.snr_constant * np.array(
        [AMPLITUDES[-1] ** 2 * squares.gramian.sum(), AMPLITUDES[0] ** 2 * squares.gramian.max()]
    )
    if not (weakest > 1e-6 and strongest < 1e2):
        change = 'lower' if weakest <= 1e-6 else 'raise'
        raise ParameterError(
            f'the noise density {camera.noise_density:g} leaves nothing to compare at amplitudes '
            f'0.1 to 10 (SNR {strongest:.3g} to {weakest:.3g}): {change} --noise'
        )


def _curve(
    camera: PaperCamera, squares: Squares, samples: int, sampled: Floats, name: str
) -> Curve:
    generalized, constant = name == 'generalized', camera.snr_constant
    law = pair_law(squares, generalized=generalized)
    one = np.array([law.standard_error(a, constant, 1) for a in AMPLITUDES])
    printed = np.full(len(AMPLITUDES), np.nan)
    if camera == PaperCamera():
        printed = printed_points()[1 + NAMES.index(name)]
    return Curve(
        exact=np.array([
            exact_error(a, squares, constant, generalized=generalized) for a in AMPLITUDES
        ]),
        sampled=sampled,
        error=one / np.sqrt(samples),
        printed=printed,
        printed_error=one / np.sqrt(PRINTED_SAMPLES),
    )
