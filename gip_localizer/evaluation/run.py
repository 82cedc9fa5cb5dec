# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The record of one run of the localizer: the input of metrics, results and report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.pose import Pose2
from gip_localizer.evaluation.wrong_bounds import DEFAULT_BOUNDS, WrongBounds
from gip_localizer.io.trajectory import Trajectory
from gip_localizer.parameters import Parameters


class FrameResult(Protocol):
    """
    The evaluated data of one frame; estimates of `gip_localizer.core` fulfil this protocol.

    A subscriber that has only messages builds its own; pose is None for a withheld frame.

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
        """Status (a string enum)."""

    @property
    def reason(self) -> str:
        """Reason of the status."""

    @property
    def quality(self) -> Mapping[str, float]:
        """Quality figures by name."""

    @property
    def timings_ms(self) -> Mapping[str, float]:
        """Time in milliseconds by stage."""


@dataclass(frozen=True, eq=False)
class Surface:
    """
    A score surface, which the report draws with axes.

    Attributes
    ----------
    values : (rows, cols) float64
        Correlation; the first row is farthest ahead, the first column farthest left. NaN: none.
    ahead_m, left_m : float
        Half of its extent, metres.
    heading_deg : float
        Heading relative to the centre of the search window, degrees.

    """

    values: NDArray[np.float64]
    ahead_m: float
    left_m: float
    heading_deg: float


@dataclass(frozen=True)
class FrameExhibit:
    """
    Pictures of one frame for the report.

    Attributes
    ----------
    title : str
        Heading above the pictures.
    stamp_ns : int
        Stamp of the frame.
    images : dict of str to array or Surface
        Caption → picture: uint8 (h, w) or (h, w, 3) RGB, shown unchanged, or a score surface.
    why : str
        Why this frame is shown, one sentence.

    """

    title: str
    stamp_ns: int
    images: Mapping[str, NDArray[Any] | Surface]
    why: str = ''


@dataclass(frozen=True)
class Run:
    """
    A run, complete or stopped early.

    Attributes
    ----------
    title : str
        Heading of the report.
    estimates : sequence of FrameResult
        Every frame in order, published or withheld.
    parameters : Parameters
        Parameters of the run.
    truth : Trajectory or None
        Ground truth of the base in the map frame.
    raster_map : RasterMap or None
        Map, drawn behind the path.
    exhibits : sequence of FrameExhibit
        Frames to show, worst first.
    wall_seconds : float or None
        Duration of the run, for `frames_per_second`.
    complete : bool
        False if the run was stopped before its end.
    sources : dict
        Origin of the input (bag, map, seed …); written to `config` and the report.
    notes : sequence of str
        Notes for the reader, for example on skipped topics or truncated input.
    wrong : WrongBounds
        Errors above which a published pose counts as wrong.
    keep_map : bool
        True: the map exists for this run only, and is written into the results folder.

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
    wrong: WrongBounds = DEFAULT_BOUNDS
    keep_map: bool = False
