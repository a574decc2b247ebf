"""Interleaved rounds of CPU time: only ratios inside one run count."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping

import numpy as np

from modelsel.fitting.design import Model
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.registry import mechanism
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import forward

TOOL = np.array([0.0, 0.0, 100.0])
FLEXURE = ("geometric", "joint2-twist", "joint3-twist", "backlash:3")


def pin() -> None:
    """This process onto one core."""
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})


def interleaved(work: Mapping[str, Callable[[], object]], rounds: int = 5) -> dict[str, float]:
    """Least CPU seconds of each piece of work, the pieces taking turns."""
    best = dict.fromkeys(work, np.inf)
    for _ in range(rounds):
        for name, run in work.items():
            start = time.process_time()
            run()
            best[name] = min(best[name], time.process_time() - start)
    return {name: float(value) for name, value in best.items()}


def arm_scene(m: int, noise: float = 0.1, seed: int = 1) -> tuple[Problem, Model]:
    """The PUMA 760 at m random configurations with noise [mm], and its 39 geometric and 4 flexure
    terms (the test problem of every figure; 29 of the 43 are independent)."""
    arm, rng = load_robot("puma760"), np.random.default_rng(seed)
    q = arm.draw(rng, m)
    data = build_measurements(q, forward(arm, q, TOOL) + rng.normal(0, noise, (m, 3)))
    return Problem(arm, data, TOOL[None]), Model(tuple(mechanism(name, arm) for name in FLEXURE))
