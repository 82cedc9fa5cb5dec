# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Write the results folder of a run: completely or not at all."""

from __future__ import annotations

from dataclasses import replace
import json
from pathlib import Path

import numpy as np

from gip_localizer.errors import OutputError
from gip_localizer.evaluation.error_table import ErrorTable, tabulate_errors
from gip_localizer.evaluation.frame_table import frame_table
from gip_localizer.evaluation.metrics import compute_metrics, Metrics
from gip_localizer.evaluation.published_bag import write_published
from gip_localizer.evaluation.report import render_report
from gip_localizer.evaluation.run import Run
from gip_localizer.io.map_files import save_map
from gip_localizer.io.output_folder import check_folder, fresh_folder
from gip_localizer.io.trajectory import Trajectory
from gip_localizer.io.tum_files import write_tum
from gip_localizer.parameters import dump_parameter_file

METRICS_FILE, MAP_FILE = 'metrics.json', 'map.yaml'


def check_output(out: Path | str, force: bool) -> None:
    """Check the output folder before any work is done (raises OutputError)."""
    check_folder(out, force=force, mark=METRICS_FILE)


def write_results(
    out: Path | str, run: Run, force: bool = False, *, report: bool = True
) -> Metrics:
    """
    Write the results folder, and the link `latest` next to it.

    Parameters
    ----------
    out : Path or str
        The folder; missing parents are created.
    run : Run
        The run to write; if `run.complete` is False, `metrics.json` and the report say so.
    force : bool
        True: existing results are replaced.
    report : bool
        False: no `report.html` is written.

    Returns
    -------
    dict
        The metrics of `metrics.json`.

    Raises
    ------
    OutputError
        The folder must not be replaced, or writing fails; nothing is left behind then.

    """
    if run.keep_map:
        named = Path(out).absolute() / MAP_FILE
        run = replace(run, parameters=run.parameters.replace({'map_file': str(named)}))
    metrics = compute_metrics(run)
    with fresh_folder(out, force=force, mark=METRICS_FILE) as folder:
        table = tabulate_errors(run.estimates, run.truth, run.wrong)
        _fill(folder, run, metrics, table)
        if report:
            page = render_report(run, metrics, table)
            (folder / 'report.html').write_text(page, encoding='utf-8')
    _link_latest(Path(out).absolute())
    return metrics


def _fill(folder: Path, run: Run, metrics: Metrics, table: ErrorTable) -> None:
    write_tum(folder / 'estimate.tum', Trajectory.from_samples(
        (estimate.stamp_ns, estimate.pose)
        for estimate in run.estimates if estimate.pose is not None
    ))
    if run.truth is not None:
        stamps = np.array([estimate.stamp_ns for estimate in run.estimates], np.int64)
        write_tum(folder / 'ground_truth.tum', run.truth.with_stamps(stamps))
    text = json.dumps(metrics, indent=2, allow_nan=False, default=str)
    (folder / METRICS_FILE).write_text(text + '\n', encoding='utf-8')
    (folder / 'params.yaml').write_text(dump_parameter_file(run.parameters), encoding='utf-8')
    if run.keep_map and run.raster_map is not None:
        save_map(run.raster_map, folder / MAP_FILE)
    write_published(folder / 'published.mcap', run)
    (folder / 'frames.csv').write_text(frame_table(run, table), encoding='utf-8')


def _link_latest(out: Path) -> None:
    """Point the link `latest` to the folder; a file or folder of that name is not changed."""
    link = out.parent / 'latest'
    if link == out or (link.exists() and not link.is_symlink()):
        return
    fresh = out.parent / f'.latest.{out.name}'
    try:
        fresh.unlink(missing_ok=True)
        fresh.symlink_to(out.name)
        fresh.replace(link)
    except OSError as error:
        raise OutputError(f'cannot write {link}: {error.strerror}') from None
