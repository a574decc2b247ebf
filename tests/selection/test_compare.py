"""The choice among subsets, where plain AIC and BIC choose a huge model: forty configurations,
columns made of noise."""

from __future__ import annotations

import itertools
from dataclasses import replace
from math import comb

import numpy as np
import pytest
from builders import drawn, planted, seeds

from modelsel.diagnosis.candidates.candidate_list import build_candidates, choose_strongest
from modelsel.fitting.design import Model, compute_design
from modelsel.fitting.least_squares import fit
from modelsel.fitting.whitening import Whitening
from modelsel.mechanisms.causes import ONE, Named, cos, q, sin
from modelsel.mechanisms.registry import every, mechanism
from modelsel.mechanisms.terms import Mechanism, Screw, Term
from modelsel.robot.files import load_robot
from modelsel.selection.comparison import MAX_CANDIDATES, SubsetComparison, compare_subsets
from modelsel.selection.criteria import aic, bic
from modelsel.selection.cross_validation import fold
from modelsel.selection.evaluation import Split, evaluate
from modelsel.selection.splits import assign_folds
from modelsel.selection.subsets import sweep_subsets

ARM = load_robot("puma760")
BASE = Model((mechanism("geometric", ARM),))
TRUE = ("joint2-twist", "joint3-twist")
SIGMA, ESTIMATION, HELD_OUT = 0.1, 40, 200


def harmonics(k: int, rng: np.random.Generator, width: int = 15) -> Mechanism:
    """A mechanism of nothing: high harmonics of drawn joints at drawn places, `width` of them at
    once."""
    orders = rng.choice(np.arange(3, 90), width, replace=False)

    def screw(order: int) -> Screw:
        angle = float(order + 0.01 * k) * q(int(rng.integers(1, 7)))
        return Screw(
            int(rng.integers(2, 7)), str(rng.choice(["rx", "ry", "rz"])), (sin, cos)[k % 2](angle)
        )

    return Mechanism(
        f"noise:{k}", tuple(Term(f"n{k}_{order}", (screw(order),)) for order in orders)
    )


def study(rng: np.random.Generator, size: float, estimation: int = ESTIMATION) -> Split:
    """Truth: geometric errors and `size` times the paper's h1 h2 h3; noise; `estimation`
    configurations fit."""
    effects = tuple(mechanism(name, ARM) for name in TRUE)
    terms = (BASE + effects).terms
    constant = [rng.normal() * (1.0 if t.unit == "mm" else 2e-3) for t in BASE.terms]
    theta = np.array(constant + [size * h for h in (-0.2e-3, -1.4e-3, -1.7e-3)])
    at = planted(drawn(ARM, rng, estimation + HELD_OUT), terms, theta, rng, SIGMA)
    inside = np.arange(len(at)) < estimation
    folds = np.full(len(at), -1)
    folds[inside] = assign_folds(at.data.take(inside), 10, rng)
    return Split(at, inside, np.zeros(len(at), bool), folds, known_sigma=False)


def compared(split: Split, offered: tuple[Mechanism, ...]) -> SubsetComparison:
    return compare_subsets(split, fit(split.training, BASE), offered, ("geometric",))


class Table:
    """Every subset refitted plainly (linear about the base's fit) on the estimation rows, and its
    held-out rms."""

    def __init__(self, split: Split, offered: tuple[Mechanism, ...]):
        base = fit(split.training, BASE, held="nothing")
        terms = (BASE + offered).terms
        X, r = compute_design(split.problem, terms, base.at())
        inside = split.estimation
        train, test = (X[rows].reshape(-1, len(terms)) for rows in (inside, ~inside))
        kept, ends = (
            list(base.found.kept),
            np.cumsum([len(BASE.terms), *(len(c.terms) for c in offered)]),
        )
        groups = [list(range(a, b)) for a, b in itertools.pairwise(ends)]
        found = sweep_subsets(
            fold(split.training, terms, split.training_folds, base.at()), kept, groups
        )
        self.names = [tuple(offered[g].name for g in np.flatnonzero(m)) for m in found.members]
        self.rss, self.rank, self.n = np.maximum(found.rss, 1e-20), found.rank, inside.sum() * 3
        self.rms = np.empty(len(found.rss))
        for s, m in enumerate(found.members):
            columns = [*kept, *(c for g in np.flatnonzero(m) for c in groups[g])]
            scale = np.linalg.norm(train[:, columns], axis=0)
            beta = np.linalg.lstsq(train[:, columns] / scale, r[inside].ravel(), rcond=1e-12)[0]
            self.rms[s] = np.sqrt(
                np.square(r[~inside].ravel() - test[:, columns] / scale @ beta).mean() * 3
            )


