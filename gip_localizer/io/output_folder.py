# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
A folder or file that is written whole or not at all.

It is filled next to its place under a temporary name and renamed, so that a full disk or a
failure leaves nothing half done and an older folder as it was.

"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import os
from pathlib import Path
import shutil
import tempfile

from gip_localizer.errors import OutputError


def check_folder(out: Path | str, *, force: bool, mark: str) -> None:
    """
    Refuse an output folder before any work is done.

    Parameters
    ----------
    out : Path
        The folder.
    force : bool
        True: what lies there may be replaced, if it carries the mark.
    mark : str
        A file that every folder of this kind holds; others are never replaced.

    Raises
    ------
    OutputError
        The folder holds something and may not be replaced, or cannot be made.

    """
    out = Path(out).absolute()
    try:
        if out.exists() and not out.is_dir():
            raise OutputError(f'{out} is a file; choose another folder with --out')
        if out.is_dir() and any(out.iterdir()):
            _check_full(out, force=force, mark=mark)
        out.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=out.parent, prefix=f'.{out.name}.'):
            pass
    except OSError as error:
        raise OutputError(f'cannot write {out}: {error.strerror}; choose another --out') from None


def _check_full(out: Path, *, force: bool, mark: str) -> None:
    if not (out / mark).is_file():
        raise OutputError(
            f'{out} is not empty and holds no {mark}, so nothing of this kind was written there '
            'and it is not replaced; choose another folder with --out'
        )
    if not force:
        raise OutputError(
            f'{out} is not empty; replace it with --force or choose another folder with --out'
        )


@contextmanager
def fresh_folder(out: Path | str, *, force: bool, mark: str) -> Iterator[Path]:
    """
    Give a temporary folder to fill; on leaving in peace it takes the place of `out`.

    Parameters
    ----------
    out, force, mark
        As for `check_folder`.

    Raises
    ------
    OutputError
        As for `check_folder`, or the disk refuses while the folder is filled.

    """
    out = Path(out).absolute()
    check_folder(out, force=force, mark=mark)
    temporary = Path(tempfile.mkdtemp(dir=out.parent, prefix=f'.{out.name}.'))
    try:
        yield temporary
        temporary.chmod(0o755)
        _swap(temporary, out)
    except OSError as error:
        raise OutputError(f'cannot write {out}: {error.strerror or error}') from None
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _swap(temporary: Path, out: Path) -> None:
    if not out.exists():
        temporary.rename(out)
        return
    old = Path(tempfile.mkdtemp(dir=out.parent, prefix=f'.{out.name}.old.'))
    out.rename(old)
    try:
        temporary.rename(out)
    finally:
        if not out.exists():
            old.rename(out)
    shutil.rmtree(old)


def check_file(out: Path, *, force: bool, suffixes: tuple[str, ...]) -> None:
    """
    Refuse an output file before any work is done.

    Parameters
    ----------
    out : Path
        The file.
    force : bool
        True: a file of that name may be replaced.
    suffixes : tuple of str
        Endings of names that can be written.

    Raises
    ------
    OutputError
        It exists and may not be replaced, is a folder, or of another ending.

    """
    if out.is_dir():
        raise OutputError(f'{out} is a folder; name a file in it with --out')
    if out.suffix.lower() not in suffixes:
        raise OutputError(
            f'{out} has the ending {out.suffix!r}; expected one of {", ".join(suffixes)}'
        )
    if out.exists() and not force:
        raise OutputError(f'{out} exists; name another with --out, or give --force')


def write_whole(path: Path, content: bytes) -> None:
    """Write a file by renaming a finished one; raise OutputError, and leave no half of it."""
    part = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f'.{path.name}.')
        part = Path(name)
        with os.fdopen(handle, 'wb') as stream:
            stream.write(content)
        part.chmod(0o644)
        part.replace(path)
    except OSError as error:
        if part is not None:
            part.unlink(missing_ok=True)
        raise OutputError(f'{path}: cannot be written ({error.strerror})') from None
