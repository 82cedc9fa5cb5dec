# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The pages for readers: links lead somewhere, names exist."""

from pathlib import Path
import re

import pytest

from gip_localizer.visualization.overview_figure import overview_figure

ROOT = Path(__file__).parents[1]
PAGES = ['README.md', 'CONTRIBUTING.md', 'bags/README.md', *(
    str(path.relative_to(ROOT)) for path in sorted((ROOT / 'docs').glob('*.md')))]
LARGEST_FIGURE = 300_000


@pytest.mark.parametrize('page', PAGES)
def test_links_to_files_lead_somewhere(page):
    path = ROOT / page
    for target in re.findall(r'\]\(([^)#]+)\)', path.read_text()):
        if '://' not in target:
            assert (path.parent / target).exists(), target


def test_each_link_within_the_readme_meets_a_heading():
    text = (ROOT / 'README.md').read_text()
    headings = {line.lstrip('# ').lower().replace(' ', '-') for line in text.splitlines()
                if line.startswith('#')}
    assert {target for target in re.findall(r'\]\(#([^)]+)\)', text)} <= headings


def test_figures_are_small():
    for figure in (ROOT / 'docs' / 'figures').iterdir():
        assert figure.stat().st_size < LARGEST_FIGURE, figure


def test_make_verbs_that_pages_name_exist():
    makefile = (ROOT / 'Makefile').read_text()
    for page in PAGES:
        for verb in re.findall(r'`make ([a-z-]+)', (ROOT / page).read_text()):
            assert f'\n{verb}:' in makefile, f'{page}: make {verb}'


def test_the_picture_of_the_readme_can_be_drawn_again(tmp_path):
    figure = overview_figure(ROOT / 'bags' / 'demo')
    titles = [axes.get_title() for axes in figure.axes]
    # 12 frames into the bag the vehicle is where its ground truth says: x = 35 m, y = 6.25 m.
    assert any('(35.00' in title and '6.25' in title for title in titles), titles
