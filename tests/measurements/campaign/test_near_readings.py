"""Which visits came back to one posture, where readings differ by what encoders and drives let
through."""

from __future__ import annotations

import numpy as np
import pytest
from builders import seeds

from modelsel._random import generator
from modelsel.measurements.campaign.near_readings import describe_returns, find_returns
from modelsel.measurements.campaign.visits import SAME_READING, number_blocks
from modelsel.measurements.measurements import build_measurements
from modelsel.robot.files import load_robot
from modelsel.selection.splits import assign_folds


def come_back(rng: np.random.Generator, jitter: float, postures: int = 30, times: int = 6):
    """Readings (v, 6) of postures in a shuffled order, and the number of each visit's posture."""
    planned = load_robot("ur5").draw(rng, postures)
    posture = rng.permutation(np.repeat(np.arange(postures), times))
    readings = planned[posture]
    return readings + rng.uniform(-jitter, jitter, readings.shape), posture


def blocks_are(posture: np.ndarray, blocks: np.ndarray) -> bool:
    together = len(np.unique(np.stack([posture, blocks]), axis=1).T)
    return together == len(np.unique(posture)) == len(np.unique(blocks))


@seeds(1, 2, 3)
@pytest.mark.parametrize("jitter", [0.0, 1e-5, 1e-4, 4e-4, 2e-3])
def test_rows_of_a_posture_are_in_one_block(rng: np.random.Generator, jitter: float) -> None:
    readings, posture = come_back(rng, jitter)
    assert blocks_are(posture, number_blocks(readings, np.arange(len(readings))))


@seeds(1, 2)
def test_many_visits_by_a_tree_are_those_of_few(rng: np.random.Generator) -> None:
    readings, posture = come_back(rng, 1e-5, postures=5, times=60)
    assert blocks_are(posture, number_blocks(readings, np.arange(len(readings))))


@seeds(1, 2)
def test_a_slide_has_a_bound_in_millimetres(rng: np.random.Generator) -> None:
    readings, posture = come_back(rng, 1e-4)
    readings[:, 2] = 1000 * readings[:, 2] + rng.uniform(-1.5, 1.5, len(readings))
    visits = np.arange(len(readings))
    slides = (False, False, True, False, False, False)
    assert blocks_are(posture, number_blocks(readings, visits, slides))
    assert len(np.unique(number_blocks(readings, visits))) > 0.9 * len(visits)


@seeds(1, 2)
def test_a_path_that_is_sampled_finely_has_no_returns(rng: np.random.Generator) -> None:
    ends = load_robot("ur5").draw(rng, 2)
    along = np.linspace(0, 1, 20_000)[:, None]
    path = ends[0] + along * (ends[1] - ends[0])
    assert not len(find_returns(path))


@seeds(1, 2)
def test_a_fine_grid_around_a_posture_is_no_return(rng: np.random.Generator) -> None:
    """Steps of one joint, measured on purpose, alone and with other postures."""
    step = np.zeros((4, 6))
    step[:, 1] = [0.0, 1e-3, 2.5e-3, 6e-3]
    planned = load_robot("ur5").draw(rng, 20)
    assert not len(find_returns(planned[0] + step))
    assert not len(find_returns(np.concatenate([planned[0] + step, planned[1:]])))


@seeds(1, 2)
def test_postures_of_a_fine_grid_are_told_apart(rng: np.random.Generator) -> None:
    """Steps of one and a half milliradians in three joints, each posture measured four times."""
    steps = np.stack(np.meshgrid(*[np.arange(5)] * 3), -1).reshape(-1, 3) * 1.5e-3
    posture = rng.permutation(np.repeat(np.arange(125), 4))
    readings = np.tile(load_robot("ur5").draw(rng, 1), (500, 1))
    readings[:, :3] += steps[posture] + rng.uniform(-1e-5, 1e-5, (500, 3))
    assert blocks_are(posture, number_blocks(readings, np.arange(500)))


@seeds(1, 2)
def test_a_visit_that_stopped_short_is_of_its_posture(rng: np.random.Generator) -> None:
    readings, posture = come_back(rng, 2e-5)
    short = np.flatnonzero(posture == 3)[0]
    readings[short, 3] -= 1.7e-3
    assert blocks_are(posture, number_blocks(readings, np.arange(len(readings))))


@seeds(1, 2, 3)
def test_pairs_are_found_whatever_their_difference(rng: np.random.Generator) -> None:
    planned = load_robot("ur5").draw(rng, 60)
    size = rng.uniform(2e-6, 3e-3, (60, 1))
    again = planned + size * rng.choice([-1.0, 1.0], planned.shape)
    readings = np.concatenate([planned, again])
    posture = np.tile(np.arange(60), 2)
    assert blocks_are(posture, number_blocks(readings, np.arange(120)))


@seeds(1)
@pytest.mark.parametrize(("postures", "times"), [(5, 1500), (20, 600)])
def test_postures_that_are_read_very_often_are_told_apart(
    rng: np.random.Generator, postures: int, times: int
) -> None:
    """An arm at rest is logged thousands of times with a flickering encoder."""
    readings, posture = come_back(rng, 1e-5, postures, times)
    assert blocks_are(posture, number_blocks(readings, np.arange(len(readings))))


@seeds(1, 2)
@pytest.mark.parametrize("reach", [0.002, 0.01])
def test_a_stage_that_moves_hardly_at_all_has_no_returns(
    rng: np.random.Generator, reach: float
) -> None:
    """No posture stands apart from others where all are as near as readings of one."""
    readings = rng.uniform(-reach, reach, (80, 3))
    assert len(np.unique(number_blocks(readings, np.arange(80)))) == 80
    slides = (True, True, True)
    assert len(np.unique(number_blocks(1000 * readings, np.arange(80), slides))) == 80


@seeds(1, 2, 3)
def test_a_posture_is_never_in_two_folds(rng: np.random.Generator) -> None:
    readings, posture = come_back(rng, 5e-5)
    data = build_measurements(readings, rng.normal(size=(len(readings), 3)))
    fold_of = assign_folds(data, 5, generator(1, "folds"))
    assert all(len(np.unique(fold_of[posture == k])) == 1 for k in np.unique(posture))


@seeds(1, 2)
def test_what_was_joined_is_said_with_its_size(rng: np.random.Generator) -> None:
    planned = load_robot("ur5").draw(rng, 10)
    readings = np.concatenate([planned, planned[:3]])
    size = rng.uniform(0.01, 0.05)
    readings[10, 4] += np.radians(size)
    said = describe_returns(readings, number_blocks(readings, np.arange(13)), (), SAME_READING)
    assert said is not None
    assert f"came back to 1 posture with readings that differ by up to {size:.2g} deg" in said
    assert "2 configurations" in said
    equal = planned.repeat(2, axis=0)
    posture = number_blocks(equal, np.arange(20))
    assert describe_returns(equal, posture, (), SAME_READING) is None
