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
from modelsel.mechanisms.environment import STEPS, find_moved_target
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
        assert {find_moved_target(m) for m in own} == {Member("target", number)}
        (half,) = build_mechanisms(f"target-step:{name}:0.5", ROBOT, registry)
        assert half.sentence == (
            f"Target {name} stands elsewhere on the flange after 50.0 % of the campaign."
        )
        assert half in own
    (together,) = build_mechanisms("target-step:0.25", ROBOT, registry)
    assert find_moved_target(together) is None
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
