# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Prediction of a view from the map at a pose, and its derivatives by the unknowns.

The map is sampled in the first step and after every long step. After a short step its values at
the new pose are extrapolated from the slopes at the last samples, which takes much less time.

"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.map.bilinear import Samples
from gip_localizer.core.refine.observation import Layer, RefinementState, Unknowns

# Longest step, in units of the final steps (`gauss_newton`), after which the prediction is
# extrapolated (design choice: 10, because a map is nearly linear over 3 mm).
LONGEST_EXTRAPOLATED = 10.0
# Longest step, in the same units, after which the derivatives are used again (design choice: 20,
# because they change more slowly than the values).
LONGEST_REUSED = 20.0

Derivatives = tuple[Floats, Floats, Callable[[], Floats]]
"""Instruments and slopes (p, n) of a `LeastSquaresProblem`, and its exact instruments."""


class MapPrediction:
    """
    Prediction of the cells of a layer.

    Parameters
    ----------
    layer : Layer
        Cells of the view, and the map.
    state : RefinementState
        Current pose, camera motion, exposure and light.
    unknowns : Unknowns
        Parameters for which derivatives are computed.

    """

    def __init__(self, layer: Layer, state: RefinementState, unknowns: Unknowns) -> None:
        self._layer, self._state, self._unknowns = layer, state, unknowns
        self._stage = layer.stage
        self._derivatives: Derivatives | None = None
        self._slopes: tuple[Floats, Floats] | None = None
        self._extrapolated: tuple[Floats, Floats] | None = None
        self._points: tuple[Floats, Floats]
        self._light = None if state.light is None else state.light.on(self._stage)
        self._shade = self._light.gain if self._light is not None else state.shade(self._stage)

    @property
    def is_extrapolated(self) -> bool:
        """Whether the current prediction was extrapolated from earlier samples."""
        return self._extrapolated is not None

    @property
    def derivatives(self) -> Derivatives:
        """Derivatives of the prediction by each unknown."""
        assert self._derivatives is not None
        return self._derivatives

    @property
    def slopes(self) -> tuple[Floats, Floats]:
        """Slopes (n,) of the map ahead and left, per metre, without the pixel blur."""
        assert self._slopes is not None
        return self._slopes

    def current(self) -> tuple[Floats, Floats]:
        """Return blurred map and weights of known cells, (n,) each, at the current state."""
        return self._extrapolated or self._sample()

    def extrapolate(
        self, current: tuple[Floats, Floats], step: Floats, length: float
    ) -> None:
        """
        Extrapolate the prediction over a step if it was short.

        Parameters
        ----------
        current : ((n,) float32, (n,) float32)
            Prediction and weights of known cells before the step.
        step : (p,)
            Step of all unknowns.
        length : float
            Length of the step of the pose, in units of the final steps.

        """
        self._extrapolated = None
        if length > LONGEST_REUSED:
            self._derivatives = None
        elif length <= LONGEST_EXTRAPOLATED:
            free = 3 + len(self._unknowns.moving)
            change = step[:free].astype(np.float32) @ self.derivatives[1][:free]
            self._extrapolated = current[0] + change, current[1]

    def pattern(self, predicted: Floats) -> Floats:
        """Return the part of the prediction (n,) that the light model does not explain."""
        if self._light is None:
            return predicted
        return predicted - (self._light.veil + self._light.gain * self._light.broad)

    def light_inputs(self) -> tuple[Floats, Floats, Floats]:
        """Return the map without and with light and shading, and the weights, (n,) each."""
        samples = self._samples()
        return samples.values, self._under_light(samples), self._known(samples)

    def _sample(self) -> tuple[Floats, Floats]:
        """Sample the map; compute the derivatives again if they are outdated."""
        samples = self._samples()
        sampled = self._under_light(samples)
        predicted = self._stage.blurred(sampled)
        if self._derivatives is None:
            self._derivatives = self._differentiate(samples, sampled, predicted)
        return predicted, self._known(samples)

    def _samples(self) -> Samples:
        """Return the map at the cells."""
        self._points = self._stage.suspension.road_points(self._state.camera_motion)
        return self._layer.raster_map.sample_from(self._state.pose, *self._points)

    def _under_light(self, samples: Samples) -> Floats:
        if self._shade is None:
            return samples.values
        lit = samples.values * self._shade
        return lit if self._light is None else lit + self._light.veil

    def _known(self, samples: Samples) -> Floats:
        """Weights (n,); 0 for cells outside the known map."""
        known = self._layer.weights
        if samples.valid is not None:
            known = known * samples.valid
        return self._less_noise(known, samples)

    def _less_noise(self, weights: Floats, samples: Samples) -> Floats:
        """Weights (n,) reduced by the noise that the map specifies: G = 1/(1/G + a² σ²)."""
        noise = self._layer.raster_map.noise
        if noise is None:
            return weights
        gain = self._state.exposure[0] if self._state.exposure else 1.0
        variance = (np.float32(gain) * samples.nearest_of(noise)) ** 2
        return np.asarray(weights / (np.float32(1.0) + weights * variance))

    def _differentiate(self, samples: Samples, sampled: Floats, predicted: Floats) -> Derivatives:
        """Return the derivatives; the pixel blur does not change the lever arms."""
        points = self._points
        ahead, left = self._under_shade(samples.slopes())
        self._slopes = ahead, left
        exact = partial(self._by_unknown, ahead, left, sampled, points)
        instruments = self._by_unknown(*self._instrument_slopes(samples), sampled, points)
        if self._stage.blur is None and self._layer.blurred_slopes is None:
            return instruments, instruments, exact
        ahead, left = self._stage.blurred(ahead), self._stage.blurred(left)
        return instruments, self._by_unknown(ahead, left, predicted, points), exact

    def _instrument_slopes(self, samples: Samples) -> tuple[Floats, Floats]:
        """Return slopes (n,), blurred by the share of the variance that the map causes."""
        ahead, left = self.slopes
        blurred = self._layer.blurred_slopes
        if blurred is None:
            return ahead, left
        blurred_ahead, blurred_left = self._under_shade(samples.slopes_of(*blurred))
        share = self._layer.pixel_share
        return (
            blurred_ahead + share * (ahead - blurred_ahead),
            blurred_left + share * (left - blurred_left),
        )

    def _under_shade(self, slopes: tuple[Floats, Floats]) -> tuple[Floats, Floats]:
        if self._shade is None:
            return slopes
        return slopes[0] * self._shade, slopes[1] * self._shade

    def _by_unknown(
        self, ahead: Floats, left: Floats, grey: Floats, points: tuple[Floats, Floats]
    ) -> Floats:
        """Return derivatives (p, n) by each unknown of a map with slopes (n,) ahead and left."""
        x, y = points
        rows = np.empty((len(self._unknowns.prior), len(grey)), np.float32)
        rows[0], rows[1] = ahead, left
        np.multiply(left, x, out=rows[2])
        rows[2] -= ahead * y
        for row, moving in zip(rows[3:], self._unknowns.moving, strict=False):
            along_x, along_y = self._stage.suspension.tangents[moving]
            np.multiply(ahead, along_x, out=row)
            row += left * along_y
        if self._unknowns.normalized:
            rows[-2], rows[-1] = grey, 1.0
        return rows
