"""The laws that every mechanism obeys, on any robot: `check_mechanism` is all the test that a new
one needs.

L1 its columns are derivatives of the exact chain; L2 its rows are local; L3 it is linear in its
causes; L4 planted, it comes back; L5 its symbols are unique and its units derive; L6 it is a value
that can be stored and printed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, is_dataclass, replace

import numpy as np

from ._records import parse_record
from ._typing import Array
from .exceptions import StudyError
from .fitting.design import Model, compute_design, residuals
from .fitting.identifiability import identify
from .fitting.least_squares import fit
from .fitting.linearisation import Linearisation
from .fitting.problem import Problem
from .fitting.reduction import reduce
from .fitting.whitening import Whitening
from .measurements.measurements import build_measurements
from .mechanisms import causes
from .mechanisms.serialization import MechanismRecord, mechanism_from_record, mechanism_record
from .mechanisms.terms import Mechanism, Screw, Term
from .robot.kinematics import Robot, forward

CONFIGURATIONS = 60  # configurations
NOISE_MM = 0.02  # mm, of L4's noise
MAX_COLUMN_ERROR = 1e-6  # L1's bound
MAX_DISPLACEMENT_MM = (
    500.0  # mm: a usual size that moves the target further is a slip of the catalogue
)
TOOL_MM = (40.0, -25.0, 100.0)


class LawBroken(AssertionError):
    """A mechanism breaks a law: which, and where."""


def require(holds: object, what: str) -> None:
    """Raise LawBroken with what is wrong, unless it holds."""
    if not holds:
        raise LawBroken(what)


def simulate_campaign(
    robot: Robot, rng: np.random.Generator, m: int, needs: frozenset[str] = frozenset()
) -> Problem:
    """Simulate m configurations within the limits, measured where the nominal robot has a target off
    its last axis, with every known covariate and those that are needed."""
    q, tool = robot.draw(rng, m), np.array(TOOL_MM)
    covariates: dict[str, Array] = {
        "payload_kg": rng.uniform(0, 5, m),
        "temperature_C": rng.uniform(15, 35, m),
        "time_s": np.arange(0.0, 30.0 * m, 30.0),
    }
    bare = Problem(
        robot, build_measurements(q, forward(robot, q, tool), covariates=covariates), tool[None]
    )
    more: dict[str, Array] = {
        name: rng.normal(size=m) for name in sorted(needs - bare.names().keys())
    }
    return replace(bare, data=replace(bare.data, covariates=covariates | more)) if more else bare


def find_broken_laws(mechanism: Mechanism, robot: Robot, rng: np.random.Generator) -> list[str]:
    """List the laws that a mechanism breaks, in words; empty where it obeys them all."""
    at, out = simulate_campaign(robot, rng, CONFIGURATIONS, mechanism.names()), []
    for one in LAWS:
        try:
            one(mechanism, at, rng)
        except LawBroken as error:
            out.append(str(error))
        except Exception as error:  # noqa: BLE001  a stranger's cause may fail in any way; what it says is the finding
            out.append(f"{one.__name__.partition('_')[0].upper()}: {type(error).__name__}: {error}")
    return out


def check_mechanism(mechanism: Mechanism, robot: Robot, rng: np.random.Generator) -> None:
    """Check every law for a mechanism on a robot. Raises LawBroken with all that it breaks.

    For the tests of a plug-in:

        import numpy as np
        from modelsel import load
        from modelsel.testing import check_mechanism

        from hose_twist import build

        def test_hose_twist():
            robot = load("puma760")
            check_mechanism(build(robot), robot, np.random.default_rng(0))
    """
    found = find_broken_laws(mechanism, robot, rng)
    require(not found, "; ".join(found))


def draw_size(term: Term, rng: np.random.Generator, share: float = 1.0) -> float:
    """Draw a size from the term's usual range (from zero where it has none), with either sign where
    physics gives none."""
    low, high = term.size or (0.0, 1e-3)
    return share * rng.uniform(low, high) * (term.sign or rng.choice([-1, 1]))


def law1_columns_are_derivatives(
    mechanism: Mechanism, at: Problem, rng: np.random.Generator
) -> None:
    """L1: a column is the central difference of the exact chain, at the nominal model and away from
    it."""
    some, terms = at.take(np.arange(min(len(at), 15))), mechanism.terms
    h = np.array([step_size(t, some) for t in terms])
    for theta in (np.zeros(len(terms)), np.array([draw_size(t, rng, 0.05) for t in terms])):
        columns = compute_design(some, terms, Linearisation(terms, theta))[0]
        both = exact_residuals(some, terms, theta + np.concatenate([np.diag(-h), np.diag(h)]))
        low, high = both.reshape(
            2, len(terms), *columns.shape[:2]
        )  # residual = measured - predicted
        slope = (low - high) / (2 * h[:, None, None])
        for column, difference, term in zip(columns.transpose(2, 0, 1), slope, terms, strict=True):
            error = np.abs(column - difference).max()
            size = max(
                np.abs(difference).max(), np.abs(column).max(), 1e-3 * column_floor(term, some)
            )
            require(
                error <= MAX_COLUMN_ERROR * size,
                f"L1: {mechanism.name} {term.symbol}, {term.screws[0]}: column off by "
                f"{error / max(size, 1e-300):.1e} of its size",
            )


def exact_residuals(at: Problem, terms: Sequence[Term], thetas: Array) -> Array:
    """Exact residuals (B, m, c) at every row of thetas (B, p), in one sweep: the rows B times over,
    every term's value a covariate of its own."""
    B, m = len(thetas), len(at)
    tiled = at.take(np.tile(np.arange(m), B))
    values = {f"value_{k}": column.repeat(m) for k, column in enumerate(thetas.T)}
    tiled = replace(tiled, data=replace(tiled.data, covariates={**tiled.data.covariates, **values}))
    scaled = [
        Term(
            t.symbol,
            tuple(Screw(s.frame, s.axis, s.cause * causes.Named(f"value_{k}")) for s in t.screws),
        )
        for k, t in enumerate(terms)
    ]
    return residuals(tiled, scaled, np.ones(len(terms))).reshape(B, m, -1)


