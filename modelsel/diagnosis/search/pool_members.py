"""The members of a pool: what may stand beside the chosen effects of a model, or in their place."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations, zip_longest

import numpy as np

from ..._linalg import TINY
from ..candidates.alike_mechanisms import number_kinds
from ..inference.evidence import compute_factors, sum_evidence
from ..inference.joint_curves import build_curve, see_rest
from ..inference.scan import build_scan_without
from .model_pool import Pool, assemble_pool
from .state import Search
from .views import View

# members of a pool, and columns up to which a candidate that is not chosen may join it
MOST_MEMBERS, MOST_COLUMNS = 160, 40
# pairs of effects that one explanation may replace, explanations of each, and the cosine of their
# displacements from which they are such a pair
MOST_PAIRS, EACH_PAIR, RELATED = 12, 12, 0.3


def gather_pool(search: Search, view: View, chosen: Sequence[int]) -> Pool | None:
    """Gather a pool around the chosen candidates of a view: what may stand beside them or in their
    place, one for one, one for two, two for one, or a family as a whole.

    None where there is nothing: no candidate is left beyond the base."""
    offered = _list_offers(search, view, chosen)
    members = dict.fromkeys(chosen)
    dead = set(search.dead.tolist())
    for g in _interleave(offered):
        columns = len(search.columns.slices[g])
        if columns <= MOST_COLUMNS and g not in dead:
            members.setdefault(g)
        if len(members) == MOST_MEMBERS:
            break
    if not members:
        return None
    which = np.array(sorted(members), dtype=np.intp)
    log_prior = search.log_prior[which]
    none_free = np.zeros(len(which), bool)
    curve = build_curve(search.columns, which, log_prior, none_free, ~none_free)
    effects = [search.candidates[g] for g in chosen]
    rest = see_rest(curve, view.scan, view.response, view.release(*effects))
    labels = [search.candidates[g].label for g in which]
    kinds = number_kinds(labels)
    return assemble_pool(rest, log_prior - search.bound, kinds, search.traits.single[which])


def _list_offers(search: Search, view: View, chosen: Sequence[int]) -> list[list[int]]:
    """List what is offered, by its reason: the rivals of each effect, what is strongest in the rest,
    the families of the effects, and what would explain two of them at once."""
    named = [search.rename(g, view).named for g in chosen]
    strongest = search.name_strongest(view, chosen)
    offered = [[entry.place for entry in one.entries] for one in (*named, strongest)]
    for family in search.traits.families:
        whole = [family.whole, *family.parts]
        if not set(whole).isdisjoint(chosen):
            offered.append(whole)
    pairs = list_related(search, view, chosen)
    offered += [_explain_both(search, view, pair) for pair in pairs]
    return offered


def _interleave(offered: Sequence[Sequence[int]]) -> Iterator[int]:
    """Generate the first of every list, then the second of every one, and so on."""
    for rank in zip_longest(*offered):
        for g in rank:
            if g is not None:
                yield g


def list_related(search: Search, view: View, chosen: Sequence[int]) -> list[tuple[int, int]]:
    """List the pairs of effects that one explanation might replace, the most alike first: those
    that move the target alike, or against each other."""
    units = []
    for g in chosen:
        moved = search.compute_displacement(g, view)
        size = max(float(np.linalg.norm(moved)), TINY)
        units.append(moved / size)
    pairs = []
    for (g, first), (h, second) in combinations(zip(chosen, units, strict=True), 2):
        cosine = abs(float(first @ second))
        if cosine > RELATED:
            pairs.append((-cosine, g, h))
    pairs.sort()
    return [(g, h) for _, g, h in pairs[:MOST_PAIRS]]


def _explain_both(search: Search, view: View, pair: tuple[int, int]) -> list[int]:
    """List what explains most of two effects together."""
    effects = [search.candidates[g] for g in pair]
    released = view.release(*effects)
    scan = build_scan_without(view.scan, released.directions)
    response = released.see(view.response, scan.back)
    factors = compute_factors(scan, response)
    _, log_probability = sum_evidence(factors, search.log_prior)
    order = np.argsort(-log_probability, kind="stable")
    strongest = order[:EACH_PAIR]
    has_evidence = np.isfinite(log_probability[strongest])
    return [int(g) for g in strongest[has_evidence]]
