"""What acts on the target: of all targets together, and of each of several by its name."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from modelsel.diagnosis.candidates.prior_weights import weigh_names
from modelsel.exceptions import StudyError
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.campaign_registry import set_reference, set_targets, waits_for_targets
from modelsel.mechanisms.environment import find_references
from modelsel.mechanisms.registry import BUILTIN, Registry, build_mechanisms, every, mechanism
from modelsel.mechanisms.target_entries import PerTarget
from modelsel.mechanisms.terms import Mechanism, Screw, Term
from modelsel.robot.files import load_robot

ROBOT = load_robot("puma760")
OF_TARGETS = [name for name, entry in BUILTIN.items() if isinstance(entry, PerTarget)]


def nudge(robot: object) -> Mechanism:
    """A stranger's mechanism of the target."""
    return Mechanism("nudge", (Term("n", (Screw(7, "tx"),)),), "The target is nudged.")


def test_what_acts_on_the_target_has_a_form_for_each_of_several() -> None:
    assert OF_TARGETS == [
        "tool-droop",
        "tool-stretch",
        "tool-play",
        "payload-droop",
        "payload-shift",
        "thermal-shift",
    ]
    registry = set_targets(BUILTIN, ["A", "B"])
    for stem in OF_TARGETS:
        names = [m.name for m in build_mechanisms(stem, ROBOT, registry)]
        forms = len(build_mechanisms(stem, ROBOT))
        assert names == [stem] * forms + [f"{stem}:A"] * forms + [f"{stem}:B"] * forms
        assert mechanism(stem, ROBOT, registry) == mechanism(stem, ROBOT)


def test_one_target_has_no_form_of_its_own() -> None:
    """Studies of one target have the candidates that they had."""
    bare = {stem: BUILTIN[stem] for stem in OF_TARGETS}
    registry = set_targets(bare, ["A"])
    assert every(ROBOT, registry) == every(ROBOT, bare)
    with pytest.raises(StudyError, match="there is only one target"):
        build_mechanisms("tool-droop:A", ROBOT, registry)


def test_the_form_of_one_target_moves_no_other(rng: np.random.Generator) -> None:
    data = build_measurements(ROBOT.draw(rng, 4), np.zeros((4, 3)), target=["A", "B"] * 2)
    at = Problem(ROBOT, data, np.zeros((2, 3)))
    registry = set_targets(BUILTIN, ["A", "B"])
    droop, bending = build_mechanisms("tool-droop:B", ROBOT, registry)
    together, _ = build_mechanisms("tool-droop", ROBOT)
    assert (
        droop.sentence
        == "Target B shifts across the flange in proportion to the gravity across it."
    )
    assert (
        droop.equation == "target offset = g · gravity direction across the flange axis · target_2"
    )
    assert bending.sentence.startswith("Target B turns with its tool about the flange")
    for own, every_one in zip(droop.terms[0].screws, together.terms[0].screws, strict=True):
        values = np.asarray(own.cause.of(at.state))
        assert values[::2].tolist() == [0, 0]
        assert values[1::2] == pytest.approx(np.asarray(every_one.cause.of(at.state))[1::2])


def test_a_target_that_there_is_not_is_refused() -> None:
    registry = set_targets(BUILTIN, ["A", "B"])
    with pytest.raises(StudyError, match="the targets are A and B"):
        build_mechanisms("tool-droop:C", ROBOT, registry)
    for given in ("3", "A & B", "A:0.5"):
        with pytest.raises(StudyError, match="tool-droop takes the name of one target only"):
            build_mechanisms(f"tool-droop:{given}", ROBOT, registry)


def test_a_name_of_one_target_waits_for_the_measurements() -> None:
    assert waits_for_targets("thermal-shift:B", BUILTIN)
    assert not waits_for_targets("thermal-shift", BUILTIN)
    assert not waits_for_targets("thermal-zero:B", BUILTIN)
    assert not waits_for_targets("thermal-shift:B", set_targets(BUILTIN, ["A", "B"]))


def reference_of(name: str, registry: Registry) -> frozenset[float]:
    """The temperature from which a mechanism counts."""
    (one,) = build_mechanisms(name, ROBOT, registry)
    (screw,) = one.terms[0].screws
    return find_references(screw.cause)


def test_a_shift_with_temperature_counts_from_that_of_the_campaign() -> None:
    named = set_targets(BUILTIN, ["A", "B"])
    for registry in (set_reference(named, 27.0), set_targets(set_reference(BUILTIN, 27.0), "AB")):
        assert reference_of("thermal-shift:B", registry) == {27.0}
    assert reference_of("thermal-shift", set_reference(set_targets(BUILTIN, ["A"]), 27.0)) == {27.0}


@pytest.mark.parametrize("targets", [["A"], ["A", "B"]])
def test_a_shift_that_is_late_is_one_of_the_targets_as_well(targets: list[str]) -> None:
    late = set_reference(BUILTIN, 20.0, (15,))
    named = set_reference(set_targets(BUILTIN, targets), 20.0, (15,))
    alone = targets if len(targets) > 1 else []
    for registry in (set_targets(late, targets), named, set_targets(named, targets)):
        built = build_mechanisms("thermal-shift", ROBOT, registry)
        names = ["thermal-shift", *(f"thermal-shift:{name}" for name in alone)]
        assert [m.name for m in built] == [name for name in names for _ in range(2)]
        assert "15 min late" in built[1].sentence
        assert mechanism("thermal-shift", ROBOT, registry) == mechanism("thermal-shift", ROBOT)


def test_a_strangers_mechanism_of_the_target_stays_its_own() -> None:
    mine: Registry = {**BUILTIN, "thermal-shift": PerTarget(nudge)}
    registry = set_reference(set_targets(mine, ["A", "B"]), 27.0)
    names = [m.name for m in build_mechanisms("thermal-shift", ROBOT, registry)]
    assert names == ["nudge", "nudge:A", "nudge:B"]


@pytest.mark.parametrize("count", [2, 5])
def test_many_targets_make_none_likelier(count: int) -> None:
    bare = {stem: BUILTIN[stem] for stem in OF_TARGETS}
    registry = set_targets(bare, [f"t{k}" for k in range(count)])
    weights = weigh_names(every(ROBOT, registry), {})
    sums: Counter[str] = Counter()
    for name, weight in weights.items():
        stem, colon, _ = name.partition(":")
        sums[stem + colon] += weight
    for stem in OF_TARGETS:
        assert sums[stem] == sums[f"{stem}:"] == pytest.approx(1.0)
