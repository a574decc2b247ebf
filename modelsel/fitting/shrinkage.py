"""Shrinkage of free functions: the coefficients of each have a variance of their own, found by
maximum marginal likelihood."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .._linalg import TINY, invert_root
from .._typing import Array, Index
from ..mechanisms.terms import TermKey
from .design import Model
from .gauss_newton import WholeProblem
from .iteration import COARSE_MM, State
from .least_squares import STEP_MM, Fit, begin, finish, fit, go_on, sampled_solver, solver_of
from .problem import Problem
from .sampled import SAMPLE_STEP_MM, draw_sample, takes_sample
from .solver import ITERATIONS, Held, Solver
from .splines import spline, spline_groups

MAX_ROUNDS = 60  # of the fixed point
TOLERANCE = 1e-3  # relative change of a precision at which the fixed point is reached
REFIT_TOLERANCE = 0.1  # relative change of a precision that asks for no further fit
# largest precision of a coefficient, in squared norms of its column: a function that is not there
# is held at zero
MAX_PRECISION = 1e6
MIN_EFFECTIVE = 1e-3  # parameters that a function counts for at least
START = {"r": 3e-4, "t": 0.1}  # rad, mm: first guess of a coefficient's size


def wide_groups(model: Model) -> list[Index]:
    """Return the term indices of every free function, shifts and rotations apart: each group is
    shrunk by a variance of its own."""
    place = {term.key: k for k, term in enumerate(model.terms)}
    groups: dict[tuple[int, str], list[int]] = {}
    for number, mechanism in enumerate(model.mechanisms):
        for term in mechanism.terms:
            if spline(term) is not None:
                kind = term.screws[0].axis[0]
                groups.setdefault((number, kind), []).append(place[term.key])
    return [np.array(group, dtype=np.intp) for group in groups.values()]


def variances(solver: Solver, state: State, groups: Sequence[Index]) -> Array:
    """Compute the precisions (p,) sigma²/v of every term by MacKay's fixed point of the marginal
    likelihood, v one number a group (MacKay 1992, Neural Computation 4, 415)."""
    likelihood = _Marginal(solver, state, groups)
    precision = likelihood.start()
    for _ in range(MAX_ROUNDS):
        previous, precision = precision, likelihood.update(precision)
        if np.allclose(precision, previous, rtol=TOLERANCE):
            break
    out = np.zeros(len(state.theta))
    out[likelihood.kept] = precision
    return out


@dataclass(frozen=True, eq=False)
class _Marginal:
    """The marginal likelihood of the variances of `groups` of a model's terms, by the expansion of
    its squares at theta; all arrays over the k kept terms."""

    solver: Solver
    state: State
    groups: Sequence[Index]

    @cached_property
    def kept(self) -> list[int]:
        """Indices of the fitted terms."""
        return list(self.state.found.kept)

    @cached_property
    def inside(self) -> list[Index]:
        """Positions of each group's kept terms."""
        where = {term: i for i, term in enumerate(self.kept)}
        return [np.array([where[k] for k in g if k in where], dtype=np.intp) for g in self.groups]

    @cached_property
    def gram(self) -> Array:
        """Cross products (k, k) of the columns."""
        return self.state.expansion.gram[np.ix_(self.kept, self.kept)]

    @cached_property
    def left(self) -> Array:
        """Products (k,) of the columns with the residual at theta."""
        return self.state.slope.products[self.kept]

    @cached_property
    def shrunk(self) -> Index:
        """Positions (s,) of the groups' terms, each once."""
        return np.unique(np.concatenate([np.zeros(0, dtype=np.intp), *self.inside]))

    @cached_property
    def places(self) -> list[Index]:
        """Where each group's terms stand among the shrunk ones."""
        return [np.searchsorted(self.shrunk, positions) for positions in self.inside]

    @cached_property
    def fixed(self) -> Index:
        """Positions (f,) of the other terms."""
        return np.setdiff1d(np.arange(len(self.kept)), self.shrunk)

    @cached_property
    def response(self) -> Array:
        """Products (k,) of the columns with what they have to explain, of all that theta explains
        already."""
        return np.asarray(self.left + self.gram @ self.state.theta[self.kept])

    @cached_property
    def fixed_gram(self) -> Array:
        """`gram` (f, f) of the fixed terms, with the prior on what the data hardly determine."""
        fixed = self.fixed
        pairs = np.ix_(fixed, fixed)
        gram = self.gram[pairs]
        rows = self.state.weak.rows
        if rows is None:
            return gram
        kept_rows = rows[:, self.kept]
        weak = kept_rows[:, fixed]
        weak_gram = weak.T @ weak
        return np.asarray(gram + weak_gram)

    @cached_property
    def elimination(self) -> tuple[Array, Array]:
        """What the fixed terms are of the shrunk ones: coefficients (f, s), and constants (f,)."""
        across = self.gram[np.ix_(self.fixed, self.shrunk)]
        right = np.column_stack([across, self.response[self.fixed]])
        solved = np.linalg.solve(self.fixed_gram, right)
        return np.asarray(solved[:, :-1]), np.asarray(solved[:, -1])

    @cached_property
    def beyond(self) -> tuple[Array, Array]:
        """`gram` (s, s) and `response` (s,) of the shrunk terms beyond the fixed ones: these do not
        change with the precisions."""
        coefficients, constants = self.elimination
        across = self.gram[np.ix_(self.fixed, self.shrunk)]
        gram = self.gram[np.ix_(self.shrunk, self.shrunk)] - across.T @ coefficients
        response = self.response[self.shrunk] - across.T @ constants
        return np.asarray(gram), np.asarray(response)

    @cached_property
    def inverse_correlation(self) -> Array:
        """Inverse (s, s) of the prior's correlation of the shrunk terms, by blocks."""
        out: Array = np.eye(len(self.shrunk))
        place = {self.kept[k]: i for i, k in enumerate(self.shrunk)}
        for index, root in spline_groups(self.solver.model.terms):
            among = [n for n, term in enumerate(index) if term in place]
            block = [place[index[n]] for n in among]
            half = np.linalg.inv(root)[:, among]
            out[np.ix_(block, block)] = half.T @ half
        return out

    def start(self) -> Array:
        """Return the precisions to start from: those of the fit, else one."""
        count = len(self.kept)
        precision: Array = np.zeros(count)
        known = self.state.shrinkage.precision
        groups = zip(self.groups, self.inside, strict=True)
        for group, positions in groups:
            initial = 1.0
            if known is not None:
                first = group[0]
                initial = known[first]
            precision[positions] = initial
        return precision

    def update(self, precision: Array) -> Array:
        """Take one step of the fixed point."""
        gram, response = self.beyond
        inverse = self.inverse_correlation
        scale = np.sqrt(precision[self.shrunk])
        root = invert_root(gram + scale[:, None] * inverse * scale)
        beta = self._every(root.T @ (root @ response))
        effective = []
        blocks = [inverse[np.ix_(place, place)] for place in self.places]
        for positions, place, block in zip(self.inside, self.places, blocks, strict=True):
            columns = root[:, place]
            trace = (block * (columns.T @ columns)).sum(1)
            effective.append(len(positions) - float(precision[positions] @ trace))
        noise = self._noise_variance(beta, effective)
        out: Array = precision.copy()
        for positions, block, count in zip(self.inside, blocks, effective, strict=True):
            largest = float(self.gram[positions, positions].max(initial=0.0))
            size = float(beta[positions] @ block @ beta[positions])
            ratio = noise * max(count, MIN_EFFECTIVE) / max(size, TINY)
            out[positions] = min(ratio, MAX_PRECISION * largest)
        return out

    def _every(self, shrunk: Array) -> Array:
        """Return the estimates (k,) of all kept terms, from those (s,) of the shrunk ones."""
        coefficients, constants = self.elimination
        explained = coefficients @ shrunk
        count = len(self.kept)
        out = np.empty(count)
        out[self.shrunk] = shrunk
        out[self.fixed] = constants - explained
        return out

    def _noise_variance(self, beta: Array, effective: Sequence[float]) -> float:
        """Estimate sigma² from what beta leaves."""
        state = self.state
        before = state.theta[self.kept]
        step = beta - before
        descent = step @ self.left
        moved = self.gram @ step
        curved = step @ moved
        squares = state.slope.squares
        change = curved - 2 * descent
        rss = squares + float(change)
        counts = map(len, self.inside)
        shrunk = sum(counts)
        count = len(self.kept)
        fixed = count - shrunk
        rows = self.solver.count
        used = sum(effective)
        freedom = rows - fixed - used
        positive = max(freedom, 1.0)
        variance = rss / positive
        return float(variance)


