# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Each rule of the diagnostics: it holds when its table says so, and not otherwise."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from gip_localizer.core.estimate import Estimate, Status
from gip_localizer.core.pose import Pose2
from gip_localizer.core.protection import PROTECTION
from gip_localizer.parameters.integration import Diagnostics
from gip_localizer.session.diagnostic_rules import DIAGNOSTIC_GROUPS, rule_of
from gip_localizer.session.diagnostic_types import Severity
from gip_localizer.session.diagnostics import HealthMonitor
from gip_localizer.session.frame_timing import TIMED_FRAMES

SECOND = 1_000_000_000
GOOD = Estimate(SECOND, Status.TRACKING, 'well', Pose2(0.0, 0.0, 0.0), np.eye(3))


@dataclass
class Steady:
    now: float = 100.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def steady():
    return Steady()


@pytest.fixture
def health(steady):
    """A node that is well: camera_info, odometry and a localized image have just come."""
    health = HealthMonitor(Diagnostics(), steady=steady)
    health.update_inputs({}, {'camera_info': 1, 'odom': 1})
    health.on_odometry()
    health.on_image(SECOND, SECOND)
    health.frame_finished(GOOD, 5.0)
    return health


def rules(health):
    return {report.rule.name for report in health.reports() if report.rule is not None}


def report(health, group):
    [found] = [r for r in health.reports() if r.group.name == group]
    return found


def test_all_is_well_where_all_comes(health):
    assert rules(health) == set()
    assert {r.level for r in health.reports()} == {Severity.OK}
    assert report(health, 'output').message == 'OK: TRACKING: well'


def test_at_the_start_each_concern_says_what_it_waits_for(steady):
    fresh = HealthMonitor(Diagnostics(), steady=steady)
    assert rules(fresh) == {'NO_IMAGE_YET', 'NO_CAMERA_INFO_YET', 'WAITING'}


@pytest.mark.parametrize('status', [s for s in Status if s is not Status.TRACKING])
def test_each_status_has_a_rule_that_withholds_and_is_named_by_the_output(health, status):
    health.frame_finished(Estimate(SECOND, status, 'because'), 5.0)
    found = rule_of(str(status))
    assert found is not None
    group, rule = found
    assert rule.withheld
    assert report(health, group.name).message == f'{status}: because'
    assert report(health, 'output').message == f'WITHHELD: {status}: because'
    assert report(health, 'output').level is Severity.ERROR


def test_a_silent_camera_is_an_error_and_withholds(health, steady):
    steady.now += 1.5
    assert report(health, 'camera').message == 'NO_IMAGE: for 1.5 s; is image remapped?'
    assert report(health, 'output').rule.name == 'WITHHELD'
    health.on_image(2 * SECOND, 2 * SECOND)
    assert 'NO_IMAGE' not in rules(health)


def test_what_is_not_heard_during_a_long_frame_is_not_taken_for_silence(health, steady):
    health.simulated = True
    health.on_clock(SECOND)
    health.on_image(2 * SECOND, 2 * SECOND)
    steady.now += 5.0
    health.frame_finished(GOOD, 5000.0)
    assert rules(health) == set()
    steady.now += 1.1
    assert report(health, 'camera').message == (
        'CLOCK_STOPPED: for 1.1 s; is /clock published?; NO_IMAGE: for 1.1 s; is image remapped?'
    )
    assert report(health, 'odometry').message == 'ODOMETRY_STALE: none for 1.1 s'


@pytest.mark.parametrize(('delay_s', 'rule'), [
    (0.6, 'LATE_FRAMES'), (-0.2, 'FUTURE_STAMPS'), (0.4, None), (-0.05, None),
])  # fmt: skip
def test_stamps_far_from_the_clock_are_told_but_do_not_withhold(health, delay_s, rule):
    health.on_image(2 * SECOND, 2 * SECOND + round(delay_s * SECOND))
    assert rules(health) == ({rule} if rule else set())


def test_stamps_that_go_back_are_told_for_ten_seconds(health, steady):
    health.on_image(10 * SECOND, 10 * SECOND)
    health.on_image(3 * SECOND, 3 * SECOND)
    assert report(health, 'camera').level is Severity.OK  # a single stamp may be wrong
    health.on_time_jump(7.0)
    assert report(health, 'camera').message == 'TIME_WENT_BACK: by 7.000 s'
    steady.now += 10.5
    health.on_image(4 * SECOND, 4 * SECOND)
    assert report(health, 'camera').level is Severity.OK


