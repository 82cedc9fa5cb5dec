# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The images of one topic in their order: those of a video are decoded as they come."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from gip_localizer.errors import ImageError
from gip_localizer.io.images import DecodedImage, MAX_PIXELS
from gip_localizer.io.video import video_codec, VideoDecoder


class ImageStream:
    """Takes every message of a topic; a packet of a video comes back decoded."""

    def __init__(self) -> None:
        self._decoder: VideoDecoder | None = None

    def taken(self, message: Any) -> Any:
        """Return the message itself, or a `DecodedImage` for a packet of a video."""
        codec = video_codec(str(getattr(message, 'format', '')))
        if not codec:
            return message
        try:
            if self._decoder is None or self._decoder.codec != codec:
                self._decoder = VideoDecoder(codec, MAX_PIXELS)
            return DecodedImage(message.header, self._decoder.grey(bytes(message.data)))
        except ImageError as error:
            return DecodedImage(message.header, None, str(error))


def decoded_images(messages: Iterable[Any | None]) -> Iterator[Any | None]:
    """Yield the messages of a topic likewise; None stays None."""
    stream = ImageStream()
    for message in messages:
        yield None if message is None else stream.taken(message)
