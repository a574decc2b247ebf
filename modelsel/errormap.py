"""The scan: how much of a residual every candidate explains beyond the fitted model, and what chance alone would explain.

With Q an orthonormal basis of the fitted model and X_g a candidate's columns, everything needed is X_gᵀX_g, X_gᵀQ and
X_gᵀr: the projected Gram is X_gᵀX_g − (X_gᵀQ)(X_gᵀQ)ᵀ, and no projected column is ever stored.
"""
from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from .candidates import Candidate
from .design import blocks
from .measurements import Index
from .rigid import Array
from .scene import Scene
from .screws import Term

ABSORBED = 1e-5     # share of a direction's squared norm that must be left beyond the model for it to count
RATIOS = np.logspace(0.5, 5.0, 8)   # v / s2, scanned


@dataclass(frozen=True, eq=False)
class Bucket:
    """Candidates of one size k: `which` (n,), their columns `index` (n, k), their Gram `left` (n, k, k) beyond the model,
    and W (n, k, k) with Z_gᵀr = W X_gᵀr."""

    which: Index
    index: Index
    left: Array
    W: Array


@dataclass(frozen=True, eq=False)
class Columns:
    """All candidates' whitened columns, transposed (C, N), where each candidate's stand, and their Gram blocks."""

    XT: Array
    slices: tuple[Index, ...]
    grams: dict[int, tuple[Index, Index, Array]]     # size -> (which, index, (n, k, k))
    signs: Array

    @property
    def groups(self) -> int:
        """Number of candidates."""
        return len(self.slices)


def columns(scene: Scene, found: Sequence[Candidate], at: tuple[Sequence[Term], Array] | None = None) -> Columns:
    """Columns of every candidate, each screw's evaluated once. Rows are ordered block, component, configuration."""
    terms: dict[tuple[object, ...], Term] = {}
    for candidate in found:
        for t in candidate.mechanism.terms:
            terms.setdefault(t.screws, t)
    place = {screws: k for k, screws in enumerate(terms)}
    slices = [np.array([place[t.screws] for t in c.mechanism.terms], dtype=np.intp) for c in found]
    parts = [c.reshape(len(c), r.size) for _, c, r in blocks(scene, tuple(terms.values()), at)]
    XT = parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)
    grams = {}
    for size in sorted({len(s) for s in slices}):
        which = np.array([g for g, s in enumerate(slices) if len(s) == size], dtype=np.intp)
        index = np.stack([slices[g] for g in which])
        gram = np.stack([XT[i] @ XT[i].T for i in index]) if size > 4 else np.einsum("nkr,nlr->nkl", XT[index], XT[index])
        grams[size] = (which, index, gram)
    signs = np.array([c.mechanism.terms[0].sign if len(c.mechanism.terms) == 1 else 0 for c in found], dtype=float)
    return Columns(XT, tuple(slices), grams, signs)


def subset(cols: Columns, which: Index) -> Columns:
    """The columns of some candidates alone, in the order of `which`."""
    used, place = np.unique(np.concatenate([cols.slices[g] for g in which]), return_inverse=True)
    bounds = np.cumsum([0, *(len(cols.slices[g]) for g in which)])
    position = {int(g): k for k, g in enumerate(which)}
    grams = {}
    for size, (members, _, gram) in cols.grams.items():
        inside = np.flatnonzero(np.isin(members, which))
        if len(inside):
            own = np.array([position[int(g)] for g in members[inside]], dtype=np.intp)
            grams[size] = (own, np.stack([place[bounds[k]:bounds[k + 1]] for k in own]), gram[inside])
    slices = tuple(place[a:b] for a, b in pairwise(bounds))
    return Columns(cols.XT[used], slices, grams, cols.signs[which])


def stacked(scene: Scene, terms: Sequence[Term], at: tuple[Sequence[Term], Array] | None) -> tuple[Array, Array]:
    """(columns (N, p), residual (N,)) whitened, in the row order of `columns`."""
    parts = [(c.reshape(len(c), r.size), r.reshape(-1)) for _, c, r in blocks(scene, terms, at)]
    return np.concatenate([c for c, _ in parts], axis=1).T, np.concatenate([r for _, r in parts])


