"""Columns by place and cause against the design written out, and views against refitted ones."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from builders import drawn, seeds

from modelsel import _workers
from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.columns import candidate_columns, row_blocks, screw_columns
from modelsel.diagnosis.columns.candidate_columns import build_columns, stack_design
from modelsel.diagnosis.columns.kept_causes import KeptCauses, evaluate_everywhere
from modelsel.diagnosis.columns.screw_columns import ScrewColumns, build_screw_columns
from modelsel.diagnosis.inference.evidence import Chance
from modelsel.diagnosis.inference.scan import (
    Response,
    build_scan,
    build_scan_without,
    compute_basis,
)
from modelsel.diagnosis.rivals.contenders import Contenders, gather_contenders
from modelsel.diagnosis.search.state import Search
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.fitting.design import Model
from modelsel.fitting.least_squares import fit
from modelsel.fitting.linearisation import Linearisation
from modelsel.fitting.problem import Problem
from modelsel.mechanisms.causes import Applied, Bump, Named, State, cos, q, sin
from modelsel.mechanisms.registry import every, mechanism
from modelsel.mechanisms.terms import Mechanism, Screw, Term

# one screw; several at several places; two at one place; a number as cause
TERMS = (
    Term("a", (Screw(2, "rz", sin(q(2))),)),
    Term("b", (Screw(2, "rz", cos(q(2))), Screw(3, "tx", sin(q(2))), Screw(5, "rx", q(4)))),
    Term("c", (Screw(4, "ty", Named("payload_kg")), Screw(4, "ty", sin(3.0 * q(1))))),
    Term("d", (Screw(7, "tz", sin(0.0 * q(1) + 1.0)),)),
    Term("e", (Screw(2, "rz", q(3)),)),
)


@cache
def offer() -> tuple[Candidate, ...]:
    """Every candidate of a PUMA, for tests that ask nothing of the rows they are made for."""
    at = drawn("puma760", np.random.default_rng(1), 30)
    return build_candidates(at, Model(()), every(at.robot))


def columns_of(at: Problem, memory_mb: float = 500.0) -> tuple[ScrewColumns, np.ndarray]:
    point = Linearisation(TERMS, np.array([1e-3, 0.1, 0.05, 0.2, 1e-3]))
    screws = build_screw_columns(at, TERMS, point, memory_mb)
    return screws, stack_design(at, TERMS, point)[0]


def make_contenders(
    at: Problem,
    base: Model,
    listed: tuple[Candidate, ...],
    contenders: list[Candidate],
    memory_mb: float,
) -> Contenders:
    """Contenders beside the base in a search with so much memory."""
    rng = np.random.default_rng(1)
    search = Search(at, base, listed, rng, fit(at, base), memory_mb)
    return gather_contenders(search, search.first, contenders)


@seeds(1, 2)
@pytest.mark.parametrize("rows", [30, 700])  # within one piece of rows, and beyond
def test_products_are_those_of_the_columns(rng: np.random.Generator, rows: int) -> None:
    screws, X = columns_of(drawn("puma760", rng, rows))
    prior = 4
    V = rng.normal(size=(len(X) + prior, 7))
    np.testing.assert_allclose(screws.dot(V), X.T @ V[:-prior], rtol=1e-11, atol=1e-9)
    np.testing.assert_allclose(screws.dot(V[:, 0]), X.T @ V[:-prior, 0], rtol=1e-11, atol=1e-9)
    some = np.array([3, 1, 2])
    np.testing.assert_allclose(screws.expand(some), X[:, some].T, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(screws.gram(some), X[:, some].T @ X[:, some], rtol=1e-12)
    lone = np.array([0, 4, 0])  # at one place
    np.testing.assert_allclose(screws.gram(lone), X[:, lone].T @ X[:, lone], rtol=1e-12)
    none = np.zeros(0, np.intp)
    assert screws.expand(none).shape == (0, screws.rows)
    assert screws.gram(none).shape == (0, 0)
    single = screws.dot(V.astype(np.float32))
    assert single.dtype == np.float32
    scale = np.linalg.norm(X, axis=0)[:, None] * np.linalg.norm(V, axis=0)
    assert (np.abs(single - screws.dot(V)) < 1e-6 * scale).all()


def test_products_do_not_depend_on_the_memory_that_is_allowed(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Causes that are kept and causes that are evaluated where they are needed: the same bytes."""
    at = drawn("puma760", rng, 60)
    kept, X = columns_of(at)
    evaluated, _ = columns_of(at, 1e-6)
    assert all(block.kept is not None for block in kept.blocks)
    assert all(block.kept is None for block in evaluated.blocks)
    V = rng.normal(size=(len(X), 3))
    assert np.array_equal(kept.dot(V), evaluated.dot(V))
    assert np.array_equal(kept.expand(np.arange(5)), evaluated.expand(np.arange(5)))
    for module in (row_blocks, screw_columns):
        monkeypatch.setattr(module, "CACHED_ROWS", 7)
    np.testing.assert_allclose(evaluated.dot(V), kept.dot(V), rtol=1e-12, atol=1e-9)


