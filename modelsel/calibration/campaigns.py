"""What changed between two campaigns: parameters that moved beyond their uncertainty, mechanisms
that came, went, grew.

Two fits choose their own representatives of what the data cannot tell apart, so neither's
parameters are compared as they stand: both are expressed in one set of representatives on common
configurations (identify.relation), where the difference and its covariance are tested, corrected
for their number (Holm 1979). What moved is then said in the fewest terms that explain it."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from .._linalg import TINY, project_out
from .._typing import Array, Index
from ..exceptions import StudyError
from ..fitting.design import compute_design
from ..fitting.identifiability import identify
from ..fitting.reduction import reduce
from ..mechanisms.geometry import build_setup
from ..mechanisms.terms import Term
from ..robot.kinematics import Joint
from .calibration import Calibration
from .constant_part import sample_workspace
from .mechanism_changes import (
    DEFINITE_CHANGES,
    POWER_QUANTILE,
    SIGNIFICANCE,
    MechanismChange,
    Motions,
    compare_mechanisms,
    describe_change,
    two_sided_p,
    two_sided_quantile,
)

MAX_DIFFERENCE_MM = 1e-6  # between the transforms of two nominal robots that are one
CONFIGURATIONS = 300  # drawn from what both campaigns have seen
MIN_CHI2 = 9.0  # that a term must explain to be named
MAX_CHI2_LOSS = 2.0  # by how much less another term may explain and still do as well
MIN_FREE_NORM = 1e-6  # of a unit column beyond the chosen ones, to be another direction
MAX_LISTED = 6


@dataclass(frozen=True)
class Change:
    """One parameter in both campaigns: values and the difference with its standard error, in the
    term's unit; `p` corrected for the number tested; `moves_mm` what the difference does to the
    target (rms)."""

    mechanism: str
    symbol: str
    unit: str
    before: float
    after: float
    standard_error: float
    p: float
    moves_mm: float


@dataclass(frozen=True)
class Explanation:
    """A change of one term that, with those before it, explains the difference best; the terms
    `alike` would explain it as well."""

    mechanism: str
    symbol: str
    unit: str
    by: float
    standard_error: float
    moves_mm: float
    alike: tuple[str, ...]


@dataclass(frozen=True)
class Comparison:
    """Two campaigns compared: all parameters tested, the most surprising first; the fewest terms
    that explain what changed; the mechanisms; what could not be compared."""

    changes: tuple[Change, ...]
    explained_by: tuple[Explanation, ...]
    mechanisms: tuple[MechanismChange, ...]
    left_aside: tuple[str, ...]
    # from where a change of the best, of the worst determined parameter would have been seen
    seen_mm: tuple[float, float] | None

    @property
    def moved(self) -> tuple[Change, ...]:
        """The changes beyond chance."""
        return tuple(c for c in self.changes if c.p <= SIGNIFICANCE)


def correct_holm(p: Array) -> Array:
    """Correct p-values (k,) for their number, step down (Holm 1979)."""
    order = np.argsort(p, kind="stable")
    stepped = np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1))
    out = np.empty(len(p))
    out[order] = np.minimum(stepped, 1.0)
    return out


def require_same_robot(a: Calibration, b: Calibration) -> None:
    """Raise StudyError where two nominal robots differ."""
    ja, jb = a.robot.joints, b.robot.joints
    same = len(ja) == len(jb) and all(map(_is_same_joint, ja, jb))
    if not same:
        raise StudyError(
            f"{a.robot.name} and {b.robot.name} are not the same nominal robot: nothing can be compared."
        )


def _is_same_joint(x: Joint, y: Joint) -> bool:
    near = np.abs(x.before - y.before).max() <= MAX_DIFFERENCE_MM
    return bool(near) and x.prismatic == y.prismatic


def compare_campaigns(a: Calibration, b: Calibration) -> Comparison:
    """Compare campaign b with campaign a, on configurations that both have seen. Raises
    StudyError."""
    require_same_robot(a, b)
    space = _build_common_space(a, b)
    tested = _select_tested(space)
    changes, p = _test_parameters(space, tested)
    significant = bool(len(p)) and p.min() <= SIGNIFICANCE
    explained = _explain(space, tested) if significant else ()
    moved = {explanation.mechanism for explanation in explained}
    motions = Motions(
        (a, b), space.terms, space.theta, space.factors, space.X, _error_ratio(space, tested)
    )
    return Comparison(
        changes,
        explained,
        compare_mechanisms(motions, moved),
        tuple(term.symbol for term in space.placing),
        _find_detectable_range(space, tested),
    )


@dataclass(frozen=True, eq=False)
class _CommonSpace:
    """Both campaigns in one set of representatives.

    `X` (m, 3, p) columns of all terms at common configurations; `theta` (2, p) and `factors` of the
    campaigns' covariances; `kept` places of the representatives, `relation` (p, r) from all terms
    to them; `placing` the terms that a new placement takes up.
    """

    campaigns: tuple[Calibration, Calibration]
    terms: tuple[Term, ...]
    placing: tuple[Term, ...]
    theta: Array
    factors: list[Array]
    X: Array
    kept: Index
    relation: Array

    @cached_property
    def shared(self) -> set[tuple[Hashable, ...]]:
        """Keys of the terms that both campaigns fitted."""
        first, second = ({term.key for term in c.terms} for c in self.campaigns)
        return first & second

    @cached_property
    def owner(self) -> dict[tuple[Hashable, ...], str]:
        """The mechanism of every term, by its screws; the first campaign's where both have it."""
        a, b = self.campaigns
        mechanisms = [m for c in (b, a) for m in reversed(c.model.mechanisms)]
        return {term.key: m.name for m in mechanisms for term in m.terms}

    @cached_property
    def displacement(self) -> Array:
        """Rms displacement (p,) of the target per unit of every term [mm]."""
        return np.asarray(np.sqrt(np.square(self.X).sum(1).mean(0)))

    @cached_property
    def estimates(self) -> Array:
        """Representatives (2, r) in both campaigns."""
        return np.asarray(self.theta @ self.relation)

    @cached_property
    def difference(self) -> Array:
        """Second campaign minus first (r,)."""
        before, after = self.estimates
        return np.asarray(after - before)

    @cached_property
    def difference_factor(self) -> Array:
        """Factor (r, k) of the difference's covariance."""
        return np.concatenate([self.relation.T @ factor for factor in self.factors], 1)

    @cached_property
    def standard_errors(self) -> Array:
        """Standard errors (r,) of the difference."""
        return np.asarray(np.sqrt(np.square(self.difference_factor).sum(1)))

    def is_comparable(self, term: Term) -> bool:
        """Whether both campaigns fitted a term, and no new placement takes it up."""
        return term not in self.placing and term.key in self.shared


