"""A screen of waves of the drives: how much of what a model leaves each of many numbers a turn explains.

A wave of a drive moves the target at row i by F_i sin(k θ_i) and F_i cos(k θ_i): F_i (c,) is what a unit
turn of the drive does there, whatever the number k, and θ_i what its encoder reads. With e the residual
and w_i = F_i · e_i, the products of both columns with e are the imaginary and the real part of
Σ_i w_i exp(i k θ_i), and those with one another follow from Σ_i |F_i|² exp(2 i k θ_i). Powers of
exp(i θ) come from one another by doubling, so that a wave costs a product of complex numbers a row, and
no column is built.

What the model explains of a wave is taken out where that matters: of waves that may be beyond chance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..._linalg import TINY, unit_columns
from ..._typing import Array, Index
from ...fitting.design import compute_design, measure_rounding
from ...fitting.least_squares import Fit
from ...fitting.problem import Problem
from ...mechanisms.causes import ONE
from ...mechanisms.motors import drive_screws, motor_reading
from ...mechanisms.terms import Term
from ..columns.row_blocks import split_range

# rows whose powers are computed together
PIECE = 512
# share of a wave that the model leaves at least, and of the residual that the wave explains at least, of
# one that is looked for
LEAST_LEFT, LEAST_SHARE = 0.25, 0.1
# determinant of a wave's Gram matrix, over its squared trace, from which both its phases are seen
LEAST_DETERMINANT = 1e-6

# draws of the rows' signs, from a stream of their own
SIGN_DRAWS, SIGN_SEED = 199, 0

Complex = NDArray[np.complex128]


class Counts(NamedTuple):
    """Numbers of waves a turn at equal distances: the first, the distance, how many."""

    first: float
    step: float
    number: int

    @property
    def values(self) -> Array:
        """The numbers (K,)."""
        places = np.arange(self.number)
        steps = self.step * places
        numbers = self.first + steps
        return np.asarray(numbers)


class _Products(NamedTuple):
    """Products of the two columns of K waves: with the residual, `cosine` and `sine`, and with one another."""

    cosine: Array
    sine: Array
    cosines: Array
    sines: Array
    across: Array

    def take(self, which: Index) -> _Products:
        """Return those of some waves."""
        taken = []
        for values in self:
            own = values[which]
            taken.append(own)
        return _Products(*taken)

    def without(self, inside: Complex) -> _Products:
        """Return the products beyond a model; `inside` (K, r): those with its basis."""
        cosine = inside.real
        sine = inside.imag
        product = cosine * sine
        cosines = np.square(cosine).sum(1)
        sines = np.square(sine).sum(1)
        across = product.sum(1)
        return self._replace(
            cosines=self.cosines - cosines, sines=self.sines - sines, across=self.across - across
        )

    def explain(self) -> Array:
        """Compute (K,) what the waves explain, or (K, B) of several residuals; nothing of one with a phase that
        is hardly seen."""
        cosines, sines = self.cosines, self.sines
        cosine, sine = self.cosine, self.sine
        across = self.across
        crossed = np.square(across)
        straight = cosines * sines
        determinant = straight - crossed
        by_cosine = sines * np.square(cosine)
        by_sine = cosines * np.square(sine)
        both = across * cosine
        total = by_cosine + by_sine
        total -= 2 * both * sine
        trace = cosines + sines
        square = np.square(trace)
        least = LEAST_DETERMINANT * square
        is_seen = determinant > least
        explained: Array = np.zeros(total.shape)
        np.divide(total, determinant, out=explained, where=is_seen)
        return explained


@dataclass(frozen=True, eq=False)
class Remains:
    """What a fitted model leaves, as one drive sees it.

    `angles` (m,): what its encoder reads [rad]; `squares` (m,): squared length of what a unit turn of it
    moves the rows, whitened; `weights` (m,): product of that with the residual; `inside` (m, r): with an
    orthonormal basis of the model's columns; `square`, `freedom`: of the residual along that motion, its
    square and in how many directions chance has a hand."""

    angles: Array
    squares: Array
    weights: Array
    inside: Array
    square: float
    freedom: float

    def compute_chance(self, counts: Counts, bound: float) -> Array:
        """Compute (K,) the logarithm of how often chance alone lets a wave of the drive explain as much:
        0 of those for which that is above a `bound`, which explain too little, or of which the model
        leaves too little.

        Of the residual along what the drive moves, with ν degrees of freedom, independent and equally
        normal errors let a wave of any phase explain the share s with probability (1 - s)^((ν - 2) / 2).
        So do those of a drive that does not repeat, which have no other direction."""
        raw = self._multiply(counts)
        most = raw.explain() / LEAST_LEFT
        at_best = self._take_logarithm(most)
        hopeful = np.flatnonzero(at_best <= bound)
        numbers = counts.values[hopeful]
        inside = self._multiply_basis(numbers)
        beyond = raw.take(hopeful).without(inside)
        explained = beyond.explain()
        logarithm = self._take_logarithm(explained)
        least = LEAST_SHARE * self.square
        is_small = explained < least
        is_likely = logarithm > bound
        logarithm[is_small | is_likely] = 0.0
        chance: Array = np.zeros(counts.number)
        chance[hopeful] = logarithm
        return chance

    def compute_sign_p(self, counts: Counts, block: Index) -> float:
        """Compute how often a wave of any number explains as much of this residual as the best one does, when
        signs are drawn for whole postures, `block` (m,): that holds for rows of unequal noise, too.

        Neither has what the model explains of a wave taken out, which makes the probability no smaller."""
        rng = np.random.default_rng(SIGN_SEED)
        _, posture = np.unique(block, return_inverse=True)
        shape = int(posture.max()) + 1, SIGN_DRAWS
        signs = rng.choice([-1.0, 1.0], shape)[posture]
        signs = np.column_stack([np.ones(len(posture)), signs])
        raw = self._multiply(counts)
        sums = np.zeros((counts.number, SIGN_DRAWS + 1), complex)
        for rows in split_range(len(self.angles), PIECE):
            flipped = self.weights[rows, None] * signs[rows]
            sums += raise_turns(self.angles[rows], counts) @ flipped
        grams = (values[:, None] for values in raw[2:])
        largest = _Products(sums.real, sums.imag, *grams).explain().max(0)
        as_large = (largest[1:] >= largest[0]).sum()
        return float((1 + as_large) / (SIGN_DRAWS + 1))

    def _take_logarithm(self, explained: Array) -> Array:
        share = explained / self.square
        rest = 1 - share
        precision = np.finfo(float)
        left = np.maximum(rest, precision.eps)
        logarithm = np.log(left)
        beyond = self.freedom - 2
        power = 0.5 * beyond
        logarithm *= power
        return np.asarray(logarithm)

    def _multiply(self, counts: Counts) -> _Products:
        """Multiply the columns of waves with the residual and with one another."""
        first = np.zeros(counts.number, complex)
        second = np.zeros(counts.number, complex)
        for rows in split_range(len(self.angles), PIECE):
            powers = raise_turns(self.angles[rows], counts)
            first += powers @ self.weights[rows]
            np.square(powers, out=powers)
            second += powers @ self.squares[rows]
        whole = float(self.squares.sum())
        cosines = 0.5 * (whole + second.real)
        sines = 0.5 * (whole - second.real)
        return _Products(first.real, first.imag, cosines, sines, 0.5 * second.imag)

    def _multiply_basis(self, numbers: Array) -> Complex:
        """Multiply the columns of some waves with the model's basis: (K, r), cosines and sines."""
        _, rank = self.inside.shape
        shape = len(numbers), rank
        cosines = np.zeros(shape)
        sines = np.zeros(shape)
        for rows in split_range(len(self.angles), PIECE):
            own = self.inside[rows]
            angles = self.angles[rows]
            phases = np.outer(numbers, angles)
            cosine = np.cos(phases)
            sine = np.sin(phases)
            cosines += cosine @ own
            sines += sine @ own
        imaginary = 1j * sines
        return cosines + imaginary