def fit_shrunk(
    problem: Problem,
    model: Model,
    start: Fit | None = None,
    step_mm: float = STEP_MM,
    *,
    held: Held = "geometry",
    fold_of: Index | None = None,
) -> Fit:
    """Fit a model, its free functions shrunk; a plain fit where it has none. `start`: a fit of a
    similar model; `held` and `fold_of` as in `fit`."""
    theta, sample = None, None
    groups = wide_groups(model)
    if groups and takes_sample(problem, model, held):
        sample = draw_sample(problem)
        start = fit_shrunk(sample, model, start, SAMPLE_STEP_MM, held=held)
    if start is not None:
        known = _by_key(start, start.theta)
        theta = np.array([known.get(term.key, 0.0) for term in model.terms])
    if not groups:
        return fit(problem, model, start=theta, step_mm=step_mm, held=held, fold_of=fold_of)
    precision = _first_precision(problem, model, groups, start)
    if sample is not None and start is not None:
        solver = sampled_solver(problem, sample, start, held, fold_of)
    else:
        solver = solver_of(problem, model, precision, held)
    # precisions need no more than an intermediate fit
    is_whole = isinstance(solver.strategy, WholeProblem)
    rough_mm = max(step_mm, COARSE_MM) if is_whole else step_mm
    first = np.zeros(len(precision)) if theta is None else theta
    state = begin(solver, first, precision, ITERATIONS, rough_mm)
    state = weigh_groups(solver, state, groups, precision, rough_mm)
    if step_mm < rough_mm:
        state = go_on(solver, state, ITERATIONS, step_mm)
    return finish(solver, state, step_mm)


