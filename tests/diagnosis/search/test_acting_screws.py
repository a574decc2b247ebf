"""A candidate is told where it moves the target, not where it hardly does."""

from __future__ import annotations

import numpy as np
import pytest
from builders import seeds
from hidden_arm import Effect as Planted
from hidden_arm import State, arm, measured
from hidden_effects import at, together

from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.candidates.signatures import PROVEN, read_parts, read_signatures
from modelsel.diagnosis.columns.candidate_columns import stack_design
from modelsel.diagnosis.findings.claim_sentences import name_places
from modelsel.diagnosis.procedure import diagnose
from modelsel.diagnosis.search.acting_screws import SMALL, keep_acting_screws
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.causes import q
from modelsel.mechanisms.registry import build_faults, mechanism
from modelsel.mechanisms.terms import Mechanism, Screw, Term
from modelsel.robot.files import load_robot

SIGMA = 0.05
TOOL = (40.0, -25.0, 100.0)


def draw_problem(robot: str, rng: np.random.Generator, m: int = 60) -> tuple[Problem, State]:
    body = arm(load_robot(robot), rng, TOOL)
    state = State(body, body.draw(rng, m), {})
    exact = measured(body, state, ())
    return Problem(load_robot(robot), build_measurements(state.q, exact), body.tool[None]), state


def see_nothing(problem: Problem) -> np.ndarray:
    """The basis of a model without parameters."""
    return np.zeros((3 * len(problem), 0))


def list_places(candidate: Candidate) -> set[tuple[int, str]]:
    return {
        (screw.frame, screw.axis) for term in candidate.mechanism.terms for screw in term.screws
    }


def name(name: str, problem: Problem) -> Candidate:
    return Candidate(mechanism(name, problem.robot), CandidateKind.MECHANISM, 0.1)


@seeds(1, 2, 3)
def test_a_link_that_bends_acts_at_the_next_joint(rng: np.random.Generator) -> None:
    problem, _ = draw_problem("puma760", rng)
    bending, yielding = name("link-bending:2", problem), name("joint-compliance:3", problem)
    told = keep_acting_screws(problem, [bending, yielding], None, see_nothing(problem))
    assert list_places(told[0]) == {(3, "rz")}
    assert told[1] == yielding
    place, drivers, shape, cause = read_signatures(told)
    assert place[0] == place[1]
    assert drivers[0] == drivers[1]
    # which of the two it is stays open
    assert shape[0] != shape[1]
    assert cause[0] != cause[1]
    of_both = [read_parts(one, short) for one, short in zip((bending, yielding), told, strict=True)]
    assert of_both[0][:2] == of_both[1][:2]
    assert of_both[0][2:] != of_both[1][2:]


@seeds(1, 2)
def test_all_joints_that_lag_are_told(rng: np.random.Generator) -> None:
    """The wrist hardly moves the target, beside the shoulder: it lags, too."""
    problem, _ = draw_problem("puma760", rng)
    faults = [Candidate(one, CandidateKind.MECHANISM, 0.1) for one in build_faults(problem.robot)]
    assert keep_acting_screws(problem, faults, None, see_nothing(problem)) == tuple(faults)


def test_what_the_model_absorbs_is_no_place(rng: np.random.Generator) -> None:
    """Of two screws that move the target as much, one is absorbed: the candidate acts by the other."""
    problem, _ = draw_problem("ur10e", rng)
    screws = [Screw(4, axis, q(2)) for axis in ("tx", "ty")]
    absorbed, _ = stack_design(problem, [Term("absorbed", (screws[1],))], None)
    Q = absorbed / np.linalg.norm(absorbed)
    both = Candidate(Mechanism("b", (Term("b", tuple(screws)),)), CandidateKind.CELL, 0.1)
    (whole,) = keep_acting_screws(problem, [both], None, see_nothing(problem))
    (told,) = keep_acting_screws(problem, [both], None, Q)
    assert list_places(whole) == {(4, "tx"), (4, "ty")}
    assert list_places(told) == {(4, "tx")}


def test_what_moves_it_as_much_stays(rng: np.random.Generator) -> None:
    problem, _ = draw_problem("ur10e", rng)
    along = [Screw(4, axis, q(2)) for axis in ("tx", "ty")]
    both = Term("both", tuple(along))
    size = 0.9 * SMALL
    uneven = Term("uneven", (along[0], Screw(4, "ty", size * q(2))))
    just = Term("just", (along[0], Screw(4, "ty", 1.2 * SMALL * q(2))))
    found = [
        Candidate(Mechanism(term.symbol, (term,)), CandidateKind.CELL, 0.1)
        for term in (both, uneven, just)
    ]
    told = keep_acting_screws(problem, found, None, see_nothing(problem))
    assert list_places(told[0]) == {(4, "tx"), (4, "ty")}
    assert list_places(told[1]) == {(4, "tx")}
    assert list_places(told[2]) == {(4, "tx"), (4, "ty")}


@pytest.mark.slow
@seeds(1, 2, 3)
def test_a_joint_that_yields_is_told_whatever_yields_there(rng: np.random.Generator) -> None:
    """Whether the gear or the link before it gives way is not told apart, joint 3 is."""
    body = arm(load_robot("puma760"), rng, TOOL)
    state = State(body, body.draw(rng, 80), {})
    bend = together(at(3, "rz", lambda s: s.moment(3)[:, 2]))
    exact = measured(body, state, ())

    def move(size: float) -> np.ndarray:
        planted = Planted("planted", "", (bend,), np.ones(1))
        return measured(body, state, (planted.scaled(size),))

    tiny = 1e-9
    most = np.linalg.norm(move(tiny) - exact, axis=1).max() / tiny
    times = rng.uniform(4.0, 7.0)
    noisy = move(times * SIGMA / most) + SIGMA * rng.standard_normal(exact.shape)
    found = diagnose(
        Problem(load_robot("puma760"), build_measurements(state.q, noisy), body.tool[None]), seed=1
    )
    told = {name_places(effect): effect.claim for effect in found.effects}
    claim = told["Joint 3 is off its reading"]
    assert claim is not None
    assert claim.levels[0] >= PROVEN
