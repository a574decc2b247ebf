"""The error map shows one moment of a step, not all that were tried."""

from __future__ import annotations

import numpy as np
import pytest
from builders import drawn, seeds
from searches import search_separated

from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.error_map import build_error_map
from modelsel.fitting.design import Model
from modelsel.mechanisms.registry import every, mechanism


@pytest.mark.slow
@seeds(1)
def test_of_many_moments_of_a_step_the_map_shows_the_strongest(rng: np.random.Generator) -> None:
    at = drawn("puma760", rng, 60)
    base = Model((mechanism("geometric", at.robot),))
    found = build_candidates(at, base, every(at.robot))
    diagnosis = search_separated(at, base, found)
    shown = build_error_map(diagnosis, found)
    for joint in range(1, at.robot.n + 1):
        name = f"zero-step:{joint}"
        forms = [g for g, one in enumerate(found) if one.registered_name == name]
        assert len(forms) > 6
        strongest = max(forms, key=lambda g: diagnosis.single_f[g])
        cells = [cell for cell, own in shown.named.items() if own.name == name]
        (cell,) = cells
        assert shown.named[cell] == found[strongest].mechanism
        assert shown.f[cell] == diagnosis.single_f[strongest]
    ripples = {own.name for own in shown.named.values() if own.name.startswith("gear-ripple")}
    waves = [own for own in shown.named.values() if own.name == "gear-ripple:2"]
    assert len(ripples) == at.robot.n
    assert len(waves) > 50
