# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Number of threads of BLAS, FFT, OpenCV and this package, set in one place.

- Yaws, and bands of images of 16 bit or float, are divided over at most `WORKERS` threads of
  this package; NumPy, SciPy, OpenCV and the compiled loops release Python's lock inside.
- BLAS and OpenCV run on one thread: the matrices and warps are small, so their threads would
mostly
  wait, on cores that a camera driver needs (measured: with BLAS threads a frame takes 2.5 times
  the processor time). NumPy and OpenCV read the setting when they are loaded, so `ros` and `cli`
  set it before.
- The FFTs have no threads of their own: there are always more yaws than cores.
- A process that shares the cores with others of its kind uses one thread (`use_one_thread`).

"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
import os
import threading
from typing import TypeVar

Part = TypeVar('Part')


def _cores() -> int:
    if hasattr(os, 'sched_getaffinity'):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


WORKERS = max(1, min(2, _cores()))
"""Number of threads for one frame: at most 2 (measured on two cores; BENCHMARK.md)."""
_ending = threading.Event()


def use_one_library_thread() -> None:
    """Set BLAS and OpenCV to one thread unless the user set it; call before they are loaded."""
    for name in ('OPENBLAS_NUM_THREADS', 'OPENCV_FOR_THREADS_NUM'):
        os.environ.setdefault(name, '1')


def use_one_thread() -> None:
    """Do all work in the calling thread from now on; results stay the same."""
    global WORKERS
    WORKERS = 1


class WorkEndedError(Exception):
    """The process is ending, so the work was stopped."""


def end_work() -> None:
    """End the work of other threads at their next `check_end`, so that the process can end."""
    _ending.set()


def check_end() -> None:
    """Raise WorkEndedError after `end_work`."""
    if _ending.is_set():
        raise WorkEndedError


def in_parallel(
    work: Callable[[Part], None], parts: Iterable[Part], *, worth_it: bool = True
) -> None:
    """
    Do the work on all parts, in this thread and in the pool; a free thread takes the next part.

    Threads make parts of less than a millisecond slower, because they wait for Python's lock: with
    `worth_it` False this thread does all parts. Raises WorkEndedError after `end_work`.

    """
    left = deque(parts)

    def drain() -> None:
        while left:
            check_end()
            try:
                part = left.popleft()
            except IndexError:
                return
            work(part)

    waiting = [_pool().submit(drain) for _ in range(min(WORKERS, len(left)) - 1) if worth_it]
    try:
        drain()
    finally:
        for done in waiting:
            done.result()


@cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(max(WORKERS - 1, 1), thread_name_prefix='gip')


if hasattr(os, 'register_at_fork'):
    os.register_at_fork(after_in_child=_pool.cache_clear)  # threads do not survive a fork
