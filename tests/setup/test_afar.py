"""From afar: joint zeros off by up to 30 degrees, links by 50 mm, tracker and target anywhere. The
fit ends in the same minimum as an exact one by scipy on kinematics of the tests' own, begun at the
truth; what is fitted is judged there."""

from __future__ import annotations

import numpy as np
import pytest
from builders import leave_to_slow
from drawn_arms import SIZES, error, target, turn
from scipy.optimize import least_squares

from modelsel.fitting.design import Model
from modelsel.fitting.least_squares import fit
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.geometry import build_setup, geometric
from modelsel.robot.files import load_robot
from modelsel.setup.registration import register

NOISE = 0.06
UNIT = np.array([1.0, 1.0, 1.0, 1e-3, 1e-3, 1e-3])


@pytest.mark.parametrize("name", leave_to_slow(("ur5e", "puma760", "irb120", "iiwa14"), "ur5e"))
def test_the_minimum_is_found_from_afar(name, rng) -> None:
    robot, m = load_robot(name), int(rng.integers(60, 160))
    n = robot.n
    limits = np.clip(
        [(-2.6, 2.6) if j.limits is None else j.limits for j in robot.joints], -2.6, 2.6
    )
    q = rng.uniform(limits[:, 0], limits[:, 1], (m, n))
    errors = rng.normal(size=(n, 6)) * SIZES
    joint, link = rng.integers(0, n, 2)
    errors[joint, 5] += np.radians(rng.choice([-1, 1]) * rng.uniform(5, 30))
    errors[link, rng.integers(0, 3)] += rng.uniform(-50, 50)
    tool = np.append(rng.uniform(-50, 50, 2), rng.uniform(50, 200))
    placement = turn(2, rng.uniform(-3, 3, 1))[0]
    placement[:3, 3] = rng.uniform(-3000, 3000, 3)
    position = (
        target(robot, q, errors, tool) @ placement[:3, :3].T
        + placement[:3, 3]
        + rng.normal(0, NOISE, (m, 3))
    )

    def left(x: np.ndarray) -> np.ndarray:
        moved = placement @ error(x[6 * n + 3 :])
        points = target(robot, q, x[: 6 * n].reshape(n, 6), tool + x[6 * n : 6 * n + 3])
        return (points @ moved[:3, :3].T + moved[:3, 3] - position).ravel()

    start = np.concatenate([errors.ravel(), np.zeros(9)])
    exact = least_squares(
        left,
        start,
        x_scale=np.concatenate([np.tile(UNIT, n), UNIT[:3], UNIT]),
        xtol=1e-15,
        ftol=1e-14,
        gtol=1e-12,
        max_nfev=30,
    )
    best = np.sqrt(np.square(exact.fun).mean())
    at = register(
        Problem(robot, build_measurements(q, position), np.zeros((1, 3))), np.ones(m, bool), False
    )
    model = Model((build_setup(robot, 1, 1, True, False), geometric(robot)))
    plain, found = fit(at, model, held="nothing"), fit(at, model)
    case = f"{name}, joint {joint + 1}, link {link + 1}: {best:.8f} mm"
    assert found.rank >= plain.rank - 2, case
    only_open = (
        found.weak.count == len(found.found.kept) - plain.rank
    )  # the prior holds what the data say nothing of
    assert np.sqrt(np.square(found.residuals(at)).mean()) == pytest.approx(
        best, rel=1e-6 if only_open else 1e-3
    ), case
