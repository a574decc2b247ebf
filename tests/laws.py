"""The laws that every registered mechanism obeys on every robot (style.md 2.3): a new mechanism needs no test of its own.

`check_mechanism(mechanism, robot, rng)` is all of them; a plug-in's author may call it too.
"""
from __future__ import annotations

import pickle
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields, is_dataclass, replace

import numpy as np
from builders import bind, drawn, planted

from modelsel import causes
from modelsel.design import Model, design, residuals
from modelsel.fit import fit
from modelsel.identify import identify
from modelsel.reduce import reduce
from modelsel.rigid import AXES
from modelsel.robot import Robot
from modelsel.scene import Scene
from modelsel.screws import Mechanism, Screw, Term

M = 60              # configurations
SIGMA = 0.02        # mm, of L4's noise
COLUMN = 1e-6       # L1's bound
FAR = 500.0         # mm: a usual size that moves the target further is a slip of the catalogue


def check_mechanism(mechanism: Mechanism, robot: Robot, rng: np.random.Generator) -> None:
    """Every law in turn."""
    at = drawn(robot, rng, M)
    carried(mechanism, at)
    for law in LAWS:
        law(mechanism, at, rng)


def carried(mechanism: Mechanism, at: Scene) -> None:
    """The laws' measurements have what the mechanism's causes need."""
    missing = mechanism.names() - at.names().keys()
    assert not missing, f"{mechanism.name} needs {sorted(missing)}, which the laws' measurements lack: add them to builders.drawn"


def joined(mechanisms: Sequence[Mechanism], at_most: int = 50) -> tuple[Mechanism, ...]:
    """The terms of many side by side, for the laws of columns alone (L1 to L3, L7): a few products instead of hundreds."""
    terms = list({t.screws: t for m in mechanisms for t in m.terms}.values())
    return tuple(Mechanism("joined", tuple(terms[k:k + at_most])) for k in range(0, len(terms), at_most))


@contextmanager
def locked(at: Scene, *more: np.ndarray) -> Iterator[Scene]:
    """The scene with every array locked against writing, and found unchanged afterwards."""
    data = at.data
    arrays = [getattr(data, f.name) for f in fields(data) if isinstance(getattr(data, f.name), np.ndarray)]
    arrays += [*data.covariates.values(), at.robot.last, *(j.before for j in at.robot.joints), at.tools, *at.placement, *more]
    arrays += [] if isinstance(at.whiten, float) else [at.whiten]
    before = [a.copy() for a in arrays]
    for a in arrays:
        a.setflags(write=False)
    try:
        yield at
    finally:
        for a in arrays:
            a.setflags(write=True)
    assert all(np.array_equal(a, b) for a, b in zip(arrays, before, strict=True)), "L7: an input was changed"


def usual(term: Term, rng: np.random.Generator, share: float = 1.0) -> float:
    """A size of the term's usual range (nought where it has none), either sign where physics gives none."""
    low, high = term.size or (0.0, 1e-3)
    return share * rng.uniform(low, high) * (term.sign or rng.choice([-1, 1]))


def law1_columns_are_derivatives(mechanism: Mechanism, at: Scene, rng: np.random.Generator) -> None:
    """L1: a column is the central difference of the exact chain, at the nominal model and away from it."""
    some, terms = at.take(np.arange(min(len(at), 15))), mechanism.terms
    h = np.array([step(t, some) for t in terms])
    for theta in (np.zeros(len(terms)), np.array([usual(t, rng, 0.05) for t in terms])):
        columns = design(some, terms, (terms, theta))[0]
        both = exact(some, terms, theta + np.concatenate([np.diag(-h), np.diag(h)]))
        low, high = both.reshape(2, len(terms), *columns.shape[:2])                      # residual = measured - predicted
        slope = (low - high) / (2 * h[:, None, None])
        for column, difference, term in zip(columns.transpose(2, 0, 1), slope, terms, strict=True):
            error = np.abs(column - difference).max()
            size = max(np.abs(difference).max(), np.abs(column).max(), 1e-3 * floor(term, some))
            assert error <= COLUMN * size, (f"L1: {mechanism.name} {term.symbol}, {term.screws[0]}: column off by "
                                            f"{error / size:.1e} of its size")