def _build_common_space(a: Calibration, b: Calibration) -> _CommonSpace:
    model = a.model + b.model.mechanisms
    problem = sample_workspace(
        replace(a, ranges=_intersect_ranges(a, b), model=model), m=CONFIGURATIONS
    )
    registered = a.registered or b.registered
    placing = build_setup(a.robot, 1, 1, True, False).terms if registered else ()
    terms = tuple(dict.fromkeys([*placing, *a.terms, *b.terms]))
    X = compute_design(problem, terms)[0]
    rows = X.transpose(0, 1, 2).reshape(-1, len(terms))
    identified = identify(reduce(rows, np.zeros(len(rows))))
    placed = [_place_estimates(c, terms) for c in (a, b)]
    return _CommonSpace(
        (a, b),
        terms,
        placing,
        np.array([theta for theta, _ in placed]),
        [factor for _, factor in placed],
        X,
        np.array(identified.exact, dtype=np.intp),
        identified.relation,
    )


def _intersect_ranges(a: Calibration, b: Calibration) -> dict[str, tuple[float, float]]:
    """Return what both campaigns have seen of a value; of a value that one alone has, what it has
    seen."""
    ranges = {**b.ranges, **a.ranges}
    for name in a.ranges.keys() & b.ranges.keys():
        low = max(a.ranges[name][0], b.ranges[name][0])
        high = min(a.ranges[name][1], b.ranges[name][1])
        ranges[name] = (low, max(high, low))
    return ranges


