"""A calibration on another day: false alarms are as rare as promised, changes are seen and named, a
new set-up is no change."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from builders import drawn, measured, planted, seeds
from click.testing import CliRunner

from modelsel.calibration.calibration import Calibration, calibrate
from modelsel.calibration.calibration_file import calibration_text
from modelsel.calibration.comparison.campaigns import Change, Comparison, compare_campaigns
from modelsel.calibration.comparison.change_sentences import describe_change, write_p
from modelsel.calibration.comparison.comparison_sentences import describe_comparison
from modelsel.calibration.comparison.difference_tests import correct_holm
from modelsel.calibration.comparison.fewest_terms import select_fewest_terms
from modelsel.calibration.prediction import compute_pose, predict, propagate_uncertainty
from modelsel.calibration.validation.validation import judge
from modelsel.calibration.validation.verdict_sentences import describe_verdict as told
from modelsel.cli.main import run_command_line
from modelsel.diagnosis.findings.sentences import format_quantity
from modelsel.exceptions import DataError, StudyError, write_rounded
from modelsel.fitting.design import Model
from modelsel.fitting.least_squares import fit
from modelsel.fitting.noise import Floor
from modelsel.fitting.problem import Problem
from modelsel.fitting.whitening import Whitening
from modelsel.measurements.formats.table import hash_source
from modelsel.measurements.measurements import Measurements
from modelsel.mechanisms.registry import every, mechanism
from modelsel.mechanisms.terms import Screw, Term
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import Robot
from modelsel.robot.rigid import from_rpy
from modelsel.selection.evaluation import Split

NOISE = 0.05
ROBOT = load_robot("puma760")
NAMES = ("geometric", "joint-compliance:2", "approach-backlash:1")


def truth(names: tuple[str, ...] = NAMES) -> tuple[Model, np.ndarray]:
    """A model and what the arm really has: drawn once."""
    model, rng = Model(tuple(mechanism(n, ROBOT) for n in names)), np.random.default_rng(5)
    sizes = {
        "geometric": 0.1,
        "refraction": 0.1,
        "joint-compliance:2": 0.02,
        "approach-backlash:1": 0.02,
        "approach-backlash:3": 0.1,
    }
    return model, np.concatenate(
        [
            rng.uniform(-1, 1, len(m.terms)) * [t.size[1] * sizes[m.name] for t in m.terms]
            if m.name == "geometric"
            else np.array([t.size[1] * sizes[m.name] for t in m.terms])
            for m in model.mechanisms
        ]
    )


def place(model: Model, symbol: str) -> int:
    """Index of the last term of a symbol: the compliance's c2, not the geometry's."""
    return max(k for k, t in enumerate(model.terms) if t.symbol == symbol)


def campaign(rng: np.random.Generator, m: int, model: Model, theta: np.ndarray) -> Measurements:
    at = drawn(ROBOT, rng, m)
    return planted(at, model.terms, theta, rng, NOISE).data


def calibrated(
    rng: np.random.Generator,
    model: Model,
    theta: np.ndarray,
    m: int = 120,
    fitted: Model | None = None,
    floor: Floor | None = None,
    robot: Robot = ROBOT,
    **more: object,
) -> Calibration:
    at = replace(drawn(robot, rng, m, **more), whitening=Whitening(1 / NOISE))
    at = planted(at, model.terms, theta, rng, NOISE)
    rows = np.ones(m, bool)
    return calibrate(
        "drift",
        Split(at, rows, ~rows, np.zeros(m, np.intp), True),
        fit(at, fitted or model),
        floor or Floor(NOISE, "stated"),
        None,
        False,
        {},
    )


@pytest.mark.slow
def test_false_alarms_are_as_rare_as_promised(rng) -> None:
    """p is uniform where nothing changed, registered or not, with the parameters' own uncertainty
    in it (20 configurations)."""
    model, theta = truth()
    p = np.array(
        [
            [judge(c, new, registered).p for registered in (False, True)]
            for c, new in (
                (calibrated(rng, model, theta, 25), campaign(rng, 30, model, theta))
                for _ in range(60)
            )
        ]
    )
    for column in p.T:
        assert 0.3 < column.mean() < 0.7
        assert (column < 0.05).mean() < 0.15
    assert not any(
        judge(calibrated(rng, model, theta), campaign(rng, 40, model, theta), False).drifted
        for _ in range(5)
    )


@pytest.mark.integration
@seeds(1, slow=(2,))
def test_what_was_held_out_holds_the_parameters_uncertainty_already(rng) -> None:
    """Twenty-five configurations fitted, the rms of 400 held out known: what these show beyond noise is
    the parameters' uncertainty, which is not expected twice."""
    model, theta = truth()
    p, factors = [], []
    for _ in range(12):
        c = calibrated(rng, model, theta, 25)
        errors = campaign(rng, 400, model, theta)
        known = judge(c, errors, False).rms_mm
        found = judge(replace(c, held_out_rms_mm=known), campaign(rng, 60, model, theta), False)
        p.append(found.p)
        factors.append(found.whitened_factor)
    assert 0.3 < np.mean(p) < 0.7
    assert np.mean(factors) == pytest.approx(1, abs=0.04)


def test_the_place_of_a_new_target_is_not_expected_as_an_error(rng) -> None:
    """Two targets were calibrated, a third is found from the new data: what is expected is what is
    left once it is found."""
    model, theta = truth()
    one = calibrated(rng, model, theta)
    tools = np.concatenate([one.tools, one.tools + np.array([0.0, 80.0, -30.0])])
    c = replace(one, targets=("a", "b"), tools=tools)
    data = campaign(rng, 40, model, theta)
    found = judge(c, replace(data, targets=("c",)), True)
    assert found.new_targets == ("c",)
    assert not found.drifted
    assert found.factor == pytest.approx(found.whitened_factor, rel=0.1)


