# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""How every node of the package starts and ends."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from itertools import takewhile
import signal
import sys
import threading
from types import FrameType

import rclpy
from rclpy.exceptions import NameValidationException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.logging import get_logger
from rclpy.node import Node

from gip_localizer.core.threads import end_work
from gip_localizer.errors import GipError

HELP = """usage: {name} [--ros-args [-p NAME:=VALUE ...] [--params-file FILE] [-r FROM:=TO ...]]

example: {name} --ros-args {example}
all parameters, with defaults and ranges: gip params --node {name} --markdown
"""
STOPS = (signal.SIGINT, signal.SIGTERM)


def run_node(
    make: Callable[[], Node], name: str, args: Sequence[str] | None = None, *, example: str = ''
) -> int:
    """
    Spin a node until Ctrl-C, SIGTERM or the shutdown of its context, or answer `--help`.

    Parameters
    ----------
    make : callable
        Builds the node; may raise GipError.
    name : str
        Name of the logger for what happens before the node exists.
    args : sequence of str or None
        Command line; None: that of the process.
    example : str
        Parameters of a start that works, which the help shows.

    Returns
    -------
    int
        Exit code: 0 after an orderly end, 1 after an error that the user can mend.

    """
    words = list(sys.argv[1:] if args is None else args)
    if {'-h', '--help'}.intersection(takewhile(lambda word: word != '--ros-args', words)):
        sys.stdout.write(HELP.format(name=name, example=example))
        return 0
    stopped = _hear_stops()
    try:
        rclpy.init(args=list(args) if args is not None else None)
    except RuntimeError as error:  # rcl's error: arguments or a parameter file it cannot read
        get_logger(name).fatal(str(error))
        return 1
    except KeyboardInterrupt:
        return 0
    node = None
    try:
        node = make()
        # One thread: a second one, of rclpy's own, keeps the interpreter from the matcher and
        # made a frame three times as slow (measured).
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        executor.spin()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except (GipError, NameValidationException) as error:
        with suppress(KeyboardInterrupt):
            get_logger(name).fatal(str(error))
        return 1
    except RuntimeError:  # a signal amid rcl, which makes an error of its own of it
        if rclpy.ok() and not stopped.is_set():
            raise
    finally:
        _end(node)
    return 0


def _end(node: Node | None) -> None:
    """Leave the graph; from now on no signal matters."""
    end_work()
    if node is not None:
        node.destroy_node()
    rclpy.try_shutdown()
    # Not in the handler: Python complains of signals that are on their way when this is set.
    for number in STOPS:
        signal.signal(number, signal.SIG_IGN)


def _hear_stops() -> threading.Event:
    """
    Let the first signal interrupt what runs, ignore those after it, and report the first.

    rclpy hands signals on to the handlers that it finds. By itself it waits for the frame in
    work at SIGTERM, a search of the whole map perhaps, and takes the topics away from under it.

    """
    stopped = threading.Event()

    def stop(_number: int, _frame: FrameType | None) -> None:
        if not stopped.is_set():
            stopped.set()
            raise KeyboardInterrupt

    for number in STOPS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, stop)
    return stopped
