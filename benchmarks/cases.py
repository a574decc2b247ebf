"""Drawn cases: an arm with its errors, a campaign, what is planted in it, and what an oracle could know of it."""
from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from hidden_arm import Arm, Effect, State, arm, geometry, measured, off
from hidden_effects import NEEDS, REGISTERED, UNREGISTERED

from modelsel.errormap import Scan
from modelsel.measurements import measurements
from modelsel.robotfile import load
from modelsel.scene import Scene, scene

ROBOTS = ("puma760", "ur10", "irb120")
COUNTS = (40, 80, 200)
SIZES = (0.3, 5.0)          # rms per coordinate beyond the base, over the noise
NOISE = 0.06                # mm per coordinate
FRESH = 300
VISIBLE = 0.1               # share of an effect's norm that the geometry must leave
TOOLS = ((0.0, 0.0, 100.0), (40.0, -25.0, 100.0))
EXPLAINS = 0.97
Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Case:
    """One campaign with what is planted; `sizes` in units of the noise, `noise` (3 m,) what was added."""

    robot: str
    arm: Arm
    state: State
    fresh: State
    effects: tuple[Effect, ...]
    sizes: tuple[float, ...]
    noise: Array

    def scene(self) -> Scene:
        """What modelsel is given."""
        x = measured(self.arm, self.state, self.effects) + self.noise.reshape(-1, 3)
        return bound(self.arm, self.robot, self.state, x)

    def unseen(self) -> Scene:
        """Fresh configurations, without noise."""
        return bound(self.arm, self.robot, self.fresh, measured(self.arm, self.fresh, self.effects))


def bound(arm: Arm, robot: str, state: State, x: Array) -> Scene:
    """A scene of modelsel's from plain arrays."""
    return scene(load(robot), measurements(state.q, x, covariates=state.covariates), arm.tool[None])


def campaign(arm: Arm, rng: np.random.Generator, m: int, reach: float, warming: bool) -> State:
    """Configurations in random order, with payload and temperature beside them."""
    warm = 18 + 12 * (1 - np.exp(-3 * np.arange(m) / m)) + rng.normal(0, .3, m) if warming else rng.uniform(18, 32, m)
    return State(arm, arm.draw(rng, m, reach), {"payload_kg": rng.choice([0.0, 5.0, 10.0], m), "temperature_C": warm})


def draw_effect(arm: Arm, state: State, rng: np.random.Generator, kind: str | None = None) -> Effect:
    """An effect of which the geometry leaves enough to see, at 1 mm rms per coordinate beyond it."""
    J = arm.screws(state.q)
    Q = geometry(J)
    table = {**REGISTERED, **UNREGISTERED}
    for _ in range(200):
        name = kind or str(rng.choice(list(REGISTERED if rng.random() < 0.6 else UNREGISTERED)))
        effect = table[name](rng, arm)
        column = effect.columns(state, J) @ effect.sizes
        left = np.linalg.norm(off(Q, column))
        if left > VISIBLE * np.linalg.norm(column):
            return effect.scaled(float(np.sqrt(len(column)) / left))
    raise LookupError(f"{kind} is invisible on {arm.name}")


def draw(seed: Sequence[int], count: int | None = None) -> Case:
    """Case of a seed; `count` effects, or 0 to 3 evenly."""
    rng = np.random.default_rng(seed)
    robot, m = str(rng.choice(ROBOTS)), int(rng.choice(COUNTS))
    body = arm(load(robot), rng, TOOLS[int(rng.integers(2))])
    reach, warming = (np.pi if rng.random() < .7 else np.radians(100)), bool(rng.random() < .5)
    state, fresh = campaign(body, rng, m, reach, warming), campaign(body, rng, FRESH, reach, warming)
    count = int(rng.integers(4)) if count is None else count
    effects, sizes = list[Effect](), list[float]()
    while len(effects) < count:
        effect, size = draw_effect(body, state, rng), float(np.exp(rng.uniform(*np.log(SIZES))))
        if effect.words not in [e.words for e in effects]:
            effects.append(effect.scaled(NOISE * size))
            sizes.append(size)
    return Case(robot, body, state, fresh, tuple(effects), tuple(sizes), rng.normal(0, NOISE, 3 * m))


