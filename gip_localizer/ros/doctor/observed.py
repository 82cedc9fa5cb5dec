# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""What `gip doctor --topics` has received from a running stack."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from gip_localizer.parameters import Parameters


@dataclass(frozen=True)
class Asked:
    """
    What the user gives.

    Attributes
    ----------
    params : Path or None
        Parameter file; None: the parameters of the running node.
    node : str or None
        Name of the localizer; None: the only one.
    seconds : float
        How long to listen.
    topics : dict
        image, camera_info, odom → name; None: that of the node.

    """

    params: Path | None
    node: str | None
    seconds: float
    topics: Mapping[str, str | None]


@dataclass
class Heard:
    """
    One topic.

    Attributes
    ----------
    topic : str
        Its full name.
    publishers : int
        How many publish it.
    conflict : str
        Why none of them reaches the localizer; empty: one does, or there is none.
    others : list of str
        Other topics of the same type that are published.
    arrivals_ns, stamps_ns : list of int
        Of each message: the clock of the stack at its arrival, and its stamp.
    frames : set of str
        Frames that the headers name.
    last : Any
        The last message; None before the first.

    """

    topic: str
    publishers: int = 0
    conflict: str = ''
    others: list[str] = field(default_factory=list)
    arrivals_ns: list[int] = field(default_factory=list)
    stamps_ns: list[int] = field(default_factory=list)
    frames: set[str] = field(default_factory=set)
    last: Any = None

    def period(self) -> float:
        """Return the median time between two stamps, seconds; 0 for fewer than three."""
        if len(self.stamps_ns) < 3:
            return 0.0
        return float(np.median(np.abs(np.diff(self.stamps_ns)))) * 1e-9

    def delay(self) -> float:
        """Return the median time from a stamp to its arrival, seconds."""
        return float(np.median(np.subtract(self.arrivals_ns, self.stamps_ns))) * 1e-9


@dataclass
class Observed:
    """
    The stack.

    Attributes
    ----------
    seconds : float
        How long it was listened to.
    node : str
        Full name of the localizer; empty: none runs.
    state : str
        Of a managed node; empty: it is not managed, or does not answer.
    parameters : Parameters
        Of the node, or of the file.
    sim_time : bool
        The node takes its time from /clock.
    topics : dict
        image, camera_info, odom, pose → what was heard.
    clocks_ns : list of int
        Times of /clock.
    transforms : set of tuple
        Parent and child of each transform heard.
    tf_known : bool
        tf2_msgs is installed, and /tf was listened to.
    statuses : dict
        Group of the node's diagnostics → level and message.

    """

    seconds: float
    node: str
    state: str
    parameters: Parameters
    sim_time: bool
    topics: dict[str, Heard]
    clocks_ns: list[int] = field(default_factory=list)
    transforms: set[tuple[str, str]] = field(default_factory=set)
    tf_known: bool = False
    statuses: dict[str, tuple[int, str]] = field(default_factory=dict)