def test_a_search_is_told_while_it_lasts(health, steady):
    health.frame_started(search=True)
    steady.now += 2.0
    assert report(health, 'match').message == 'SEARCHING: for 2.0 s'
    assert report(health, 'output').message == 'WITHHELD: SEARCHING: for 2.0 s'
    assert report(health, 'camera').level is Severity.OK  # images wait
    health.frame_finished(Estimate(SECOND, Status.CONFIRMING, 'found'), 2000.0)
    assert not rules(health) & {'SEARCHING', 'NO_IMAGE'}


def test_a_clock_that_stands_is_told_under_simulated_time_only(health, steady):
    for simulated in (False, True):
        health.simulated = simulated
        health.on_clock(SECOND)
        steady.now += 1.2
        health.on_clock(SECOND)
        health.on_image(SECOND + 1, SECOND)
        assert ('CLOCK_STOPPED' in rules(health)) == simulated


def test_odometry_that_stops_or_is_refused_is_told(health, steady):
    counts = {'camera_info': 1, 'odom': 2, 'odom_refused': 1}
    health.update_inputs({'odom': 'odometry jumped 9 m'}, counts)
    assert report(health, 'odometry').message == 'ODOMETRY_REFUSED: odometry jumped 9 m'
    steady.now += 1.1
    health.on_image(2 * SECOND, 2 * SECOND)
    assert report(health, 'odometry').message.endswith('m; ODOMETRY_STALE: none for 1.1 s')


def test_a_refusal_is_remembered_for_ten_seconds_after_good_messages_follow(health, steady):
    counts = {'camera_info': 1, 'initialpose': 1, 'initialpose_refused': 1}
    health.update_inputs({'initialpose': 'of the moon'}, counts)
    health.update_inputs({}, counts)
    assert report(health, 'prior').message == 'INITIALPOSE_REFUSED: of the moon'
    steady.now += 10.5
    assert report(health, 'prior').level is Severity.OK


def test_slow_is_a_median_above_the_time_between_images(health):
    for n in range(2, TIMED_FRAMES + 2):
        health.on_image(n * SECOND // 10, n * SECOND // 10)
        health.frame_finished(GOOD, 120.0)
    assert report(health, 'match').message == 'SLOW: 120 ms per frame, one image every 100 ms'


def test_a_protection_level_above_its_alert_limit_is_reported(health):
    level = dict.fromkeys(PROTECTION, 0.5)
    health.frame_finished(replace(GOOD, quality={**level, 'protection_valid': 0.0}), 5.0)
    assert rules(health) == {'ALERT_LIMIT'}
    assert 'protection_left_m 0.5' in report(health, 'output').message
    health.frame_finished(replace(GOOD, quality={**level, 'protection_valid': 1.0}), 5.0)
    assert rules(health) == set()


def test_disabled_outdoes_all_else_on_the_output(health):
    health.frame_finished(Estimate(SECOND, Status.LOST, 'no fix'), 5.0)
    health.enabled = False
    assert report(health, 'output').rule.name == 'DISABLED'


def test_figures_are_those_of_the_table(health):
    for found in health.reports():
        assert set(found.figures) <= set(found.group.figures)
    assert report(health, 'output').figures['availability'] == '1.0000'
    assert report(health, 'camera').figures['frames'] == '1'


def test_rule_names_are_unique():
    names = [str(rule.name) for group in DIAGNOSTIC_GROUPS for rule in group.rules]
    assert len(names) == len(set(names))


def test_a_refused_initialpose_stays_visible_until_a_good_one_comes(health, steady):
    counts = {'camera_info': 1, 'initialpose_refused': 1}
    health.update_inputs({'initialpose': 'of another frame'}, counts)
    steady.now += 3600.0
    assert 'INITIALPOSE_REFUSED' in rules_of(health, 'prior')
    health.update_inputs({}, {'camera_info': 1, 'odom': 1})
    steady.now += 10.0
    assert rules_of(health, 'prior') == []


def test_images_ahead_of_the_first_word_of_a_simulated_clock_are_not_of_the_future(health):
    health.on_image(5000 * SECOND, 0)
    assert 'FUTURE_STAMPS' not in rules_of(health, 'camera')


def rules_of(health, group):
    return [rule.name for rule in report(health, group).rules]
