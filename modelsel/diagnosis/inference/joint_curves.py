"""Joint curves: whether a joint's own-angle error is one curve or a sum of waves.

A kink or a soft step of one joint resembles a gear's eccentricity at first, then an encoder's, then
a scale error: each is significant, and none is the cause. So the effects that act through one
joint's own angle are weighed together against a free function of that angle, and a free function
against a few waves; whichever the data make more probable stands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ..._typing import Array, Index, Mask
from ...fitting.splines import spline
from ..candidates.candidate import Candidate
from ..columns.buckets import build_buckets
from ..columns.candidate_columns import Block, Columns, find_signed
from ..columns.screw_columns import ScrewColumns
from ..shapes.candidate_kinds import CandidateKind
from .evidence import compute_factors
from .scan import Beyond, Released, Response, Scan

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
    them, `chained` (k,) those of which a few together may stand for a curve; `index` (c,): their columns among all `columns`; `slices`: each candidate's own among
    those; `blocks`: the candidates by their number of columns; `homes`: where the candidates of each
    block are among all candidates' blocks, (block, rows)."""

    columns: ScrewColumns
    which: Index
    log_prior: Array
    free: Mask
    chained: Mask
    index: Index
    slices: tuple[Index, ...]
    blocks: tuple[Block, ...]
    homes: tuple[tuple[int, Index], ...]
    signs: tuple[Array, ...]
    signed: Index

    _known: dict[int, Array] = field(default_factory=dict, repr=False)

    def multiply(self, member: int) -> Array:
        """Compute the products (c, k) of all columns with those of one candidate."""
        if member not in self._known:
            own = self.index[self.slices[member]]
            self._known[member] = self._compute_products(own)
        return self._known[member]

    def _compute_products(self, own: Index) -> Array:
        """Compute the products (c, k) of all columns with some; at one place, of their causes."""
        columns = self.columns
        fields = columns.lone_field[self.index]
        first = fields[0]
        at_one_place = (fields == first).all()
        if first >= 0 and at_one_place:
            return columns.multiply(self.index, own)
        vectors = columns.expand(own)
        products = columns.dot(vectors.T)
        return products[self.index]