def list_reach(term: Term, at: Problem) -> list[tuple[str, float]]:
    """(axis, largest size of the cause) of every screw."""
    return [
        (s.axis, float(np.abs(np.broadcast_to(s.cause.of(at), len(at))).max())) for s in term.screws
    ]


def step_size(term: Term, at: Problem) -> float:
    """Step that turns nothing by more than 1e-4 rad and shifts nothing by more than 0.1 mm:
    truncation 2e-9, rounding 1e-10."""
    return min(
        (1e-4 if axis[0] == "r" else 1e-1) / max(size, 1e-12) for axis, size in list_reach(term, at)
    )


def column_floor(term: Term, at: Problem) -> float:
    """mm per unit at a lever of 100 mm: what a column that should vanish is measured against."""
    return max((100.0 if axis[0] == "r" else 1.0) * size for axis, size in list_reach(term, at))


def law2_rows_are_local(mechanism: Mechanism, at: Problem, rng: np.random.Generator) -> None:
    """L2: rows permuted or dropped give the same columns, whether or not the causes were evaluated
    before."""
    whole = compute_design(at, mechanism.terms)[0]
    for index in (
        rng.permutation(len(at)),
        np.sort(rng.choice(len(at), len(at) // 3, replace=False)),
        np.arange(1),
    ):
        for some in (at.take(index), Problem(at.robot, at.data.take(index), at.tools)):
            require(
                np.allclose(
                    compute_design(some, mechanism.terms)[0], whole[index], rtol=1e-12, atol=1e-9
                ),
                f"L2: {mechanism.name} looks beyond its row",
            )


def law3_linear_in_the_cause(mechanism: Mechanism, at: Problem, rng: np.random.Generator) -> None:
    """L3: a zero cause gives a zero column, twice the cause twice the column."""
    del rng
    columns = compute_design(at, mechanism.terms)[0]
    for factor in (0.0, 2.0):
        terms = tuple(
            Term(t.symbol, tuple(Screw(s.frame, s.axis, factor * s.cause) for s in t.screws))
            for t in mechanism.terms
        )
        require(
            np.allclose(compute_design(at, terms)[0], factor * columns, rtol=1e-13, atol=0),
            f"L3: {mechanism.name} with its causes x {factor} is not x {factor}",
        )


def law4_plant_and_recover(mechanism: Mechanism, at: Problem, rng: np.random.Generator) -> None:
    """L4: planted on the exact chain with noise, its estimable combinations come back within 4
    standard errors.

    Where columns depend on one another, what must come back is relation' theta: to first order, so
    the sizes are small."""
    terms = mechanism.terms
    model = Model((mechanism,))
    columns = compute_design(at, terms)[0]
    moves = np.linalg.norm(columns, axis=1).max(0)
    for term, far in zip(terms, moves * [(t.size or (0.0, 0.0))[1] for t in terms], strict=True):
        require(
            far < MAX_DISPLACEMENT_MM,
            f"L4: {mechanism.name} {term.symbol}: its usual size, {term.size or ()} {term.unit}, moves the target "
            f"{far:.0f} mm",
        )
    dependent = identify(
        reduce(columns.reshape(-1, len(terms)), at.data.position.ravel())
    ).rank < len(terms)
    theta = np.array([draw_size(t, rng, 0.02 if dependent else 0.3) for t in terms])
    off = []
    for _ in range(2):  # 4 sigma by chance: once in 16,000, so draw once more
        position = (
            at.data.position
            - residuals(at, terms, theta)[:, :3]
            + rng.normal(0, NOISE_MM, (len(at), 3))
        )
        found = fit(
            replace(
                at, whitening=Whitening(1 / NOISE_MM), data=replace(at.data, position=position)
            ),
            model,
        )
        require(found.found.kept, f"L4: {mechanism.name} moves nothing")
        error = found.found.relation.T @ (found.theta - theta)
        spread = np.sqrt(
            np.square(found.found.relation.T @ found.factor).sum(1)
        )  # sigma is known: whitened by it
        off.append(np.abs(error / spread).max())
        if off[-1] < 4:
            return
    raise LawBroken(
        f"L4: {mechanism.name}: {' and '.join(f'{x:.1f}' for x in off)} standard errors off, twice running"
    )


def law5_symbols_and_units(mechanism: Mechanism, at: Problem, rng: np.random.Generator) -> None:
    """L5: symbols are unique, screws stand on frames there are, units derive from place and
    cause."""
    del rng
    symbols = [t.symbol for t in mechanism.terms]
    require(len(set(symbols)) == len(symbols), f"L5: {mechanism.name} repeats a symbol: {symbols}")
    require(
        mechanism.name and mechanism.equation and mechanism.source,
        f"L5: {mechanism.name or 'it'} lacks a name, an equation or a source",
    )
    require(
        mechanism.sentence.endswith("."),
        f"L5: {mechanism.name} is not said in a sentence that ends with a full stop",
    )
    for term in mechanism.terms:
        require(term.screws, f"L5: {term.symbol} drives no screw")
        require(
            all(1 <= s.frame <= at.robot.n + 1 for s in term.screws),
            f"L5: {term.symbol} stands on a frame that is not there",
        )
        require(
            term.unit.replace("/", " ").split()[0] in ("mm", "rad", "1"),
            f"L5: {term.symbol} has the unit {term.unit}",
        )
        for s in term.screws:
            if s.cause.unit == "1" and len(term.screws) == 1:
                require(
                    term.unit == ("mm" if s.axis[0] == "t" else "rad"),
                    f"L5: {term.symbol} has the unit {term.unit}",
                )
            known = at.names()
            wrong = [
                f"the unit of {name} {unit}, and it is {known.get(name, 'unknown')}"
                for name, unit in list_named(s.cause)
                if unit != known.get(name)
            ]
            require(not wrong, f"L5: {s} calls {', '.join(wrong)}")
        require(
            term.size is None or 0 <= term.size[0] < term.size[1],
            f"L5: {term.symbol}: its size is not from low to high: {term.size}",
        )
        require(term.sign in (-1, 0, 1), f"L5: {term.symbol}: its sign is {term.sign}; -1, 0 or 1")


def list_named(cause: object) -> list[tuple[str, str]]:
    """List name and unit of every name in a cause."""
    if isinstance(cause, causes.Named):
        return [(cause.name, cause.dimension)]
    return (
        [pair for f in fields(cause) for pair in list_named(getattr(cause, f.name))]
        if is_dataclass(cause)
        else []
    )


def law6_a_value(mechanism: Mechanism, at: Problem, rng: np.random.Generator) -> None:
    """L6: it hashes, equals itself after being stored, and its causes print in the contract's
    grammar."""
    del rng
    try:
        record = parse_record(mechanism_record(mechanism), MechanismRecord)
        again = mechanism_from_record(record)
    except (StudyError, ValueError) as error:
        raise LawBroken(f"L6: {mechanism.name}: {error}") from None
    require(
        again == mechanism and hash(again) == hash(mechanism),
        f"L6: {mechanism.name} is not equal after being stored",
    )
    require(
        mechanism != replace(mechanism, terms=mechanism.terms[1:]),
        f"L6: {mechanism.name} equals another",
    )
    for term in mechanism.terms:
        for s in term.screws:
            if isinstance(
                s.cause, causes.Bump
            ):  # one column of a free function prints as the function
                require(
                    str(s.cause) == f"free({s.cause.name})",
                    f"L6: {s.cause} does not print as the function it belongs to",
                )
                continue
            read = causes.parse(str(s.cause), at.names())
            require(str(read) == str(s.cause), f"L6: {s.cause} reads back as {read}")
            value = np.asarray(s.cause.of(at))  # numbers print to ten digits
            require(
                np.abs(read.of(at) - value).max() <= 1e-8 * np.abs(value).max(),
                f"L6: {s.cause} is not what it prints as",
            )


LAWS = (
    law1_columns_are_derivatives,
    law2_rows_are_local,
    law3_linear_in_the_cause,
    law4_plant_and_recover,
    law5_symbols_and_units,
    law6_a_value,
)
