"""The scan: how much of a residual every candidate explains beyond a fitted model.

With Q an orthonormal basis of the fitted model, X_g a candidate's columns and r the residual,
everything follows from X_gᵀX_g, X_gᵀQ and X_gᵀr: the Gram matrix beyond the model is
X_gᵀX_g − (X_gᵀQ)(X_gᵀQ)ᵀ. "Beyond" means projected off the model throughout. No projected column is
ever stored, and the rows of the data are visited once per model.

A smaller model, without one of the effects, needs neither a refit nor the rows: its basis lacks some
directions D of Q, which are "given back" to the candidates by adding (X_gᵀQ D)(X_gᵀQ D)ᵀ to their Gram
matrices."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..._typing import Array, Index, Mask
from ..columns.buckets import SOLID_WEIGHT, Bucket, build_buckets
from ..columns.candidate_columns import Columns
from .sign_constraints import Sides, build_sides, compute_least_of_sign

# unit column below which a column, and diagonal of R below which a direction, depends on others
ZERO_COLUMN = 1e-13
DEPENDENT = 1e-10


class Strength(NamedTuple):
    """How much of responses (N, B) every candidate explains, Z_g its orthonormal columns.

    `whole` (G, B): |Z_gᵀr|². `root` (S, B), of candidates with terms that physics gives a sign: sign
    times estimate over standard error at unit noise, of the term where that is smallest. `smooth`
    (F, K, B), of free functions: |z_kᵀr|² of every direction, zero beyond a function's own ones."""

    whole: Array
    root: Array
    smooth: Array


class Response(NamedTuple):
    """A response r that the model is projected off: its products Xᵀr (C,) and its square |r|²."""

    products: Array
    square: float

    @property
    def column(self) -> Array:
        """The products as one column (C, 1)."""
        return self.products[:, None]


class Displacement(NamedTuple):
    """The whitened displacement (N,) of the target by a candidate, its coordinates (r,) in the model's
    basis, and (d,) in the directions that were given back."""

    raw: Array
    along: Array
    returned: Array

    def dot(self, other: Displacement) -> float:
        """Compute the inner product with another displacement, both projected off the model."""
        within = self.along @ other.along - self.returned @ other.returned
        return float(self.raw @ other.raw - within)


