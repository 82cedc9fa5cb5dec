# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""`--set NAME=VALUE`, files beside a bag, what Ctrl-C may interrupt: shared by the verbs."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
import signal
import threading

from gip_localizer.errors import ParameterError
from gip_localizer.parameters import load_parameter_file, Parameters
from gip_localizer.parameters.spec import ParameterGroup


def parse_settings(words: Sequence[str], tree: type[ParameterGroup]) -> dict[str, object]:
    """
    Return NAME=VALUE words as values of each parameter's type.

    Raises
    ------
    ParameterError
        A word without `=`. Unknown names and bad values are refused by the tree itself.

    """
    types = {spec.name: spec.type for spec in tree.specs()}
    changes: dict[str, object] = {}
    for word in words:
        name, equals, text = word.partition('=')
        if not equals:
            raise ParameterError(f'--set {word}: expected NAME=VALUE, e.g. search.x=1.0')
        changes[name.strip()] = _value(text.strip(), types.get(name.strip(), str))
    return changes


def _value(text: str, kind: type) -> object:
    """Return the text as the type; as it is where it cannot be (refused with its range later)."""
    if kind is bool:
        return {'true': True, 'false': False}.get(text.lower(), text)
    if kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            return text
    return text


def beside(bag: Sequence[Path], name: str) -> Path | None:
    """Return a file that `gip simulate` puts beside its bag, if it is there."""
    folder = bag[0] if bag[0].is_dir() else bag[0].parent
    path = folder / name
    return path if path.is_file() else None


def recorded_parameters(
    args: argparse.Namespace, changes: Mapping[str, object] | None = None
) -> Parameters:
    """Return what `--params` (or the file beside `bag`), `changes`, each `--set` say, in turn."""
    path = args.params or beside(args.bag, 'params.yaml')
    parameters = load_parameter_file(path) if path else Parameters()
    parameters = parameters.replace(changes or {})
    return parameters.replace(parse_settings(args.settings, Parameters))


@contextmanager
def ctrl_c(*, heard: bool) -> Iterator[None]:
    """Let Ctrl-C interrupt (even where a shell's & made the process deaf to it), or wait."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    answer = signal.default_int_handler if heard else signal.SIG_IGN
    before = signal.signal(signal.SIGINT, answer)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