@pytest.mark.integration
@pytest.mark.parametrize(
    ("rng", "size"),
    [(1, 1.0), (2, 1.0), (3, 1.0), (1, 0.0), (5, 0.0)],
    indirect=["rng"],
    ids=["gravity-seed1", "gravity-seed2", "gravity-seed3", "nothing-seed1", "nothing-seed5"],
)
def test_choice_where_aic_and_bic_fail(size, rng) -> None:
    """Six times fifteen columns of noise on 40 configurations: AIC and BIC take all 120, three
    times worse held out and more; the one-standard-error choice stays within a tenth of the best of
    all 256 subsets."""
    offered = (*(mechanism(name, ARM) for name in TRUE), *(harmonics(k, rng) for k in range(6)))
    data = study(rng, size)
    table = Table(data, offered)
    for criterion in (aic, bic):
        taken = int(np.argmin(criterion(table.rss, table.n, table.rank)))
        assert table.rank[taken] > 100, criterion.__name__
        assert table.rms[taken] > 3 * table.rms.min()
    choice = compared(data, offered).choice
    assert choice[0] == "geometric"
    held = table.rms[table.names.index(choice[1:])]
    assert held <= 1.1 * table.rms.min(), (
        f"chose {choice}: {held:.3f} mm, best {table.rms.min():.3f} mm"
    )


@pytest.mark.integration
@seeds(1)
def test_notes_go_by_the_weighted_errors_of_cross_validation(rng) -> None:
    """Orientations weigh, and CV rms does not have them: the row with the note is the first, of
    whatever CV rms, and the note says what it goes by."""
    offered = (*(mechanism(name, ARM) for name in TRUE), harmonics(0, rng, 3))
    table = compared(study(rng, 1.0, estimation=60), offered)
    first = table.best[0]
    assert "lowest weighted CV" in first.note.split("; ")
    assert not any("lowest CV" in row.note for row in table.best)


@pytest.mark.slow
@seeds(1, 2)
def test_table(rng) -> None:
    """Rows are measured one linear step from the base's fit, which the exact fit bears out; the
    choice is marked; weights are of all that was compared."""
    offered = (
        *(mechanism(name, ARM) for name in TRUE),
        harmonics(0, rng, 3),
        mechanism("wrist-coupling:5", ARM),
    )
    data = study(rng, 1.0, estimation=80)
    table = compared(data, offered)
    assert table.compared == 16
    assert set(table.choice) >= {"geometric", *TRUE}
    assert set(table.considered) == {c.name for c in offered}
    assert table.set_aside == ()
    assert 0 < sum(r.weight for r in table.best) <= 1 + 1e-9
    (marked,) = [r for r in table.best if "one-standard-error choice" in r.note]
    assert marked.names == table.choice
    assert sum(part == "lowest weighted CV" for r in table.best for part in r.note.split("; ")) == 1
    for row in table.best:
        again = evaluate(data, BASE + tuple(c for c in offered if c.name in row.names), row.names)
        assert row.rank == again.rank
        assert row.held_out.rms_mm == pytest.approx(again.held_out.rms_mm, rel=0.01)
        assert row.cv_rms_mm == pytest.approx(again.cv_rms_mm, rel=0.01)
    assert marked.held_out.rms_mm == pytest.approx(SIGMA * np.sqrt(3), rel=0.25)