def test_measured_orientations_are_told(rng) -> None:
    """They are not judged, and the verdict says by how much they differ."""
    model, theta = truth()
    c = calibrated(rng, model, theta)
    data = campaign(rng, 40, model, theta)
    assert not any("orientation" in sentence for sentence in told(data, judge(c, data, False)))
    nominal = c.problem(replace(data, rotation=np.tile(np.eye(3), (40, 1, 1))))
    rotation = compute_pose(nominal, c.terms, c.theta).rotation.transpose(2, 0, 1)
    turned = replace(data, rotation=rotation @ from_rpy(0.0, 0.1, 0.0))
    found = judge(c, turned, False)
    assert found.turned_rad == pytest.approx(0.1, rel=1e-6)
    assert any("are 100 mrad rms from the calibrated" in line for line in told(data, found))


@pytest.mark.parametrize(("symbol", "by"), [("γ3", 4e-4), ("a4", 0.4), ("c2", 8e-6), ("k1", 3e-4)])
def test_a_change_is_seen(symbol, by, rng) -> None:
    model, theta = truth()
    c = calibrated(rng, model, theta)
    changed = theta.copy()
    changed[place(model, symbol)] += by
    found = judge(c, campaign(rng, 40, model, changed), False)
    assert found.drifted
    assert 1.2 < found.factor < 8


def test_the_factor_is_that_of_the_figures_beside_it(rng) -> None:
    """Where the parameters are poorly known, the test weighs by them, and the quotient is another."""
    model, theta = truth()
    c = calibrated(rng, model, theta, 25)
    changed = theta.copy()
    changed[place(model, "a4")] += 1.0
    data = campaign(rng, 40, model, changed)
    found = judge(c, data, False)
    assert found.factor == found.rms_mm / found.expected_rms_mm
    assert abs(found.whitened_factor / found.factor - 1) > 0.02
    said = told(data, found)[0]
    assert f"a factor of {found.factor:.2f} (p" in said


@pytest.mark.slow
def test_louder_noise_is_no_change(rng) -> None:
    """Three times the noise has no pattern; a change has, beside it or alone."""
    model, theta = truth()
    c = calibrated(rng, model, theta)
    changed = theta.copy()
    changed[place(model, "γ3")] += 2e-3
    alike = 0
    for _ in range(20):
        quiet = campaign(rng, 40, model, changed)
        assert judge(c, quiet, False).drifted
        assert not judge(c, quiet, False).patternless
        for theta_now in (theta, changed):
            at = planted(drawn(ROBOT, rng, 40), model.terms, theta_now, rng, 3 * NOISE)
            found = judge(c, at.data, False)
            assert found.drifted
            if theta_now is changed:
                assert not found.patternless
            else:
                alike += found.patternless
                said = told(at.data, found)[0]
                assert ("No change of the set-up" in said) == found.patternless
                assert ("--register" in said) != found.patternless
    assert alike >= 16


def test_registering_anew_is_no_drift(rng) -> None:
    """Tracker far away and turned, another target: drifted as it stands, valid when registered; a
    bent link is still seen."""
    model, theta = truth()
    c = calibrated(rng, model, theta)
    R, t = from_rpy(0.4, -0.2, 2.0), np.array([2500.0, -800.0, 300.0])
    moved = [Term("o", (Screw(7, "ty"),)), *model.terms]
    at = drawn(ROBOT, rng, 40)
    new = planted(at, moved, np.r_[3.0, theta], rng, NOISE).data
    new = replace(new, position=new.position @ R.T + t)
    new.position[5] += 4.0  # a gross row must not tilt it
    found = judge(c, new, True)
    assert judge(c, new, False).drifted
    assert found.worst == (5,)
    clean = judge(c, new.take(np.arange(40) != 5), True)
    assert not clean.drifted
    assert clean.moved[2] == pytest.approx(3.0, abs=0.1)
    assert clean.moved[1] == pytest.approx(np.arccos((np.trace(R) - 1) / 2), abs=1e-3)
    bent = theta.copy()
    bent[place(model, "α4")] += 2e-3
    new = planted(at, moved, np.r_[3.0, bent], rng, NOISE).data
    assert judge(c, replace(new, position=new.position @ R.T + t), True).drifted
    with pytest.raises(DataError, match="--register needs 4"):
        judge(c, new.take(np.arange(3)), True)


def test_rows_that_a_set_up_fits_exactly_prove_nothing(rng) -> None:
    """Four rows of two targets: twelve coordinates, which tracker and targets follow whatever they
    are."""
    model, theta = truth()
    c = calibrated(rng, model, theta)
    two = replace(c, targets=("A", "B"), tools=c.tools.repeat(2, 0))
    new = campaign(rng, 6, model, theta)
    named = replace(new, targets=("A", "B"), target=np.arange(6) % 2)
    assert not judge(two, named, True).drifted
    four = named.take(np.arange(4))
    said = "4 rows of 2 targets, which --register uses up.* Measure more configurations"
    with pytest.raises(DataError, match=said):
        judge(two, four, True)


