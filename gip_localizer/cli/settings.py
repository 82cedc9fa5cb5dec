# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Shared by the verbs: `--set NAME=VALUE`, files next to a bag, and handling of Ctrl-C."""

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

NODE_ONLY = (
    'image_reliability', 'lifecycle', 'autostart_node', 'bond_heartbeat_period', 'state_file',
    'tf.publish',
)
"""Parameters that change what the node does and mean nothing for a bag."""


def parse_settings(words: Sequence[str], tree: type[ParameterGroup]) -> dict[str, object]:
    """
    Return NAME=VALUE words as values of each parameter's type.

    Raises
    ------
    ParameterError
        A word has no `=`. Unknown names and values outside their range are refused later.

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
    """Return the text as the type, or unchanged if that is impossible (refused later)."""
    if kind is bool:
        return {'true': True, 'false': False}.get(text.lower(), text)
    if kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            return text
    return text


def file_next_to(bag: Sequence[Path], name: str) -> Path | None:
    """Return the file of this name in the folder of the bag, or None if there is none."""
    folder = bag[0] if bag[0].is_dir() else bag[0].parent
    path = folder / name
    return path if path.is_file() else None


def recorded_parameters(
    args: argparse.Namespace, changes: Mapping[str, object] | None = None
) -> Parameters:
    """Return the parameters of `--params` (or next to the bag), then `changes`, then `--set`."""
    path = args.params or file_next_to(args.bag, 'params.yaml')
    parameters = load_parameter_file(path) if path else Parameters()
    parameters = parameters.replace(changes or {})
    return parameters.replace(parse_settings(args.settings, Parameters))


def unused_at_the_desk(parameters: Parameters, also: Sequence[str] = ()) -> list[str]:
    """
    Return what is to be said of parameters that are set and that a verb does not use.

    Parameters
    ----------
    parameters : Parameters
        As given.
    also : sequence of str
        Names beyond those of `NODE_ONLY`.

    """
    defaults, given = Parameters().to_dict(), parameters.to_dict()
    unused = [name for name in (*NODE_ONLY, *also) if given[name] != defaults[name]]
    return [f'not used here, only by the node: {", ".join(unused)}'] if unused else []


def without_masks(parameters: Parameters) -> Parameters:
    """Return the parameters of a verb that reads no mask topic (raises ParameterError)."""
    if parameters.mask.from_topic:
        raise ParameterError(
            'parameter mask.from_topic: is true, and this verb reads no masks from a topic; '
            'expected false: --set mask.from_topic=false, and mask_file for the own vehicle'
        )
    return parameters


@contextmanager
def ctrl_c(*, interrupts: bool) -> Iterator[None]:
    """Let Ctrl-C interrupt (even if a shell's `&` disabled it), or ignore it meanwhile."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    answer = signal.default_int_handler if interrupts else signal.SIG_IGN
    before = signal.signal(signal.SIGINT, answer)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