@dataclass(frozen=True, eq=False)
class Beyond:
    """The candidates projected off a model.

    `signs`, (k,) for each candidate: the signs that physics allows its terms, 0 for either; `signed`
    (S,): candidates with a term of one sign; `sizes` (G,): number of directions that each has beyond
    the model; `freedom`: coordinates less the model's rank."""

    signs: tuple[Array, ...]
    signed: Index
    buckets: tuple[Bucket, ...]
    sizes: Array
    freedom: int

    @cached_property
    def smooth(self) -> tuple[Index, Array]:
        """The free functions (F,) and the weights (F, K) of their directions.

        A weight is zero beyond a function's own directions."""
        weighted = [(b.block.which, b.weights) for b in self.buckets if b.weights is not None]
        count = sum(len(which) for which, _ in weighted)
        width = max((weights.shape[1] for _, weights in weighted), default=0)
        padded = np.zeros((count, width))
        start = 0
        for which, weights in weighted:
            padded[start : start + len(which), : weights.shape[1]] = weights
            start += len(which)
        return np.concatenate([np.zeros(0, np.intp), *(which for which, _ in weighted)]), padded

    @cached_property
    def sides(self) -> tuple[Sides | None, ...]:
        """For every bucket, how the terms with a sign follow from its Zᵀr; None without signs."""
        signed = self.signed
        return tuple(build_sides(b.block.which, b.W, self.signs, signed) for b in self.buckets)

    @cached_property
    def by_size(self) -> dict[float, Index | slice]:
        """The candidates of every size of at least one direction.

        A slice where they are consecutive, so that nothing is copied."""
        sizes = (size for size in np.unique(self.sizes) if size > 0)
        return {float(size): _shorten(np.flatnonzero(self.sizes == size)) for size in sizes}

    def strength(self, products: Array) -> Strength:
        """Compute what responses have in common with every candidate, by their products (C, B)."""
        gathered = []
        for bucket in self.buckets:
            W = bucket.W.astype(products.dtype, copy=False)
            # of one column alone a product of matrices is ten times slower
            product = np.multiply if W.shape[1] == 1 else np.matmul
            gathered.append(product(W, products[bucket.block.index]))
        return self.gather(gathered)

    def judge(self, response: Response) -> tuple[Strength, Mask]:
        """Compute the strength of one response, and whether (G,) it asks for small screws only.

        A joint that turns about its own target would have to turn by radians to explain a tenth of
        a millimetre, and is not its cause."""
        products = response.column
        is_small = np.ones(len(self.sizes), bool)
        coordinates = []
        for bucket in self.buckets:
            block = bucket.block
            own_products = products[block.index]
            z = np.matmul(bucket.W, own_products)
            coordinates.append(z)
            which = block.which
            is_small[which] = _has_small_terms(bucket, z)
        strength = self.gather(coordinates)
        return strength, is_small

    def gather(self, products: Sequence[Array]) -> Strength:
        """Gather the strength from every bucket's Z_gᵀr (n, k, B), in their precision.

        Overwrites them."""
        dtype = products[0].dtype if products else np.dtype(float)
        draws = products[0].shape[2] if products else 0
        whole: Array = np.zeros((len(self.sizes), draws), dtype)
        root: Array = np.zeros((len(self.signed), draws), dtype)
        smooth: Array = np.zeros((*self.smooth[1].shape, draws), dtype)
        start = 0
        for bucket, z, side in zip(self.buckets, products, self.sides, strict=True):
            which, k = bucket.block.which, z.shape[1]
            if side is not None:
                root[side.signed] = compute_least_of_sign(z, side)
            np.square(z, out=z)
            whole[which] = z[:, 0] if k == 1 else z.sum(1)
            if bucket.weights is not None:
                smooth[start : start + len(which), :k] = z
                start += len(which)
        return Strength(whole, root, smooth)


@dataclass(frozen=True, eq=False)
class Scan(Beyond):
    """All candidates projected off one fitted model.

    Q (N, r): an orthonormal basis of the fitted model; `inside` (C, r): the products XᵀQ; `back`
    (C, d): the products XᵀQ D with the orthonormal directions D (r, d) that were given back. The
    projection removed is then Q Qᵀ − (Q D)(Q D)ᵀ. A model with shrunk terms has its prior's rows below
    those of the data; candidates are then weighed as if these terms were integrated out."""

    columns: Columns
    Q: Array
    inside: Array
    back: Array

    def see(self, response: Array) -> Response:
        """Multiply a response (N,), which the model is projected off, by all columns."""
        return Response(self.columns.dot(response), float(response @ response))

    def fit_alone(self, g: int, response: Response) -> Array:
        """Compute (k,) least-squares terms of candidate g, fitted alone beyond the model."""
        number, row = self.columns.home[g]
        W = self.buckets[number].W[row]
        return np.asarray(W.T @ (W @ response.products[self.columns.slices[g]]))

    def displace(self, g: int, response: Response) -> Displacement:
        """Compute the whitened displacement by candidate g, fitted alone beyond the model."""
        terms = self.fit_alone(g, response)
        own = self.columns.slices[g]
        raw = terms @ self.columns.expand(g)
        return Displacement(raw, terms @ self.inside[own], terms @ self.back[own])


def _shorten(index: Index) -> Index | slice:
    first, last = int(index[0]), int(index[-1])
    return slice(first, last + 1) if len(index) == last + 1 - first else index


def _has_small_terms(bucket: Bucket, z: Array) -> Mask:
    """Return whether (n,) the terms Wᵀz of every candidate stay below those of small screws.

    Faint directions of a free function do not count."""
    if bucket.weights is not None:
        z = np.where(bucket.weights[:, :, None] > SOLID_WEIGHT, z, 0.0)
    terms = np.matmul(bucket.W.swapaxes(1, 2), z)[:, :, 0]
    return np.asarray((np.abs(terms) < bucket.block.most).all(1))