def basis(matrix: Array) -> Array:
    """Orthonormal basis (N, r) of the columns of (N, p), rank by pivoted QR on unit columns."""
    from scipy.linalg import qr
    size = np.linalg.norm(matrix, axis=0)
    unit = matrix[:, size > 1e-13 * size.max(initial=0)] / size[size > 1e-13 * size.max(initial=0)]
    if not unit.shape[1]:
        return np.zeros((len(matrix), 0))
    Q, R, _ = qr(unit, mode="economic", pivoting=True)
    return np.asarray(Q[:, :int((np.abs(np.diag(R)) > 1e-10).sum())])


@dataclass(frozen=True, eq=False)
class Scan:
    """The candidates seen from one fitted model: Z_g bases, effective sizes k (G,), `freedom` N − r; Q (N, ·) spans the model
    (its columns need not be orthonormal after directions were given back: Q Qᵀ still projects)."""

    columns: Columns
    Q: Array
    buckets: tuple[Bucket, ...]
    sizes: Array
    freedom: int

    def strength(self, response: Array) -> tuple[Array, Array]:
        """(|Z_gᵀ r|² (G, B), signed root of single columns (G, B), nought elsewhere) of responses (N, B)."""
        s = self.columns.XT @ response
        out, root = np.zeros((len(self.sizes), s.shape[1])), np.zeros((len(self.sizes), s.shape[1]))
        for bucket in self.buckets:
            z = np.matmul(bucket.W, s[bucket.index])
            out[bucket.which] = np.square(z).sum(1)
            if bucket.W.shape[1] == 1:
                root[bucket.which] = z[:, 0]
        return out, root


def scan(cols: Columns, Q: Array) -> Scan:
    """Project every candidate off the model's basis Q (N, r)."""
    A = cols.XT @ Q
    lefts = [gram - np.matmul(A[index], A[index].swapaxes(1, 2)) for _, index, gram in cols.grams.values()]
    return _scan(cols, Q, lefts)


def scan_without(seen: Scan, D: Array) -> Scan:
    """The scan from a smaller model, whose basis lacks the directions D (N, d) of `seen.Q`'s span: they are given back."""
    A = seen.columns.XT @ D
    lefts = [bucket.left + np.matmul(A[bucket.index], A[bucket.index].swapaxes(1, 2)) for bucket in seen.buckets]
    return _scan(seen.columns, seen.Q - D @ (D.T @ seen.Q), lefts, seen.freedom + D.shape[1])


def _scan(cols: Columns, Q: Array, lefts: Sequence[Array], freedom: int | None = None) -> Scan:
    buckets, sizes = [], np.zeros(cols.groups)
    for (which, index, gram), left in zip(cols.grams.values(), lefts, strict=True):
        norm = np.sqrt(np.maximum(np.einsum("nkk->nk", gram), 1e-300))
        value, vector = np.linalg.eigh(left / norm[:, :, None] / norm[:, None, :])
        good = value > ABSORBED * (1 if gram.shape[1] <= 4 else 1e1)
        W = np.where(good, 1 / np.sqrt(np.where(good, value, 1)), 0)[:, :, None] * vector.swapaxes(1, 2) / norm[:, None, :]
        sizes[which] = good.sum(1)
        buckets.append(Bucket(which, index, left, W))
    return Scan(cols, Q, tuple(buckets), sizes, cols.XT.shape[1] - Q.shape[1] if freedom is None else freedom)


def single_f(seen: Scan, response: Array) -> Array:
    """(G,) F statistic of every candidate alone beyond the model; nought for one that adds nothing."""
    strength = seen.strength(response[:, None])[0][:, 0]
    rest = float(response @ response) - strength
    k = seen.sizes
    room = (k > 0) & (seen.freedom > k)
    return np.where(room, strength / np.maximum(k, 1) / np.maximum(rest, 1e-300) * np.maximum(seen.freedom - k, 1), 0.0)


