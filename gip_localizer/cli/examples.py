# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Examples at the end of `gip VERB --help`, for the verbs that have no text of their own there."""

from __future__ import annotations

import argparse

EXAMPLES = {
    'demo': """examples:
  gip demo                                 a rendered road, 20 s at 5 images per second
  gip demo --world tiles --seconds 10      the paper's tiles
  gip demo --world road.yaml --out demo    your own map

The results folder holds report.html, metrics.json and frames.csv.
""",
    'simulate': """examples:
  gip simulate --out bag                                  a clear day
  gip simulate --scenario occlusion --seed 3 --out bag    cars hide parts of the road
  gip simulate --set camera.z=0.35 --set camera.pitch=0.5 --seconds 60 --out bag
  gip replay bag                                          localize it

scenarios: clear, night, distorted, rain-noise, glare, shadows, occlusion, changed, pitch-bumps,
  crown, grade, bank, real-road, relaid, tone, rolling-shutter, nadir, tiles-low-snr
""",
    'replay': """examples:
  gip replay bags/demo                                    map and parameters of the bag's folder
  gip replay drive --map road.yaml --params my.yaml --initial-pose 12.5,3.0,1.57
  gip replay drive --map road.yaml --relocalize           without a start: search the map
  gip replay drive --initial-pose truth --start 30 --duration 60
  gip replay bags/demo --set integrity.min_confidence=0.99 --out strict
""",
    'compare': """examples:
  gip compare results/replay results/strict               figures, changed parameters, one chart

Each RUN is a results folder of gip replay or gip demo.
""",
    'check-calibration': """examples:
  gip check-calibration drive --set camera.z=1.5 --set camera.pitch=0.26
  gip check-calibration drive --params my.yaml --out road.png
""",
    'evaluate': """examples:
  gip evaluate                                            all suites, below ten minutes
  gip evaluate --suite conditions --frames 100 --seed 7
  gip evaluate --suite integrity --set integrity.min_confidence=0.95
""",
    'paper': """examples:
  gip paper                                               its curves, exactly and by sampling
  gip paper --full                                        also on rendered images
""",
    'params': """examples:
  gip params > localizer.yaml                             every parameter of the node
  gip params --node bag_player --markdown
  gip params --write .                                    config/ and the generated pages of docs/
""",
    'bench': """examples:
  gip bench --suite track --quick                         a rough result in a minute
  gip bench                                               everything; stop other programs
""",
}
"""Verb → text, as it is printed."""


class ExamplesFormatter(argparse.HelpFormatter):
    """Wraps descriptions, and prints examples as they are."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        if text.startswith('examples:'):
            return text
        return super()._fill_text(text, width, indent)


def add_examples(verbs: dict[str, argparse.ArgumentParser]) -> None:
    """Add `EXAMPLES` to the parsers of the verbs."""
    for name, text in EXAMPLES.items():
        verbs[name].epilog = text
        verbs[name].formatter_class = ExamplesFormatter
