# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
A tree of parameters as parameters of a node: declared once, judged whole, swapped whole.

A change is judged by rebuilding the whole tree, so that a refusal names its reason; only then
is the tree replaced, between two frames, so that no half-applied state exists.

"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
import difflib
import sys
from typing import Generic, TypeVar

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.parameter import Parameter

from gip_localizer.errors import GipError, ParameterError
from gip_localizer.parameters.spec import ParameterGroup, Spec

Tree = TypeVar('Tree', bound=ParameterGroup)
LARGEST_INTEGER = 2**53
"""Largest integer that a double represents exactly, with all smaller ones: IEEE 754."""
OF_THE_PROCESS = ('lifecycle',)
"""Read-only in every state: the kind of the node follows from it."""
QOS = 'qos_overrides.'
"""Declared when the topics are made."""


class LiveParameters(Generic[Tree]):
    """
    The parameters of a node as one object that is always whole.

    Parameters
    ----------
    node : Node
        Declares the parameters and takes changes to them.
    kind : type of ParameterGroup
        The tree; its specs give types, ranges, units and meanings.
    on_change : callable or None
        Called with the new tree after a change was taken.
    check : callable or None
        Called with the new tree before it is taken; raises GipError to refuse it.
    fixed : callable or None
        Whether read-only parameters are in use now; None: always. A managed node that could not
        be configured is repaired by setting them.

    Raises
    ------
    ParameterError
        A value given at start is of the wrong type, out of range or refused by the whole.

    """

    def __init__(
        self, node: Node, kind: type[Tree], on_change: Callable[[Tree], None] | None = None,
        fixed: Callable[[], bool] | None = None,
        check: Callable[[Tree], None] | None = None,
    ) -> None:
        self._on_change, self._fixed, self._check = on_change, fixed, check
        self._log = node.get_logger().info
        self._names = frozenset(spec.name for spec in kind.specs())
        self._settled = frozenset(spec.name for spec in kind.specs() if spec.read_only)
        specs = kind.specs() if fixed is None else [
            replace(spec, read_only=spec.name in OF_THE_PROCESS) for spec in kind.specs()
        ]
        self.value: Tree = kind.from_dict({spec.name: _declare(node, spec) for spec in specs})
        _warn_of_unknown_names(node, self._names)
        node.add_on_set_parameters_callback(self._judge)
        node.add_post_set_parameters_callback(self._swap)

    def _judge(self, changes: Sequence[Parameter]) -> SetParametersResult:
        before, ours = self.value.to_dict(), self._ours(changes)
        if self._fixed is not None and self._fixed():
            for name in self._settled.intersection(ours):
                if ours[name] != before[name]:
                    return SetParametersResult(successful=False, reason=(
                        f'parameter {name}: cannot change while the node is configured; '
                        'clean it up first'
                    ))  # fmt: skip
        try:
            changed = self.value.replace(ours)
            if self._check is not None and ours:
                self._check(changed)
        except GipError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _swap(self, changes: Sequence[Parameter]) -> None:
        ours = self._ours(changes)
        if not ours:
            return
        before = self.value.to_dict()
        self.value = self.value.replace(ours)
        for name, value in self.value.to_dict().items():
            if value != before[name]:
                self._log(f'parameter {name}: {before[name]} -> {value}')
        if self._on_change is not None:
            self._on_change(self.value)

    def _ours(self, changes: Sequence[Parameter]) -> dict[str, object]:
        return {change.name: change.value for change in changes if change.name in self._names}


def descriptor(spec: Spec) -> ParameterDescriptor:
    """Return the description of a parameter for `ros2 param describe`."""
    unit = f' [{spec.unit}]' if spec.unit else ''
    described = ParameterDescriptor(
        description=f'{spec.description}{unit}',
        additional_constraints=spec.allowed(),
        read_only=spec.read_only,
    )
    bounded = spec.low is not None or spec.high is not None
    if bounded and spec.type is float:
        low = -sys.float_info.max if spec.low is None else spec.low
        high = sys.float_info.max if spec.high is None else spec.high
        described.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
    elif bounded and spec.type is int:
        low = -LARGEST_INTEGER if spec.low is None else int(spec.low)
        high = LARGEST_INTEGER if spec.high is None else int(spec.high)
        described.integer_range = [IntegerRange(from_value=low, to_value=high, step=1)]
    return described


def _declare(node: Node, spec: Spec) -> object:
    """Declare one parameter; a value given at start is judged in this package's words."""
    given = given_at_start(node).get(spec.name)
    default = spec.default if given is None else spec.checked(given.value)
    try:
        return node.declare_parameter(
            spec.name, default, descriptor(spec), ignore_override=given is not None
        ).value
    except ParameterException as error:
        raise ParameterError(
            f'parameter {spec.name}: expected {spec.allowed()}; {error}'
        ) from None


def given_at_start(node: Node) -> Mapping[str, Parameter]:
    """Return what the command line and parameter files set; rclpy has no public word for it."""
    given: Mapping[str, Parameter] = getattr(node, '_parameter_overrides', {})
    return given


def _warn_of_unknown_names(node: Node, names: frozenset[str]) -> None:
    """Warn of a misspelt name, which rclpy would ignore."""
    for name in given_at_start(node):
        known = name in names or node.has_parameter(name) or name.startswith(QOS)
        if not known:
            _warn_of(node, name, names)


def warn_of_unknown_qos(node: Node) -> None:
    """Warn of QoS overrides for topics that the node does not have."""
    known = {f'{QOS}{rest}' for rest in node.get_parameters_by_prefix(QOS.rstrip('.'))}
    for name in given_at_start(node):
        if name.startswith(QOS) and name not in known:
            _warn_of(node, name, known)


def _warn_of(node: Node, name: str, known: Iterable[str]) -> None:
    close = difflib.get_close_matches(name, known, n=1)
    guess = f'; did you mean {close[0]}?' if close else ''
    node.get_logger().warning(f'parameter {name} is unknown and ignored{guess}')