def test_the_beam_is_as_long_as_where_the_tracker_now_stands(rng) -> None:
    """Refraction grows with the square of the range: with the tracker five metres further off it is
    another, and no drift."""
    model, theta = truth(("geometric", "refraction"))  # 0.09 mm at 3 m, 0.7 mm at 8 m

    def seen_from(place: tuple[float, float, float], m: int) -> Problem:
        placement = (np.eye(3)[None], np.array([place]))
        at = replace(drawn(ROBOT, rng, m), placement=placement, whitening=Whitening(1 / NOISE))
        return planted(at, model.terms, theta, rng, NOISE)

    at, rows = seen_from((3000.0, 0.0, 0.0), 120), np.ones(120, bool)
    data = Split(at, rows, ~rows, np.zeros(120, np.intp), True)
    c = calibrate("beam", data, fit(at, model), Floor(NOISE, "stated"), None, True, {})
    found = judge(c, seen_from((8000.0, 2000.0, 0.0), 40).data, True)
    assert not found.drifted
    assert found.rms_mm == pytest.approx(NOISE * np.sqrt(3), rel=0.2)
    assert found.moved is not None
    assert found.moved[0] == pytest.approx(np.hypot(5000, 2000), abs=0.3)
    assert found.moved[1] < 4e-5


def test_which_configurations(rng) -> None:
    model, theta = truth()
    c = calibrated(rng, model, theta)
    new = campaign(rng, 60, model, theta)
    far = new.q[:, 1] > np.median(new.q[:, 1])
    new.position[far] += 0.4
    found = judge(c, new, False)
    said = told(new, found)
    assert said[0].startswith("The calibration has drifted")
    middle = np.median(new.q[:, 1])
    assert f"most of it where q2 is above {np.degrees(middle):.3g} deg" in said[0]
    sliding = replace(new, prismatic=(False, True, False, False, False, False))
    assert f"where q2 is above {middle:.3g} mm" in told(sliding, found)[0]
    assert set(found.worst) <= set(np.flatnonzero(far))
    assert f"row {found.worst[0]} (" in said[1]


@pytest.mark.parametrize("changed_by", [0.0, 4e-4])
def test_rows_in_metres_are_no_drift(changed_by, rng) -> None:
    """The verdict waits until the data are right; the factor has no digits that mean nothing. Where
    the arm has changed, too, the rows are counted all the same, and the others are not."""
    model, theta = truth()
    c = calibrated(rng, model, theta)
    changed = theta.copy()
    changed[place(model, "γ3")] += changed_by
    new = campaign(rng, 60, model, changed)
    position = new.position.copy()
    position[10:30] /= 1e3
    mixed = replace(new, position=position)
    for free_setup in (False, True):
        found = judge(c, mixed, free_setup)
        assert found.drifted
        assert "20 rows are in metres, not millimetres (rows 10 to 29, " in found.doubts[-1]
        said = told(new, found)
        assert said[0].startswith("Whether the calibration still holds cannot be said before")
        assert not any("Beyond noise" in line or "a factor" in line for line in said)
    moved = judge(c, replace(new, position=new.position + 100.0), False)
    assert "(p < 1e-12)" in told(new, moved)[0]


def test_errors_where_the_parameters_are_open_count_by_their_size(rng) -> None:
    """Five standard errors in the least certain direction are a small part of T, but most of the
    errors: 'still valid' was said, with a factor of three."""
    model, theta = truth()
    c = calibrated(rng, model, theta, 60)
    widened = c.factor.copy()
    widened[:, 0] *= 20
    c = replace(c, factor=widened)
    at = drawn(ROBOT, rng, 60)
    spread = propagate_uncertainty(c, at)
    _, sizes, directions = np.linalg.svd(spread.reshape(180, -1), full_matrices=False)
    assert sizes[0] > 5 * sizes[1]
    off = spread @ (5.0 * directions[0])
    here = predict(c, at) + rng.normal(0, NOISE, (60, 3))
    assert not judge(c, replace(at.data, position=here), False).drifted
    found = judge(c, replace(at.data, position=here + off), False)
    assert found.drifted
    assert found.by_size
    assert found.factor > 2
    assert found.p < 1e-3


def test_far_beyond_what_was_calibrated_nothing_is_told_of_a_drift(rng) -> None:
    model, theta = truth()
    near = drawn(ROBOT, rng, 60)
    c = calibrated(rng, model, theta)
    low, high = c.ranges["q1"]
    narrow = replace(c, ranges=dict(c.ranges) | {"q1": (low, low + 0.1 * (high - low))})
    shift = np.array([0.8, 0, 0])
    moved = replace(near.data, position=predict(c, near) + shift)
    said = told(moved, judge(narrow, moved, False))[0]
    assert said.startswith("The calibration does not hold for these data:")
    assert "rows lie far beyond what it has seen" in said
    assert told(moved, judge(c, moved, False))[0].startswith("The calibration has drifted:")


@pytest.mark.slow
def test_data_that_cannot_be_of_the_arm_are_refused(rng) -> None:
    """Further from the arm than a quarter of its reach, registered or not: the mistake is named, and
    no drift is told."""
    model, theta = truth()
    c = calibrated(rng, model, theta)
    new = campaign(rng, 40, model, theta)
    turned, metres = replace(new, q=new.q * (1, 1, -1, 1, 1, 1)), new.position / 1e3
    figures = r"\([\d.]+ mm instead of [\d,]+ mm, median\)"
    said = {
        False: rf"40 rows are in metres, not millimetres .* {figures}",
        True: "Wherever the instrument and the target are, the positions fit "
        rf".* {figures} .* are (in )?metres",
    }
    for free_setup in (False, True):
        with pytest.raises(
            DataError, match=r"quarter of the length of the arm's links.*joint 3 turns the other"
        ):
            judge(c, turned, free_setup)
        with pytest.raises(
            DataError, match=rf"quarter of the length of the arm's links.* {said[free_setup]}"
        ):
            judge(c, replace(new, position=metres), free_setup)
    shuffled = replace(new, position=rng.permutation(new.position))
    with pytest.raises(DataError, match="This looks like another arm"):
        judge(c, shuffled, True)


