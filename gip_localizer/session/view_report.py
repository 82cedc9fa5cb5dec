# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""What is reported of the view: which road it holds, and whether it suits camera and map."""

from __future__ import annotations

from gip_localizer.core.birdseye.view_choice import COARSEST, fitting_view
from gip_localizer.core.calibrated_view import CalibratedView
from gip_localizer.core.localizer import Localizer
from gip_localizer.parameters import Birdseye

MOST_OUTSIDE = 0.5
"""Largest share of a given view outside the image that is not reported; chosen: most of it."""
FINEST = 0.5
"""Smallest side of a cell, in sides of the map's cell, that is not reported; chosen: finer cells
show nothing more of the map and take four times as long for each halving."""


class ViewReport:
    """
    Description and warnings of the view in use, made once per calibrated view.

    Attributes
    ----------
    text : str
        The view in words; empty until it is known.
    seconds : float
        Time that the computation of the view took.
    number : int
        Number of views since the start.
    warnings : dict
        Rule of `gip_localizer.session.diagnostic_rules` → detail.

    """

    def __init__(self) -> None:
        self.text = ''
        self.seconds, self.number = 0.0, 0
        self.warnings: dict[str, str] = {}
        self._reported: CalibratedView | None = None

    def update(self, localizer: Localizer) -> None:
        """Describe the view that the localizer uses now."""
        prepared = localizer.prepared
        if prepared is None or prepared is self._reported:
            return
        self._reported = prepared
        self.seconds, self.number = prepared.seconds, self.number + 1
        given, map_resolution = localizer.parameters.birdseye, localizer.raster_map.resolution
        self.text = view_text(prepared.birdseye, given)
        self.warnings = view_warnings(prepared, given, map_resolution)


def view_text(view: Birdseye, given: Birdseye) -> str:
    """Return a view in words, and which of its values were chosen."""
    automatic = given.automatic
    whence = {0: 'as given', len(vars(given)): 'chosen from camera and map'}.get(
        len(automatic), f'{", ".join(automatic)} chosen from camera and map'
    )
    return (
        f'view {view.near:.3g} to {view.far:.3g} m ahead, {view.half_width:.3g} m to each side, '
        f'cells of {100.0 * view.resolution:.3g} cm: {whence}'
    )


def view_warnings(
    prepared: CalibratedView, given: Birdseye, map_resolution: float
) -> dict[str, str]:
    """Return by rule in what a given view does not suit the camera or the map."""
    warnings = {}
    outside = 1.0 - float(prepared.rectifier.valid.mean())
    if not given.automatic and outside > MOST_OUTSIDE:
        warnings['VIEW_OUTSIDE_IMAGE'] = (
            f'{100.0 * outside:.0f} % of the cells lie outside the image; '
            f'{fitting_view(prepared.rectifier.camera, map_resolution)}'
        )
    side = prepared.birdseye.resolution
    if given.resolution and not FINEST <= side / map_resolution <= 1.05 * COARSEST:
        word = 'coarser' if side > map_resolution else 'finer'
        warnings['VIEW_CELLS'] = (
            f'cells of {side:g} m are much {word} than those of the map, {map_resolution:g} m; '
            f'set birdseye.resolution from {map_resolution:g} to {COARSEST * map_resolution:g}, '
            'or 0: automatic'
        )
    return warnings
