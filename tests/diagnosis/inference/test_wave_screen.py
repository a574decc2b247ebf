"""The screen of waves: what it computes, against columns built one by one, and how often chance passes."""

from __future__ import annotations

import numpy as np
import pytest
from builders import seeds
from planted_waves import Waved, plant_wave

from modelsel._typing import Array
from modelsel.diagnosis.columns.candidate_columns import stack_design
from modelsel.diagnosis.high_waves import SCREENED, compute_bound
from modelsel.diagnosis.inference.wave_screen import (
    LEAST_SHARE,
    Counts,
    Remains,
    raise_turns,
    see_remains,
)
from modelsel.fitting.design import Model
from modelsel.fitting.least_squares import Fit, fit
from modelsel.mechanisms.causes import ONE
from modelsel.mechanisms.drives import gear_ripple
from modelsel.mechanisms.motors import drive_screws
from modelsel.mechanisms.registry import mechanism
from modelsel.mechanisms.terms import Term


def fit_geometry(waved: Waved) -> Fit:
    robot = waved.problem.robot
    return fit(waved.problem, Model((mechanism("geometric", robot),)))


def see(waved: Waved) -> dict[int, Remains]:
    joints = range(1, waved.problem.robot.n + 1)
    return see_remains(waved.problem, fit_geometry(waved), joints)


@seeds(1, 2)
def test_powers_by_doubling_are_those_of_each_number(rng: np.random.Generator) -> None:
    angles = rng.uniform(-2 * np.pi, 2 * np.pi, 20)
    number = int(rng.integers(1, 700))
    counts = Counts(61.0, 0.5, number)
    expected = np.exp(1j * np.outer(61 + 0.5 * np.arange(number), angles))
    assert raise_turns(angles, counts) == pytest.approx(expected, abs=1e-10)


def project(waved: Waved, fitted: Fit) -> tuple[Array, Array, Array]:
    """An orthonormal basis of the geometry (N, r), and the residual off it (N,)."""
    columns, residual = stack_design(waved.problem, fitted.terms, fitted.at())
    kept = columns[:, list(fitted.representatives)]
    left, singular, _ = np.linalg.svd(kept / np.linalg.norm(kept, axis=0), full_matrices=False)
    basis = left[:, singular > 1e-10]
    return basis, residual - basis @ (basis.T @ residual), residual


@pytest.mark.integration
@seeds(1, 2, 3)
def test_what_waves_explain_is_that_of_columns_built_one_by_one(rng: np.random.Generator) -> None:
    """Of few rows, where chance explains much, as the dense computation has it."""
    waved = plant_wave(rng, 1.0, rows=30)
    problem = waved.problem
    fitted = fit_geometry(waved)
    basis, residual, _ = project(waved, fitted)
    counts = Counts(61.0, 4.5, 60)
    found = 0
    for joint, own in see(waved).items():
        chance = own.compute_chance(counts, -0.5)
        turn = Term("turn", drive_screws(problem.robot, joint, ONE))
        (field, _) = stack_design(problem, (turn,), fitted.at())
        # unit directions of what a turn of the joint does, row by row
        by_row = field.reshape(3, -1)
        unit = (by_row / np.linalg.norm(by_row, axis=0)).reshape(-1)
        along = (unit * residual).reshape(3, -1).sum(0)
        taken = (unit[:, None] * basis).reshape(3, len(along), -1).sum(0)
        freedom = len(along) - np.square(taken).sum()
        for number, logarithm in zip(counts.values, chance, strict=True):
            terms = gear_ripple(problem.robot, joint, number).terms
            columns, _ = stack_design(problem, terms, fitted.at())
            beyond = columns - basis @ (basis.T @ columns)
            solution = np.linalg.lstsq(beyond, residual, rcond=None)[0]
            share = np.square(beyond @ solution).sum() / np.square(along).sum()
            expected = 0.5 * (freedom - 2) * np.log(1 - min(share, 1 - 1e-12))
            is_left = (np.square(beyond).sum(0) > 0.3 * np.square(columns).sum(0)).all()
            if logarithm:
                assert logarithm == pytest.approx(expected, rel=1e-6)
                found += 1
            elif is_left:
                assert share < LEAST_SHARE or expected > -0.5 - 1e-9
    assert found > 20