def test_a_mistake_within_a_quarter_of_the_reach_is_said(rng) -> None:
    """A zero that is off by ten degrees may be a slipped joint: said beside the drift."""
    model, theta = truth()
    c = calibrated(rng, model, theta)
    new = campaign(rng, 40, model, theta)
    found = judge(c, replace(new, q=new.q + np.radians((0, 0, 10, 0, 0, 0))), False)
    assert found.drifted
    assert not found.mistaken
    assert "joint 3" in found.doubts[-1]


def test_estimated_noise_is_no_certainty(rng) -> None:
    """With few degrees of freedom behind the floor the same errors are less surprising."""
    model, theta = truth()
    sure, unsure = (
        calibrated(np.random.default_rng(1), model, theta, floor=Floor(NOISE, "estimated", f))
        for f in (np.inf, 5.0)
    )
    new = campaign(rng, 40, model, theta)
    new = measured(
        replace(drawn(ROBOT, rng, 40), data=new), new.position + rng.normal(0, 0.5 * NOISE, (40, 3))
    ).data
    assert judge(sure, new, False).p < judge(unsure, new, False).p


@pytest.mark.parametrize(("by", "drifted"), [(0.0, False), (0.6, True)])
def test_new_data_far_below_an_estimated_noise_are_judged_by_their_own(by, drifted, rng) -> None:
    """Nobody stated the noise: that the data show less of it is no mistake of the study's."""
    model, theta = truth()
    loud = Floor(4 * NOISE, "estimated", 100.0)
    c = calibrated(np.random.default_rng(1), model, theta, floor=loud)
    changed = theta.copy()
    changed[place(model, "a4")] += by
    data = campaign(rng, 40, model, changed)
    found = judge(c, data, False)
    assert found.doubts == ()
    assert found.drifted is drifted
    assert found.quieter is not None
    assert found.quieter == pytest.approx((4 * NOISE, NOISE), rel=0.2)
    said = told(data, found)
    assert not any("stated" in sentence for sentence in said)
    assert "The study estimated a noise of" in said[1]
    sure = replace(c, floor=replace(loud, freedom=np.inf))
    assert judge(sure, data, False).quieter is None


# -- two campaigns
# -------------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_nothing_changed(rng) -> None:
    model, theta = truth()
    alarms = sum(
        bool(compare_campaigns(calibrated(rng, model, theta), calibrated(rng, model, theta)).moved)
        for _ in range(20)
    )
    assert alarms <= 4  # 5 % each: more than 4 of 20 once in 400
    same = calibrated(rng, model, theta)
    assert describe_comparison(compare_campaigns(same, same))[0].startswith(
        "Nothing changed beyond chance"
    )


@pytest.mark.parametrize(
    ("after", "said"),
    [
        (4 * NOISE, "What does not repeat became more"),
        (NOISE / 4, "What does not repeat became less"),
        (1.05 * NOISE, None),
    ],
)
def test_noise_that_changed_is_told(after, said, rng) -> None:
    model, theta = truth()
    c = calibrated(rng, model, theta, floor=Floor(NOISE, "estimated", 100.0))
    other = replace(c, floor=Floor(after, "estimated", 80.0))
    told_of = describe_comparison(compare_campaigns(c, other))
    what = "No parameter" if said else "Nothing"
    assert told_of[0].startswith(f"{what} changed beyond chance")
    found = [one for one in told_of if "does not repeat" in one]
    assert len(found) == bool(said)
    if said:
        assert found[0].startswith(said)
        assert f"{write_rounded(NOISE)} to {write_rounded(after)} mm per coordinate" in found[0]
    stated = replace(other, floor=Floor(after, "stated"))
    assert compare_campaigns(c, stated).noise is None


def test_what_moved_is_named(rng) -> None:
    model, theta = truth()
    changed = theta.copy()
    changed[place(model, "γ3")] += 1e-3
    changed[place(model, "c2")] *= 3
    found = compare_campaigns(calibrated(rng, model, theta), calibrated(rng, model, changed, 90))
    by = {e.symbol: e for e in found.explained_by}
    assert set(by) == {"γ3", "c2"}
    assert by["γ3"].by == pytest.approx(1e-3, abs=4 * by["γ3"].standard_error)
    assert by["c2"].by == pytest.approx(
        2 * theta[place(model, "c2")], abs=4 * by["c2"].standard_error
    )
    assert by["γ3"].moves_mm > 0.3
    assert {m.name: m.what for m in found.mechanisms} == {"joint-compliance:2": "grew"}
    said = " ".join(describe_comparison(found))
    assert "γ3 (frame 3 rz) changed by" in said
    assert "joint-compliance:2 grew" in said


