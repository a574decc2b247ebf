"""What changed between two campaigns: parameters that moved beyond their uncertainty, mechanisms that came, went, grew.

Two fits choose their own representatives of what the data cannot tell apart, so neither's parameters are compared as they stand:
both are expressed in one set of representatives on common configurations (identify.relation), where the difference and its
covariance are tested, corrected for their number (Holm 1979). What moved is then said in the fewest terms that explain it.
"""
from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..matrix.design import design
from ..matrix.identify import identify
from ..matrix.reduce import reduce
from ..words.errors import StudyError
from ..words.rigid import Array
from ..wrong.mechanisms.geometry import setup
from ..wrong.screws import Term
from .calibration import Calibration
from .carried import workspace

LEVEL = 0.05
SAME_MM = 1e-6        # two nominal robots alike to this are one
CONFIGURATIONS = 300
WORTH = 9.0           # χ² that a term must explain to be said
LISTED = 6
RENAMED = 0.95        # cosine of two motions that are one under two names
ALIKE = 2.0           # and by how much less another may, and still do as well


@dataclass(frozen=True)
class Change:
    """One parameter in both campaigns: values and the difference with its standard error, in the term's unit; `p` corrected for
    the number tested; `moves_mm` what the difference does to the target (rms)."""

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
    """A change of one term that, beside those before it, explains the difference best; `alike` move the arm as it does."""

    mechanism: str
    symbol: str
    unit: str
    by: float
    standard_error: float
    moves_mm: float
    alike: tuple[str, ...]


@dataclass(frozen=True)
class MechanismChange:
    """A mechanism that came, went or changed: what it moved the target by (rms mm) in each campaign."""

    name: str
    what: str
    before_mm: float
    after_mm: float


@dataclass(frozen=True)
class Comparison:
    """All parameters tested, the most surprising first; the fewest terms that explain what moved; mechanisms; what could not be
    compared."""

    changes: tuple[Change, ...]
    explained_by: tuple[Explanation, ...]
    mechanisms: tuple[MechanismChange, ...]
    left_aside: tuple[str, ...]

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
    if len(ja) != len(jb) or any(np.abs(x.before - y.before).max() > SAME_MM or x.prismatic != y.prismatic
                                 for x, y in zip(ja, jb, strict=True)):
        raise StudyError(f"{a.robot.name} and {b.robot.name} are not the same nominal robot: nothing can be compared.")


def compare(a: Calibration, b: Calibration) -> Comparison:
    """Campaign b against campaign a, on configurations that both have seen. Raises StudyError."""
    same_robot(a, b)
    both = {name: (max(pair[0], b.ranges[name][0]), min(pair[1], b.ranges[name][1])) for name, pair in a.ranges.items()
            if name in b.ranges}
    ranges = {name: (low, max(high, low)) for name, (low, high) in {**b.ranges, **a.ranges, **both}.items()}
    at = workspace(replace(a, ranges=ranges, model=a.model + b.model.mechanisms), m=CONFIGURATIONS)
    placing = setup(a.robot, 1, 1, True, False).terms if a.registered or b.registered else ()
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
    found = identify(reduce(X.transpose(0, 1, 2).reshape(-1, len(terms)), np.zeros(X.shape[0] * X.shape[1])))
    kept, relation = list(found.exact), found.relation
    before, after = theta @ relation
    F = np.concatenate([relation.T @ f for f in factors], 1)
    spread = np.sqrt(np.square(F).sum(1))
    tested = [i for i, k in enumerate(kept) if spread[i] > 0 and terms[k] not in placing and _in_both(a, b, terms[k])]
    p = holm(np.array([_two_sided((after[i] - before[i]) / spread[i]) for i in tested]))
    size = np.sqrt(np.square(X).sum(1).mean(0))
    owner = {t.screws: m.name for c in (b, a) for m in reversed(c.model.mechanisms) for t in m.terms}
    changes = [Change(owner[t.screws], t.symbol, t.unit, float(before[i]), float(after[i]), float(spread[i]), float(q),
                      float(abs(after[i] - before[i]) * size[kept[i]])) for i, q in zip(tested, p, strict=True)
               for t in (terms[kept[i]],)]
    changes.sort(key=lambda c: (c.p, -abs(c.after - c.before) / c.standard_error))
    explained: list[Explanation] = []
    if len(p) and p.min() <= LEVEL:
        open_ = [k for k, t in enumerate(terms) if t not in placing and t.screws in owner and _in_both(a, b, t)]
        for k, by, error, alike in _fewest((after - before)[tested], F[tested], relation[np.ix_(open_, tested)]):
            t = terms[open_[k]]
            explained.append(Explanation(owner[t.screws], t.symbol, t.unit, by, error, float(abs(by) * size[open_[k]]),
                                         tuple(f"{o.symbol} of {owner[o.screws]}" for j in alike for o in (terms[open_[j]],))))
    return Comparison(tuple(changes), tuple(explained), _mechanisms(a, b, terms, theta, X, {e.mechanism for e in explained}),
                      tuple(t.symbol for t in placing))


