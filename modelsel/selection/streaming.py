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
from ..measurements.measurements import Measurements
from ..measurements.reader import read_measurements
from ..measurements.table import count_row_groups
from ..measurements.visits import SAME_READING
from ..mechanisms.terms import Mechanism, Term
from ..robot.kinematics import Robot
from .cross_validation import CrossValidation, FoldedData, cross_validate, pad_blocks

# `map`, or a cluster's equivalent; results in the items' order
Mapper = Callable[[Callable[[Any], Any], Sequence[Any]], Iterable[Any]]
# state variables that depend on other parts: the place in the campaign, the group's number
GLOBAL_STATE = ("progress", "group")


def hash_folds(data: Measurements, count: int, by: str = "configuration") -> Index:
    """Assign every row (m,) to a fold by a hash of its readings (rounded to 1e-6), or of its group's
    name.

    No machine has to know what others hold, and equal readings stay together."""
    if by == "group":
        code = np.array([crc32(name.encode()) for name in data.groups], np.uint64)[data.group]
    else:
        code = _hash_readings(data.q)
    return np.asarray(code % np.uint64(count), dtype=np.intp)


def _hash_readings(q: Array) -> NDArray[np.uint64]:
    """Hash (m,) of joint readings (m, n), by multiplication with the golden ratio's bits."""
    code = np.zeros(len(q), np.uint64)
    for column in np.round(q / SAME_READING).astype(np.int64).T:
        code = (code ^ column.view(np.uint64)) * np.uint64(0x9E3779B97F4A7C15)
        code ^= code >> np.uint64(32)
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
        reductions = tuple(Reduction.empty(len(terms)) for _ in range(folds))
        return Stream(tuple(terms), reductions, at, by)

    def add(self, configurations: Problem) -> Stream:
        """Add the configurations of a problem."""
        fold = hash_folds(configurations.data, len(self.folds), self.by)
        point = None if self.at is None else Linearisation(self.terms, self.at)
        folds = list(self.folds)
        for k in np.unique(fold):
            part = configurations.take(fold == k)
            folds[k] = folds[k].merge(reduce_problem(part, self.terms, point))
        return replace(self, folds=tuple(folds))

    def merge(self, other: Stream) -> Stream:
        """Merge both sets of configurations.

        Raises ValueError where they differ in terms, folds or point."""
        same_folds = len(self.folds) == len(other.folds) and self.by == other.by
        if self.terms != other.terms or not same_folds or not _same_point(self.at, other.at):
            raise ValueError("streams of different terms, folds or points cannot be merged")
        pairs = zip(self.folds, other.folds, strict=True)
        return replace(self, folds=tuple(a.merge(b) for a, b in pairs))

    @property
    def total(self) -> Reduction:
        """All folds as one."""
        return merged(self.folds)

    def folded(self) -> FoldedData:
        """Return the folds for cross-validation and the search over subsets, without empty ones."""
        folds = [f for f in self.folds if f.rows]
        return pad_blocks([f.R for f in folds], [f.rows for f in folds])


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
        parts += [Part(path, group, rows) for group, rows in enumerate(count_row_groups(path))]
    return tuple(parts)


@dataclass(frozen=True, eq=False)
class Parts(Source):
    """Measurements too large for memory, as a source of reductions.

    robot, tool: the arm and its target in the flange frame [mm].
    parts: where the rows are.
    map: applies a function to every part, on this machine or on many.
    whiten: weight [1/mm] of a coordinate.

    Models that depend on earlier parts are refused (`fit_parts`)."""

    robot: Robot
    tool: tuple[float, float, float]
    parts: tuple[Part, ...]
    map: Mapper = map

    def __len__(self) -> int:
        return sum(part.rows for part in self.parts)

    def problem(self, part: Part) -> Problem:
        """Read a part. Raises DataError."""
        data = read_measurements(part.path, self.robot.prismatic, group=part.group)
        if data.gauges is not None:
            raise DataError(
                "only measured points can be fitted in parts: rows of other kinds share features "
                "across parts.",
                file=part.path.name,
                column="kind",
                remedy="Study the measurements as one file, or leave these rows out.",
            )
        tools = np.tile(np.array(self.tool), (len(data.targets), 1))
        return Problem(self.robot, data, tools)

    def alone(self) -> Parts:
        """Return the source without parts and map: what is sent to a worker."""
        return Parts(self.robot, self.tool, ())

    def reduced(
        self,
        terms: Sequence[Term],
        at: Linearisation | None = None,
        only: Sequence[int] | None = None,
    ) -> Reduction:
        """Reduce all parts, merged in file order: independent of the number of workers."""
        work = partial(_reduce_part, self.alone(), tuple(terms), at, only)
        return merged(self.map(work, self.parts))

    def stream(self, terms: Sequence[Term], theta: Array, folds: int) -> Stream:
        """Reduce all parts fold by fold, linearised at theta (p,)."""
        work = partial(_stream_part, self.alone(), tuple(terms), theta, folds)
        streams: Iterable[Stream] = self.map(work, self.parts)
        return reduce(Stream.merge, streams)


def _reduce_part(
    source: Parts,
    terms: tuple[Term, ...],
    at: Linearisation | None,
    only: Sequence[int] | None,
    part: Part,
) -> Reduction:
    return reduce_problem(source.problem(part), terms, at, only)


def _stream_part(
    source: Parts, terms: tuple[Term, ...], theta: Array, folds: int, part: Part
) -> Stream:
    return Stream.empty(terms, folds, theta).add(source.problem(part))


def fit_parts(source: Parts, model: Model, folds: int = 10) -> tuple[Fit, CrossValidation]:
    """Fit a model to measurements in parts, re-linearised pass by pass, and cross-validate it
    exactly.

    Raises DataError or NotEstimable, and StudyError for a model that depends on what no part holds
    alone."""
    _check_model(source, model)
    fitted = fit(source, model)
    folded = source.stream(model.terms, fitted.theta, folds).folded()
    return fitted, cross_validate(folded, fitted.found.kept, fitted.prior)


def _check_model(source: Parts, model: Model) -> None:
    """Raise StudyError where the model depends on what comes before a part: its place in the
    campaign, the last move, how groups are counted; or on directions of approach that a file does
    not have."""
    underived = _files_without_approach(source)
    problems = []
    for mechanism in model.mechanisms:
        names = _state_names(mechanism)
        lost = [n for n in names if n in GLOBAL_STATE or n.startswith("move")]
        if lost:
            problems.append(
                f"{mechanism.name} depends on {', '.join(lost)}, which no part of the measurements "
                "holds alone: leave it out of the base, or study the measurements as one file."
            )
        elif underived and any(n.startswith("approach") for n in names):
            files = f"{underived[0]}{' and others' if len(underived) > 1 else ''}"
            problems.append(
                f"{mechanism.name} depends on directions of approach, which parts cannot take from "
                f"the order of motion: add the columns approach1 ... to {files}."
            )
    if problems:
        raise StudyError(*problems)


def _files_without_approach(source: Parts) -> list[str]:
    """Names of the files without columns of approach."""
    import pyarrow.parquet as pq

    files = dict.fromkeys(part.path for part in source.parts)
    return [p.name for p in files if "approach1" not in pq.ParquetFile(p).schema_arrow.names]


def _state_names(mechanism: Mechanism) -> list[str]:
    """Names of the state variables that a mechanism's causes use, sorted."""
    causes = [screw.cause for term in mechanism.terms for screw in term.screws]
    return sorted({name for cause in causes for name in cause.names()})
