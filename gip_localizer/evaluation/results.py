# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
The results folder of a run: whole or not at all.

It is written beside its place under a temporary name and renamed, so that a full disk or a
failure leaves nothing half done and an older folder as it was.

"""

from __future__ import annotations

import json
from pathlib import Path
import shutil
import tempfile

from gip_localizer.errors import OutputError
from gip_localizer.evaluation.error_table import tabulate_errors
from gip_localizer.evaluation.metrics import compute_metrics, Metrics
from gip_localizer.evaluation.published import write_published
from gip_localizer.evaluation.report import render_report
from gip_localizer.evaluation.run import Run
from gip_localizer.io.trajectory import Trajectory, write_tum
from gip_localizer.parameters import dump_parameter_file

METRICS_FILE = 'metrics.json'


def check_output(out: Path, force: bool) -> None:
    """
    Refuse an output folder before any work is done.

    Raises
    ------
    OutputError
        The folder holds something and `force` is False, or it holds something that no run wrote
        (never deleted), or it cannot be made.

    """
    if out.exists() and not out.is_dir():
        raise OutputError(f'{out} is a file; choose another folder with --out')
    if out.is_dir() and any(out.iterdir()):
        if not (out / METRICS_FILE).is_file():
            raise OutputError(
                f'{out} is not empty and holds no {METRICS_FILE}, so it is no results folder and '
                'is not replaced; choose another with --out'
            )
        if not force:
            raise OutputError(
                f'{out} holds results already; replace them with --force or choose another '
                'folder with --out'
            )
    try:
        out.absolute().parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=out.absolute().parent, prefix=f'.{out.name}.'):
            pass
    except OSError as error:
        raise OutputError(f'cannot write {out}: {error.strerror}; choose another --out') from None


def write_results(out: Path | str, run: Run, force: bool = False) -> Metrics:
    """
    Write the whole results folder and the link `latest` beside it.

    Parameters
    ----------
    out : Path or str
        The folder; its parents are made.
    run : Run
        What is written; `run.complete` False marks it in `metrics.json` and the report.
    force : bool
        True: results that lie there are replaced.

    Returns
    -------
    dict
        The figures of `metrics.json`.

    Raises
    ------
    OutputError
        The folder may not be replaced, or the disk refuses; nothing is left behind then.

    """
    out = Path(out).absolute()
    check_output(out, force)
    metrics = compute_metrics(run)
    temporary = Path(tempfile.mkdtemp(dir=out.parent, prefix=f'.{out.name}.'))
    try:
        _fill(temporary, run, metrics)
        temporary.chmod(0o755)
        _swap(temporary, out)
        _link_latest(out)
    except OSError as error:
        raise OutputError(f'cannot write {out}: {error.strerror or error}') from None
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
    return metrics


def _fill(folder: Path, run: Run, metrics: Metrics) -> None:
    write_tum(folder / 'estimate.tum', Trajectory.from_samples(
        (estimate.stamp_ns, estimate.pose)
        for estimate in run.estimates if estimate.pose is not None
    ))
    if run.truth is not None:
        write_tum(folder / 'ground_truth.tum', run.truth)
    text = json.dumps(metrics, indent=2, allow_nan=False, default=str)
    (folder / METRICS_FILE).write_text(text + '\n', encoding='utf-8')
    (folder / 'params.yaml').write_text(dump_parameter_file(run.parameters), encoding='utf-8')
    write_published(folder / 'published.mcap', run)
    page = render_report(run, metrics, tabulate_errors(run.estimates, run.truth))
    (folder / 'report.html').write_text(page, encoding='utf-8')


def _swap(temporary: Path, out: Path) -> None:
    """Put the new folder in place of the old one (refused before unless it may go)."""
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


def _link_latest(out: Path) -> None:
    """Point `latest`, beside the folder, to it; anything else of that name is left alone."""
    link = out.parent / 'latest'
    if link == out or (link.exists() and not link.is_symlink()):
        return
    fresh = out.parent / f'.latest.{out.name}'
    fresh.unlink(missing_ok=True)
    fresh.symlink_to(out.name)
    fresh.replace(link)
