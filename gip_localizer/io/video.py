# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
H.264 and H.265 as in sensor_msgs/CompressedImage: a stream of packets → grey images.

A video has memory: it can be decoded from a key frame on, with every packet since. What cannot be
decoded without doubt is refused until the next key frame.

"""

from __future__ import annotations

from typing import Any

import numpy as np

from gip_localizer.core.arrays import Grey
from gip_localizer.errors import ImageError
from gip_localizer.io.video_headers import H264Headers, H265Headers, Headers, Packet

CODECS: dict[str, tuple[str, type[Headers]]] = {
    'h264': ('h264', H264Headers), 'avc': ('h264', H264Headers),
    'h265': ('hevc', H265Headers), 'hevc': ('hevc', H265Headers),
}
"""Format of a message → name of the decoder, and its headers."""
MISSING = (
    "video needs PyAV, which is not installed: pip install 'gip_localizer[video]', or publish "
    'jpeg images'
)
LUMA_8 = ('yuv420p', 'yuvj420p', 'yuv422p', 'yuvj422p', 'yuv444p', 'yuvj444p', 'gray', 'nv12')
"""Pixel formats of a decoder whose first plane is luminance of 8 bits."""
LUMA_10 = ('yuv420p10le', 'yuv422p10le', 'yuv444p10le', 'gray10le')
"""The same of 10 bits, in the lower bits of 16."""


def video_codec(name: str) -> str:
    """Return the word of `CODECS` that a message's format begins with; empty: no video."""
    word = name.lower().replace('.', '').replace(';', ' ').split()
    return word[0] if word and word[0] in CODECS else ''


class VideoDecoder:
    """
    Decodes the packets of one stream, each of which must be given.

    Parameters
    ----------
    codec : str
        A key of `CODECS`.
    most_pixels : int
        Largest size of a picture.

    Raises
    ------
    ImageError
        PyAV is not installed.

    """

    def __init__(self, codec: str, most_pixels: int) -> None:
        try:
            import av  # an extra, and slow to import: only where there is video
        except ImportError:
            raise ImageError(f'{codec} {MISSING}') from None
        av.logging.set_level(None)
        self._av = av
        self.codec, self._most = codec, most_pixels
        self._headers = CODECS[codec][1]()
        self._last: Packet | None = None
        self._context: Any = None

    def grey(self, data: bytes) -> Grey:
        """
        Return the picture (height, width) of the next packet, uint8 or uint16.

        Raises
        ------
        ImageError
            It cannot be decoded without doubt: no key frame came yet, a packet before it is
            missing, it is damaged, or predicted from a later one.

        """
        packet = self._headers.packet(data)
        if packet.bidirectional:
            self._last = None
            raise ImageError(f'{self.codec} with B-frames cannot be used while driving; let the '
                             'encoder write none (bf=0, tune=zerolatency)')
        self._check_order(packet)
        image = self._decoded(data)
        if packet.referred or packet.key:
            self._last = packet
        return image

    def _check_order(self, packet: Packet) -> None:
        """Refuse a packet whose predecessor did not come."""
        if packet.key:
            self._context = self._new_context()
            return
        if self._last is None:
            raise ImageError(f'{self.codec} is decoded from the next key frame on')
        if packet.number == self._last.number:
            raise ImageError(f'{self.codec} repeats picture {packet.number}')
        expected = (self._last.number + 1) % self._last.modulus
        if packet.number != expected:
            self._last = None
            raise ImageError(
                f'{self.codec} lacks a packet before this one (picture {packet.number}, expected '
                f'{expected}); it is decoded from the next key frame on. Let the node keep more: '
                'qos_overrides./image/compressed.subscription.depth: 30'
            )

    def _new_context(self) -> Any:
        context = self._av.CodecContext.create(CODECS[self.codec][0], 'r')
        # Frames come out with their packet only from one thread.
        context.thread_count = 1
        context.flags |= self._av.codec.context.Flags.low_delay
        context.options = {'max_pixels': str(self._most)}
        return context

    def _decoded(self, data: bytes) -> Grey:
        try:
            frames = self._context.decode(self._av.Packet(data))
        except (self._av.error.FFmpegError, ValueError) as error:
            frames, why = [], str(error)
        else:
            why = f'{len(frames)} pictures came out'
        if len(frames) != 1 or frames[0].is_corrupt:
            self._last = None
            raise ImageError(f'{self.codec} packet of {len(data)} bytes cannot be decoded '
                             f'({why}); it is decoded from the next key frame on')
        return _luminance(frames[0])


def _luminance(frame: Any) -> Grey:
    """Return the first plane of a decoded frame."""
    name, plane = frame.format.name, frame.planes[0]
    if name not in (*LUMA_8, *LUMA_10):
        raise ImageError(f'video of the pixel format {name} is not read; expected YUV of 8 or 10 '
                         'bits')
    kind = np.dtype(np.uint8 if name in LUMA_8 else np.uint16)
    stride = plane.line_size // kind.itemsize
    rows = np.frombuffer(plane, kind, frame.height * stride).reshape(frame.height, stride)
    pixels: Grey = rows[:, : frame.width].copy()
    return pixels if name in LUMA_8 else pixels << 6
