"""Cost and gradient of a model without its columns: residuals are carried back through the screw
field, so that a step towards the minimum costs a walk along the chain and no matrix."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from .._typing import Array, Index
from ..mechanisms.causes import Number
from ..mechanisms.terms import FIXTURE_AXES, FixtureTerm, Term
from ..robot._kernels import Workspace
from .design import PLACE, fill_rows
from .linearisation import add_feature_changes
from .observation import predict_readings, reading_gradients
from .problem import Problem

# numbers of causes that are kept between evaluations (240 MB); of more, a block's are made anew
MAX_KEPT = 30_000_000
ROWS = 2000  # of a block, whose screw field a core's cache about holds


class Slope(NamedTuple):
    """Whitened squares of the residual at theta, and the products (p,) of the columns there with
    it: minus half the gradient of the squares."""

    squares: float
    products: Array

    @staticmethod
    def zero(p: int) -> Slope:
        """Return the slope of no rows."""
        return Slope(0.0, np.zeros(p))

    def plus(self, other: Slope) -> Slope:
        """Return the slope of both sets of rows."""
        squares = self.squares + other.squares
        products = self.products + other.products
        return Slope(squares, products)


@dataclass(frozen=True, eq=False)
class Screws:
    """The screws of some terms by their place in the screw field: (number of the term, place,
    value) of constant ones, and of each place the terms (k,) whose cause varies."""

    terms: Sequence[Term]

    @cached_property
    def constant(self) -> tuple[Index, Index, Array]:
        """Terms, places and values of the screws whose cause is a number."""
        found = [
            (k, _place(s.frame, s.axis), s.cause.number)
            for k, term in enumerate(self.terms)
            for s in term.screws
            if isinstance(s.cause, Number)
        ]
        k, place, value = np.array(found, dtype=float).reshape(-1, 3).T
        return k.astype(np.intp), place.astype(np.intp), value

    @cached_property
    def varying(self) -> dict[int, list[tuple[int, int]]]:
        """By place: (term, number of its screw) of the others."""
        out: dict[int, list[tuple[int, int]]] = {}
        for k, term in enumerate(self.terms):
            for number, s in enumerate(term.screws):
                if not isinstance(s.cause, Number):
                    out.setdefault(_place(s.frame, s.axis), []).append((k, number))
        return out

    @cached_property
    def index(self) -> list[tuple[int, Index]]:
        """Of each place with varying causes, their terms."""
        return [
            (place, np.array([k for k, _ in found], dtype=np.intp))
            for place, found in self.varying.items()
        ]

    def causes(self, problem: Problem) -> list[Array]:
        """Evaluate the varying causes of every place, (k, m) each."""
        out = []
        for found in self.varying.values():
            values = np.empty((len(found), len(problem)))
            for row, (k, number) in zip(values, found, strict=True):
                row[:] = problem.cause(self.terms[k].screws[number].cause)
            out.append(values)
        return out

    def twist(self, theta: Array, causes: Sequence[Array], frames: int, m: int) -> Array:
        """Compute the entries (frames, 6, m) of every frame's H at theta (p,)."""
        k, place, value = self.constant
        constant = np.bincount(place, value * theta[k], 6 * frames).astype(float)
        out: Array = np.repeat(constant[:, None], m, axis=1)
        for (place_, index), values in zip(self.index, causes, strict=True):
            out[place_] += theta[index] @ values
        entries: Array = out.reshape(frames, 6, m)
        return entries

    def carry_back(self, seen: Array, causes: Sequence[Array]) -> Array:
        """Compute the products (p,) of the columns with what the rows' residual makes of every
        place of the screw field, `seen` (places, m)."""
        k, place, value = self.constant
        total = seen.sum(1)
        out = np.bincount(k, value * total[place], len(self.terms)).astype(float)
        for (place_, index), values in zip(self.index, causes, strict=True):
            np.add.at(out, index, values @ seen[place_])
        return np.asarray(out, dtype=float)


def _place(frame: int, axis: str) -> int:
    return 6 * (frame - 1) + PLACE[axis]


@dataclass(frozen=True, eq=False)
class Rows:
    """The rows of a problem under a model, ready to be evaluated at many parameters."""

    problem: Problem
    terms: Sequence[Term]
    space: Workspace = field(default_factory=Workspace, repr=False)

    @cached_property
    def screws(self) -> Screws:
        """The model's screws."""
        return Screws(self.terms)

    def parts(self) -> Iterator[tuple[slice, Part]]:
        """Yield the blocks of the rows; their causes are kept where they are not too many."""
        varying = sum(map(len, self.screws.varying.values()))
        is_kept = varying * len(self.problem) <= MAX_KEPT
        yield from self._kept if is_kept else self._make()

    @cached_property
    def _kept(self) -> list[tuple[slice, Part]]:
        return list(self._make())

    def _make(self) -> Iterator[tuple[slice, Part]]:
        for rows, part in self.problem.parts(ROWS):
            yield rows, Part(part, self.screws)

    def along(self, theta: Array, change: Array) -> Iterator[tuple[slice, Array, Array]]:
        """Yield, of every block of rows that are points, (rows, residual (c, rows), the columns at
        theta (p,) times a change (p,) of it), not whitened; overwritten by the next."""
        for rows, part in self.parts():
            yield rows, *part.arm.along(theta, change, self.space)

    def at(self, theta: Array) -> Slope:
        """Evaluate at parameters theta (p,)."""
        count = len(theta)
        total = Slope.zero(count)
        for _, part in self.parts():
            slope = part.at(theta, self.space)
            total = total.plus(slope)
        return total


