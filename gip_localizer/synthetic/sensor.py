# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
The sensor model: vignetting, exposure, shot and read noise, clipping, quantization.

    value = offset + gain · vignetting · scene                (1.0 is full scale)
    variance = value / full_well + read_noise²                 (shot noise: Poisson's variance)
    output = round(white · clip((value + √variance · n)^gamma, 0, 1))

The noise of a frame depends only on (seed, frame index), so every frame is reproducible.

"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats32 = NDArray[np.float32]


@dataclass(frozen=True)
class SensorModel:
    """
    An image sensor behind a lens.

    Attributes
    ----------
    gain : float
        Exposure: full scale per unit of scene brightness.
    offset : float
        Black level, fraction of full scale.
    vignetting : float
        Fraction of light lost in the image corners (the loss grows with the squared radius).
    full_well : float
        Electrons at full scale; 0 disables shot noise.
    read_noise : float
        Standard deviation, fraction of full scale. Without shot noise it is the paper's white
        noise.
    bits : int
        8 or 16.
    gamma : float
        Power that the noisy values are raised to: the tone curve of the camera's own processing.

    """

    gain: float = 1.0
    offset: float = 0.0
    vignetting: float = 0.0
    full_well: float = 0.0
    read_noise: float = 0.0
    bits: int = 8
    gamma: float = 1.0

    def __post_init__(self) -> None:
        """Refuse a bit depth that no image message has."""
        if self.bits not in (8, 16):
            raise ValueError(f'bits is {self.bits}; expected 8 or 16')

    @property
    def white(self) -> int:
        """Largest value of a pixel."""
        return (1 << self.bits) - 1

    def expose(self, scene: Floats32) -> Floats32:
        """Return the noise-free values of a scene (rows, cols), fraction of full scale."""
        light = scene * np.float32(self.gain)
        if self.vignetting:
            light *= vignetting_factor(scene.shape, self.vignetting)
        return light + np.float32(self.offset)

    def capture(self, scene: Floats32, seed: int, frame: int) -> NDArray[np.unsignedinteger]:
        """
        Return the image of a scene.

        Parameters
        ----------
        scene : (rows, cols) float32
            Brightness; 1.0 with gain 1 is full scale.
        seed, frame : int
            Not negative; the same two give the same bytes.

        Returns
        -------
        (rows, cols) uint8 or uint16

        """
        values = self.expose(scene)
        if self.full_well or self.read_noise:
            rng = np.random.default_rng([seed, frame])
            noise = rng.standard_normal(values.shape, dtype=np.float32)
            values += noise * self._deviation(values)
        if self.gamma != 1.0:
            np.power(np.maximum(values, 0.0), np.float32(self.gamma), out=values)
        values *= np.float32(self.white)
        np.clip(values + np.float32(0.5), 0, self.white, out=values)
        return values.astype(np.uint8 if self.bits == 8 else np.uint16)

    def _deviation(self, values: Floats32) -> Floats32 | np.float32:
        """Return the standard deviation of the noise at noise-free values."""
        if not self.full_well:
            return np.float32(self.read_noise)
        shot = np.maximum(values, 0.0) * np.float32(1.0 / self.full_well)
        return np.asarray(np.sqrt(shot + np.float32(self.read_noise**2)), np.float32)


def vignetting_factor(shape: tuple[int, ...], loss: float) -> Floats32:
    """Return 1 in the image centre and 1 - loss in its corners, (rows, cols)."""
    rows, cols = shape
    y = (np.arange(rows, dtype=np.float32) - (rows - 1) / 2.0)[:, None]
    x = (np.arange(cols, dtype=np.float32) - (cols - 1) / 2.0)[None, :]
    corner = max(((rows - 1) ** 2 + (cols - 1) ** 2) / 4.0, 1.0)
    return np.asarray(1.0 - loss * (x * x + y * y) / corner, np.float32)
