"""Steps of some targets of several, by their names and by what they move."""

from __future__ import annotations

import numpy as np
import pytest

from modelsel.exceptions import StudyError
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.campaign_registry import set_targets
from modelsel.mechanisms.causes import Member
from modelsel.mechanisms.environment import STEPS, target_step
from modelsel.mechanisms.moved_targets import JOINED, find_moved_targets, limit_to_targets
from modelsel.mechanisms.registry import BUILTIN, build_mechanisms, every
from modelsel.mechanisms.target_names import choose_targets
from modelsel.mechanisms.terms import Mechanism, Term
from modelsel.robot.files import load_robot

ROBOT = load_robot("puma760")


def test_targets_that_move_alike_share_their_numbers(rng: np.random.Generator) -> None:
    q = ROBOT.draw(rng, 8)
    names = ["A", "B", "C", "D"] * 2
    data = build_measurements(q, np.zeros((8, 3)), target=names)
    at = Problem(ROBOT, data, np.zeros((4, 3)))
    step = limit_to_targets(target_step(ROBOT, 0.5), {0: "A", 2: "C"})
    assert step.name == "target-step:A & C"
    assert step.sentence == (
        "Targets A and C stand elsewhere on the flange, shifted alike, after 50.0 % of the campaign."
    )
    assert len(step.terms) == 3
    for term in step.terms:
        moved = np.sum([screw.cause.of(at.state) for screw in term.screws], axis=0)
        assert moved.tolist() == [0, 0, 0, 0, 1, 0, 1, 0]


def test_moved_targets_are_those_that_every_screw_is_limited_to() -> None:
    step = target_step(ROBOT, 0.5)
    alone = limit_to_targets(step, {1: "B"})
    both = limit_to_targets(step, {0: "A", 1: "B"})
    assert find_moved_targets(step) == ()
    assert find_moved_targets(alone) == (Member("target", 1),)
    assert find_moved_targets(both) == (Member("target", 0), Member("target", 1))
    first, second = step.terms[0].screws, alone.terms[0].screws
    mixed = Mechanism("mixed", (Term("s", (*second, *first)),))
    assert find_moved_targets(mixed) == ()


def test_a_name_of_several_targets_is_that_of_their_common_step() -> None:
    names = ["A", "B", "A & B", "c:d"]
    registry = set_targets(BUILTIN, names)
    own = build_mechanisms("target-step:B & c:d", ROBOT, registry)
    assert len(own) == len(STEPS)
    assert {m.name for m in own} == {"target-step:B & c:d"}
    assert {find_moved_targets(m) for m in own} == {(Member("target", 1), Member("target", 3))}
    (single,) = build_mechanisms("target-step:B & c:d:0.5", ROBOT, registry)
    assert single in own
    # a target that is called so
    (one,) = build_mechanisms("target-step:A & B:0.5", ROBOT, registry)
    assert find_moved_targets(one) == (Member("target", 2),)


@pytest.mark.parametrize("given", ["A & D", "A & A", "A & ", "A&B"])
def test_a_name_of_targets_that_are_not_there_is_refused(given: str) -> None:
    registry = set_targets(BUILTIN, ["A", "B", "C"])
    with pytest.raises(StudyError, match="the targets are A, B and C"):
        build_mechanisms(f"target-step:{given}", ROBOT, registry)


def test_many_targets_that_are_called_alike_are_told_apart_at_once() -> None:
    """A name could be read in as many ways as there are sums: forty targets took for ever."""
    names = [JOINED.join("A" * count) for count in range(1, 41)]
    joined = JOINED.join("A" * 1000)
    assert choose_targets(joined, names) == ((), joined)
    assert choose_targets(f"{names[-1]}:0.5", names) == ((39,), "0.5")
    given = f"{names[4]}{JOINED}B:0.5"
    assert choose_targets(given, [*names[:5], "B"]) == ((2, 1, 5), "0.5")
    long = JOINED.join("A" * 5000)
    assert choose_targets(long, ["A", "B"]) == ((), long)


def test_common_steps_are_not_among_what_every_search_considers() -> None:
    registry = set_targets(BUILTIN, ["A", "B", "C"])
    steps = {m.name for m in every(ROBOT, registry) if m.stem == "target-step"}
    assert steps == {"target-step", "target-step:A", "target-step:B", "target-step:C"}


def test_targets_that_move_alike_have_one_name() -> None:
    """In the order of the file: written in another, it would be another name of the same step."""
    registry = set_targets(BUILTIN, ("A", "B", "C"))
    assert build_mechanisms("target-step:A & C:0.5", ROBOT, registry)
    with pytest.raises(
        StudyError, match=r'"target-step:C & A:0.5": .* as in "target-step:A & C:0.5"'
    ):
        build_mechanisms("target-step:C & A:0.5", ROBOT, registry)
