"""Drawn cases: an arm with its errors, a campaign, what is planted in it, and what an oracle could
know of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from hidden_arm import Arm, Effect, State, arm, geometry, measured, off
from hidden_effects import REGISTERED, UNREGISTERED
from hidden_oracle import power

from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.robot.files import load_robot

ROBOTS = ("puma760", "ur10", "irb120")
COUNTS = (40, 80, 200)
SIZES = (0.3, 5.0)  # rms per coordinate beyond the base, over the noise
NOISE = 0.06  # mm per coordinate
FRESH = 300
VISIBLE = 0.1  # share of an effect's norm that the geometry must leave
TOOLS = ((0.0, 0.0, 100.0), (40.0, -25.0, 100.0))
EXPLAINS = 0.97
Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Case:
    """One campaign with what is planted; `sizes` in units of the noise, `noise` (3 m,) what was
    added."""

    robot: str
    arm: Arm
    state: State
    fresh: State
    effects: tuple[Effect, ...]
    sizes: tuple[float, ...]
    noise: Array

    def problem(self) -> Problem:
        """What modelsel is given."""
        x = measured(self.arm, self.state, self.effects) + self.noise.reshape(-1, 3)
        return bound(self.arm, self.robot, self.state, x)

    def unseen(self) -> Problem:
        """Fresh configurations, without noise."""
        return bound(self.arm, self.robot, self.fresh, measured(self.arm, self.fresh, self.effects))


def bound(arm: Arm, robot: str, state: State, x: Array) -> Problem:
    """A problem of modelsel's from plain arrays."""
    return Problem(
        load_robot(robot),
        build_measurements(state.q, x, covariates=state.covariates),
        arm.tool[None],
    )


def campaign(arm: Arm, rng: np.random.Generator, m: int, reach: float, warming: bool) -> State:
    """Configurations in random order, with payload and temperature beside them."""
    warm = (
        18 + 12 * (1 - np.exp(-3 * np.arange(m) / m)) + rng.normal(0, 0.3, m)
        if warming
        else rng.uniform(18, 32, m)
    )
    return State(
        arm,
        arm.draw(rng, m, reach),
        {"payload_kg": rng.choice([0.0, 5.0, 10.0], m), "temperature_C": warm},
    )


def draw_effect(arm: Arm, state: State, fresh: State, rng: np.random.Generator) -> Effect:
    """An effect of which the geometry leaves enough to see, in both campaigns and not in one
    configuration alone, at 1 mm rms per coordinate beyond the geometry."""
    table = {**REGISTERED, **UNREGISTERED}
    for _ in range(200):
        effect = table[str(rng.choice(list(REGISTERED if rng.random() < 0.6 else UNREGISTERED)))](
            rng, arm
        )
        J = arm.screws(state.q)
        column = effect.columns(state, J) @ effect.sizes
        if not np.linalg.norm(column):
            continue
        unit = effect.scaled(float(np.sqrt(len(column)) / np.linalg.norm(off(geometry(J), column))))
        small = unit.scaled(SIZES[1] * NOISE).displacement(state) / (SIZES[1] * NOISE)
        straight = np.linalg.norm(
            small - unit.columns(state, J) @ unit.sizes
        ) < 0.05 * np.linalg.norm(small)  # else no lever
        if straight and all(visible(unit, s) for s in (state, fresh)):
            return unit
    raise LookupError(f"nothing is visible on {arm.name}")


def visible(effect: Effect, state: State) -> bool:
    """Is enough left beyond the geometry, and more than a tenth of it in others than the strongest
    two configurations?"""
    J = state.arm.screws(state.q)
    column = effect.columns(state, J) @ effect.sizes
    left = np.sort(np.square(off(geometry(J), column)).reshape(-1, 3).sum(1))
    return bool(
        left.sum() > (VISIBLE * np.linalg.norm(column)) ** 2 and left[:-2].sum() > 0.5 * left.sum()
    )


def draw(seed: Sequence[int], count: int | None = None, configurations: int | None = None) -> Case:
    """Case of a seed; `count` effects, or 0 to 3 evenly; `configurations`, or one of COUNTS."""
    rng = np.random.default_rng(seed)
    robot, m = str(rng.choice(ROBOTS)), int(rng.choice(COUNTS))
    m = configurations or m
    body = arm(load_robot(robot), rng, TOOLS[int(rng.integers(2))])
    reach, warming = (np.pi if rng.random() < 0.7 else np.radians(100)), bool(rng.random() < 0.5)
    state, fresh = (
        campaign(body, rng, m, reach, warming),
        campaign(body, rng, FRESH, reach, warming),
    )
    count = int(rng.integers(4)) if count is None else count
    effects, sizes = list[Effect](), list[float]()
    while len(effects) < count:
        effect, size = (
            draw_effect(body, state, fresh, rng),
            float(np.exp(rng.uniform(*np.log(SIZES)))),
        )
        if effect.words not in [e.words for e in effects]:
            effects.append(effect.scaled(NOISE * size))
            sizes.append(size)
    return Case(
        robot, body, state, fresh, tuple(effects), tuple(sizes), rng.normal(0, NOISE, 3 * m)
    )


# -- what an oracle could do
# ------------------------------------------------------------------------------------------------


def oracle_error(case: Case) -> Array:
    """(3 FRESH,) error of the fit of geometry and the true mechanisms on fresh configurations, to
    first order."""

    def matrix(state: State) -> Array:
        J = case.arm.screws(state.q)
        A = J.reshape(state.m, -1, 3).transpose(0, 2, 1).reshape(3 * state.m, -1)[:, :-3]
        return np.hstack([A, *(e.columns(state, J) for e in case.effects)])

    A, B = matrix(case.state), matrix(case.fresh)
    size = np.maximum(np.linalg.norm(A, axis=0), 1e-9 * np.linalg.norm(A))
    return np.asarray((B / size) @ np.linalg.lstsq(A / size, case.noise, rcond=1e-7)[0])


def powers(case: Case, p_critical: float) -> tuple[list[float], list[float]]:
    """(power, delta) of the oracle's test of every true mechanism alone, the others known, at the
    scan's critical value (A.7); delta: what is left of the effect beyond geometry and the others,
    in noise units."""
    J = case.arm.screws(case.state.q)
    columns = [c / e.scale(c) for e, c in ((e, e.columns(case.state, J)) for e in case.effects)]
    empty = np.zeros((3 * case.state.m, 0))
    both = [
        power(
            e,
            case.state,
            np.hstack([empty, *(c for i, c in enumerate(columns) if i != k)]),
            NOISE,
            p_critical,
        )
        for k, e in enumerate(case.effects)
    ]
    return [p for p, _ in both], [d for _, d in both]