def _place_estimates(c: Calibration, terms: Sequence[Term]) -> tuple[Array, Array]:
    """Return a campaign's theta (p,) and covariance factor (p, r) among the terms of both; zero for
    the other's terms."""
    place = {term.key: k for k, term in reversed(list(enumerate(terms)))}
    places = np.array([place[term.key] for term in c.terms], dtype=np.intp)
    theta = np.zeros(len(terms))
    theta[places] = c.theta
    factor = np.zeros((len(terms), c.factor.shape[1]))
    factor[places] = c.factor
    return theta, factor


def _select_tested(space: _CommonSpace) -> Index:
    """Select the representatives that both campaigns fitted and the data determine."""
    comparable = np.array([space.is_comparable(space.terms[k]) for k in space.kept], dtype=bool)
    return np.flatnonzero(comparable & (space.standard_errors > 0))


def _test_parameters(space: _CommonSpace, tested: Index) -> tuple[tuple[Change, ...], Array]:
    """Test every representative: (changes, the most surprising first; p-values corrected for their
    number, in the order of `tested`)."""
    z = space.difference[tested] / space.standard_errors[tested]
    p = correct_holm(np.array([two_sided_p(value) for value in z.tolist()]))
    changes = [_build_change(space, i, value) for i, value in zip(tested, p.tolist(), strict=True)]
    changes.sort(
        key=lambda change: (change.p, -abs(change.after - change.before) / change.standard_error)
    )
    return tuple(changes), p


def _build_change(space: _CommonSpace, i: int, p: float) -> Change:
    term = space.terms[space.kept[i]]
    before, after = space.estimates[:, i].tolist()
    return Change(
        mechanism=space.owner[term.key],
        symbol=term.symbol,
        unit=term.unit,
        before=before,
        after=after,
        standard_error=float(space.standard_errors[i]),
        p=p,
        moves_mm=float(abs(space.difference[i]) * space.displacement[space.kept[i]]),
    )


def _explain(space: _CommonSpace, tested: Index) -> tuple[Explanation, ...]:
    """Explain the difference by the fewest terms that both campaigns fitted."""
    comparable = [space.is_comparable(term) for term in space.terms]
    open_terms = np.flatnonzero(comparable)
    steps = _select_fewest_terms(
        space.difference[tested],
        space.difference_factor[tested],
        space.relation[np.ix_(open_terms, tested)],
    )
    return tuple(_build_explanation(space, open_terms.tolist(), step) for step in steps)


def _build_explanation(space: _CommonSpace, open_terms: list[int], step: _Step) -> Explanation:
    place = open_terms[step.term]
    term = space.terms[place]
    others = [space.terms[open_terms[k]] for k in step.alike]
    return Explanation(
        mechanism=space.owner[term.key],
        symbol=term.symbol,
        unit=term.unit,
        by=step.change,
        standard_error=step.standard_error,
        moves_mm=float(abs(step.change) * space.displacement[place]),
        alike=tuple(f"{other.symbol} of {space.owner[other.key]}" for other in others),
    )


def _error_ratio(space: _CommonSpace, tested: Index) -> float:
    """Return the second campaign's standard errors over the first's, in the median."""
    if not len(tested):
        return 1.0
    relation = space.relation.T[tested]
    first, second = (np.linalg.norm(relation @ factor, axis=1) for factor in space.factors)
    return float(np.median(second / np.maximum(first, TINY)))


def _find_detectable_range(space: _CommonSpace, tested: Index) -> tuple[float, float] | None:
    """Return the rms displacements [mm] from which a change of the best and of the worst determined
    parameter would have been seen; None where none is tested."""
    if not len(tested):
        return None
    errors = two_sided_quantile(SIGNIFICANCE / len(tested)) + POWER_QUANTILE
    displacement = space.displacement[space.kept[tested]]
    least = errors * space.standard_errors[tested] * displacement
    return float(least.min()), float(least.max())


# -- the fewest terms that explain a difference
# ------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Step:
    """A chosen term, its change with standard error, and the terms that would do as well."""

    term: int
    change: float
    standard_error: float
    alike: list[int]


