"""Starts, sights and arms that are minimised together end where each ends alone, and nothing is
searched twice."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from builders import seeds
from scipy.spatial.transform import Rotation
from setup_mistakes import arm

from modelsel._typing import Array, Index
from modelsel.exceptions import NotEstimable
from modelsel.fitting.problem import Problem
from modelsel.robot.files import load_robot
from modelsel.robot.rigid import tidy_rotations
from modelsel.setup import placement_search
from modelsel.setup.adjustment import refine_robustly, refine_without_gross_rows
from modelsel.setup.independent_parts import build_sight
from modelsel.setup.minimisation import minimise
from modelsel.setup.offset_arms import build_nominal_arm
from modelsel.setup.offset_fits import fit_offsets
from modelsel.setup.placement import Placed, Sight, compute_misfits, stack_placed, stack_sights
from modelsel.setup.registration import register, register_each
from modelsel.study.preparation.checks import check_setup

ROBOTS = ("ur5", "ur5e", "ur10", "puma760")


@dataclass(frozen=True)
class _Points:
    """Points (k, 2) in a curved valley."""

    xy: Array

    def take(self, which: Index) -> _Points:
        return _Points(self.xy[which])

    def put(self, which: Index, others: _Points) -> _Points:
        xy = self.xy.copy()
        xy[which] = others.xy
        return _Points(xy)


@dataclass(frozen=True)
class _Valley:
    """Rosenbrock's valley, each of another steepness (k,)."""

    steepness: Array

    def take(self, which: Index) -> _Valley:
        return _Valley(self.steepness[which])

    def _residuals(self, points: _Points) -> Array:
        x, y = points.xy.T
        return np.stack([1 - x, self.steepness * (y - x**2)], 1)

    def cost(self, points: _Points) -> Array:
        return np.square(self._residuals(points)).sum(1)

    def equations(self, points: _Points) -> tuple[Array, Array]:
        x, _ = points.xy.T
        one, a = np.ones_like(x), self.steepness
        J = np.stack([np.stack([one, 0 * x], 1), np.stack([2 * a * x, -a], 1)], 1)
        r = self._residuals(points)
        return np.einsum("kri,krj->kij", J, J), np.einsum("kri,kr->ki", J, r)

    def move(self, points: _Points, steps: Array) -> _Points:
        return _Points(points.xy + steps)


@seeds(1, 2, 3)
def test_states_end_where_each_ends_alone(rng) -> None:
    starts, steepness = rng.uniform(-2, 2, (20, 2)), rng.uniform(1, 8, 20)
    starts[4] = [1, 1]  # a minimum from the beginning
    together = minimise(_Points(starts), _Valley(steepness)).xy
    alone = [
        minimise(_Points(starts[[k]]), _Valley(steepness[[k]])).xy[0] for k in range(len(starts))
    ]
    np.testing.assert_allclose(together, alone, rtol=0, atol=1e-12)
    np.testing.assert_allclose(together, 1, atol=1e-5)


def sight_of(at: Problem) -> Sight:
    return build_sight(at, np.zeros(len(at), np.intp), 1)


def turned_starts(sight: Sight, count: int, rng: np.random.Generator) -> list[Placed]:
    """Placements turned and shifted at will: from some of them nothing fits."""
    starts = []
    for R in Rotation.random(count, rng=rng).as_matrix():
        t = rng.normal(0, 2000, (1, 3))
        starts.append(Placed(R[None], t, sight.usual + rng.normal(0, 100, (1, 3))))
    return starts


