# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Level of the smooth errors, estimated along a drive.

Road, map and calibration cause errors of a similar size in all frames of a drive, but not every
frame shows them: by chance the parts of a view may agree although all of them are displaced. The
prior of a frame's strength and correlation length is therefore a mixture of a fixed density and of
the mean posterior of the frames before it (empirical Bayes, see Laird 1978 for the iteration).

"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.pose import Pose2

# Grid of ln s² (s² in m²) on which the level is stored (design choice: standard deviations from 3
# um, far below any error of a pose, to 0.17 m, far above those of a map that can be used).
LOG_VARIANCES = np.linspace(np.log(1e-11), np.log(3e-2), 56)


@dataclass(frozen=True)
class LevelSettings:
    """
    Settings of the estimation of the level.

    The defaults were compared with others by `make error-level`, on worlds that no reported number
    uses.

    Attributes
    ----------
    rarity : float
        Power with which the fixed density of s² falls: most views have no smooth error. With 1.0,
        1.3 and 1.6 the mean NEES of exact roads is 2.7, 2.9 and 3.0 (3 is consistent), and
        83 to 92, 79 to 83 and 79 % of the poses under shadows and glare are inside the ellipse.
    most_learned : float
        Largest share of the learned part of the prior, 0..1: 0.5 to 0.98 give the same results.
    half_learned : float
        Number of frames for half of that share: 2 gives the same results.
    memory : float
        Number of frames over which the level is averaged, so that it follows a change of the
        road: 20 give the same results.
    spread : float
        Standard deviation by which the result of one frame is blurred, in steps of the grid:
        strengths vary from place to place. At 0.5 and below, 83 instead of 96 % of the poses on
        banked curves are inside the ellipse.

    """

    rarity: float = 1.3
    most_learned: float = 0.9
    half_learned: float = 4.0
    memory: float = 10.0
    spread: float = 1.0


@dataclass(frozen=True, eq=False)
class ErrorLevel:
    """
    Estimate of the smooth errors from the frames of a drive.

    Attributes
    ----------
    shares : (lengths, bins) float64
        Mean posterior of correlation length and `LOG_VARIANCES`; its sum is 1.
    frames : float
        Number of frames in it, at most `settings.memory`.
    place : Pose2 or None
        Pose of the last of them, base in map.
    settings : LevelSettings
        Settings of the estimation.

    """

    shares: Floats | None = None
    frames: float = 0.0
    place: Pose2 | None = None
    settings: LevelSettings = LevelSettings()

    def log_prior(self, strengths: Floats, variances: Floats) -> Floats:
        """
        Return the logarithm of the prior (lengths, n).

        Parameters
        ----------
        strengths : (n,)
            s² relative to the noise, evenly spaced in its logarithm.
        variances : (lengths, n)
            s², m², for each correlation length.

        """
        fixed = np.broadcast_to(strengths**-self.settings.rarity, variances.shape)
        fixed = fixed / fixed.sum()
        if self.shares is None:
            return np.log(fixed)
        learned = np.array([
            np.interp(np.log(v), LOG_VARIANCES, share, left=0.0, right=0.0)
            for v, share in zip(variances, self.shares, strict=True)
        ])
        learned *= (np.log(strengths[1] / strengths[0]) / (LOG_VARIANCES[1] - LOG_VARIANCES[0]))
        known = self.frames / (self.frames + self.settings.half_learned)
        share = self.settings.most_learned * known
        return np.asarray(np.log((1.0 - share) * fixed + share * learned))

    def after(
        self, weights: Floats, variances: Floats, place: Pose2, *, min_distance: float
    ) -> ErrorLevel:
        """
        Return the level after one more frame.

        Parameters
        ----------
        weights : (lengths, n)
            Posterior of the frame; its sum is 1.
        variances : (lengths, n)
            s², m².
        place : Pose2
            Pose of base in map.
        min_distance : float
            Distance (m) from the last frame above which the errors are independent; a nearer
            frame does not change the level.

        """
        if self.place is not None and self.place.distance(place) < min_distance:
            return self
        spread = self.settings.spread
        seen = np.array([
            _binned(np.log(v), w, spread) for v, w in zip(variances, weights, strict=True)
        ])
        seen /= seen.sum()
        frames = min(self.frames + 1.0, self.settings.memory)
        if self.shares is not None:
            seen = self.shares + (seen - self.shares) / frames
        return replace(self, shares=seen, frames=frames, place=place)


def _binned(logs: Floats, weights: Floats, spread: float) -> Floats:
    """Return weights at positions `logs` (n,) on the grid (bins,), blurred by `spread` steps."""
    step = LOG_VARIANCES[1] - LOG_VARIANCES[0]
    offsets = (LOG_VARIANCES[:, None] - np.clip(logs, LOG_VARIANCES[0], LOG_VARIANCES[-1])) / step
    kernel = np.exp(-0.5 * (offsets / spread) ** 2)
    return np.asarray((kernel / kernel.sum(axis=0)) @ weights)