@dataclass(frozen=True, eq=False)
class Rest:
    """What candidates of a curve are beyond a model.

    `blocks`: the candidates that are offered, `lefts`: their Gram matrices there. Products of all
    columns beyond the model are those of the curve less those along `inside` (c, r) and `absorbed`
    (c, a), plus those along `back` (c, d). `products` (c,): with a response whose sum of squares is
    `square`; `freedom`: coordinates beyond the model."""

    curve: Curve
    blocks: tuple[Block, ...]
    lefts: tuple[Array, ...]
    inside: Array
    back: Array
    absorbed: Array
    products: Array
    square: float
    freedom: int

    @cached_property
    def factors(self) -> Array:
        """Log Bayes factors (ratios, k) of every candidate alone, -inf where it is not offered."""
        curve = self.curve
        buckets, sizes = build_buckets(self.blocks, self.lefts, len(curve.which))
        seen = Beyond(curve.signs, curve.signed, buckets, sizes, self.freedom)
        return compute_factors(seen, Response(self.products, self.square))

    @cached_property
    def score(self) -> Array:
        """Log prior + log Bayes factor (k,) of every candidate alone, -inf where it is not offered."""
        return np.asarray(self.curve.log_prior + self.factors.max(0))

    def offer(self, members: Mask) -> Rest:
        """Offer those of the candidates that are among the members (k,)."""
        blocks, lefts = [], []
        for block, left in zip(self.blocks, self.lefts, strict=True):
            kept = members[block.which]
            if kept.any():
                blocks.append(block.take(kept))
                lefts.append(left[kept])
        return replace(self, blocks=tuple(blocks), lefts=tuple(lefts))

    def absorb(self, member: int) -> Rest:
        """Add one candidate to the model, and offer it no more."""
        own = self.curve.slices[member]
        products = self.curve.multiply(member)
        left = products - self.inside @ self.inside[own].T
        left -= self.absorbed @ self.absorbed[own].T
        left += self.back @ self.back[own].T
        W = _whiten_all(left[own], np.diag(products[own]))
        shared = left @ W.T
        explained = W @ self.products[own]
        left_over = self.square - float(explained @ explained)
        rest = self.offer(np.arange(len(self.curve.which)) != member)
        lefts = []
        for block, before in zip(rest.blocks, rest.lefts, strict=True):
            part = shared[block.index]
            lefts.append(before - np.matmul(part, part.swapaxes(1, 2)))
        return replace(
            rest,
            lefts=tuple(lefts),
            absorbed=np.column_stack([self.absorbed, shared]),
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
        # bumps side by side take any shape, as a free function does, without its price
        is_bump = np.array([found[g].kind is CandidateKind.BUMP for g in indices])
        free = np.array(is_free)
        curves[joint] = build_curve(cols, which, log_prior[which], free, ~free & ~is_bump)
    return curves


def build_curve(cols: Columns, which: Index, log_prior: Array, free: Mask, chained: Mask) -> Curve:
    """Build what candidates `which` (k,) have in common, to weigh them together; `free` (k,) marks
    the free functions among them, `chained` (k,) what may stand for a curve a few together."""
    columns = [cols.slices[g] for g in which]
    index = np.unique(np.concatenate(columns))
    blocks, homes = [], []
    for number, block in enumerate(cols.grams):
        is_inside = np.isin(block.which, which)
        inside = np.flatnonzero(is_inside)
        if len(inside):
            own = block.take(inside)
            candidates = np.searchsorted(which, own.which)
            own_columns = np.searchsorted(index, own.index)
            renumbered = replace(own, which=candidates, index=own_columns)
            blocks.append(renumbered)
            homes.append((number, inside))
    signs = tuple(cols.signs[g] for g in which)
    return Curve(
        columns=cols.screws,
        which=which,
        log_prior=log_prior,
        free=free,
        chained=chained,
        index=index,
        slices=tuple(np.searchsorted(index, own) for own in columns),
        blocks=tuple(blocks),
        homes=tuple(homes),
        signs=signs,
        signed=find_signed(signs),
    )


def see_rest(curve: Curve, scan: Scan, response: Response, released: Released) -> Rest:
    """See a curve's candidates beyond a model of which something was released.

    `response`: the residual of the whole model."""
    inside = scan.inside[curve.index]
    back = inside @ released.directions
    lefts = []
    for block, (number, rows) in zip(curve.blocks, curve.homes, strict=True):
        own = back[block.index]
        lefts.append(scan.buckets[number].left[rows] + np.matmul(own, own.swapaxes(1, 2)))
    own_response = Response(response.products[curve.index], response.square)
    products, square = released.see(own_response, back)
    return Rest(
        curve=curve,
        blocks=curve.blocks,
        lefts=tuple(lefts),
        inside=inside,
        back=back,
        absorbed=np.zeros((len(inside), 0)),
        products=products,
        square=square,
        freedom=scan.freedom,
    )


def chain_effects(start: Rest, steps: int, at_any_cost: bool = False) -> tuple[float, list[int]]:
    """Sum up effects one after the other, each beyond those before: (log evidence, candidates).

    The effects are the most probable of those that are offered, at most so many steps, as long as
    one adds evidence, or `at_any_cost`."""
    members = start.curve.which.tolist()
    total = 0.0
    chosen: list[int] = []
    rest, best = start, -1
    for step in range(steps):
        if step:
            rest = rest.absorb(best)
        best = int(np.argmax(rest.score))
        gain = float(rest.score[best])
        if not np.isfinite(gain) or not (gain > 0 or at_any_cost):
            break
        total += gain
        chosen.append(members[best])
    return total, chosen


def find_better_curve(start: Rest, now: Sequence[int], odds: float) -> list[int] | None:
    """Find candidates that explain a joint's curve better than `now` by `odds` in log evidence.

    They are a free function (and what it leaves), or a few waves; None where there are none.

    `start` has the effects `now` put back."""
    curve = start.curve
    present, _ = chain_effects(start.offer(np.isin(curve.which, now)), len(now), at_any_cost=True)
    functions = start.offer(curve.free).score
    trials = [chain_effects(start.offer(curve.chained), MAX_EFFECTS_PER_CURVE)]
    for place in np.flatnonzero(curve.free):
        value = functions[place]
        trials.append((value, [int(curve.which[place])]) if np.isfinite(value) else (0.0, []))
    value, best = max(trials, key=lambda trial: trial[0])
    is_better = value > present + odds
    is_same = set(best) == set(now)
    if best and is_better and not is_same:
        return best
    return None
