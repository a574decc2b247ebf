"""Candidates: of constants that do the same on the data, one is left, and nothing of them is kept."""

from __future__ import annotations

import numpy as np

from modelsel.diagnosis.candidates import build_candidates
from modelsel.fitting.design import Model
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.causes import Cause, Named, Number, sign
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
