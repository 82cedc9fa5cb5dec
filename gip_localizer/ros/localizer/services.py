# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The services `~/enable`, `~/relocalize` and `~/relocalize_and_wait`."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from gip_localizer.core.estimate import Estimate
from gip_localizer.ros.localizer.search_service import SearchService
from gip_localizer.session.diagnostics import HealthMonitor


class Services:
    """
    Switches the node on and off, and starts searches of the whole map.

    Parameters
    ----------
    node : Node
        Serves.
    health : HealthMonitor
        Knows whether images are localized.
    publish : callable
        Publishes the diagnostics.
    relocalize : callable
        Requests a search from the next frame on, and then calls its argument.

    """

    def __init__(
        self, node: Node, health: HealthMonitor, publish: Callable[[], None],
        relocalize: Callable[[Callable[[], None]], None],
    ) -> None:
        self._health, self._publish, self._relocalize = health, publish, relocalize
        self._log = node.get_logger().info
        node.create_service(SetBool, '~/enable', self._on_enable)
        node.create_service(Trigger, '~/relocalize', self._on_relocalize)
        self._searches = SearchService(node, self._search_refusal, relocalize)

    def take(self, estimate: Estimate) -> None:
        """Answer a waiting client if a frame decides its search."""
        self._searches.take(estimate)

    def look(self) -> None:
        """Answer a waiting client whose search was not decided in time."""
        self._searches.look()

    def _on_relocalize(
        self, _request: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        response.message = self._search_refusal()
        response.success = not response.message
        if response.success:
            self._relocalize(lambda: None)
            response.message = 'the next frame is searched for in the whole map'
        return response

    def _search_refusal(self) -> str:
        """Return why no search is possible now; empty if it is."""
        if self._health.accepts_frames:
            return ''
        return 'images are ignored: ' + (
            'call ~/enable with data: true' if self._health.active else 'activate the node'
        )

    def _on_enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self._health.enabled = bool(request.data)
        self._log(f'~/enable: images are {"localized" if request.data else "ignored"}')
        self._publish()
        response.success = True
        response.message = 'enabled' if request.data else 'disabled'
        if not self._health.active:
            response.message += '; the node is not active, and images are ignored until it is'
        return response
