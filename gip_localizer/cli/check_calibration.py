# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""`gip check-calibration`: check that lane lines are parallel in bird's-eye views."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
import sys
from typing import Any, TYPE_CHECKING

from gip_localizer.parameters.yaml_files import user_path

if TYPE_CHECKING:
    from gip_localizer.mapping.calibration_check import CalibrationCheck

BOUND = math.radians(0.5)
"""Largest pitch error, rad, that passes the check; chosen."""
LEAST_FRAMES = 3
"""Least number of frames with two straight lines for a result; chosen."""
PICTURES = ('.png', '.jpg', '.svg', '.pdf')


def add_parser(verbs: Any) -> None:
    """Add the verb to the parser of `gip`."""
    parser = verbs.add_parser(
        'check-calibration',
        help='draw the road plane over a frame, and measure the pitch error from lane lines',
        description='Draw the road plane over a frame of a bag, and measure from lane lines how '
                    'large the error of the camera pitch is.',
    )
    parser.add_argument('bag', type=user_path, nargs='+', metavar='BAG',
                        help='drive that includes a straight road with two lane lines')
    parser.add_argument('--params', type=user_path, metavar='FILE',
                        help='ROS parameter YAML (default: params.yaml next to the bag, if any)')
    parser.add_argument('--set', action='append', default=[], dest='settings',
                        metavar='NAME=VALUE', help='one parameter, e.g. camera.pitch=0.26')
    parser.add_argument('--frames', type=int, default=40, help='number of frames (default: 40)')
    parser.add_argument('--image-topic', metavar='TOPIC')
    parser.add_argument('--camera-info-topic', metavar='TOPIC')
    parser.add_argument('--out', type=user_path, default=Path('results/calibration.png'),
                        help='picture to write (default: %(default)s)')
    parser.add_argument('--force', action='store_true', help='replace an existing picture')
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Measure, draw, and print the pitch that makes the lines parallel."""
    from gip_localizer.cli.settings import (
        recorded_parameters,
        unused_at_the_desk,
        without_masks,
    )
    from gip_localizer.io.bags.bag import Bag
    from gip_localizer.io.bags.camera import mounted
    from gip_localizer.io.bags.topics import choose_topics, TopicNames
    from gip_localizer.io.output_folder import check_file, write_whole
    from gip_localizer.mapping.calibration_check import check_calibration, check_picture

    check_file(args.out, force=args.force, suffixes=PICTURES)
    parameters = recorded_parameters(args)
    bag = Bag(args.bag)
    topics = choose_topics(bag, TopicNames(args.image_topic, args.camera_info_topic))
    parameters, said = mounted(bag, topics, without_masks(parameters))
    for note in [*said, *unused_at_the_desk(parameters, ['mask_file'])]:
        print(f'gip: {note}', file=sys.stderr)
    check = check_calibration(bag, topics, parameters, max(args.frames, 1))
    write_whole(args.out, check_picture(check, args.out.suffix.lower().lstrip('.')))
    return _print_result(check, parameters.camera.pitch, args.out)


def _print_result(check: CalibrationCheck, pitch: float, out: Path) -> int:
    found = len(check.excesses)
    print(f'{"frames":28}{check.frames:>10}')
    print(f'{"with two straight lines":28}{found:>10}')
    if check.refused:
        print(f'{"that cannot be used":28}{len(check.refused):>10}  first: {check.refused[0]}')
    if found < LEAST_FRAMES:
        print(f'picture: {out}')
        print('gip: too few frames show two straight lane lines that are 2 m apart; choose a '
              'straight part of the drive, or increase birdseye.half_width', file=sys.stderr)
        return 1
    excess, error = check.excess, check.error
    side = 'large' if excess >= 0.0 else 'small'
    print(f'{f"camera.pitch too {side} by":28}{math.degrees(abs(excess)):>10.3f}  deg '
          f'(standard error {math.degrees(error):.3f})')
    print(f'{"estimated camera.pitch":28}{pitch - excess:>10.5f}  rad')
    print(f'picture: {out}')
    if abs(excess) > BOUND + 2.0 * error:
        print('gip: the lane lines are not parallel: correct camera.pitch, or camera.z and the '
              'lens if the grid in the picture does not fit the road; with a map and known '
              'poses gip calibrate estimates the mounting pose', file=sys.stderr)
        return 1
    return 0