@pytest.mark.parametrize("rng", [0, 2], indirect=True)
def test_a_motion_that_grew_is_told_though_none_of_its_terms_did_beyond_chance(rng) -> None:
    """The compliance of joint 2 under five masses whose moments are alike doubles."""
    (by_mass,) = (
        one for one in every(ROBOT) if one.name == "joint-compliance:2" and len(one.terms) == 5
    )
    geometry, theta = truth(("geometric",))
    model = Model((*geometry.mechanisms, by_mass))
    share = np.array([0.4, 0.1, 0.2, 0.1, 0.2]) * by_mass.terms[0].size[1] * 0.012
    before, after = np.r_[theta, share], np.r_[theta, 2 * share]
    first, second = calibrated(rng, model, before, 60), calibrated(rng, model, after, 60)
    found = compare_campaigns(first, second)
    assert not found.moved
    (only,) = found.mechanisms
    assert (only.name, only.what) == ("joint-compliance:2", "grew")
    assert only.after_mm == pytest.approx(2 * only.before_mm, rel=0.25)
    said = " ".join(describe_comparison(found))
    assert "joint-compliance:2 grew" in said
    assert "Nothing changed" not in said
    assert compare_campaigns(first, calibrated(rng, model, before, 60)).mechanisms == ()


def test_mechanisms_that_appeared_and_disappeared(rng) -> None:
    model, theta = truth()
    other, more = truth(("geometric", "joint-compliance:2", "approach-backlash:3"))
    found = compare_campaigns(calibrated(rng, model, theta), calibrated(rng, other, more))
    assert {m.name: m.what for m in found.mechanisms if m.what in ("appeared", "disappeared")} == {
        "approach-backlash:1": "disappeared",
        "approach-backlash:3": "appeared",
    }


def test_one_motion_under_two_names(rng) -> None:
    """The wind-up of joint 3, found as the catalogue's twist in one campaign and as a cell in the
    other, did not come or go."""
    from modelsel.mechanisms.causes import cos, q
    from modelsel.mechanisms.terms import Mechanism

    twist = Mechanism("joint3-twist", (Term("h", (Screw(3, "rz", cos(q(2) + q(3))),)),))
    cell = Mechanism("cell", (Term("h0", (Screw(3, "rz", cos(q(3) + q(2))),)),))
    geometry, theta = truth(("geometric",))
    a, b = Model((*geometry.mechanisms, twist)), Model((*geometry.mechanisms, cell))
    (only,) = compare_campaigns(
        calibrated(rng, a, np.r_[theta, 1e-3]), calibrated(rng, b, np.r_[theta, 2e-3])
    ).mechanisms
    assert (only.name, only.what) == ("joint3-twist (now cell, which moves the arm alike)", "grew")
    assert only.after_mm == pytest.approx(2 * only.before_mm, rel=0.1)


@pytest.mark.parametrize(("beside_mm", "is_told"), [(0.2, True), (1.0, False)])
def test_two_names_of_motions_that_are_much_alike_may_be_one_error(beside_mm, is_told, rng) -> None:
    """One of them also shifts the target, by less or by more than it has in common with the other."""
    from modelsel.mechanisms.causes import cos, q, sin
    from modelsel.mechanisms.terms import Mechanism

    common = Term("h", (Screw(3, "rz", cos(q(2) + q(3))),))
    beside = Term("h1", (Screw(3, "ty", sin(q(4))),))
    twist, cell = Mechanism("joint3-twist", (common,)), Mechanism("cell", (common, beside))
    geometry, theta = truth(("geometric",))
    a, b = Model((*geometry.mechanisms, twist)), Model((*geometry.mechanisms, cell))
    found = compare_campaigns(
        calibrated(rng, a, np.r_[theta, 1e-3]), calibrated(rng, b, np.r_[theta, 1e-3, beside_mm])
    )
    said = [describe_change(one) for one in found.mechanisms]
    for words, other in zip(said, ("cell of the second", "joint3-twist of the first"), strict=True):
        told = f" It may be the same error as {other}, which moves the target much alike."
        assert words.endswith(told) == is_told, words


@pytest.mark.parametrize("bad", [1, 2])
def test_one_bad_shot_of_a_quick_check_is_no_drift(bad: int, rng) -> None:
    """Of ten rows it is more than a twentieth; two are no longer one bad shot."""
    model, theta = truth()
    new = campaign(rng, 10, model, theta)
    rows = rng.choice(10, bad, replace=False)
    position = new.position.copy()
    position[rows] += 3.0 * rng.choice([-1.0, 1.0], (bad, 3))
    found = judge(calibrated(rng, model, theta), replace(new, position=position), False)
    assert found.drifted == (bad > 1)
    assert found.left_out == (tuple(rows.tolist()) if bad == 1 else ())


@seeds(1, 2, 3)
def test_a_zero_that_no_parameter_shows_alone_is_told(rng) -> None:
    """Of the wrist the data tell combinations: a zero that moved was hidden in the errors of all."""
    geometry, theta = truth(("geometric",))
    moved = theta.copy()
    moved[place(geometry, "γ5")] += rng.choice([-1.0, 1.0]) * rng.uniform(0.7e-3, 1.0e-3)
    found = compare_campaigns(
        calibrated(rng, geometry, theta, 60), calibrated(rng, geometry, moved, 60)
    )
    assert found.together_p < 0.01
    assert found.explained_by
    names = [found.explained_by[0].label, *found.explained_by[0].alike]
    assert "γ5 (frame 5 rz)" in names or any("frame 6" in name for name in names)


@seeds(1, 2)
def test_a_spring_under_two_names_tilts_no_axis(rng) -> None:
    """What the geometry follows of a spring stands in its name in one campaign, in the geometry in the other."""
    robot = load_robot("ur10e")
    spring, bending = (mechanism(name, robot) for name in ("joint-compliance:2", "link-bending:1"))
    geometry = mechanism("geometric", robot)
    theta = np.r_[[rng.normal(0, 0.1 * t.size[1]) for t in geometry.terms], 2e-5]
    planted_by = Model((geometry, spring))
    first = calibrated(rng, planted_by, theta, robot=robot)
    second = calibrated(rng, planted_by, theta, fitted=Model((geometry, bending)), robot=robot)
    found = compare_campaigns(first, second)
    assert next(one.name for one in found.mechanisms).startswith("joint-compliance:2")
    assert found.explained_by == ()
    assert found.moved == ()


