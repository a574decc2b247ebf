"""The laws of modelsel.testing, and two more that only this project's own tests need: nothing is
written into, and a mechanism is a value in every sense. `check_mechanism(mechanism, robot, rng)` is
all of them."""

from __future__ import annotations

import pickle
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields

import numpy as np
from builders import bind, drawn

from modelsel import testing as laws
from modelsel.fitting.design import compute_design, residuals
from modelsel.fitting.linearisation import Linearisation
from modelsel.fitting.problem import Problem
from modelsel.mechanisms import causes
from modelsel.mechanisms.terms import Mechanism, Screw, Term
from modelsel.robot.kinematics import Robot
from modelsel.robot.rigid import AXES
from modelsel.testing import (
    CONFIGURATIONS,
    draw_size,
    law1_columns_are_derivatives,
    law2_rows_are_local,
    law3_linear_in_the_cause,
    law5_symbols_and_units,
    step_size,
)


def check_mechanism(mechanism: Mechanism, robot: Robot, rng: np.random.Generator) -> None:
    """Every law in turn."""
    at = drawn(robot, rng, CONFIGURATIONS)
    carried(mechanism, at)
    for law in LAWS:
        law(mechanism, at, rng)


def carried(mechanism: Mechanism, at: Problem) -> None:
    """The laws' measurements have what the mechanism's causes need."""
    missing = mechanism.names() - at.names().keys()
    assert not missing, (
        f"{mechanism.name} needs {sorted(missing)}, which the laws' measurements lack: add them to builders.drawn"
    )


def joined(mechanisms: Sequence[Mechanism], at_most: int = 50) -> tuple[Mechanism, ...]:
    """The terms of many side by side, for the laws of columns alone (L1 to L3, L7): a few products
    instead of hundreds."""
    terms = list({t.key: t for m in mechanisms for t in m.terms}.values())
    return tuple(
        Mechanism("joined", tuple(terms[k : k + at_most])) for k in range(0, len(terms), at_most)
    )


@contextmanager
def locked(at: Problem, *more: np.ndarray) -> Iterator[Problem]:
    """The problem with every array locked against writing, and found unchanged afterwards."""
    data = at.data
    arrays = [
        getattr(data, f.name) for f in fields(data) if isinstance(getattr(data, f.name), np.ndarray)
    ]
    arrays += [
        *data.covariates.values(),
        at.robot.last,
        *(j.before for j in at.robot.joints),
        at.tools,
        *at.placement,
        *more,
    ]
    arrays += [] if at.whitening.matrices is None else [at.whitening.matrices]
    before = [a.copy() for a in arrays]
    for a in arrays:
        a.setflags(write=False)
    try:
        yield at
    finally:
        for a in arrays:
            a.setflags(write=True)
    assert all(np.array_equal(a, b) for a, b in zip(arrays, before, strict=True)), (
        "L7: an input was changed"
    )


def law4_plant_and_recover(mechanism: Mechanism, at: Problem, rng: np.random.Generator) -> None:
    """L4, on inputs that nothing may write into."""
    with locked(at):
        laws.law4_plant_and_recover(mechanism, at, rng)


def law6_a_value(mechanism: Mechanism, at: Problem, rng: np.random.Generator) -> None:
    """L6, and more: it pickles, and prints so that it can be read back."""
    laws.law6_a_value(mechanism, at, rng)
    names = {
        c.__name__: c
        for c in (Mechanism, Term, Screw, *vars(causes).values())
        if isinstance(c, type)
    }
    again = [pickle.loads(pickle.dumps(mechanism)), eval(repr(mechanism), names)]  # noqa: S301, S307 - our own text
    for other in again:
        assert other == mechanism, f"L6: {mechanism.name} is not equal after a round trip"
        assert hash(other) == hash(mechanism)


def law7_inputs_stay(mechanism: Mechanism, at: Problem, rng: np.random.Generator) -> None:
    """L7: nothing writes into what it was given (all inputs are locked), and what comes out is no
    view of what went in. L4's fit runs on locked inputs too."""
    terms, theta = mechanism.terms, np.array([draw_size(t, rng, 0.02) for t in mechanism.terms])
    with locked(bind(at.robot, at.data, at.tools[0]), theta) as fresh:
        for out in (
            *compute_design(fresh, terms, Linearisation(terms, theta)),
            residuals(fresh, terms, theta),
        ):
            out[...] = np.nan


LAWS = (
    law1_columns_are_derivatives,
    law2_rows_are_local,
    law3_linear_in_the_cause,
    law4_plant_and_recover,
    law5_symbols_and_units,
    law6_a_value,
    law7_inputs_stay,
)
__all__ = ["AXES", "CONFIGURATIONS", "LAWS", "draw_size", "step_size"]