def build_scan(cols: Columns, Q: Array) -> Scan:
    """Project every candidate off the model's orthonormal basis Q (N, r)."""
    return assemble_scan(cols, Q, cols.dot(Q))


def assemble_scan(cols: Columns, Q: Array, inside: Array) -> Scan:
    """Assemble the scan beyond a basis Q (N, r) from the products (C, r) of every column with it."""
    lefts = []
    for block in cols.grams:
        own = inside[block.index]
        lefts.append(block.gram - np.matmul(own, own.swapaxes(1, 2)))
    rows, rank = Q.shape
    buckets, sizes = build_buckets(cols.grams, lefts, cols.groups)
    return Scan(
        signs=cols.signs,
        signed=cols.signed,
        buckets=buckets,
        sizes=sizes,
        freedom=rows - rank,
        columns=cols,
        Q=Q,
        inside=inside,
        back=np.zeros((len(inside), 0)),
    )


class Released(NamedTuple):
    """What taking effects out of a model releases.

    `directions` (r, d): orthonormal, in the coordinates of the model's basis; `amounts` (d,): the
    part of the response along them, which the effects explained."""

    directions: Array
    amounts: Array

    def see(self, response: Response, back: Array) -> Response:
        """Add the released part to a response; `back` (C, d): the columns along the directions."""
        square = response.square + float(self.amounts @ self.amounts)
        return Response(response.products + back @ self.amounts, square)


def build_scan_without(seen: Scan, directions: Array) -> Scan:
    """Build the scan from a smaller model, by giving directions back.

    They are (r, d), orthonormal, in the coordinates of `seen.Q`."""
    smaller = give_back(seen, directions)
    blocks = seen.columns.grams
    buckets, sizes = build_buckets(blocks, smaller.lefts, seen.columns.groups)
    return smaller.complete(buckets, sizes)


class SmallerModel(NamedTuple):
    """A smaller model than that of a scan.

    `back` (C, d): products of all columns with the directions that it gives back; `lefts`: the Gram
    matrices (n, k, k) of every block beyond it."""

    seen: Scan
    back: Array
    lefts: list[Array]

    @property
    def freedom(self) -> int:
        """Coordinates less its rank."""
        given_back = int(self.back.shape[1])
        return self.seen.freedom + given_back

    def complete(self, buckets: tuple[Bucket, ...], sizes: Array) -> Scan:
        """Complete the scan beyond it."""
        return replace(
            self.seen, buckets=buckets, sizes=sizes, freedom=self.freedom, back=self.back
        )


def give_back(seen: Scan, directions: Array) -> SmallerModel:
    """Give directions (r, d) of a model back to the candidates."""
    # what was added last has no part in what stood before it
    first = int(directions.any(1).argmax()) if directions.any() else 0
    back = seen.inside[:, first:] @ directions[first:]
    lefts = []
    for bucket in seen.buckets:
        own = back[bucket.block.index]
        lefts.append(bucket.left + np.matmul(own, own.swapaxes(1, 2)))
    return SmallerModel(seen, back, lefts)


def compute_basis(matrix: Array) -> Array:
    """Compute an orthonormal basis (N, r) of the columns of a matrix (N, p).

    Its rank is from pivoted QR on unit columns."""
    from scipy.linalg import qr

    size = np.linalg.norm(matrix, axis=0)
    is_nonzero = size > ZERO_COLUMN * size.max(initial=0)
    unit = matrix[:, is_nonzero] / size[is_nonzero]
    if not unit.shape[1]:
        return np.zeros((len(matrix), 0))
    Q, R, _ = qr(unit, mode="economic", pivoting=True)
    rank = int((np.abs(np.diag(R)) > DEPENDENT).sum())
    return np.asarray(Q[:, :rank])
