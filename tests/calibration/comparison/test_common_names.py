"""Two campaigns with several targets and groups: compared by their names, not by their order."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import drawn, planted

from modelsel._typing import Array
from modelsel.calibration.calibration import Calibration, calibrate
from modelsel.calibration.comparison.campaigns import compare_campaigns
from modelsel.calibration.comparison.common_names import number_together, renumber
from modelsel.calibration.comparison.common_space import build_common_space
from modelsel.calibration.comparison.comparison_sentences import describe_comparison
from modelsel.fitting.design import Model
from modelsel.fitting.least_squares import fit
from modelsel.fitting.noise import Floor
from modelsel.fitting.problem import Problem
from modelsel.fitting.whitening import Whitening
from modelsel.mechanisms.causes import Member, Named, q, sign, sin
from modelsel.mechanisms.geometry import build_setup
from modelsel.mechanisms.registry import mechanism
from modelsel.mechanisms.terms import Mechanism, Screw, Term
from modelsel.robot.files import load_robot
from modelsel.selection.evaluation import Split

NOISE = 0.02
ROBOT = load_robot("puma760")
TOOLS = np.array([[0.0, 40.0, 100.0], [-60.0, 0.0, 190.0]])


def of_day(number: int) -> Mechanism:
    """An eccentric gear of joint 2 on one day alone, the group of a number."""
    cause = Member("group", number) * sin(q(2))
    return Mechanism("day", (Term("s", (Screw(2, "rz", cause),)),))


def measured(rng: np.random.Generator, tools: Array = TOOLS) -> Problem:
    """Two targets on two days, on an arm with errors of its geometry, and of a gear on the first."""
    m = 160
    at = drawn(
        ROBOT, rng, m, target=["ball1", "ball2"] * (m // 2), group=["mon"] * 60 + ["tue"] * 100
    )
    at = replace(at, tools=tools, whitening=Whitening(1 / NOISE))
    model = Model((mechanism("geometric", ROBOT), of_day(0)))
    theta = np.full(len(model.terms), 5e-4)
    return planted(at, model.terms, theta, rng, NOISE)


def exchanged(at: Problem) -> Problem:
    """The same rows, with targets and groups numbered the other way round: as a file in another
    order is read."""
    data = at.data
    other = replace(
        data,
        target=1 - data.target,
        targets=data.targets[::-1],
        group=1 - data.group,
        groups=data.groups[::-1],
    )
    R, t = at.placement
    return replace(at, data=other, tools=at.tools[::-1], placement=(R[::-1], t[::-1]))


def calibrated(at: Problem, day: int = 0) -> Calibration:
    """The calibration of rows, with the place of every target open; `day` is the number of the
    group on which the gear errs."""
    setup = build_setup(ROBOT, len(at.tools), 1, False, False)
    model = Model((setup, mechanism("geometric", ROBOT), of_day(day)))
    m = len(at)
    rows = np.ones(m, bool)
    split = Split(at, rows, ~rows, np.zeros(m, np.intp), True)
    return calibrate("two", split, fit(at, model), Floor(NOISE, "stated"), None, False, {})


def named(c: Calibration, *targets: str) -> Calibration:
    return replace(c, targets=targets)


def offsets_of(terms: tuple[Term, ...], target: int) -> list[Term]:
    """The terms that move one target on the flange."""
    own = [Screw(ROBOT.n + 1, axis, Member("target", target)) for axis in ("tx", "ty", "tz")]
    return [term for term in terms if term.screws[0] in own]


def test_the_same_rows_in_another_order_are_the_same(rng) -> None:
    at = measured(rng)
    first = calibrated(at)
    second = calibrated(exchanged(at), day=1)
    assert second.targets == ("ball2", "ball1")
    found = compare_campaigns(first, second)
    assert not found.moved
    assert found.targets_apart_mm == 0
    assert all(abs(one.z) < 1e-3 for one in map(_Standardised, found.changes))
    assert any(one.mechanism == "day" for one in found.changes)
    said = describe_comparison(found)
    assert [one for one in said if "Nothing changed beyond chance" in one]
    assert "25 parameters and the places of 2 targets tested" in said[-1]
    assert not [one for one in said if "different targets" in one or "campaign only" in one]
    assert not [one for one in said if "moved on the flange by" in one]


class _Standardised:
    """A change over its standard error."""

    def __init__(self, change) -> None:
        self.z = (change.after - change.before) / change.standard_error


def test_a_target_that_sits_elsewhere_is_told_by_its_name(rng) -> None:
    at = measured(rng)
    moved = measured(rng, TOOLS + np.outer([0, 1], [0, 0, 30.0]))
    found = compare_campaigns(calibrated(at), calibrated(exchanged(moved), day=1))
    assert found.targets_apart_mm == pytest.approx(30)
    (motion,) = found.target_motions
    assert motion.targets == ("ball2",)
    assert motion.moved_mm[0] == pytest.approx((0, 0, 30), abs=0.02)


def test_a_target_that_is_only_said_to_sit_elsewhere_has_not_moved(rng) -> None:
    """What the second study expects is another place; where the target is measured is the same."""
    first, second = (measured(rng) for _ in range(2))
    elsewhere = exchanged(replace(second, tools=TOOLS + np.outer([0, 1], [0, 0, 30.0])))
    found = compare_campaigns(calibrated(first), calibrated(elsewhere, day=1))
    assert found.targets_apart_mm == pytest.approx(30)
    assert not found.target_motions
    assert not any("different targets" in one for one in describe_comparison(found))


def test_targets_of_one_campaign_alone_are_set_aside(rng) -> None:
    at = measured(rng)
    first = calibrated(at)
    other = named(calibrated(exchanged(at), day=1), "ball3", "ball1")
    found = compare_campaigns(first, other)
    assert not found.moved
    assert found.other_targets == (("ball2",), ("ball3",))
    (told,) = [one for one in describe_comparison(found) if "ball" in one]
    assert told == (
        'Only the first campaign measured "ball2" and only the second campaign measured "ball3": '
        "where they sit on the flange cannot be compared."
    )
    space = build_common_space(other, first)
    moves = dict(zip(space.terms, space.displacement, strict=True))
    of_ball3, of_ball1, _ = np.array(
        [[moves[term] for term in offsets_of(space.terms, target)] for target in range(3)]
    )
    assert not of_ball3.any()  # the first's first target, which the second does not have
    assert of_ball1.all()
    assert not compare_campaigns(other, first).moved


def test_without_a_common_target_its_motions_are_set_aside(rng) -> None:
    at = measured(rng)
    found = compare_campaigns(calibrated(at), named(calibrated(at), "ball3", "ball4"))
    assert not found.moved
    assert found.changes
    assert found.left_aside == ("a7", "b7", "c7")
    assert not {"γ6", "a7", "b7", "c7"} & {one.symbol for one in found.changes}
    said = describe_comparison(found)
    assert said[-1] == (
        "No target was measured in both campaigns: motions that a target would also make "
        "(a7, b7, c7) cannot be compared."
    )
    assert said[-2].startswith('Only the first campaign measured "ball1" and "ball2" and only')


def test_one_target_alone_may_have_another_name() -> None:
    names = number_together(("ball",), ("SMR",))
    assert names.shared.tolist() == [0]
    assert names.only_first == names.only_second == ()


def test_causes_follow_their_targets_and_groups(rng) -> None:
    c = calibrated(measured(rng))
    cause = sign(Named("q1", "rad")) * Member("target", 1) + Member("group", 0)
    model = Model((Mechanism("own", (Term("k", (Screw(1, "tx", cause),)),)),))
    own = replace(c, model=model, tool_rotations=np.stack([np.eye(3), -np.eye(3)]))
    first = replace(c, targets=("x", "ball2"), groups=("tue", "mon"))
    targets = number_together(first.targets, own.targets)
    groups = number_together(first.groups, own.groups)
    renumbered = renumber(own, first, targets, groups)
    assert renumbered.targets == ("x", "ball2", "ball1")
    assert renumbered.groups == ("tue", "mon")
    _check(renumbered.tools[1:], TOOLS[::-1])
    rotations = renumbered.tool_rotations
    assert rotations is not None
    _check(rotations[1:], np.stack([-np.eye(3), np.eye(3)]))
    (term,) = renumbered.terms
    expected = sign(Named("q1", "rad")) * Member("target", 1) + Member("group", 1)
    assert term.screws == (Screw(1, "tx", expected),)


def _check(values: Array, expected: Array) -> None:
    np.testing.assert_array_equal(values, expected)
