"""Screening: free functions that cannot matter where one effect is named again.

To separate a free function of many columns into its directions takes far longer than to bound what
it explains. With S its Gram matrix beyond the model, of unit columns, and p their products with the
response, it explains no more than pᵀ(S + ε)⁻¹p times 1 + ε / λ, λ the least eigenvalue that counts;
its directions weigh at most one each, the first of them one. Where that leaves it less than
e^-SLACK of the probability of the effect, it is set aside, and no probability changes by more than
that: priors sum to one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..._linalg import TINY
from ..._typing import Array, Mask
from ..columns.buckets import build_bucket, build_buckets, find_least_share
from ..columns.candidate_columns import Block, find_signed
from .evidence import RATIOS, compute_factors
from .scan import Beyond, Released, Response, Scan, SmallerModel, give_back

# log odds against an effect beyond which an explanation does not matter
SLACK = 30.0
# added to the eigenvalues, as a share of the least that counts, and columns from which a bound is
# worth its time
RIDGE = 1e-2
MANY_COLUMNS = 16


def build_scan_for(
    seen: Scan, released: Released, response: Response, g: int, log_prior: Array
) -> tuple[Scan, Response]:
    """Build the scan beyond a model without candidate g, to name it again: free functions that
    cannot matter beside it have no directions there.

    `response`: that of the model. Returns the scan, and the response with what g explained."""
    smaller = give_back(seen, released.directions)
    put_back = released.see(response, smaller.back)
    columns = seen.columns
    aside = _find_hopeless(smaller, put_back, g, log_prior)
    buckets, sizes = build_buckets(columns.grams, smaller.lefts, columns.groups, aside)
    return smaller.complete(buckets, sizes), put_back


def _find_hopeless(smaller: SmallerModel, response: Response, g: int, log_prior: Array) -> Mask:
    """Find the candidates (G,) that cannot matter beside g."""
    columns = smaller.seen.columns
    aside = np.zeros(columns.groups, bool)
    least: Array | None = None
    for block, left in zip(columns.grams, smaller.lefts, strict=True):
        width = block.index.shape[1]
        if block.root is None or width < MANY_COLUMNS:
            continue
        if least is None:
            own = _weigh_one(smaller, response, g)
            posterior = own + log_prior[g]
            least = posterior - SLACK
        most = _bound_factors(block, left, response, smaller.freedom)
        is_less = most < least[:, None]
        aside[block.which] = is_less.all(0)
    aside[g] = False
    return aside


def _weigh_one(smaller: SmallerModel, response: Response, g: int) -> Array:
    """Compute (ratios,) log Bayes factors of candidate g."""
    columns = smaller.seen.columns
    number, row = columns.home[g]
    block = columns.grams[number]
    alone = np.array([row])
    own = block.take(alone)
    first = np.zeros(1, np.intp)
    lone = replace(own, which=first)
    left = smaller.lefts[number]
    bucket, sizes = build_bucket(lone, left[alone])
    signs = (columns.signs[g],)
    beyond = Beyond(signs, find_signed(signs), (bucket,), sizes, smaller.freedom)
    return compute_factors(beyond, response)[:, 0]


def _bound_factors(block: Block, left: Array, response: Response, freedom: int) -> Array:
    """Bound the log Bayes factors (ratios, n) of free functions."""
    unit = block.unit
    least = find_least_share(unit.shape[1])
    scaled = left * unit[:, :, None] * unit[:, None, :]
    np.einsum("nkk->nk", scaled)[...] += RIDGE * least
    products = response.products[block.index] * unit
    columns = products[:, :, None]
    solved = np.linalg.solve(scaled, columns)
    explained = np.einsum("nk,nk->n", products, solved[:, :, 0])
    share = (1 + RIDGE) * explained / max(response.square, TINY)
    largest = 1 - np.finfo(float).eps
    most = np.clip(share, 0.0, largest)
    ratios = RATIOS[:, None]
    shrunk = most * ratios / (1 + ratios)
    gain = -0.5 * freedom * np.log1p(-shrunk)
    price = 0.5 * np.log1p(ratios)
    return np.asarray(gain - price)
