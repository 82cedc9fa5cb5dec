# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Checks of the arrays and sizes that are passed to the compiled loops; all raise ValueError."""

from __future__ import annotations

import numpy as np

from gip_localizer.core.arrays import Grey


def require_shape(name: str, found: tuple[int, ...], expected: tuple[int, ...]) -> None:
    """Check a shape."""
    if found != expected:
        raise ValueError(f'{name} has shape {found}; the loop expects {expected}')


def require_contiguous(name: str, array: Grey, kind: type) -> None:
    """Check type and contiguity of an array."""
    if array.dtype != kind or not array.flags.c_contiguous:
        raise ValueError(f'{name} is {array.dtype} with strides {array.strides}; the loop expects '
                         f'{np.dtype(kind)} without gaps')


def require_rows(name: str, array: Grey, kind: type, axes: int) -> None:
    """Check type and number of axes of an array, whose rows must be contiguous."""
    gaps = array.size > 0 and array.strides[-1] != array.itemsize
    if array.dtype != kind or array.ndim != axes or gaps:
        raise ValueError(f'{name} is {array.dtype} of shape {array.shape}, strides '
                         f'{array.strides}; the loop expects {np.dtype(kind)} with {axes} axes, '
                         'the last without gaps')


def check_pairs(pairs: Grey, templates: int, fields: int, totals: int) -> None:
    """Check that pairs of template and field exist, and that many totals."""
    inside = bool((pairs >= 0).all() and (pairs < (templates, fields)).all())
    if not inside or not 0 <= totals <= templates:
        raise ValueError(f'pairs {pairs.tolist()} or {totals} totals exceed {templates} '
                         f'templates and {fields} fields')


def check_translations(
    start: tuple[int, int], counts: tuple[int, ...], template: tuple[int, ...],
    field: tuple[int, ...],
) -> None:
    """Check that templates stay inside the fields at all translations."""
    fits = (
        0 <= first <= whole - part - count + 1
        for first, count, part, whole in zip(start, counts, template, field, strict=True)
    )
    if not all(fits):
        raise ValueError(f'{counts[0]} x {counts[1]} translations from {start} on move templates '
                         f'of {template} out of fields of {field}')


def check_footprints(image: Grey, starts: Grey, cells: Grey, means: int, *, block: int) -> None:
    """Check that blocks of bytes are inside an image, and cells inside the means."""
    extent = (image.shape[0] - 1) * image.strides[0] + image.shape[1]
    if starts.size and not (starts.min() >= 0 and starts.max() + block <= extent):
        raise ValueError(f'blocks of {block} bytes begin at {starts.min()} to {starts.max()}, '
                         f'the image has {extent} bytes')
    if cells.size and not (cells.min() >= 0 and cells.max() < means):
        raise ValueError(f'cells {cells.min()} to {cells.max()} of {means} means')


def check_averaging(
    values: tuple[int, ...], taps: int, factor: int, shape: tuple[int, int]
) -> None:
    """Check that all sizes of an averaging are positive."""
    if min(*shape, *values, factor, taps) < 1:
        raise ValueError(f'cells of shape {values}, {taps} taps, factor {factor} and larger '
                         f'cells of shape {shape}: all must be at least 1')


def check_pair_fits(pair: tuple[int, ...], plane: tuple[int, ...]) -> None:
    """Check that two planes fit into the first corner of one plane."""
    if len(plane) != 2 or pair[1] > plane[0] or pair[2] > plane[1]:
        raise ValueError(f'planes of shape {pair} do not fit into one of {plane}')
