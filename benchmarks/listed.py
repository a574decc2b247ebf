"""What is right of listed effects: where they act, what drives them, and what a finding may say of
them at each level."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from hidden_arm import Effect, State

from modelsel.diagnosis.findings.effects import Effect as Finding
from modelsel.fitting.problem import Problem
from modelsel.mechanisms.terms import Mechanism

from .cases import EXPLAINS
from .unlisted import find_places, name_drivers
from .unlisted_plants import ALLOWED, find_alike, measure_drivers

Array = np.ndarray

BASE_PLACES = frozenset((1, f"{kind}{axis}") for kind in "tr" for axis in "xyz")


@dataclass(frozen=True, eq=False)
class Held(State):
    """A campaign whose motions and times stay when its readings are exchanged."""

    moves: Array = None  # type: ignore[assignment]
    times: Array = None  # type: ignore[assignment]

    @property
    def move(self) -> Array:
        """(m, n) signed last motions, as they were."""
        return self.moves

    @property
    def progress(self) -> Array:
        """(m,) place in the order of motion, as it was."""
        return self.times


@dataclass(frozen=True)
class Listed:
    """Where a listed effect acts, and what drives it."""

    places: frozenset[tuple[int, str]]
    drivers: frozenset[str]


def find_listed(effect: Effect, state: State, rng: np.random.Generator) -> Listed:
    """Find the places of an effect, others that move the target alike, and its drivers."""
    held = Held(state.arm, state.q, state.covariates, state.move, state.progress)
    J = state.arm.screws(state.q)

    def displace(s: State) -> Array:
        return (effect.columns(s, J) @ effect.sizes).reshape(-1, 3)

    twist = np.abs(effect.perturbation(state)[0]).max(0)
    own = [(int(f), int(a)) for f, a in zip(*np.nonzero(twist), strict=True)]
    axes = ("tx", "ty", "tz", "rx", "ry", "rz")
    places = frozenset((f + 1, axes[a]) for f, a in find_alike(state, own)) if own else BASE_PLACES
    drivers = {
        name for name, share in measure_drivers(displace, held, rng).items() if share > ALLOWED
    }
    plain, order = displace(held), rng.permutation(state.m)
    varies = 2 * float(np.square(plain - plain.mean(0)).sum())
    for name, other in exchange_states(held, order):
        if np.square(displace(other) - plain).sum() > ALLOWED * varies:
            drivers.add(name)
    return Listed(places, frozenset(drivers))


def exchange_states(held: Held, order: Array) -> Iterable[tuple[str, State]]:
    """Generate campaigns of which everything but the readings is exchanged in turn."""
    for j in range(held.arm.n):
        moves = held.moves.copy()
        moves[:, j] = moves[order, j]
        yield f"move{j + 1}", replace(held, moves=moves)
    yield "time", replace(held, times=held.times[order])
    for name, values in held.covariates.items():
        covariates = {**held.covariates, name: values[order]}
        yield name.partition("_")[0], replace(held, covariates=covariates)


def list_drivers(own: Mechanism, at: Problem) -> frozenset[str]:
    """List what drives an explanation, the temperature, too."""
    drivers = name_drivers(own, at)
    return drivers | {"temperature"} if "temperature_C" in own.names() else drivers


def judge_listed(
    finding: Finding, held: Sequence[float], truths: Sequence[Listed], at: Problem
) -> dict[str, bool]:
    """Judge what a finding says at each level by the listed effects of a case, of which it holds
    such shares."""
    own = finding.candidate.mechanism
    alike = any(share > EXPLAINS for share in held)
    places, drivers = find_places(own), list_drivers(own, at)
    there = [truth for truth in truths if places and places <= truth.places]
    driven = [truth for truth in there if drivers and drivers <= truth.drivers]
    return {
        "place": alike or bool(there),
        "drivers": alike or bool(driven),
        "shape": alike,
        "cause": alike and finding.candidate.registered,
    }


def is_rightly_told(
    finding: Finding, held: Sequence[float], truths: Sequence[Listed], at: Problem
) -> bool:
    """Whether what a finding claims, no deeper than it claims, is true of a listed effect."""
    claim = finding.claim
    return claim is not None and judge_listed(finding, held, truths, at)[claim.level]
