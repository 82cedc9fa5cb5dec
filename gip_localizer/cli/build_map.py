# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""`gip map`: build a map of the road from a drive with known poses."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
import sys
from typing import Any, TYPE_CHECKING

from gip_localizer.cli.known_poses import add_pose_options, known_poses
from gip_localizer.parameters.yaml_files import user_path

if TYPE_CHECKING:
    from gip_localizer.core.map.raster_map import RasterMap
    from gip_localizer.io.bags.bag import Bag
    from gip_localizer.io.bags.topics import Topics
    from gip_localizer.mapping.mapped_drive import MappedDrive
    from gip_localizer.mapping.pose_check import PoseCheck, PoseCheckResult
    from gip_localizer.mapping.settings import MapBuilderSettings

DEFAULT_OUT = Path('results/map/map.yaml')
EXAMPLES = """examples:
  gip map survey --out road.yaml                      poses from the bag's ground truth
  gip map survey --poses rtk.tum --out road.yaml      poses from a TUM file (base_link in map)
  gip map survey --set camera.pitch=0.26 --set birdseye.far=9 --resolution 0.04
  gip map survey --start 30 --duration 60 --every 3   part of the drive, every third frame
  gip replay another_drive --map road.yaml            localize on the map

The verb also writes road.png (16-bit grey, transparent where the road was not seen) and
road_noise.png (standard deviation of each cell; full scale is 1). The mounting pose of the camera
must be calibrated, and the poses accurate to a fraction of a cell: their errors blur the map.
Afterwards frames are localized on maps of single other frames of the drive. Where they disagree
with the poses, the map states the error (sigma_xy, sigma_yaw in road.yaml), and every covariance
on this map contains it. An offset that is common to the whole drive remains unknown.
"""


def add_parser(verbs: Any) -> None:
    """Add the verb to the parser of `gip`."""
    parser = verbs.add_parser(
        'map', help='build a road map from a drive with known poses', epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description='Combine the bird\'s-eye views of a drive into a map: every cell is the mean\n'
                    'over all frames that saw it, with larger weights for near views.',
    )
    parser.add_argument('bag', nargs='+', type=user_path, metavar='BAG',
                        help='rosbag2 folder, .mcap or .db3 file; several bags are merged by time')
    parser.add_argument('--out', type=user_path, default=DEFAULT_OUT, metavar='YAML',
                        help=f'map to write (default: {DEFAULT_OUT})')
    parser.add_argument('--force', action='store_true', help='replace an existing map')
    parser.add_argument('--resolution', type=float, metavar='M',
                        help='side of a cell (default: birdseye.resolution, or from the camera if '
                             'that is 0)')
    poses = add_pose_options(parser)
    poses.add_argument('--max-gap', type=float, default=0.2, metavar='S',
                       help='longest time between two poses to interpolate (default: 0.2)')
    poses.add_argument('--no-pose-check', action='store_true',
                       help='do not compare the poses with what the frames see; the map then '
                            'counts as exact')
    tune = parser.add_argument_group('parameters')
    tune.add_argument('--params', type=user_path, metavar='FILE',
                      help='ROS parameter YAML (default: params.yaml next to the bag, if any)')
    tune.add_argument('--set', action='append', default=[], metavar='NAME=VALUE', dest='settings',
                      help='one parameter; repeatable, e.g. --set camera.pitch=0.26')
    part = parser.add_argument_group('part of the bag')
    part.add_argument('--image-topic', metavar='TOPIC')
    part.add_argument('--camera-info-topic', metavar='TOPIC')
    part.add_argument('--every', type=int, default=1, metavar='N', help='use every Nth frame')
    part.add_argument('--start', type=float, default=0.0, metavar='S',
                      help='start time in seconds after the first message')
    part.add_argument('--duration', type=float, metavar='S', help='length in seconds')
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Build the map, write it, print the table."""
    from gip_localizer.cli.map_summary import map_rows, pose_notes, pose_rows, range_note
    from gip_localizer.cli.settings import (
        ctrl_c,
        recorded_parameters,
        unused_at_the_desk,
        without_masks,
    )
    from gip_localizer.core.birdseye.view_choice import complete_view
    from gip_localizer.evaluation.metrics import format_table
    from gip_localizer.io.bags.bag import Bag
    from gip_localizer.io.bags.camera import mounted, recorded_camera
    from gip_localizer.io.bags.window import BagWindow
    from gip_localizer.io.map_files import save_map
    from gip_localizer.io.output_folder import check_file
    from gip_localizer.mapping.mapped_drive import MappedDrive
    from gip_localizer.mapping.pose_check import PoseCheck
    from gip_localizer.mapping.settings import MapBuilderSettings

    check_file(args.out, force=args.force, suffixes=('.yaml', '.yml'))
    for end in ('.png', '_noise.png'):
        check_file(args.out.with_name(args.out.stem + end), force=args.force, suffixes=('.png',))
    parameters = recorded_parameters(args)
    window = BagWindow(args.start, args.duration)
    bag = Bag(args.bag)
    topics, poses, notes = known_poses(args, bag, parameters, 'build a map')
    parameters, said = mounted(bag, topics, without_masks(parameters))
    notes += [*said, *unused_at_the_desk(parameters)]
    resolution = args.resolution
    if resolution is None:
        camera = recorded_camera(bag, topics, parameters)
        resolution = complete_view(parameters.birdseye, camera).resolution
    settings = MapBuilderSettings(resolution, args.every, args.max_gap, window)
    drive = MappedDrive(bag, topics, parameters, poses, settings)
    with ctrl_c(interrupts=True):
        raster_map = _with_progress(drive, settings, bag, topics)
        checked = _check_poses(args, PoseCheck(drive, parameters, resolution))
    if checked is not None and checked.errors is not None:
        raster_map = replace(raster_map, accuracy=checked.errors.accuracy)
    save_map(raster_map, args.out, force=args.force)
    notes += [*range_note(drive, resolution), *pose_notes(checked)]
    for note in [*notes, *bag.notes]:
        print(f'gip: {note}', file=sys.stderr)
    print(format_table([*map_rows(drive, raster_map), *pose_rows(checked)]))
    print(f'\nmap: {args.out}, its picture: {args.out.with_suffix(".png")}')
    return 0


def _with_progress(drive: MappedDrive, settings: MapBuilderSettings, bag: Bag,
                   topics: Topics) -> RasterMap:
    from gip_localizer.cli.progress import progress

    total = round(topics.image.messages * settings.window.share(bag) / settings.every)
    with progress(total, 'mapping') as bar:
        return drive.run(bar.update)


def _check_poses(args: argparse.Namespace, check: PoseCheck) -> PoseCheckResult | None:
    """Return the comparison of the poses with the frames; None if it is not requested."""
    from gip_localizer.cli.progress import progress

    if args.no_pose_check:
        return None
    with progress(len(check.indices), 'comparing poses') as bar:
        return check.run(bar.update)
