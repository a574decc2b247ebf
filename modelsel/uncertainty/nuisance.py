"""Components of the noise: which whitened coordinate shares which noise scale, where the study
gives reason for several.

Stated uncertainties set the ratios inside a component; the scale of each component is left open.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from .._typing import Array, Index
from ..fitting.design import PLACE, Model
from ..fitting.noise import Instrument
from ..fitting.problem import Problem
from ..mechanisms.registry import Registry, Scanned
from ..mechanisms.terms import Mechanism, TermKey
from ..robot.kinematics import Robot

SINGLE = "noise scale"


@dataclass(frozen=True, eq=False)
class Components:
    """A problem whose whitened coordinates each belong to one component: `of` (c,) its number per
    coordinate, names and units of the T scales, `factor` (T,) what a scale of 1 is in that unit."""

    problem: Problem
    of: Index
    names: tuple[str, ...]
    units: tuple[str, ...]
    factor: Array

    @property
    def count(self) -> int:
        """How many scales."""
        return len(self.names)


def components(
    problem: Problem, instrument: Instrument | None = None, stated: bool = False
) -> Components:
    """Of a weighed problem. Per-coordinate uncertainties in the data: a scale per axis of the
    tracker's frame; an instrument (where no floor is `stated`): one along the beam, one across;
    orientations: one of their own; else one scale in mm."""
    six = problem.components == 6
    if (
        problem.data.gauges is not None
    ):  # the coordinates of different kinds are not alike: one scale for all that is in mm
        six_of = np.array([0, 0, 0, 1, 1, 1] if six else [0, 0, 0], dtype=np.intp)
        own = ("noise of position", "noise of orientation") if six else (SINGLE,)
        plain = problem.whitening.uniform and not six
        return Components(
            problem,
            six_of,
            own,
            ("mm",) if plain else ("of the stated",) * len(own),
            np.array([1 / problem.whitening.weight]) if plain else np.ones(len(own)),
        )
    rest, rest_names = ([3, 3, 3], ["noise of orientation"]) if six else ([], [])
    if problem.data.sigma is not None:
        of, names = [0, 1, 2, *rest], ["noise in x", "noise in y", "noise in z", *rest_names]
    elif instrument is not None and not stated:
        problem = along_beam(problem, instrument)
        of, names = (
            [0, 1, 1, *(k - 1 for k in rest)],
            ["noise along the beam", "noise across the beam", *rest_names],
        )
    elif six:
        of, names = [0, 0, 0, 1, 1, 1], ["noise of position", *rest_names]
    else:
        if problem.whitening.uniform:
            return Components(
                problem,
                np.zeros(3, dtype=np.intp),
                (SINGLE,),
                ("mm",),
                np.array([1 / problem.whitening.weight]),
            )
        of, names = [0, 0, 0], [SINGLE]
    return Components(
        problem,
        np.array(of, dtype=np.intp),
        tuple(names),
        ("of the stated",) * len(names),
        np.ones(len(names)),
    )


def along_beam(problem: Problem, instrument: Instrument) -> Problem:
    """The same weights, each row's first whitened coordinate along the beam and the others across
    it: an orthogonal turn of the whitened coordinates, which no least-squares fit feels."""
    matrices = problem.whitening.matrices
    if matrices is None:
        raise TypeError("an instrument's weights are a block per row")
    line = problem.data.position - np.array(instrument.at)
    u = line / np.linalg.norm(line, axis=1)[:, None]
    least = np.argmin(np.abs(u), axis=1)
    v = np.cross(u, np.eye(3)[least])
    v /= np.linalg.norm(v, axis=1)[:, None]
    basis = np.stack([u, v, np.cross(u, v)], axis=1)  # rows: along, across, across
    position = matrices[:, :3, :3]
    spread = np.linalg.inv(np.einsum("mji,mjk->mik", position, position))  # covariance of a row
    sigma = np.sqrt(np.einsum("mai,mij,maj->ma", basis, spread, basis))
    turned = matrices.copy()
    turned[:, :3, :3] = basis / sigma[:, :, None]
    return replace(problem, whitening=replace(problem.whitening, matrices=turned))


def single(of: Components) -> Components:
    """With one scale for all."""
    return Components(of.problem, np.zeros_like(of.of), (SINGLE,), of.units[:1], of.factor[:1])


# Inner constants of scanned mechanisms, taken as continuous: the moment at which a tracker was
# moved, for one.

GRID = 401  # values at which a cause is worked out; between them it is interpolated


@dataclass(frozen=True, eq=False)
class Constant:
    """One constant: its name and its mechanism's, its range, the value the model holds, and, for
    every screw it bears on, (place, term index, table (GRID, m) of how far the cause departs from
    the model's)."""

    name: str
    mechanism: str
    low: float
    high: float
    held: float
    tables: tuple[tuple[tuple[int, int], int, Array], ...] = field(repr=False)

    def twist(self, theta: Array, value: Array, into: dict[tuple[int, int], Array]) -> None:
        """Add to `into` (place -> (W, m)) what the constant's values (W,) change at parameters
        theta (W, p)."""
        below, share = self.between(value)
        part = share[:, None]
        for place, k, table in self.tables:
            change = theta[:, k, None] * (table[below] * (1 - part) + table[below + 1] * part)
            into[place] = into.get(place, np.zeros((1, 1))) + change

    def between(self, value: Array) -> tuple[Index, Array]:
        """(grid point below each value (W,), share of the way to the next one)."""
        at = (value - self.low) / (self.high - self.low) * (GRID - 1)
        below = np.clip(at, 0, GRID - 2).astype(np.intp)
        return below, at - below


def constants(problem: Problem, model: Model, registry: Registry) -> tuple[Constant, ...]:
    """One for each mechanism of a model that the registry scans over a range of real numbers;
    numbered where a mechanism is in the model several times, as the labels of its coefficients
    are."""
    place = {t.key: k for k, t in enumerate(model.terms)}
    out = []
    for m in model.mechanisms:
        stem, *joint = m.name.split(":")
        entry = registry.get(stem)
        if isinstance(entry, Scanned) and entry.range is not None:
            held = _held(entry, problem.robot, joint, m)
            if held is not None:
                low, high = entry.range
                built = [
                    entry.build(problem.robot, *map(int, joint), float(v))
                    for v in np.linspace(low, high, GRID)
                ]
                out.append(
                    Constant(
                        f"constant of {m.name}",
                        m.name,
                        low,
                        high,
                        held,
                        _tables(problem, m, built, place),
                    )
                )
    several = [[o for o in out if o.mechanism == c.mechanism] for c in out]
    return tuple(
        c if len(alike) == 1 else replace(c, name=f"{c.name} ({alike.index(c) + 1})")
        for c, alike in zip(out, several, strict=True)
    )


def _held(entry: Scanned, robot: Robot, joint: Sequence[str], m: Mechanism) -> float | None:
    """The scanned constant that gives this mechanism."""
    places = tuple(map(int, joint))
    return next(
        (
            float(c)
            for c in entry.constants(robot, *places)
            if entry.build(robot, *places, c).terms == m.terms
        ),
        None,
    )


def _tables(
    problem: Problem, m: Mechanism, built: Sequence[Mechanism], place: dict[TermKey, int]
) -> tuple[tuple[tuple[int, int], int, Array], ...]:
    rows = len(problem)
    out = []
    for i, term in enumerate(m.terms):
        for j, screw in enumerate(term.screws):
            base = np.broadcast_to(screw.cause.of(problem), (rows,))
            table = (
                np.stack(
                    [
                        np.broadcast_to(b.terms[i].screws[j].cause.of(problem), (rows,))
                        for b in built
                    ]
                )
                - base
            )
            out.append(((screw.frame - 1, PLACE[screw.axis]), place[term.key], table))
    return tuple(out)
