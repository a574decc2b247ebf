"""What the instrument measures wrongly does not get into the arm that is exported: it is taken off the
measurements before a form's own arm is fitted to them."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from builders import seeds
from exact import flanges_of
from gauged import NOISE as CAMPAIGN_NOISE
from gauged import TOOL as CAMPAIGN_TOOL
from gauged import Campaign
from hidden_arm import Effect, State, measured
from hidden_effects import shifted
from scipy.spatial.transform import Rotation

from modelsel.calibration.calibration import Calibration, calibrate
from modelsel.calibration.calibration_file import calibration_text
from modelsel.calibration.constant_part import compute_points, sample_workspace, split_parts
from modelsel.calibration.export import export
from modelsel.calibration.export.python import read_module_data
from modelsel.calibration.export.standalone import predict_both
from modelsel.calibration.loading import parse_calibration
from modelsel.calibration.prediction import predict
from modelsel.calibration.refitting import correct_measurements, refit_forms, select_carried
from modelsel.fitting.design import Model, residuals
from modelsel.fitting.least_squares import fit
from modelsel.fitting.noise import Floor
from modelsel.fitting.problem import Problem
from modelsel.fitting.whitening import Whitening
from modelsel.measurements.measurements import build_measurements
from modelsel.measurements.reader import read_measurements
from modelsel.mechanisms.environment import tracker_step
from modelsel.mechanisms.geometry import build_setup
from modelsel.mechanisms.registry import mechanism
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import Robot
from modelsel.robot.rigid import transform
from modelsel.robot.urdf import read_urdf_text
from modelsel.selection.evaluation import Split
from modelsel.setup.feature_positions import place_features

NOISE_MM = 0.02
ROWS = 200
TOOL = np.array([40.0, -25.0, 100.0])
STANDS = np.array([2600.0, -700.0, 500.0])


def disturb(arm: Robot, rng: np.random.Generator) -> Robot:
    """The same arm with every joint a bit off its drawing."""
    joints = []
    for joint in arm.joints:
        turn = Rotation.from_rotvec(rng.normal(0, 1e-3, 3)).as_matrix()
        off = transform(turn, rng.normal(0, 0.5, 3))
        joints.append(replace(joint, before=joint.before @ off))
    return replace(arm, joints=tuple(joints))


def stand(arm: Robot, q: np.ndarray, twist: float) -> np.ndarray:
    """Where the target is (m, 3): joint 4 turns unevenly, which no geometry carries."""
    turned = q.copy()
    turned[:, 3] += twist * np.sin(2 * q[:, 3] + 0.4)
    flange = flanges_of(arm, turned)
    return flange[:, :3, 3] + flange[:, :3, :3] @ TOOL


def misread(point: np.ndarray, name: str) -> np.ndarray:
    """What an instrument beside the arm measures."""
    if name == "tracker-axes":
        x, y, z = point.T
        return np.stack([x + 2e-3 * y, y, z + 1.5e-3 * x], axis=1)
    away = point - STANDS
    distance = np.linalg.norm(away, axis=1, keepdims=True)
    return STANDS + away * (1 + 4.0 / distance)


def calibrated(rng: np.random.Generator, name: str, twist: float) -> tuple[Calibration, Robot]:
    """A calibration by an instrument that measures wrongly, and the arm as it is."""
    nominal = load_robot("ur5")
    arm = disturb(nominal, rng)
    q = arm.draw(rng, ROWS)
    seen = misread(stand(arm, q, twist), name) + rng.normal(0, NOISE_MM, (ROWS, 3))
    data = build_measurements(q, seen)
    whitening = Whitening(1 / NOISE_MM)
    at = Problem(nominal, data, TOOL, whitening=whitening, tracker=tuple(STANDS.tolist()))
    found = [mechanism("geometric", nominal), mechanism(name, nominal)]
    if twist:
        found.append(mechanism("encoder-eccentricity:4", nominal))
    fitted = fit(at, Model(tuple(found)))
    every = np.ones(ROWS, bool)
    split = Split(at, every, ~every, np.arange(ROWS) % 5, True)
    made = calibrate("seen", split, fitted, Floor(NOISE_MM, "stated"), None, False, {})
    return replace(made, refits=refit_forms(split, fitted)), arm


def miss(points: np.ndarray, truth: np.ndarray) -> float:
    """The rms [mm] between points, but for where the base is thought to stand."""
    own, other = points - points.mean(0), truth - truth.mean(0)
    turn, _ = Rotation.align_vectors(other, own)
    left = turn.apply(own) - other
    return float(np.sqrt(np.square(left).sum(1).mean()))


@pytest.mark.parametrize("twist", [0.0, 2e-3])
@pytest.mark.parametrize("name", ["tracker-axes", "tracker-range"])
def test_the_arm_is_the_one_that_there_is(rng, name, twist) -> None:
    c, arm = calibrated(rng, name, twist)
    q = arm.draw(rng, 300)
    truth = stand(arm, q, twist)
    wrong = miss(misread(truth, name), truth)
    assert wrong > 0.5
    # the whole model
    made = export(c, "python")
    _, calibrated_points = predict_both(read_module_data(made.text), q, c.targets[0], {})
    assert miss(calibrated_points, truth) < 0.03
    (note,) = [note for note in made.notes if note.startswith(name)]
    assert "is an error of the instrument" in note
    # the geometry alone, which cannot have the uneven turning
    robot = read_urdf_text(export(c, "urdf").text, "file", tip="target")
    still = flanges_of(robot, q)[:, :3, 3]
    bent = miss(stand(arm, q, 0.0), truth)
    assert miss(still, truth) < max(0.03, 1.05 * bent)


@pytest.mark.parametrize("form", ["json", "csv", "table"])
def test_corrections_have_none_of_it(rng, form) -> None:
    c, _ = calibrated(rng, "tracker-range", 2e-3)
    text = export(c, form).text
    assert "beam" not in text
    assert "encoder-eccentricity:4" in text or form == "table"


@seeds(2)
def test_refits_of_an_earlier_version_are_not_used(rng) -> None:
    """They were fitted to what the instrument measured wrongly."""
    c, _ = calibrated(rng, "tracker-axes", 2e-3)
    text = calibration_text(c)
    stored = parse_calibration(text)
    assert stored.refits is not None
    assert export(stored, "urdf").text == export(c, "urdf").text
    record = json.loads(text)
    del record["refits"]["corrected"]
    earlier = parse_calibration(json.dumps(record))
    assert earlier.refits is None
    assert "run the study again" in " ".join(export(earlier, "urdf").notes)


@seeds(5)
def test_points_coordinates_and_lengths_are_corrected_and_zero_readings_left_out(
    rng, tmp_path
) -> None:
    """What the arm alone leaves of readings is what arm and instrument left of what was read. Nothing
    can be taken off a touched plane or point, or a bar whose length is not known."""
    campaign = Campaign(rng)
    campaign.points(20)
    campaign.axes(12)
    campaign.distances(20)
    campaign.wires(12)
    campaign.bars(8, {"known": 400.0}, True)
    campaign.bars(8, {"open": 500.0}, False)
    campaign.plates(8, 1)
    campaign.touches(6, 1)
    robot = load_robot("puma760")
    data = read_measurements(campaign.file(tmp_path), robot)
    at = Problem(robot, data, np.array([[0.0, 0.0, 100.0]]))
    model = Model((mechanism("tracker-scale", robot), mechanism("encoder-scale:2", robot)))
    fitted = fit(at, model)
    fitted = replace(fitted, theta=np.full(len(fitted.terms), 1e-3))
    every = np.ones(len(at), bool)
    split = Split(at, every, ~every, np.arange(len(at)) % 5, True)
    corrected_split = correct_measurements(split, fitted)
    corrected = corrected_split.problem
    used = corrected_split.used
    arm = select_carried(fitted.model, "whole")
    own = [place for place, term in enumerate(fitted.terms) if arm(term)]
    terms = tuple(fitted.terms[place] for place in own)
    left = residuals(corrected.unweighted(), terms, fitted.theta[own])
    expected = residuals(at.unweighted(), fitted.terms, fitted.theta)
    np.testing.assert_allclose(left[used], expected[used], atol=1e-9)
    assert len(used) - used.sum() == 8 + 8 + 6
    assert (corrected_split.folds[~used] == -1).all()
    assert np.abs(residuals(at.unweighted(), terms, fitted.theta[own]) - expected).max() > 0.1


@seeds(5, 6)
def test_rows_that_read_zero_do_not_bend_the_arm(rng, tmp_path) -> None:
    """Plates and bars of unknown length, met where the instrument sees the target: the arm alone
    would meet them elsewhere."""

    def stretch(_: State, points: np.ndarray) -> np.ndarray:
        return misread(points, "tracker-range") - points

    seen = Effect("range", "a longer beam", (shifted(stretch),), np.array([1.0]))
    campaign = Campaign(rng, [seen])
    campaign.points(90)
    campaign.plates(120, 4)
    campaign.bars(80, {"a": 500.0, "b": 700.0}, False)
    robot = load_robot("puma760")
    data = read_measurements(campaign.file(tmp_path), robot)
    whitening = Whitening(1 / CAMPAIGN_NOISE)
    tool = np.array(CAMPAIGN_TOOL)
    at = Problem(robot, data, tool, whitening=whitening, tracker=tuple(STANDS.tolist()))
    at = place_features(at, np.ones(len(at), bool))
    assert data.gauges is not None
    placing = build_setup(robot, 1, 1, False, False, data.gauges.features)
    names = ("geometric", "tracker-range", "encoder-eccentricity:4")
    fitted = fit(at, Model((placing, *(mechanism(name, robot) for name in names))))
    every = np.ones(len(at), bool)
    split = Split(at, every, ~every, np.arange(len(at)) % 5, True)
    geometry = refit_forms(split, fitted).alone["geometry"]
    q = campaign.arm.draw(rng, 300)
    truth = measured(campaign.arm, State(campaign.arm, q), [])
    of_arm = [term for term in fitted.terms if not term.fixture]
    terms = tuple(of_arm[place] for place in geometry.terms)
    left = residuals(Problem(robot, build_measurements(q, truth), tool), terms, geometry.theta)
    assert geometry.estimation_rms_mm is not None
    assert geometry.estimation_rms_mm < 1.1 * np.sqrt(3) * CAMPAIGN_NOISE
    assert miss(truth - left, truth) < 0.05


def test_the_workspace_is_measured_without_it(rng) -> None:
    """What a form leaves out is told of the arm alone."""
    c, _ = calibrated(rng, "tracker-axes", 2e-3)
    made = export(c, "urdf")
    assert all(name.startswith("encoder-eccentricity:4") for name in made.left_out)
    at = sample_workspace(c)
    constant, varying = split_parts(c)
    turning = [part for part in varying if part.mechanism.startswith("encoder")]
    size = compute_points(at, constant + turning) - compute_points(at, constant)
    rms = float(np.sqrt(np.square(size).sum(1).mean()))
    assert made.left_out_mm[0] < 1.2 * rms


@seeds(11)
def test_an_instrument_that_moved_does_not_bend_the_arm(rng) -> None:
    """The move was spread over the geometry where a form has no place for it."""
    nominal = load_robot("ur5")
    arm = disturb(nominal, rng)
    q = arm.draw(rng, ROWS)
    seen = stand(arm, q, 0.0) + rng.normal(0, NOISE_MM, (ROWS, 3))
    seen[ROWS // 2 :] += rng.choice([-1.0, 1.0], 3)
    at = Problem(nominal, build_measurements(q, seen), TOOL, whitening=Whitening(1 / NOISE_MM))
    model = Model((mechanism("geometric", nominal), tracker_step(nominal, 0.4999)))
    fitted = fit(at, model)
    every = np.ones(ROWS, bool)
    split = Split(at, every, ~every, np.arange(ROWS) % 5, True)
    made = calibrate("moved", split, fitted, Floor(NOISE_MM, "stated"), None, False, {})
    made = replace(made, refits=refit_forms(split, fitted))
    urdf = export(made, "urdf")
    robot = read_urdf_text(urdf.text, "file", tip="target")
    elsewhere = arm.draw(rng, 300)
    points = flanges_of(robot, elsewhere)[:, :3, 3]
    assert miss(points, stand(arm, elsewhere, 0.0)) < 0.03
    # the arm is whole in the file; the move is told as what it is, and asked of nobody
    assert (urdf.left_out, max(urdf.left_out_mm)) == ((), pytest.approx(0, abs=0.02))
    assert any(note.startswith("tracker-step says how the instrument") for note in urdf.notes)
    module = export(made, "python")
    assert not any("tracker-step" in note for note in module.notes)
    data = read_module_data(module.text)
    assert "progress" not in data["needs"]
    _, alone = predict_both(data, elsewhere, None, {})
    another_day = made.problem(build_measurements(elsewhere, points))
    np.testing.assert_allclose(alone, predict(made, another_day), atol=1e-9)
