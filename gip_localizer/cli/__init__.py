# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
The desk tool `gip`: one module per verb, each with `add_parser` and `run`.

The modules of verbs import large packages inside `run`, so that `gip --help` is fast.

"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
import sys

from gip_localizer import __version__
from gip_localizer.cli import (
    bench,
    build_map,
    calibrate,
    check_calibration,
    compare,
    demo,
    doctor,
    evaluate,
    import_folder,
    paper,
    params,
    replay,
    simulate,
    suggest,
)
from gip_localizer.cli.examples import add_examples
from gip_localizer.core.threads import use_one_library_thread
from gip_localizer.errors import GipError

VERBS = (
    demo, doctor, simulate, import_folder, replay, compare, build_map, calibrate,
    check_calibration, suggest, evaluate, paper, params, bench,
)
INTERRUPTED = 130
"""Exit status after Ctrl-C: 128 plus the number of SIGINT, as shells report it."""
LONG_NAME = 200
"""Number of characters of a file name after which a message shortens it; chosen."""

use_one_library_thread()  # must be set before NumPy is imported, which the verbs do


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of `gip` with all verbs."""
    parser = argparse.ArgumentParser(
        prog='gip', description='Camera localization on a road map: the desk tool.'
    )
    parser.add_argument('--version', action='version', version=f'gip_localizer {__version__}')
    verbs = parser.add_subparsers(title='verbs', metavar='VERB', required=True)
    for verb in VERBS:
        verb.add_parser(verbs)
    add_examples(verbs.choices)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """
    Run a verb.

    Parameters
    ----------
    argv : sequence of str or None
        Arguments after the program name; None takes those of the process.

    Returns
    -------
    int
        0 on success; 1 on an error that the user can correct or on a missed bound; 130 on Ctrl-C.

    """
    args = build_parser().parse_args(argv)
    try:
        return int(args.run(args))
    except GipError as error:
        print(f'gip: {error}', file=sys.stderr)
        return 1
    except BrokenPipeError:
        sys.stderr.close()
        return 1
    except OSError as error:
        if error.strerror is None:
            raise
        print(f'gip: {_shortened(error.filename)}{error.strerror}', file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print('gip: stopped', file=sys.stderr)
        return INTERRUPTED


def _shortened(name: object) -> str:
    """Return a file name for a message, with a colon; an empty string if there is none."""
    if name is None:
        return ''
    words = str(name)
    return f'{words if len(words) <= LONG_NAME else words[:LONG_NAME] + "…"}: '
