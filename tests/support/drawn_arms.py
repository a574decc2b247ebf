"""Arms drawn about their drawing, measured by a tracker somewhere with one reflector: kinematics
and an oracle of their own.

Nothing here comes from the package but the nominal robots' numbers. The oracle knows how large the
errors are, and how large the noise is: no method predicts a longer tool better."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import Robot

Array = np.ndarray
SIZES = np.array(
    [0.5, 0.5, 0.5, 2e-3, 2e-3, 2e-3]
)  # mm, rad: standard deviations of a b c α β γ of every frame
OPEN = np.array(
    [1e3, 1e3, 1e3, 1e4, 1e4, 1e4, 100.0, 100.0, 100.0]
)  # mm, rad: of the target, of the tracker
LONGER = 150.0  # mm of tool added afterwards
UP = np.array([0.0, 0.0, 1.0])  # the flange's z
STEP = np.array([1e-2, 1e-2, 1e-2, 1e-5, 1e-5, 1e-5])


def turn(axis: int, angle: Array) -> Array:
    """(k, 4, 4) rotations about a coordinate axis."""
    c, s = np.cos(angle), np.sin(angle)
    i, j = ((1, 2), (2, 0), (0, 1))[axis]
    out = np.tile(np.eye(4), (len(angle), 1, 1))
    out[:, i, i], out[:, j, j], out[:, i, j], out[:, j, i] = c, c, -s, s
    return out


def error(numbers: Array) -> Array:
    """(4, 4) Trans(a, b, c) Rx(α) Ry(β) Rz(γ)."""
    out = np.eye(4)
    out[:3, 3] = numbers[:3]
    for axis in range(3):
        out = out @ turn(axis, numbers[3 + axis : 4 + axis])[0]
    return out


def target(
    robot: Robot, q: Array, errors: Array, tool: Array, effect: Array | None = None
) -> Array:
    """(m, 3) mm: the reflector in the base's frame; errors (n, 6); effect (m, n) rad on top of the
    readings."""
    at = np.tile(np.eye(4), (len(q), 1, 1))
    for k, joint in enumerate(robot.joints):
        at = (
            at
            @ joint.before
            @ error(errors[k])
            @ turn(2, q[:, k] + (0.0 if effect is None else effect[:, k]))
        )
    return np.asarray((at @ robot.last @ np.append(tool, 1.0))[:, :3])


def yields(q: Array, effect: float) -> Array:
    """(m, n) rad on top of the readings: joint 3 yields under the forearm's weight."""
    out = np.zeros_like(q)
    out[:, 2] = effect * np.cos(q[:, 1] + q[:, 2])
    return out


@dataclass(frozen=True, eq=False)
class Campaign:
    """A drawn arm and its measurements: readings q (m, n) rad, positions (m, 3) mm in the tracker's
    frame, noise [mm], effect [rad] (`yields`), which the oracle knows."""

    name: str
    robot: Robot
    q: Array
    errors: Array
    tool: Array
    placement: Array
    position: Array
    noise: float
    effect: float = 0.0

    @property
    def columns(self) -> dict[str, Array]:
        """A measurements file's columns."""
        return {f"q{k + 1}_rad": self.q[:, k] for k in range(self.robot.n)} | {
            f"{axis}_mm": self.position[:, a] for a, axis in enumerate("xyz")
        }

    def seen(self, points: Array) -> Array:
        """Points of the base's frame in the tracker's."""
        return np.asarray(points @ self.placement[:3, :3].T + self.placement[:3, 3])

    def later(self, rng: np.random.Generator, count: int = 200) -> tuple[Array, Array]:
        """(readings (count, n), where the target is then with the tool made LONGER along the
        flange's z (count, 3))."""
        q = rng.uniform(self.q.min(0), self.q.max(0), (count, self.robot.n))
        return q, self.seen(
            target(self.robot, q, self.errors, self.tool + UP * LONGER, yields(q, self.effect))
        )

    def oracle(self, q: Array, rows: Array, sizes: Array = SIZES) -> Array:
        """(k, 3) mm: where it has the longer tool's target at readings q: the most probable arm
        given these rows (mask), the errors' true sizes and the noise, by Gauss-Newton from the true
        placement with central differences."""
        n, own, position = self.robot.n, self.q[rows], self.position[rows]
        root = np.diag(1 / np.concatenate([np.tile(sizes, n), OPEN]))
        steps = np.concatenate([np.tile(STEP, n), STEP[:3], STEP])

        def predicted(x: Array, at: Array, longer: float = 0.0) -> Array:
            moved = self.placement @ error(x[6 * n + 3 :])
            points = target(
                self.robot,
                at,
                x[: 6 * n].reshape(n, 6),
                self.tool + x[6 * n : 6 * n + 3] + UP * longer,
                yields(at, self.effect),
            )
            return points @ moved[:3, :3].T + moved[:3, 3]

        x = np.zeros(6 * n + 9)
        for _ in range(4):
            left = (position - predicted(x, own)).ravel() / self.noise
            J = np.stack(
                [
                    (predicted(x + d, own) - predicted(x - d, own)).ravel()
                    / (2 * d.max())
                    / self.noise
                    for d in np.diag(steps)
                ],
                1,
            )
            x = (
                x
                + np.linalg.lstsq(np.vstack([J, root]), np.append(left, -root @ x), rcond=1e-15)[0]
            )
        return predicted(x, q, LONGER)


def campaign(
    rng: np.random.Generator,
    names: tuple[str, ...],
    noise: tuple[float, float] = (0.03, 0.1),
    sizes: Array = SIZES,
    effect: float = 0.0,
) -> Campaign:
    """A study's data: a built-in robot, 40 to 200 configurations within its limits, the reflector
    on or off the last axis, the tracker anywhere. `effect` [rad]: see `yields`."""
    name = str(rng.choice(names))
    robot = load_robot(name)
    m, sigma = int(rng.integers(40, 201)), float(rng.uniform(*noise))
    limits = np.clip(
        [(-2.8, 2.8) if j.limits is None else j.limits for j in robot.joints], -2.8, 2.8
    )
    q = rng.uniform(limits[:, 0], limits[:, 1], (m, robot.n))
    errors = rng.normal(size=(robot.n, 6)) * sizes
    tool = np.array([*(rng.uniform(-80, 80, 2) * (rng.random() < 0.6)), rng.uniform(30, 220)])
    placement = turn(2, rng.uniform(-3, 3, 1))[0] @ turn(0, rng.normal(0, 0.05, 1))[0]
    placement[:3, 3] = rng.uniform(-3000, 3000, 3)
    points = target(robot, q, errors, tool, yields(q, effect))
    position = points @ placement[:3, :3].T + placement[:3, 3] + rng.normal(0, sigma, (m, 3))
    return Campaign(name, robot, q, errors, tool, placement, position, sigma, effect)
