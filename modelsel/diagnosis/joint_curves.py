"""One curve, several waves? What a joint's own angle does is told by the evidence of the whole, not
wave by wave.

A kink or a soft step of one joint looks like a gear's eccentricity at first, then like an
encoder's, then like a scale: each passes, and none is the cause. So the findings that act through
one joint's own angle are held, together, against a free function of that angle, and a free function
against a few waves: whichever the data make more probable stands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .._typing import Array, Index
from ..fitting.splines import spline
from .candidates import Candidate
from .evidence import compute_factors
from .scan import Columns, compute_basis, scan, subset

LONGEST = 4  # waves and the like that one curve may be made of


def find_own_joint(candidate: Candidate) -> int | None:
    """The joint through whose own angle alone a candidate acts, at that joint's own rotation; None
    for any other."""
    screws = [s for t in candidate.mechanism.terms for s in t.screws]
    frame = screws[0].frame
    same = all(
        s.frame == frame and s.axis == "rz" and s.cause.names() == {f"q{frame}"} for s in screws
    )
    return frame if same else None


@dataclass(frozen=True, eq=False)
class Curve:
    """The candidates (global indices `which`) of one joint's own angle; `free` marks the free
    functions among them."""

    which: Index
    columns: Columns
    log_prior: Array
    free: Array


def collect_curves(found: Sequence[Candidate], cols: Columns, log_prior: Array) -> dict[int, Curve]:
    """Joint -> its own-angle candidates, where a free function is among them."""
    own: dict[int, list[int]] = {}
    for g, candidate in enumerate(found):
        if (joint := find_own_joint(candidate)) is not None:
            own.setdefault(joint, []).append(g)
    out = {}
    for joint, members in own.items():
        which = np.array(members, dtype=np.intp)
        free = np.array([spline(found[g].mechanism.terms[0]) is not None for g in members])
        if free.any():
            out[joint] = Curve(which, subset(cols, which), log_prior[which], free)
    return out


def score_each(curve: Curve, Q: Array, response: Array) -> Array:
    """(G,) log prior + log Bayes factor of every candidate of a curve."""
    return np.asarray(curve.log_prior + compute_factors(scan(curve.columns, Q), response).max(0))


def chain_effects(
    curve: Curve,
    Q: Array,
    response: Array,
    given: Sequence[int] | None,
    allowed: Array,
    first: Array | None = None,
) -> tuple[float, list[int]]:
    """(log evidence, candidates) of a sum of effects, one after the other, each beyond those
    before: the `given` ones, or the most probable among the `allowed`, as long as one adds
    evidence. Q (N, ·) projects the rest of the model off; `first`: what each is worth `alone`,
    where that is known."""
    members = curve.which.tolist()
    total, out = 0.0, list[int]()
    wanted = None if given is None else [members.index(g) for g in given]
    for step in range(LONGEST if wanted is None else len(wanted)):
        joint = first if first is not None and not step else score_each(curve, Q, response)
        left = allowed.copy() if wanted is None else np.isin(np.arange(len(members)), wanted)
        left[[members.index(g) for g in out]] = False
        best = int(np.argmax(np.where(left, joint, -np.inf)))
        if wanted is None and not joint[best] > 0 or not np.isfinite(joint[best]):
            break
        X = curve.columns.sum_of(np.eye(len(curve.columns.slices[best])), best, len(response))
        Z = compute_basis(X - Q @ (Q.T @ X))
        Q, response = np.column_stack([Q, Z]), response - Z @ (Z.T @ response)
        total += float(joint[best])
        out.append(members[best])
    return total, out


def better(
    curve: Curve, Q: Array, response: Array, now: Sequence[int], odds: float
) -> list[int] | None:
    """What explains a joint's curve better than `now` does, by `odds` in log evidence: a free
    function (and what it leaves), or a few waves; None where nothing does. `response` (N,) has all
    of `now` put back, Q does not hold it."""
    first = score_each(curve, Q, response)
    held = chain_effects(curve, Q, response, now, curve.free, first)[0]
    trials = [
        chain_effects(curve, Q, response, None, np.logical_not(curve.free), first),
        *(
            chain_effects(curve, Q, response, [g], curve.free, first)
            for g in curve.which[curve.free].tolist()
        ),
    ]
    value, best = max(trials, key=lambda t: t[0])
    return best if best and value > held + odds and set(best) != set(now) else None
