# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""How many messages of each topic arrived, how many were refused, and why the last one was."""

from __future__ import annotations


class MessageLog:
    """
    Counts and faults of messages by topic.

    Attributes
    ----------
    counts : dict
        Number of messages per topic, and of refused ones (`<topic>_refused`).
    complaints : dict
        Topic → fault of its last message.

    """

    def __init__(self) -> None:
        self.counts: dict[str, int] = {}
        self.complaints: dict[str, str] = {}

    def count(self, topic: str) -> None:
        """Count a message."""
        self.counts[topic] = self.counts.get(topic, 0) + 1

    def count_refused(self, topic: str) -> None:
        """Count a message as refused; its frame has the reason."""
        self.count(f'{topic}_refused')

    def refuse(self, topic: str, reason: str) -> None:
        """Count a message as refused, and keep the reason until a good message."""
        self.count_refused(topic)
        self.complaints[topic] = reason

    def accept(self, topic: str) -> None:
        """Forget the fault of an earlier message."""
        self.complaints.pop(topic, None)