def log_bayes_factors(seen: Scan, strength: Array, root: Array, total: Array, ratio: float) -> Array:
    """(G, B) log Bayes factors of every candidate at v = ratio · s², s² integrated out (Jeffreys), against no effect;
    `total` (B,) residual sums of squares. A single-term compliance of the wrong sign is discounted by its tail."""
    shrink = ratio / (1 + ratio)
    share = np.minimum(strength / total, 1 - np.finfo(strength.dtype).eps)
    out = np.log1p(share * -share.dtype.type(shrink))
    out *= share.dtype.type(-0.5 * seen.freedom)
    out -= (0.5 * np.log1p(ratio) * seen.sizes[:, None]).astype(share.dtype)
    signed = np.flatnonzero(seen.columns.signs)
    if len(signed):
        from scipy.special import log_ndtr
        sigma = np.sqrt(total * (1 - share[signed] * shrink) / seen.freedom)
        out[signed] += np.log(2) + log_ndtr(seen.columns.signs[signed, None] * root[signed] / sigma * np.sqrt(shrink))
    out[seen.sizes == 0] = -np.inf
    return np.asarray(out)


def evidence(seen: Scan, log_prior: Array, response: Array) -> tuple[float, Array]:
    """(log Σ prior BF at the ratio v/s² that maximises it, log prior + log BF (G,) there) of a response (N,)."""
    strength, root = seen.strength(response[:, None])
    total = np.square(response).sum(keepdims=True)
    best, posterior = -np.inf, np.full(len(log_prior), -np.inf)
    for r in RATIOS:
        joint = log_bayes_factors(seen, strength, root, total, float(r))[:, 0] + log_prior
        value = float(joint.max() + np.log(np.exp(joint - joint.max()).sum()))
        if value > best:
            best, posterior = value, joint
    return best, posterior


def best_factors(seen: Scan, response: Array) -> Array:
    """(G,) log Bayes factor of every candidate alone, each at the ratio v/s² that suits it best."""
    strength, root = seen.strength(response[:, None])
    total = np.square(response).sum(keepdims=True)
    return np.asarray(np.max([log_bayes_factors(seen, strength, root, total, float(r))[:, 0] for r in RATIOS], axis=0))


def _null_evidence(seen: Scan, log_prior: Array, strength: Array, root: Array, total: Array) -> Array:
    """The same evidence (B,) of many responses; single precision is ample where nothing stands out."""
    strength, root, prior = strength.astype(np.float32), root.astype(np.float32), log_prior.astype(np.float32)[:, None]
    total, best = total.astype(np.float32), np.full(strength.shape[1], -np.inf)
    for r in RATIOS:
        joint = log_bayes_factors(seen, strength, root, total, float(r))
        joint += prior
        top = joint.max(0)
        joint -= top
        np.exp(joint, out=joint)
        best = np.maximum(best, top + np.log(joint.sum(0)))
    return best


def null(seen: Scan, log_prior: Array, draws: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """(draws,) sorted evidences, and sorted smallest p-values of single candidates, when nothing is left: the residual then
    lies evenly on the sphere of the model's residuals, whatever the parameters and the noise level (Dufour 2006)."""
    out, least = [], []
    for part in _chunks(draws, max(1, int(4e6 / max(seen.columns.groups, 1)))):
        u = rng.standard_normal((seen.columns.XT.shape[1], part))
        u -= seen.Q @ (seen.Q.T @ u)
        strength, root = seen.strength(u)
        total = np.square(u).sum(0)
        out.append(_null_evidence(seen, log_prior, strength, root, total))
        share = strength / total
        best = {k: share[seen.sizes == k].max(0) for k in np.unique(seen.sizes) if k > 0}
        least.append(np.min([_tail(value, k, seen.freedom) for k, value in best.items()], axis=0) if best else np.ones(part))
    return np.sort(np.concatenate(out)), np.sort(np.concatenate(least))


def _tail(share: Array, size: Array | float, freedom: int) -> Array:
    """P(a candidate of `size` columns explains at least this share by chance): Beta(k/2, (ν−k)/2) (methods.md A.6)."""
    from scipy.special import betainc
    return np.asarray(betainc(np.maximum(freedom - size, 1e-9) / 2, np.maximum(size, 1e-9) / 2, 1 - np.minimum(share, 1.0)))


def familywise(seen: Scan, response: Array, least_p: Array) -> Array:
    """(G,) family-wise p of every candidate alone: the exact max-test over the whole map (methods.md A.6)."""
    share = seen.strength(response[:, None])[0][:, 0] / float(response @ response)
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


