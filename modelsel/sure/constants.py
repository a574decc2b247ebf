"""Inner constants of scanned mechanisms, taken as continuous: the moment at which a tracker was moved, for one."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from .._typing import Array, Index
from ..fitting.design import PLACE, Model
from ..fitting.problem import Scene
from ..mechanisms.registry import Registry, Scanned
from ..mechanisms.terms import Mechanism, Screw
from ..robot.kinematics import Robot

GRID = 401     # values at which a cause is worked out; between them it is interpolated


@dataclass(frozen=True, eq=False)
class Constant:
    """One constant: its name and its mechanism's, its range, the value the model holds, and, for every screw it bears on, (place,
    term index, table (GRID, m) of how far the cause departs from the model's)."""

    name: str
    mechanism: str
    low: float
    high: float
    held: float
    tables: tuple[tuple[tuple[int, int], int, Array], ...] = field(repr=False)

    def twist(self, theta: Array, value: Array, into: dict[tuple[int, int], Array]) -> None:
        """Add to `into` (place -> (W, m)) what the constant's values (W,) change at parameters theta (W, p)."""
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


def constants(scene: Scene, model: Model, registry: Registry) -> tuple[Constant, ...]:
    """One for each mechanism of a model that the registry scans over a range of real numbers; numbered where a mechanism is in
    the model several times, as the labels of its coefficients are."""
    place = {t.screws: k for k, t in enumerate(model.terms)}
    out = []
    for m in model.mechanisms:
        stem, *joint = m.name.split(":")
        entry = registry.get(stem)
        if isinstance(entry, Scanned) and entry.range is not None:
            held = _held(entry, scene.robot, joint, m)
            if held is not None:
                low, high = entry.range
                built = [entry.build(scene.robot, *map(int, joint), float(v)) for v in np.linspace(low, high, GRID)]
                out.append(Constant(f"constant of {m.name}", m.name, low, high, held, _tables(scene, m, built, place)))
    several = [[o for o in out if o.mechanism == c.mechanism] for c in out]
    return tuple(c if len(alike) == 1 else replace(c, name=f"{c.name} ({alike.index(c) + 1})")
                 for c, alike in zip(out, several, strict=True))


def _held(entry: Scanned, robot: Robot, joint: Sequence[str], m: Mechanism) -> float | None:
    """The scanned constant that gives this mechanism."""
    places = tuple(map(int, joint))
    return next((float(c) for c in entry.constants(robot, *places)
                 if entry.build(robot, *places, c).terms == m.terms), None)


def _tables(scene: Scene, m: Mechanism, built: Sequence[Mechanism], place: dict[tuple[Screw, ...], int]
            ) -> tuple[tuple[tuple[int, int], int, Array], ...]:
    rows = len(scene)
    out = []
    for i, term in enumerate(m.terms):
        for j, screw in enumerate(term.screws):
            base = np.broadcast_to(screw.cause.of(scene), (rows,))
            table = np.stack([np.broadcast_to(b.terms[i].screws[j].cause.of(scene), (rows,)) for b in built]) - base
            out.append(((screw.frame - 1, PLACE[screw.axis]), place[term.screws], table))
    return tuple(out)
