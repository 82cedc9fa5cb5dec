# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Every command of the tutorials works, in the order of the page; each status has its advice."""

from __future__ import annotations

import json
from pathlib import Path
import re
import shlex
import shutil
import subprocess
import sys

import cv2
from drive_samples import recorded
import numpy as np
import pytest
import yaml

from gip_localizer.cli import main
from gip_localizer.core.estimate import Status
from gip_localizer.io.bags.bag import Bag
from gip_localizer.io.bags.topics import choose_topics, TopicNames
from gip_localizer.io.bags.truth import read_truth
from gip_localizer.io.cdr import image_of
from gip_localizer.io.images import grey_image
from gip_localizer.io.messages import stamp_ns
from gip_localizer.io.tum_files import write_tum

ROOT = Path(__file__).parents[1]
DOCS = ROOT / 'docs'


def commands() -> list[list[str]]:
    blocks = re.findall(r'```sh\n(.*?)```', (DOCS / 'tutorial.md').read_text(), re.DOTALL)
    return [shlex.split(line)[1:] for block in blocks for line in block.splitlines()
            if line.startswith('gip ')]


@pytest.fixture
def own_drive(drive, tmp_path) -> Path:
    """The folder of the second tutorial, from the images of a simulated drive."""
    folder = tmp_path / 'drive'
    (folder / 'images').mkdir(parents=True)
    stamps = []
    for topic, _, _, raw in recorded(drive):
        if topic == '/image':
            message = image_of(raw, 'Image')
            stamps.append(stamp_ns(message.header))
            cv2.imwrite(str(folder / f'images/{len(stamps) - 1:06d}.png'), grey_image(message))
    (folder / 'times.txt').write_text(''.join(f'{stamp * 1e-9:.9f}\n' for stamp in stamps))
    bag = Bag([drive])
    topics = choose_topics(bag, TopicNames())
    truth, _ = read_truth(bag, topics, 'map')
    write_tum(folder / 'poses.txt', truth)
    [info] = [bag.decode(m) for m in bag.messages([topics.camera_info.name])][:1]
    (folder / 'camera.yaml').write_text(yaml.safe_dump({
        'image_width': int(info.width), 'image_height': int(info.height),
        'distortion_model': str(info.distortion_model),
        'camera_matrix': {'rows': 3, 'cols': 3, 'data': np.asarray(info.k).tolist()},
        'distortion_coefficients': {'rows': 1, 'cols': len(info.d),
                                    'data': np.asarray(info.d).tolist()},
    }))
    return folder


def test_each_command_of_the_tutorials_works(own_drive, tmp_path, monkeypatch):
    shutil.copytree(ROOT / 'bags' / 'demo', tmp_path / 'bags' / 'demo')
    monkeypatch.chdir(tmp_path)
    found = commands()
    assert [words[0] for words in found] == [
        'replay', 'replay', 'import', 'suggest', 'map', 'replay',
    ]
    for words in found:
        assert main(words) == 0, ' '.join(words)
    for name in ('first', 'own'):
        metrics = json.loads((tmp_path / 'results' / name / 'metrics.json').read_text())
        assert metrics['availability'] > 0.95
        assert metrics['wrong_published'] == 0
        assert metrics['rmse_xy_m'] < 0.01
    assert cv2.imread(str(tmp_path / 'view.png')) is not None


def test_troubleshooting_has_advice_for_each_status():
    text = (DOCS / 'troubleshooting.md').read_text()
    for status in Status:
        assert f'\n| {status} |' in text


def test_the_documents_become_a_site(tmp_path):
    pytest.importorskip('mkdocs', reason='mkdocs is the extra `docs`')
    done = subprocess.run(
        [sys.executable, '-m', 'mkdocs', 'build', '--strict', '--quiet', '--config-file',
         str(ROOT / 'mkdocs.yml'), '--site-dir', str(tmp_path / 'site')],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert 'Tutorials' in (tmp_path / 'site' / 'index.html').read_text()
