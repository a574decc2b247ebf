"""Reduction: any number of rows folded into one triangle, block by block; associative, constant memory.

R holds the columns and, last, the response: X'X = R'R of the stacked rows. LAPACK's dtpqrt puts a block onto R.
"""
from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dtpqrt

from .design import blocks
from .rigid import Array
from .scene import Scene
from .screws import Term

PANEL = 8  # dtpqrt's inner block, measured best for some forty columns


@dataclass(frozen=True, eq=False)
class Reduction:
    """Upper triangle R (p+1, p+1) of [columns | response] and the number of rows that went into it."""

    R: Array
    rows: int

    @staticmethod
    def empty(p: int) -> Reduction:
        """Of no rows, for p columns and the response."""
        return Reduction(np.zeros((p + 1, p + 1)), 0)

    @property
    def p(self) -> int:
        """Number of columns."""
        return len(self.R) - 1

    def add(self, matrix: Array) -> Reduction:
        """With the rows of matrix (k, p+1), the response last, stacked on."""
        if not len(matrix):
            return self
        triangle, _, _, info = dtpqrt(0, min(PANEL, self.p + 1), np.asfortranarray(self.R), np.asfortranarray(matrix))
        if info:
            raise ArithmeticError(f"dtpqrt: argument {-info} is wrong")
        return Reduction(np.triu(triangle), self.rows + len(matrix))

    def merge(self, other: Reduction) -> Reduction:
        """Of both sets of rows."""
        return Reduction(self.add(other.R).R, self.rows + other.rows)

    def select(self, columns: Sequence[int]) -> Reduction:
        """Of some columns, in the given order; the response stays last."""
        picked = self.R[:, [*columns, self.p]]
        out = Reduction.empty(len(columns)).add(picked)
        return Reduction(out.R, self.rows)


def merged(parts: Iterable[Reduction]) -> Reduction:
    """All of them as one."""
    first, *others = parts
    for other in others:
        first = first.merge(other)
    return first


def reduce(matrix: Array, response: Array) -> Reduction:
    """Of a plain matrix (N, p) and response (N,)."""
    return Reduction.empty(matrix.shape[1]).add(np.column_stack([matrix, response]))


def reduce_scene(scene: Scene, terms: Sequence[Term], at: tuple[Sequence[Term], Array] | None = None) -> Reduction:
    """Of a scene's whitened design and residual, block by block; the whole matrix is never held."""
    out = Reduction.empty(len(terms))
    for _, columns, residual in blocks(scene, terms, at):
        p, c, m = columns.shape
        out = out.add(np.concatenate([columns.reshape(p, c * m), residual.reshape(1, c * m)]).T)
    return out
