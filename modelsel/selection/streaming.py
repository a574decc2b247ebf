"""Fits and cross-validation of measurements that come in parts, in any order and on any machine; a
part is kept as one triangle a fold.

Associative: `add` a problem of some configurations, `merge` what other machines have added; the
results of cross-validation and of the search over subsets are those of all rows at once."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial, reduce
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from .._typing import Array, Index
from ..exceptions import DataError, StudyError
from ..fitting.design import Model
from ..fitting.least_squares import Fit, fit
from ..fitting.linearisation import Linearisation
from ..fitting.problem import Problem
from ..fitting.reduction import Reduction, Source, merged, reduce_problem
from ..measurements.campaign.state_names import StateKind, state_kind
from ..measurements.campaign.visits import SAME_READING
from ..measurements.formats.table import count_row_groups
from ..measurements.measurements import Measurements
from ..measurements.reader import read_measurements
from ..mechanisms.terms import Mechanism, Term
from ..robot.kinematics import Robot
from .cross_validation import CrossValidation, FoldedData, cross_validate, pad_blocks

# `map`, or a cluster's equivalent; results in the items' order
Mapper = Callable[[Callable[[Any], Any], Sequence[Any]], Iterable[Any]]
# state variables that depend on other parts: the place in the campaign, the group's number, the
# last move, the way that a joint came, the speed, and what the clock says of the rows before
GLOBAL_KINDS = (
    StateKind.PROGRESS,
    StateKind.GROUP,
    StateKind.MOVE,
    StateKind.DRAG,
    StateKind.RATE,
    StateKind.SINCE_REST,
    StateKind.LATE,
)


def hash_folds(data: Measurements, count: int, by: str = "configuration") -> Index:
    """Assign every row (m,) to a fold by a hash of its readings (rounded to 1e-6), or of its group's
    name.

    No machine has to know what others hold, and equal readings stay together."""
    modulus = np.uint64(count)
    if by == "group":
        names = data.groups
        codes = [crc32(name.encode()) for name in names]
        by_name = np.array(codes, np.uint64)
        code = by_name[data.group]
    else:
        code = _hash_readings(data.q)
    fold = code % modulus
    return np.asarray(fold, dtype=np.intp)


def _hash_readings(q: Array) -> NDArray[np.uint64]:
    """Hash joint readings (m, n) to (m,) by multiplication with the golden ratio's bits."""
    golden = np.uint64(0x9E3779B97F4A7C15)
    half = np.uint64(32)
    rows = len(q)
    code = np.zeros(rows, np.uint64)
    rounded = np.round(q / SAME_READING)
    numbers = rounded.astype(np.int64)
    for column in numbers.T:
        bits = column.view(np.uint64)
        code = code ^ bits
        code = code * golden
        code ^= code >> half
    return code


@dataclass(frozen=True, eq=False)
class Stream:
    """Reduction of some configurations, fold by fold.

    terms: the terms of the design.
    folds: one reduction per fold.
    at: parameters (p,) at which the model is linearised; None for the nominal model.
    by: whether configurations or groups are kept whole.
    """

    terms: tuple[Term, ...]
    folds: tuple[Reduction, ...]
    at: Array | None = None
    by: str = "configuration"

    @staticmethod
    def empty(
        terms: Sequence[Term], folds: int = 10, at: Array | None = None, by: str = "configuration"
    ) -> Stream:
        """Create the reduction of no configurations."""
        count = len(terms)
        reductions = []
        for _ in range(folds):
            reduction = Reduction.empty(count)
            reductions.append(reduction)
        return Stream(tuple(terms), tuple(reductions), at, by)

    def add(self, configurations: Problem) -> Stream:
        """Add the configurations of a problem."""
        data = configurations.data
        terms = self.terms
        folds = list(self.folds)
        count = len(folds)
        fold = hash_folds(data, count, self.by)
        point = None
        if self.at is not None:
            point = Linearisation(terms, self.at)
        for k in np.unique(fold):
            in_fold = fold == k
            part = configurations.take(in_fold)
            reduction = reduce_problem(part, terms, point)
            known = folds[k]
            folds[k] = known.merge(reduction)
        return replace(self, folds=tuple(folds))

    def merge(self, other: Stream) -> Stream:
        """Merge both sets of configurations.

        Raises ValueError where they differ in terms, folds or point."""
        same_terms = self.terms == other.terms
        count = len(self.folds)
        same_count = count == len(other.folds)
        same_units = self.by == other.by
        same_folds = same_count and same_units
        same_point = _same_point(self.at, other.at)
        same = same_terms and same_folds and same_point
        if not same:
            raise ValueError("streams of different terms, folds or points cannot be merged")
        pairs = zip(self.folds, other.folds, strict=True)
        folds = []
        for one, another in pairs:
            both = one.merge(another)
            folds.append(both)
        merged_folds = tuple(folds)
        return replace(self, folds=merged_folds)

    def folded(self) -> FoldedData:
        """Return the folds for cross-validation and the search over subsets, without empty ones."""
        parts = []
        rows = []
        for reduction in self.folds:
            if reduction.rows:
                parts.append(reduction.R)
                rows.append(reduction.rows)
        return pad_blocks(parts, rows)


def _same_point(one: Array | None, other: Array | None) -> bool:
    """Whether two models are linearised at the same parameters; None is the nominal model."""
    if one is None or other is None:
        return one is other
    return np.array_equal(one, other)


