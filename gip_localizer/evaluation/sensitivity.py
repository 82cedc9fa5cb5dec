# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
What the constants of matching and refinement are worth, run by `make sensitivity`.

Each constant is multiplied by `FACTORS`, and the same frames are matched again: development worlds
of four conditions, which no reported number uses. A constant whose change has no effect is a
matter of robustness or time; one with an effect is at its best value, or the table shows that it
is not.

"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass
import importlib
from pathlib import Path
import sys
from types import ModuleType

import numpy as np
from tqdm import tqdm

from gip_localizer import core
from gip_localizer.core.arrays import Floats, Grey
from gip_localizer.core.pose import Pose2
from gip_localizer.core.threads import use_one_thread
from gip_localizer.evaluation.suites.conditions import CARS, CHANGED, CLEAR, SHADOWS
from gip_localizer.evaluation.suites.single_frame import summary
from gip_localizer.evaluation.suites.trials import Bench, compared, Spread

Value = float | int | tuple['Value', ...]
FACTORS = (0.7, 1.4)
ROOMS = ('refine', 'search')
CONDITIONS = (CLEAR, SHADOWS, CARS, CHANGED)  # those in which the constants matter
SEED, FRAMES = 7401, 3  # of the world, and of each condition
ROOT = Path(core.__file__).parent
PAGE = Path(core.__file__).parents[2] / 'docs' / 'constants.md'


@dataclass(frozen=True)
class Constant:
    """A number in a module, and the comment above it."""

    module: ModuleType
    name: str
    value: Value
    meaning: str


@dataclass(frozen=True, eq=False)
class Scene:
    """Images of one condition, their true poses and their starts."""

    bench: Bench
    frames: list[tuple[Grey, Pose2, Pose2]]


def main() -> int:
    """Write the page."""
    use_one_thread()
    scenes = [_scene(Bench(setup, SEED, {})) for setup in CONDITIONS]
    found = constants()
    usual = _figures(scenes)
    rows = []
    for constant in tqdm(found, unit='constant'):
        changed = []
        for factor in FACTORS:
            setattr(constant.module, constant.name, scaled(constant.value, factor))
            changed.append(_figures(scenes))
            setattr(constant.module, constant.name, constant.value)
        rows.append(_row(constant, changed))
    PAGE.write_text(_page(usual, rows), encoding='utf-8')
    sys.stdout.write(f'wrote {PAGE}\n')
    return 0


def constants() -> list[Constant]:
    """Return the numbers of the rooms in the order of the files."""
    return [
        constant for room in ROOMS for path in sorted((ROOT / room).glob('*.py'))
        for constant in _of_module(path, f'gip_localizer.core.{room}.{path.stem}')
    ]


def _of_module(path: Path, name: str) -> Iterator[Constant]:
    module, text = importlib.import_module(name), path.read_text(encoding='utf-8')
    lines = text.splitlines()
    for node in ast.parse(text).body:
        if not isinstance(node, ast.Assign):
            continue
        targets = node.targets[0].elts if isinstance(node.targets[0], ast.Tuple) else node.targets
        for target in targets:
            if not isinstance(target, ast.Name):
                continue
            value = getattr(module, target.id)
            if target.id.isupper() and is_number(value):
                yield Constant(module, target.id, value, _comment(lines, node.lineno))


def is_number(value: object) -> bool:
    """Return whether a value is a number or a tuple of numbers, and not a flag."""
    if isinstance(value, tuple):
        return bool(value) and all(is_number(part) for part in value)
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _comment(lines: list[str], line: int) -> str:
    """Return the comment in the lines above a line (from 1), or behind it."""
    words: list[str] = []
    for text in reversed(lines[: line - 1]):
        if not text.startswith('#'):
            break
        words.insert(0, text[1:].strip())
    if not words and '#' in lines[line - 1]:
        words = [lines[line - 1].split('#', 1)[1].strip()]
    return ' '.join(words)


def scaled(value: Value, factor: float) -> Value:
    """Return a number or all of a tuple times a factor; integers change by one at least."""
    if isinstance(value, tuple):
        return tuple(scaled(part, factor) for part in value)
    if isinstance(value, int):
        return max(round(value * factor), 1) if round(value * factor) != value else value + 1
    return value * factor


def _scene(bench: Bench) -> Scene:
    return Scene(bench, [bench.scene(index, Spread()) for index in range(FRAMES)])


def _figures(scenes: list[Scene]) -> Floats:
    """Return root mean square error (m), mean NEES and share published."""
    trials = []
    for scene in scenes:
        scene.bench.restart()
        trials += [
            compared(scene.bench.localize(image, start, Spread().covariance), truth)
            for image, truth, start in scene.frames
        ]
    found = summary(trials)
    return np.array([found.rmse_xy, found.nees, found.published / found.frames])


def _row(constant: Constant, changed: list[Floats]) -> str:
    cells = ' | '.join(_cells(figures) for figures in changed)
    name = f'`{constant.module.__name__.removeprefix("gip_localizer.core.")}.{constant.name}`'
    return f'| {name} | {_text(constant.value)} | {constant.meaning} | {cells} |'


def _cells(figures: Floats) -> str:
    return f'{1e3 * figures[0]:.2f} mm, {figures[1]:.2f}, {figures[2]:.0%}'


def _text(value: Value) -> str:
    if isinstance(value, tuple):
        return '(' + ', '.join(_text(part) for part in value) + ')'
    return f'{value:g}'


def _page(usual: Floats, rows: list[str]) -> str:
    low, high = FACTORS
    return '\n'.join([
        '# Constants of matching and refinement', '',
        'Written by `make sensitivity`. Each constant is multiplied by '
        f'{low:g} and {high:g}; then {FRAMES} frames of each of the conditions '
        f'{", ".join(c.name for c in CONDITIONS)} of `gip evaluate` are matched again (world '
        f'{SEED}, which no reported number uses). The columns give the root mean square error of '
        'the position, the mean NEES and the share of published poses; unchanged they are '
        f'{_cells(usual)}.', '',
        f'| constant | value | meaning | times {low:g} | times {high:g} |',
        '| --- | --- | --- | --- | --- |', *rows, '',
    ])


if __name__ == '__main__':
    sys.exit(main())