def test_a_choice_that_goes_round_in_a_circle_ends() -> None:
    """What each step makes superfluous was chosen again by the next."""
    rng = np.random.default_rng(2)
    for _ in range(200):
        directions = rng.normal(0, 1, (6, 3)) @ np.diag([1.0, 1e-2, 1e-4])
        factor = np.diag([1.0, 1e-2, 1e-4])
        select_fewest_terms(rng.normal(0, 4, 3), factor, directions)


@pytest.mark.parametrize("mean", [3.0, 8.0])
def test_motions_alike_in_what_the_geometry_follows_are_not_called_one(mean, rng) -> None:
    """Two causes of one sign: all that their motions have in common is a turn of joint 3 by a
    constant, by so much that they may be, or would be, one error under two names."""
    from modelsel.mechanisms.causes import cos, q, sin
    from modelsel.mechanisms.terms import Mechanism

    wrist = Mechanism("wrist", (Term("h", (Screw(3, "rz", cos(q(4)) + mean),)),))
    hand = Mechanism("hand", (Term("k", (Screw(3, "rz", sin(q(5)) + mean),)),))
    geometry, theta = truth(("geometric",))
    first = calibrated(rng, Model((*geometry.mechanisms, wrist)), np.r_[theta, 1e-3])
    second = calibrated(rng, Model((*geometry.mechanisms, hand)), np.r_[theta, 1e-3])
    found = compare_campaigns(first, second)
    assert [one.name for one in found.mechanisms] == ["wrist", "hand"]
    said = " ".join(describe_change(one) for one in found.mechanisms)
    assert "alike" not in said


