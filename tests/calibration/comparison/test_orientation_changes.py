"""Two campaigns that both measured orientations: how far a change turns the target is told beside how
far it moves it, and one that only turns it is seen.

Arms and noise are drawn from the test's stream, and measured on the exact chain."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import drawn
from scipy import stats

from modelsel._typing import Array
from modelsel.calibration.calibration import Calibration, calibrate
from modelsel.calibration.comparison.campaigns import Comparison, Explanation, compare_campaigns
from modelsel.calibration.comparison.change_sentences import describe_change
from modelsel.calibration.comparison.comparison_sentences import describe_comparison
from modelsel.calibration.comparison.mechanism_changes import SIGNIFICANCE
from modelsel.fitting.design import Model, residuals
from modelsel.fitting.least_squares import fit
from modelsel.fitting.noise import Floor
from modelsel.fitting.whitening import Whitening
from modelsel.mechanisms.geometry import build_setup
from modelsel.mechanisms.registry import mechanism
from modelsel.mechanisms.terms import Term
from modelsel.report.comparison_page import _write_parameters
from modelsel.robot.files import load_robot
from modelsel.robot.rigid import from_rotation_vector
from modelsel.selection.evaluation import Split

NOISE_MM, NOISE_RAD = 0.02, 2e-5
ROBOT = load_robot("puma760")
GEOMETRY = mechanism("geometric", ROBOT)
FLANGE = ROBOT.n + 1


def make_model(oriented: bool) -> Model:
    setup = build_setup(ROBOT, 1, 1, False, oriented)
    return Model((setup, GEOMETRY) if setup.terms else (GEOMETRY,))


def find(terms: tuple[Term, ...], frame: int, axis: str) -> int:
    """The place of a constant term among others."""
    places = [(term.screws[0].frame, term.screws[0].axis) for term in terms]
    return places.index((frame, axis))


def draw_errors(rng: np.random.Generator, model: Model) -> Array:
    sizes = [0.2 if term.unit == "mm" else 5e-4 for term in model.terms]
    return rng.normal(0, sizes)


def campaign(
    rng: np.random.Generator, model: Model, theta: Array, oriented: bool = True
) -> Calibration:
    """60 poses, measured and fitted."""
    at = drawn(ROBOT, rng, 60)
    data = replace(at.data, rotation=np.tile(np.eye(3), (60, 1, 1)))
    at = replace(at, data=data)
    left = residuals(at, model.terms, theta)
    position = data.position - left[:, :3] + rng.normal(0, NOISE_MM, (60, 3))
    turns = -left[:, 3:]
    rotation = from_rotation_vector(turns)
    noise = rng.normal(0, NOISE_RAD, (60, 3))
    rotation = from_rotation_vector(noise) @ rotation
    measured = replace(data, position=position, rotation=rotation if oriented else None)
    weights = np.repeat([1 / NOISE_MM, 1 / NOISE_RAD], 3)
    blocks = np.tile(np.diag(weights), (60, 1, 1))
    whitening = Whitening(matrices=blocks) if oriented else Whitening(1 / NOISE_MM)
    tool_rotations = np.eye(3)[None] if oriented else None
    at = replace(at, data=measured, whitening=whitening, tool_rotations=tool_rotations)
    rows = np.ones(60, bool)
    split = Split(at, rows, ~rows, np.zeros(60, np.intp), True)
    fitted = fit(at, model if oriented else make_model(False))
    return calibrate("bench", split, fitted, Floor(NOISE_MM, "stated"), None, False, {})


def test_a_mechanism_that_grew_is_told_with_its_turns(rng: np.random.Generator) -> None:
    compliance = mechanism("joint-compliance:2", ROBOT)
    model = make_model(True)
    model = Model((*model.mechanisms, compliance))
    before = draw_errors(rng, make_model(True))
    calibrations = []
    for size in (1e-6, 4e-6):
        theta = np.append(before, size)
        calibrations.append(campaign(rng, model, theta))
    found = compare_campaigns(*calibrations)
    (change,) = found.mechanisms
    assert change.what == "grew"
    first, second = change.turns_mrad
    assert second == pytest.approx(4 * first, rel=0.1)
    # what joint 2 winds up turns the target as far, and moves it by the lever, of a metre or less
    assert change.after_mm < second * ROBOT.reach / 1e3
    assert " mrad rms of its orientation (p < 0.001)." in describe_change(change)
    only = compare_campaigns(calibrations[1], campaign(rng, make_model(True), before))
    (gone,) = only.mechanisms
    assert gone.turns_mrad == (pytest.approx(second, rel=0.05), 0.0)
    assert " mrad rms of its orientation; " in describe_change(gone)


def compare_changed(
    rng: np.random.Generator, frame: int, axis: str, by: float, oriented: bool = True
) -> Comparison:
    """Compare two campaigns between which one term has changed."""
    model = make_model(True)
    before = draw_errors(rng, model)
    after = before.copy()
    after[find(model.terms, frame, axis)] += by
    first, second = (campaign(rng, model, theta, oriented) for theta in (before, after))
    return compare_campaigns(first, second)


def explained(found: Comparison) -> Explanation:
    (one,) = found.explained_by
    return one


def test_a_target_that_only_turned_is_seen(rng: np.random.Generator) -> None:
    found = compare_changed(rng, FLANGE, "ry", 1e-3)
    one = explained(found)
    assert one.label.endswith(f"(frame {FLANGE} ry)")
    assert one.turns_mrad == pytest.approx(1.0, abs=0.1)
    assert one.moves_mm < 1e-9
    said = describe_comparison(found)
    assert any("mrad rms of the target's orientation." in line for line in said)
    assert not any("mm rms at the target." in line for line in said)


def test_a_joint_that_tilted_moves_and_turns_the_target(rng: np.random.Generator) -> None:
    found = compare_changed(rng, 3, "rx", 1e-3)
    one = explained(found)
    assert one.turns_mrad == pytest.approx(1.0, abs=0.1)
    assert one.moves_mm > 0.1
    said = "\n".join(describe_comparison(found))
    assert " mm rms at the target, " in said
    assert " mrad rms of its orientation." in said
    page = _write_parameters(found)
    assert '<th scope="col" class="number">mrad rms</th>' in page


def test_nothing_changed_is_said_of_orientations_too(rng: np.random.Generator) -> None:
    found = compare_changed(rng, 3, "rx", 0.0)
    assert not found.explained_by
    assert all(change.turns_mrad is not None for change in found.changes)


@pytest.mark.slow
def test_changes_by_chance_are_as_rare_as_said(rng: np.random.Generator) -> None:
    """Of 100 pairs of campaigns between which nothing changed, about five tell a change."""
    least = []
    for _ in range(100):
        found = compare_changed(rng, 3, "rx", 0.0)
        least.append(min(change.p for change in found.changes))
    told = np.count_nonzero(np.array(least) <= SIGNIFICANCE)
    assert stats.binom.ppf(0.001, 100, SIGNIFICANCE) <= told
    assert told <= stats.binom.ppf(0.999, 100, SIGNIFICANCE)


def test_positions_alone_tell_no_turn(rng: np.random.Generator) -> None:
    found = compare_changed(rng, 3, "rx", 1e-3, oriented=False)
    assert all(change.turns_mrad is None for change in (*found.changes, *found.explained_by))
    assert "mrad rms" not in "\n".join(describe_comparison(found))
    assert "mrad rms" not in _write_parameters(found)
