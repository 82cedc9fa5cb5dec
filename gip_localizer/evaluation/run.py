# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""What one run of the localizer leaves behind: the input of metrics, results and report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

from numpy.typing import NDArray

from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.pose import Pose2
from gip_localizer.io.trajectory import Trajectory
from gip_localizer.parameters import Parameters


class FrameResult(Protocol):
    """
    What is judged of one frame; `gip_localizer.core` estimates have this shape.

    A subscriber that has only messages may build its own: pose None for a withheld frame.

    """

    @property
    def stamp_ns(self) -> int:
        """Stamp of the image, nanoseconds."""

    @property
    def pose(self) -> Pose2 | None:
        """Published pose of the base in the map; None: withheld."""

    @property
    def covariance(self) -> NDArray[Any] | None:
        """(3, 3) covariance of x, y [m] and yaw [rad], map frame."""

    @property
    def status(self) -> Any:
        """Status word (a string enum)."""

    @property
    def reason(self) -> str:
        """Why the status is what it is."""

    @property
    def quality(self) -> Mapping[str, float]:
        """Figures of quality by name."""

    @property
    def timings_ms(self) -> Mapping[str, float]:
        """Milliseconds by stage."""


@dataclass(frozen=True)
class FrameExhibit:
    """
    Pictures of one frame for the report.

    Attributes
    ----------
    title : str
        One line above the pictures.
    stamp_ns : int
        Stamp of the frame.
    images : dict of str to array
        Caption to a picture: uint8 (h, w) or (h, w, 3) RGB as it is; other two-dimensional
        arrays are scaled from their finite least to their greatest value and coloured.

    """

    title: str
    stamp_ns: int
    images: Mapping[str, NDArray[Any]]


@dataclass(frozen=True)
class Run:
    """
    A run, complete or cut short.

    Attributes
    ----------
    title : str
        Heading of the report.
    estimates : sequence of FrameResult
        Every frame in order, published or withheld.
    parameters : Parameters
        As used.
    truth : Trajectory or None
        Ground truth of the base in the map frame.
    raster_map : RasterMap or None
        Drawn behind the path.
    exhibits : sequence of FrameExhibit
        Frames to show, worst first.
    wall_seconds : float or None
        Time the run took, for `frames_per_second`.
    complete : bool
        False: stopped before its end.
    sources : dict
        Where the input came from (bag, map, seed …); goes to `config` and the report.
    notes : sequence of str
        What the reader must know: skipped topics, truncated input.

    """

    title: str
    estimates: Sequence[FrameResult]
    parameters: Parameters
    truth: Trajectory | None = None
    raster_map: RasterMap | None = None
    exhibits: Sequence[FrameExhibit] = ()
    wall_seconds: float | None = None
    complete: bool = True
    sources: Mapping[str, Any] = field(default_factory=dict)
    notes: Sequence[str] = ()
