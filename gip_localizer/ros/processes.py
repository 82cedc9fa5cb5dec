# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Nodes as child processes that end with their parent, however it ends."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
import contextlib
import ctypes
import os
from pathlib import Path
import signal
import subprocess
import sys
from types import TracebackType

from gip_localizer.errors import GipError
from gip_localizer.parameters.spec import Value

PR_SET_PDEATHSIG = 1
"""Option of prctl(2) that sends a signal when the parent ends: linux/prctl.h."""
PATIENCE = ((signal.SIGINT, 5.0), (signal.SIGTERM, 3.0), (signal.SIGKILL, 5.0))
"""Signals that end a child, in order, and the waiting time (s) after each; chosen."""
Launch = Callable[[str, Sequence[str], Path, Mapping[str, str]], 'subprocess.Popen[bytes]']
"""Starts a node: of its name, its arguments, the file of what it prints, and the environment."""


def launch_interpreter(
    name: str, arguments: Sequence[str], log: Path, environment: Mapping[str, str]
) -> subprocess.Popen[bytes]:
    """Start a node in an interpreter of its own."""
    with log.open('wb') as out:
        return subprocess.Popen(
            [sys.executable, '-m', f'gip_localizer.ros.{name}_node', *arguments],
            stdin=subprocess.DEVNULL, stdout=out, stderr=subprocess.STDOUT,
            env=dict(environment), start_new_session=True, preexec_fn=_die_with_parent(),
        )  # fmt: skip


class NodeProcesses:
    """
    A set of nodes of this package, each in a process and a process group of its own.

    Use as a context manager: on leaving, all of them have ended.

    Parameters
    ----------
    logs : Path
        Folder for what the nodes print, `NAME.log`.
    environment : mapping
        Environment variables to add to the inherited ones.
    launch : callable
        Starts a process that leads a group; what it returns has the methods of `Popen`.

    """

    def __init__(
        self, logs: Path, environment: Mapping[str, str], launch: Launch = launch_interpreter
    ) -> None:
        self._logs = logs
        self._launch = launch
        self._environment = {**os.environ, 'PYTHONUNBUFFERED': '1', **environment}
        self._running: dict[str, subprocess.Popen[bytes]] = {}

    def __enter__(self) -> NodeProcesses:
        """Return the set, still empty."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End every child, even when Ctrl-C is pressed again meanwhile."""
        with _deaf_to_ctrl_c():
            self.end(*self._running)

    def start(
        self, name: str, parameters: Mapping[str, Value], remappings: Sequence[str] = ()
    ) -> subprocess.Popen[bytes]:
        """
        Start a node.

        Parameters
        ----------
        name : str
            Of the executable: localizer, synthetic_camera or bag_player.
        parameters : mapping
            Dotted name to value, in their own types.
        remappings : sequence of str
            As in `pose:=/estimate`.

        Returns
        -------
        subprocess.Popen
            The process; `end` ends it.

        """
        arguments = ['--ros-args']
        for key, value in parameters.items():
            arguments += ['-p', f'{key}:={_yaml(value)}']
        for remapping in remappings:
            arguments += ['-r', remapping]
        process = self._launch(name, arguments, self._logs / f'{name}.log', self._environment)
        self._running[name] = process
        return process

    def check(self) -> None:
        """
        Make sure that all of them still run.

        Raises
        ------
        GipError
            One has ended; the message holds its last words.

        """
        for name, process in self._running.items():
            code = process.poll()
            if code is not None:
                raise GipError(f'{name} ended with code {code}: {self.last_words(name)}')

    def last_words(self, name: str) -> str:
        """Return the last lines that a node printed."""
        text = (self._logs / f'{name}.log').read_text(encoding='utf-8', errors='replace')
        return '\n'.join(text.splitlines()[-15:]) or '(it printed nothing)'

    def end(self, *names: str) -> None:
        """End some of the children, with their process groups, by the signals of `PATIENCE`."""
        ending = [self._running.pop(name) for name in names]
        for ask, seconds in PATIENCE:
            for process in ending:
                if process.poll() is None:
                    _signal_group(process.pid, ask)
            for process in ending:
                with contextlib.suppress(subprocess.TimeoutExpired):
                    process.wait(seconds)


@contextlib.contextmanager
def _deaf_to_ctrl_c() -> Iterator[None]:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _signal_group(leader: int, number: int) -> None:
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(leader, number)


def _yaml(value: Value) -> str:
    """Return a value as ROS reads it from a command line: floats with a point, text quoted."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return "'" + value.replace("'", "''") + "'"
    text = repr(value)
    # YAML reads 1e-05 as text: a number needs its point.
    return text.replace('e', '.0e') if 'e' in text and '.' not in text else text


def _die_with_parent() -> Callable[[], None] | None:
    """Return what a child calls before it becomes the node, so that the kernel ends it with us."""
    if not sys.platform.startswith('linux'):
        return None
    libc = ctypes.CDLL(None)
    parent = os.getpid()

    def arrange() -> None:
        libc.prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:
            os._exit(1)

    return arrange
