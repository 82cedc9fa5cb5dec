# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""YAML files that others wrote, read with bounds on their size and on what aliases expand to."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from gip_localizer.errors import GipError, shortened

MOST_BYTES = 1 << 19
"""Of a file, bytes: 300 times the node's parameters; PyYAML reads it in about 4 s."""
MOST_EXPANDED = 2 * MOST_BYTES
"""Characters and values of a document with all its aliases expanded: a file without aliases may
be of any size up to `MOST_BYTES`."""


SEPARATOR = '---'
"""Between two documents; `ros2 topic echo` writes one after the last document too."""


class YamlFileError(GipError):
    """A YAML file cannot be read; the message is one bounded line without the file's name."""


def user_path(path: Path | str) -> Path:
    """Return the path with `~` as the user's home; as it is where there is no such home."""
    try:
        return Path(path).expanduser()
    except RuntimeError:
        return Path(path)


def read_yaml(path: Path | str) -> Any:
    """
    Read the one document of a YAML file.

    Raises
    ------
    FileNotFoundError
        There is no such file.
    YamlFileError
        Unreadable, too large, no YAML, or aliases that expand to more than `MOST_EXPANDED`.

    """
    try:
        with Path(path).open('rb') as stream:
            content = stream.read(MOST_BYTES + 1)
    except FileNotFoundError:
        raise
    except OSError as error:
        raise YamlFileError(f'cannot be read: {error.strerror}') from None
    if len(content) > MOST_BYTES:
        raise YamlFileError(f'is larger than {MOST_BYTES} bytes; check that it is the YAML file')
    try:
        text = content.decode('utf-8-sig')
    except UnicodeDecodeError as error:
        raise YamlFileError(f'cannot be read as text: {error.reason}') from None
    return parse_yaml(text)


def parse_yaml(text: str) -> Any:
    """Return the one document of a text, within the bounds of a file (raises YamlFileError)."""
    if len(text) > MOST_BYTES:
        raise YamlFileError(f'is larger than {MOST_BYTES} characters')
    try:
        return _document(text)
    except RecursionError:
        raise YamlFileError('not valid YAML: nested too deep') from None
    except (yaml.YAMLError, ValueError) as error:
        raise YamlFileError(f'not valid YAML: {shortened(str(error))}') from None


def _document(text: str) -> Any:
    loader = yaml.SafeLoader(text.rstrip().removesuffix(f'\n{SEPARATOR}'))
    try:
        node = loader.get_single_node()
        if node is None:
            return None
        _check_expanded(node)
        return loader.construct_document(node)
    finally:
        loader.dispose()


def _check_expanded(root: yaml.Node) -> None:
    """Refuse a document whose aliases expand to too much, or into themselves."""
    sizes: dict[int, int] = {}

    def size(node: yaml.Node) -> int:
        known = sizes.get(id(node))
        if known is not None:
            return known
        sizes[id(node)] = MOST_EXPANDED  # for an alias that refers to what holds it
        own = len(node.value) if isinstance(node, yaml.ScalarNode) else 0
        total = 1 + own + sum(size(child) for child in _children(node))
        if total > MOST_EXPANDED:
            raise YamlFileError(
                f'its aliases expand to more than {MOST_EXPANDED} characters; expected plain '
                'values'
            )
        sizes[id(node)] = total
        return total

    size(root)


def _children(node: yaml.Node) -> list[yaml.Node]:
    if isinstance(node, yaml.MappingNode):
        return [part for pair in node.value for part in pair]
    return node.value if isinstance(node, yaml.SequenceNode) else []
