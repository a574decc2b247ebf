"""Arms with errors of their own, and mistakes of the set-up put into their data."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from builders import drawn as drawn_arm
from builders import planted

from modelsel._typing import Array
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.geometry import geometric
from modelsel.robot.rigid import from_rpy
from modelsel.setup.mistakes import describe_setup_mistake
from modelsel.setup.registration import register

Change = Callable[[Array, Array], tuple[Array, Array]]


def arm(rng: np.random.Generator, name: str, m: int = 80, registered: bool = True) -> Problem:
    """A built-in arm with geometric errors (about 1 mm) and noise; where it is to be registered,
    the tracker stands elsewhere."""
    at = drawn_arm(name, rng, m)
    terms = geometric(at.robot).terms
    size = np.array([5e-4 if t.unit == "rad" else 0.3 for t in terms])
    at = planted(at, terms, rng.normal(0, size), rng, 0.05)
    if not registered:
        return at
    moved = at.data.position @ from_rpy(0.3, -0.5, 2.0).T + [2500.0, -800.0, 400.0]
    return replace(at, data=replace(at.data, position=moved), tools=np.zeros((1, 3)))


def said(at: Problem, change: Change, registered: bool = True) -> str | None:
    """What is said of the problem with a mistake put into its readings and positions."""
    q, position = change(at.data.q, at.data.position)
    data = replace(build_measurements(q, position), notes=())
    wrong = replace(at, data=data)
    use = np.ones(len(at), bool)
    return describe_setup_mistake(
        register(wrong, use, per_group=False) if registered else wrong, use, registered
    )


def shifted(joint: int, by: float) -> Change:
    return lambda q, x: (q + by * (np.arange(q.shape[1]) == joint - 1), x)
