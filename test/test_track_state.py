# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import numpy as np

from gip_localizer.core.belief import Belief
from gip_localizer.core.pose import Pose2
from gip_localizer.core.refine.error_level import ErrorLevel
from gip_localizer.core.track.track_state import Phase, TrackState
from gip_localizer.parameters import Parameters

S = 1_000_000_000
SHARP = np.diag([0.01**2, 0.01**2, 0.001**2])
PARAMETERS = Parameters.from_dict({'integrity.lost_after': 2, 'recovery.confirm_frames': 2})


def match(seconds: int) -> Belief:
    return Belief(seconds * S, Pose2(1.0, 2.0, 0.5), SHARP)


def test_the_state_machine_passes_through_its_phases():
    state = TrackState(PARAMETERS)
    assert state.phase is Phase.UNINITIALIZED
    state.start_from(match(0))
    assert state.phase is Phase.INITIALIZED
    state.accept(state.predict(S), match(1), gain=0.8, error_level=ErrorLevel())
    assert state.phase is Phase.TRACKING
    for seconds in (2, 3):
        state.miss(state.predict(seconds * S))
    assert state.phase is Phase.LOST
    state.request_search()
    assert state.phase is Phase.RELOCALIZING
    assert state.search_due(4 * S)
    state.searched(4 * S)
    state.accept(state.predict(4 * S), match(4), gain=0.8, error_level=ErrorLevel())
    assert state.phase is Phase.CONFIRMING
    state.accept(state.predict(5 * S), match(5), gain=0.8, error_level=ErrorLevel())
    assert state.phase is Phase.TRACKING


def test_the_state_prints_phase_belief_gain_and_time_order():
    state = TrackState(PARAMETERS)
    assert str(state) == (
        'uninitialized (misses 0, unconfirmed 0); no belief; gain unknown; no frame yet'
    )
    state.start_from(match(0))
    assert state.take_stamp(S) == ''
    state.accept(state.predict(S), match(1), gain=0.8, error_level=ErrorLevel())
    for words in ('tracking', '(1.000 m, 2.000 m, 0.5000 rad)', 'gain 0.800', f'frame {S} ns'):
        assert words in str(state)


def test_a_new_prior_forgets_the_gain_and_the_time_order():
    state = TrackState(PARAMETERS)
    assert state.take_stamp(9 * S) == ''
    state.accept(None, match(9), gain=0.8, error_level=ErrorLevel())
    state.start_from(match(1))
    assert state.gain is None
    assert state.take_stamp(S) == ''
