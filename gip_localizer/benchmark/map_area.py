# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Suite `map`: time per frame and resident memory as functions of the area of the map.

Each area is measured in a separate process, which prints one JSON object.

"""

from __future__ import annotations

import json
import os
from pathlib import Path
import sys
import tempfile
import time
from typing import Any

import numpy as np

from gip_localizer.benchmark.children import child
from gip_localizer.benchmark.frames import images, straight, tracking_parameters
from gip_localizer.benchmark.rows import exponent, Row
from gip_localizer.benchmark.scene import camera
from gip_localizer.core.localizer import Localizer
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.pose import Pose2
from gip_localizer.io.map_files import load_map, save_map
from gip_localizer.synthetic.worlds import map_of, road_world

CELL = 0.1
"""Side of a map cell, metres; chosen."""
SIDES = (100.0, 316.0, 1000.0)
"""Sides of the maps, metres: 1 ha, 10 ha, 1 km²; chosen."""
START = Pose2(30.0, 8.0, 0.0)
"""Start pose, metres and rad; chosen, on the road in the map's corner."""
STEP = 0.1
"""Distance between frames, metres; chosen."""
DRIVE = 40
"""Number of frames forward, and then of frames back; chosen."""


def map_suite(rounds: int) -> tuple[list[Row], dict[str, Any]]:
    """Return a row per area with time and memory, and the details."""
    found = []
    with tempfile.TemporaryDirectory(prefix='gip_bench_') as folder:
        store = {'XDG_CACHE_HOME': str(Path(folder) / 'cache')}
        for side in SIDES:
            path = Path(folder) / f'map{side:.0f}' / 'map.yaml'
            save_map(tiled_map(side), path)
            module = 'gip_localizer.benchmark.map_area'
            child(module, [str(path), '1'], store)  # the first run decodes the image of the map
            found.append({'side_m': side, **child(module, [str(path), str(rounds)], store)})
    rows = [
        Row('map', f'{(each["side_m"] / 100) ** 2:.0f} ha at 10 cm, '
                   f'{each["rss_mib"]:.0f} MiB resident', each['ms'])
        for each in found
    ]
    areas = [each['side_m'] ** 2 for each in found]
    return rows, {
        'areas': found,
        'time_exponent': exponent(areas, [each['ms'] for each in found]),
        'memory_exponent': exponent(areas, [each['rss_mib'] for each in found]),
    }


def tiled_map(side: float) -> RasterMap:
    """Return a square map that repeats one part of the road."""
    world = map_of(road_world(seed=0, resolution=CELL / 2).raster, 2)
    grey = np.round(255.0 * world.grey).astype(np.uint8)
    cells = round(side / CELL)
    repeat = [-(-cells // n) for n in grey.shape]
    return RasterMap(np.ascontiguousarray(np.tile(grey, repeat)[-cells:, :cells]), CELL)


def resident_mib() -> float:
    """Return the resident memory of this process, MiB."""
    pages = int(Path('/proc/self/statm').read_text().split()[1])
    return pages * os.sysconf('SC_PAGE_SIZE') / 2**20


def main(arguments: list[str]) -> int:
    """Track frames on a map and print time and memory; arguments: `map.yaml rounds`."""
    path, rounds = Path(arguments[0]), int(arguments[1])
    start = time.perf_counter()
    raster_map = load_map(path)
    loaded_ms = 1e3 * (time.perf_counter() - start)
    model = camera(640, 360)
    poses = straight(START, DRIVE, STEP)
    seen = images(raster_map, model, poses)
    raster_map.release()  # rendering read parts of the map that tracking does not need
    localizer = Localizer(raster_map, tracking_parameters(model, START))
    order = [*range(DRIVE), *range(DRIVE - 2, 0, -1)] * rounds
    times, published = [], 0
    for k, frame in enumerate(order):
        start = time.perf_counter()
        estimate = localizer.update((k + 1) * 30_000_000, seen[frame], model)
        times.append(1e3 * (time.perf_counter() - start))
        published += estimate.published
    json.dump({
        'ms': float(np.median(times[5:])), 'load_ms': loaded_ms, 'rss_mib': resident_mib(),
        'frames': len(order), 'published': published,
    }, sys.stdout)
    return 0


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
