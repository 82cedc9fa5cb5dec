# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The probability that a match is right: fitted to kept trials, and what alone decides."""

from dataclasses import replace
import math

from camera_samples import make_camera
import numpy as np
import pytest

from gip_localizer.core.belief import Belief
from gip_localizer.core.confidence import confidence
from gip_localizer.core.confidence_terms import OFFSET, TERMS
from gip_localizer.core.estimate import Status
from gip_localizer.core.integrity import below, judge
from gip_localizer.core.localizer import Localizer
from gip_localizer.core.pose import Pose2
from gip_localizer.evaluation.confidence import trials
from gip_localizer.evaluation.confidence.__main__ import main, terms_module
from gip_localizer.evaluation.confidence.chart import reliability
from gip_localizer.evaluation.confidence.fit import Design, regress, Regression, select, SENSES
from gip_localizer.evaluation.suites.conditions import TILES
from gip_localizer.parameters import Parameters

S = 1_000_000_000
CAMERA = make_camera('plumb_bob')
PARAMETERS = Parameters.from_dict({
    'birdseye.near': 3.0, 'birdseye.far': 9.0, 'birdseye.half_width': 3.0,
    'birdseye.resolution': 0.1, 'search.x': 0.4, 'search.y': 0.4, 'search.yaw': 0.03,
    'recovery.automatic': False,
})
TIGHT, WIDE = np.diag([0.1**2, 0.1**2, 0.01**2]), np.diag([0.16**2, 0.16**2, 0.01**2])
TURNING = np.diag([0.1**2, 0.1**2, 0.031**2])
PLACE = 0.1  # share of the lane's length


@pytest.fixture(scope='module')
def kept():
    return trials.read(trials.KEPT)


@pytest.fixture(scope='module')
def design(kept):
    return Design.of(kept)


def columns(design):
    return [design.names.index(term.figure) for term in TERMS]


def of(trial):
    return confidence(trial.figures, OFFSET, TERMS)


def test_the_core_holds_the_fit_to_the_kept_trials(design):
    fitted = regress(design, columns(design))
    assert fitted.offset == pytest.approx(OFFSET, rel=0.01)
    assert [term.figure for term in fitted.terms] == [term.figure for term in TERMS]
    np.testing.assert_allclose(
        [term[1:] for term in fitted.terms], [term[1:] for term in TERMS], rtol=0.01
    )


def test_each_figure_that_is_taken_earns_its_place_and_no_other_does(design):
    taken = columns(design)
    loss = design.loss(design.left_out(taken))
    for column in range(len(design.names)):
        if column in taken:
            without = design.loss(design.left_out([c for c in taken if c != column]))
            assert without > loss, design.names[column]
        else:
            more = design.loss(design.left_out([*taken, column]))
            assert more > 0.98 * loss, design.names[column]


def test_no_wrong_match_is_believed_by_a_fit_without_its_part_and_nearly_all_right_ones_are(
    design
):
    odds = design.left_out(columns(design))
    least = Parameters().integrity.min_confidence
    believed = odds >= math.log(least / (1.0 - least))
    assert not believed[~design.right].any()
    assert believed[design.right].mean() > 0.9


def test_parts_that_were_left_out_are_told_apart_all_the_same(design):
    bins = reliability(design, design.left_out(columns(design)))
    assert sum(b.right + b.wrong for b in bins) == len(design.right)
    assert bins[-1].found > 0.98
    assert bins[0].found < 0.02


@pytest.mark.parametrize('term', TERMS, ids=lambda term: term.figure)
def test_more_of_a_figure_speaks_in_its_sense(term):
    middle = {t.figure: math.sqrt(t.low * t.high) for t in TERMS}
    low, high = (confidence({**middle, term.figure: v}, OFFSET, TERMS)
                 for v in (term.low, term.high))
    assert (high - low) * SENSES[term.figure] > 0.0
    beyond = confidence({**middle, term.figure: 10.0 * term.high}, OFFSET, TERMS)
    assert beyond == high