def raise_turns(angles: Array, counts: Counts) -> Complex:
    """Compute exp(i k θ) (K, m) of equally distant numbers k: each step doubles how many are known."""
    number = counts.number
    shape = number, len(angles)
    imaginary = 1j * angles
    powers = np.empty(shape, complex)
    powers[0] = np.exp(counts.first * imaginary)
    turn = np.exp(counts.step * imaginary)
    known = 1
    while known < number:
        left = number - known
        more = min(known, left)
        before = powers[:more]
        end = known + more
        new = powers[known:end]
        np.multiply(before, turn, out=new)
        turn = turn * turn
        known += more
    return powers


def see_remains(problem: Problem, fitted: Fit, drives: Sequence[int]) -> dict[int, Remains]:
    """See what a fitted model leaves of a problem, whose rows are whitened one by one, as some drives do;
    as none where that is rounding, or no coordinates are left beside the model.

    Terms that the fit shrinks take whatever they can."""
    model = [fitted.terms[k] for k in fitted.representatives]
    turned = [Term(f"drive {j}", drive_screws(problem.robot, j, ONE)) for j in drives]
    design, observed = compute_design(problem, [*model, *turned], fitted.at())
    rank = len(model)
    basis, _ = np.linalg.qr(unit_columns(design[:, :, :rank].reshape(-1, rank)))
    flat = observed.reshape(-1)
    beyond = flat - basis @ (basis.T @ flat)
    if problem.coordinates - rank <= 2 or np.linalg.norm(beyond) <= measure_rounding(problem):
        return {}
    by_row = basis.reshape(*observed.shape, rank)
    residual = beyond.reshape(observed.shape)
    seen = {}
    for k, j in enumerate(drives, rank):
        own = _look_along(problem, j, design[:, :, k], by_row, residual)
        if own.freedom > 2:
            seen[j] = own
    return seen


def _look_along(
    problem: Problem, drive: int, field: Array, basis: Array, residual: Array
) -> Remains:
    """Look at a residual (m, c) along what a drive moves, `field` (m, c); `basis` (m, c, r)."""
    squares = np.square(field).sum(1)
    weights = (field * residual).sum(1)
    inside = np.einsum("mc,mcr->mr", field, basis)
    is_moved = squares > TINY
    length = squares[is_moved]
    along = np.square(weights[is_moved]) / length
    taken = np.square(inside[is_moved]).sum(1) / length
    angle = motor_reading(problem.robot, drive)
    reading = problem.cause(angle)
    return Remains(
        angles=np.broadcast_to(reading, len(problem)),
        squares=squares,
        weights=weights,
        inside=inside,
        square=max(float(along.sum()), TINY),
        freedom=float((1 - taken).sum()),
    )