@pytest.mark.integration
@seeds(1, slow=(2,))
@pytest.mark.parametrize("known", [True, False])
def test_one_definition_of_every_criterion(known, rng) -> None:
    """Of known sigma or unknown, a row's criteria are of one kind, its own rung's; EBIC adds the
    price of the groups that were scanned; the notes say which row has the lowest; weights are
    exp(evidence) by that sigma."""
    offered = (*(mechanism(name, ARM) for name in TRUE), *(harmonics(k, rng, 3) for k in range(4)))
    data = replace(study(rng, 0.3, estimation=60), known_sigma=known)
    data = replace(data, problem=replace(data.problem, whitening=Whitening(1 / SIGMA)))
    table = compare_subsets(
        data, fit(data.training, BASE, held="nothing"), offered, ("geometric",), (), 4860
    )
    rows = {row.names[1:]: row for row in table.best}
    for names, row in rows.items():
        assert row.ebic - row.bic == pytest.approx(2 * np.log(comb(4860, len(names))), rel=1e-6)
        again = evaluate(data, BASE + tuple(c for c in offered if c.name in names), row.names)
        assert row.bic == pytest.approx(again.bic, abs=0.5)
        assert row.aicc == pytest.approx(again.aicc, abs=0.5)
    values = Table(data, offered)
    every = bic(values.rss, values.n, values.rank, 1.0 if known else None)
    lowest = values.names[int(np.argmin(every))]
    assert "lowest BIC" in rows[lowest].note or "lowest weighted CV" in rows[lowest].note
    assert rows[lowest].bic == min(row.bic for row in table.best)
    if known:
        two = list(rows)[:2]
        price = {s: np.log(comb(6, len(s))) for s in two}
        n, rss = values.n, {s: values.rss[values.names.index(s)] for s in two}
        rank = {s: values.rank[values.names.index(s)] for s in two}
        score = {s: -n / (1 + n) * rss[s] / 2 - rank[s] / 2 * np.log(1 + n) - price[s] for s in two}
        assert np.log(rows[two[0]].weight / rows[two[1]].weight) == pytest.approx(
            score[two[0]] - score[two[1]], rel=1e-4
        )


def test_rung_cross_validates_like_refits(rng) -> None:
    """cv_rms_mm: every fold's rows under the linear fit of the others, about the whole fit."""
    data = study(rng, 1.0)
    whole = evaluate(data, BASE, ("geometric",))
    at, folds = data.training, data.training_folds
    X, r = compute_design(at, BASE.terms, whole.fit.at())
    kept, left, prior = list(whole.fit.found.kept), np.empty((ESTIMATION, 3)), whole.fit.prior
    for k in np.unique(folds):
        held = folds == k
        A = np.vstack([X[~held][:, :, kept].reshape(-1, len(kept)), prior[:, kept]])
        beta = np.linalg.lstsq(A, np.append(r[~held].ravel(), prior[:, -1]), rcond=1e-15)[0]
        left[held] = r[held] - X[held][:, :, kept] @ beta
    assert whole.cv_rms_mm == pytest.approx(np.sqrt(np.square(left).sum(1).mean()), rel=1e-8)
    assert whole.cv_mean_mm == pytest.approx(np.linalg.norm(left, axis=1).mean(), rel=1e-8)
    fresh = whole.fit.residuals(data.problem.take(~data.estimation))
    assert whole.held_out.rms_mm == pytest.approx(np.sqrt(np.square(fresh).sum(1).mean()))


def test_shared_terms_enter_once(rng) -> None:
    """gravity-twist is joint2-twist and joint3-twist: no row of the table repeats another under a
    longer name."""
    offered = tuple(mechanism(name, ARM) for name in (*TRUE, "gravity-twist"))
    data = study(rng, 1.0, estimation=80)
    table = compared(data, offered)
    assert set(table.choice[1:]) in ({*TRUE}, {"gravity-twist"})
    assert all(
        r.fit.found.rank == len((BASE + tuple(c for c in offered if c.name in r.names)).terms)
        for r in table.best
    )


def test_a_candidate_that_the_base_spans_in_part(rng) -> None:
    """One of its two columns is a joint zero, which the base has: the other must still be found."""
    twist = mechanism("joint2-twist", ARM).terms[1]
    partly = Mechanism("partly", (Term("zero", (Screw(3, "rz", 2.0 * ONE),)), twist))
    data = study(rng, 1.0, estimation=80)
    assert "partly" in compared(data, (partly, mechanism("joint3-twist", ARM))).choice


