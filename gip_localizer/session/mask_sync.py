# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Images and the masks that a network sends after them, paired by their stamps.

An image waits for its mask, for `mask.timeout` at most. The newest image whose mask has come is
handed out, and the older ones that still wait are dropped: a network slower than the camera sets
the pace, and nothing queues up.

"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from gip_localizer.core.track.stamp_check import REWIND_NS
from gip_localizer.io.messages import stamp_ns
from gip_localizer.parameters.integration import MaskTopic

MOST_WAITING = 16
"""Images that may wait at once, and masks: memory is bounded whatever the rates."""


class Masked(NamedTuple):
    """An image message and its mask; None and the reason where there is none."""

    image: Any
    mask: Any | None
    missing: str = ''


class _Waiting(NamedTuple):
    image: Any
    stamp_ns: int
    until_ns: int


@dataclass
class MaskPairing:
    """
    Pairs two streams; the clock is the caller's, and may be that of a log.

    Attributes
    ----------
    limits : callable
        Gives `mask.*` as they are now.
    dropped : int
        Images that a newer one with its mask overtook.

    """

    limits: Callable[[], MaskTopic]
    dropped: int = 0
    _images: list[_Waiting] = field(default_factory=list)
    _masks: dict[int, Any] = field(default_factory=dict)
    _last_mask_ns: int | None = None

    def add_image(self, image: Any, now_ns: int) -> Masked | None:
        """Take an image at a time of the caller's clock; hand it out if its mask is there."""
        stamp = stamp_ns(image.header)
        if self._images and self._images[-1].stamp_ns - stamp > REWIND_NS:
            self._forget()
        until = now_ns + round(self.limits().timeout * 1e9)
        self._images.append(_Waiting(image, stamp, until))
        if len(self._images) > MOST_WAITING:
            del self._images[0]
            self.dropped += 1
        return self._newest_pair()

    def add_mask(self, mask: Any) -> Masked | None:
        """Take a mask; hand out the image that it completes."""
        self._last_mask_ns = stamp_ns(mask.header)
        self._masks.pop(self._last_mask_ns, None)
        self._masks[self._last_mask_ns] = mask
        while len(self._masks) > MOST_WAITING:
            del self._masks[next(iter(self._masks))]
        return self._newest_pair()

    def overdue(self, now_ns: int) -> list[Masked]:
        """Hand out the images that have waited long enough, oldest first, without a mask."""
        overdue = [waiting for waiting in self._images if waiting.until_ns <= now_ns]
        self._images = [waiting for waiting in self._images if waiting.until_ns > now_ns]
        return [Masked(waiting.image, None, self._why(waiting.stamp_ns)) for waiting in overdue]

    def flush(self) -> list[Masked]:
        """Hand out all that wait: no mask will come any more."""
        return self.overdue(1 << 62)

    def _newest_pair(self) -> Masked | None:
        for place in reversed(range(len(self._images))):
            waiting = self._images[place]
            key = self._nearest(waiting.stamp_ns)
            if key is not None:
                self.dropped += place
                self._images = self._images[place + 1:]
                return Masked(waiting.image, self._masks.pop(key))
        return None

    def _nearest(self, stamp: int) -> int | None:
        key = min(self._masks, key=lambda mask: abs(mask - stamp), default=None)
        if key is None or abs(key - stamp) > round(self.limits().tolerance * 1e9):
            return None
        return key

    def _why(self, stamp: int) -> str:
        waited = f'no mask within mask.timeout {self.limits().timeout:g} s'
        if self._last_mask_ns is None:
            return f'{waited}: none has come at all; is the topic remapped?'
        apart = (self._last_mask_ns - stamp) * 1e-9
        side = 'ahead of' if apart > 0.0 else 'behind'
        return (
            f'{waited}; the last mask is stamped {abs(apart):.6g} s {side} the image, '
            f'mask.tolerance is {self.limits().tolerance:g} s'
        )

    def _forget(self) -> None:
        self.dropped += len(self._images)
        self._images.clear()
        self._masks.clear()
