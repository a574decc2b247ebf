"""Free functions that cannot matter are set aside, and only these."""

from __future__ import annotations

import numpy as np
import pytest
from builders import drawn, planted

from modelsel._typing import Array
from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.inference import screening
from modelsel.diagnosis.inference.evidence import compute_factors
from modelsel.diagnosis.inference.scan import Scan, build_scan_without
from modelsel.diagnosis.inference.screening import build_scan_for
from modelsel.diagnosis.search.state import Search
from modelsel.diagnosis.search.views import View
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.fitting.design import Model
from modelsel.fitting.least_squares import fit
from modelsel.mechanisms.registry import every, mechanism


def search_with(rng: np.random.Generator, size: float) -> tuple[Search, View, int]:
    """A search, its view with the eccentric encoder of joint 3 and a twist beside it, and which
    candidate the encoder is; `size` [rad] of it."""
    at = drawn("puma760", rng, 90)
    base = Model((mechanism("geometric", at.robot),))
    bent = planted(at, mechanism("encoder-eccentricity:3", at.robot).terms, [size, size], rng, 0.03)
    every_one = build_candidates(bent, base, every(at.robot))
    # what is set aside are functions of many columns; of the other cells and waves a few are enough
    found = tuple(
        one
        for k, one in enumerate(every_one)
        if one.registered or one.kind is CandidateKind.FREE_FUNCTION or k % 7 == 0
    )
    search = Search(bent, base, found, rng, fit(bent, base))
    place = {one.mechanism.name: g for g, one in enumerate(found)}
    own = place["encoder-eccentricity:3"]
    return search, search.fit_model([own, place["settle:2"]], None), own


def name_again(search: Search, view: View, g: int) -> tuple[Scan, Array, Array]:
    """The scan to name a candidate again, and (ratios, G) factors by it and by the scan in full."""
    released = view.release(search.candidates[g])
    scan, response = build_scan_for(view.scan, released, view.response, g, search.log_prior)
    full = build_scan_without(view.scan, released.directions)
    return scan, compute_factors(scan, response), compute_factors(full, response)


def list_functions(search: Search) -> Array:
    """Free functions of many columns."""
    blocks = [block for block in search.columns.grams if block.root is not None]
    many = [one.which for one in blocks if one.index.shape[1] >= screening.MANY_COLUMNS]
    return np.concatenate(many)


@pytest.mark.integration
def test_only_what_cannot_matter_is_set_aside(rng: np.random.Generator) -> None:
    search, view, g = search_with(rng, 1e-3)
    scan, factors, full = name_again(search, view, g)
    functions = list_functions(search)
    aside = functions[scan.sizes[functions] == 0]
    assert 0 < len(aside) < len(functions)
    least = full[:, g] + search.log_prior[g] - screening.SLACK
    assert (full[:, aside] < least[:, None]).all()
    kept = np.setdiff1d(np.arange(len(search.candidates)), aside)
    np.testing.assert_array_equal(factors[:, kept], full[:, kept])
    assert np.isneginf(factors[:, aside]).all()


@pytest.mark.slow
def test_beside_a_weak_effect_everything_may_matter(rng: np.random.Generator) -> None:
    search, view, g = search_with(rng, 3e-6)
    _, factors, full = name_again(search, view, g)
    np.testing.assert_array_equal(factors, full)


@pytest.mark.integration
@pytest.mark.parametrize("size", [1e-5, 1e-4, 1e-3])
def test_no_factor_exceeds_its_bound(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch, size: float
) -> None:
    """Whatever a function has in common with the model."""
    search, view, g = search_with(rng, size)
    bounds = {}

    def keep(block: screening.Block, left: Array, *others: object) -> Array:
        found = bound(block, left, *others)
        bounds.update(zip(block.which.tolist(), found.T, strict=True))
        return found

    bound = screening._bound_factors
    monkeypatch.setattr(screening, "_bound_factors", keep)
    _, _, full = name_again(search, view, g)
    assert sorted(bounds) == sorted(list_functions(search).tolist())
    for candidate, most in bounds.items():
        assert (full[:, candidate] <= most + 1e-9).all()