# -- what an oracle could do ------------------------------------------------------------------------------------------------


def oracle_error(case: Case) -> Array:
    """(3 FRESH,) error of the fit of geometry and the true mechanisms on fresh configurations, to first order."""
    def matrix(state: State) -> Array:
        J = case.arm.screws(state.q)
        A = J.reshape(state.m, -1, 3).transpose(0, 2, 1).reshape(3 * state.m, -1)[:, :-3]
        return np.hstack([A, *(e.columns(state, J) for e in case.effects)])
    A, B = matrix(case.state), matrix(case.fresh)
    size = np.maximum(np.linalg.norm(A, axis=0), 1e-9 * np.linalg.norm(A))
    return np.asarray((B / size) @ np.linalg.lstsq(A / size, case.noise, rcond=1e-7)[0])


def critical_p(seen: Scan, rng: np.random.Generator, draws: int = 499, level: float = 0.05) -> float:
    """The family-wise critical value of the exact max-test: smallest single p-value at the given level (methods.md A.6)."""
    u = rng.standard_normal((seen.columns.XT.shape[1], draws))
    u -= seen.Q @ (seen.Q.T @ u)
    share = seen.strength(u)[0] / np.square(u).sum(0)
    return float(np.quantile(smallest_p(seen, share), level))


def smallest_p(seen: Scan, share: Array) -> Array:
    """(B,) smallest p-value over all candidates of their shares (G, B) of the residual: Beta(k/2, (freedom - k)/2)."""
    from scipy.special import betaincc
    sizes = seen.sizes
    return np.min([betaincc(k / 2, (seen.freedom - k) / 2, np.clip(share[sizes == k].max(0), 0, 1))
                   for k in np.unique(sizes) if 0 < k < seen.freedom], axis=0)


def powers(case: Case, p_critical: float) -> tuple[list[float], list[float]]:
    """(power, delta) of the oracle's test of every true mechanism alone, the others known, at the scan's critical value (A.7);
    delta: what is left of the effect beyond geometry and the others, in noise units."""
    from scipy.special import fdtri, ncfdtr
    J = case.arm.screws(case.state.q)
    Q = geometry(J)
    columns = [e.columns(case.state, J) for e in case.effects]
    power, delta = [], []
    for k, effect in enumerate(case.effects):
        others = [c for i, c in enumerate(columns) if i != k]
        P = np.linalg.qr(np.hstack([Q, *(c / np.linalg.norm(c, axis=0) for c in others)]))[0] if others else Q
        own = off(P, columns[k])
        rank = int(np.linalg.matrix_rank(own / np.linalg.norm(columns[k], axis=0), tol=1e-4))
        size = float(np.linalg.norm(own @ effect.sizes) / NOISE)
        free = len(J) * 3 - P.shape[1] - rank
        power.append(float(1 - ncfdtr(rank, free, size ** 2, fdtri(rank, free, 1 - p_critical))) if rank else 0.0)
        delta.append(size)
    return power, delta


def naming_limit(delta: float, rho: float) -> float:
    """Rate at which anyone could name the right one of two causes with residual correlation rho (A.7)."""
    from scipy.special import ndtr
    a, b = delta * np.sqrt((1 - rho) / 2), delta * np.sqrt((1 + rho) / 2)
    return float(ndtr(a) * ndtr(b) + ndtr(-a) * ndtr(-b))


def held_by(case: Case, seen: Scan) -> Array:
    """(effects, G) share of the norm of what was planted that every candidate holds beyond the base, on the campaign's rows."""
    out = []
    for effect in case.effects:
        d = off(seen.Q, effect.displacement(case.state).reshape(-1, 3).T.ravel())
        out.append(np.sqrt(seen.strength(d[:, None])[0][:, 0]) / np.linalg.norm(d))
    return np.array(out).reshape(len(case.effects), -1)
