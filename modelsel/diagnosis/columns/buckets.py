"""Buckets: candidates of one number of columns, each with its own directions beyond a model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..._linalg import TINY, invert_factors
from ..._typing import Array, Mask
from .candidate_columns import Block

# share of a direction's squared norm that must be left beyond the model for it to count; rounding
# adds up in candidates of many columns, which need ten times as much
ABSORBED = 1e-5
FEW_COLUMNS = 4
# prior variance of a smooth function's direction, relative to its largest: from which it counts at
# all, and from which it shows in the function's size
FAINT_WEIGHT = 1e-7
SOLID_WEIGHT = 1e-3
# columns up to which many small matrices are factored at once, number by number
MAX_UNROLLED = 6


@dataclass(frozen=True, eq=False)
class Bucket:
    """A block of candidates beyond the model.

    `left` (n, k, k): their Gram matrices there; W (n, k, k) with Z_gᵀr = W X_gᵀr, Z_g orthonormal.

    `weights` (n, k): prior variances of a free function's directions, the largest 1; None where all
    directions are alike."""

    block: Block
    left: Array
    W: Array
    weights: Array | None


def build_buckets(
    blocks: Sequence[Block], lefts: Sequence[Array], count: int, aside: Mask | None = None
) -> tuple[tuple[Bucket, ...], Array]:
    """Build the buckets of blocks of candidates from their Gram matrices beyond a model.

    Returns them, and the number (G,) of directions there of every candidate, of which there are
    `count`: 0 for one of no block, or set `aside`."""
    buckets = []
    sizes = np.zeros(count)
    pairs = zip(blocks, lefts, strict=True)
    for block, left in pairs:
        if aside is None or not aside[block.which].any():
            bucket, size = build_bucket(block, left)
        else:
            is_asked = ~aside[block.which]
            part, some = build_bucket(block.take(is_asked), left[is_asked])
            bucket, size = _spread(part, some, block, left, is_asked)
        sizes[block.which] = size
        buckets.append(bucket)
    return tuple(buckets), sizes


def build_bucket(block: Block, left: Array) -> tuple[Bucket, Array]:
    """Build the bucket of a block, and the number (n,) of every candidate's directions."""
    W, size = _whiten(block, left)
    weights = None
    root = block.root
    if root is not None:
        W, weights = _separate_by_prior(W, left, root)
    bucket = Bucket(block, left, W, weights)
    return bucket, size


def _spread(
    part: Bucket, sizes: Array, block: Block, left: Array, is_asked: Mask
) -> tuple[Bucket, Array]:
    """Spread the bucket of some candidates of a block over all; the others have no directions."""
    W = np.zeros_like(left)
    W[is_asked] = part.W
    size = np.zeros(len(left))
    size[is_asked] = sizes
    weights = part.weights
    if weights is not None:
        weights = np.zeros(left.shape[:2])
        weights[is_asked] = part.weights
    return Bucket(block, left, W, weights), size


def _whiten(block: Block, left: Array) -> tuple[Array, Array]:
    """Compute W (n, k, k) with orthonormal Z = X Wᵀ beyond the model.

    `left`: the Gram matrices there. Returns also the number (n,) of directions that are left; the
    rows of the others are zero.

    Of few columns that surely are all left W is the inverse of a Cholesky factor L: the smallest
    eigenvalue is at least 1 / trace((L Lᵀ)⁻¹)."""
    unit = block.unit
    scaled = left * unit[:, :, None] * unit[:, None, :]
    n, k = unit.shape
    least = find_least_share(k)
    W, size = np.empty_like(scaled), np.full(n, k)
    is_open = np.ones(n, bool)
    if k <= MAX_UNROLLED:
        W = invert_factors(scaled)
        trace = np.einsum("nkl,nkl->n", W, W)
        is_open = ~(trace * least < 1)
    if is_open.any():
        value, vector = np.linalg.eigh(scaled[is_open])
        is_left = value > least
        scale = np.where(is_left, 1 / np.sqrt(np.where(is_left, value, 1)), 0)
        W[is_open] = scale[:, :, None] * vector.swapaxes(1, 2)
        size[is_open] = is_left.sum(1)
    W *= unit[:, None, :]
    return W, size


def find_least_share(columns: int) -> float:
    """Find the share of a direction that must be left, of a candidate of so many columns."""
    if columns <= FEW_COLUMNS:
        return ABSORBED
    return 10 * ABSORBED


def _separate_by_prior(W: Array, left: Array, root: Array) -> tuple[Array, Array]:
    """Rotate Z to the directions that a smooth function's prior and these data keep apart.

    Returns W, and the prior variances (n, k) of the directions, the largest 1."""
    half = np.matmul(W, np.matmul(left, root))  # (Zᵀ X) L
    value, vector = np.linalg.eigh(np.matmul(half, half.swapaxes(1, 2)))
    top = np.maximum(value.max(1, keepdims=True), TINY)
    weights = np.where(value > FAINT_WEIGHT * top, value / top, 0.0)
    return np.matmul(vector.swapaxes(1, 2), W), weights
