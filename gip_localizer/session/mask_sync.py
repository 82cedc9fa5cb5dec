# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Images and the masks that a segmentation network publishes for them, paired by their stamps.

An image waits for its mask, for `mask.timeout` at most. The newest image with a mask is returned,
and older ones that still wait are dropped. So a network slower than the camera sets the frame
rate, and no queue builds up.

"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from gip_localizer.core.track.stamp_check import REWIND_NS
from gip_localizer.io.messages import stamp_ns
from gip_localizer.parameters.integration import MaskTopic

MOST_WAITING = 16
"""Largest number of waiting images, and of masks; chosen, to bound the memory at any rate."""


class Masked(NamedTuple):
    """An image message and its mask; without one, None and the reason."""

    image: Any
    mask: Any | None
    missing: str = ''


@dataclass(frozen=True)
class Frame:
    """
    An image that is ready to be localized.

    Attributes
    ----------
    message : sensor_msgs/Image or sensor_msgs/CompressedImage
        The image.
    masked : Masked or None
        The image with its mask; None if `mask.from_topic` is not set.

    """

    message: Any
    masked: Masked | None = None

    @property
    def stamp_ns(self) -> int:
        """Stamp of the image, nanoseconds."""
        return stamp_ns(self.message.header)


def frames_of(masked: Masked | None) -> list[Frame]:
    """Return a masked image as a frame; an empty list for None."""
    return [] if masked is None else [Frame(masked.image, masked)]


class _Waiting(NamedTuple):
    image: Any
    stamp_ns: int
    until_ns: int


@dataclass
class MaskPairing:
    """
    Pairs two streams; the caller passes the time, which may be that of a recording.

    Attributes
    ----------
    limits : callable
        Returns the current `mask.*`.
    dropped : int
        Images that were dropped because a newer image had its mask first.

    """

    limits: Callable[[], MaskTopic]
    dropped: int = 0
    _images: list[_Waiting] = field(default_factory=list)
    _masks: dict[int, Any] = field(default_factory=dict)
    _last_mask_ns: int | None = None

    def add_image(self, image: Any, now_ns: int) -> Masked | None:
        """Store an image at a time of the caller's clock; return it if its mask is there."""
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
        """Store a mask; return the image that it belongs to, if that is there."""
        self._last_mask_ns = stamp_ns(mask.header)
        self._masks.pop(self._last_mask_ns, None)
        self._masks[self._last_mask_ns] = mask
        while len(self._masks) > MOST_WAITING:
            del self._masks[next(iter(self._masks))]
        return self._newest_pair()

    def overdue(self, now_ns: int) -> list[Masked]:
        """Return, oldest first and without a mask, the images whose waiting time is over."""
        overdue = [waiting for waiting in self._images if waiting.until_ns <= now_ns]
        self._images = [waiting for waiting in self._images if waiting.until_ns > now_ns]
        return [Masked(waiting.image, None, self._why(waiting.stamp_ns)) for waiting in overdue]

    def flush(self) -> list[Masked]:
        """Return all waiting images, at the end of the input."""
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
            return f'{waited}: no mask has been received; check the name of the topic'
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
