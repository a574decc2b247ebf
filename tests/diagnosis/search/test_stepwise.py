"""The stepwise search adds what is beyond chance by itself."""

from __future__ import annotations

import numpy as np
import pytest
from builders import drawn
from searches import ignore

from modelsel import Model, mechanism
from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.inference.credible_sets import compute_own_evidence
from modelsel.diagnosis.search import stepwise
from modelsel.diagnosis.search.state import LEVEL, Search
from modelsel.diagnosis.search.stepwise import explore
from modelsel.fitting.least_squares import fit
from modelsel.mechanisms.registry import every


@pytest.mark.integration
def test_what_is_beyond_chance_only_with_other_effects_is_not_added(
    monkeypatch: pytest.MonkeyPatch, rng: np.random.Generator
) -> None:
    """It was added, dropped, and kept all the same while the search went on beside it."""
    at = drawn("irb120", rng, 40)
    base = Model((mechanism("geometric", at.robot),))
    found = build_candidates(at, base, every(at.robot))
    search = Search(at, base, found, rng, fit(at, base))
    monkeypatch.setattr(search, "compute_sign_p", lambda *given: 0.0)
    monkeypatch.setattr(stepwise, "MAX_EFFECTS", 1)
    question = search.ask_rest(search.first)
    strongest = question.answer(search.list_set_aside(()))
    own = compute_own_evidence(question, strongest, strongest.top)
    assert own < strongest.evidence

    search.null = np.full_like(search.null, strongest.evidence - 1e-9)
    together = explore(search, (), ignore)
    assert together.chosen == ()
    assert together.progress.path == []
    assert together.remainder.p <= LEVEL

    search.null = np.full_like(search.null, own - 1e-9)
    alone = explore(search, (), ignore)
    assert search.candidates[strongest.top].label in alone.progress.path[0]
