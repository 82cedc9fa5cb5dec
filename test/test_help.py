# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""`--help` of every verb: it describes, and ends with examples that the parser accepts."""

from __future__ import annotations

import re
import shlex

import pytest

from gip_localizer.cli import build_parser
from gip_localizer.cli.examples import EXAMPLES
from gip_localizer.synthetic.scenarios import SCENARIOS

PARSERS = next(action.choices for action in build_parser()._actions
               if isinstance(action.choices, dict))


@pytest.mark.parametrize('verb', sorted(PARSERS))
def test_every_verb_is_described_and_shows_examples(verb):
    text = ' '.join(PARSERS[verb].format_help().split())
    assert PARSERS[verb].description, verb
    assert f'examples: gip {verb}' in text


@pytest.mark.parametrize('verb', sorted(EXAMPLES))
def test_the_examples_are_understood(verb):
    for line in EXAMPLES[verb].splitlines():
        if not line.startswith('  gip '):
            continue
        command = re.split(r' {2,}| > ', line.strip())[0]
        build_parser().parse_args(shlex.split(command)[1:])


def test_simulate_names_every_scenario():
    named = EXAMPLES['simulate'].split('scenarios:')[1].replace('\n', ' ')
    assert [name.strip() for name in named.split(',')] == list(SCENARIOS)
