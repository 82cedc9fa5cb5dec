# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Messages and files with something wrong in them, drawn by hypothesis."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import copy
import dataclasses
import math
import os
import time
from typing import Any

from hypothesis import strategies as st
import numpy as np

FLOATS = [0.0, -0.0, 1.0, -1.0, 1e-300, -1e-9, 0.5, 3.0, 1e3, -1e7, 1e18, 1e308, -1e308,
          math.nan, math.inf, -math.inf]
INTEGERS = [0, 1, 2, 3, 255, 256, 65535, 65536, 2**31 - 1, 2**32 - 1, -1, -2**31]
TEXTS = ['', 'map', '/map', 'mono8', 'mono16', 'bgr8', 'bayer_rggb8', 'yuv422_yuy2', '32FC1',
         'jpeg', 'png', 'equidistant', 'rational_polynomial', 'plumb_bob', '\0', 'é' * 300]


LONG = 'GIP_FUZZ' in os.environ
HANG = 1.0
"""Seconds of computing that no message and no file may take."""


@contextmanager
def no_hang() -> Iterator[None]:
    """Hold what is done against the time that it may take, where the run is a long one."""
    started = time.process_time()
    yield
    assert not LONG or time.process_time() - started < HANG


def leaves(message: Any, path: tuple[str, ...] = ()) -> list[tuple[str, ...]]:
    """Paths of all fields that are no messages themselves."""
    found = []
    for field in dataclasses.fields(message):
        value = getattr(message, field.name)
        if field.name.startswith('_'):
            continue
        if dataclasses.is_dataclass(value):
            found += leaves(value, (*path, field.name))
        else:
            found.append((*path, field.name))
    return [leaf for leaf in found if not leaf[-1].isupper()]


def _array(draw: Any, value: np.ndarray) -> np.ndarray:
    how = draw(st.sampled_from(['one', 'all', 'cut', 'longer', 'empty', 'noise']))
    changed = value.copy()
    choices = FLOATS if value.dtype.kind == 'f' else [0, 1, 127, 255]
    if how == 'one' and len(changed):
        changed[draw(st.integers(0, len(changed) - 1))] = draw(st.sampled_from(choices))
    elif how == 'all':
        changed[:] = draw(st.sampled_from(choices))
    elif how == 'cut':
        changed = changed[:draw(st.integers(0, max(len(changed) - 1, 0)))]
    elif how == 'longer':
        changed = np.concatenate([changed, changed[:1], changed])
    elif how == 'empty':
        changed = changed[:0]
    else:
        rng = np.random.default_rng(draw(st.integers(0, 1000)))
        where = rng.random(len(changed)) < 0.05
        changed[where] = rng.integers(0, 255, where.sum()).astype(changed.dtype)
    return changed


def _value(draw: Any, value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return _array(draw, value)
    if isinstance(value, str):
        return draw(st.sampled_from(TEXTS))
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        near = st.integers(max(value - 3, 0), value + 3)
        return draw(st.one_of(st.sampled_from(INTEGERS), near))
    return draw(st.sampled_from(FLOATS))


@st.composite
def mutated(draw: Any, message: Any, keep: tuple[str, ...] = ()) -> Any:
    """A copy with one to three fields replaced; fields whose name is in `keep` are not."""
    message = copy.deepcopy(message)
    paths = [path for path in leaves(message) if path[-1] not in keep]
    for path in draw(st.lists(st.sampled_from(paths), min_size=1, max_size=3, unique=True)):
        owner = message
        for name in path[:-1]:
            owner = getattr(owner, name)
        setattr(owner, path[-1], _value(draw, getattr(owner, path[-1])))
    return message


@st.composite
def mutated_bytes(draw: Any, content: bytes) -> bytes:
    """Bytes with a piece replaced, cut out, doubled or the end missing."""
    start = draw(st.integers(0, len(content)))
    end = draw(st.integers(start, min(start + 40, len(content))))
    piece = draw(st.one_of(
        st.binary(max_size=20), st.just(b''), st.just(content[start:end] * 2),
        st.sampled_from([b'.nan', b'-1', b'1e308', b'[', b'{', b': ', b'&a [*a]', b'\xff\xfe']),
    ))  # fmt: skip
    whole = content[:start] + piece + content[end:]
    return whole[:draw(st.integers(0, len(whole)))] if draw(st.booleans()) else whole
