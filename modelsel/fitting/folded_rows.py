"""Very many rows, fold after fold: the slopes of every fold, and residuals, of models at given
parameters, without a column.

Several models go over the rows together, so that a block of rows evaluates a cause once."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from .._typing import Array, Index
from ..mechanisms.terms import Term
from ..robot._kernels import Workspace
from .gradient import ROWS, Part, Screws, Slope
from .problem import Problem


@dataclass(frozen=True, eq=False)
class FoldedProblem:
    """The rows of a problem in the order of their folds: `order` (m,), where each stands in that
    problem; `edges` (K+1,), where each fold begins."""

    problem: Problem
    order: Index
    edges: Index

    @staticmethod
    def of(problem: Problem, fold_of: Index) -> FoldedProblem:
        """Sort the rows by their folds (m,)."""
        order = np.argsort(fold_of, kind="stable")
        ordered = fold_of[order]
        last = int(ordered[-1])
        folds = np.arange(last + 2)
        edges = np.searchsorted(ordered, folds)
        return FoldedProblem(problem.take(order), order, edges)

    @property
    def count(self) -> int:
        """Number of folds."""
        return len(self.edges) - 1

    def blocks(self) -> Iterator[tuple[int, Index, Problem]]:
        """Yield blocks of rows, each of one fold: the fold, where the rows stand, their problem."""
        for fold, (first, end) in enumerate(pairwise(self.edges.tolist())):
            for start in range(first, end, ROWS):
                rows = slice(start, min(start + ROWS, end))
                yield fold, self.order[rows], self.problem.take(rows)


@dataclass(frozen=True, eq=False)
class Point:
    """Some terms at parameters theta (p,)."""

    terms: Sequence[Term]
    theta: Array


def measure_slopes(folded: FoldedProblem, points: Sequence[Point]) -> list[list[Slope]]:
    """Compute the slope of every fold, for every point."""
    screws = _prepare(folded, points)
    space = Workspace()
    slopes = [[Slope.zero(len(point.theta)) for _ in range(folded.count)] for point in points]
    for fold, _, problem in folded.blocks():
        for of_point, point, own in zip(slopes, points, screws, strict=True):
            slope = Part(problem, own).at(point.theta, space)
            of_point[fold] = of_point[fold].plus(slope)
    return slopes


def walk_along(
    folded: FoldedProblem, points: Sequence[Point], changes: Sequence[Array]
) -> Iterator[tuple[int, Index, Array, Array]]:
    """Yield, of every block of rows that are points and of every point, (its number, where the rows
    stand, residual (c, rows), the columns times the fold's change, of (K, p), of the parameters),
    not whitened; overwritten by the next."""
    screws = _prepare(folded, points)
    space = Workspace()
    for fold, rows, problem in folded.blocks():
        for number, (point, own) in enumerate(zip(points, screws, strict=True)):
            arm = Part(problem, own).arm
            yield number, rows, *arm.along(point.theta, changes[number][fold], space)


def _prepare(folded: FoldedProblem, points: Sequence[Point]) -> list[Screws]:
    """Return the points' screws; what these need of the chain is evaluated once for all rows."""
    folded.problem.keep_values(term for point in points for term in point.terms)
    return [Screws(point.terms) for point in points]
