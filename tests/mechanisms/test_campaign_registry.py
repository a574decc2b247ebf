"""Targets of a campaign in names of mechanisms and in causes."""

from __future__ import annotations

import numpy as np
import pytest
from builders import bind

from modelsel.exceptions import StudyError
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.campaign_registry import set_targets, waits_for_targets
from modelsel.mechanisms.cause_formulas import list_members, parse
from modelsel.mechanisms.causes import Member, Named
from modelsel.mechanisms.environment import STEPS
from modelsel.mechanisms.moved_targets import find_moved_targets, split_target
from modelsel.mechanisms.registry import BUILTIN, build_mechanisms, every
from modelsel.mechanisms.terms import Mechanism
from modelsel.robot.files import load_robot

ROBOT = load_robot("puma760")
# as people call them: a number, one of the scanned moments, words of the program's own
NAMES = ("2", "0.5", "a:b", "²", "B after A", "{target}", "torque2")


def test_every_target_of_several_may_move_by_itself() -> None:
    registry = set_targets(BUILTIN, NAMES)
    steps = [m for m in every(ROBOT, registry) if m.stem == "target-step"]
    assert len(steps) == len(STEPS) * (1 + len(NAMES))
    for number, name in enumerate(NAMES):
        own = build_mechanisms(f"target-step:{name}", ROBOT, registry)
        assert len(own) == len(STEPS)
        assert {m.name for m in own} == {f"target-step:{name}"}
        assert {find_moved_targets(m) for m in own} == {(Member("target", number),)}
        (half,) = build_mechanisms(f"target-step:{name}:0.5", ROBOT, registry)
        assert half.sentence == (
            f"Target {name} stands elsewhere on the flange after 50.0 % of the campaign."
        )
        assert half in own
    (together,) = build_mechanisms("target-step:0.25", ROBOT, registry)
    assert find_moved_targets(together) == ()
    assert together in every(ROBOT)


def test_one_target_and_an_entry_of_ones_own_stay_as_they_are() -> None:
    alone = set_targets(BUILTIN, ["target"])
    assert every(ROBOT, alone) == every(ROBOT)
    own = {"target-step": lambda robot: None}
    assert set_targets(own, NAMES) == own
    assert not waits_for_targets("target-step:B", own)


def test_a_target_that_there_is_not_is_refused_with_those_that_there_are() -> None:
    registry = set_targets(BUILTIN, ["A", "B"])
    with pytest.raises(StudyError, match=r'"target-step:C": .* the targets are A and B\.'):
        build_mechanisms("target-step:C", ROBOT, registry)
    with pytest.raises(StudyError, match=r"0\.333 is not among the constants"):
        build_mechanisms("target-step:B:0.333", ROBOT, registry)
    with pytest.raises(StudyError, match="there is only one target"):
        build_mechanisms("target-step:C", ROBOT, set_targets(BUILTIN, ["A"]))
    assert waits_for_targets("target-step:C", BUILTIN)
    assert not waits_for_targets("target-step:C", registry)
    assert not waits_for_targets("target-step", BUILTIN)


def test_a_moment_that_is_not_scanned_is_told_as_one() -> None:
    for names in (["A"], ["A", "B"]):
        registry = set_targets(BUILTIN, names)
        with pytest.raises(StudyError, match=r"0\.512 is not among the constants of target-step\."):
            build_mechanisms("target-step:0.512", ROBOT, registry)


def test_the_longer_name_of_a_target_goes_before_a_constant() -> None:
    registry = set_targets(BUILTIN, ["A", "A:0.5"])
    own = build_mechanisms("target-step:A:0.5", ROBOT, registry)
    assert {m.name for m in own} == {"target-step:A:0.5"}
    assert len(own) == len(STEPS)
    assert {find_moved_targets(m) for m in own} == {(Member("target", 1),)}
    (one,) = build_mechanisms("target-step:A:0.5:0.25", ROBOT, registry)
    assert one in own
    (other,) = build_mechanisms("target-step:A:0.25", ROBOT, registry)
    assert find_moved_targets(other) == (Member("target", 0),)


def test_the_one_target_that_is_left_of_several_keeps_its_name() -> None:
    registry = set_targets(BUILTIN, ["B"], ["A", "B"])
    assert every(ROBOT, registry) == every(ROBOT)
    (half,) = build_mechanisms("target-step:B:0.5", ROBOT, registry)
    assert half.name == "target-step:B"


@pytest.mark.parametrize(
    ("text", "rest"),
    [
        ("q4*target_2", "q4"),
        ("target_2*q4", "q4"),
        ("q4*target_2*progress", "q4*progress"),
        ("target_2*q4/progress", "q4/progress"),
        ("target_2/progress", "1/progress"),
        ("q4*(target_2*progress)", "q4*progress"),
        ("q4*target_2/2", "q4/2"),
    ],
)
def test_a_factor_of_one_target_is_found_wherever_it_stands(text: str, rest: str) -> None:
    """The order of a product decided whether the noise floor knew that the target moves."""
    units = {"q4": "rad", "progress": "1"}
    cause = parse(text, units, members=list_members(3, 1))
    target, others = split_target(cause)
    assert target == Member("target", 1)
    assert str(others) == rest


@pytest.mark.parametrize("text", ["q4/target_2", "q4+target_2", "sin(target_2)", "group_1*q4"])
def test_what_is_no_factor_of_one_target_is_none(text: str) -> None:
    cause = parse(text, {"q4": "rad"}, members=list_members(3, 2))
    assert split_target(cause) == (None, cause)


def test_the_name_of_a_target_is_no_joint() -> None:
    """A digit that is no number ended the program."""
    assert Mechanism("target-step:²", ()).joint is None
    assert Mechanism("backlash:3", ()).joint == 3


def test_a_cause_of_one_target_is_one_at_its_rows_alone(rng: np.random.Generator) -> None:
    q = ROBOT.draw(rng, 6)
    data = build_measurements(q, np.zeros((6, 3)), target=list("ABABCA"), group=list("xxyyyy"))
    at = bind(ROBOT, data)
    members = list_members(3, 2)
    cause = parse("q4*target_2+group_2", at.names(), members=members)
    expected = q[:, 3] * [0, 1, 0, 1, 0, 0] + np.array([0, 0, 1, 1, 1, 1])
    np.testing.assert_allclose(cause.of(at.state), expected, rtol=1e-15)
    assert parse(str(cause), at.names(), members=members) == cause


def test_a_column_keeps_the_name_that_it_has() -> None:
    assert parse("target_2", {"target_2": "1"}, members=list_members(2, 1)) == Named("target_2")


@pytest.mark.parametrize(
    ("name", "targets", "said"),
    [
        ("target_4", 3, "The targets are target_1 to target_3."),
        ("target_2", 1, "There is only one target."),
        ("group_0", 1, "There is only one group."),
    ],
)
def test_a_number_that_no_target_has_is_refused(name: str, targets: int, said: str) -> None:
    with pytest.raises(StudyError, match=said):
        parse(name, {"target": "1"}, members=list_members(targets, 1))
