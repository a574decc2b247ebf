"""Campaigns measured with other means than a tracker's points, on the tests' own exact arm
(hidden_arm): wires, ball-bars, distances, plates, touched points, dial gauges. Constraints are held
by moving the joints until the exact arm meets them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from hidden_arm import Arm, Effect, State, arm, measured

from modelsel.robot.files import load_robot

NOISE = 0.05
TOOL = (30.0, -20.0, 100.0)
ANCHORS = {
    "w1": (900.0, -1200.0, 300.0),
    "w2": (-1300.0, 500.0, 100.0),
    "w3": (200.0, 1400.0, -500.0),
}
Gap = Callable[[np.ndarray], np.ndarray]


def hold(a: Arm, effects: list[Effect], q: np.ndarray, gap: Gap) -> tuple[np.ndarray, np.ndarray]:
    """(readings (m, n) near q at which gap (m, k) of the exact target (m, 3) is nought, whether it
    is (m,)): steps of least size, Newton's but for what effects add to the joints' own turns."""
    for _ in range(60):
        x = measured(a, State(a, q), effects)
        g = gap(x)
        if (np.abs(g).max(1) < 1e-6).mean() > 0.9:
            break
        slope = np.stack([(gap(x + h) - g) / 1e-4 for h in 1e-4 * np.eye(3)], 2)
        J = slope @ a.screws(q)[:, : a.n, 5].transpose(0, 2, 1)
        step = -np.einsum("mjk,mk->mj", np.linalg.pinv(J, rcond=1e-3), g)
        q = q + step * np.minimum(1, 0.5 / np.maximum(np.linalg.norm(step, axis=1), 1e-9))[:, None]
    return q, np.abs(gap(measured(a, State(a, q), effects))).max(1) < 1e-6


@dataclass
class Campaign:
    """Rows of a measurements file, made kind by kind; `file` writes them."""

    rng: np.random.Generator
    effects: list[Effect] = field(default_factory=list)
    arm: Arm = field(init=False)
    rows: list[dict[str, object]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.arm = arm(load_robot("puma760"), self.rng, TOOL)

    def exact(self, q: np.ndarray) -> np.ndarray:
        return measured(self.arm, State(self.arm, q), self.effects)

    def add(self, kind: str, q: np.ndarray, feature: str = "", **cells: np.ndarray) -> None:
        for k, reading in enumerate(q):
            self.rows.append(
                {f"q{j + 1}_rad": v for j, v in enumerate(reading)}
                | {"kind": kind, "feature": feature, "s_mm": NOISE}
                | {name: values[k] for name, values in cells.items()}
            )

    def noise(self, *shape: int) -> np.ndarray:
        return self.rng.normal(0, NOISE, shape)

    def points(self, m: int) -> None:
        q = self.arm.draw(self.rng, m)
        x = self.exact(q) + self.noise(m, 3)
        self.add("point", q, **{f"{axis}_mm": x[:, a] for a, axis in enumerate("xyz")})

    def axes(self, m: int) -> None:
        for a, axis in enumerate("xyz"):
            q = self.arm.draw(self.rng, m // 3)
            self.add(axis, q, **{f"{axis}_mm": self.exact(q)[:, a] + self.noise(len(q))})

    def wires(self, m: int, dead: float = 0.0) -> None:
        for name, anchor in ANCHORS.items():
            q = self.arm.draw(self.rng, m // 3)
            self.add(
                "wire",
                q,
                name,
                length_mm=np.linalg.norm(self.exact(q) - anchor, axis=1)
                - dead
                + self.noise(len(q)),
            )

    def bars(self, m: int, lengths: Mapping[str, float], given: bool) -> None:
        """A bar of fixed length about each of some spheres; its length is written where it is
        `given`."""
        length = np.repeat(list(lengths.values()), 2 * m // len(lengths))
        centre = np.repeat(
            self.exact(self.arm.draw(self.rng, len(lengths))), 2 * m // len(lengths), axis=0
        )
        want = length + self.noise(len(length))
        self._held(
            "ball-bar",
            [*lengths],
            m,
            lambda x: (np.linalg.norm(x - centre, axis=1) - want)[:, None],
            **({"length_mm": length} if given else {}),
        )

    def distances(self, m: int) -> None:
        """Pairs of configurations, each a feature."""
        a, b = self.arm.draw(self.rng, m), self.arm.draw(self.rng, m)
        length = np.linalg.norm(self.exact(a) - self.exact(b), axis=1) + self.noise(m)
        for k in range(m):
            self.add("distance", a[k : k + 1], f"d{k}", length_mm=np.array([np.nan]))
            self.add("distance", b[k : k + 1], f"d{k}", length_mm=length[k : k + 1])

    def touches(self, m: int, points: int) -> None:
        place = np.repeat(
            self.exact(self.arm.draw(self.rng, points)) * 0.8, 2 * m // points, axis=0
        )
        want = place + self.noise(*place.shape)
        self._held("same-point", [f"p{k}" for k in range(points)], m, lambda x: x - want)

    def plates(self, m: int, plates: int) -> None:
        normal = np.repeat(
            np.linalg.qr(self.rng.normal(size=(plates, 3, 3)))[0][:, 0], 2 * m // plates, axis=0
        )
        want = np.repeat(self.rng.uniform(-300, 300, plates), 2 * m // plates) + self.noise(
            len(normal)
        )
        self._held(
            "plane",
            [f"plate{k}" for k in range(plates)],
            m,
            lambda x: ((x * normal).sum(1) - want)[:, None],
        )

    def _held(self, kind: str, names: list[str], m: int, gap: Gap, **cells: np.ndarray) -> None:
        """m rows, alike many for each feature, of twice as many attempts."""
        each = m // len(names)
        q, good = hold(self.arm, self.effects, self.arm.draw(self.rng, 2 * each * len(names)), gap)
        for k, name in enumerate(names):
            rows = 2 * each * k + np.flatnonzero(good[2 * each * k : 2 * each * (k + 1)])[:each]
            assert len(rows) == each
            self.add(
                kind, q[rows], name, **{column: values[rows] for column, values in cells.items()}
            )

    def file(self, folder: Path, name: str = "measurements.csv") -> Path:
        import pandas as pd

        pd.DataFrame(self.rows).to_csv(folder / name, index=False)
        return folder / name
