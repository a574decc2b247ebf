"""A screen of waves of the drives: how much of what a model leaves each of many numbers a turn explains.

A wave of a drive moves the target at row i by F_i sin(k θ_i) and F_i cos(k θ_i): F_i (c,) is what a unit
turn of the drive does there, whatever the number k, and θ_i what its encoder reads. With e the residual
and w_i = F_i · e_i, the products of both columns with e are the imaginary and the real part of
Σ_i w_i exp(i k θ_i), and those with one another follow from Σ_i |F_i|² exp(2 i k θ_i). Powers of
exp(i θ) come from one another by doubling, so that a wave costs a product of complex numbers a row, and
no column is built.

What the model explains of a wave is taken out where that matters: of waves that may be beyond chance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._linalg import unit_columns
from .._typing import Array, Index
from ..fitting.design import compute_design, measure_rounding
from ..fitting.least_squares import Fit
from ..fitting.problem import Problem
from ..mechanisms.causes import ONE
from ..mechanisms.motors import drive_screws, motor_reading
from ..mechanisms.terms import Term
from .row_blocks import split_range

# rows whose powers are computed together
PIECE = 512
# share of a wave that the model leaves at least, of one that is looked for
LEAST_LEFT = 0.25
# determinant of a wave's Gram matrix, over its squared trace, from which both its phases are seen
LEAST_DETERMINANT = 1e-6

Complex = NDArray[np.complex128]


class Counts(NamedTuple):
    """Numbers of waves a turn at equal distances: the first, the distance, how many."""

    first: float
    step: float
    number: int

    @property
    def values(self) -> Array:
        """The numbers (K,)."""
        steps = self.step * np.arange(self.number)
        return np.asarray(self.first + steps)


class _Products(NamedTuple):
    """Products of the two columns of K waves: with the residual, `cosine` and `sine`, and with one another."""

    cosine: Array
    sine: Array
    cosines: Array
    sines: Array
    across: Array

    def take(self, which: Index) -> _Products:
        """Return those of some waves."""
        return _Products(*(values[which] for values in self))

    def without(self, inside: Complex) -> _Products:
        """Return the products beyond a model; `inside` (K, r): those with its basis."""
        cosines = self.cosines - np.square(inside.real).sum(1)
        sines = self.sines - np.square(inside.imag).sum(1)
        across = self.across - (inside.real * inside.imag).sum(1)
        return self._replace(cosines=cosines, sines=sines, across=across)

    def explain(self) -> Array:
        """Compute (K,) what the waves explain; nothing of one with a phase that is hardly seen."""
        determinant = self.cosines * self.sines - np.square(self.across)
        squares = self.sines * np.square(self.cosine) + self.cosines * np.square(self.sine)
        crossed = 2 * self.across * self.cosine * self.sine
        trace = self.cosines + self.sines
        is_seen = determinant > LEAST_DETERMINANT * np.square(trace)
        explained: Array = np.zeros(len(trace))
        np.divide(squares - crossed, determinant, out=explained, where=is_seen)
        return explained


@dataclass(frozen=True, eq=False)
class Remains:
    """What a fitted model leaves, as the drives see it.

    `angles` (J, m): what their encoders read [rad]; `fields` (J, m, c): whitened displacement by a unit
    turn of each; `basis` (m, c, r): orthonormal, of the model's columns; `residual` (m, c): beyond it;
    `freedom`: coordinates less the model's rank."""

    angles: Array
    fields: Array
    basis: Array
    residual: Array
    freedom: int

    def compute_chance(self, drive: int, counts: Counts, bound: float) -> Array:
        """Compute (K,) the logarithm of how often chance alone lets a wave of a drive explain as much:
        0 of those for which that is above a `bound`, or of which the model leaves too little.

        Of independent, equally normal errors a wave of any phase explains the share s of ν coordinates
        with probability (1 - s)^((ν - 2) / 2)."""
        raw = self._multiply(drive, counts)
        total = float(np.square(self.residual).sum())
        most = raw.explain() / LEAST_LEFT
        hopeful = np.flatnonzero(self._take_logarithm(most / total) <= bound)
        chance: Array = np.zeros(counts.number)
        inside = self._multiply_basis(drive, counts.values[hopeful])
        beyond = raw.take(hopeful).without(inside)
        chance[hopeful] = self._take_logarithm(beyond.explain() / total)
        chance[chance > bound] = 0.0
        return chance

    def _take_logarithm(self, share: Array) -> Array:
        left = np.maximum(1 - share, np.finfo(float).eps)
        return np.asarray(0.5 * (self.freedom - 2) * np.log(left))

    def _multiply(self, drive: int, counts: Counts) -> _Products:
        """Multiply the columns of waves with the residual and with one another."""
        field = self.fields[drive]
        weights = (field * self.residual).sum(1)
        squares = np.square(field).sum(1)
        first = np.zeros(counts.number, complex)
        second = np.zeros(counts.number, complex)
        for rows in split_range(len(weights), PIECE):
            powers = raise_turns(self.angles[drive, rows], counts)
            first += powers @ weights[rows]
            np.square(powers, out=powers)
            second += powers @ squares[rows]
        whole = float(squares.sum())
        cosines = 0.5 * (whole + second.real)
        sines = 0.5 * (whole - second.real)
        return _Products(first.real, first.imag, cosines, sines, 0.5 * second.imag)

    def _multiply_basis(self, drive: int, numbers: Array) -> Complex:
        """Multiply the columns of some waves with the model's basis: (K, r), cosines and sines."""
        field = self.fields[drive]
        inside = np.zeros((len(numbers), self.basis.shape[2]), complex)
        for rows in split_range(len(field), PIECE):
            weights = np.einsum("mc,mcr->mr", field[rows], self.basis[rows])
            phases = np.outer(numbers, self.angles[drive, rows])
            inside += np.cos(phases) @ weights
            inside += 1j * (np.sin(phases) @ weights)
        return inside


