"""The page on causes of one's own: every block of it is a study, or the part of one, that runs."""

from __future__ import annotations

import tomllib

import numpy as np
import pandas as pd
import pytest
from shown_code import ROOT, fenced

from modelsel import Study, load_robot
from modelsel.diagnosis.candidates.prior_weights import weigh_outcomes
from modelsel.measurements.reader import read_measurements
from modelsel.robot.kinematics import forward
from modelsel.study.pipeline.runner import rehearse_study
from modelsel.study.preparation.own_causes import build_own_candidates
from modelsel.study.preparation.preparation import prepare

PAGE = ROOT / "docs" / "how-to" / "own-causes.md"
TEXT = PAGE.read_text(encoding="utf-8")
WHOLE, BASE, OUTCOMES = [tomllib.loads(block) for block in fenced("toml", TEXT)]
# seven of an arm's places move every target as another one does
PLACES = 6 * 6 + 3 - 7

pytestmark = pytest.mark.docs


@pytest.fixture
def frame(rng: np.random.Generator) -> pd.DataFrame:
    robot = load_robot("puma760")
    q = robot.draw(rng, 40)
    x = forward(robot, q, np.array([40.0, -25.0, 100.0])) + rng.normal(0, 0.05, (40, 3))
    columns = {f"q{j + 1}_rad": q[:, j] for j in range(6)}
    columns |= dict(zip(("x_mm", "y_mm", "z_mm"), x.T, strict=True))
    for name in ("acc_x_g", "acc_y_g", "pressure_bar"):
        columns[name] = rng.uniform(4, 7, 40)
    return pd.DataFrame(columns)


def test_the_first_study_adds_a_pair_and_products_everywhere(frame: pd.DataFrame) -> None:
    study = Study(**WHOLE | {"measurements": frame})
    rehearsed = rehearse_study(study)
    assert rehearsed["own_explanations"] == 3 * PLACES
    robot = load_robot("puma760")
    split, _, _ = prepare(study, robot, read_measurements(frame, robot))
    pairs, products = build_own_candidates(study, split.problem)
    assert len(pairs.mechanisms) == PLACES
    assert len(products.mechanisms) == 2 * PLACES
    assert (pairs.prior, products.prior) == (None, 0.1)


def test_the_second_study_has_its_own_cause_in_the_base(frame: pd.DataFrame) -> None:
    rehearsed = rehearse_study(Study(**BASE | {"measurements": frame}))
    assert rehearsed["base"] == ["geometric", "hose"]
    assert rehearsed["own_explanations"] == 0


def test_what_became_of_findings_weighs_as_the_page_says(frame: pd.DataFrame) -> None:
    study = Study(**WHOLE | {"measurements": frame} | OUTCOMES)
    rehearse_study(study)
    droop = study.search.outcomes["tool-droop"]
    weight = weigh_outcomes(droop.confirmed, droop.contradicted)
    assert weight == pytest.approx(1 / 6)
    assert "a sixth of its odds" in TEXT
