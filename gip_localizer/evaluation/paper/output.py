# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The folder of the paper's results: whole or not at all, and never over something else."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
import csv
from pathlib import Path
import shutil
import tempfile

from gip_localizer.errors import OutputError
from gip_localizer.evaluation.paper.curves import Curves

CURVES_FILE = 'curves.csv'
CURVES_COLUMNS = (
    'amplitude', 'standard_exact', 'generalized_exact', 'standard_sampled',
    'generalized_sampled', 'standard_paper', 'generalized_paper',
)


def check_folder(out: Path, force: bool) -> None:
    """
    Refuse an output folder before any work is done.

    Raises
    ------
    OutputError
        It is a file, it cannot be written, or it holds something: earlier results without
        `force`, or files of another kind, which are never deleted.

    """
    try:
        if out.exists() and not out.is_dir():
            raise OutputError(f'{out} is a file; name a folder with --out')
        if out.is_dir() and any(out.iterdir()):
            if not (out / CURVES_FILE).is_file():
                raise OutputError(
                    f'{out} is not empty and holds no {CURVES_FILE}, so it is not replaced; '
                    'name another folder with --out'
                )
            if not force:
                raise OutputError(
                    f'{out} holds results already; replace them with --force or name another '
                    'folder with --out'
                )
        out.absolute().parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=out.absolute().parent, prefix=f'.{out.name}.'):
            pass
    except OSError as error:
        raise OutputError(f'cannot write {out}: {error.strerror}; name another --out') from None


@contextmanager
def results_folder(out: Path, force: bool) -> Iterator[Path]:
    """
    Give a folder to fill beside `out`, and put it in place when the block ends well.

    Raises
    ------
    OutputError
        As `check_folder`, or the disk refuses; nothing is left behind then.

    """
    check_folder(out, force)
    out = out.absolute()
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
    old = Path(tempfile.mkdtemp(dir=out.parent, prefix=f'.{out.name}.'))
    out.rename(old)
    try:
        temporary.rename(out)
    finally:
        if not out.exists():
            old.rename(out)
    shutil.rmtree(old, ignore_errors=True)


def write_table(path: Path, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Write a CSV file; floats keep ten significant digits, NaN is an empty field."""
    with path.open('w', encoding='utf-8', newline='') as file:
        writer = csv.writer(file, lineterminator='\n')
        writer.writerow(columns)
        writer.writerows([_field(value) for value in row] for row in rows)


def _field(value: object) -> str:
    if not isinstance(value, float):
        return str(value)
    return '' if value != value else f'{value:.10g}'


def write_curves(path: Path, curves: Curves) -> None:
    """Write `curves.csv`, one row per amplitude."""
    standard, generalized = curves.standard, curves.generalized
    columns = (
        curves.amplitudes, standard.exact, generalized.exact, standard.sampled,
        generalized.sampled, standard.printed, generalized.printed,
    )
    rows = zip(*(column.tolist() for column in columns), strict=True)
    write_table(path, CURVES_COLUMNS, rows)