def test_a_figure_that_is_no_number_is_no_evidence():
    figures = {term.figure: term.high for term in TERMS}
    assert not confidence({**figures, TERMS[0].figure: math.nan}, OFFSET, TERMS) >= 0.5


def test_a_fit_finds_the_figure_that_tells():
    rng = np.random.default_rng(1)
    made = []
    for index in range(400):
        figures = {name: float(rng.uniform(0.5, 2.0)) for name in trials.FIGURES}
        odds = 4.0 * math.log(figures['margin'])
        right = bool(rng.uniform() < 1.0 / (1.0 + math.exp(-odds)))
        made.append(trials.ConfidenceTrial(f'part {index % 4}', 1, 'right', right, figures))
    design = Design.of(made)
    assert [design.names[column] for column in select(design)] == ['margin']
    assert design.fitted([0])[1] == pytest.approx(4.0, abs=1.0)
    bins = reliability(design, design.left_out([0]))
    assert all(abs(b.expected - b.found) < 0.2 for b in bins if b.right + b.wrong > 40)


def test_trials_are_kept_as_they_are_made(tmp_path):
    made = list(trials.make_trials(replace(TILES, name='tiles'), 5_100_099))
    assert {trial.start for trial in made} >= {'right', 'another street'}
    assert all(trial.right for trial in made if trial.start == 'right')
    trials.write(tmp_path / 'trials.csv', made)
    read = trials.read(tmp_path / 'trials.csv')
    for one, other in zip(made, read, strict=True):
        assert (one.part, one.start, one.right) == (other.part, other.start, other.right)
        assert other.figures == pytest.approx(one.figures, rel=1e-3)


def test_the_module_of_the_core_is_what_the_command_writes():
    text = terms_module(Regression(OFFSET, TERMS))
    held = {}
    exec(compile(text, 'terms', 'exec'), held)
    assert (held['OFFSET'], held['TERMS']) == (OFFSET, TERMS)


def test_the_command_prints_the_figures(capsys, monkeypatch):
    taken = tuple(trials.FIGURES.index(term.figure) for term in TERMS)
    monkeypatch.setattr('gip_localizer.evaluation.confidence.__main__.select', lambda _: taken)
    assert main([]) == 0
    said = capsys.readouterr().out
    assert all(term.figure in said for term in TERMS)
    assert 'share right' in said


@pytest.fixture(scope='module')
def search(road):
    """Match and search of a frame, as the localizer hands them to its judge."""
    caught = []

    def catch(match, found, parameters, prior=None):
        caught.append((match, found))
        return judge(match, found, parameters, prior=prior)

    pose = road.pose(PLACE)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr('gip_localizer.core.judged_search.judge', catch)
        localizer = Localizer(road.map, PARAMETERS)
        localizer.set_prior(0, pose, WIDE)
        assert localizer.update(S, road.frame(CAMERA, pose), CAMERA).published
    return caught[-1]


def changed(found, **changes):
    """Return a search whose best fit has other figures."""
    best, *others = found.fits
    return replace(found, fits=[replace(best, **changes), *others])


def test_a_match_is_withheld_by_its_confidence(search):
    verdict = judge(search[0], doubtful(search, 0.89), PARAMETERS)
    assert verdict.status is Status.NO_MATCH
    assert 'integrity.min_confidence 0.9' in verdict.reason
    assert all(term.figure in verdict.reason for term in TERMS)


def test_a_first_match_needs_a_margin(search):
    match, found = search
    score = found.fits[0].fit_score / found.fits[0].agreement
    for margin, status in ((0.38, Status.NO_MATCH), (0.39, Status.TRACKING)):
        alone = replace(found, fits=[replace(found.fits[0], agreement=margin / score)])
        parameters = Parameters.from_dict({'integrity.min_confidence': 0.5})
        verdict = judge(match, alone, parameters)
        assert verdict.status is status, verdict.reason


