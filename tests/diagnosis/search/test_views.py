"""Views of models that extend a base, against all their columns projected together."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from builders import drawn, planted

from modelsel._typing import Array
from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.columns.candidate_columns import stack_design
from modelsel.diagnosis.search import views
from modelsel.diagnosis.search.state import Search
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.fitting.design import Model
from modelsel.fitting.least_squares import fit
from modelsel.mechanisms.environment import tracker_step
from modelsel.mechanisms.registry import every, mechanism
from modelsel.robot.files import load_robot

NAMES = ("free(q4) 20", "encoder-scale:4", "backlash:2", "settle:2")
ARM = load_robot("puma760")
BASE = Model((mechanism("geometric", ARM),))


@cache
def offer() -> tuple[Candidate, ...]:
    """Those that are seen, and every seventh of the others: what a view is does not depend on how
    many there are."""
    found = build_candidates(drawn(ARM, np.random.default_rng(1), 70), BASE, every(ARM))
    return tuple(one for k, one in enumerate(found) if k % 7 == 0 or one.mechanism.name in NAMES)


def search_drawn(rng: np.random.Generator) -> Search:
    """A search on a drawn campaign of a PUMA whose joint 3 has an eccentric encoder."""
    at = drawn(ARM, rng, 70)
    bent = planted(at, mechanism("encoder-eccentricity:3", ARM).terms, [3e-4, 2e-4], rng, 0.03)
    return Search(bent, BASE, offer(), rng, fit(bent, BASE))


def find(search: Search, *names: str) -> list[int]:
    """The candidates of these names."""
    place = {one.mechanism.name: g for g, one in enumerate(search.candidates)}
    return [place[name] for name in names]


def see_strength(view: views.View) -> Array:
    """How much of what the view leaves every candidate explains (G,)."""
    return view.scan.strength(view.response.column).whole[:, 0]


@pytest.mark.slow
@pytest.mark.parametrize("count", range(len(NAMES) + 1))
def test_a_view_holds_all_columns_of_its_model(rng: np.random.Generator, count: int) -> None:
    search = search_drawn(rng)
    view = search.fit_model(find(search, *NAMES[:count]), None)
    rows, kept = search.columns.rows, list(view.kept)
    A, _ = stack_design(search.problem, view.model.terms, search.first.fitted.at())
    size = np.linalg.norm(A, axis=0).max()
    assert view.A.rows == rows
    every = np.arange(len(view.model.terms))
    sizes = rng.normal(size=len(every))
    np.testing.assert_allclose(view.A.move(every, sizes), A @ sizes, atol=1e-8 * size)
    basis = np.zeros((len(view.Q), len(kept)))
    view.A.fill(kept, basis)
    np.testing.assert_allclose(basis[:rows], A[:, kept], atol=1e-9 * size)
    np.testing.assert_allclose(view.Q @ view.R, basis, atol=1e-9 * size)
    np.testing.assert_allclose(view.Q.T @ view.Q, np.eye(len(kept)), atol=1e-9)
    inside = search.columns.dot(view.Q)
    np.testing.assert_allclose(view.scan.inside, inside, atol=1e-9 * np.abs(inside).max())
    assert np.abs(view.Q.T @ view.residual).max() < 1e-9 * np.linalg.norm(view.residual)


@pytest.mark.integration
def test_columns_of_the_last_models_are_remembered_and_the_oldest_forgotten(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    search = search_drawn(rng)
    first, second = find(search, "settle:2"), find(search, "encoder-scale:4")
    before = see_strength(search.fit_model(first, None))
    asked: list[int] = []
    multiply = search.views.columns.screws.dot

    def count(values: Array) -> Array:
        asked.append(values.reshape(len(values), -1).shape[1])
        return multiply(values)

    monkeypatch.setattr(type(search.columns), "dot", lambda _, values: count(values))
    again = see_strength(search.fit_model(first, None))
    np.testing.assert_array_equal(again, before)
    assert asked == [1]  # what is left alone
    monkeypatch.setattr(views, "KEPT_NUMBERS", 0)
    search.fit_model(second, None)
    search.fit_model(first, None)
    assert sum(asked[1:]) > 3


@pytest.mark.integration
def test_a_view_by_itself_sees_the_same(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Linearised at its own fit instead of the base's, which are near each other."""
    search = search_drawn(rng)
    chosen = find(search, *NAMES)
    shared = search.fit_model(chosen, None)
    monkeypatch.setattr(views, "OWN_SHARE", 2.0)  # no column has as much of its own
    alone = search.fit_model(chosen, None)
    assert alone.Q.shape == shared.Q.shape
    assert not np.array_equal(alone.Q, shared.Q)
    np.testing.assert_allclose(see_strength(alone), see_strength(shared), rtol=0.02, atol=0.02)


def test_a_model_that_adds_nothing_has_a_view(rng: np.random.Generator) -> None:
    """A step after the last configuration moves no row."""
    before = search_drawn(rng)
    after = tracker_step(before.problem.robot, 1.5)
    search = before.offer((Candidate(after, CandidateKind.MECHANISM, 1e-3),))
    view = search.fit_model(find(search, "tracker-step")[-1:], None)
    assert view.model.terms[-1].key == after.terms[-1].key
    assert view.Q.shape == search.first.Q.shape
    # shares of one, each rounded as one is
    np.testing.assert_allclose(
        see_strength(view), see_strength(search.first), rtol=1e-6, atol=1e-12
    )
