"""Held-out rows between estimation rows of one path are told; of scattered rows and grids nothing is."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from builders import seeds

from modelsel.measurements.measurements import build_measurements
from modelsel.robot.files import load_robot
from modelsel.study.preparation.near_rows import note_near_rows

ARM = load_robot("irb120")


def draw_paths(rng: np.random.Generator, paths: int, points: int) -> np.ndarray:
    """Straight lines in joints between random postures."""
    ends = ARM.draw(rng, 2 * paths).reshape(paths, 2, -1)
    along = np.linspace(0, 1, points)[:, None]
    return np.concatenate([first + along * (last - first) for first, last in ends])


def say(q: np.ndarray, estimation: np.ndarray) -> list[str]:
    data = build_measurements(q, np.zeros((len(q), 3)))
    return [note.sentence for note in note_near_rows(data, estimation)]


@seeds(1, 2, 3)
def test_held_out_rows_of_the_same_paths_are_told(rng: np.random.Generator) -> None:
    q = draw_paths(rng, 8, int(rng.integers(20, 40)))
    (said,) = say(q, rng.random(len(q)) < rng.uniform(0.6, 0.8))
    assert "on these paths" in said
    # whole paths that are held out are others
    assert say(q, np.arange(len(q)) % len(q) < 0.7 * len(q)) == []


@pytest.mark.parametrize("count", [25, 80, 400])
@seeds(1, 2)
def test_scattered_rows_are_not_told(count: int, rng: np.random.Generator) -> None:
    q = ARM.draw(rng, count)
    assert say(q, rng.random(count) < 0.6) == []


@seeds(1)
def test_a_grid_is_no_path(rng: np.random.Generator) -> None:
    levels = np.linspace(-1, 1, 4)
    q = np.array(list(product(levels, levels, levels, [0.0, 0.5], [0.3], [0.1])))
    assert say(q, rng.random(len(q)) < 0.6) == []


@pytest.mark.filterwarnings("error")
@seeds(1)
def test_joints_that_rest_have_no_say(rng: np.random.Generator) -> None:
    q = draw_paths(rng, 8, 30)
    resting = np.hstack([q, np.full((len(q), 1), 500.0)])
    estimation = rng.random(len(q)) < 0.7
    assert say(resting, estimation) == say(q, estimation) != []


def test_few_rows_say_nothing() -> None:
    q = draw_paths(np.random.default_rng(5), 2, 12)
    assert say(q, np.arange(24) < 21) == []
