# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
A thread for work that takes seconds, so that the executor stays responsive.

It is used only for such work, because a frame takes longer outside the executor's thread.

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
    Does one piece of work at a time; tasks that use the same data wait for its end.

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
        """Whether work is in progress, or its result has not been processed."""
        return self._then is not None

    def start(self, work: Callable[[], Out], then: Callable[[Out], None]) -> None:
        """Start work in a thread; `then` processes its result in the executor's thread."""
        self._then = then
        threading.Thread(target=self._work, args=(work,)).start()

    def when_free(self, task: Task, *, instead_of: str = '') -> None:
        """
        Do a task now, or after the current work; of tasks with one name only the last is done.

        Tasks without a name are done first, so that an image is processed after other inputs.

        """
        if not self.busy:
            task()
        elif instead_of:
            self._last[instead_of] = task
        else:
            self._waiting.append(task)

    def close(self) -> None:
        """Process no more results."""
        self._then = None
        self._waiting.clear()
        self._last.clear()
        self._node.destroy_guard_condition(self._woken)

    def _work(self, work: Callable[[], Out]) -> None:
        try:
            out = work()
        except BaseException as error:  # raised when the result is processed
            caught = error

            def fail() -> Out:
                raise caught

            self._done.append(fail)
        else:
            self._done.append(lambda: out)
        with contextlib.suppress(InvalidHandle):  # the node was destroyed
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
