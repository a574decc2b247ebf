"""The laws that every mechanism obeys, on any robot: `check_mechanism` is all the test that a new
one needs.

L1 its columns are derivatives of the exact chain; L2 its rows are local; L3 it is linear in its
causes; L4 planted, it comes back; L5 its symbols are unique and its units derive; L6 it is a value
that can be stored and printed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, is_dataclass, replace

import numpy as np

from ._arguments import check_type
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
from .mechanisms import cause_formulas, causes
from .mechanisms.registry import find_misbuilt
from .mechanisms.serialization import MechanismRecord, mechanism_from_record, mechanism_record
from .mechanisms.terms import Mechanism, Screw, Term
from .robot.kinematics import Robot, forward

CONFIGURATIONS = 60  # configurations
NOISE_MM = 0.02  # mm, of L4's noise
MAX_COLUMN_ERROR = 1e-6  # L1's bound
# mm: a usual size that moves the target further is a slip of the catalogue
MAX_DISPLACEMENT_MM = 500.0
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
    """Simulate m configurations within the limits, measured where the nominal robot has a target
    off its last axis, with every known covariate and those that are needed."""
    q = robot.draw(rng, m)
    tool = np.array(TOOL_MM)
    covariates: dict[str, Array] = {
        "payload_kg": rng.uniform(0, 5, m),
        "temperature_C": rng.uniform(15, 35, m),
        "time_s": np.arange(0.0, 30.0 * m, 30.0),
    }
    position = forward(robot, q, tool)
    data = build_measurements(q, position, covariates=covariates)
    bare = Problem(robot, data, tool[None])
    known = bare.names()
    missing = sorted(needs - known.keys())
    if not missing:
        return bare
    completed = dict(covariates)
    for name in missing:
        completed[name] = rng.normal(size=m)
    data = replace(bare.data, covariates=completed)
    return replace(bare, data=data)


def find_broken_laws(mechanism: Mechanism, robot: Robot, rng: np.random.Generator) -> list[str]:
    """List the laws that a mechanism breaks, in words; empty where it obeys them all."""
    problem = find_misbuilt(mechanism, robot)
    if problem is not None:
        # no other law can be tried
        return [f"L5: {problem}"]
    at = simulate_campaign(robot, rng, CONFIGURATIONS, mechanism.names())
    broken = []
    for law in LAWS:
        try:
            law(mechanism, at, rng)
        except LawBroken as error:
            broken.append(str(error))
        # a stranger's cause may fail in any way; what it says is the finding
        except Exception as error:  # noqa: BLE001
            name, _, _ = law.__name__.partition("_")
            number = name.removeprefix("law")
            kind = type(error).__name__
            broken.append(f"L{number}: {kind}: {error}")
    return broken


def check_mechanism(mechanism: Mechanism, robot: Robot, rng: np.random.Generator) -> None:
    """Check every law for a mechanism on a robot. Raises LawBroken with all that it breaks.

    For the tests of a plug-in:

        import numpy as np
        from modelsel import load_robot
        from modelsel.testing import check_mechanism

        from hose_twist import build

        def test_hose_twist():
            robot = load_robot("puma760")
            check_mechanism(build(robot), robot, np.random.default_rng(0))
    """
    check_type("robot", robot, Robot, 'a Robot, as load_robot("puma760") returns it')
    check_type("rng", rng, np.random.Generator, "a generator, as np.random.default_rng(0)")
    found = find_broken_laws(mechanism, robot, rng)
    sentences = "; ".join(found)
    is_lawful = not found
    require(is_lawful, sentences)


def draw_size(term: Term, rng: np.random.Generator, share: float = 1.0) -> float:
    """Draw a size from the term's usual range (from zero where it has none), with either sign where
    physics gives none."""
    low, high = term.size or (0.0, 1e-3)
    size = share * rng.uniform(low, high)
    sign = term.sign
    if not sign:
        sign = rng.choice([-1, 1])
    return size * sign


def law1_columns_are_derivatives(
    mechanism: Mechanism, at: Problem, rng: np.random.Generator
) -> None:
    """L1: a column is the central difference of the exact chain, at the nominal model and away from
    it."""
    terms = mechanism.terms
    some = at.take(np.arange(min(len(at), 15)))
    h = np.array([step_size(term, some) for term in terms])
    nominal = np.zeros(len(terms))
    away = np.array([draw_size(term, rng, 0.05) for term in terms])
    steps = np.concatenate([np.diag(-h), np.diag(h)])
    for theta in (nominal, away):
        columns = compute_design(some, terms, Linearisation(terms, theta))[0]
        both = exact_residuals(some, terms, theta + steps)
        # residual = measured - predicted
        low, high = both.reshape(2, len(terms), *columns.shape[:2])
        slope = (low - high) / (2 * h[:, None, None])
        for column, difference, term in zip(columns.transpose(2, 0, 1), slope, terms, strict=True):
            error = np.abs(column - difference).max()
            floor = 1e-3 * column_floor(term, some)
            size = max(np.abs(difference).max(), np.abs(column).max(), floor)
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
    """List the axis and the largest size of the cause of every screw."""
    reach = []
    for screw in term.screws:
        cause = screw.cause.of(at)
        values = np.broadcast_to(cause, len(at))
        sizes = np.abs(values)
        largest = float(sizes.max())
        reach.append((screw.axis, largest))
    return reach


def step_size(term: Term, at: Problem) -> float:
    """Step that turns nothing by more than 1e-4 rad and shifts nothing by more than 0.1 mm:
    truncation 2e-9, rounding 1e-10."""
    steps = []
    for axis, size in list_reach(term, at):
        limit = 1e-4 if axis[0] == "r" else 1e-1
        step = limit / max(size, 1e-30)
        steps.append(step)
    return min(steps)


def column_floor(term: Term, at: Problem) -> float:
    """mm per unit at a lever of 100 mm: what a column that should vanish is measured against."""
    moves = []
    for axis, size in list_reach(term, at):
        lever = 100.0 if axis[0] == "r" else 1.0
        move = lever * size
        moves.append(move)
    return max(moves)


def law2_rows_are_local(mechanism: Mechanism, at: Problem, rng: np.random.Generator) -> None:
    """L2: rows permuted or dropped give the same columns, whether or not the causes were evaluated
    before."""
    terms = mechanism.terms
    whole = compute_design(at, terms)[0]
    count = len(at)
    permuted = rng.permutation(count)
    third = rng.choice(count, count // 3, replace=False)
    first = np.arange(1)
    for index in (permuted, np.sort(third), first):
        evaluated = at.take(index)
        anew = Problem(at.robot, at.data.take(index), at.tools)
        for some in (evaluated, anew):
            columns = compute_design(some, terms)[0]
            same = np.allclose(columns, whole[index], rtol=1e-12, atol=1e-9)
            require(same, f"L2: {mechanism.name} looks beyond its row")


def law3_linear_in_the_cause(mechanism: Mechanism, at: Problem, rng: np.random.Generator) -> None:
    """L3: a zero cause gives a zero column, twice the cause twice the column."""
    del rng
    columns = compute_design(at, mechanism.terms)[0]
    for factor in (0.0, 2.0):
        terms = []
        for term in mechanism.terms:
            screws = []
            for screw in term.screws:
                cause = factor * screw.cause
                screws.append(Screw(screw.frame, screw.axis, cause))
            terms.append(Term(term.symbol, tuple(screws)))
        scaled = compute_design(at, terms)[0]
        linear = np.allclose(scaled, factor * columns, rtol=1e-13, atol=0)
        require(linear, f"L3: {mechanism.name} with its causes x {factor} is not x {factor}")


def law4_plant_and_recover(mechanism: Mechanism, at: Problem, rng: np.random.Generator) -> None:
    """L4: planted on the exact chain with noise, its estimable combinations come back within 4
    standard errors.

    Where columns depend on one another, what must come back is relation' theta: to first order, so
    the sizes are small."""
    terms = mechanism.terms
    model = Model((mechanism,))
    columns = compute_design(at, terms)[0]
    moves = np.linalg.norm(columns, axis=1).max(0)
    for term, move in zip(terms, moves, strict=True):
        size = term.size or (0.0, 0.0)
        far = move * size[1]
        require(
            far < MAX_DISPLACEMENT_MM,
            f"L4: {mechanism.name} {term.symbol}: its usual size, {term.size or ()} {term.unit}, moves the target "
            f"{far:.0f} mm",
        )
    rows = columns.reshape(-1, len(terms))
    identified = identify(reduce(rows, at.data.position.ravel()))
    share = 0.02 if identified.rank < len(terms) else 0.3
    theta = np.array([draw_size(term, rng, share) for term in terms])
    planted = at.data.position - residuals(at, terms, theta)[:, :3]
    off = []
    for _ in range(2):  # 4 sigma by chance: once in 16,000, so draw once more
        position = planted + rng.normal(0, NOISE_MM, (len(at), 3))
        data = replace(at.data, position=position)
        found = fit(replace(at, whitening=Whitening(1 / NOISE_MM), data=data), model)
        require(found.found.kept, f"L4: {mechanism.name} moves nothing")
        relation = found.found.relation.T
        error = relation @ (found.theta - theta)
        # sigma is known: whitened by it
        spread = np.sqrt(np.square(relation @ found.factor).sum(1))
        off.append(np.abs(error / spread).max())
        if off[-1] < 4:
            return
    figures = " and ".join(f"{ratio:.1f}" for ratio in off)
    raise LawBroken(f"L4: {mechanism.name}: {figures} standard errors off, twice running")


def law5_symbols_and_units(mechanism: Mechanism, at: Problem, rng: np.random.Generator) -> None:
    """L5: symbols are unique, screws stand on frames there are, units derive from place and
    cause."""
    del rng
    name = mechanism.name
    symbols = [term.symbol for term in mechanism.terms]
    require(len(set(symbols)) == len(symbols), f"L5: {name} repeats a symbol: {symbols}")
    require(
        name and mechanism.equation and mechanism.source,
        f"L5: {name or 'it'} lacks a name, an equation or a source",
    )
    require(
        mechanism.sentence.endswith("."),
        f"L5: {name} is not said in a sentence that ends with a full stop",
    )
    known = at.names()
    problem = find_misbuilt(mechanism, at.robot)
    require(problem is None, f"L5: {problem}")
    for term in mechanism.terms:
        symbol = term.symbol
        unit = term.unit
        require(term.screws, f"L5: {symbol} drives no screw")
        base, *_ = unit.replace("/", " ").split()
        follows_speed = all(screw.cause.unit.endswith("/s") for screw in term.screws)
        allowed = ("s",) if follows_speed else ("mm", "rad", "1")
        require(base in allowed, f"L5: {symbol} has the unit {unit}")
        for screw in term.screws:
            cause = screw.cause
            if cause.unit == "1" and len(term.screws) == 1:
                derived = "mm" if screw.axis[0] == "t" else "rad"
                require(unit == derived, f"L5: {symbol} has the unit {unit}")
            wrong = []
            for named, stated in list_named(cause):
                actual = known.get(named, "unknown")
                if stated != actual:
                    wrong.append(f"the unit of {named} {stated}, and it is {actual}")
            listed = ", ".join(wrong)
            require(not wrong, f"L5: {screw} calls {listed}")
        require(
            term.size is None or 0 <= term.size[0] < term.size[1],
            f"L5: {symbol}: its size is not from low to high: {term.size}",
        )
        require(term.sign in (-1, 0, 1), f"L5: {symbol}: its sign is {term.sign}; -1, 0 or 1")


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
            read = cause_formulas.parse(str(s.cause), at.names())
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
