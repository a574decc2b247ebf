"""Candidates: of constants that do the same on the data, one is left, and nothing of them is kept; a
joint that stands still gives no reading."""

from __future__ import annotations

import numpy as np

from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.fitting.design import Model
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.causes import Cause, Named, Number, cos, q, sign
from modelsel.mechanisms.terms import Mechanism, Screw, Term
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import forward

ARM = load_robot("puma760")
TOOL = np.array([0.0, 0.0, 100.0])


def jump(at: float, name: str = "jump", axis: str = "tx") -> Mechanism:
    """A jump where q1 passes a constant."""
    cause: Cause = sign(Named("q1") - Number(at))
    return Mechanism(name, (Term("j", (Screw(1, axis, cause),)),))


def test_of_constants_that_do_the_same_the_middle_one_is_left() -> None:
    """A constant counts by what it does to these rows; another name or axis is another cause."""
    q = ARM.draw(np.random.default_rng(0), 8)
    q[:, 0] = np.linspace(-1.4, 1.4, 8)  # 0.4 apart
    problem = Problem(ARM, build_measurements(q, forward(ARM, q, TOOL)), TOOL[None])
    offered = [
        jump(-0.15),
        jump(0.05),
        jump(0.15),
        jump(0.45),
        jump(0.55),
        jump(0.15, "other"),
        jump(0.05, axis="ty"),
        jump(-3.0),
        jump(3.0),
    ]
    found = build_candidates(problem, Model(()), offered, cells=False)
    expected = [offered[k] for k in (1, 3, 5, 6, 7, 8)]
    assert [candidate.mechanism for candidate in found] == expected
    assert not problem.state._causes


def test_no_candidate_needs_the_reading_of_a_joint_that_stands_still(
    rng: np.random.Generator,
) -> None:
    """A wave of q1 + q4 is one of q1 there, by another name."""
    still = int(rng.integers(1, ARM.n + 1))
    q = ARM.draw(rng, 50)
    q[:, still - 1] = 0.3 + rng.normal(0, 1e-5, 50)
    at = Problem(ARM, build_measurements(q, forward(ARM, q, TOOL)), TOOL[None])
    named = {name for one in build_candidates(at, Model(()), ()) for name in one.mechanism.names()}
    readings = {f"q{j}" for j in range(1, ARM.n + 1)}
    assert named & readings == readings - {f"q{still}"}


def test_a_label_has_short_numbers_where_the_cause_keeps_all() -> None:
    """A constant of the arm's geometry has ten digits; people read four, files keep ten."""
    cause = Named("payload_kg", "kg") * cos(q(2) + q(3) - Number(0.2277659657))
    cell = Mechanism("3 rz cell", (Term("m", (Screw(3, "rz", cause),)),))
    candidate = Candidate(cell, CandidateKind.CELL, 1.0)
    assert candidate.label == "frame 3 rz · payload_kg*cos(q2+q3-0.2278)"
    assert candidate.causes(" and ") == "payload_kg*cos(q2+q3-0.2278)"
    (screw,) = cell.terms[0].screws
    assert str(screw.cause) == "payload_kg*cos(q2+q3-0.2277659657)"
