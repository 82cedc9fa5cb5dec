# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
A thread for work that takes seconds, so that the executor goes on answering.

Only for such work: a frame in another thread than the executor's takes longer.

"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
import contextlib
import threading
from typing import Generic, TypeVar

from rclpy.exceptions import InvalidHandle
from rclpy.node import Node

Out = TypeVar('Out')
Task = Callable[[], None]


class Worker(Generic[Out]):
    """
    Does one piece of work at a time; what touches the same things waits for its end.

    Parameters
    ----------
    node : Node
        Its executor is woken when work is done.

    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._woken = node.create_guard_condition(self._take_up)
        self._done: deque[Callable[[], Out]] = deque()
        self._then: Callable[[Out], None] | None = None
        self._waiting: deque[Task] = deque()
        self._last: dict[str, Task] = {}

    @property
    def busy(self) -> bool:
        """Whether work is being done, or its outcome has not been taken up."""
        return self._then is not None

    def start(self, work: Callable[[], Out], then: Callable[[Out], None]) -> None:
        """Work in a thread; `then` takes what comes out, in the executor's."""
        self._then = then
        threading.Thread(target=self._work, args=(work,)).start()

    def when_free(self, task: Task, *, instead_of: str = '') -> None:
        """
        Do a task now, or after the work; of those that are named alike only the last.

        Those without a name come first: a waiting image finds all that came before its turn.

        """
        if not self.busy:
            task()
        elif instead_of:
            self._last[instead_of] = task
        else:
            self._waiting.append(task)

    def close(self) -> None:
        """Take up nothing any more."""
        self._then = None
        self._waiting.clear()
        self._last.clear()
        self._node.destroy_guard_condition(self._woken)

    def _work(self, work: Callable[[], Out]) -> None:
        try:
            out = work()
        except BaseException as error:  # raised where it is taken up
            caught = error

            def fail() -> Out:
                raise caught

            self._done.append(fail)
        else:
            self._done.append(lambda: out)
        with contextlib.suppress(InvalidHandle):  # the node is gone
            self._woken.trigger()

    def _take_up(self) -> None:
        if not self._done or self._then is None:
            return
        out, then = self._done.popleft(), self._then
        self._then = None
        then(out())
        while (self._waiting or self._last) and not self.busy:
            self._next()()

    def _next(self) -> Task:
        return self._waiting.popleft() if self._waiting else self._last.popitem()[1]
