"""Joint curves: whether a joint's own-angle error is one curve or a sum of waves.

A kink or a soft step of one joint resembles a gear's eccentricity at first, then an encoder's, then
a scale error: each is significant, and none is the cause. So the effects that act through one
joint's own angle are weighed together against a free function of that angle, and a free function
against a few waves; whichever the data make more probable stands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .._typing import Array, Index, Mask
from ..fitting.splines import spline
from .candidate_columns import Columns, select_columns
from .candidates import Candidate
from .evidence import compute_factors
from .scan import build_scan, compute_basis

# effects (waves and the like) that one curve may be made of
MAX_EFFECTS_PER_CURVE = 4


def find_own_joint(candidate: Candidate) -> int | None:
    """Find the joint at whose rotation alone, by whose own angle alone, a candidate acts.

    None for any other candidate."""
    first_term = candidate.mechanism.terms[0]
    frame = first_term.screws[0].frame
    own_angle = {f"q{frame}"}
    for term in candidate.mechanism.terms:
        for screw in term.screws:
            is_own_rotation = screw.frame == frame and screw.axis == "rz"
            is_own_angle = screw.cause.names() == own_angle
            if not (is_own_rotation and is_own_angle):
                return None
    return frame


@dataclass(frozen=True, eq=False)
class Curve:
    """The candidates of one joint's own angle.

    `which` (k,): their indices among all candidates; `free` (k,) marks the free functions among
    them."""

    which: Index
    columns: Columns
    log_prior: Array
    free: Mask


def collect_curves(found: Sequence[Candidate], cols: Columns, log_prior: Array) -> dict[int, Curve]:
    """Map every joint to its own-angle candidates, where a free function is among them."""
    members: dict[int, list[int]] = {}
    for g, candidate in enumerate(found):
        joint = find_own_joint(candidate)
        if joint is not None:
            members.setdefault(joint, []).append(g)
    curves = {}
    for joint, indices in members.items():
        which = np.array(indices, dtype=np.intp)
        is_free = [spline(found[g].mechanism.terms[0]) is not None for g in indices]
        if not any(is_free):
            continue
        curves[joint] = Curve(
            which=which,
            columns=select_columns(cols, which),
            log_prior=log_prior[which],
            free=np.array(is_free),
        )
    return curves


def score_each(curve: Curve, Q: Array, response: Array) -> Array:
    """Compute (G,) log prior + log Bayes factor of every candidate of a curve alone."""
    factors = compute_factors(build_scan(curve.columns, Q), response)
    return np.asarray(curve.log_prior + factors.max(0))


def chain_effects(
    curve: Curve,
    Q: Array,
    response: Array,
    given: Sequence[int] | None,
    allowed: Mask,
    first: Array | None = None,
) -> tuple[float, list[int]]:
    """Sum up effects one after the other, each beyond those before: (log evidence, candidates).

    The effects are the `given` candidates, or else the most probable among the `allowed` (k,), as
    long as one adds evidence. Q (N, ·) projects the rest of the model off the response (N,);
    `first`: the result of `score_each`, where it is known."""
    members = curve.which.tolist()
    steps = MAX_EFFECTS_PER_CURVE
    offered = allowed.copy()
    if given is not None:
        steps = len(given)
        offered = np.isin(curve.which, given)
    total = 0.0
    chosen: list[int] = []
    for step in range(steps):
        score = first
        if score is None or step > 0:
            score = score_each(curve, Q, response)
        score_offered = np.where(offered, score, -np.inf)
        best = int(np.argmax(score_offered))
        gain = float(score[best])
        adds_evidence = gain > 0 or given is not None
        if not np.isfinite(gain) or not adds_evidence:
            break
        Q, response = _absorb(curve, best, Q, response)
        offered[best] = False
        total += gain
        chosen.append(members[best])
    return total, chosen


def _absorb(curve: Curve, member: int, Q: Array, response: Array) -> tuple[Array, Array]:
    """Add one member's columns to the basis Q and remove them from the response."""
    identity = np.eye(len(curve.columns.slices[member]))
    X = curve.columns.sum_of(identity, member, len(response))
    Z = compute_basis(X - Q @ (Q.T @ X))
    return np.column_stack([Q, Z]), response - Z @ (Z.T @ response)


def find_better_curve(
    curve: Curve, Q: Array, response: Array, now: Sequence[int], odds: float
) -> list[int] | None:
    """Find candidates that explain a joint's curve better than `now` by `odds` in log evidence.

    They are a free function (and what it leaves), or a few waves; None where there are none.

    `response` (N,) has the effects `now` put back, and Q does not hold them."""
    first = score_each(curve, Q, response)
    present, _ = chain_effects(curve, Q, response, given=now, allowed=curve.free, first=first)
    waves = chain_effects(curve, Q, response, given=None, allowed=~curve.free, first=first)
    trials = [waves]
    free_functions = curve.which[curve.free]
    for g in free_functions.tolist():
        function_and_rest = chain_effects(
            curve, Q, response, given=[g], allowed=curve.free, first=first
        )
        trials.append(function_and_rest)
    value, best = max(trials, key=lambda trial: trial[0])
    is_better = value > present + odds
    is_same = set(best) == set(now)
    if best and is_better and not is_same:
        return best
    return None
