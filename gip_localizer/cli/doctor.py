# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""`gip doctor`: check this machine, or a running stack, and say what to do."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager
import signal
import sys
from typing import Any, TYPE_CHECKING

from gip_localizer.cli.settings import ctrl_c
from gip_localizer.parameters.yaml_files import user_path

if TYPE_CHECKING:
    from gip_localizer.ros.doctor.check import Check

LOOP_SECONDS = 12.0
"""Longest time of the loop, seconds; the other checks and the end take 2 to 3 s."""
EXAMPLES = """examples:
  gip doctor                           this machine, with a short loop of camera, node, observer
  gip doctor --no-loop                 this machine, without the loop (2 s)
  gip doctor --topics                  the stack that runs now: topics, rates, QoS, clock, map
  gip doctor --topics --params my.yaml --image-topic /front/image_raw
                                       the same before the localizer is started
The exit status is 0 if every check is passed, else 1.
"""


def add_parser(verbs: Any) -> None:
    """Add the verb to the parser of `gip`."""
    parser = verbs.add_parser(
        'doctor', help='check this machine, or a running stack, and say what to do',
        description='Check this machine in at most 15 s, or with --topics a running stack. Each '
                    'check is PASS or FAIL with a remedy.',
        epilog=EXAMPLES, formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument('--no-loop', action='store_true',
                        help='leave out the loop of camera, node and observer over DDS')
    stack = parser.add_argument_group('a running stack')
    stack.add_argument('--topics', action='store_true',
                       help='check the topics of the graph that ROS_DOMAIN_ID names')
    stack.add_argument('--params', type=user_path, metavar='FILE',
                       help='ROS parameter YAML (default: the parameters of the running node)')
    stack.add_argument('--node', metavar='NAME', help='the localizer (default: the only one)')
    stack.add_argument('--image-topic', metavar='TOPIC',
                       help='default: that of the node, or /image')
    stack.add_argument('--camera-info-topic', metavar='TOPIC')
    stack.add_argument('--odom-topic', metavar='TOPIC')
    stack.add_argument('--seconds', type=float, default=5.0,
                       help='how long to listen (default: %(default)s)')
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Make the checks, print each as it is done, and return 0 if all are passed."""
    from gip_localizer.ros.doctor.check import summary_line

    # A plain `kill` must end the children too, as Ctrl-C does.
    for request in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(request, lambda number, _: sys.exit(128 + number))
    with ctrl_c(interrupts=True):
        checks = []
        for check in _stack(args) if args.topics else _machine(args):
            print(check.lines(), flush=True)
            checks.append(check)
    print(summary_line(checks))
    return 0 if all(check.passed for check in checks) else 1


def _machine(args: argparse.Namespace) -> Iterator[Check]:
    from gip_localizer.ros.doctor.check import Check
    from gip_localizer.ros.doctor.environment import environment_checks

    passed = {}
    for make in environment_checks():
        check = make()
        passed[check.name] = check.passed
        yield check
    if args.no_loop:
        return
    if not all(passed[name] for name in ('libraries', 'packages', 'ROS', 'middleware')):
        yield Check('loop', 'not run', 'follow the remedies above first')
        return
    from gip_localizer.ros.doctor.loop import loop_check

    with _progress('loop', LOOP_SECONDS) as shown:
        yield loop_check(LOOP_SECONDS, shown)


def _stack(args: argparse.Namespace) -> Iterator[Check]:
    from gip_localizer.ros.doctor.environment import middleware, rclpy_and_messages

    for check in (rclpy_and_messages(), middleware()):
        yield check
        if not check.passed:
            return
    from gip_localizer.ros.doctor.listener import observed
    from gip_localizer.ros.doctor.observed import Asked
    from gip_localizer.ros.doctor.stack import stack_checks

    asked = Asked(args.params, args.node, args.seconds, {
        'image': args.image_topic, 'camera_info': args.camera_info_topic, 'odom': args.odom_topic,
    })  # fmt: skip
    with _progress('listening', args.seconds) as shown:
        seen = observed(asked, shown)
    yield from stack_checks(seen)


@contextmanager
def _progress(what: str, seconds: float) -> Iterator[Callable[[float], object]]:
    """Show a bar on a terminal while something takes seconds."""
    from gip_localizer.cli.progress import progress

    form = '{desc} {percentage:3.0f}%|{bar:20}| {elapsed}'
    with progress(seconds, what, bar_format=form, leave=False) as bar:
        yield lambda elapsed: bar.update(min(elapsed, seconds) - bar.n)
