# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
A parameter is defined once: a dataclass field that carries unit, range and meaning.

`ParameterGroup` turns such dataclasses, nested, into dotted names and back, and judges values.
Both the localizer (`gip_localizer.parameters`) and the synthetic camera declare theirs this way.

"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, is_dataclass, MISSING
import difflib
import math
from numbers import Integral, Real
from typing import Any, ClassVar, TypeVar

from gip_localizer.errors import ParameterError, quoted, shortened

Value = bool | int | float | str
Group = TypeVar('Group', bound='ParameterGroup')


@dataclass(frozen=True)
class Spec:
    """
    What is known of one parameter.

    Attributes
    ----------
    name : str
        Dotted name, as in ROS.
    default : bool, int, float or str
        The default; its Python type is the parameter's type.
    unit : str
        Unit, empty where there is none.
    description : str
        One sentence.
    low, high : float or None
        Inclusive bounds of a number.
    choices : tuple of str
        The allowed words of a string; empty: any.
    read_only : bool
        True: cannot change while the node runs.

    """

    name: str
    default: Value
    unit: str = ''
    description: str = ''
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()
    read_only: bool = False

    @property
    def type(self) -> type:
        """The Python type of the value."""
        return type(self.default)

    def allowed(self) -> str:
        """Return the allowed values in words."""
        if self.choices:
            return 'one of ' + ', '.join(self.choices)
        kind = {bool: 'true or false', int: 'an integer', float: 'a number', str: 'a string'}
        if self.low is None and self.high is None:
            return kind[self.type]
        low = '-inf' if self.low is None else f'{self.low:g}'
        high = 'inf' if self.high is None else f'{self.high:g}'
        return f'{kind[self.type]} from {low} to {high}{" " + self.unit if self.unit else ""}'

    def checked(self, value: object) -> Value:
        """
        Return the value if it may be taken.

        Raises
        ------
        ParameterError
            Wrong type, not finite, out of range or not one of the choices.

        """
        if self.type is float and _is_number(value, Real):
            value = float(value)  # type: ignore[arg-type]
        elif self.type is int and _is_number(value, Integral):
            value = int(value)  # type: ignore[call-overload]
        wrong_type = type(value) is not self.type
        if wrong_type or not self._within(value):
            raise ParameterError(
                f'parameter {self.name}: got {quoted(value)}, expected {self.allowed()}'
            )
        return value  # type: ignore[return-value]

    def _within(self, value: object) -> bool:
        if self.choices:
            return value in self.choices
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            return (
                math.isfinite(value)
                and (self.low is None or value >= self.low)
                and (self.high is None or value <= self.high)
            )
        return True


def _is_number(value: object, kind: type) -> bool:
    """Whether a value is a number (NumPy's too) and no truth value."""
    return isinstance(value, kind) and not isinstance(value, bool)


def parameter(
    default: Value,
    description: str,
    *,
    unit: str = '',
    low: float | None = None,
    high: float | None = None,
    choices: tuple[str, ...] = (),
    read_only: bool = False,
) -> Any:
    """Return a dataclass field that carries its `Spec` (the name is filled in later)."""
    spec = Spec('', default, unit, description, low, high, choices, read_only)
    return field(default=default, metadata={'spec': spec})


def group(kind: type[Any]) -> Any:
    """Return a dataclass field for a nested group of parameters."""
    return field(default_factory=kind)


@dataclass(frozen=True)
class ParameterGroup:
    """Base of a tree of parameters; subclasses are frozen dataclasses of `parameter` fields."""

    _spec_cache: ClassVar[dict[type, tuple[Spec, ...]]] = {}

    @classmethod
    def specs(cls) -> tuple[Spec, ...]:
        """Return every parameter of the tree, in order of declaration."""
        if cls not in ParameterGroup._spec_cache:
            ParameterGroup._spec_cache[cls] = tuple(_walk(cls, ''))
        return ParameterGroup._spec_cache[cls]

    @classmethod
    def from_dict(cls: type[Group], values: Mapping[str, object]) -> Group:
        """
        Build from dotted names; what is not named keeps its default.

        Raises
        ------
        ParameterError
            Unknown name, or a value that its `Spec` or the whole refuses.

        """
        return cls().replace(values)

    def replace(self: Group, values: Mapping[str, object]) -> Group:
        """Return a copy with some values changed, all or none (raises ParameterError)."""
        known = {spec.name: spec for spec in self.specs()}
        for name in values:
            if name not in known:
                raise ParameterError(
                    f'parameter {shortened(name)} is unknown{_nearest(name, known)}'
                )
        merged = self.to_dict()
        merged.update({name: known[name].checked(value) for name, value in values.items()})
        built = _build(type(self), merged, '')
        built.check()
        return built  # type: ignore[no-any-return]

    def to_dict(self) -> dict[str, Value]:
        """Return dotted name → value, in order of declaration."""
        return {spec.name: _look_up(self, spec.name) for spec in self.specs()}

    def check(self) -> None:
        """Judge what spans several fields; raise ParameterError (the base finds no fault)."""


def _walk(cls: type[Any], prefix: str) -> Iterator[Spec]:
    for item in fields(cls):
        spec = item.metadata.get('spec')
        if spec is not None:
            yield Spec(**{**{f.name: getattr(spec, f.name) for f in fields(Spec)},
                          'name': prefix + item.name})
        elif item.default_factory is not MISSING and is_dataclass(item.default_factory):
            yield from _walk(item.default_factory, f'{prefix}{item.name}.')


def _build(cls: type[Any], values: Mapping[str, Value], prefix: str) -> Any:
    arguments: dict[str, Any] = {}
    for item in fields(cls):
        if 'spec' in item.metadata:
            arguments[item.name] = values[prefix + item.name]
        elif item.default_factory is not MISSING and is_dataclass(item.default_factory):
            arguments[item.name] = _build(item.default_factory, values, f'{prefix}{item.name}.')
    return cls(**arguments)


def _look_up(tree: object, dotted: str) -> Value:
    for part in dotted.split('.'):
        tree = getattr(tree, part)
    return tree  # type: ignore[return-value]


def _nearest(name: str, known: Mapping[str, Spec]) -> str:
    close = difflib.get_close_matches(name, known, n=1)
    return f'; did you mean {close[0]}?' if close else ''