def weigh_groups(
    solver: Solver, state: State, groups: Sequence[Index], precision: Array, step_mm: float
) -> State:
    """Go on from a fit at some precisions (p,) to those that the data ask for."""
    for _ in range(2):
        previous, precision = precision, variances(solver, state, groups)
        state = go_on(solver, solver.weighed(state, precision), ITERATIONS, step_mm)
        if np.allclose(precision, previous, rtol=REFIT_TOLERANCE):
            break
    return state


def _first_precision(
    problem: Problem, model: Model, groups: Sequence[Index], start: Fit | None
) -> Array:
    """Choose the precisions (p,) to begin with: those of a similar model, else by the usual sizes."""
    known: dict[TermKey, float] = {}
    if start is not None and start.precision is not None:
        known = _by_key(start, start.precision)
    weight = problem.whitening.typical_weight(None)
    terms = model.terms
    count = len(terms)
    precision = np.zeros(count)
    for group in groups:
        number = group[0]
        first = terms[number]
        screw = first.screws[0]
        kind = screw.axis[0]
        usual = START[kind]
        relative = 0.1 * weight / usual
        by_size = relative**2
        precision[group] = known.get(first.key, by_size)
    return precision


def _by_key(fitted: Fit, values: Array) -> dict[TermKey, float]:
    return dict(zip((term.key for term in fitted.terms), values, strict=True))