def exact(at: Scene, terms: Sequence[Term], thetas: np.ndarray) -> np.ndarray:
    """Exact residuals (B, m, c) at every row of thetas (B, p), in one sweep: the rows B times over, every term's value a
    covariate of its own."""
    B, m = len(thetas), len(at)
    tiled = at.take(np.tile(np.arange(m), B))
    values = {f"value_{k}": column.repeat(m) for k, column in enumerate(thetas.T)}
    tiled = replace(tiled, data=replace(tiled.data, covariates={**tiled.data.covariates, **values}))
    scaled = [Term(t.symbol, tuple(Screw(s.frame, s.axis, s.cause * causes.Named(f"value_{k}")) for s in t.screws))
              for k, t in enumerate(terms)]
    return residuals(tiled, scaled, np.ones(len(terms))).reshape(B, m, -1)


def reach(term: Term, at: Scene) -> list[tuple[str, float]]:
    """(axis, largest size of the cause) of every screw."""
    return [(s.axis, float(np.abs(np.broadcast_to(s.cause.of(at), len(at))).max())) for s in term.screws]


def step(term: Term, at: Scene) -> float:
    """Step that turns nothing by more than 1e-5 rad and shifts nothing by more than 0.01 mm: truncation 2e-11, rounding 1e-9."""
    return min((1e-5 if axis[0] == "r" else 1e-2) / max(size, 1e-12) for axis, size in reach(term, at))


def floor(term: Term, at: Scene) -> float:
    """mm per unit at a lever of 100 mm: what a column that should vanish is measured against."""
    return max((100.0 if axis[0] == "r" else 1.0) * size for axis, size in reach(term, at))