def _select_fewest_terms(difference: Array, factor: Array, directions: Array) -> list[_Step]:
    """Select terms one after the other until what they leave of a difference is chance.

    `difference` (k,) has the covariance factor factorᵀ; `directions` (terms, k) is what a unit of
    each term changes. Generalised least squares by orthogonal matching pursuit.
    """
    from scipy.linalg import qr, solve_triangular
    from scipy.special import chdtrc

    count = len(difference)
    L = qr(factor.T, mode="r")[0][:count].T  # factor factorᵀ = L Lᵀ
    response = solve_triangular(L, difference, lower=True)
    columns = solve_triangular(L, directions.T, lower=True)
    lengths = np.linalg.norm(columns, axis=0)
    columns = columns / np.where(lengths > 0, lengths, 1.0)
    basis, residual = np.zeros((count, 0)), response
    chosen, alike = list[int](), list[list[int]]()
    while len(chosen) < count:
        if chdtrc(count - len(chosen), float(residual @ residual)) >= SIGNIFICANCE:
            break
        free = project_out(columns, basis)
        norms = np.linalg.norm(free, axis=0)
        gains = _explained_chi2(free, norms, residual)
        best = int(np.argmax(gains))
        if gains[best] < MIN_CHI2:
            break
        rivals = np.flatnonzero(gains > gains[best] - MAX_CHI2_LOSS).tolist()
        alike.append([rival for rival in rivals if rival != best])
        chosen.append(best)
        basis = np.column_stack([basis, free[:, best] / norms[best]])
        residual = response - basis @ (basis.T @ response)
    changes, errors = _solve_chosen(basis, columns[:, chosen], response)
    return [
        _Step(term, float(change / lengths[term]), float(error / lengths[term]), others)
        for term, change, error, others in zip(chosen, changes, errors, alike, strict=True)
    ]


def _explained_chi2(free: Array, norms: Array, residual: Array) -> Array:
    """Return the χ² that each direction explains; -1 for one that the chosen ones span."""
    explained = (free.T @ residual) ** 2 / np.maximum(norms, MIN_FREE_NORM) ** 2
    return np.where(norms > MIN_FREE_NORM, explained, -1.0)


def _solve_chosen(basis: Array, columns: Array, response: Array) -> tuple[Array, Array]:
    """Return the changes of the chosen terms and their standard errors."""
    R = basis.T @ columns
    changes = np.linalg.solve(R, basis.T @ response)
    errors = np.linalg.norm(np.linalg.inv(R), axis=1)
    return np.asarray(changes), np.asarray(errors)


def describe_comparison(comparison: Comparison) -> list[str]:
    """Describe what changed and what did not, and how large a change would have been seen (with
    90 %)."""
    sentences = [describe_change(change) for change in comparison.mechanisms]
    sentences += map(_describe_explanation, comparison.explained_by)
    sentences.append(_summarise(comparison))
    if comparison.left_aside:
        sentences.append(
            "The set-up was registered again: motions that the tracker or the target would also make "
            f"({', '.join(comparison.left_aside)}) cannot be compared."
        )
    return sentences


def _describe_explanation(explanation: Explanation) -> str:
    alike = ", ".join(explanation.alike[:MAX_LISTED])
    also = f" (or equally well: {alike})" if alike else ""
    return (
        f"{explanation.symbol} of {explanation.mechanism}{also} changed by {explanation.by:.3g} ± "
        f"{explanation.standard_error:.2g} {explanation.unit}: {explanation.moves_mm:.3g} mm rms at the target."
    )


def _summarise(comparison: Comparison) -> str:
    """Return the sentence on all parameters tested."""
    least = min((change.p for change in comparison.changes), default=1.0)
    tested = f"{len(comparison.changes)} parameters tested, p = {least:.2g} for the most surprising, corrected for their number"
    if comparison.seen_mm is None:
        return "No parameter is fitted in both campaigns: nothing else can be compared."
    if comparison.explained_by:
        return (
            f"These are the fewest terms that explain the difference of the parameters ({tested})."
        )
    if comparison.moved:
        moved = comparison.moved[:MAX_LISTED]
        names = ", ".join(f"{change.symbol} of {change.mechanism}" for change in moved)
        return f"{names} changed beyond chance, but no few terms explain it ({tested})."
    changed = any(change.what in DEFINITE_CHANGES for change in comparison.mechanisms)
    low, high = comparison.seen_mm
    return (
        f"Nothing {'else ' if changed else ''}changed beyond chance ({tested}). A change of {low:.2g} mm rms at the "
        f"target in the best determined parameter, of {high:.2g} mm in the worst, would have been seen."
    )
