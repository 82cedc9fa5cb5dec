# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The services of `bag_player`: those of rosbag2 where its types are installed."""

from __future__ import annotations

from typing import Any, Protocol

from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

try:
    import rosbag2_interfaces.srv as rosbag2
except ImportError:  # not in the wheels
    rosbag2 = None


class Player(Protocol):
    """What the services control."""

    paused: bool

    def step(self) -> bool:
        """Publish the next message, while paused; return whether there was one."""

    def seek(self, log_ns: int) -> bool:
        """Go to a log time; return whether it lies in the bag."""

    def set_rate(self, rate: float) -> bool:
        """Play faster or slower; return whether the rate can be used."""

    def rate(self) -> float:
        """Return bag seconds per second."""

    def stop(self) -> None:
        """End."""


def serve(node: Node, player: Player) -> None:
    """Create the services of a node."""
    if rosbag2 is None:
        _PlainServices(node, player)
    else:
        _Rosbag2Services(node, player)


class _PlainServices:
    """`~/pause`, `~/toggle_paused` and `~/play_next` with the types that are always there."""

    def __init__(self, node: Node, player: Player) -> None:
        self._player = player
        node.create_service(SetBool, '~/pause', self._pause)
        node.create_service(Trigger, '~/toggle_paused', self._toggle)
        node.create_service(Trigger, '~/play_next', self._play_next)

    def _pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self._player.paused = bool(request.data)
        return self._state(response)

    def _toggle(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._player.paused = not self._player.paused
        return self._state(response)

    def _state(self, response: Any) -> Any:
        response.success = True
        response.message = 'paused' if self._player.paused else 'playing'
        return response

    def _play_next(
        self, _request: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        response.success = self._player.step()
        if not response.success:
            response.message = 'the end of the bag' if self._player.paused else (
                'only while paused: call ~/pause with data: true first'
            )
        return response


class _Rosbag2Services:
    """The services of rosbag2's player, under its names."""

    def __init__(self, node: Node, player: Player) -> None:
        self._player = player
        for name, use in {
            'Pause': self._pause, 'Resume': self._resume, 'TogglePaused': self._toggle,
            'IsPaused': self._is_paused, 'PlayNext': self._play_next, 'Seek': self._seek,
            'SetRate': self._set_rate, 'GetRate': self._get_rate, 'Stop': self._stop,
        }.items():
            # As rosbag2 names them: PlayNext is served as play_next.
            service = ''.join(f'_{c.lower()}' if c.isupper() else c for c in name).lstrip('_')
            node.create_service(getattr(rosbag2, name), f'~/{service}', use)

    def _pause(self, _request: Any, response: Any) -> Any:
        self._player.paused = True
        return response

    def _resume(self, _request: Any, response: Any) -> Any:
        self._player.paused = False
        return response

    def _toggle(self, _request: Any, response: Any) -> Any:
        self._player.paused = not self._player.paused
        return response

    def _is_paused(self, _request: Any, response: Any) -> Any:
        response.paused = self._player.paused
        return response

    def _play_next(self, _request: Any, response: Any) -> Any:
        response.success = self._player.step()
        return response

    def _seek(self, request: Any, response: Any) -> Any:
        response.success = self._player.seek(
            request.time.sec * 1_000_000_000 + request.time.nanosec
        )
        return response

    def _set_rate(self, request: Any, response: Any) -> Any:
        response.success = self._player.set_rate(request.rate)
        return response

    def _get_rate(self, _request: Any, response: Any) -> Any:
        response.rate = self._player.rate()
        return response

    def _stop(self, _request: Any, response: Any) -> Any:
        self._player.stop()
        return response