def _fewest(d: Array, F: Array, directions: Array) -> list[tuple[int, float, float, list[int]]]:
    """(term, its change, standard error, terms that would do as well), one after the other, until what is left of the difference
    d (k,) with covariance F Fᵀ is chance: generalised least squares on the `directions` (terms, k) of single terms."""
    from scipy.linalg import qr, solve_triangular
    from scipy.special import chdtrc
    L = qr(F.T, mode="r")[0][:len(d)].T                                   # F Fᵀ = L Lᵀ
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
    return [(k, float(b / size[k]), float(e / size[k]), others) for k, b, e, others in zip(chosen, by, error, alike, strict=True)]


def _in_both(a: Calibration, b: Calibration, term: Term) -> bool:
    return all(term.screws in {t.screws for t in c.terms} for c in (a, b))


def _two_sided(z: float) -> float:
    from scipy.special import ndtr
    return float(2 * ndtr(-abs(z)))


def _mechanisms(a: Calibration, b: Calibration, terms: tuple[Term, ...], theta: Array, X: Array, moved: set[str]
                ) -> tuple[MechanismChange, ...]:
    """What came, went, grew or shrank: every mechanism but the geometry, by what it moves the target. One that went and one that
    came and moves it alike are one motion under two names."""
    place = {t.screws: k for k, t in reversed(list(enumerate(terms)))}
    motion: list[dict[str, Array]] = [{}, {}]
    for k, c in enumerate((a, b)):
        for m in c.model.mechanisms:
            if m.name not in ("geometric", "set-up"):
                own = [place[t.screws] for t in m.terms]
                motion[k][m.name] = (X[:, :, own] @ theta[k, own]).ravel()
    before, after = motion
    def rms(d: Array | None) -> float:
        return 0.0 if d is None else float(np.sqrt(d @ d / len(X)))
    went, came, out = [n for n in before if n not in after], [n for n in after if n not in before], list[MechanismChange]()
    for name in list(went):
        like = [n for n in came if _cosine(before[name], after[n]) > RENAMED]
        if like:
            went.remove(name)
            came.remove(like[0])
            first, second = rms(before[name]), rms(after[like[0]])
            out.append(MechanismChange(f"{name} (now {like[0]}, which moves the arm alike)",
                                       "grew" if second > first else "shrank", first, second))
    out += [MechanismChange(n, "went", rms(before[n]), 0.0) for n in went]
    out += [MechanismChange(n, "came", 0.0, rms(after[n])) for n in came]
    return (*out, *(MechanismChange(n, "grew" if rms(after[n]) > rms(before[n]) else "shrank", rms(before[n]), rms(after[n]))
                    for n in before if n in after and n in moved))


def _cosine(a: Array, b: Array) -> float:
    size = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(a @ b) / size if size else 0.0


def sentences(found: Comparison) -> list[str]:
    """What changed, in words; what did not, too."""
    out = []
    for m in found.mechanisms:
        size = f"{m.before_mm:.3g} to {m.after_mm:.3g}" if m.before_mm and m.after_mm else f"{max(m.before_mm, m.after_mm):.3g}"
        out.append(f"{m.name} {m.what}: {size} mm rms at the target.")
    for e in found.explained_by:
        also = f" (or as well: {', '.join(e.alike[:LISTED])})" if e.alike else ""
        out.append(f"{e.symbol} of {e.mechanism}{also} changed by {e.by:.3g} ± {e.standard_error:.2g} {e.unit}: "
                   f"{e.moves_mm:.3g} mm rms at the target.")
    least = min((c.p for c in found.changes), default=1.0)
    counted = f"{len(found.changes)} parameters tested, p = {least:.2g} for the most surprising, corrected for their number"
    said = "These are the fewest changes that explain the difference" if out else "Nothing changed beyond chance"
    out.append(f"{said} ({counted}).")
    if found.left_aside:
        out.append("The set-up was registered anew: what moves the arm as the tracker or the target would "
                   f"({', '.join(found.left_aside)}) cannot be compared.")
    return out
