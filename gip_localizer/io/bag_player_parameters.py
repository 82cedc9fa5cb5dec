# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Every parameter of the node `bag_player`, once."""

from __future__ import annotations

from dataclasses import dataclass

from gip_localizer.parameter_specs import parameter as p
from gip_localizer.parameter_specs import ParameterGroup


@dataclass(frozen=True)
class BagPlayerParameters(ParameterGroup):
    """What is played, and how fast."""

    bag: str = p('', 'Bag: a rosbag2 folder, an .mcap or a .db3 file.', read_only=True)
    rate: float = p(1.0, 'Bag seconds per second.', low=0.01, high=100.0)
    start: float = p(0.0, 'What is skipped at the beginning.', unit='s', low=0.0, high=1e7,
                     read_only=True)
    loop: bool = p(False, 'Begin again at the end.')
    paused: bool = p(False, 'Wait for the service ~/pause before the first message.',
                     read_only=True)
    topics: str = p('', 'Names of the topics to play, with commas between; empty: all.',
                    read_only=True)
    wait_for: str = p('', 'Names of topics, with commas between, that must each have a subscriber '
                      'before the first message; empty: play at once.', read_only=True)