@dataclass(frozen=True, eq=False)
class Part:
    """A block of rows."""

    problem: Problem
    screws: Screws

    @cached_property
    def arm(self) -> _Arm:
        """The chain up to the target, of rows that are points or are taken for such."""
        problem = self.problem
        if not problem.only_points:
            problem = problem.bare
        return _Arm(problem, self.screws)

    @cached_property
    def origin(self) -> _Arm | None:
        """The chain where the rows' distances begin."""
        origin = self.problem.origin
        if origin is None:
            return None
        return _Arm(origin, self.screws)

    def at(self, theta: Array, space: Workspace) -> Slope:
        """Evaluate at parameters theta (p,)."""
        if not self.problem.only_points:
            return self._readings_at(theta)
        moved, residual = self.arm.walk(theta, space)
        squares, back = self._weigh(residual)
        return Slope(squares, self.arm.carry_back(moved, back))

    def _weigh(self, residual: Array) -> tuple[float, Array]:
        """(squares of the whitened residual, what it is carried back as (c, m)); the residual (c,
        m) is overwritten."""
        whitening = self.problem.whitening
        white = whitening.apply(residual)
        square = np.vdot(white, white)
        squares = float(square)
        back = whitening.apply_transposed(white)
        return squares, back

    def _readings_at(self, theta: Array) -> Slope:
        """`at` where not every row is a point: see `design.assemble`."""
        problem, terms = self.problem, self.screws.terms
        gauges = problem.observed()
        change = add_feature_changes(len(gauges.features), terms, theta)
        moved, residual = self.arm.walk(theta, Workspace())
        x, origin_x, origin_field = -residual[:3], None, None
        if self.origin is not None:
            origin_field, origin_residual = self.origin.walk(theta, Workspace())
            origin_x = -origin_residual[:3]
        G, E = reading_gradients(gauges, problem.fixtures, change, x, origin_x)
        predicted = predict_readings(gauges, problem.fixtures, change, x, origin_x)
        residual[:3] = problem.readings - predicted
        measured = problem.components_measured.T
        squares, back = self._weigh(residual * measured)
        back = back * measured
        at_target = back.copy()
        at_target[:3] = np.einsum("ijm,im->jm", G, back[:3])
        products = self.arm.carry_back(moved, at_target)
        if self.origin is not None and origin_field is not None:
            begun = np.zeros(origin_field.shape[2:])
            begun[:3] = at_target[:3] * gauges.of("distance")
            products -= self.origin.carry_back(origin_field, begun)
        of_features = np.einsum("kim,im->km", E, back[:3])
        for k, term in enumerate(terms):
            if isinstance(term, FixtureTerm):
                seen = of_features[FIXTURE_AXES.index(term.axis)]
                products[k] = seen[gauges.feature == term.feature].sum()
        return Slope(squares, products)


@dataclass(frozen=True, eq=False)
class _Arm:
    """The chain of rows that are points, and the causes of a model's terms there."""

    problem: Problem
    screws: Screws

    @cached_property
    def causes(self) -> list[Array]:
        """The varying causes, (k, m) of every place."""
        return self.screws.causes(self.problem)

    def walk(self, theta: Array, space: Workspace) -> tuple[Array, Array]:
        """(screw field (n+1, 6, c, m), residual (c, m)) at theta, not whitened."""
        problem = self.problem
        m, frames, c = len(problem), problem.robot.n + 1, problem.components
        moved = space.array("field", frames, 6, c, m)
        residual = space.array("residual", c, m)
        twist = self.screws.twist(theta, self.causes, frames, m)
        fill_rows(problem, twist, slice(0, m), moved, residual, space)
        return moved, residual

    def along(self, theta: Array, change: Array, space: Workspace) -> tuple[Array, Array]:
        """(residual (c, m), columns at theta (p,) times a change (p,) of it), not whitened."""
        moved, residual = self.walk(theta, space)
        frames, _, _, m = moved.shape
        entries = self.screws.twist(change, self.causes, frames, m)
        return residual, np.einsum("facm,fam->cm", moved, entries)

    def carry_back(self, moved: Array, back: Array) -> Array:
        """Products (p,) of the columns with rows `back` (c, m); `moved`: the screw field."""
        places = moved.reshape(-1, *moved.shape[2:])
        seen = np.einsum("fcm,cm->fm", places, back)
        return self.screws.carry_back(seen, self.causes)
