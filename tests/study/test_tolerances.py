"""Parameters beyond every maker's tolerance are told where they are certain, and no others."""

from __future__ import annotations

import numpy as np
import pytest
from builders import drawn, planted, study_of

from modelsel.exceptions import write_rounded
from modelsel.fitting.design import Model
from modelsel.fitting.noise import Floor
from modelsel.mechanisms.registry import mechanism
from modelsel.selection.evaluation import Evaluation, Split, evaluate
from modelsel.study.preparation.checks import check_chosen_model

pytestmark = pytest.mark.unit

ROBOT = "irb120"
NOISE = 0.05
LINK = "a3"  # along the upper arm


def fit_arm(rng: np.random.Generator, link_mm: float, noise_mm: float) -> tuple[Split, Evaluation]:
    """The geometric model of an arm within its tolerances, but for one link."""
    at = drawn(ROBOT, rng, 50)
    model = Model((mechanism("geometric", at.robot),))
    theta = np.array([0.3 if term.unit == "mm" else 1e-3 for term in model.terms])
    theta *= rng.uniform(-1, 1, len(theta))
    symbols = [term.symbol for term in model.terms]
    theta[symbols.index(LINK)] += link_mm
    split = study_of(planted(at, model.terms, theta, rng, noise_mm))
    return split, evaluate(split, model, ("geometric",))


def told(split: Split, chosen: Evaluation) -> list[str]:
    notes = check_chosen_model(split, chosen, Floor(NOISE, "stated"), None, (), False)
    return [note.sentence for note in notes if note.code == "beyond-tolerance"]


@pytest.mark.parametrize(
    ("link_mm", "least", "most", "is_told"), [(7.0, 5.0, 10.0, True), (6.0, 1.0, 5.0, False)]
)
def test_a_link_that_is_certainly_wrong_is_told(
    link_mm: float, least: float, most: float, is_told: bool
) -> None:
    """As many standard errors beyond 5 mm as a wrong model does not make, and fewer."""
    split, chosen = fit_arm(np.random.default_rng(1), link_mm, NOISE)
    place = [term.symbol for term in chosen.fit.terms].index(LINK)
    value = float(chosen.fit.theta[place])
    error = float(chosen.fit.standard_errors[place])
    assert least < (abs(value) - 5.0) / error < most
    sentences = told(split, chosen)
    assert bool(sentences) is is_told
    if is_told:
        assert f"{LINK} = {value:.4g} ± {write_rounded(error, 2)} mm" in sentences[0]


@pytest.mark.integration
def test_arms_within_their_tolerances_are_not_told(rng: np.random.Generator) -> None:
    for _ in range(10):
        assert told(*fit_arm(rng, 0.0, NOISE)) == []
