# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Which constants `make sensitivity` changes, and how."""

from __future__ import annotations

import pytest

from gip_localizer.core.refine import stages
from gip_localizer.evaluation.sensitivity import constants, is_number, scaled


def test_it_finds_the_numbers_with_the_sentences_above_them():
    found = {(c.module.__name__, c.name): c for c in constants()}
    assert len(found) > 50
    blocks = found[stages.__name__, 'BLOCK_SIDES']
    assert blocks.value == stages.BLOCK_SIDES
    assert blocks.meaning
    assert not any(c.meaning == '' for c in found.values()), [
        name for name, c in found.items() if not c.meaning
    ]


@pytest.mark.parametrize(('value', 'factor', 'wanted'), [
    (2.0, 0.7, 1.4), (10, 1.4, 14), (1, 0.7, 2), (2, 0.7, 1), ((1.0, 10), 0.7, (0.7, 7)),
    (-40.0, 1.4, -56.0),
])
def test_numbers_and_tuples_are_scaled_and_integers_change_by_one_at_least(value, factor, wanted):
    assert scaled(value, factor) == pytest.approx(wanted)


def test_flags_and_words_are_no_numbers():
    assert is_number(1.0)
    assert is_number((1, (2.0, 3)))
    assert not is_number(True)
    assert not is_number('x')
    assert not is_number(())
