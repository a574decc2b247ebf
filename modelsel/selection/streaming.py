"""Configurations that come in pieces, in any order and on any machine: what stays is one triangle a
fold.

Associative: `add` a problem of some configurations, `merge` what other machines have seen; the
answers of cross-validation and of the search over subsets are those of all rows at once."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np

from .._typing import Array, Index
from ..exceptions import DataError, StudyError
from ..fitting.design import Model
from ..fitting.least_squares import Fit, fit
from ..fitting.linearisation import Linearisation
from ..fitting.problem import Problem
from ..fitting.reduction import Reduction, Source, merged, reduce_problem
from ..measurements.measurements import SAME_READING, Measurements
from ..measurements.reader import read_measurements
from ..measurements.table import row_groups
from ..mechanisms.terms import Term
from ..robot.kinematics import Robot
from .cross_validation import CrossValidation, Folded, cross_validate, pad

Mapper = Callable[
    [Callable[[Any], Any], Sequence[Any]], Iterable[Any]
]  # map, or a cluster's; results in the items' order


def fold_of(data: Measurements, count: int, by: str = "configuration") -> Index:
    """(m,) fold of every row from its own readings (rounded to 1e-6) or its group's name alone, so
    that no machine has to know what others hold: equal readings are never apart."""
    if by == "group":
        code = np.array([crc32(name.encode()) for name in data.groups], np.uint64)[data.group]
    else:
        code = np.zeros(len(data), np.uint64)
        for column in np.round(data.q / SAME_READING).astype(np.int64).T:
            code = (code ^ column.view(np.uint64)) * np.uint64(0x9E3779B97F4A7C15)
            code ^= code >> np.uint64(32)
    return np.asarray(code % np.uint64(count), dtype=np.intp)


@dataclass(frozen=True, eq=False)
class Stream:
    """What some configurations say of terms, linearised at theta (p,) or at the nominal model: a
    reduction per fold."""

    terms: tuple[Term, ...]
    folds: tuple[Reduction, ...]
    at: Array | None = None
    by: str = "configuration"

    @staticmethod
    def empty(
        terms: Sequence[Term], folds: int = 10, at: Array | None = None, by: str = "configuration"
    ) -> Stream:
        """Of no configurations."""
        return Stream(
            tuple(terms), tuple(Reduction.empty(len(terms)) for _ in range(folds)), at, by
        )

    def add(self, configurations: Problem) -> Stream:
        """With the configurations of a problem."""
        which = fold_of(configurations.data, len(self.folds), self.by)
        point = None if self.at is None else Linearisation(self.terms, self.at)
        new = tuple(
            old.merge(reduce_problem(configurations.take(which == k), self.terms, point))
            if (which == k).any()
            else old
            for k, old in enumerate(self.folds)
        )
        return Stream(self.terms, new, self.at, self.by)

    def merge(self, other: Stream) -> Stream:
        """Of both sets of configurations. Raises ValueError where they are not of the same terms
        and point."""
        same = self.at is other.at is None or (
            self.at is not None and other.at is not None and np.array_equal(self.at, other.at)
        )
        if (
            self.terms != other.terms
            or len(self.folds) != len(other.folds)
            or self.by != other.by
            or not same
        ):
            raise ValueError("streams of different terms, folds or points cannot be merged")
        return Stream(
            self.terms,
            tuple(a.merge(b) for a, b in zip(self.folds, other.folds, strict=True)),
            self.at,
            self.by,
        )

    @property
    def total(self) -> Reduction:
        """All folds as one."""
        return merged(self.folds)

    def folded(self) -> Folded:
        """For cross-validation and the search over subsets; folds that nothing fell into are left
        out."""
        some = [f for f in self.folds if f.rows]
        return pad([f.R for f in some], [f.rows for f in some])


@dataclass(frozen=True)
class Part:
    """A piece of a measurement set that one machine reads at once: a row group of a Parquet file,
    and its number of rows."""

    path: Path
    group: int
    rows: int


def parts_of(files: Sequence[Path]) -> tuple[Part, ...]:
    """Every row group of Parquet files, in order. Raises DataError."""
    return tuple(
        Part(path, group, rows) for path in files for group, rows in enumerate(row_groups(path))
    )


@dataclass(frozen=True, eq=False)
class Parts(Source):
    """Measurements that are never held whole, as a source of reductions: a robot, its target [mm],
    the pieces, and the `map` that works on them. What hangs on an earlier piece is refused
    (`fit_parts`)."""

    robot: Robot
    tool: tuple[float, float, float]
    parts: tuple[Part, ...]
    map: Mapper = map

    def __len__(self) -> int:
        return sum(part.rows for part in self.parts)

    def problem(self, part: Part) -> Problem:
        """A piece, read."""
        data = read_measurements(part.path, self.robot.prismatic, group=part.group)
        if data.gauges is not None:
            raise DataError(
                "rows that are no points cannot be fitted in parts: what they share is not in one part.",
                file=part.path.name,
                column="kind",
                remedy="Make it a study, or leave these rows out.",
            )
        return Problem(self.robot, data, np.tile(np.array(self.tool), (len(data.targets), 1)))

    def alone(self) -> Parts:
        """Without the map: what travels to a worker."""
        return Parts(self.robot, self.tool, ())

    def reduced(
        self,
        terms: Sequence[Term],
        at: Linearisation | None = None,
        only: Sequence[int] | None = None,
    ) -> Reduction:
        """Of all pieces, merged in their order whoever worked on them."""
        work = partial(_reduced, self.alone(), tuple(terms), at, only)
        return merged(self.map(work, self.parts))

    def stream(self, terms: Sequence[Term], theta: Array, folds: int) -> Stream:
        """All pieces, fold by fold, at a fitted point."""
        first, *others = self.map(
            partial(_streamed, self.alone(), tuple(terms), theta, folds), self.parts
        )
        for other in others:
            first = first.merge(other)
        return first  # type: ignore[no-any-return]


def _reduced(
    source: Parts,
    terms: tuple[Term, ...],
    at: Linearisation | None,
    only: Sequence[int] | None,
    part: Part,
) -> Reduction:
    return reduce_problem(source.problem(part), terms, at, only)


def _streamed(
    source: Parts, terms: tuple[Term, ...], theta: Array, folds: int, part: Part
) -> Stream:
    return Stream.empty(terms, folds, theta).add(source.problem(part))


def _check(source: Parts, model: Model) -> None:
    """Nothing in the model may hang on what comes before a piece: its place in the campaign, the
    last move, how groups are counted; directions of approach only where every file has them. Raises
    StudyError."""
    import pyarrow.parquet as pq

    problems, files = [], dict.fromkeys(part.path for part in source.parts)
    derived = [
        path.name for path in files if "approach1" not in pq.ParquetFile(path).schema_arrow.names
    ]
    for m in model.mechanisms:
        names = sorted(set().union(*(s.cause.names() for t in m.terms for s in t.screws)))
        lost = [n for n in names if n in ("progress", "group") or n.startswith("move")]
        if lost:
            problems.append(
                f"{m.name} looks at {', '.join(lost)}, which no piece of the measurements knows alone: leave it "
                "out of the base, or study the measurements as one file."
            )
        elif derived and any(n.startswith("approach") for n in names):
            problems.append(
                f"{m.name} looks at directions of approach, which pieces cannot take from the order of motion: add "
                f"the columns approach1 ... to {derived[0]}{' and others' if len(derived) > 1 else ''}."
            )
    if problems:
        raise StudyError(*problems)


def fit_parts(source: Parts, model: Model, folds: int = 10) -> tuple[Fit, CrossValidation]:
    """A model fitted on measurements in pieces, re-linearised pass by pass, and its exact
    cross-validation. Raises DataError or NotEstimable, and StudyError for a model that looks at
    what no piece knows alone."""
    _check(source, model)
    fitted = fit(source, model)
    return fitted, cross_validate(
        source.stream(model.terms, fitted.theta, folds).folded(), fitted.found.kept, fitted.prior
    )
