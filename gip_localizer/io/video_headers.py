# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
What the headers of an H.264 or H.265 packet say: key frame, number, kind of slices.

A decoder conceals a lost packet by repeating old pixels, without an error. The numbers of the
pictures (frame_num, ITU-T H.264 7.4.3; slice_pic_order_cnt_lsb, H.265 7.4.7.1) reveal it.

"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple, Protocol

from gip_localizer.errors import ImageError

START = b'\x00\x00\x01'
"""Start code of a unit (Annex B of both standards)."""
HEADER_BYTES = 64
"""Of a unit, as many are read: slice headers and parameter sets begin well within; chosen."""
LARGEST_BITS = 32
"""Longest Exp-Golomb prefix of the standards."""


class Packet(NamedTuple):
    """
    A picture.

    Attributes
    ----------
    key : bool
        It can be decoded without an earlier one.
    number : int
        Of the picture, modulo `modulus`.
    modulus : int
        Where the numbers begin again.
    referred : bool
        Later pictures may be predicted from it.
    bidirectional : bool
        It holds B slices.

    """

    key: bool
    number: int
    modulus: int
    referred: bool
    bidirectional: bool


class Headers(Protocol):
    """The parameter sets of a stream so far."""

    def packet(self, data: bytes) -> Packet:
        """Return the picture of a packet (raises ImageError if there is none)."""


class Bits:
    """Reads the bits of a unit, without its emulation prevention bytes."""

    def __init__(self, unit: bytes) -> None:
        content = unit[:HEADER_BYTES].replace(b'\x00\x00\x03', b'\x00\x00')
        self._value, self._left = int.from_bytes(content, 'big'), 8 * len(content)

    def fixed(self, count: int) -> int:
        """Return the next bits as a number (raises ImageError at the end)."""
        self._left -= count
        if self._left < 0:
            raise ImageError('a header of the video is cut off')
        return (self._value >> self._left) & ((1 << count) - 1)

    def golomb(self) -> int:
        """Return the next Exp-Golomb number."""
        zeros = 0
        while not self.fixed(1):
            zeros += 1
            if zeros > LARGEST_BITS:
                raise ImageError('a header of the video is damaged')
        return (1 << zeros) - 1 + self.fixed(zeros)


def units(data: bytes) -> Iterator[bytes]:
    """Yield the units of a packet (raises ImageError where it has no start code)."""
    if START not in data[:HEADER_BYTES]:
        raise ImageError('the video is not in Annex B format (no start code): let the encoder '
                         'write byte streams, with the parameter sets in every key frame')
    for part in data.split(START)[1:]:
        if part:
            yield part


class H264Headers:
    """Parameter sets of H.264."""

    def __init__(self) -> None:
        self._frame_num_bits: dict[int, tuple[int, bool]] = {}
        self._sets: dict[int, int] = {}

    def packet(self, data: bytes) -> Packet:
        """Return the picture of a packet (raises ImageError if there is none)."""
        for unit in units(data):
            kind, referred = unit[0] & 31, bool(unit[0] >> 5 & 3)
            if kind == 7:
                self._take_sequence(unit)
            elif kind == 8:
                bits = Bits(unit[1:])
                own = bits.golomb()
                self._sets[own] = bits.golomb()
            elif kind in (1, 5):
                return self._slice(Bits(unit[1:]), key=kind == 5, referred=referred)
        raise ImageError('the packet holds no H.264 picture')

    def _take_sequence(self, unit: bytes) -> None:
        bits = Bits(unit[1:])
        profile = bits.fixed(8)
        bits.fixed(16)
        own, planes = bits.golomb(), False
        if profile in (100, 110, 122, 244, 44, 83, 86, 118, 128, 138, 139, 134, 135):
            chroma = bits.golomb()
            planes = chroma == 3 and bool(bits.fixed(1))
            bits.golomb(), bits.golomb(), bits.fixed(1)
            if bits.fixed(1):
                raise ImageError('H.264 with scaling matrices is not read; encode without them')
        self._frame_num_bits[own] = 4 + bits.golomb(), planes

    def _slice(self, bits: Bits, *, key: bool, referred: bool) -> Packet:
        bits.golomb()
        kind, own = bits.golomb(), bits.golomb()
        found = self._frame_num_bits.get(self._sets.get(own, -1))
        if found is None:
            raise ImageError('no parameter sets of the video came yet; it is decoded from the '
                             'next key frame on')
        count, planes = found
        if planes:
            bits.fixed(2)
        return Packet(key, bits.fixed(count), 1 << count, referred, kind % 5 == 1)


class H265Headers:
    """Parameter sets of H.265."""

    def __init__(self) -> None:
        self._order_bits: dict[int, int] = {}
        self._sets: dict[int, tuple[int, bool, int]] = {}

    def packet(self, data: bytes) -> Packet:
        """Return the picture of a packet (raises ImageError if there is none)."""
        for unit in units(data):
            kind = unit[0] >> 1 & 63
            if kind == 33:
                self._take_sequence(unit)
            elif kind == 34:
                bits = Bits(unit[2:])
                own, sequence = bits.golomb(), bits.golomb()
                bits.fixed(1)
                self._sets[own] = sequence, bool(bits.fixed(1)), bits.fixed(3)
            elif kind < 32:
                return self._slice(Bits(unit[2:]), kind)
        raise ImageError('the packet holds no H.265 picture')

    def _take_sequence(self, unit: bytes) -> None:
        bits = Bits(unit[2:])
        bits.fixed(4)
        if bits.fixed(3):
            raise ImageError('H.265 with temporal layers is not read; encode with one layer')
        bits.fixed(1 + 88 + 8)  # nesting, profile, level
        own = bits.golomb()
        if bits.golomb() == 3:
            bits.fixed(1)
        bits.golomb(), bits.golomb()
        if bits.fixed(1):
            for _ in range(4):
                bits.golomb()
        bits.golomb(), bits.golomb()
        self._order_bits[own] = 4 + bits.golomb()

    def _slice(self, bits: Bits, kind: int) -> Packet:
        bits.fixed(1)
        if 16 <= kind <= 23:
            bits.fixed(1)
        sequence, shown, extra = self._sets.get(bits.golomb(), (-1, False, 0))
        count = self._order_bits.get(sequence)
        if count is None:
            raise ImageError('no parameter sets of the video came yet; it is decoded from the '
                             'next key frame on')
        bits.fixed(extra)
        bidirectional = bits.golomb() == 0
        if shown:
            bits.fixed(1)
        number = 0 if kind in (19, 20) else bits.fixed(count)
        return Packet(16 <= kind <= 21, number, 1 << count, True, bidirectional)