@seeds(1, 2, 3)
def test_a_planted_wave_is_the_best_of_all(rng: np.random.Generator) -> None:
    waved = plant_wave(rng, 2.0)
    seen = see(waved)
    bound = compute_bound(len(seen))
    passed = {}
    for joint, own in seen.items():
        chance = own.compute_chance(SCREENED, bound)
        if chance.any():
            passed[joint] = float(SCREENED.values[chance.argmin()])
            assert own.compute_sign_p(SCREENED, waved.problem.data.block) == 1 / 200
    assert list(passed) == [waved.joint]
    assert passed[waved.joint] == pytest.approx(waved.count, abs=1)


@pytest.mark.integration
def test_a_joint_that_does_not_repeat_is_no_wave() -> None:
    """Its errors have one direction in every row: against those of all three, more than one campaign
    in six would have a wave."""
    passed = 0
    for seed in range(30):
        waved = plant_wave(np.random.default_rng([seed, 3]), 0.0, rows=60, loose=5.0)
        seen = see(waved)
        bound = compute_bound(len(seen))
        passed += any(own.compute_chance(SCREENED, bound).any() for own in seen.values())
    assert passed <= 5


def see_alone(angles: Array, turned: Array, lever: Array | float = 1.0) -> Remains:
    """What a drive that is off by some angles sees at some levers, where there is no model."""
    count = len(angles)
    residual = lever * turned
    square = float(residual @ residual)
    squares = np.square(lever) * np.ones(count)
    return Remains(angles, squares, lever * residual, np.zeros((count, 0)), square, float(count))


@seeds(1, 2)
def test_a_few_loud_rows_are_no_wave(rng: np.random.Generator) -> None:
    """One of many numbers fits three of them, whatever their signs."""
    angles = rng.uniform(-np.pi, np.pi, 40)
    lever = np.ones(40)
    lever[:3] = 30
    own = see_alone(angles, rng.standard_normal(40), lever)
    assert own.compute_chance(SCREENED, compute_bound(6)).any()
    assert own.compute_sign_p(SCREENED, np.arange(40)) > 0.1
    # visits of one posture keep theirs together: nothing is left to draw
    assert own.compute_sign_p(SCREENED, np.zeros(40)) == 1.0


def test_so_many_waves_are_allowed_for() -> None:
    assert compute_bound(6) == pytest.approx(np.log(0.01 / (6 * 539)))
    assert list(SCREENED.values[[0, 1, -1]]) == [61.0, 61.5, 330.0]


def test_exact_data_leave_nothing_to_screen(rng: np.random.Generator) -> None:
    assert see(plant_wave(rng, 0.0, sigma=1e-9)) == {}


def test_a_wave_with_one_phase_at_all_readings_is_not_seen(rng: np.random.Generator) -> None:
    """Every 2° 90 waves a turn are a change of sign from one angle to the next."""
    angles = np.radians(2.0 * rng.integers(-80, 80, 60))
    residual = 5 * np.cos(90 * angles) + rng.standard_normal(60)
    counts = Counts(89.75, 0.25, 3)
    chance = see_alone(angles, residual).compute_chance(counts, -20.0)
    assert chance[1] == 0.0
    assert see_alone(angles + 0.1, residual).compute_chance(counts, -20.0)[1] == 0.0
    between = rng.uniform(-2.5, 2.5, 60)
    wave = see_alone(between, 5 * np.cos(90 * between) + rng.standard_normal(60))
    assert wave.compute_chance(counts, -20.0)[1] < -20
