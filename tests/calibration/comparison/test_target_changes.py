"""Several targets in two campaigns: one that moved on the flange is named, all that moved together
are told as that, and what cannot be told apart is told together.

Targets, arms, moves and noise are drawn from the test's stream, and measured on the exact chain."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest
from builders import drawn, planted

from modelsel._typing import Array
from modelsel.calibration.calibration import Calibration, calibrate
from modelsel.calibration.comparison.campaigns import Comparison, compare_campaigns
from modelsel.calibration.comparison.comparison_sentences import describe_comparison
from modelsel.calibration.comparison.difference_tests import SIGNIFICANCE_TOGETHER
from modelsel.calibration.comparison.fewest_terms import select_fewest_terms
from modelsel.fitting.design import Model
from modelsel.fitting.least_squares import fit
from modelsel.fitting.noise import Floor
from modelsel.fitting.whitening import Whitening
from modelsel.mechanisms.geometry import build_setup
from modelsel.mechanisms.registry import mechanism
from modelsel.report.comparison_page import _write_parameters
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import forward
from modelsel.robot.rigid import from_rpy
from modelsel.selection.evaluation import Split
from modelsel.setup.registration import register

NOISE = 0.02
ROBOT = load_robot("puma760")
GEOMETRY = mechanism("geometric", ROBOT)
CONFIGURATIONS = 60


@dataclass(frozen=True, eq=False)
class Bench:
    """An arm with errors of its geometry, where targets are said to sit, and where they do."""

    tools: Array
    actual: Array
    theta: Array
    names: Sequence[str]

    def moved(self, by: Array) -> Bench:
        """The same with its targets moved on the flange."""
        return replace(self, actual=self.actual + by)

    def bent(self, symbol: str, by: float) -> Bench:
        """The same with another error of its geometry."""
        theta = self.theta.copy()
        theta[[term.symbol for term in GEOMETRY.terms].index(symbol)] += by
        return replace(self, theta=theta)

    def of(self, *places: int) -> Bench:
        """The same with these targets alone, in this order."""
        own = list(places)
        names = [self.names[k] for k in own]
        return replace(self, tools=self.tools[own], actual=self.actual[own], names=names)


def bench(rng: np.random.Generator, count: int) -> Bench:
    tools = rng.uniform(-80, 80, (count, 3)) + np.array([0, 0, 120])
    theta = [
        0.0 if term.screws[0].frame > ROBOT.n else rng.normal(0, 0.2 if term.unit == "mm" else 5e-4)
        for term in GEOMETRY.terms
    ]
    names = [f"ball{k + 1}" for k in range(count)]
    return Bench(tools, tools + rng.normal(0, 0.3, tools.shape), np.array(theta), names)


def campaign(
    rng: np.random.Generator, of: Bench, m: int = CONFIGURATIONS, registered: bool = False
) -> Calibration:
    """m configurations of every target, measured and fitted; where the set-up is registered, the
    tracker stands anywhere."""
    count = len(of.tools)
    at = drawn(ROBOT, rng, m * count, target=list(of.names) * m)
    at = replace(at, tools=of.actual, whitening=Whitening(1 / NOISE))
    nominal = replace(at.data, position=forward(ROBOT, at.data.q, at.tool))
    at = replace(planted(replace(at, data=nominal), GEOMETRY.terms, of.theta), tools=of.tools)
    position = at.data.position + rng.normal(0, NOISE, at.data.position.shape)
    if registered:
        position = position @ from_rpy(*rng.normal(0, 1, 3)).T + rng.normal(0, 500, 3)
    at = replace(at, data=replace(at.data, position=position))
    rows = np.ones(len(at), bool)
    if registered:
        at = register(at, rows, False)
    setup = build_setup(ROBOT, count, 1, registered, False)
    model = Model((setup, GEOMETRY) if setup.terms else (GEOMETRY,))
    split = Split(at, rows, ~rows, np.zeros(len(at), np.intp), True)
    floor = Floor(NOISE, "stated")
    return calibrate("bench", split, fit(at, model), floor, None, registered, {})


def compared(
    rng: np.random.Generator, before: Bench, after: Bench, registered: bool = False
) -> Comparison:
    first, second = (campaign(rng, one, registered=registered) for one in (before, after))
    return compare_campaigns(first, second)


def told(found: Comparison) -> list[tuple[str, ...]]:
    """What the difference is explained by: names of targets that moved alone, "together", symbols."""
    motions = [("together",) if one.together else one.targets for one in found.target_motions]
    return [*motions, *((one.symbol,) for one in found.explained_by)]


def anywhere(rng: np.random.Generator, size: float) -> Array:
    direction = rng.normal(size=3)
    return size * direction / np.linalg.norm(direction)


def only(place: int, by: Array, count: int) -> Array:
    """A move of one target among several."""
    moves = np.zeros((count, 3))
    moves[place] = by
    return moves


SETUPS = pytest.mark.parametrize("registered", [False, True], ids=["stands", "registered"])


def benches(count: int, setup: str) -> pytest.MarkDecorator:
    """Two, three and five targets in both set-ups, of which all but one are slow: each draws a dozen
    pairs of campaigns."""
    every = itertools.product((2, 3, 5), ("stands", "registered"))
    return pytest.mark.parametrize(
        ("count", "registered"),
        [
            pytest.param(
                targets,
                placed == "registered",
                id=f"{targets}-{placed}",
                marks=() if (targets, placed) == (count, setup) else pytest.mark.slow,
            )
            for targets, placed in every
        ],
    )


# -- what moved
# ------------------------------------------------------------------------------------------------


@pytest.mark.integration
@benches(3, "stands")
def test_one_target_of_several_that_moved_is_named(count, registered, rng) -> None:
    """Chance alone adds a further change to one in twenty; the size is told with its uncertainty."""
    right, z = 0, []
    for _ in range(16):
        before = bench(rng, count)
        place, size = rng.integers(count), rng.uniform(0.1, 3)
        after = before.moved(only(place, anywhere(rng, size), count))
        found = compared(rng, before, after, registered)
        assert (before.names[place],) in told(found)
        (motion,) = [m for m in found.target_motions if m.targets == (before.names[place],)]
        z.append((math.hypot(*motion.moved_mm[0]) - size) / motion.standard_errors[0])
        assert found.targets[place].p <= 0.05
        right += told(found) == [(before.names[place],)]
    assert right >= 13
    assert np.sqrt(np.mean(np.square(z))) < 2


@pytest.mark.integration
@benches(2, "stands")
def test_an_adapter_that_was_put_back_moves_all_together(count, registered, rng) -> None:
    right = 0
    for _ in range(12):
        before = bench(rng, count)
        turned = (before.actual - [0, 0, 50]) @ from_rpy(*rng.normal(0, 2e-3, 3)).T + [0, 0, 50]
        after = before.moved(turned - before.actual + rng.normal(0, 0.2, 3))
        found = compared(rng, before, after, registered)
        assert found.target_motions
        right += told(found) == [("together",)]
        sizes = np.linalg.norm(after.actual - before.actual, axis=1)
        (motion,) = [m for m in found.target_motions if m.together] or [None]
        if motion is not None:
            assert motion.targets == tuple(before.names)
            apart = np.linalg.norm(motion.moved_mm, axis=1) - sizes
            # the placement, and the last joint's zero, may take up a part of it
            assert np.abs(apart).max() < 0.05 or registered
    assert right >= 10


@pytest.mark.integration
def test_several_that_moved_each_on_its_own_are_named(rng) -> None:
    right = 0
    for _ in range(12):
        before = bench(rng, 4)
        moves = rng.normal(0, 0.2, (4, 3)) * [[1.0], [0.0], [1.0], [0.0]]
        found = compared(rng, before, before.moved(moves))
        assert {("ball1",), ("ball3",)} <= set(told(found))
        right += told(found) == [("ball1",), ("ball3",)]
    assert right >= 10


@pytest.mark.integration
def test_a_target_and_a_joint_are_both_found(rng) -> None:
    right = 0
    for _ in range(12):
        before = bench(rng, 3)
        symbol = rng.choice(["γ2", "γ3", "γ4", "α5"])
        after = before.moved(only(1, anywhere(rng, rng.uniform(0.1, 1)), 3))
        found = compared(rng, before, after.bent(symbol, 4e-4 * rng.choice([-1, 1])))
        assert ("ball2",) in told(found)
        (bent, *further) = found.explained_by
        names = [bent.label, *bent.alike]  # γ4 and α5 turn about one axis
        is_named = any(name.startswith(f"{symbol} ") for name in names)
        right += is_named and not further and len(found.target_motions) == 1
    assert right >= 10


@pytest.mark.slow
@SETUPS
@pytest.mark.parametrize("count", [2, 4])
def test_where_nothing_moved_nothing_is_told_at_the_stated_rate(count, registered, rng) -> None:
    """One comparison in twenty has a p below 0.05, over all parameters and targets one by one, and one in a
    hundred has one below 0.01 of all together."""
    alarms = together = 0
    for _ in range(150):
        before = bench(rng, count)
        found = compared(rng, before, before, registered)
        alone = bool(found.moved or found.moved_targets or found.targets_among_p <= 0.05)
        alarms += alone
        together += found.together_p <= SIGNIFICANCE_TOGETHER
        if not alone and found.together_p > SIGNIFICANCE_TOGETHER:
            assert not told(found)
    # 7.5 expected; 16 or more of 150 have a probability of 0.004
    assert alarms <= 15
    # 1.5 expected; 7 or more have a probability of 0.001
    assert together <= 6


@pytest.mark.slow
def test_a_move_that_would_have_been_told_is(rng) -> None:
    seen = 0
    for _ in range(40):
        before = bench(rng, 3)
        same = compared(rng, before, before)
        (least,) = {one.seen_mm for one in same.targets if one.target == "ball2"}
        after = before.moved(only(1, anywhere(rng, least), 3))
        seen += compared(rng, before, after).targets[1].p <= 0.05
    assert seen >= 32


# -- what cannot be told apart
# ------------------------------------------------------------------------------------------------


def test_a_shift_along_the_last_axis_may_be_the_last_link(rng) -> None:
    before = bench(rng, 3)
    found = compared(rng, before, before.moved(np.array([0, 0, 0.4])))
    assert told(found)[0] == ("c6",)
    (c6,) = [one for one in found.explained_by if one.symbol == "c6"]
    assert c6.alike == ("the place of all targets together on the flange",)
    said = describe_comparison(found)[0]
    assert said.startswith(
        "c6 (frame 6 tz), or equally well the place of all targets together on the flange, changed"
    )


def test_a_turn_about_the_last_axis_may_be_one_target_of_two(rng) -> None:
    """The other one sits on the axis, where no turn about it moves it."""
    tools = np.array([[0.0, 0.0, 100.0], [60.0, 0.0, 100.0]])
    before = replace(bench(rng, 2), tools=tools, actual=tools)
    found = compared(rng, before, before.moved(only(1, np.array([0, 0.3, 0]), 2)))
    (turn,) = [one for one in found.explained_by if one.symbol == "γ6"]
    assert 'the place of the target "ball2" on the flange' in turn.alike
    assert 'the place of the target "ball1" on the flange' not in turn.alike


def test_a_move_across_the_line_of_two_may_be_a_turn_of_both(rng) -> None:
    before = bench(rng, 2)
    line = before.tools[1] - before.tools[0]
    across = np.cross(line, rng.normal(size=3))
    found = compared(rng, before, before.moved(only(1, 0.3 * across / np.linalg.norm(across), 2)))
    motion = found.target_motions[0]
    assert motion.targets == ("ball2",)
    assert motion.alike == ("the place of all targets together on the flange",)
    said = describe_comparison(found)[0]
    assert said.endswith(
        "A change of the place of all targets together on the flange would explain it as well: the "
        "two campaigns do not tell these apart."
    )


# -- beside what is assumed
# ------------------------------------------------------------------------------------------------


def test_targets_in_another_order_missing_or_of_other_rows(rng) -> None:
    before = bench(rng, 3)
    after = before.moved(only(2, anywhere(rng, 0.3), 3))
    first = campaign(rng, before)
    for places, m in (((2, 1, 0), 30), ((2, 0), 80), ((1, 2), CONFIGURATIONS)):
        second = campaign(rng, after.of(*places), m)
        for pair in ((first, second), (second, first)):
            found = compare_campaigns(*pair)
            assert ("ball3",) in told(found)
            assert {one.target for one in found.targets} == {before.names[k] for k in places}
    assert any("where it sits on the flange" in one for one in describe_comparison(found))


def test_of_one_common_target_its_place_is_compared_as_a_parameter(rng) -> None:
    """One campaign measured it among others: the model of the other knows no targets apart."""
    before = bench(rng, 3)
    after = before.moved(only(2, np.array([0.3, 0, 0]), 3))
    first = campaign(rng, before)
    alone = campaign(rng, after.of(2))
    for pair in ((first, alone), (alone, first)):
        found = compare_campaigns(*pair)
        assert found.targets == found.target_motions == ()
        assert "a7" in {change.symbol for change in found.moved}


def test_one_target_alone_is_compared_as_before(rng) -> None:
    before = bench(rng, 1)
    found = compared(rng, before, before.moved(np.array([[0.3, 0, 0]])))
    assert found.targets == ()
    assert [one.symbol for one in found.explained_by] == ["a7"]
    anew = compared(rng, before, before.moved(np.array([[0.3, 0, 0]])), registered=True)
    assert "the instrument or the target would also make (a7" in describe_comparison(anew)[-1]


def test_exchanged_names_are_two_targets_that_moved(rng) -> None:
    before = bench(rng, 3)
    names = ["ball2", "ball1", "ball3"]
    found = compared(rng, before, replace(before, names=names))
    assert {("ball1",), ("ball2",)} <= set(told(found))
    assert ("ball3",) not in told(found)


# -- words
# ------------------------------------------------------------------------------------------------


def test_what_moved_is_said(rng) -> None:
    before = bench(rng, 3)
    nothing = describe_comparison(compared(rng, before, before, registered=True))
    assert "and the places of 3 targets tested, p" in nothing[0]
    assert nothing[0].endswith(" mm on.")
    assert "A target that moved on the flange would have been told from 0.0" in nothing[0]
    assert "motions that the instrument would also make (a1, b1, c1, α1" in nothing[1]
    one = compared(rng, before, before.moved(only(0, np.array([0, 0.5, 0]), 3)))
    said = describe_comparison(one)
    assert said[0].startswith('The target "ball1" moved on the flange by 0.')
    assert said[0].endswith(" mm (k = 2).")
    assert said[-1].startswith("These are the fewest changes that explain the difference")
    for count, who in ((2, 'Both targets, "ball1" and "ball2",'), (3, "All 3 targets")):
        at = bench(rng, count)
        all_of_them = compared(rng, at, at.moved(np.array([0.4, -0.3, 0.2])))
        said = describe_comparison(all_of_them)
        assert said[0].startswith(f"{who} moved together on the flange, by 0.")
        assert said[0].endswith("k = 2), as on an adapter that was taken off and put back.")


def test_targets_stand_on_the_page(rng) -> None:
    before = replace(bench(rng, 2), names=["<one>", "two"])
    page = _write_parameters(compared(rng, before, before.moved(only(0, np.ones(3), 2))))
    assert "<b>&lt;one&gt;</b>" in page
    assert "target on the flange" in page
    assert "No small set of parameters" not in page


# -- the fewest terms, with groups
# ------------------------------------------------------------------------------------------------


def test_a_group_is_chosen_where_no_term_explains_as_much(rng) -> None:
    directions = rng.normal(size=(3, 12))
    groups = [rng.normal(size=(3, 12)) for _ in range(3)]
    difference = groups[1].T @ (0.2, -0.1, 0.3)
    (step,) = select_fewest_terms(difference, 1e-3 * np.eye(12), directions, groups, (0, 1, 2))
    assert step.term == 3 + 1
    assert step.changes == pytest.approx((0.2, -0.1, 0.3))
    assert not step.alike


def test_what_later_groups_explain_is_dropped(rng) -> None:
    """The sum of two moves is most of what the first step sees."""
    apart = [rng.normal(size=(2, 12)) for _ in range(2)]
    both = apart[0][:1] + apart[1][:1]
    difference = apart[0].T @ (1.0, 0.3) + apart[1].T @ (1.0, -0.3)
    steps = select_fewest_terms(difference, 0.05 * np.eye(12), both, apart)
    assert sorted(step.term for step in steps) == [1, 2]
