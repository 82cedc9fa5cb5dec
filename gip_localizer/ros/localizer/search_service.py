# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""`~/relocalize_and_wait`: a search of the whole map whose answer is its outcome."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from std_srvs.srv import Trigger

from gip_localizer.core.estimate import Estimate
from gip_localizer.session.relocalization import Outcome, Relocalization


class SearchService:
    """
    Answers when the outcome is known, without blocking the executor.

    rclpy sends the return value of a callback. A coroutine could wait, but keeps the executor of
    Jazzy busy until it ends; so the answer is sent later instead.

    Parameters
    ----------
    node : Node
        Serves.
    refusal : callable
        Returns why no search is possible now; empty if it is.
    request : callable
        Requests the search, and calls its argument when no frame is being processed.

    """

    def __init__(
        self, node: Node, refusal: Callable[[], str],
        request: Callable[[Callable[[], None]], None],
    ) -> None:
        self._refusal, self._request = refusal, request
        self._relocalization = Relocalization()
        self._begun = False
        self._waiting: list[tuple[Trigger.Response, Any]] = []
        service = node.create_service(Trigger, '~/relocalize_and_wait', self._take)
        self._send = service.send_response
        service.send_response = self._hold

    def take(self, estimate: Estimate) -> None:
        """Answer if a frame decides the search."""
        if self._begun:
            self._answer(self._relocalization.outcome(estimate))

    def look(self) -> None:
        """Answer if the search was not decided in time."""
        if self._begun:
            self._answer(self._relocalization.overdue())

    def _take(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.message = self._refusal()
        if not response.message:
            self._request(self._begin)
        return response

    def _begin(self) -> None:
        self._relocalization.begin()
        self._begun = True

    def _hold(self, response: Trigger.Response, header: Any) -> None:
        if response.message:
            self._send(response, header)
        else:
            self._waiting.append((response, header))

    def _answer(self, outcome: Outcome | None) -> None:
        if outcome is None:
            return
        self._begun = False
        waiting, self._waiting = self._waiting, []
        for response, header in waiting:
            response.success, response.message = outcome
            self._send(response, header)
