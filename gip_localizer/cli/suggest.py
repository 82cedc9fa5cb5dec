# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""`gip suggest`: which view suits a camera."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
import sys
from typing import Any, TYPE_CHECKING

from gip_localizer.parameters.yaml_files import user_path

if TYPE_CHECKING:
    from gip_localizer.core.camera.model import CameraModel
    from gip_localizer.mapping.view_suggestion import Suggestion
    from gip_localizer.parameters import Parameters

CALIBRATIONS = ('.yaml', '.yml')
PICTURES = ('.png', '.jpg', '.svg', '.pdf')
EXAMPLES = """examples:
  gip suggest camera.yaml --set camera.z=0.35 --set camera.pitch=0.44    a robot's camera
  gip suggest drive --map road.yaml                           camera_info of a bag, and its map
  gip suggest drive --map road.yaml --out results/view.png    with a picture

The node and gip replay choose the same view where birdseye.* is not given.
"""


def add_parser(verbs: Any) -> None:
    """Add the verb to the parser of `gip`."""
    parser = verbs.add_parser(
        'suggest', help='print and draw the view that suits a camera', epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description='Choose birdseye.* from the camera and the map, and print it as YAML.',
    )
    parser.add_argument('bag', nargs=1, type=user_path, metavar='CAMERA_INFO|BAG',
                        help='calibration as YAML (of camera_calibration, or a CameraInfo), or a '
                             'bag')
    parser.add_argument('--map', type=user_path, metavar='YAML', help='nav2 map YAML')
    parser.add_argument('--params', type=user_path, metavar='FILE',
                        help='ROS parameter YAML with camera.* (default: params.yaml next to the '
                             'input, if any)')
    parser.add_argument('--set', action='append', default=[], dest='settings',
                        metavar='NAME=VALUE', help='one parameter, e.g. camera.pitch=0.26')
    parser.add_argument('--image-topic', metavar='TOPIC')
    parser.add_argument('--camera-info-topic', metavar='TOPIC')
    parser.add_argument('--out', type=user_path, metavar='FILE', help='picture to write')
    parser.add_argument('--force', action='store_true', help='replace an existing picture')
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Choose the view, print it, draw it."""
    from gip_localizer.cli.settings import recorded_parameters
    from gip_localizer.io.map_files import load_map
    from gip_localizer.io.output_folder import check_file, write_whole
    from gip_localizer.mapping.view_suggestion import suggest_view, suggestion_picture

    if args.out is not None:
        check_file(args.out, force=args.force, suffixes=PICTURES)
    parameters = recorded_parameters(args)
    camera = _camera(args, parameters)
    raster_map = None if args.map is None else load_map(args.map)
    found = suggest_view(camera, raster_map, parameters.score)
    _print(found)
    if args.out is not None:
        write_whole(args.out, suggestion_picture(found, args.out.suffix.lower().lstrip('.')))
        print(f'gip: picture: {args.out}', file=sys.stderr)
    return 0


def _camera(args: argparse.Namespace, parameters: Parameters) -> CameraModel:
    """Return the camera of a calibration file or of a bag."""
    from gip_localizer.core.camera.model import CameraModel
    from gip_localizer.io.bags.bag import Bag
    from gip_localizer.io.bags.camera import mounted, recorded_camera
    from gip_localizer.io.bags.topics import choose_topics, TopicNames
    from gip_localizer.io.camera_info_files import load_camera_info
    from gip_localizer.io.messages import calibration

    path: Path = args.bag[0]
    if path.suffix.lower() in CALIBRATIONS:
        return CameraModel.given(calibration(load_camera_info(path)), parameters.camera)
    bag = Bag(args.bag)
    topics = choose_topics(bag, TopicNames(args.image_topic, args.camera_info_topic))
    parameters, notes = mounted(bag, topics, parameters)
    for note in notes:
        print(f'gip: {note}', file=sys.stderr)
    return recorded_camera(bag, topics, parameters)


def _print(found: Suggestion) -> None:
    """Print the view as a ROS parameter file; remarks are comments of YAML."""
    view, sigma = found.view, found.sigma
    print('/**:\n  ros__parameters:\n    birdseye:')
    for name, value in vars(view).items():
        print(f'      {name}: {float(value)}')
    print(f'# cells inside the image: {found.cells}')
    if sigma is None:
        print('# expected standard deviation: give the map with --map')
        return
    print(
        f'# expected standard deviation of a frame, at least: {1e3 * sigma[0]:.2g} mm ahead, '
        f'{1e3 * sigma[1]:.2g} mm to the left, {math.degrees(sigma[2]):.2g} deg\n'
        '# (errors of road, map and calibration add to it)'
    )