def test_a_place_that_is_nearly_as_good_makes_it_ambiguous(search):
    match, found = search
    best = found.fits[0]
    parameters = Parameters.from_dict({'integrity.min_confidence': 0.0})
    for likeness, status in ((0.72, Status.TRACKING), (0.74, Status.AMBIGUOUS)):
        elsewhere = replace(best, pose=best.pose @ Pose2(0.3, 0.0, 0.0),
                            agreement=likeness * best.agreement)
        verdict = judge(match, replace(found, fits=[best, elsewhere]), parameters)
        assert verdict.status is status, verdict.reason


def test_an_equal_place_makes_it_ambiguous(search):
    match, found = search
    best = found.fits[0]
    elsewhere = replace(best, pose=best.pose @ Pose2(0.3, 0.0, 0.0))
    verdict = judge(match, replace(found, fits=[best, elsewhere]), PARAMETERS)
    assert verdict.status is Status.AMBIGUOUS
    assert verdict.quality['competitor'] == pytest.approx(1.0)
    near = replace(best, pose=best.pose @ Pose2(0.1, 0.0, 0.0))
    same = judge(match, replace(found, fits=[best, near]), PARAMETERS)
    assert same.status is Status.TRACKING


def test_a_fit_that_did_not_converge_is_withheld(search):
    match, found = search
    verdict = judge(match, changed(found, converged=False), PARAMETERS)
    assert verdict.status is Status.NO_MATCH
    assert 'converge' in verdict.reason


def test_a_match_outside_the_window_is_withheld(search):
    match, found = search
    lattice = found.scores.lattice
    for beyond, status in ((0.04, Status.TRACKING), (0.06, Status.NO_MATCH)):
        edge = lattice.anchor @ Pose2(lattice.half[0] * lattice.step + beyond, 0.0, 0.0)
        alone = replace(found, fits=[replace(found.fits[0], pose=edge)])
        assert judge(match, alone, PARAMETERS).status is status


def doubtful(search, least):
    """Return the search with so little agreement that its confidence is just below a figure."""
    match, found = search
    return next(
        less for share in np.geomspace(1.0, 1e-3, 700)
        for less in [changed(found, agreement=share)]
        if judge(match, less, PARAMETERS).quality['confidence'] < least
    )


HERE = Pose2(0.0, 0.0, 0.0)


@pytest.mark.parametrize(('least', 'covariance', 'off', 'believed'), [
    (0.94, None, HERE, False), (0.94, WIDE, HERE, False), (0.94, TURNING, HERE, False),
    (0.94, TIGHT, HERE, True), (0.5, TIGHT, HERE, True), (0.34, TIGHT, HERE, False),
    (0.5, TIGHT, Pose2(0.34, 0.0, 0.0), True), (0.5, TIGHT, Pose2(0.36, 0.0, 0.0), False),
    (0.5, TIGHT, Pose2(0.0, 0.0, 0.039), True), (0.5, TIGHT, Pose2(0.0, 0.0, 0.041), False),
])
def test_less_confidence_is_enough_where_a_tight_prior_expects_the_match(
    search, least, covariance, off, believed
):
    found = doubtful(search, least)
    prior = None
    if covariance is not None:
        pose = found.fits[0].pose
        there = Pose2(pose.x + off.x, pose.y + off.y, pose.yaw + off.yaw)
        prior = Belief(S, there, covariance)
    verdict = judge(search[0], found, PARAMETERS, prior=prior)
    assert (verdict.status is Status.TRACKING) == believed, verdict.reason


@pytest.mark.parametrize(('value', 'limit', 'text'), [
    (0.5, 0.9, '0.50'), (0.899, 0.9, '0.899'), (0.99985, 0.9999, '0.99985'),
    (0.89999999, 0.9, '0.900000'),
])
def test_a_confidence_below_its_limit_is_printed_below_it(value, limit, text):
    assert below(value, limit) == text