@dataclass(frozen=True)
class Part:
    """Part of a measurement set that one machine reads at once: a row group of a Parquet file, and
    its number of rows."""

    path: Path
    group: int
    rows: int


def list_parts(files: Sequence[Path]) -> tuple[Part, ...]:
    """List every row group of Parquet files, in order. Raises DataError."""
    parts = []
    for path in files:
        groups = count_row_groups(path)
        for group, rows in enumerate(groups):
            part = Part(path, group, rows)
            parts.append(part)
    return tuple(parts)


@dataclass(frozen=True, eq=False)
class Parts(Source):
    """Measurements too large for memory, as a source of reductions.

    robot, tool: the arm and its target in the flange frame [mm].
    parts: where the rows are.
    map: applies a function to every part, on this machine or on many.

    Models that depend on earlier parts are refused (`fit_parts`)."""

    robot: Robot
    tool: tuple[float, float, float]
    parts: tuple[Part, ...]
    map: Mapper = map

    def __len__(self) -> int:
        count = 0
        for part in self.parts:
            count += part.rows
        return count

    def problem(self, part: Part) -> Problem:
        """Read a part: its positions, all weighed alike. Raises DataError."""
        data = read_measurements(part.path, self.robot, group=part.group)
        if data.gauges is not None:
            raise DataError(
                "only measured points can be fitted in parts: rows of other kinds share features "
                "across parts.",
                file=part.path.name,
                column="kind",
                remedy="Study the measurements as one file, or leave these rows out.",
            )
        tools = np.tile(np.array(self.tool), (len(data.targets), 1))
        return Problem(self.robot, data, tools).plain_points()

    def alone(self) -> Parts:
        """Return the source without parts and map: what is sent to a worker."""
        robot = self.robot
        tool = self.tool
        return Parts(robot, tool, ())

    def reduced(
        self,
        terms: Sequence[Term],
        at: Linearisation | None = None,
        only: Sequence[int] | None = None,
    ) -> Reduction:
        """Reduce all parts, merged in file order: independent of the number of workers."""
        source = self.alone()
        work = partial(_reduce_part, source, tuple(terms), at, only)
        reductions = self.map(work, self.parts)
        return merged(reductions)

    def stream(self, terms: Sequence[Term], theta: Array, folds: int) -> Stream:
        """Reduce all parts fold by fold, linearised at theta (p,)."""
        source = self.alone()
        work = partial(_stream_part, source, tuple(terms), theta, folds)
        streams: Iterable[Stream] = self.map(work, self.parts)
        return reduce(Stream.merge, streams)


def _reduce_part(
    source: Parts,
    terms: tuple[Term, ...],
    at: Linearisation | None,
    only: Sequence[int] | None,
    part: Part,
) -> Reduction:
    problem = source.problem(part)
    return reduce_problem(problem, terms, at, only)


def _stream_part(
    source: Parts, terms: tuple[Term, ...], theta: Array, folds: int, part: Part
) -> Stream:
    problem = source.problem(part)
    stream = Stream.empty(terms, folds, theta)
    return stream.add(problem)


def fit_parts(source: Parts, model: Model, folds: int = 10) -> tuple[Fit, CrossValidation]:
    """Fit a model to the positions of measurements in parts, re-linearised pass by pass, and
    cross-validate it exactly.

    All positions weigh alike: orientations and stated uncertainties are not used. Raises DataError or NotEstimable, and StudyError for a model that depends on what no part holds
    alone."""
    _check_model(source, model)
    fitted = fit(source, model)
    terms = model.terms
    stream = source.stream(terms, fitted.theta, folds)
    folded = stream.folded()
    kept = fitted.found.kept
    prior = fitted.prior
    validation = cross_validate(folded, kept, prior)
    return fitted, validation


def _check_model(source: Parts, model: Model) -> None:
    """Raise StudyError where the model depends on what comes before a part: its place in the
    campaign, the last move, how groups are counted; or on directions of approach that a file does
    not have."""
    underived = _files_without_approach(source)
    problems = []
    for mechanism in model.mechanisms:
        names = _state_names(mechanism)
        kinds = {name: state_kind(name) for name in names}
        lost = [name for name, kind in kinds.items() if kind in GLOBAL_KINDS]
        if lost:
            problems.append(
                f"{mechanism.name} depends on {', '.join(lost)}, which no part of the measurements "
                "holds alone: leave it out of the base, or study the measurements as one file."
            )
        elif underived and StateKind.APPROACH in kinds.values():
            files = f"{underived[0]}{' and others' if len(underived) > 1 else ''}"
            problems.append(
                f"{mechanism.name} depends on directions of approach, which parts cannot take from "
                f"the order of motion: add the columns approach1 ... to {files}."
            )
    if problems:
        raise StudyError(*problems)


def _files_without_approach(source: Parts) -> list[str]:
    """List the names of the files without columns of approach."""
    import pyarrow.parquet as pq

    files = dict.fromkeys(part.path for part in source.parts)
    without = []
    for path in files:
        schema = pq.ParquetFile(path).schema_arrow
        if "approach1" not in schema.names:
            without.append(path.name)
    return without


def _state_names(mechanism: Mechanism) -> list[str]:
    """List the names of the state variables that a mechanism's causes use, sorted."""
    names: set[str] = set()
    for term in mechanism.terms:
        for screw in term.screws:
            variables = screw.cause.names()
            names.update(variables)
    return sorted(names)
