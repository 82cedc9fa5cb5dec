# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Effect of each constant of search and refinement on the errors, run by `make sensitivity`.

Each constant is multiplied by each of `FACTORS`, and the same frames are localized again. They are
of development worlds, which no reported number uses. A constant without an effect on them serves
robustness or speed; the effect of the others shows whether their value is well chosen.

"""

from __future__ import annotations

import argparse
import ast
from collections.abc import Iterator
from dataclasses import dataclass
import importlib
from pathlib import Path
import sys
from types import ModuleType

from tqdm import tqdm

from gip_localizer import core
from gip_localizer.core.arrays import Grey
from gip_localizer.core.pose import Pose2
from gip_localizer.core.threads import use_one_thread
from gip_localizer.evaluation.suites.conditions import CARS, CHANGED, CLEAR, SHADOWS
from gip_localizer.evaluation.suites.single_frame import summary
from gip_localizer.evaluation.suites.trials import Bench, compared, Spread

Value = float | int | tuple['Value', ...]
FACTORS = (0.7, 1.4)
"""Factors (no unit) of the constants; chosen: a change that a wrong choice could make."""
FOLDERS = ('refine', 'search')
"""Folders of `core` whose constants are changed."""
CONDITIONS = (CLEAR, SHADOWS, CARS, CHANGED)
"""Conditions of the frames; chosen: a correct model, and three kinds of differences from it."""
SEED = 7401
"""Seed (no unit) of worlds and frames; chosen: no reported number uses it."""
FRAMES = 2
"""Number of frames of each condition; chosen: all constants then take ten minutes."""
WHOLE_MAP = ('global_search', 'whole_map', 'expected_fit')
"""Modules of searches that frames with an initial pose do not start."""
GIVEN = ('GEOMETRY', 'OPTICAL_TERMS', 'CHI_SQ_MEDIAN', 'TRIMMED_CHI_SQ')
"""Constants that follow from equations: numbers of unknowns, and quantiles."""
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
class ConditionFrames:
    """Images of one condition, their true poses and their starts."""

    bench: Bench
    frames: list[tuple[Grey, Pose2, Pose2]]


@dataclass(frozen=True)
class Figures:
    """Errors of the frames of all conditions."""

    rmse_xy: float
    nees: float
    published: float
    faults: int

    def __str__(self) -> str:
        """Return the figures as they are in the table."""
        if self.faults:
            return 'exception'
        if not self.published:
            return 'no pose'
        return f'{1e3 * self.rmse_xy:.2f} mm, {self.nees:.2f}, {self.published:.0%}'


def main(arguments: list[str] | None = None) -> int:
    """Write the page."""
    _parser().parse_args(arguments)
    use_one_thread()
    scenes = [_scene(Bench(setup, SEED, {})) for setup in CONDITIONS]
    usual = _figures(scenes)
    rows = [
        (constant, [_figures_with(constant, factor, scenes) for factor in FACTORS])
        for constant in tqdm(constants(), unit='constant')
    ]
    PAGE.write_text(_page(usual, rows), encoding='utf-8')
    sys.stdout.write(f'wrote {PAGE}\n')
    return 0


def _parser() -> argparse.ArgumentParser:
    return argparse.ArgumentParser(
        prog='make sensitivity',
        description=f'Multiply each constant of core/{" and core/".join(FOLDERS)} by '
        f'{FACTORS[0]:g} and {FACTORS[1]:g}, localize the same frames again, and write the '
        'errors to docs/constants.md. It takes ten minutes on one core.',
    )


def constants() -> list[Constant]:
    """Return the constants that are changed, in the order of the files."""
    return [
        constant for folder in FOLDERS for path in sorted((ROOT / folder).glob('*.py'))
        if path.stem not in WHOLE_MAP
        for constant in _of_module(path, f'gip_localizer.core.{folder}.{path.stem}')
        if constant.name not in GIVEN
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


def _scene(bench: Bench) -> ConditionFrames:
    return ConditionFrames(bench, [bench.scene(index, Spread()) for index in range(FRAMES)])


def _figures(scenes: list[ConditionFrames]) -> Figures:
    trials = []
    for scene in scenes:
        scene.bench.renew()
        trials += [
            compared(scene.bench.localize(image, start, Spread().covariance), truth)
            for image, truth, start in scene.frames
        ]
    found = summary(trials)
    return Figures(
        found.rmse_xy, found.nees, found.published / found.frames,
        sum(trial.faulty for trial in trials),
    )


def _figures_with(constant: Constant, factor: float, scenes: list[ConditionFrames]) -> Figures:
    """Return the figures with a constant times a factor, in all modules that import it."""
    modules = [
        module for name, module in sorted(sys.modules.items())
        if name.startswith(core.__name__)
        and getattr(module, constant.name, None) is constant.value
    ]
    for module in modules:
        setattr(module, constant.name, scaled(constant.value, factor))
    try:
        return _figures(scenes)
    finally:
        for module in modules:
            setattr(module, constant.name, constant.value)


def _page(usual: Figures, rows: list[tuple[Constant, list[Figures]]]) -> str:
    low, high = FACTORS
    return '\n'.join([
        '# Effect of the constants of search and refinement', '',
        'Written by `make sensitivity`. Each constant is multiplied by '
        f'{low:g} and {high:g}; then the same frames are localized again: {FRAMES} of each of the '
        f'conditions {", ".join(c.name for c in CONDITIONS)} of `gip evaluate` (seed {SEED}, '
        'which no reported number uses). The columns give the root mean square error of the '
        'position, the mean NEES and the share of published poses. Without a change they are '
        f'{usual}.', '',
        'These frames show which constants matter; they are too few to choose values by. Where '
        'more poses are published than without a change, the error includes a frame that is '
        'otherwise withheld. "same": no figure changes. "no pose": every frame is withheld. '
        '"exception": the value is invalid, and a frame ended with the status FAULT. '
        'Constants of the search of the whole map '
        f'({", ".join(f"`{name}`" for name in WHOLE_MAP)}) and those that follow from equations '
        f'({", ".join(f"`{name}`" for name in GIVEN)}) are not changed.', '',
        f'{len(rows)} constants; for {sum(_without_effect(row, usual) for row in rows)} of them '
        'both changes leave all figures as they are: they serve robustness and speed.', '',
        f'| constant | value | meaning | times {low:g} | times {high:g} |',
        '| --- | --- | --- | --- | --- |', *(_row(*row, usual) for row in rows), '',
    ])


def _without_effect(row: tuple[Constant, list[Figures]], usual: Figures) -> bool:
    return all(str(changed) == str(usual) for changed in row[1])


def _row(constant: Constant, changed: list[Figures], usual: Figures) -> str:
    cells = ' | '.join('same' if str(f) == str(usual) else str(f) for f in changed)
    name = f'`{constant.module.__name__.removeprefix("gip_localizer.core.")}.{constant.name}`'
    meaning = constant.meaning.replace('|', '\\|')
    return f'| {name} | {_text(constant.value)} | {meaning} | {cells} |'


def _text(value: Value) -> str:
    if isinstance(value, tuple):
        return '(' + ', '.join(_text(part) for part in value) + ')'
    return f'{value:g}'


if __name__ == '__main__':
    sys.exit(main())
