# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""What `gip calibrate` writes: parameters, static transform, covariance, pictures, table."""

from __future__ import annotations

from collections.abc import Sequence
import json
import math
from pathlib import Path
import shlex

import cv2
import numpy as np

from gip_localizer.core.birdseye.rectifier import make_grid
from gip_localizer.core.birdseye.view_choice import complete_view
from gip_localizer.core.camera.extrinsics import Extrinsics
from gip_localizer.core.camera.model import CameraModel
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.evaluation.metrics import format_table, TableRow
from gip_localizer.io.output_folder import check_folder, fresh_folder
from gip_localizer.mapping.mount_calibration import COMPONENTS, KnownFrame, MountResult
from gip_localizer.parameters import dump_parameter_file, Parameters
from gip_localizer.visualization.overlay import outlines_at

MARK = 'calibration.json'
VAGUE = {'m': 0.02, 'rad': math.radians(0.1)}
"""Standard deviations above which a component counts as not observable; chosen: errors that a
user sees in the poses."""
MANOEUVRES = {
    'x': 'a drive with turns', 'y': 'a drive with turns', 'yaw': 'a longer straight drive',
    'z': 'road with more texture, near and far', 'roll': 'road with texture to both sides',
    'pitch': 'road with texture, near and far',
}
"""What shows a component better."""


def check_calibration_folder(out: Path, *, force: bool) -> None:
    """Refuse a folder that must not be replaced (raises OutputError)."""
    check_folder(out, force=force, mark=MARK)


def write_calibration(
    out: Path, found: MountResult, frames: Sequence[KnownFrame], camera: CameraModel,
    raster_map: RasterMap, parameters: Parameters, *, force: bool,
) -> None:
    """Write the folder whole or not at all (raises OutputError)."""
    values = {name: float(getattr(found.extrinsics, name)) for name in COMPONENTS}
    calibrated = parameters.replace({f'camera.{name}': value for name, value in values.items()})
    sigmas = dict(zip(COMPONENTS, found.sigmas.tolist(), strict=True))
    frame = frames[len(frames) // 2]
    with fresh_folder(out, force=force, mark=MARK) as folder:
        (folder / 'params.yaml').write_text(dump_parameter_file(calibrated))
        (folder / 'static_transform.sh').write_text(_transform(values, parameters.frames.base))
        (folder / MARK).write_text(json.dumps({
            'camera': values, 'sigma': sigmas, 'covariance': found.covariance.tolist(),
            'frames_used': found.used, 'frames': found.tried,
        }, indent=2) + '\n')
        for name, mount in (('before', camera.extrinsics), ('after', found.extrinsics)):
            drawn = _picture(frame, camera.with_extrinsics(mount), raster_map, parameters)
            cv2.imwrite(str(folder / f'{name}.png'), drawn)


def _picture(
    frame: KnownFrame, camera: CameraModel, raster_map: RasterMap, parameters: Parameters
) -> np.ndarray:  # type: ignore[type-arg]
    view = complete_view(parameters.birdseye, camera, raster_map.resolution)
    return outlines_at(frame.image, camera, raster_map, make_grid(view), frame.pose)


def _transform(values: dict[str, float], base: str) -> str:
    """Return the command that publishes the camera's body frame (x ahead, z up), REP 103."""
    options = ' '.join(f'--{name} {values[name]:.6f}' for name in COMPONENTS)
    return (
        '# Body frame of the camera (x ahead, y left, z up). Its optical frame is turned by\n'
        '# --roll -1.570796 --pitch 0 --yaw -1.570796 with the body frame as parent.\n'
        f'ros2 run tf2_ros static_transform_publisher {options} \\\n'
        f'  --frame-id {shlex.quote(base)} --child-frame-id camera_link\n'
    )


def calibration_table(found: MountResult, start: Extrinsics, fixed: Sequence[str]) -> str:
    """Return the table of the components, and what the drive did not show."""
    rows = [TableRow('frames that agree', f'{found.used} of {found.tried}', '')]
    vague = []
    for name, sigma in zip(COMPONENTS, found.sigmas.tolist(), strict=True):
        before, after = getattr(start, name), getattr(found.extrinsics, name)
        unit = 'm' if name in 'xyz' else 'rad'
        if name in fixed:
            rows.append(TableRow(f'camera.{name}', f'{after:.5f}', f'{unit}, kept (--fix)'))
            continue
        change = f'{1e3 * (after - before):+.1f} mm' if unit == 'm' else (
            f'{math.degrees(after - before):+.3f} deg')
        error = f'{1e3 * sigma:.2f} mm' if unit == 'm' else f'{math.degrees(sigma):.4f} deg'
        rows.append(TableRow(f'camera.{name}', f'{after:.5f}',
                             f'{unit}, changed by {change}, standard error {error}'))
        if sigma > VAGUE[unit]:
            vague.append(f'camera.{name} was hardly observable: {MANOEUVRES[name]} shows it')
    return '\n'.join([format_table(rows), *vague])