def test_a_drift_within_the_second_campaign_came_and_is_no_change_of_the_geometry(rng) -> None:
    geometry, theta = truth(("geometric",))
    drifting = Model((*geometry.mechanisms, mechanism("tracker-drift", ROBOT)))
    drift = np.array([3.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    still = calibrated(rng, geometry, theta)
    moving = calibrated(rng, drifting, np.r_[theta, drift])
    for pair, what in (((still, moving), "appeared"), ((moving, still), "disappeared")):
        found = compare_campaigns(*pair)
        (only,) = found.mechanisms
        assert (only.name, only.what) == ("tracker-drift", what)
        # evenly from 0 to 3 mm, beyond the constant shift that the geometry follows
        assert max(only.before_mm, only.after_mm) == pytest.approx(3 / np.sqrt(12), rel=0.1)
        assert not found.explained_by


def test_what_the_geometry_follows_cannot_be_compared(rng) -> None:
    """The second day's offset from the first is a shift where one day alone is looked at."""
    from modelsel.mechanisms.causes import Member
    from modelsel.mechanisms.terms import Mechanism

    shift = Mechanism("new-stand", (Term("s", (Screw(1, "tx", Member("group", 0)),)),))
    geometry, theta = truth(("geometric",))
    model = Model((*geometry.mechanisms, shift))
    days = np.repeat(["one", "two"], 60)
    still = calibrated(rng, geometry, theta, group=days)
    moved = calibrated(rng, model, np.r_[theta, 2.0], group=days)
    same = (
        "The geometry, which both have fitted, would move it in the same way, so the two campaigns"
    )
    for pair, campaign in (((still, moved), "second"), ((moved, still), "first")):
        found = compare_campaigns(*pair)
        (only,) = found.mechanisms
        assert (only.what, only.seen_mm, only.only_in) == ("cannot be compared", None, campaign)
        told = describe_comparison(found)[0]
        assert told.startswith(f"new-stand is in the model of the {campaign} campaign only, with ")
        assert f"{same} cannot be compared in it." in told


def test_a_campaign_without_uncertainty_proves_nothing_of_the_other(rng) -> None:
    """Divided by no error, every mechanism would have come."""
    model, theta = truth(("geometric", "joint-compliance:2"))
    other, _ = truth(("geometric",))
    first = calibrated(rng, other, theta[:-1])
    second = calibrated(rng, model, theta)
    exact = replace(second, factor=np.zeros_like(second.factor))
    (only,) = compare_campaigns(first, exact).mechanisms
    assert (only.what, only.seen_mm) == ("may have appeared", None)
    assert "From where on the first would have named it is not known" in describe_change(only)
    empty = replace(only, what="may have disappeared", before_mm=0.0, after_mm=0.0, only_in="first")
    assert "is in the model of the first campaign only, with 0 mm" in describe_change(empty)


@pytest.mark.slow
def test_what_is_named_once_or_twice_is_told_as_far_as_the_evidence_goes(rng) -> None:
    """The same effect under two names did not change, however its two sizes differ; a faint one,
    named in a long campaign alone, may have been there before; and how large a change would have
    been seen is said, and is."""
    from modelsel.mechanisms.causes import cos, q
    from modelsel.mechanisms.terms import Mechanism

    twist = Mechanism("joint3-twist", (Term("h", (Screw(3, "rz", cos(q(2) + q(3))),)),))
    cell = Mechanism("cell", (Term("h0", (Screw(3, "rz", cos(q(3) + q(2))),)),))
    geometry, theta = truth(("geometric",))
    a, b = Model((*geometry.mechanisms, twist)), Model((*geometry.mechanisms, cell))
    found = [
        compare_campaigns(
            calibrated(rng, a, np.r_[theta, 1e-3]), calibrated(rng, b, np.r_[theta, 1e-3])
        )
        for _ in range(10)
    ]
    changed = [c.mechanisms[0].what != "did not change" for c in found]
    assert sum(changed) <= 2
    (only,) = found[changed.index(False)].mechanisms
    said = " ".join(describe_comparison(found[changed.index(False)]))
    assert only.before_mm != only.after_mm
    assert only.p > 0.05
    assert "alike) did not change beyond chance: " in said
    assert "grew" not in said
    assert "shrank" not in said
    assert f"a change of {only.seen_mm:.2g} mm would have been detected" in said
    larger = 1e-3 * (1 + 1.3 * only.seen_mm / only.before_mm)  # beyond what is seen with 90 %
    seen = [
        compare_campaigns(
            calibrated(rng, a, np.r_[theta, 1e-3]), calibrated(rng, b, np.r_[theta, larger])
        )
        for _ in range(10)
    ]
    assert sum(c.mechanisms[0].what == "grew" for c in seen) >= 8

    short, long = calibrated(rng, geometry, theta, 30), calibrated(rng, b, np.r_[theta, 1e-4], 200)
    (faint,) = compare_campaigns(short, long).mechanisms
    assert faint.what == "may have appeared"
    assert faint.seen_mm > faint.after_mm
    assert "so it cannot be said whether it appeared" in " ".join(
        describe_comparison(compare_campaigns(short, long))
    )
    assert compare_campaigns(long, short).mechanisms[0].what == "may have disappeared"
    assert (
        compare_campaigns(
            calibrated(rng, geometry, theta, 30), calibrated(rng, b, np.r_[theta, 2e-3])
        )
        .mechanisms[0]
        .what
        == "appeared"
    )


@pytest.mark.integration
def test_a_change_that_would_have_been_seen_is(rng) -> None:
    model, theta = truth()
    first = calibrated(rng, model, theta)
    same = compare_campaigns(first, calibrated(rng, model, theta))
    typical, high = same.seen_mm
    (own,) = [c for c in same.changes if c.mechanism == "joint-compliance:2"]
    beyond = 2.0 + float(
        np.sqrt(2 * np.log(len(same.changes) / 0.05))
    )  # more than Holm's bound and 90 % ask
    changed = theta.copy()
    changed[place(model, "c2")] += beyond * own.standard_error
    found = [compare_campaigns(first, calibrated(rng, model, changed)) for _ in range(10)]
    assert sum(any(c.mechanism == own.mechanism for c in f.moved) for f in found) >= 8
    per_error = [
        change.moves_mm / abs(change.after - change.before) * change.standard_error
        for change in same.changes
    ]
    assert 4.5 * per_error[same.changes.index(own)] <= 1.1 * high
    assert typical / high == pytest.approx(float(np.median(per_error)) / max(per_error))
    if not same.moved:
        assert f"{high:#.2g} mm (the worst-determined one)" in describe_comparison(same)[-1]


def test_representatives_do_not_matter(rng) -> None:
    """The same arm fitted with its terms in another order keeps others at nought: still nothing
    changed."""
    model, theta = truth()
    first = model.mechanisms[0]
    turned = Model((replace(first, terms=first.terms[::-1]), *model.mechanisms[1:]))
    found = compare_campaigns(
        calibrated(rng, model, theta), calibrated(rng, model, theta, fitted=turned)
    )
    assert min(c.p for c in found.changes) > 1e-3


def test_a_new_set_up_is_left_aside(rng) -> None:
    model, theta = truth()
    shifted = theta.copy()
    shifted[place(model, "a1")] += 1.0
    a, b = calibrated(rng, model, theta), calibrated(rng, model, shifted)
    assert any(c.symbol == "a1" for c in compare_campaigns(a, b).moved)
    anew = compare_campaigns(a, replace(b, registered=True))
    assert not any(c.symbol in ("a1", "a7") for c in anew.changes)
    assert "cannot be compared" in describe_comparison(anew)[-1]


@pytest.mark.parametrize("rng", [1, 2, 3, 4], indirect=True)
def test_a_shift_along_parallel_axes_is_told_as_a_shift(rng) -> None:
    """A turn about joint 1's axis and one of link 1's end do the same, once registered anew: by itself
    the latter would swing the target by several millimetres. What a new placement takes up of the
    shift does not count."""
    robot = load_robot("irb1600")
    model = Model((mechanism("geometric", robot),))
    theta = np.zeros(len(model.terms))
    shifted = theta.copy()
    size = rng.uniform(0.5, 1.0)
    shifted[place(model, "c3")] += size
    days = (calibrated(rng, model, of_day, robot=robot) for of_day in (theta, shifted))
    found = compare_campaigns(*(replace(day, registered=True) for day in days))
    (only,) = found.explained_by
    assert {"c2 (frame 2 tz)", "c3 (frame 3 tz)"} <= {only.label, *only.alike}
    assert abs(only.by) == pytest.approx(size, abs=4 * only.standard_error)
    assert only.unit == "mm"
    assert only.moves_mm < 0.98 * abs(only.by)


def test_another_robot_is_refused(rng) -> None:
    model, theta = truth()
    c = calibrated(rng, model, theta)
    with pytest.raises(StudyError, match="not the same nominal robot"):
        compare_campaigns(c, replace(c, robot=load_robot("ur5")))
    last = ROBOT.last.copy()
    last[2, 3] += 200.0
    another = replace(c, robot=replace(ROBOT, last=last))
    with pytest.raises(StudyError, match="the flange sits elsewhere on the last joint"):
        compare_campaigns(c, another)


def test_holm() -> None:
    np.testing.assert_allclose(
        correct_holm(np.array([0.01, 0.04, 0.03, 0.005])), [0.03, 0.06, 0.06, 0.02]
    )  # Holm 1979's procedure


def test_commands(rng, tmp_path) -> None:
    model, theta = truth()
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "calibration.json").write_text(
            calibration_text(calibrated(rng, model, theta))
        )
    new = campaign(rng, 30, model, theta)
    frame = {f"q{j + 1}_rad": new.q[:, j] for j in range(6)} | dict(
        zip(("x_mm", "y_mm", "z_mm"), new.position.T, strict=True)
    )
    pd.DataFrame(frame).to_csv(tmp_path / "new.csv", index=False)
    ran = CliRunner().invoke(
        run_command_line, ["validate", str(tmp_path / "a"), str(tmp_path / "new.csv")]
    )
    assert ran.exit_code == 0, ran.output
    assert ran.output.startswith("The calibration is still valid within noise")
    assert "made the calibration" not in ran.output
    digest = hash_source(tmp_path / "new.csv")
    own = replace(calibrated(rng, model, theta), provenance={"data_sha256": digest})
    (tmp_path / "b" / "calibration.json").write_text(calibration_text(own))
    ran = CliRunner().invoke(
        run_command_line, ["validate", str(tmp_path / "b"), str(tmp_path / "new.csv")]
    )
    assert "Note: These are the measurements that made the calibration" in ran.output
    pd.DataFrame(frame | {"y_mm": new.position[:, 1] + 1.0}).to_csv(
        tmp_path / "new.csv", index=False
    )
    for more, status in (([], 5), (["--register", "--json"], 0)):
        ran = CliRunner().invoke(
            run_command_line, ["validate", str(tmp_path / "a"), str(tmp_path / "new.csv"), *more]
        )
        assert ran.exit_code == status, ran.output
    assert '"drifted": false' in ran.output
    for more in ([], ["--json"]):
        ran = CliRunner().invoke(
            run_command_line, ["compare", str(tmp_path / "a"), str(tmp_path / "b"), *more]
        )
        assert ran.exit_code == 0, ran.output


def test_words_of_a_comparison(rng) -> None:
    """One list, the largest move first, with expanded uncertainties; other targets are said."""
    model, theta = truth()
    changed = theta.copy()
    changed[place(model, "b4")] += 0.3
    changed[place(model, "a2")] += 0.9
    a, b = calibrated(rng, model, theta), calibrated(rng, model, changed)
    found = compare_campaigns(a, replace(b, tools=b.tools + np.array([0.0, 0.0, 76.0])))
    moves = [one.moves_mm for one in found.explained_by]
    assert len(moves) > 1
    assert moves == sorted(moves, reverse=True)
    said = describe_comparison(found)
    first = found.explained_by[0]
    size = format_quantity(first.by, 2 * first.standard_error, first.unit)
    (told,) = [one for one in said if one.startswith(f"{first.label} changed by")]
    assert f"{size} (k = 2)" in told
    assert any("76.0 mm apart" in one for one in said)
    assert not any("apart" in one for one in describe_comparison(compare_campaigns(a, b)))


@pytest.mark.parametrize(("count", "tested"), [(1, "1 parameter"), (3, "3 parameters")])
def test_the_number_of_parameters_tested(count, tested) -> None:
    change = Change("geometric", "a1", "a1 (frame 1 tx)", "mm", 0.0, 0.0, 0.1, 1.0, 0.0)
    found = Comparison((change,) * count, (), (), (), (0.1, 0.2))
    (said,) = describe_comparison(found)
    assert said.startswith(f"Nothing changed beyond chance ({tested} tested, p = 1 for the most")


def test_change_that_would_have_been_seen_is_of_a_typical_parameter(rng) -> None:
    model, theta = truth()
    same = compare_campaigns(calibrated(rng, model, theta), calibrated(rng, model, theta))
    typical, worst = same.seen_mm
    assert typical < worst
    said = " ".join(describe_comparison(same))
    assert (
        f"would have been detected from {typical:#.2g} mm rms at the target (typical parameter)"
        in said
    )


def test_p_that_is_tiny_is_a_bound() -> None:
    assert write_p(0.0) == "p < 0.001"
    assert write_p(0.02) == "p = 0.02"


def test_a_term_that_moves_nothing_tested_explains_nothing(rng) -> None:
    """A direction of rounding has no length, whatever the other terms leave."""
    directions = np.vstack([rng.normal(size=(3, 4)), 1e-15 * rng.normal(size=4)])
    left = np.linalg.svd(directions[:3])[2][3]
    difference = directions[:3].T @ (2.0, -1.0, 0.5) + 0.05 * left
    steps = select_fewest_terms(difference, 1e-3 * np.eye(4), directions)
    assert sorted(step.term for step in steps) == [0, 1, 2]


def test_two_arms_registered_anew_differ_by_what_arms_differ_by(rng) -> None:
    """All parameters differ, and the set-up with them: no change is larger than what was planted."""
    model, theta = truth()
    other = theta.copy()
    of_geometry = [k for k, term in enumerate(model.terms) if term.unit in ("mm", "rad")]
    other[of_geometry] *= -1
    a, b = (replace(calibrated(rng, model, truth), registered=True) for truth in (theta, other))
    found = compare_campaigns(a, b)
    assert found.explained_by
    assert max(e.moves_mm for e in found.explained_by) < 30
