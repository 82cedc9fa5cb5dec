# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""`gip simulate`: record a synthetic drive as a bag, with its map and parameters."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from gip_localizer.parameters.yaml_files import user_path

DEFAULT_OUT = Path('results/simulated')
MARK = 'metadata.yaml'


def add_parser(verbs: Any) -> None:
    """Add the verb to the parser of `gip`."""
    parser = verbs.add_parser(
        'simulate', help='record a synthetic drive as a bag, with map and parameters',
        description='Write a rosbag2 folder (MCAP) with map.yaml, params.yaml and ground truth. '
                    'Replay it with: gip replay DIR',
    )
    parser.add_argument('--scenario', default='clear', metavar='NAME',
                        help='conditions; an unknown name prints the list (default: clear)')
    parser.add_argument('--seconds', type=float, default=20.0, metavar='S',
                        help='length of the drive (default: 20)')
    parser.add_argument('--rate', type=float, metavar='HZ', help='images per second')
    parser.add_argument('--seed', type=int, metavar='N',
                        help='seed of noise, odometry, traffic and weather')
    parser.add_argument('--transport', choices=('raw', 'jpeg', 'png'), default='raw',
                        help='format of the recorded images (default: raw)')
    parser.add_argument('--quality', type=int, default=90, metavar='1-100',
                        help='quality of jpeg images (default: 90)')
    parser.add_argument('--params', type=user_path, metavar='FILE',
                        help='ROS parameter YAML of the synthetic camera')
    parser.add_argument('--set', action='append', default=[], metavar='NAME=VALUE',
                        dest='settings', help='one parameter of the synthetic camera; repeatable')
    parser.add_argument('--out', type=user_path, default=DEFAULT_OUT, metavar='DIR',
                        help=f'folder to write (default: {DEFAULT_OUT})')
    parser.add_argument('--force', action='store_true', help='replace an existing bag in --out')
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Write the bag folder."""
    from gip_localizer.cli.progress import progress
    from gip_localizer.io.output_folder import check_folder, fresh_folder
    from gip_localizer.synthetic.drive import SyntheticDrive
    from gip_localizer.synthetic.recording import START_NS, write_drive

    parameters = _parameters(args)
    check_folder(args.out, force=args.force, mark=MARK)
    drive = SyntheticDrive(parameters, start_ns=START_NS)
    total = int(min(args.seconds, drive.motion.duration) * parameters.rate)
    with (
        fresh_folder(args.out, force=args.force, mark=MARK) as folder,
        progress(total, 'rendering') as bar,
    ):
        write_drive(folder, drive, seconds=args.seconds, transport=args.transport,
                    quality=args.quality, on_frame=bar.update)
    size = sum(path.stat().st_size for path in args.out.iterdir())
    print(f'{args.out}: {size / 1e6:.1f} MB; localize it with: gip replay {args.out}')
    return 0


def _parameters(args: argparse.Namespace) -> Any:
    from gip_localizer.cli.settings import parse_settings
    from gip_localizer.errors import ParameterError
    from gip_localizer.parameters.ros_yaml import load_ros_yaml
    from gip_localizer.synthetic.parameters import SyntheticCameraParameters
    from gip_localizer.synthetic.scenarios import scenario_parameters

    if not args.seconds > 0.0:
        raise ParameterError(f'--seconds {args.seconds:g}: expected more than 0')
    if not 1 <= args.quality <= 100:
        raise ParameterError(f'--quality {args.quality}: expected 1 to 100')
    values: dict[str, object] = {}
    if args.params is not None:
        values |= load_ros_yaml(args.params)
    values |= parse_settings(args.settings, SyntheticCameraParameters)
    if args.rate is not None:
        values['rate'] = args.rate
    if args.seed is not None:
        values['seed'] = args.seed
    return scenario_parameters(args.scenario, values)
