# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
What the JPEG decoder says of a damaged picture.

libjpeg repairs what it can, fills the rest with grey or with what came before, and only warns; a
picture mended like that matches a wrong place well. OpenCV gives the warnings to nobody but the
process's standard error, so they are read there; what others write meanwhile is passed on.

"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import os
import re
import tempfile
import threading

WARNING = re.compile(rb'^[^\n]*(?:JPEG|libpng|imread_|imdecode_)[^\n]*\n{0,2}', re.MULTILINE)
EXTRANEOUS = re.compile(r'(\d+) extraneous bytes')
STUFFED = 8
"""Extraneous bytes that cameras are known to leave behind a whole picture."""
HARMLESS = ('JFIF', 'libpng warning')
"""Of a version nobody knows, and of colour profiles."""
STDERR = 2
_one_at_a_time = threading.Lock()


@contextmanager
def decoder_warnings() -> Iterator[list[str]]:
    """
    Collect what the decoder warns of; the list is filled when the context ends.

    Where the process has no standard error nothing can be heard, and the list stays empty.

    """
    warnings: list[str] = []
    with _one_at_a_time, tempfile.TemporaryFile() as heard:
        try:
            kept = os.dup(STDERR)
        except OSError:
            yield warnings
            return
        os.dup2(heard.fileno(), STDERR)
        try:
            yield warnings
        finally:
            os.dup2(kept, STDERR)
            os.close(kept)
            heard.seek(0)
            warnings += _pass_on(heard.read())


def _pass_on(text: bytes) -> list[str]:
    """Return the decoder's lines, and write all others to where they were meant to go."""
    others = WARNING.sub(b'', text)
    if others:
        os.write(STDERR, others)
    return [line.decode('ascii', 'replace').strip() for line in WARNING.findall(text)]


def damage(warnings: list[str]) -> str:
    """Return the first warning that tells of damage; empty where there is none."""
    for warning in warnings:
        extraneous = EXTRANEOUS.search(warning)
        if extraneous is not None and int(extraneous[1]) <= STUFFED:
            continue
        if not any(word in warning for word in HARMLESS):
            return warning
    return ''
