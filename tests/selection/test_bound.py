"""Branch and bound against every subset walked; a certificate that never claims too much."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from builders import drawn, one, planted, study_of

from modelsel.config.study_file import parse_study
from modelsel.fitting.design import Model
from modelsel.fitting.least_squares import fit
from modelsel.fitting.reduction import reduce
from modelsel.mechanisms.causes import cos, q, sin
from modelsel.results.record import describe_candidates
from modelsel.selection.branch_and_bound import SearchOptions, find_best_subset
from modelsel.selection.comparison import compare_subsets
from modelsel.selection.criteria import bic
from modelsel.selection.cross_validation import pad_blocks
from modelsel.selection.subsets import sweep_subsets

N = 240


def problem(
    rng: np.random.Generator, widths: list[int], base: int, alike: float, planted: dict[int, float]
):
    """(X, y, base columns, groups): columns of any scale, a share `alike` of each common to all."""
    p = base + sum(widths)
    common = rng.normal(size=(N, 1)) + rng.normal(size=(N, 3)) @ rng.normal(size=(3, p))
    X = (1 - alike) * rng.normal(size=(N, p)) + alike * common
    ends = base + np.cumsum([0, *widths])
    groups = [list(range(a, b)) for a, b in pairwise(ends)]
    y = X[:, :base].sum(1) + rng.normal(size=N)
    for g, size in planted.items():
        y = y + size * X[:, groups[g]].sum(1)
    return X * 10.0 ** rng.integers(-4, 5, p), y, list(range(base)), groups


def walked(X, y, base, groups, sigma=None) -> tuple[np.ndarray, np.ndarray]:
    """(members, BIC) of every subset."""
    blocks = [np.column_stack([X, y])[k::4] for k in range(4)]
    found = sweep_subsets(pad_blocks(blocks, [len(b) for b in blocks]), base, groups)
    return found.members, np.asarray(bic(found.rss, N, found.rank, sigma))


@pytest.mark.parametrize("alike", [0.0, 0.3, 0.6])
@pytest.mark.parametrize("seed", range(6))
def test_best_of_every_subset(seed, alike) -> None:
    rng = np.random.default_rng(seed)
    X, y, base, groups = problem(
        rng, rng.integers(1, 4, 10).tolist(), 3, alike, {1: 0.3, 4: 0.15, 7: 0.08}
    )
    members, value = walked(X, y, base, groups)
    found = find_best_subset(reduce(X, y), base, groups)
    assert found.proven
    assert found.members.tolist() == members[value.argmin()].tolist()
    assert found.bic == pytest.approx(value.min(), rel=1e-9)
    first = find_best_subset(
        reduce(X, y), base, groups, SearchOptions(max_nodes=1)
    )  # however early it stops, what it says holds
    assert first.bic - first.gap <= value.min() + 1e-6
    assert first.proven == (first.gap == 0)


@pytest.mark.parametrize("sigma", [0.4, 1.0, 2.5])
@pytest.mark.parametrize("alike", [0.0, 0.5])
def test_best_of_every_subset_where_the_noise_is_known(sigma, alike, rng) -> None:
    """The BIC of a known standard deviation has its own best subset: too small a one asks for more
    groups."""
    X, y, base, groups = problem(
        rng, rng.integers(1, 4, 10).tolist(), 3, alike, {1: 0.3, 4: 0.15, 7: 0.08}
    )
    members, value = walked(X, y, base, groups, sigma)
    found = find_best_subset(reduce(X, y), base, groups, sigma=sigma)
    assert found.proven
    assert found.members.tolist() == members[value.argmin()].tolist()
    assert found.bic == pytest.approx(value.min(), rel=1e-9)
    first = find_best_subset(reduce(X, y), base, groups, SearchOptions(max_nodes=1), sigma=sigma)
    assert first.bic - first.gap <= value.min() + 1e-6


@pytest.mark.integration
def test_forty_groups_are_proven(rng) -> None:
    X, y, base, groups = problem(
        rng, rng.integers(1, 3, 40).tolist(), 10, 0.15, {2: 0.5, 9: -0.4, 17: 0.3, 31: 0.35}
    )
    found = find_best_subset(reduce(X, y), base, groups)
    assert found.proven
    assert {2, 9, 17, 31} <= set(np.flatnonzero(found.members))


def test_doubtful_columns(rng) -> None:
    """A group that the base spans, one that another repeats, one that shares a column: the best of
    those that stand alone."""
    X, y, base, groups = problem(rng, [1, 2, 1, 2, 1], 2, 0.0, {1: 0.4})
    X[:, groups[0][0]] = X[:, 0] - 2 * X[:, 1]
    X[:, groups[3]] = X[:, groups[1]] @ np.array([[1.0, 2.0], [0.5, -1.0]])
    found = find_best_subset(reduce(X, y), base, groups)
    assert found.proven
    assert np.flatnonzero(found.members).tolist() == [1]


@pytest.mark.parametrize("near", [1e-1, 1e-2, 1e-3, 1e-4])
def test_groups_that_are_nearly_alike(near, rng) -> None:
    """Columns that differ by a little from those of another group: no tangent runs away (a warning
    is an error here), and the subset is the best of all."""
    X, y, base, groups = problem(rng, rng.integers(1, 4, 8).tolist(), 2, 0.0, {})
    for g in range(1, 8, 2):
        k = min(len(groups[g]), len(groups[g - 1]))
        X[:, groups[g][:k]] = X[:, groups[g - 1][:k]] * (1 + near * rng.normal(size=(N, k)))
    y = (y + X[:, groups[0]].sum(1) / np.abs(X[:, groups[0]]).max()) * 10.0 ** rng.uniform(-8, 8)
    _, value = walked(X, y, base, groups)
    found = find_best_subset(reduce(X, y), base, groups)
    assert found.bic == pytest.approx(value.min(), rel=1e-6)
    assert found.bic - found.gap <= value.min() + 1e-6 * abs(value.min())


def test_table_of_more_mechanisms_than_can_be_walked(rng) -> None:
    """Eighteen mechanisms, two of them real: the table says that the two are the best of all
    subsets, or by how much they may be beaten."""
    base = Model((one(1, "tx"), one(1, "rz"), one(2, "rz")))
    offered = tuple(
        one(f, a, c)
        for f in (2, 3, 5)
        for a in ("rx", "rz")
        for c in (sin(3 * q(f)), cos(3 * q(f)), q(4))
    )
    real = (offered[4], offered[9])
    at = planted(
        drawn("puma760", rng, 120),
        (*base.terms, *(t for m in real for t in m.terms)),
        np.full(5, 5e-4),
        rng,
        0.05,
    )
    data = study_of(at, held_out=40)
    found = compare_subsets(data, fit(data.training, base), offered, ("base",))
    said = describe_candidates(found)
    assert said["search"] == said["search"] | {
        "mechanisms": 18,
        "proven": True,
        "may_be_beaten_by": 0.0,
    }
    assert set(said["search"]["best"]) == {m.name for m in real}
    (best,) = [r for r in found.best if "of all subsets, proven" in r.note]
    assert set(best.names[1:]) == {m.name for m in real}
    assert best.weight is None
    brief = SearchOptions(max_nodes=1, tangents=1)
    short = compare_subsets(data, fit(data.training, base), offered, ("base",), options=brief)
    assert short.certified is not None
    assert short.certified.proven or any("another may have up to" in r.note for r in short.best)


def test_a_study_asks_for_more() -> None:
    """The option is new: studies without it keep their hash."""
    plain = 'name = "x"\n[robot]\nname = "puma760"\ntool_mm = [0, 0, 1]\n[measurements]\nfile = "m.csv"\n'
    assert "mechanisms" not in parse_study(plain, "study.toml").model_dump_json()
    asked = parse_study(plain + "[comparison]\nmechanisms = 40\n", "study.toml")
    assert asked.comparison.mechanisms == 40
    assert "40" in asked.model_dump_json()