def test_as_many_blocks_are_kept_as_memory_is_allowed(rng: np.random.Generator) -> None:
    at = drawn("puma760", rng, 5000)
    kept, X = columns_of(at)
    causes = len(kept.blocks[0].wide)
    first = len(kept.blocks[0].fields)
    some, _ = columns_of(at, 8e-6 * causes * (first + 1) / screw_columns.CAUSES_SHARE)
    assert [block.kept is not None for block in some.blocks] == [True, False]
    V = rng.normal(size=(len(X), 2))
    assert np.array_equal(kept.dot(V), some.dot(V))


def test_a_function_of_several_causes_is_evaluated_once(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    at = drawn("puma760", rng, 20)
    once, other = Applied("tanh", 2.0 * q(2)), Applied("exp", q(1))
    causes = (once, once * other, other + once, q(3) * (once - 2.0), once * 3.0)
    want = [cause.of(at.state) for cause in causes]
    asked: list[object] = []
    evaluate = Applied.of

    def count(cause: Applied, state: State) -> object:
        asked.append(cause)
        return evaluate(cause, state)

    monkeypatch.setattr(Applied, "of", count)
    values = evaluate_everywhere(at, causes)
    assert np.array_equal(values, want)
    assert sorted(map(str, asked)) == ["exp(q1)", "tanh(2*q2)"]


def test_columns_of_the_same_rows_share_their_causes(rng: np.random.Generator) -> None:
    """Whatever comes first, and beyond the room that was left, products are those of the columns by
    themselves; those that were built before stay as they were."""
    at = drawn("puma760", rng, 40)
    alone, X = columns_of(at)
    V = rng.normal(size=(len(X), 3))
    known = KeptCauses()
    first = build_screw_columns(at, TERMS[3:], None, 500.0, known)
    before = first.dot(V)
    many = tuple(Term(f"w{k}", (Screw(2, "rz", sin(0.01 * k * q(1))),)) for k in range(200))
    build_screw_columns(at, many, None, 500.0, known)
    point = Linearisation(TERMS, np.array([1e-3, 0.1, 0.05, 0.2, 1e-3]))
    later = build_screw_columns(at, TERMS, point, 500.0, known)
    assert np.array_equal(first.dot(V), before)
    np.testing.assert_allclose(later.dot(V), alone.dot(V), rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(later.expand(np.arange(5)), X.T, rtol=1e-12, atol=1e-12)
    kept = later.blocks[0].kept
    assert kept is not None
    again = build_screw_columns(at, TERMS, point, 500.0, known).blocks[0].kept
    assert np.shares_memory(kept, again)


@pytest.mark.parametrize("share", [0.5, 1.5])
def test_contenders_take_the_memory_that_the_search_leaves(
    rng: np.random.Generator, share: float
) -> None:
    """Causes of contenders are kept only where the search's own leave room; their Bayes factors are
    the same."""
    at = drawn("puma760", rng, 60)
    base = Model((mechanism("geometric", at.robot),))
    listed = build_candidates(at, base, ())[:800]
    free = tuple(
        Mechanism(f"own {k}", (Term("own", (Screw(3, "rz", sin(0.1 * k * q(2))),)),))
        for k in range(40)
    )
    contenders = [Candidate(one, CandidateKind.PRODUCT, 1e-3) for one in free]
    ample = make_contenders(at, base, listed, contenders, 500.0)
    taken_mb = ample.search.causes.count_mb()
    needed_mb = len(free) * len(at) * 8e-6 / screw_columns.CAUSES_SHARE
    assert taken_mb > needed_mb
    tight = make_contenders(at, base, listed, contenders, taken_mb + share * needed_mb)
    assert (tight._seen.columns.screws.blocks[0].kept is not None) == (share > 1)
    factors, wanted = (each.weigh((), contenders) for each in (tight, ample))
    np.testing.assert_allclose(factors, wanted, rtol=1e-9)


def test_splines_are_kept_where_they_are_not_zero(rng: np.random.Generator) -> None:
    """Products, columns and mean squares are those of the splines in full, of a few of the rows'
    numbers."""
    at = drawn("puma760", rng, 5000)  # more than one block of rows
    splines = [Bump("q2", centre, 0.1) for centre in np.arange(-2.0, 0.5, 0.1).tolist()]
    own = [Term(f"s{k}", (Screw(2, "rz", one),)) for k, one in enumerate(splines)]
    twice = Term("twice", (Screw(2, "rz", splines[3]), Screw(4, "tx", splines[4])))
    terms = (TERMS[0], *own, twice, TERMS[4])
    screws = build_screw_columns(at, terms, None, 500.0)
    X, _ = stack_design(at, terms, None)
    V = rng.normal(size=(len(X), 4))
    np.testing.assert_allclose(screws.dot(V), X.T @ V, rtol=1e-11, atol=1e-7)
    single = screws.dot(V.astype(np.float32))
    assert single.dtype == np.float32
    every = np.arange(len(terms))
    np.testing.assert_allclose(screws.expand(every), X.T, rtol=1e-12, atol=1e-12)
    at_one_place = np.setdiff1d(every, [len(terms) - 2])
    own_columns = X[:, at_one_place]
    np.testing.assert_allclose(
        screws.gram(at_one_place), own_columns.T @ own_columns, rtol=1e-11, atol=1e-6
    )
    others = at_one_place[[-1, 3, 4]]  # a wide cause and two splines
    products = screws.multiply(at_one_place, others)
    np.testing.assert_allclose(products, own_columns.T @ X[:, others], rtol=1e-11, atol=1e-6)
    squares = screws.mean_squares(at, splines)
    for one in splines:
        assert squares[one] == pytest.approx(np.square(one.of(at.state)).mean(), rel=1e-12)
    kept = sum(len(block.local.values) for block in screws.blocks)
    assert kept == sum(np.count_nonzero(one.of(at.state)) for one in splines)
    assert kept < 0.2 * len(splines) * len(at)


@pytest.mark.integration
def test_columns_that_are_asked_for_again_are_kept_within_bounds(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    at = drawn("puma760", rng, 30)
    cols = build_columns(at, offer())
    first = cols.expand(0)
    assert cols.expand(0) is first
    monkeypatch.setattr(candidate_columns, "KEPT_NUMBERS", 10 * cols.rows)
    for g in range(20):
        assert np.array_equal(cols.expand(g), cols.screws.expand(cols.slices[g]))
    assert cols.expand(0) is not first
    assert cols.expand(19) is cols.expand(19)


@pytest.mark.integration
def test_gram_matrices_are_those_of_the_columns(rng: np.random.Generator) -> None:
    """Of candidates at one place, from the lengths of rows, and of those at several."""
    at = drawn("puma760", rng, 30)
    cols = build_columns(at, offer())
    fields = cols.screws.lone_field
    kinds = set()
    for block in cols.grams:
        for i, gram in zip(block.index, block.gram, strict=True):
            kinds.add(len(set(fields[i])) == 1 and fields[i[0]] >= 0)
            X = cols.screws.expand(i)
            scale = np.linalg.norm(X, axis=1)
            assert (np.abs(gram - X @ X.T) <= 1e-12 * np.outer(scale, scale)).all()
    assert kinds == {True, False}


def test_places_have_their_columns_in_runs(rng: np.random.Generator) -> None:
    """All columns of ordered terms but few stand in slices, and products are those of the columns,
    whatever the order of the terms."""
    at = drawn("puma760", rng, 30)
    cols = build_columns(at, offer())
    runs = [run.causes for place in cols.screws.places for run in place.runs]
    sliced = sum(run.stop - run.start for run in runs if isinstance(run, slice))
    assert sliced > 0.9 * cols.screws.count
    V = rng.normal(size=(cols.rows, 2))
    products = cols.dot(V)
    every_column = cols.screws.expand(np.arange(cols.screws.count))
    np.testing.assert_allclose(products, every_column @ V, rtol=1e-9, atol=1e-6)


def test_directions_beyond_a_model_are_orthonormal(rng: np.random.Generator) -> None:
    """Of few columns and of many, of candidates that are free of the model and of those that it
    has in part: W left Wᵀ is the identity on what is left."""
    at = drawn("puma760", rng, 60)
    cols = build_columns(at, offer())
    some = np.concatenate([cols.slices[g][:1] for g in rng.choice(cols.groups, 40)])
    seen = build_scan(cols, compute_basis(cols.screws.expand(some).T))
    partly = 0
    for bucket in seen.buckets:
        sizes = seen.sizes[bucket.block.which].astype(int)
        partly += int((sizes < bucket.left.shape[1]).sum())
        identity = bucket.W @ bucket.left @ bucket.W.swapaxes(1, 2)
        own = np.einsum("nkk->nk", identity)
        np.testing.assert_allclose(np.sort(own, 1).round(4), np.sort(own.round(), 1))
        assert np.array_equal(own.round().sum(1), sizes)
        off = identity - own[:, :, None] * np.eye(own.shape[1])
        assert np.abs(off).max(initial=0) < 1e-4
    assert partly > 10


def test_products_do_not_depend_on_the_number_of_cores(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    screws, X = columns_of(drawn("puma760", rng, 1100))
    V = rng.normal(size=(len(X), 3))
    monkeypatch.setattr(screw_columns, "MANY_PRODUCTS", 0)
    results = []
    for cores in (1, 2):
        monkeypatch.setattr(_workers, "count_cores", lambda cores=cores: cores)
        results.append(screws.dot(V))
    assert np.array_equal(*results)


@pytest.mark.slow
@seeds(3, 4)
def test_a_scan_without_an_effect_is_that_of_the_smaller_model(rng: np.random.Generator) -> None:
    """Giving directions back against projecting afresh: sizes, strengths and displacements."""
    at = drawn("puma760", rng, 80)
    base = Model((mechanism("geometric", at.robot),))
    fitted = fit(at, base)
    found = build_candidates(at, base, every(at.robot))
    cols = build_columns(at, found, fitted.at())
    X, r = stack_design(at, base.terms, fitted.at())
    r = r + rng.normal(size=len(r))
    Q = compute_basis(X[:, list(fitted.found.kept)])
    extra = cols.expand(100).T
    more = compute_basis(extra - Q @ (Q.T @ extra))
    whole = build_scan(cols, np.column_stack([Q, more]))
    given_back = np.eye(whole.Q.shape[1])[:, Q.shape[1] :]
    seen, direct = build_scan_without(whole, given_back), build_scan(cols, Q)
    y = r - Q @ (Q.T @ r)
    response = direct.see(y)
    assert np.array_equal(seen.sizes, direct.sizes)
    assert seen.freedom == direct.freedom
    got, want = seen.strength(response.column), direct.strength(response.column)
    for one, other in zip(got, want, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-8)
    a, b = seen.displace(100, response), seen.displace(7, response)
    c, d = direct.displace(100, response), direct.displace(7, response)
    assert a.dot(b) == pytest.approx(c.dot(d), rel=1e-6, abs=1e-8)

    def projected(g: int) -> np.ndarray:
        moved = direct.fit_alone(g, response) @ cols.expand(g)
        return moved - Q @ (Q.T @ moved)

    assert a.dot(b) == pytest.approx(projected(100) @ projected(7), rel=1e-6, abs=1e-8)


@pytest.mark.slow
@seeds(5, 6)
def test_the_evidence_of_chance_stays_below_its_bound(rng: np.random.Generator) -> None:
    """With candidates of every number of columns, signs and free functions, from noise to an effect
    that stands far out."""
    at = drawn("puma760", rng, 60)
    base = Model((mechanism("geometric", at.robot),))
    fitted = fit(at, base)
    found = build_candidates(at, base, every(at.robot))
    cols = build_columns(at, found, fitted.at())
    Q = compute_basis(stack_design(at, base.terms, fitted.at())[0])
    seen = build_scan(cols, Q)
    assert len(seen.signed)
    assert len(seen.smooth[0])
    sizes = np.geomspace(0.01, 1e3, 12)
    effects = np.stack([cols.expand(int(g))[0] for g in rng.choice(cols.groups, 12)], 1)
    y = rng.normal(size=(len(Q), 12)) + effects / np.linalg.norm(effects, axis=0) * sizes
    y -= Q @ (Q.T @ y)
    log_prior = np.log([c.prior for c in found])
    chance = Chance(seen, log_prior, cols.dot(y), np.square(y).sum(0))
    assert (chance.evidence <= chance.most).all()
    assert (chance.most - chance.evidence).min() < 12  # and the bound is worth something
    assert (chance.first <= chance.evidence).all()
    assert (chance.evidence <= chance.ceiling).all()
    largest = float(chance.evidence.max())
    for level in (-np.inf, 0.5 * largest, largest, largest + 0.1, largest + 9, largest + 99):
        fresh = Chance(seen, log_prior, cols.dot(y), np.square(y).sum(0))
        assert fresh.stays_below(level) == (largest < level)
    for level in (-np.inf, float(np.median(chance.evidence)), np.inf):
        below = chance.below(level)
        assert ((below >= level) == (chance.evidence >= level)).all()
        exact = chance.evidence >= level
        assert below[exact] == pytest.approx(chance.evidence[exact])
    single = Response(cols.dot(y[:, 3]), float(y[:, 3] @ y[:, 3]))
    assert single.column.shape == (cols.screws.count, 1)
