# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""`report.html`: a single file without external parts, for large and small screens."""

from __future__ import annotations

import base64
from functools import lru_cache
from io import BytesIO
from typing import Any

import cv2
import jinja2
import matplotlib as mpl
from matplotlib.figure import Figure
import numpy as np
from numpy.typing import NDArray

from gip_localizer.evaluation.error_table import ErrorTable
from gip_localizer.evaluation.metrics import latencies_ms, Metrics, table_rows
from gip_localizer.evaluation.report_figures import (
    error_figure,
    latency_figure,
    nees_figure,
    surface_figure,
)
from gip_localizer.evaluation.report_frames import frame_rows, HEADINGS
from gip_localizer.evaluation.report_map import map_figure
from gip_localizer.evaluation.run import FrameExhibit, Run, Surface
from gip_localizer.visualization.style import STYLE

MAX_PICTURE_SIDE = 480
"""Largest side of a picture in the report, px; chosen."""
READABLE = STYLE | {'font.size': 10.0, 'figure.constrained_layout.use': False}
"""
Settings of charts that are also read on a telephone, 390 px wide; chosen.

The margins are those of `figure_uri`; a computed layout would take half of the time.

"""
MAP, ERRORS, CONSISTENCY = 'Map', 'Error over time', 'Consistency: NEES over time'
EXPLANATIONS = {
    MAP: 'Dark blue: not on the map. The ellipses hold the true position in 95 % of the frames if '
         'the covariances are right.',
    ERRORS: 'In the axes of the vehicle. The band is three reported standard deviations; '
            'errors should stay inside it. Circles lead to the pictures of the frame.',
    CONSISTENCY: 'NEES (normalized estimation error squared): the squared error of x, y and yaw '
                 'divided by the reported covariance. Its mean is 3 if the covariances are right; '
                 'more means that they promise too much, less too little.',
}
"""Caption of a chart → how it is read."""


def render_report(run: Run, metrics: Metrics, table: ErrorTable) -> str:
    """
    Return the HTML page of a run.

    Parameters
    ----------
    run : Run
        Run with estimates, map and pictures.
    metrics : dict
        Result of `compute_metrics`.
    table : ErrorTable
        Result of `tabulate_errors`.

    Returns
    -------
    str
        HTML with pictures as data URIs.

    """
    return template('report.html.j2').render(
        run=run,
        metrics=metrics,
        rows=table_rows(metrics),
        figures=_figures(run, table),
        explanations=EXPLANATIONS,
        exhibits=[_exhibit(exhibit) for exhibit in run.exhibits],
        frames=frame_rows(run, table),
        headings=HEADINGS,
        parameters=run.parameters.to_dict(),
    )


@lru_cache(maxsize=4)
def template(name: str) -> jinja2.Template:
    """Return a template of the package; inserted values are HTML-escaped."""
    loader = jinja2.PackageLoader('gip_localizer.evaluation', 'templates')
    return jinja2.Environment(loader=loader, autoescape=True, trim_blocks=True).get_template(name)


def _figures(run: Run, table: ErrorTable) -> dict[str, str]:
    """Return caption → SVG element or data URI, in the order of the page; without empty ones."""
    figures: dict[str, str] = {}
    with mpl.rc_context(READABLE):
        if len(table.stamps_ns) or run.truth is not None:
            figures[MAP] = figure_uri(map_figure(run, table))
        if table.judged.any():
            links = {exhibit.stamp_ns: f'#{anchor(exhibit)}' for exhibit in run.exhibits}
            figures[ERRORS] = _inline(error_figure(table, links))
        if np.isfinite(table.nees).any():
            figures[CONSISTENCY] = figure_uri(nees_figure(table))
        latencies = latencies_ms(run.estimates)
        if len(latencies):
            figures['Latency'] = figure_uri(latency_figure(latencies))
    return figures


def anchor(exhibit: FrameExhibit) -> str:
    """Return the name of a frame's pictures within the page."""
    return f'frame-{exhibit.stamp_ns}'


def figure_uri(figure: Figure) -> str:
    """Return a figure as SVG in a data URI, with a margin about all that is drawn."""
    return _uri('svg+xml', _svg(figure))


def _inline(figure: Figure) -> str:
    """Return a figure as an SVG element, whose links work, unlike those of a data URI."""
    text = _svg(figure).decode()
    return text[text.index('<svg'):]


def _svg(figure: Figure) -> bytes:
    buffer = BytesIO()
    figure.savefig(buffer, format='svg', metadata={'Date': None}, bbox_inches='tight')
    return buffer.getvalue()


def _exhibit(exhibit: FrameExhibit) -> dict[str, Any]:
    pictures = {caption: _picture_uri(picture) for caption, picture in exhibit.images.items()}
    return {'title': exhibit.title, 'anchor': anchor(exhibit), 'why': exhibit.why,
            'pictures': pictures}


def _picture_uri(picture: NDArray[Any] | Surface) -> str:
    if isinstance(picture, Surface):
        with mpl.rc_context(READABLE):
            return figure_uri(surface_figure(picture))
    return _png_uri(picture)


def _png_uri(image: NDArray[Any]) -> str:
    if image.ndim == 3:
        image = image[..., ::-1]
    scale = MAX_PICTURE_SIDE / max(image.shape[:2])
    how = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_NEAREST
    scale = scale if scale < 1.0 else max(1.0, float(int(scale)))
    size = (max(round(image.shape[1] * scale), 1), max(round(image.shape[0] * scale), 1))
    _, png = cv2.imencode('.png', cv2.resize(np.ascontiguousarray(image), size,
                                             interpolation=how))
    return _uri('png', png.tobytes())


def _uri(kind: str, content: bytes) -> str:
    return f'data:image/{kind};base64,{base64.b64encode(content).decode("ascii")}'
