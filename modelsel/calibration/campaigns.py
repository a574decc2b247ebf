"""What changed between two campaigns: parameters that moved beyond their uncertainty, mechanisms
that came, went, grew.

Two fits choose their own representatives of what the data cannot tell apart, so neither's
parameters are compared as they stand: both are expressed in one set of representatives on common
configurations (identify.relation), where the difference and its covariance are tested, corrected
for their number (Holm 1979). What moved is then said in the fewest terms that explain it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .._typing import Array
from ..exceptions import StudyError
from ..fitting.design import design
from ..fitting.identifiability import identify
from ..fitting.reduction import reduce
from ..mechanisms.geometry import build_setup
from ..mechanisms.terms import Term
from .calibration import Calibration
from .constant_part import workspace
from .mechanism_changes import (
    LEVEL,
    SEEN,
    MechanismChange,
    Motions,
    mechanisms,
    quantile,
    told,
    two_sided,
)

SAME_MM = 1e-6  # two nominal robots alike to this are one
CONFIGURATIONS = 300
WORTH = 9.0  # χ² that a term must explain to be said
LISTED = 6
ALIKE = 2.0  # and by how much less another may, and still do as well


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
    """A change of one term that, beside those before it, explains the difference best; `alike` move
    the arm as it does."""

    mechanism: str
    symbol: str
    unit: str
    by: float
    standard_error: float
    moves_mm: float
    alike: tuple[str, ...]


@dataclass(frozen=True)
class Comparison:
    """All parameters tested, the most surprising first; the fewest terms that explain what moved;
    mechanisms; what could not be compared."""

    changes: tuple[Change, ...]
    explained_by: tuple[Explanation, ...]
    mechanisms: tuple[MechanismChange, ...]
    left_aside: tuple[str, ...]
    seen_mm: (
        tuple[float, float] | None
    )  # from where a change of the best, of the worst told parameter would have been seen

    @property
    def moved(self) -> tuple[Change, ...]:
        """The changes beyond chance."""
        return tuple(c for c in self.changes if c.p <= LEVEL)


def holm(p: Array) -> Array:
    """p-values (k,) corrected for their number, step down (Holm 1979)."""
    order = np.argsort(p, kind="stable")
    stepped = np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1))
    out = np.empty(len(p))
    out[order] = np.minimum(stepped, 1.0)
    return out


def same_robot(a: Calibration, b: Calibration) -> None:
    """Refuses two nominal robots that differ. Raises StudyError."""
    ja, jb = a.robot.joints, b.robot.joints
    if len(ja) != len(jb) or any(
        np.abs(x.before - y.before).max() > SAME_MM or x.prismatic != y.prismatic
        for x, y in zip(ja, jb, strict=True)
    ):
        raise StudyError(
            f"{a.robot.name} and {b.robot.name} are not the same nominal robot: nothing can be compared."
        )


def compare(a: Calibration, b: Calibration) -> Comparison:
    """Campaign b against campaign a, on configurations that both have seen. Raises StudyError."""
    same_robot(a, b)
    both = {
        name: (max(pair[0], b.ranges[name][0]), min(pair[1], b.ranges[name][1]))
        for name, pair in a.ranges.items()
        if name in b.ranges
    }
    ranges = {
        name: (low, max(high, low))
        for name, (low, high) in {**b.ranges, **a.ranges, **both}.items()
    }
    at = workspace(replace(a, ranges=ranges, model=a.model + b.model.mechanisms), m=CONFIGURATIONS)
    placing = build_setup(a.robot, 1, 1, True, False).terms if a.registered or b.registered else ()
    terms = tuple(dict.fromkeys([*placing, *(t for c in (a, b) for t in c.terms)]))
    place = {t.screws: k for k, t in reversed(list(enumerate(terms)))}
    theta, factors = np.zeros((2, len(terms))), []
    for k, c in enumerate((a, b)):
        own = np.array([place[t.screws] for t in c.terms], dtype=np.intp)
        theta[k, own] = c.theta
        factor = np.zeros((len(terms), c.factor.shape[1]))
        factor[own] = c.factor
        factors.append(factor)
    X = design(at, terms)[0]
    found = identify(
        reduce(X.transpose(0, 1, 2).reshape(-1, len(terms)), np.zeros(X.shape[0] * X.shape[1]))
    )
    kept, relation = list(found.exact), found.relation
    before, after = theta @ relation
    F = np.concatenate([relation.T @ f for f in factors], 1)
    spread = np.sqrt(np.square(F).sum(1))
    tested = [
        i
        for i, k in enumerate(kept)
        if spread[i] > 0 and terms[k] not in placing and _in_both(a, b, terms[k])
    ]
    p = holm(np.array([two_sided((after[i] - before[i]) / spread[i]) for i in tested]))
    size = np.sqrt(np.square(X).sum(1).mean(0))
    owner = {
        t.screws: m.name for c in (b, a) for m in reversed(c.model.mechanisms) for t in m.terms
    }
    changes = [
        Change(
            owner[t.screws],
            t.symbol,
            t.unit,
            float(before[i]),
            float(after[i]),
            float(spread[i]),
            float(q),
            float(abs(after[i] - before[i]) * size[kept[i]]),
        )
        for i, q in zip(tested, p, strict=True)
        for t in (terms[kept[i]],)
    ]
    changes.sort(key=lambda c: (c.p, -abs(c.after - c.before) / c.standard_error))
    explained: list[Explanation] = []
    if len(p) and p.min() <= LEVEL:
        open_ = [
            k
            for k, t in enumerate(terms)
            if t not in placing and t.screws in owner and _in_both(a, b, t)
        ]
        for k, by, error, alike in _fewest(
            (after - before)[tested], F[tested], relation[np.ix_(open_, tested)]
        ):
            t = terms[open_[k]]
            explained.append(
                Explanation(
                    owner[t.screws],
                    t.symbol,
                    t.unit,
                    by,
                    error,
                    float(abs(by) * size[open_[k]]),
                    tuple(
                        f"{o.symbol} of {owner[o.screws]}"
                        for j in alike
                        for o in (terms[open_[j]],)
                    ),
                )
            )
    each = [np.linalg.norm(relation.T[tested] @ f, axis=1) for f in factors]
    surer = float(np.median(each[1] / np.maximum(each[0], 1e-300))) if tested else 1.0
    named = mechanisms(
        Motions((a, b), terms, theta, factors, X, surer), {e.mechanism for e in explained}
    )
    least = (
        (quantile(LEVEL / max(len(tested), 1)) + SEEN)
        * spread[tested]
        * size[np.array(kept, dtype=np.intp)[tested]]
    )
    return Comparison(
        tuple(changes),
        tuple(explained),
        named,
        tuple(t.symbol for t in placing),
        (float(least.min()), float(least.max())) if tested else None,
    )


def _fewest(d: Array, F: Array, directions: Array) -> list[tuple[int, float, float, list[int]]]:
    """(term, its change, standard error, terms that would do as well), one after the other, until
    what is left of the difference d (k,) with covariance F Fᵀ is chance: generalised least squares
    on the `directions` (terms, k) of single terms."""
    from scipy.linalg import qr, solve_triangular
    from scipy.special import chdtrc

    L = qr(F.T, mode="r")[0][: len(d)].T  # F Fᵀ = L Lᵀ
    z, V = solve_triangular(L, d, lower=True), solve_triangular(L, directions.T, lower=True)
    size = np.linalg.norm(V, axis=0)
    V = V[:, :] / np.where(size > 0, size, 1.0)
    Q, chosen, alike = np.zeros((len(d), 0)), list[int](), list[list[int]]()
    left = z
    while len(chosen) < len(d) and chdtrc(len(d) - len(chosen), float(left @ left)) < LEVEL:
        free = V - Q @ (Q.T @ V)
        norm = np.linalg.norm(free, axis=0)
        gain = np.where(norm > 1e-6, (free.T @ left) ** 2 / np.maximum(norm, 1e-6) ** 2, -1.0)
        best = int(np.argmax(gain))
        if gain[best] < WORTH:
            break
        alike.append([j for j in np.flatnonzero(gain > gain[best] - ALIKE).tolist() if j != best])
        chosen.append(best)
        Q = np.column_stack([Q, free[:, best] / norm[best]])
        left = z - Q @ (Q.T @ z)
    if not chosen:
        return []
    R = Q.T @ V[:, chosen]
    by = np.linalg.solve(R, Q.T @ z)
    error = np.linalg.norm(np.linalg.inv(R), axis=1)
    return [
        (k, float(b / size[k]), float(e / size[k]), others)
        for k, b, e, others in zip(chosen, by, error, alike, strict=True)
    ]


def _in_both(a: Calibration, b: Calibration, term: Term) -> bool:
    return all(term.screws in {t.screws for t in c.terms} for c in (a, b))


def sentences(found: Comparison) -> list[str]:
    """What changed, in words; what did not, too, and how large a change would have been seen (with
    90 %)."""
    out = [told(m) for m in found.mechanisms]
    for e in found.explained_by:
        also = f" (or as well: {', '.join(e.alike[:LISTED])})" if e.alike else ""
        out.append(
            f"{e.symbol} of {e.mechanism}{also} changed by {e.by:.3g} ± {e.standard_error:.2g} {e.unit}: "
            f"{e.moves_mm:.3g} mm rms at the target."
        )
    least = min((c.p for c in found.changes), default=1.0)
    counted = f"{len(found.changes)} parameters tested, p = {least:.2g} for the most surprising, corrected for their number"
    if found.seen_mm is None:
        out.append("No parameter is fitted in both campaigns: nothing else can be compared.")
    elif found.explained_by:
        out.append(
            f"These are the fewest terms that explain the difference of the parameters ({counted})."
        )
    elif found.moved:
        names = ", ".join(f"{c.symbol} of {c.mechanism}" for c in found.moved[:LISTED])
        out.append(f"{names} changed beyond chance, but no few terms explain it ({counted}).")
    else:
        other = (
            "else "
            if any(m.what in ("came", "went", "grew", "shrank") for m in found.mechanisms)
            else ""
        )
        low, high = found.seen_mm
        out.append(
            f"Nothing {other}changed beyond chance ({counted}); a change of one by {low:.2g} mm rms at the target, of the "
            f"least told by {high:.2g} mm, would have been seen."
        )
    if found.left_aside:
        out.append(
            "The set-up was registered anew: what moves the arm as the tracker or the target would "
            f"({', '.join(found.left_aside)}) cannot be compared."
        )
    return out