def raise_turns(angles: Array, counts: Counts) -> Complex:
    """Compute exp(i k θ) (K, m) of equally distant numbers k: each step doubles how many are known."""
    powers = np.empty((counts.number, len(angles)), complex)
    powers[0] = np.exp(1j * counts.first * angles)
    turn = np.exp(1j * counts.step * angles)
    known = 1
    while known < counts.number:
        more = min(known, counts.number - known)
        np.multiply(powers[:more], turn, out=powers[known : known + more])
        turn = turn * turn
        known += more
    return powers


def see_remains(problem: Problem, fitted: Fit, drives: Sequence[int]) -> Remains | None:
    """See what a fitted model leaves of a problem, whose rows are whitened one by one; None where that is
    rounding, or no coordinates are left beside the model.

    Terms that the fit shrinks take whatever they can."""
    model = [fitted.terms[k] for k in fitted.representatives]
    turned = [Term(f"drive {j}", drive_screws(problem.robot, j, ONE)) for j in drives]
    design, observed = compute_design(problem, [*model, *turned], fitted.at())
    rank = len(model)
    freedom = problem.coordinates - rank
    shape = (*observed.shape, rank)
    columns = design[:, :, :rank].reshape(-1, rank)
    basis, _ = np.linalg.qr(unit_columns(columns))
    flat = observed.reshape(-1)
    residual = flat - basis @ (basis.T @ flat)
    if freedom <= 2 or np.linalg.norm(residual) <= measure_rounding(problem):
        return None
    readings = [problem.cause(motor_reading(problem.robot, j)) for j in drives]
    return Remains(
        angles=np.array(readings),
        fields=np.moveaxis(design[:, :, rank:], 2, 0),
        basis=basis.reshape(shape),
        residual=residual.reshape(observed.shape),
        freedom=freedom,
    )
