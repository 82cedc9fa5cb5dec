# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""`gip paper`: the paper's figure, exact and sampled; with --full also on rendered images."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, TYPE_CHECKING

from gip_localizer.errors import ParameterError
from gip_localizer.parameters.yaml_files import user_path

if TYPE_CHECKING:
    from gip_localizer.paper.curves import Curves
    from gip_localizer.paper.geometry import PaperCamera

CAMERA_OPTIONS = {
    'height': ('height', 'camera height h above the road, cm (58.3095)'),
    'pitch': ('pitch_deg', 'optical axis θ below the horizon, degrees (35.9020)'),
    'fov-vertical': ('fov_vertical_deg', 'vertical field of view, degrees (39.2962)'),
    'fov-horizontal': ('fov_horizontal_deg', 'horizontal field of view, degrees (70.5288)'),
    'focal-length': ('focal_length', 'focal length f, cm (0.0367)'),
    'square': ('square', 'side of a square on the road, cm (20)'),
    'noise': ('noise_density', 'noise density N0 (0.0018)'),
}


def add_parser(verbs: Any) -> None:
    """Add the verb to the parser of `gip`."""
    parser = verbs.add_parser(
        'paper', help='reproduce the numbers and figures of the paper',
        description='Reproduce the simulated figure of "Localization in Autonomous Vehicles '
        'Using a Generalized Inner Product": curves.csv, figure.png and figure.svg.',
    )
    parser.add_argument(
        '--samples', type=int, default=10_000, metavar='N',
        help='random pairs per amplitude (default: 10000, as in the paper)',
    )
    parser.add_argument('--seed', type=int, default=0, metavar='S',
                        help='seed of random numbers (default: 0)')
    parser.add_argument(
        '--full', action='store_true',
        help='also test the paper on rendered images (pipeline.csv, beyond.csv and figures); '
        'takes up to 15 minutes',
    )
    parser.add_argument(
        '--trials', type=int, default=2000, metavar='N',
        help='places per experiment of --full (default: 2000; a twentieth of them for the table '
        'of methods)',
    )
    output = parser.add_argument_group('output')
    output.add_argument(
        '--out', type=user_path, default=Path('results/paper'), metavar='DIR',
        help='results folder (default: results/paper)',
    )
    output.add_argument('--force', action='store_true', help='replace existing results in DIR')
    camera = parser.add_argument_group('camera', 'defaults are the paper\'s')
    for option, (name, text) in CAMERA_OPTIONS.items():
        camera.add_argument(f'--{option}', dest=name, type=float, metavar='X', help=text)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Compute, write and print."""
    from gip_localizer.io.output_folder import check_folder, fresh_folder
    from gip_localizer.paper.curves import compute_curves
    from gip_localizer.paper.geometry import PaperCamera
    from gip_localizer.paper.output import CURVES_FILE
    from gip_localizer.paper.summary import curve_rows, format_rows

    given = {name: getattr(args, name) for name, _ in CAMERA_OPTIONS.values()}
    camera = PaperCamera(**{name: value for name, value in given.items() if value is not None})
    if args.full and camera != PaperCamera():
        raise ParameterError('--full tests the paper\'s own camera; leave out the camera options')
    if args.trials < 1:
        raise ParameterError(f'trials is {args.trials}; give --trials 1 or more')
    check_folder(args.out, force=args.force, mark=CURVES_FILE)
    curves = compute_curves(camera, args.samples, args.seed, _bar('sampling', 'amplitude'))
    with fresh_folder(args.out, force=args.force, mark=CURVES_FILE) as folder:
        _write_curves(folder, curves)
        rows = curve_rows(curves)
        if args.full:
            rows += _run_full(folder, camera, args.seed, args.trials)
    print(format_rows(rows))
    print(f'wrote {args.out}')
    return 0


def _write_curves(folder: Path, curves: Curves) -> None:
    from gip_localizer.paper.figure import curves_figure
    from gip_localizer.paper.output import CURVES_FILE, write_curves
    from gip_localizer.paper.style import save_figure, styled

    write_curves(folder / CURVES_FILE, curves)
    with styled():
        save_figure(curves_figure(curves), folder, 'figure')


def _run_full(
    folder: Path, camera: PaperCamera, seed: int, trials: int
) -> list[tuple[str, str, str]]:
    """Run the experiments on images and write their results; return the rows to print."""
    from gip_localizer.paper import (
        baseline_comparison,
        baseline_results,
        full_figures,
        image_experiment,
        image_results,
        summary,
    )
    from gip_localizer.paper.output import write_table
    from gip_localizer.paper.style import save_figure, styled

    bar = _bar('the paper on images', 'place')
    measured = image_experiment.run_pipeline(camera, seed, bar, trials=trials)
    write_table(
        folder / 'pipeline.csv', image_results.COLUMNS, image_results.table_rows(measured)
    )
    bar = _bar('beyond the paper', 'place')
    found = baseline_comparison.run_beyond(camera, seed, bar, trials=max(trials // 20, 1))
    write_table(
        folder / 'beyond.csv', baseline_results.COLUMNS, baseline_results.table_rows(found)
    )
    with styled():
        save_figure(full_figures.pipeline_figure(measured), folder, 'pipeline')
        save_figure(full_figures.beyond_figure(found), folder, 'beyond')
    return summary.pipeline_rows(measured) + summary.beyond_rows(found)


def _bar(text: str, unit: str) -> Callable[[Iterable[Any]], Iterable[Any]]:
    """Return a function that wraps an iterable with a progress bar."""
    from gip_localizer.cli.progress import progress

    def wrap(items: Iterable[Any]) -> Iterable[Any]:
        bar: Iterable[Any] = progress(None, text, unit=unit, iterable=items)
        return bar

    return wrap