def assert_alike(found: Placed, wanted: Placed) -> None:
    np.testing.assert_allclose(found.R, wanted.R, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.t, wanted.t, rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(found.tools, wanted.tools, rtol=1e-9, atol=1e-6)


@seeds(1, 2)
def test_starts_are_refined_as_each_alone(rng) -> None:
    """Those that are left behind in a poor minimum too, of two sights at once."""
    sights = [sight_of(arm(rng, name, 40)) for name in ("ur5", "puma760") for _ in range(4)]
    starts = [start for sight in sights for start in turned_starts(sight, 1, rng)]
    stacked = stack_sights(sights)
    refined = refine_robustly(stacked, stack_placed(starts))
    fitted, good = refine_without_gross_rows(stacked, refined)
    misfits = compute_misfits(stacked, fitted)
    for k, (sight, start) in enumerate(zip(sights, starts, strict=True)):
        one = stack_sights([sight])
        alone = refine_robustly(one, stack_placed([start]))
        assert_alike(refined.take(k), alone.take(0))
        last, own_good = refine_without_gross_rows(one, alone)
        assert_alike(fitted.take(k), last.take(0))
        np.testing.assert_array_equal(good[k], own_good[0])
        np.testing.assert_allclose(misfits[k], compute_misfits(sight, last.take(0)), atol=1e-6)


@seeds(1, 2)
def test_problems_are_registered_as_each_alone(rng, monkeypatch) -> None:
    """The same positions with the right robot and with others, and as many of other rows; one that is
    refused leaves the others as they are."""
    monkeypatch.setattr(placement_search, "REMEMBERED", 0)
    at = arm(rng, "ur5", 40)
    problems = [replace(at, robot=load_robot(name)) for name in ROBOTS]
    fewer = at.take(np.arange(len(at)) < 30)
    refused = at.take(np.arange(len(at)) < 3)
    problems += [fewer, refused]
    *together, none = register_each(problems)
    assert none is None
    with pytest.raises(NotEstimable):
        register(refused, np.ones(3, bool), per_group=False)
    for problem, found in zip(problems, together, strict=False):
        assert found is not None
        alone = register(problem, np.ones(len(problem), bool), per_group=False)
        np.testing.assert_allclose(found.placement[0], alone.placement[0], atol=1e-9)
        np.testing.assert_allclose(found.placement[1], alone.placement[1], rtol=1e-9, atol=1e-6)
        np.testing.assert_allclose(found.tools, alone.tools, rtol=1e-9, atol=1e-6)


@seeds(1)
def test_other_robots_are_searched_in_one_go(rng, monkeypatch) -> None:
    monkeypatch.setattr(placement_search, "REMEMBERED", 0)
    at = arm(rng, "ur5", 40)
    calls = []
    refine = placement_search.refine_robustly

    def counted(sight: Sight, starts: Placed) -> Placed:
        calls.append(len(sight.x))
        return refine(sight, starts)

    monkeypatch.setattr(placement_search, "refine_robustly", counted)
    register_each([replace(at, robot=load_robot(name)) for name in ROBOTS])
    # the first starts, the others, and the rows in full
    assert len(calls) <= 4
    assert calls[0] == 2 * len(ROBOTS)


@pytest.mark.slow
@seeds(1)
def test_a_check_made_again_searches_nothing(rng, monkeypatch) -> None:
    """`modelsel init` and `modelsel check` both describe a file and try its study."""
    at = arm(rng, "ur5", 14)
    q = rng.permutation(at.data.q)  # no arm has these readings
    wrong = replace(at, data=replace(at.data, q=q))
    use = np.ones(len(at), bool)
    searched = []
    find = placement_search._find_alike

    def counted(sights: list[Sight]) -> object:
        searched.extend(sights)
        return find(sights)

    monkeypatch.setattr(placement_search, "_find_alike", counted)
    registered = register(wrong, use, per_group=False)
    notes = check_setup(registered, use, registered=True, per_group=False)
    count = len(searched)
    assert count > len(ROBOTS)
    hashes = {placement_search._hash_sight(sight) for sight in searched}
    assert len(hashes) == count
    again = check_setup(
        register(wrong, use, per_group=False), use, registered=True, per_group=False
    )
    assert len(searched) == count
    assert [note.sentence for note in again] == [note.sentence for note in notes]


def test_what_is_remembered_is_limited(rng, monkeypatch) -> None:
    monkeypatch.setattr(placement_search, "REMEMBERED", 3)
    at = arm(rng, "ur5", 20)
    for rows in range(12, 20):
        few = at.take(np.arange(len(at)) < rows)
        register(few, np.ones(rows, bool), per_group=False)
    assert len(placement_search._remembered) == 3


@seeds(1, 2)
@pytest.mark.parametrize("set_up", [True, False])
def test_arms_are_fitted_as_each_alone(set_up, rng) -> None:
    """Zeros, links and both, of different counts."""
    at = arm(rng, "puma760", 30, registered=False)
    q = at.data.q.copy()
    q[:, 2] += rng.uniform(0.2, 0.6)
    wrong = replace(at, data=replace(at.data, q=q))
    n = wrong.robot.n
    free = [[0], [2], [4], [n + 6, n + 7, n + 8], [2, n + 3, n + 4, n + 5], [n, n + 1, n + 2]]
    nominal = build_nominal_arm(wrong)
    starts = [replace(nominal, zeros=rng.normal(0, 0.1, n)) for _ in free]
    together = fit_offsets(wrong, starts, free, set_up)
    for start, numbers, found in zip(starts, free, together, strict=True):
        (alone,) = fit_offsets(wrong, [start], [numbers], set_up)
        np.testing.assert_allclose(found.R, alone.R, rtol=0, atol=1e-9)
        np.testing.assert_allclose(found.t, alone.t, atol=1e-6)
        np.testing.assert_allclose(found.offsets(), alone.offsets(), rtol=1e-9, atol=1e-7)
        if not set_up:
            np.testing.assert_array_equal(found.tool, start.tool)
        moved = np.flatnonzero(found.offsets() != start.offsets())
        assert set(moved) <= set(numbers)


@seeds(1)
def test_rounding_is_taken_out_of_rotations(rng) -> None:
    R = Rotation.random(50, rng=rng).as_matrix()
    tidied = tidy_rotations(R + rng.normal(0, 1e-9, R.shape))
    assert np.abs(np.swapaxes(tidied, 1, 2) @ tidied - np.eye(3)).max() < 1e-15
    assert np.abs(tidied - R).max() < 1e-8
