# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The results folder of a benchmark: bench.json, details.json, bench.md and figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import json
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from gip_localizer.benchmark.rows import exponent, Row
from gip_localizer.io.output_folder import fresh_folder

MARK = 'bench.json'
SEARCHES = {'exhaustive': 'o-', 'coarse to fine': 's-', 'peer': '^--'}


def write_bench(
    out: Path, rows: Sequence[Row], details: Mapping[str, Any], *, force: bool
) -> None:
    """Write the folder completely or not at all (raises OutputError)."""
    with fresh_folder(out, force=force, mark=MARK) as folder:
        text = json.dumps([row.as_dict() for row in rows], indent=1, ensure_ascii=False)
        (folder / MARK).write_text(text + '\n', encoding='utf-8')
        (folder / 'details.json').write_text(json.dumps(details, indent=1) + '\n', 'utf-8')
        (folder / 'bench.md').write_text(as_markdown(rows) + '\n', encoding='utf-8')
        for name, figure in figures(details).items():
            figure.savefig(folder / f'{name}.png', dpi=130, metadata={'Software': None})


def as_markdown(rows: Sequence[Row]) -> str:
    """Return the rows as a Markdown table."""
    lines = ['| suite | case | this package | baseline | its time | speed-up '
             '| same best candidate |',
             '| --- | --- | ---: | --- | ---: | ---: | ---: |']
    for row in rows:
        lines.append('| ' + ' | '.join([
            row.suite, row.case, f'{row.ours_ms:.3g} ms', row.peer or '-',
            '-' if row.peer_ms is None else f'{row.peer_ms:.3g} ms',
            '-' if row.ratio is None else f'{row.ratio:.2f}',
            '-' if row.same_winner is None else f'{row.same_winner:.1%}',
        ]) + ' |')
    return '\n'.join(lines)


def figures(details: Mapping[str, Any]) -> dict[str, Figure]:
    """Return the figures for which there are details, by name."""
    found: dict[str, Figure] = {}
    points = details.get('growth', [])
    for axis in dict.fromkeys(point['axis'] for point in points):
        chosen = [point for point in points if point['axis'] == axis]
        found['growth-' + axis.split()[0]] = _growth(axis, chosen)
    if 'map' in details:
        found['growth-map'] = _map_figure(details['map']['areas'])
    return found


def _axes(label: str) -> tuple[Figure, Any]:
    figure = Figure(figsize=(5.2, 3.6), layout='constrained')
    axes = figure.add_subplot()
    axes.set(xscale='log', yscale='log', xlabel=label, ylabel='time per frame [ms]')
    axes.grid(alpha=0.3, which='both')
    return figure, axes


def _growth(axis: str, points: Sequence[Mapping[str, Any]]) -> Figure:
    figure, axes = _axes(axis)
    for search, style in SEARCHES.items():
        sizes = [p['size'] for p in points if p['search'] == search]
        times = [p['ms'] for p in points if p['search'] == search]
        name = 'cv2.matchTemplate' if search == 'peer' else search
        axes.plot(sizes, times, style, label=f'{name}: exponent {exponent(sizes, times):.2f}')
    axes.legend(frameon=False)
    return figure


def _map_figure(areas: Sequence[Mapping[str, Any]]) -> Figure:
    figure, axes = _axes('area of the map [m²]')
    sizes = [each['side_m'] ** 2 for each in areas]
    for key, name in (('ms', 'time per frame [ms]'), ('rss_mib', 'resident memory [MiB]')):
        values = [each[key] for each in areas]
        axes.plot(sizes, values, 'o-', label=f'{name}: exponent {exponent(sizes, values):.2f}')
    axes.set_ylabel('')
    axes.legend(frameon=False)
    return figure
