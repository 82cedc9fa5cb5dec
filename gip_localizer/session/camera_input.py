# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The camera as its last usable CameraInfo and the parameters `camera.*` describe it."""

from __future__ import annotations

from typing import Any

from gip_localizer.core.camera.calibration import Calibration
from gip_localizer.core.camera.model import CameraModel
from gip_localizer.io import messages
from gip_localizer.parameters import Camera


class CameraInput:
    """
    Calibration and camera model; the model is made when it is needed.

    Attributes
    ----------
    calibration : Calibration or None
        Of the last usable CameraInfo; None before the first.
    camera : CameraModel or None
        The camera in use; None before the first frame, and after a change.
    warnings : dict
        Rule of `gip_localizer.session.diagnostic_rules` → detail.

    """

    def __init__(self) -> None:
        self.calibration: Calibration | None = None
        self.camera: CameraModel | None = None
        self.warnings: dict[str, str] = {}
        self._raw: tuple[object, ...] | None = None

    def take(self, message: Any) -> bool:
        """
        Use a sensor_msgs/CameraInfo.

        Returns
        -------
        bool
            False if it equals the one in use.

        Raises
        ------
        CalibrationError, ValueError
            It is unusable; the previous one is kept.

        """
        raw = messages.fingerprint(message)
        if raw == self._raw:
            return False
        self.calibration = messages.calibration(message)
        note = messages.calibration_note(message)
        self.warnings = {'LENS_UNNAMED': note} if note else {}
        self._raw, self.camera = raw, None
        return True

    def renew(self) -> None:
        """Make the model again for the next frame, because `camera.*` may have changed."""
        self.camera = None

    def model(self, calibration: Calibration, settings: Camera) -> CameraModel:
        """Return the camera model (raises CalibrationError if it cannot be used)."""
        if self.camera is None:
            self.camera = CameraModel.given(calibration, settings)
        return self.camera