@seeds(1, 2, 3)
def test_of_equal_models_none_has_the_lowest_criterion_alone(rng) -> None:
    """A mechanism beside itself in other units: rounding alone says which of both is lower, and no
    note says so."""
    joint2, joint3 = (mechanism(name, ARM) for name in TRUE)
    factor = float(rng.uniform(2, 9))
    terms = tuple(
        Term(t.symbol, tuple(Screw(s.frame, s.axis, factor * s.cause) for s in t.screws))
        for t in joint3.terms
    )
    table = compared(study(rng, 1.0, estimation=80), (joint2, joint3, Mechanism("again", terms)))
    lowest = min(one.bic for one in table.best)
    equal = [one for one in table.best if one.bic < lowest + 1e-6]
    assert len(equal) == 2
    assert not any("disagree" in one.note for one in equal)


def test_the_twelve_of_largest_f(rng) -> None:
    """Of more than the table holds, the strong ones; of a scanned mechanism its best constant
    alone; the others named."""
    noise = tuple(harmonics(k, rng, 1) for k in range(14))
    ripples = tuple(Mechanism("ripple", harmonics(20 + k, rng, 1).terms) for k in range(3))
    offered = build_candidates(
        drawn(ARM, rng, 5),
        BASE,
        (*noise, *ripples, *(mechanism(name, ARM) for name in TRUE)),
        cells=False,
    )
    F = np.r_[rng.uniform(0, 2, 14), 5.0, 9.0, 7.0, 50.0, 60.0]
    F[3] = 0.0  # adds no column
    taken, aside = choose_strongest(offered, F)
    assert len(taken) == MAX_CANDIDATES
    assert ripples[1] in taken
    assert not {ripples[0], ripples[2]} & set(taken)
    assert {m.name for m in taken} >= {*TRUE, "ripple"}
    assert len({m.name for m in taken} | set(aside)) == 16  # 14 - 1 + ripple + 2
    assert F[[noise.index(m) for m in taken if m in noise]].min() > max(
        F[int(name.partition(":")[2])] for name in aside
    )


def test_what_was_named_stands_in_the_table(rng) -> None:
    """However weak alone, with the named constant; a named union in place of its parts."""
    noise = tuple(harmonics(k, rng, 1) for k in range(14))
    whole = mechanism("gravity-twist", ARM)
    parts = tuple(mechanism(name, ARM) for name in ("joint2-twist", "joint3-twist"))
    ripples = tuple(Mechanism("ripple", harmonics(20 + k, rng, 1).terms) for k in range(2))
    offered = build_candidates(
        drawn(ARM, rng, 5), BASE, (*noise, *ripples, whole, *parts), cells=False
    )
    F = np.r_[rng.uniform(5, 9, 14), 0.5, 4.0, 1.0, 50.0, 60.0]
    plain, _ = choose_strongest(offered, F)
    assert whole not in plain
    assert set(parts) <= set(plain)
    taken, aside = choose_strongest(offered, F, [offered[14], offered[16]])
    assert {ripples[0], whole} <= set(taken)
    assert not {ripples[1], *parts} & set(taken)
    assert len(taken) == MAX_CANDIDATES
    assert {p.name for p in parts} <= set(aside)


def test_what_may_extend(rng) -> None:
    """What the base holds already, and what the data have no columns for, is no candidate; the
    prior sums to one."""
    at = drawn(ARM, rng, 10, covariates={})
    offered = build_candidates(at, BASE, every(ARM), cells=False)
    names = {c.mechanism.name for c in offered}
    assert "geometric" not in names
    assert "payload-deflection:2" not in names
    assert {"joint2-twist", "backlash:3"} <= names
    assert sum(c.prior for c in offered) == pytest.approx(1)
    lacking = Mechanism(
        "heat", (Term("t", (Screw(2, "tx", Named("temperature_C", "°C") - 20.0),)),)
    )
    assert build_candidates(at, BASE, (lacking,), cells=False) == ()
