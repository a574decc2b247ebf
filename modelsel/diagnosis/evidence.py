"""The evidence of every candidate for a residual, and what chance alone would give: Bayes factors,
the exact null, p-values."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from .._typing import Array, Index
from .scan import CACHED, Bucket, Scan, Strength, pieces

RATIOS = np.logspace(0.5, 5.0, 8)  # v / s2, scanned
SLACK = 1e-3  # in log evidence: far beyond single precision's rounding
PIECE = (
    256  # draws that are worked out together: a product of full speed, in memory that is used again
)
MAX_SELECTED_SHARE = (
    0.7  # share of the draws beyond which all of them are worked out: picking some costs, too
)


def normalise_strength(strength: Strength, total: Array) -> Strength:
    """The same of responses of unit length, from their sums of squares `total` (B,); the whole is
    overwritten."""
    whole = np.divide(strength.whole, total, out=strength.whole)
    np.minimum(whole, 1 - np.finfo(whole.dtype).eps, out=whole)
    return Strength(whole, strength.root / np.sqrt(total), strength.smooth / total)


def _prices(seen: Scan, ratio: float) -> tuple[Array, Array]:
    """(what every candidate's freedom costs (G,), how much of every direction of a free function
    counts (F, K))."""
    (which, weights), price = seen.smooth, 0.5 * np.log1p(ratio) * seen.sizes
    price[which] = 0.5 * np.log1p(ratio * weights).sum(1)
    return price, ratio * weights / (1 + ratio * weights)


def _smooth_share(share: Strength, each: Array) -> Array:
    """(F, B) what free functions, their directions weighed, explain."""
    kind = share.smooth.dtype
    return np.asarray(
        np.minimum(
            np.matmul(each.astype(kind)[:, None], share.smooth)[:, 0], 1 - np.finfo(kind).eps
        )
    )


def compute_log_bayes_factors(
    seen: Scan, share: Strength, ratio: float, out: Array | None = None
) -> Array:
    """(G, B) log Bayes factors of every candidate at v = ratio · s², s² integrated out (Jeffreys),
    against no effect, from the `shares`. A free function's directions have variances of their own,
    v times their weight.

    Terms with a sign have half of their prior: the half is likelier by 2, and what the data leave
    of it is the tail of the posterior, a Student t of as many degrees of freedom as the residual,
    P(t_ν < z): BF = BF of either sign · 2 P. With t² = ν (exp(2 log BF / ν) − 1) before its price,
    Wallace's normal z = (8ν+1)/(8ν+3) √(ν log(1 + t²/ν)) (1959) stays finite however strong the
    evidence. Of several terms, it is the one that is least of its sign; exact where it alone has
    one."""
    kind, shrink, signed = share.whole.dtype.type, ratio / (1 + ratio), seen.signed
    price, each = _prices(seen, ratio)
    out = np.multiply(share.whole, kind(-shrink), out=out)
    if len(each):
        out[seen.smooth[0]] = -_smooth_share(share, each)
    np.log1p(out, out=out)
    out *= kind(-0.5 * seen.freedom)
    out -= np.where(seen.sizes > 0, price, np.inf)[:, None].astype(kind)
    if len(signed):
        from scipy.special import log_ndtr

        whole, nu = np.maximum(share.whole[signed], np.finfo(kind).tiny), seen.freedom
        normal = np.sqrt(-nu * np.log1p(-shrink * whole) / whole) * ((8 * nu + 1) / (8 * nu + 3))
        out[signed] += kind(np.log(2)) + log_ndtr((normal * share.root).astype(kind))
    return out


def compute_factors(seen: Scan, response: Array) -> Array:
    """(RATIOS, G) log Bayes factors of every candidate alone; −inf for one that would have to be
    large to explain a response (N,)."""
    strength, small = seen.judged(response)
    share = normalise_strength(strength, np.square(response).sum(keepdims=True))
    return np.where(
        small, [compute_log_bayes_factors(seen, share, float(r))[:, 0] for r in RATIOS], -np.inf
    )


def sum_evidence(known: Array, log_prior: Array) -> tuple[float, Array]:
    """(log Σ prior BF at the ratio v/s² that maximises it, log prior + log BF (G,) there) from the
    `factors`."""
    joint = known + log_prior
    top = joint.max(1)
    if not np.isfinite(top).all():
        return -np.inf, np.full(len(log_prior), -np.inf)
    values = top + np.log(np.exp(joint - top[:, None]).sum(1))
    best = int(np.argmax(values))
    return float(values[best]), joint[best]


def compute_null_evidence(
    seen: Scan, log_prior: Array, share: Strength, top: Mapping[float, Array]
) -> Array:
    """The same evidence (B,) of many responses, in their precision; `top`: largest share (B,) among
    the candidates of each size.

    From one ratio to the next no candidate's Bayes factor grows by more than that of the largest
    share of its size (`lift`), and so neither does their sum: where that cannot reach the best, the
    ratio is not worked out."""
    if not top:  # the model has all that could be a cause
        return np.full(share.whole.shape[1], -np.inf)
    prior, space = log_prior.astype(share.whole.dtype)[:, None], np.empty_like(share.whole)

    def total(some: Strength, ratio: float) -> Array:
        joint = compute_log_bayes_factors(seen, some, ratio, space[:, : some.whole.shape[1]])
        joint += prior
        most = joint.max(0)
        joint -= most
        return np.asarray(most + np.log(np.exp(joint, out=joint).sum(0)), float)

    def grown(ratio: float) -> Array:
        price, each = _prices(seen, ratio)
        costs = [
            *(0.5 * k * np.log1p(ratio) for k in top),
            *price[seen.signed],
            *price[seen.smooth[0]],
        ]
        alone = np.concatenate([alike * (ratio / (1 + ratio)), _smooth_share(share, each)])
        return np.asarray(-0.5 * seen.freedom * np.log1p(-alone) - np.array(costs)[:, None])

    alike = np.concatenate([np.array(list(top.values())), share.whole[seen.signed]])
    slack = np.full((len(alike) + len(share.smooth), 1), SLACK)
    slack[len(top) : len(alike)] += np.log(2)  # what the tail of a sign may grow by
    first = total(share, float(RATIOS[0]))
    best = first.copy()
    slack = slack - grown(float(RATIOS[0]))
    for r in map(float, RATIOS[1:]):
        need = np.flatnonzero((grown(r) + slack).max(0) > best - first)
        if len(need) > MAX_SELECTED_SHARE * len(best):
            best = np.maximum(best, total(share, r))
        elif len(need):
            best[need] = np.maximum(
                best[need], total(Strength(*(part[..., need] for part in share)), r)
            )
    return best


def draw_null(
    seen: Scan, log_prior: Array, draws: int, rng: np.random.Generator
) -> tuple[Array, Array]:
    """(draws,) sorted evidences, and sorted smallest p-values of single candidates, when nothing is
    left: the residual then lies evenly on the sphere of the model's residuals, whatever the
    parameters and the noise level (Dufour 2006). In single precision, which is ample where nothing
    stands out; every basis is made once, so that a draw costs one matrix product."""
    out, least = [], []
    rows = seen.columns.XT.shape[1]
    bases = [_bases(b, seen.columns.XT) for b in seen.buckets]
    alike = by_size(seen)
    if not alike:
        return np.full(draws, np.nan), np.ones(draws)
    for drawn in pieces(draws, int(4e6 / max(seen.columns.groups, 1))):
        u = rng.standard_normal((rows, drawn.stop - drawn.start))
        u = (u - seen.Q @ (seen.Q.T @ u)).astype(np.float32)
        for some in pieces(u.shape[1], PIECE):
            part = np.ascontiguousarray(u[:, some])
            products = [
                (Z @ part).reshape(*b.block.index.shape, -1)
                for Z, b in zip(bases, seen.buckets, strict=True)
            ]
            share = normalise_strength(seen.gather(products), np.square(part).sum(0))
            top = {k: share.whole[which].max(0) for k, which in alike.items()}
            out.append(compute_null_evidence(seen, log_prior, share, top))
            least.append(compute_smallest_p(top, seen.freedom))
    return np.sort(np.concatenate(out)), np.sort(np.concatenate(least))


def _bases(bucket: Bucket, XT: Array) -> Array:
    """(n · k, N) orthonormal columns of a bucket's candidates, in single precision."""
    index = bucket.block.index
    out = np.empty((*index.shape, XT.shape[1]), np.float32)
    for some in pieces(len(index), CACHED // (index.shape[1] * XT.shape[1])):
        out[some] = np.matmul(bucket.W[some], XT[index[some]])
    return out.reshape(-1, XT.shape[1])


def by_size(seen: Scan) -> dict[float, Index | slice]:
    """The candidates of every size, of at least one direction."""
    return {float(k): _run(np.flatnonzero(seen.sizes == k)) for k in np.unique(seen.sizes) if k > 0}


def _run(index: Index) -> Index | slice:
    """The same as a slice where it is one: nothing is copied then."""
    return (
        slice(int(index[0]), int(index[-1]) + 1)
        if len(index) == index[-1] + 1 - index[0]
        else index
    )


def compute_smallest_p(top: Mapping[float, Array], freedom: int) -> Array:
    """(B,) smallest p of single candidates, from the largest share (B,) among those of each size; 1
    where there is none."""
    return (
        np.ones(1)
        if not top
        else np.asarray(np.min([_tail(value, k, freedom) for k, value in top.items()], axis=0))
    )


def _tail(share: Array, size: Array | float, freedom: int) -> Array:
    """P(a candidate of `size` columns explains at least this share by chance): Beta(k/2, (ν−k)/2)
    (methods.md A.6)."""
    from scipy.special import betainc

    return np.asarray(
        betainc(
            np.maximum(freedom - size, 1e-9) / 2,
            np.maximum(size, 1e-9) / 2,
            1 - np.minimum(share, 1.0),
        )
    )


def compute_familywise_p(seen: Scan, response: Array, least: Array) -> Array:
    """(G,) family-wise p of every candidate alone: the max-test over the whole map (methods.md
    A.6), whose null is the sorted smallest p-values `least`."""
    share = seen.strength(response[:, None]).whole[:, 0] / float(response @ response)
    own = np.where(seen.sizes > 0, _tail(share, seen.sizes, seen.freedom), 1.0)
    return np.asarray((1 + np.searchsorted(least, own, side="right")) / (len(least) + 1))


def compute_single_f(seen: Scan, response: Array) -> Array:
    """(G,) F statistic of every candidate alone beyond the model; 0 for one that adds nothing,
    finite where one explains all."""
    strength, whole = seen.strength(response[:, None]).whole[:, 0], float(response @ response)
    rest = np.maximum(whole - strength, max(np.finfo(float).eps * whole, 1e-300))
    k = seen.sizes
    room = (k > 0) & (seen.freedom > k)
    return np.where(room, strength / np.maximum(k, 1) / rest * np.maximum(seen.freedom - k, 1), 0.0)


def compute_p_value(observed: float, sorted_null: Array) -> float:
    """(1 + #{null ≥ observed}) / (B + 1); 1 where there is no evidence at all."""
    if not np.isfinite(observed):
        return 1.0
    return float(
        (1 + len(sorted_null) - np.searchsorted(sorted_null, observed, side="left"))
        / (len(sorted_null) + 1)
    )
