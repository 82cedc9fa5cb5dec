# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import base64
from html.parser import HTMLParser
import re

import cv2
import numpy as np
import pytest
from run_samples import noisy_run

from gip_localizer.evaluation import report_frames
from gip_localizer.evaluation.error_table import tabulate_errors
from gip_localizer.evaluation.metrics import compute_metrics, table_rows
from gip_localizer.evaluation.report import render_report
from gip_localizer.evaluation.report_map import map_figure


class Page(HTMLParser):
    def __init__(self, text):
        super().__init__()
        self.images, self.links, self.cells, self._open = {}, [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        attributes = dict(attrs)
        if tag == 'img':
            self.images[attributes['alt']] = attributes['src']
        if attributes.get('role') == 'img':
            self.images[attributes['aria-label']] = ''
        self.links += [v for k, v in attrs if k in ('href', 'src') and not v.startswith('data:')]
        self._open.append(tag)

    def handle_data(self, text):
        if self._open and self._open[-1] in ('td', 'th') and text.strip():
            self.cells.append(text.strip())


def page_of(run):
    text = render_report(run, compute_metrics(run), tabulate_errors(run.estimates, run.truth))
    return text, Page(text)


def test_the_page_needs_nothing_else():
    text, page = page_of(noisy_run())
    assert page.links == []
    assert not re.search(r'url\((?!data:|#)|@import|<script|<link', text)


def test_the_page_has_every_section():
    _, page = page_of(noisy_run(withheld=3))
    assert list(page.images)[:4] == [
        'Map', 'Error over time', 'Consistency: NEES over time', 'Latency'
    ]
    assert set(page.images) >= {'camera image', 'score surface'}


def test_the_summary_holds_the_figures():
    run = noisy_run()
    _, page = page_of(run)
    for row in table_rows(compute_metrics(run)):
        assert page.cells[page.cells.index(row.name) + 1] == row.value


def test_names_from_bags_are_escaped():
    text, _ = page_of(noisy_run(notes=['topic <script>alert(1)</script>']))
    assert '<script>' not in text
    assert 'A &lt;run&gt;' in text


def test_without_truth_the_page_says_so():
    text, page = page_of(noisy_run(truth=None))
    assert 'No ground truth' in text
    assert 'Error over time' not in page.images


def test_colour_pictures_keep_their_colours():
    red = np.zeros((4, 4, 3), np.uint8)
    red[..., 0] = 200
    run = noisy_run()
    exhibit = run.exhibits[0]
    changed = type(exhibit)(exhibit.title, exhibit.stamp_ns, {'red': red})
    _, page = page_of(noisy_run(exhibits=[changed]))
    png = base64.b64decode(page.images['red'].split(',')[1])
    pixel = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)[0, 0]
    assert pixel.tolist() == [0, 0, 200]


@pytest.mark.parametrize('sigma', [1e-4, 0.01, 0.3])
def test_ellipses_are_enlarged_by_the_factor_that_is_said(sigma):
    run = noisy_run()
    frames = [type(f)(f.stamp_ns, f.pose, np.eye(3) * sigma**2) for f in run.estimates]
    run = noisy_run(estimates=frames)
    axes = map_figure(run, tabulate_errors(run.estimates, run.truth)).axes[0]
    said = re.search(r'(\d+) times', axes.get_title(loc='right'))
    factor = int(said.group(1)) if said else 1
    drawn = axes.collections[0].get_widths()
    np.testing.assert_allclose(drawn, 2 * np.sqrt(5.991464547) * sigma * factor, rtol=1e-6)


def test_worst_frames_and_charts_are_explained():
    text, _ = page_of(noisy_run())
    assert 'Rank 1 of 1.' in text
    assert 'normalized estimation error squared' in text


def test_a_score_surface_has_axes_with_units():
    _, page = page_of(noisy_run())
    drawing = base64.b64decode(page.images['score surface'].split(',')[1]).decode()
    assert page.images['score surface'].startswith('data:image/svg')
    assert all(words in drawing for words in ('ahead [m]', 'left [m]', 'correlation'))


def test_cells_without_a_map_are_unlike_paint():
    run = noisy_run()
    axes = map_figure(run, tabulate_errors(run.estimates, run.truth)).axes[0]
    red, green, blue, _ = axes.images[0].cmap.get_bad()
    assert blue > red + 0.1
    assert blue > green + 0.1


def test_all_frames_are_listed_and_filtered_by_status_without_a_script():
    text, page = page_of(noisy_run(withheld=3))
    assert text.count('<tr class="LOST">') == 3
    assert text.count('<tr class="TRACKING">') == 57
    assert 'section:has(#status-LOST:not(:checked)) tr.LOST { display: none; }' in text
    assert 'no match' in page.cells


def test_the_table_of_a_long_drive_ends_and_says_so(monkeypatch):
    monkeypatch.setattr(report_frames, 'MOST_ROWS', 10)
    text, _ = page_of(noisy_run())
    assert text.count('<tr class="TRACKING">') == 10
    assert 'The first 10 of 60' in text


def test_circles_of_the_error_chart_lead_to_the_pictures_of_the_frame():
    run = noisy_run()
    text, _ = page_of(run)
    name = f'frame-{run.exhibits[0].stamp_ns}'
    assert text.count(f'<a xlink:href="#{name}"') == 3  # along, across, yaw
    assert text.count(f'<h3 id="{name}">') == 1
