# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The correlation against the definition in float64, with both transforms."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from gip_localizer.core.match import fft as spectra
from gip_localizer.core.match.correlation import correlate
from gip_localizer.core.match.fft import OpenCVTransform, SciPyTransform
from gip_localizer.core.threads import in_parallel

TERMS = [((0, 0),), ((0, 1), (1, 0)), ((2, 2), (1, 1), (0, 0))]
CANVAS, HALF, YAWS = (19, 14), (4, 5), 5


def case(seed: int = 1):
    rng = np.random.default_rng(seed)
    window = (3, CANVAS[0] + 2 * HALF[0], CANVAS[1] + 2 * HALF[1])
    fields = rng.random(window, np.float32) - np.float32(0.5)
    templates = rng.random((YAWS, 3, *CANVAS), np.float32)
    return fields, templates


def by_definition(fields, templates):
    """Every sum as the definition says, in float64."""
    n_x, n_y = 2 * HALF[0] + 1, 2 * HALF[1] + 1
    out = np.zeros((YAWS, len(TERMS), n_x, n_y))
    for yaw, term, x, y in np.ndindex(out.shape):
        for t, f in TERMS[term]:
            part = fields[f, x : x + CANVAS[0], y : y + CANVAS[1]].astype(float)
            out[yaw, term, x, y] += (templates[yaw, t] * part).sum()
    return out


def collected(yaws, fields, templates):
    out = np.full((YAWS, len(TERMS), 2 * HALF[0] + 1, 2 * HALF[1] + 1), np.nan)

    def turn(yaw, room):
        room[:] = templates[yaw]

    def sink(yaws, terms):
        out[yaws.start : yaws.stop] = terms.transpose(1, 0, 2, 3)

    correlate(fields, TERMS, yaws, canvas=CANVAS, turn=turn, sink=sink)
    return out


@pytest.mark.parametrize('transform', [OpenCVTransform, SciPyTransform])
def test_transforms_equal_the_definition(transform, monkeypatch):
    monkeypatch.setattr('gip_localizer.core.match.correlation.make_transform', transform)
    for seed in (1, 2):  # the second run works in what the first left behind
        fields, templates = case(seed)
        expected = by_definition(fields, templates)
        found = collected(YAWS, fields, templates)
        np.testing.assert_allclose(found, expected, atol=1e-5 * np.abs(expected).max())


@pytest.mark.parametrize('transform', [OpenCVTransform, SciPyTransform])
def test_a_yaw_without_a_partner_takes_nothing_from_frames_before(transform, monkeypatch):
    monkeypatch.setattr('gip_localizer.core.match.correlation.make_transform', transform)
    found = []
    for seed in (2, 3):
        collected(YAWS - 1, *case(seed))
        found.append(collected(1, *case(1)))
    np.testing.assert_array_equal(found[0], found[1])


@pytest.mark.parametrize('transform', [OpenCVTransform, SciPyTransform])
@pytest.mark.parametrize('size', [(1, 1), (2, 3), (37, 53), (128, 96)])
def test_planes_come_back_and_are_large_enough(transform, size):
    t = transform(*size)
    assert t.shape[0] >= size[0]
    assert t.shape[1] >= size[1]
    # a template of a single cell picks the field out again, as either part of a plane
    field = np.random.default_rng(1).random(size, np.float32)
    dot = np.zeros(t.shape, np.complex64)
    dot[0, 0] = 1.0 - 2.0j
    spectrum, room = np.empty_like(dot), np.empty_like(dot)
    t.forward(dot, 1, spectrum)
    back = t.backward(spectra.field_spectrum(t, field) * spectrum, size[0], room)
    np.testing.assert_allclose(back[: size[0], : size[1]], (1.0 - 2.0j) * field, atol=1e-6)


@pytest.mark.parametrize('least', [1, 97, 378, 392, 410, 425, 2005])
def test_quick_sizes_suffice_and_are_not_wasteful(least):
    size, _ = OpenCVTransform(least, 1).shape
    assert size >= least
    assert size % spectra.MULTIPLE == 0
    assert size <= 1.15 * least + 2 * spectra.MULTIPLE


@pytest.mark.skipif(not hasattr(cv2, 'ipp'), reason='this build of OpenCV has no IPP')
def test_the_transform_follows_what_opencv_has_alone():
    before = cv2.ipp.useIPP()
    try:
        for asked in (True, False):
            cv2.ipp.setUseIPP(asked)
            kind = OpenCVTransform if cv2.ipp.useIPP() else SciPyTransform
            assert isinstance(spectra.make_transform(10, 10), kind)
        assert kind is SciPyTransform
    finally:
        cv2.ipp.setUseIPP(before)


def test_an_error_in_any_part_reaches_the_caller():
    def work(part):
        if part == 1:
            raise RuntimeError('part 1')

    with pytest.raises(RuntimeError, match='part 1'):
        in_parallel(work, [0, 1])
    with pytest.raises(RuntimeError, match='part 1'):
        in_parallel(work, [1, 0])
