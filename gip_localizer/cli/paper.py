# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""`gip paper`: the paper's figure, exactly and by sampling; with --full, on images too."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from math import isnan
from pathlib import Path
import sys
from typing import Any, TYPE_CHECKING

if TYPE_CHECKING:
    from gip_localizer.evaluation.paper.curves import Curves

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
        'paper', help='the numbers and figures of the paper',
        description='Reproduce the simulated figure of "Localization in Autonomous Vehicles '
        'Using a Generalized Inner Product": curves.csv, figure.png and figure.svg.',
    )
    parser.add_argument(
        '--samples', type=int, default=10_000, metavar='N',
        help='random pairs per amplitude (default: 10000, as in the paper)',
    )
    parser.add_argument('--seed', type=int, default=0, metavar='S', help='seed (default: 0)')
    parser.add_argument(
        '--full', action='store_true',
        help='also test the claim on rendered images (pipeline.csv, beyond.csv and figures); '
        'up to 15 minutes',
    )
    output = parser.add_argument_group('output')
    output.add_argument(
        '--out', type=Path, default=Path('results/paper'), metavar='DIR',
        help='results folder (default: results/paper)',
    )
    output.add_argument('--force', action='store_true', help='replace earlier results in DIR')
    camera = parser.add_argument_group('camera', 'defaults are the paper\'s')
    for option, (name, text) in CAMERA_OPTIONS.items():
        camera.add_argument(f'--{option}', dest=name, type=float, metavar='X', help=text)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Compute, write and print."""
    from tqdm import tqdm

    from gip_localizer.evaluation.paper.curves import compute_curves
    from gip_localizer.evaluation.paper.figure import curves_figure
    from gip_localizer.evaluation.paper.geometry import PaperCamera
    from gip_localizer.evaluation.paper.output import (
        check_folder,
        CURVES_FILE,
        results_folder,
        write_curves,
    )
    from gip_localizer.evaluation.paper.style import save_figure, styled

    def progress(amplitudes: Iterable[float]) -> Iterable[float]:
        bar: Iterable[float] = tqdm(
            amplitudes, desc='sampling', unit='amplitude', mininterval=_bar_interval()
        )
        return bar

    given = {name: getattr(args, name) for name, _ in CAMERA_OPTIONS.values()}
    camera = PaperCamera(**{name: value for name, value in given.items() if value is not None})
    check_folder(args.out, args.force)
    curves = compute_curves(camera, args.samples, args.seed, progress)
    with results_folder(args.out, args.force) as folder:
        write_curves(folder / CURVES_FILE, curves)
        with styled():
            save_figure(curves_figure(curves), folder, 'figure')
    _print_curves(curves)
    print(f'wrote {args.out}')
    return 0


def _bar_interval() -> float:
    """Return how often a progress bar is drawn, seconds: seldom where it fills a log."""
    return 0.1 if sys.stderr.isatty() else 15.0


def _print_curves(curves: Curves) -> None:
    from gip_localizer.evaluation.paper.curves import GAIN_AT

    rows = [('squares', f'{curves.squares.total}', '')]
    for k in (0, 9, 49, 99):
        for name in ('generalized', 'standard'):
            exact = getattr(curves, name).exact[k]
            rows.append((f'error at a = {curves.amplitudes[k]:g}, {name}', f'{exact:.6e}', ''))
    for probability, gain in zip(GAIN_AT, curves.gains_db, strict=True):
        value = ('not reached', '') if isnan(gain) else (f'{gain:.2f}', 'dB')
        rows.append((f'gain at error {probability:g}', *value))
    for name in ('generalized', 'standard'):
        curve = getattr(curves, name)
        count = len(curves.amplitudes)
        text = f'samples outside the 99.9 % band, {name}'
        rows.append((text, f'{curve.outside} of {count}', ''))
        if curves.is_paper:
            text = f'RMS of (printed - exact) / standard error, {name}'
            rows.append((text, f'{curve.printed_rms:.3f}', ''))
    width = max(len(row[0]) for row in rows)
    for metric, value, unit in rows:
        print(f'{metric:<{width}}  {value:>12} {unit}'.rstrip())
