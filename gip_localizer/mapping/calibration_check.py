# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Check a camera's mounting pose: lane lines of a bag must be parallel in bird's-eye views."""

from __future__ import annotations

from dataclasses import dataclass
from io import BytesIO
from itertools import islice
import math

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np

from gip_localizer.core.arrays import Floats, Grey
from gip_localizer.core.birdseye.rectifier import Rectifier, View
from gip_localizer.core.birdseye.view_choice import complete_view
from gip_localizer.core.camera.model import CameraModel
from gip_localizer.errors import BagError, CalibrationError, ImageError
from gip_localizer.io.bags.bag import Bag
from gip_localizer.io.bags.camera import recorded_camera
from gip_localizer.io.bags.topics import IMAGES, Topics
from gip_localizer.io.bit_depth import BitDepth
from gip_localizer.io.image_stream import decoded_images
from gip_localizer.io.images import compressed_grey_image, grey_image
from gip_localizer.mapping.lane_lines import lane_lines, LaneLine, pitch_excess
from gip_localizer.parameters import Parameters
from gip_localizer.visualization.style import ESTIMATE, STYLE, WRONG


@dataclass(frozen=True, eq=False)
class CheckedFrame:
    """One frame: image, view, lane lines, and the pitch error (rad) estimated from them."""

    image: Grey
    view: View
    lines: list[LaneLine]
    excess: float | None


@dataclass(frozen=True, eq=False)
class CalibrationCheck:
    """
    Result of the check for the frames of a bag.

    Attributes
    ----------
    camera : CameraModel
        Camera with the mounting pose that is checked.
    frames : int
        Number of examined frames.
    refused : list of str
        Reasons why other frames could not be used.
    excesses : (n,) float64
        Assumed minus estimated pitch, rad, of each frame with two straight lines.
    example : CheckedFrame
        The frame with the most lines.

    """

    camera: CameraModel
    frames: int
    refused: list[str]
    excesses: Floats
    example: CheckedFrame

    @property
    def excess(self) -> float:
        """Median pitch excess over the frames, rad; NaN without frames."""
        return float(np.median(self.excesses)) if len(self.excesses) else math.nan

    @property
    def error(self) -> float:
        """Standard error of the median, rad, from the scatter between frames."""
        if len(self.excesses) < 2:
            return math.nan
        spread = 1.4826 * np.median(np.abs(self.excesses - self.excess))
        return float(1.2533 * spread / math.sqrt(len(self.excesses)))


def check_calibration(
    bag: Bag, topics: Topics, parameters: Parameters, most: int
) -> CalibrationCheck:
    """
    Detect lane lines in frames of a bag.

    Parameters
    ----------
    bag, topics : Bag, Topics
        Topics image and camera_info are read.
    parameters : Parameters
        `camera.*` and `birdseye.*` are used.
    most : int
        Largest number of frames, spread evenly over the bag.

    Raises
    ------
    GipError
        No image can be read, or the view sees no road.

    """
    recorded, at = recorded_camera(bag, topics, parameters), parameters.camera
    camera = recorded
    rectifier = Rectifier(camera, complete_view(parameters.birdseye, camera))
    decode = compressed_grey_image if topics.image.msgtype in IMAGES[1:] else grey_image
    step = max(topics.image.messages // most, 1)
    depth = BitDepth()
    frames: list[CheckedFrame] = []
    refused: list[str] = []
    messages = decoded_images(map(bag.decode, bag.messages([topics.image.name])))
    for decoded in islice(messages, 0, step * most, step):
        if decoded is None:
            continue
        try:
            image = depth.scaled(decode(decoded))
            if image.shape != (camera.height, camera.width):
                camera = recorded.for_image(image)
                rectifier = Rectifier(camera, complete_view(parameters.birdseye, camera))
        except (ImageError, CalibrationError) as error:
            refused.append(str(error))
            continue
        view = rectifier.rectify(image)
        lines = lane_lines(view, at.x)
        frames.append(CheckedFrame(image, view, lines, pitch_excess(lines, at.z)))
    if not frames:
        why = f': {refused[0]}' if refused else ''
        raise BagError(f'no image of {topics.image.name} can be used{why}')
    excesses = np.array([f.excess for f in frames if f.excess is not None], float)
    return CalibrationCheck(camera, len(frames), refused, excesses, max(frames, key=_usefulness))


def _usefulness(frame: CheckedFrame) -> tuple[bool, int]:
    return frame.excess is not None, len(frame.lines)


def check_picture(check: CalibrationCheck, kind: str) -> bytes:
    """Draw the road grid over the frame, and the lane lines in the view; `kind`: png or svg."""
    with rc_context({**STYLE, 'axes.grid': False}):
        figure = Figure(figsize=(10.4, 4.4))
        panels = figure.subplots(1, 2, width_ratios=(1.8, 1.0))
        _draw_grid(panels[0], check)
        _draw_lines(panels[1], check)
        picture = BytesIO()
        figure.savefig(picture, format=kind, dpi=110)
    return picture.getvalue()


def _draw_grid(axes: Axes, check: CalibrationCheck) -> None:
    grid = check.example.view.grid
    near = grid.far - grid.rows * grid.resolution
    axes.imshow(check.example.image, cmap='gray')
    ahead, across = np.linspace(near, grid.far, 100), np.linspace(-grid.left, grid.left, 100)
    for y in np.arange(-math.floor(grid.left), grid.left + 0.01, 1.0):
        _draw_road_line(axes, check.camera, np.column_stack([ahead, np.full(100, y)]))
    for x in np.arange(math.ceil(near), grid.far + 0.01, 1.0):
        _draw_road_line(axes, check.camera, np.column_stack([np.full(100, x), across]))
    height, width = check.example.image.shape
    axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), xticks=[], yticks=[])
    axes.set_title('road plane of this calibration: squares of 1 m')


def _draw_road_line(axes: Axes, camera: CameraModel, points: Floats) -> None:
    pixels, valid = camera.project(points)
    pixels[~valid] = np.nan
    axes.plot(pixels[:, 0], pixels[:, 1], color=ESTIMATE, lw=0.8)


def _draw_lines(axes: Axes, check: CalibrationCheck) -> None:
    view, grid = check.example.view, check.example.view.grid
    extent = (grid.left, -grid.left, grid.far - grid.rows * grid.resolution, grid.far)
    axes.imshow(np.where(view.valid, view.patch, np.nan), cmap='gray', extent=extent)
    camera_x = check.camera.extrinsics.x
    for line in check.example.lines:
        x = np.array([line.start, line.end])
        axes.plot(line.offset + line.slope * x, x + camera_x, color=WRONG, lw=1.5)
    axes.set(xlabel='left [m]', ylabel='ahead of base_link [m]', xlim=extent[:2],
             ylim=extent[2:])
    axes.set_title(f'{len(check.example.lines)} straight lines')
