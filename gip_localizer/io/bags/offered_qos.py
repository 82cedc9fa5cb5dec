# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The quality of service that a recorder noted for a topic, of each of its publishers."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

from gip_localizer.parameters.yaml_files import parse_yaml, YamlFileError

RELIABLE, LATCHED = ('reliable', 1), ('transient_local', 1)
"""As Jazzy writes them, and as a number (rmw) before."""


class OfferedQos(NamedTuple):
    """
    What one publisher offered.

    Attributes
    ----------
    reliable : bool
        False: best effort.
    latched : bool
        Transient local; False: volatile.
    depth : int
        Messages that it kept; 0: unknown.

    """

    reliable: bool
    latched: bool
    depth: int


def offered_qos(text: str) -> tuple[OfferedQos, ...]:
    """Return the profiles of a channel's `offered_qos_profiles`; none where it is unreadable."""
    try:
        profiles = parse_yaml(text)
    except YamlFileError:
        return ()
    if not isinstance(profiles, list):
        return ()
    return tuple(_of(profile) for profile in profiles if isinstance(profile, dict))


def offered_by(profiles: Iterable[Any]) -> tuple[OfferedQos, ...]:
    """Return the profiles as `rosbags` reads them."""
    return tuple(OfferedQos(profile.reliability.name == 'RELIABLE',
                            profile.durability.name == 'TRANSIENT_LOCAL', int(profile.depth))
                 for profile in profiles)


def _of(profile: dict[str, Any]) -> OfferedQos:
    depth = profile.get('depth')
    return OfferedQos(profile.get('reliability') in RELIABLE, profile.get('durability') in LATCHED,
                      depth if isinstance(depth, int) and depth > 0 else 0)
