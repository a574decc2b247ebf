"""Friction that grows with the load: a drive that stops beside its reading by more or less with the torque that it
holds stands against one that always stops as far from it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import drawn, seeds

from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.rivals.free_functions import generate_more_drivers
from modelsel.diagnosis.rivals.unlisted_shapes import list_rivals
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.fitting.problem import Problem
from modelsel.mechanisms.registry import mechanism
from modelsel.mechanisms.terms import Mechanism
from modelsel.robot.coupling import Coupling
from modelsel.robot.files import load_robot

Rng = np.random.Generator


def build_parallelogram() -> object:
    """An arm of which motor 3 reads the forearm's angle to the base."""
    matrix = np.eye(6)
    matrix[2, 1] = -1
    return replace(load_robot("puma760"), coupling=Coupling(matrix))


def find_loaded(at: Problem, motor: int) -> Mechanism:
    """Find the one rival of a drive's play that depends on the side that it came from and on torques."""
    own = mechanism(f"approach-backlash:{motor}", at.robot)
    rivals = list_rivals(at, Candidate(own, CandidateKind.MECHANISM, 0.1))
    (loaded,) = (
        rival.candidate.mechanism
        for rival in rivals
        if rival.agrees == "place" and any("torque" in n for n in rival.candidate.mechanism.names())
    )
    return loaded


def move(at: Problem, found: Mechanism, term: int) -> dict[int, np.ndarray]:
    """Find by how much a term turns each joint, at all rows."""
    screws = found.terms[term].screws
    assert {screw.axis for screw in screws} == {"rz"}
    return {screw.frame: np.asarray(screw.cause.of(at.state)) for screw in screws}


@seeds(1)
def test_friction_of_a_coupled_drive_grows_with_the_torque_that_its_motor_holds(rng: Rng) -> None:
    """It was told as growing along the campaign: of such a drive no load was tried."""
    at = drawn(build_parallelogram(), rng, 40)
    loaded = find_loaded(at, 2)
    side = at.state.value("approach2")
    # motor 2 turns joint 2, and joint 3 back by as much
    held = at.state.value("torque2") - at.state.value("torque3")
    plain = move(at, loaded, 0)
    grows = move(at, loaded, 1)
    assert plain[2] == pytest.approx(side)
    assert plain[3] == pytest.approx(-side)
    share = np.abs(held) / np.mean(np.abs(held))
    assert grows[2] == pytest.approx(side * share, rel=1e-3)
    assert grows[3] == pytest.approx(-side * share, rel=1e-3)
    # and functions of other drivers times that side, as of any joint
    own = mechanism("approach-backlash:2", at.robot)
    beside = [one for one in generate_more_drivers(at, own) if "q5" in one.names()]
    assert {one.names() for one in beside} == {frozenset(("approach2", "q5"))}


@pytest.mark.parametrize("motor", [2, 3])
@seeds(1)
def test_friction_of_a_joint_grows_with_the_torque_about_it(rng: Rng, motor: int) -> None:
    at = drawn("puma760", rng, 40)
    loaded = find_loaded(at, motor)
    side = at.state.value(f"approach{motor}")
    torque = np.abs(at.state.value(f"torque{motor}"))
    assert move(at, loaded, 0)[motor] == pytest.approx(side)
    expected = side * torque / torque.mean()
    assert move(at, loaded, 1)[motor] == pytest.approx(expected, rel=1e-3)
    # no weight turns about an upright axis
    upright = mechanism("approach-backlash:1", at.robot)
    rivals = list_rivals(at, Candidate(upright, CandidateKind.MECHANISM, 0.1))
    names = frozenset[str]().union(*(rival.candidate.mechanism.names() for rival in rivals))
    assert not [name for name in names if name.startswith("torque")]
