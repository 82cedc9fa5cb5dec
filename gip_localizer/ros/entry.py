# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The commands of the nodes: Ctrl-C ends them quietly, also while the imports still go on."""

from __future__ import annotations

import importlib
import os
import signal


def localizer() -> int:
    """Run the node `localizer`."""
    return _run('localizer_node')


def synthetic_camera() -> int:
    """Run the node `synthetic_camera`."""
    return _run('synthetic_camera_node')


def bag_player() -> int:
    """Run the node `bag_player`."""
    return _run('bag_player_node')


def _run(module: str) -> int:
    """Import the node's module, which takes a second, and run it; it sets handlers of its own."""
    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, lambda *_: os._exit(0))
    code: int = importlib.import_module(f'gip_localizer.ros.{module}').main()
    return code