def law2_rows_are_local(mechanism: Mechanism, at: Scene, rng: np.random.Generator) -> None:
    """L2: rows permuted or dropped give the same columns, whether or not the causes were evaluated before."""
    whole = design(at, mechanism.terms)[0]
    for index in (rng.permutation(len(at)), np.sort(rng.choice(len(at), len(at) // 3, replace=False)), np.arange(1)):
        for some in (at.take(index), bind(at.robot, at.data.take(index), at.tools[0])):
            np.testing.assert_allclose(design(some, mechanism.terms)[0], whole[index], rtol=1e-12, atol=1e-9,
                                       err_msg=f"L2: {mechanism.name} looks beyond its row")


def law3_linear_in_the_cause(mechanism: Mechanism, at: Scene, rng: np.random.Generator) -> None:
    """L3: a zero cause gives a zero column, twice the cause twice the column."""
    del rng
    columns = design(at, mechanism.terms)[0]
    for factor in (0.0, 2.0):
        terms = tuple(Term(t.symbol, tuple(Screw(s.frame, s.axis, factor * s.cause) for s in t.screws)) for t in mechanism.terms)
        np.testing.assert_allclose(design(at, terms)[0], factor * columns, rtol=1e-13, atol=0,
                                   err_msg=f"L3: {mechanism.name} x {factor}")


def law4_plant_and_recover(mechanism: Mechanism, at: Scene, rng: np.random.Generator) -> None:
    """L4: planted on the exact chain with noise, its estimable combinations come back within 4 standard errors.

    Where columns depend on one another, what must come back is relation' theta: to first order, so the sizes are small.
    """
    terms = mechanism.terms
    model = Model((mechanism,))
    columns = design(at, terms)[0]
    moves = np.linalg.norm(columns, axis=1).max(0)
    for term, far in zip(terms, moves * [(t.size or (0.0, 0.0))[1] for t in terms], strict=True):
        assert far < FAR, (f"L4: {mechanism.name} {term.symbol}: its usual size, {term.size[1]:g} {term.unit}, moves the target "
                           f"{far:.0f} mm")
    dependent = identify(reduce(columns.reshape(-1, len(terms)), at.data.position.ravel())).rank < len(terms)
    theta = np.array([usual(t, rng, 0.02 if dependent else 0.3) for t in terms])
    off = []
    for _ in range(2):                                                # 4 sigma by chance: once in 16,000, so draw once more
        with locked(planted(replace(at, whiten=1 / SIGMA), terms, theta, rng, SIGMA), theta) as measured:
            found = fit(measured, model)
        kept = list(found.found.kept)
        assert kept, f"L4: {mechanism.name} moves nothing"
        error = found.theta[kept] - found.found.relation.T @ theta
        off.append(np.abs(error / np.sqrt(np.square(found.factor[kept]).sum(1))).max())      # sigma is known: whitened by it
        if off[-1] < 4:
            return
    raise AssertionError(f"L4: {mechanism.name}: {' and '.join(f'{x:.1f}' for x in off)} standard errors off, twice running")


def law5_symbols_and_units(mechanism: Mechanism, at: Scene, rng: np.random.Generator) -> None:
    """L5: symbols are unique, screws stand on frames there are, units derive from place and cause."""
    del rng
    symbols = [t.symbol for t in mechanism.terms]
    assert len(set(symbols)) == len(symbols), f"L5: {mechanism.name} repeats a symbol: {symbols}"
    assert mechanism.name
    assert mechanism.sentence.endswith(".")
    assert mechanism.equation
    assert mechanism.source
    for term in mechanism.terms:
        assert term.screws, f"L5: {term.symbol} drives no screw"
        assert all(1 <= s.frame <= at.robot.n + 1 and s.axis in AXES for s in term.screws)
        assert term.unit.replace("/", " ").split()[0] in ("mm", "rad", "1")
        for s in term.screws:
            if s.cause.unit == "1" and len(term.screws) == 1:
                assert term.unit == ("mm" if s.axis[0] == "t" else "rad")
            known = at.names()
            assert all(unit == known[name] for name, unit in named(s.cause)), f"L5: {s} calls a name's unit something else"
        assert term.size is None or 0 <= term.size[0] < term.size[1]
        assert term.sign in (-1, 0, 1)


def named(cause: object) -> list[tuple[str, str]]:
    """(name, unit) of every name in a cause."""
    if isinstance(cause, causes.Named):
        return [(cause.name, cause.dimension)]
    return [pair for f in fields(cause) for pair in named(getattr(cause, f.name))] if is_dataclass(cause) else []


def law6_a_value(mechanism: Mechanism, at: Scene, rng: np.random.Generator) -> None:
    """L6: it hashes, equals and pickles, prints so that it can be read back, and its causes print in the contract's grammar."""
    del rng
    names = {c.__name__: c for c in (Mechanism, Term, Screw, *vars(causes).values()) if isinstance(c, type)}
    again = [pickle.loads(pickle.dumps(mechanism)), eval(repr(mechanism), names)]  # noqa: S301, S307 - our own text
    for other in again:
        assert other == mechanism, f"L6: {mechanism.name} is not equal after a round trip"
        assert hash(other) == hash(mechanism)
    assert mechanism != replace(mechanism, terms=mechanism.terms[1:])
    for term in mechanism.terms:
        for s in term.screws:
            if isinstance(s.cause, causes.Bump):                          # one column of a free function prints as the function
                assert str(s.cause) == f"free({s.cause.name})"
                continue
            read = causes.parse(str(s.cause), at.names())
            assert str(read) == str(s.cause), f"L6: {s.cause} reads back as {read}"
            value = s.cause.of(at)                                        # numbers print to ten digits
            np.testing.assert_allclose(read.of(at), value, rtol=0, atol=1e-8 * np.abs(value).max(), err_msg=f"L6: {s.cause}")


def law7_inputs_stay(mechanism: Mechanism, at: Scene, rng: np.random.Generator) -> None:
    """L7: nothing writes into what it was given (all inputs are locked), and what comes out is no view of what went in.
    L4's fit runs on locked inputs too."""
    terms, theta = mechanism.terms, np.array([usual(t, rng, 0.02) for t in mechanism.terms])
    with locked(bind(at.robot, at.data, at.tools[0]), theta) as fresh:
        for out in (*design(fresh, terms, (terms, theta)), residuals(fresh, terms, theta)):
            out[...] = np.nan


LAWS = (law1_columns_are_derivatives, law2_rows_are_local, law3_linear_in_the_cause, law4_plant_and_recover,
        law5_symbols_and_units, law6_a_value, law7_inputs_stay)
