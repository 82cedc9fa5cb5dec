# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Videos as cameras' encoders write them, made with PyAV."""

from __future__ import annotations

from fractions import Fraction

import av
import numpy as np

ENCODERS = {'h264': 'libx264', 'h265': 'libx265'}


def encoded(codec, images, *, gop=10, b_frames=0, pixel_format='yuv420p', crf=12):
    """One packet for each image (mono8), with parameter sets in every key frame."""
    height, width = images[0].shape
    context = av.CodecContext.create(ENCODERS[codec], 'w')
    context.width, context.height, context.pix_fmt = width, height, pixel_format
    context.time_base, context.gop_size = Fraction(1, 10), gop
    context.options = {'preset': 'veryfast', 'crf': str(crf)}
    if codec == 'h264':
        context.options['x264-params'] = f'bframes={b_frames}:keyint={gop}:scenecut=0'
    else:
        context.options['x265-params'] = (
            f'bframes={b_frames}:keyint={gop}:scenecut=0:repeat-headers=1:log-level=none:'
            'frame-threads=1:pools=1'
        )
    if not b_frames:
        context.options['tune'] = 'zerolatency'
    packets = []
    for number, image in enumerate(images):
        frame = av.VideoFrame.from_ndarray(image, 'gray').reformat(format=pixel_format)
        frame.pts = number
        packets += context.encode(frame)
    packets += context.encode(None)
    return [bytes(packet) for packet in packets]


def pictures(count, shape=(120, 160)):
    """A texture that moves by a pixel with each picture."""
    import cv2

    noise = np.random.default_rng(3).normal(size=(shape[0], shape[1] + count)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 2.0)
    wide = np.clip(128.0 + 60.0 * smooth / smooth.std(), 20.0, 235.0).astype(np.uint8)
    return [np.ascontiguousarray(wide[:, n : n + shape[1]]) for n in range(count)]
