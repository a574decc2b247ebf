"""Arms with a wave of one joint, planted by turning the true joint further, in plain numpy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from hidden_arm import arm

from modelsel.fitting.problem import Problem
from modelsel.fitting.whitening import Whitening
from modelsel.measurements.measurements import build_measurements
from modelsel.robot.files import load_robot

ARMS = ("puma760", "ur5", "irb120")


@dataclass(frozen=True, eq=False)
class Waved:
    """A problem, and the wave in it: the joint (from 1), how many a turn, its phase [rad] and how far it
    turns the joint [rad]."""

    problem: Problem
    joint: int
    count: int
    phase: float
    size: float


def plant_wave(
    rng: np.random.Generator,
    times: float,
    *,
    rows: int = 100,
    sigma: float = 0.05,
    counts: tuple[int, int] = (61, 330),
    grid_degrees: float = 0.0,
    joints: tuple[int, ...] = (1, 2, 3, 4),
    loose: float = 0.0,
    is_square: bool = False,
) -> Waved:
    """Measure a drawn arm with errors of assembly, of which a joint stands off its reading by a sine: `times`
    as far at the target as an instrument of `sigma` [mm] errs in one coordinate, in the rms.

    `grid_degrees`: commanded angles are its multiples; `loose`: the same joint also stands off by a
    draw of every row, as far as that; `is_square`: the sign of the sine in its place."""
    robot = load_robot(str(rng.choice(ARMS)))
    body = arm(robot, rng, (40.0, -25.0, 100.0))
    q = body.draw(rng, rows)
    if grid_degrees:
        step = np.radians(grid_degrees)
        q = step * np.round(q / step)
    joint = int(rng.choice(joints))
    count = int(rng.integers(counts[0], counts[1] + 1))
    phase = rng.uniform(0, 2 * np.pi)
    wave = np.sin(count * q[:, joint - 1] + phase)
    if is_square:
        wave = np.sign(wave)
    exact = body.chain(q)[0]
    turned = np.zeros_like(q)
    turned[:, joint - 1] = 1e-5
    lever = np.linalg.norm(body.chain(q + turned)[0] - exact, axis=1) / 1e-5
    size = times * sigma / np.sqrt(np.mean((lever * wave) ** 2))
    off = size * wave
    off += loose * sigma / np.sqrt(np.mean(lever**2)) * rng.standard_normal(rows)
    turned[:, joint - 1] = off
    position = body.chain(q + turned)[0] + sigma * rng.standard_normal(exact.shape)
    data = build_measurements(q, position)
    problem = Problem(robot, data, body.tool[None], whitening=Whitening(1 / sigma))
    return Waved(problem, joint, count, phase, size)
