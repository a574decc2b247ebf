"""Joint curves: whether a joint's own-angle error is one curve or a sum of waves.

A kink or a soft step of one joint resembles a gear's eccentricity at first, then an encoder's, then
a scale error: each is significant, and none is the cause. So the effects that act through one
joint's own angle are weighed together against a free function of that angle, and a free function
against a few waves; whichever the data make more probable stands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .._typing import Array, Index, Mask
from ..fitting.splines import spline
from .candidate_columns import Block, Columns, find_signed
from .candidates import Candidate
from .evidence import compute_factors
from .scan import Beyond, Bucket, Response, Scan, build_buckets

# effects (waves and the like) that one curve may be made of
MAX_EFFECTS_PER_CURVE = 4
# share of a column's square, or of a direction's of unit columns, below which it is rounding
ROUNDING = 1e-11


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
    them; `index` (c,): their columns among all; `slices`: each candidate's own among those; `gram`
    (c, c): products of the columns; `blocks`: the candidates by their number of columns."""

    which: Index
    log_prior: Array
    free: Mask
    index: Index
    slices: tuple[Index, ...]
    gram: Array
    blocks: tuple[Block, ...]
    signs: tuple[Array, ...]
    signed: Index


@dataclass(frozen=True, eq=False)
class _Rest:
    """What a curve's columns have in common beyond a model.

    `left` (c, c): their Gram matrix there, `products` (c,) with a response, `square` of the
    response; `freedom`: coordinates beyond the model."""

    curve: Curve
    left: Array
    products: Array
    square: float
    freedom: int

    @cached_property
    def buckets(self) -> tuple[tuple[Bucket, ...], Array]:
        """The candidates beyond the model, and the number of directions of each."""
        lefts = [self.left[b.index[:, :, None], b.index[:, None]] for b in self.curve.blocks]
        return build_buckets(self.curve.blocks, lefts)

    @cached_property
    def score(self) -> Array:
        """Log prior + log Bayes factor (k,) of every candidate alone."""
        buckets, sizes = self.buckets
        seen = Beyond(self.curve.signs, self.curve.signed, buckets, sizes, self.freedom)
        factors = compute_factors(seen, Response(self.products, self.square))
        return np.asarray(self.curve.log_prior + factors.max(0))

    def absorb(self, member: int) -> _Rest:
        """Add one candidate to the model: what is beyond both."""
        own = self.curve.slices[member]
        W = _whiten_all(self.left[np.ix_(own, own)], np.diag(self.curve.gram)[own])
        shared = self.left[:, own] @ W.T
        explained = W @ self.products[own]
        left_over = self.square - float(explained @ explained)
        return _Rest(
            curve=self.curve,
            left=self.left - shared @ shared.T,
            products=self.products - shared @ explained,
            square=max(left_over, ROUNDING * self.square),
            freedom=self.freedom - len(W),
        )


def _whiten_all(left: Array, norms: Array) -> Array:
    """Compute W (r, k) with orthonormal Z = X Wᵀ that spans all that the columns are beyond a model.

    `left` (k, k): their Gram matrix there; `norms` (k,): their squared norms."""
    own = np.diag(left)
    is_left = own > ROUNDING * norms
    scale = np.where(is_left, 1 / np.sqrt(np.where(is_left, own, 1)), 0)
    value, vector = np.linalg.eigh(left * scale * scale[:, None])
    solid = value > ROUNDING
    return np.asarray((vector[:, solid] / np.sqrt(value[solid])).T * scale)


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
        curves[joint] = _build_curve(cols, which, log_prior[which], np.array(is_free))
    return curves


def _build_curve(cols: Columns, which: Index, log_prior: Array, free: Mask) -> Curve:
    index = np.unique(np.concatenate([cols.slices[g] for g in which]))
    blocks = []
    for block in cols.grams:
        inside = np.flatnonzero(np.isin(block.which, which))
        if len(inside):
            blocks.append(
                Block(
                    which=np.searchsorted(which, block.which[inside]),
                    index=np.searchsorted(index, block.index[inside]),
                    gram=block.gram[inside],
                    most=block.most[inside],
                    root=None if block.root is None else block.root[inside],
                )
            )
    signs = tuple(cols.signs[g] for g in which)
    return Curve(
        which=which,
        log_prior=log_prior,
        free=free,
        index=index,
        slices=tuple(np.searchsorted(index, cols.slices[g]) for g in which),
        gram=cols.screws.gram(index),
        blocks=tuple(blocks),
        signs=signs,
        signed=find_signed(signs),
    )


def see_rest(curve: Curve, scan: Scan, returned: Array, response: Response) -> _Rest:
    """See a curve's columns beyond a model of which directions `returned` (r, d) were given back.

    `response`: the residual with them put back."""
    inside = scan.inside[curve.index]
    back = inside @ returned
    left = curve.gram - inside @ inside.T + back @ back.T
    return _Rest(curve, left, response.products[curve.index], response.square, scan.freedom)


def chain_effects(
    start: _Rest, given: Sequence[int] | None, allowed: Mask
) -> tuple[float, list[int]]:
    """Sum up effects one after the other, each beyond those before: (log evidence, candidates).

    The effects are the `given` candidates, or else the most probable among the `allowed` (k,), as
    long as one adds evidence."""
    curve = start.curve
    members = curve.which.tolist()
    steps = MAX_EFFECTS_PER_CURVE
    offered = allowed.copy()
    if given is not None:
        steps = len(given)
        offered = np.isin(curve.which, given)
    total = 0.0
    chosen: list[int] = []
    rest = start
    for _ in range(steps):
        score_offered = np.where(offered, rest.score, -np.inf)
        best = int(np.argmax(score_offered))
        gain = float(rest.score[best])
        adds_evidence = gain > 0 or given is not None
        if not np.isfinite(gain) or not adds_evidence:
            break
        rest = rest.absorb(best)
        offered[best] = False
        total += gain
        chosen.append(members[best])
    return total, chosen


def find_better_curve(start: _Rest, now: Sequence[int], odds: float) -> list[int] | None:
    """Find candidates that explain a joint's curve better than `now` by `odds` in log evidence.

    They are a free function (and what it leaves), or a few waves; None where there are none.

    `start` has the effects `now` put back."""
    curve = start.curve
    present, _ = chain_effects(start, given=now, allowed=curve.free)
    waves = chain_effects(start, given=None, allowed=~curve.free)
    trials = [waves]
    free_functions = curve.which[curve.free]
    for g in free_functions.tolist():
        function_and_rest = chain_effects(start, given=[g], allowed=curve.free)
        trials.append(function_and_rest)
    value, best = max(trials, key=lambda trial: trial[0])
    is_better = value > present + odds
    is_same = set(best) == set(now)
    if best and is_better and not is_same:
        return best
    return None
