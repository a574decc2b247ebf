"""The evidence of every candidate for a residual, and what chance alone would give: Bayes factors, the exact null, p-values."""
from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..words.rigid import Array
from .errormap import Scan, Strength

RATIOS = np.logspace(0.5, 5.0, 8)   # v / s2, scanned


def log_bayes_factors(seen: Scan, strength: Strength, total: Array, ratio: float) -> Array:
    """(G, B) log Bayes factors of every candidate at v = ratio · s², s² integrated out (Jeffreys), against no effect;
    `total` (B,) residual sums of squares. A free function's directions have variances of their own, v times their weight. A
    single-term compliance of the wrong sign is discounted by its tail."""
    shrink = ratio / (1 + ratio)
    share = np.minimum(strength.whole / total, 1 - np.finfo(strength.whole.dtype).eps)
    shrunk, price = share * share.dtype.type(shrink), 0.5 * np.log1p(ratio) * seen.sizes
    for which, square, weights in strength.smooth:
        each = ratio * weights / (1 + ratio * weights)
        shrunk[which] = np.minimum(np.einsum("nkb,nk->nb", square, each.astype(square.dtype)) / total,
                                   1 - np.finfo(square.dtype).eps)
        price[which] = 0.5 * np.log1p(ratio * weights).sum(1)
    out = np.log1p(-shrunk)
    out *= share.dtype.type(-0.5 * seen.freedom)
    out -= price[:, None].astype(share.dtype)
    signed = np.flatnonzero(seen.columns.signs)
    if len(signed):
        from scipy.special import log_ndtr
        sigma = np.sqrt(total * (1 - share[signed] * shrink) / seen.freedom)
        out[signed] += np.log(2) + log_ndtr(seen.columns.signs[signed, None] * strength.root[signed] / sigma * np.sqrt(shrink))
    out[seen.sizes == 0] = -np.inf
    return np.asarray(out)


def evidence(seen: Scan, log_prior: Array, response: Array) -> tuple[float, Array]:
    """(log Σ prior BF at the ratio v/s² that maximises it, log prior + log BF (G,) there) of a response (N,); candidates that
    would have to be large to explain it have no part in it."""
    strength, log_prior = seen.strength(response[:, None]), np.where(seen.small(response), log_prior, -np.inf)
    total = np.square(response).sum(keepdims=True)
    best, posterior = -np.inf, np.full(len(log_prior), -np.inf)
    for r in RATIOS:
        joint = log_bayes_factors(seen, strength, total, float(r))[:, 0] + log_prior
        top = joint.max(initial=-np.inf)
        value = float(top + np.log(np.exp(joint - top).sum())) if np.isfinite(top) else -np.inf
        if value > best:
            best, posterior = value, joint
    return best, posterior


def best_factors(seen: Scan, response: Array) -> Array:
    """(G,) log Bayes factor of every candidate alone, each at the ratio v/s² that suits it best; −inf for one that would have
    to be large."""
    strength = seen.strength(response[:, None])
    total = np.square(response).sum(keepdims=True)
    best = np.max([log_bayes_factors(seen, strength, total, float(r))[:, 0] for r in RATIOS], axis=0)
    return np.asarray(np.where(seen.small(response), best, -np.inf))


def _null_evidence(seen: Scan, log_prior: Array, strength: Strength, total: Array) -> Array:
    """The same evidence (B,) of many responses, in their precision."""
    prior, best = log_prior.astype(total.dtype)[:, None], np.full(len(total), -np.inf)
    for r in RATIOS:
        joint = log_bayes_factors(seen, strength, total, float(r))
        joint += prior
        top = joint.max(0)
        joint -= top
        np.exp(joint, out=joint)
        best = np.maximum(best, top + np.log(joint.sum(0)))
    return best


def null(seen: Scan, log_prior: Array, draws: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """(draws,) sorted evidences, and sorted smallest p-values of single candidates, when nothing is left: the residual then
    lies evenly on the sphere of the model's residuals, whatever the parameters and the noise level (Dufour 2006). In single
    precision, which is ample where nothing stands out; every basis is made once, so that a draw costs one matrix product."""
    out, least = [], []
    rows = seen.columns.XT.shape[1]
    bases = [np.matmul(b.W, seen.columns.XT[b.block.index]).astype(np.float32) for b in seen.buckets]
    for part in _chunks(draws, max(1, int(4e6 / max(seen.columns.groups, 1)))):
        u = rng.standard_normal((rows, part))
        u = (u - seen.Q @ (seen.Q.T @ u)).astype(np.float32)
        strength = seen.gather([(Z.reshape(-1, rows) @ u).reshape(*Z.shape[:2], part) for Z in bases])
        total = np.square(u).sum(0)
        out.append(_null_evidence(seen, log_prior, strength, total))
        share = strength.whole / total
        best = {k: share[seen.sizes == k].max(0) for k in np.unique(seen.sizes) if k > 0}
        least.append(np.min([_tail(value, k, seen.freedom) for k, value in best.items()], axis=0) if best else np.ones(part))
    return np.sort(np.concatenate(out)), np.sort(np.concatenate(least))


def _tail(share: Array, size: Array | float, freedom: int) -> Array:
    """P(a candidate of `size` columns explains at least this share by chance): Beta(k/2, (ν−k)/2) (methods.md A.6)."""
    from scipy.special import betainc
    return np.asarray(betainc(np.maximum(freedom - size, 1e-9) / 2, np.maximum(size, 1e-9) / 2, 1 - np.minimum(share, 1.0)))


def familywise(seen: Scan, response: Array, least_p: Array) -> Array:
    """(G,) family-wise p of every candidate alone: the exact max-test over the whole map (methods.md A.6)."""
    share = seen.strength(response[:, None]).whole[:, 0] / float(response @ response)
    own = np.where(seen.sizes > 0, _tail(share, seen.sizes, seen.freedom), 1.0)
    return np.asarray((1 + np.searchsorted(least_p, own, side="right")) / (len(least_p) + 1))


def _chunks(total: int, size: int) -> Iterator[int]:
    while total > 0:
        yield min(size, total)
        total -= size


def p_value(observed: float, sorted_null: Array) -> float:
    """(1 + #{null ≥ observed}) / (B + 1); 1 where there is no evidence at all."""
    if not np.isfinite(observed):
        return 1.0
    return float((1 + len(sorted_null) - np.searchsorted(sorted_null, observed, side="left")) / (len(sorted_null) + 1))


