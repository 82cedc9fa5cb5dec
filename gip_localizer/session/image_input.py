# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Image and mask of a frame: at full scale, checked, and with the warnings about them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from gip_localizer.core.arrays import Grey
from gip_localizer.io.bit_depth import BitDepth
from gip_localizer.io.map_files import load_mask
from gip_localizer.session.mask_sync import Masked
from gip_localizer.session.masks import both, fitting, mask_image, MaskError
from gip_localizer.session.message_log import MessageLog


class ImageInput:
    """
    Prepares the images of a camera and their masks.

    Parameters
    ----------
    mask_file : str
        Picture of the mask for all frames; empty: none.
    log : MessageLog
        Counts the masks.

    Raises
    ------
    MapError
        `mask_file` cannot be read.

    Attributes
    ----------
    warnings : dict
        Rule of `gip_localizer.session.diagnostic_rules` → detail, of the last frame.

    """

    def __init__(self, mask_file: str, log: MessageLog) -> None:
        self.warnings: dict[str, str] = {}
        self._log = log
        self._depth = BitDepth()
        self._mask = load_mask(mask_file) if mask_file else None

    def image(self, message: Any, decode: Callable[[Any], Grey]) -> Grey:
        """Return the image of a new frame, scaled if it uses only its lower bits (ImageError)."""
        self.warnings.clear()
        image = decode(message)
        scaled = self._depth.scaled(image)
        if note := self._depth.note(image):
            self.warnings['FEW_BITS'] = note
        return scaled

    def mask(self, masked: Masked | None, image: Grey, *, required: bool) -> Grey | None:
        """
        Return the mask of the frame: of its message, of the file, or of both.

        Parameters
        ----------
        masked : Masked or None
            The message of the mask, or why it is missing; None: masks are not messages.
        image : (height, width) array
            The image.
        required : bool
            True: a frame without a usable message is refused.

        Returns
        -------
        (height, width) uint8 or None
            None: all pixels are used.

        Raises
        ------
        ImageError
            The mask of the file has another size than the image.
        MaskError
            There is no usable message, and one is required.

        """
        fixed = fitting(self._mask, image)
        return both(fixed, self._from_message(masked, image, required=required))

    def _from_message(
        self, masked: Masked | None, image: Grey, *, required: bool
    ) -> Grey | None:
        if masked is None:
            return None
        try:
            if masked.mask is None:
                raise MaskError(masked.missing)
            self._log.count('mask')
            return mask_image(masked.mask, (image.shape[0], image.shape[1]))
        except MaskError as error:
            rule = 'MASK_MISSING' if masked.mask is None else 'MASK_REFUSED'
            self.warnings[rule] = str(error)
            self._log.count_refused('mask')
            if required:
                raise
            return None
