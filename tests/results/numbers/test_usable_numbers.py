"""Usable numbers against the chain itself: readings are moved by the error, and the target is looked at."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from builders import bind, drawn
from builders import one as one_screw

from modelsel.diagnosis.shapes.unregistered import build_cell
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.causes import Applied, Bump, Named, cos, q, sin, torque
from modelsel.mechanisms.environment import temperature_rise
from modelsel.mechanisms.registry import build_mechanisms, every, mechanism
from modelsel.mechanisms.terms import Mechanism, Screw, Term
from modelsel.results.conclusions.finding_figures import find_worst, find_worst_turn
from modelsel.results.numbers.effect_sizes import measure_sizes
from modelsel.results.numbers.quantities import express, format_figure
from modelsel.results.numbers.usable_numbers import list_usable
from modelsel.results.numbers.workspace import (
    Fitted,
    Range,
    Workspace,
    build_workspace,
    find_longest,
)
from modelsel.robot.files import builtin_names, load_robot
from modelsel.robot.gravity import compute_joint_torques
from modelsel.robot.kinematics import Robot, forward, pose

ARM = load_robot("ur10")
TOOL = np.array([60.0, -40.0, 120.0])
UNITS = {"arcsec", "mrad", "mm", "ppm", "ppm/K", "N m/rad"}
PARTS = ("gear", "encoder", "bearing", "drive", "spring", "belt", "tracker", "backlash", "friction")


def test_of_equal_places_the_first_is_the_worst() -> None:
    """Where an effect moves the target alike, rounding does not choose the place."""
    length = np.array([0.5, 1.0, 1.0 + 1e-15, 1.0 - 1e-15])
    assert find_longest(np.outer([0.6, 0.0, 0.8], length)) == 1


def workspace_of(arm: Robot = ARM, rows: int = 60) -> Workspace:
    at = drawn(arm, np.random.default_rng(5), rows, TOOL)
    return build_workspace(at, np.random.default_rng(6))


def fitted(one: Mechanism, *estimate: float, error: float = 0.05, arm: Robot = ARM) -> Fitted:
    theta = np.array(estimate)
    return Fitted(one.terms, theta, np.diag(np.square(error * theta)), workspace_of(arm))


def numbers(one: Mechanism, effect: Fitted) -> dict[str, tuple[float, str]]:
    return {u.quantity: (u.value, u.unit) for u in list_usable(one, effect)}


def moved_by(effect: Fitted, joint: int, by: np.ndarray | float) -> np.ndarray:
    """How far the target moves at every row where a joint stands off its reading."""
    q = effect.workspace.q.copy()
    q[:, joint - 1] += by
    return np.linalg.norm(forward(ARM, q, TOOL) - forward(ARM, effect.workspace.q, TOOL), axis=1)


# -- quantities
# --------------------------------------------------------------------------------------------------


def test_play_is_the_whole_step_and_its_millimetres_are_those_of_the_wrist() -> None:
    one = mechanism("approach-backlash:2", ARM)
    effect = fitted(one, -1e-4)
    got = numbers(one, effect)
    assert got["play"] == (pytest.approx(2e-4 * 180 / np.pi * 3600), "arcsec")
    q = effect.workspace.q
    turned = q.copy()
    turned[:, 1] += 2e-4
    wrist = pose(ARM, turned, TOOL).origins[4] - pose(ARM, q, TOOL).origins[4]
    largest = np.linalg.norm(wrist, axis=0).max()
    assert got["play at the wrist"] == (pytest.approx(largest, rel=1e-4), "mm")
    turn, moved = (one.text for one in list_usable(one, effect))
    assert turn.endswith("of play from side to side, or 41.3 arc seconds")
    assert moved.endswith("at the wrist from side to side")


def test_a_joint_of_the_wrist_has_its_play_at_the_target() -> None:
    one = mechanism("approach-backlash:6", ARM)
    effect = fitted(one, -1e-4)
    assert numbers(one, effect)["play at the target"][0] == pytest.approx(
        moved_by(effect, 6, 2e-4).max(), rel=1e-4
    )


@pytest.mark.parametrize("least", [0.0, -1.0])
@pytest.mark.parametrize(
    "one",
    [
        mechanism("approach-backlash:2", ARM),
        one_screw(2, "tz", Named("approach1")),
        mechanism("overshoot:1", ARM),
    ],
)
def test_a_side_that_was_not_measured_is_not_told(one: Mechanism, least: float) -> None:
    """Of a direction that no row has, the difference to the other is not known."""
    space = workspace_of()
    data = space.problem.data
    sides = np.where(np.arange(len(data)) % 10, 1.0, least)[:, None] * np.ones(ARM.n)
    data = replace(data, approach=sides)
    space = replace(space, problem=replace(space.problem, data=data))
    effect = Fitted(one.terms, np.full(len(one.terms), 1e-4), np.eye(len(one.terms)), space)
    assert bool(list_usable(one, effect)) == (least < 0)


@pytest.mark.parametrize(
    ("size", "unit", "words"),
    [
        (46.0, "arcsec", "amplitude 0.223 mrad (95 %: 0.213 to 0.233)"),
        (0.041, "mrad", "amplitude 41.0 µrad (95 %: 39.2 to 42.8)"),
        (2.06, "mrad", "amplitude 2.06 mrad (95 %: 1.97 to 2.15)"),
        (0.411, "mm", "amplitude 0.411 mm (95 %: 0.393 to 0.429)"),
    ],
)
def test_words_tell_an_angle_as_the_sentence_of_the_finding_does(size, unit, words) -> None:
    """In the unit that its size asks for; the number keeps its own."""
    usable = express("amplitude", Range(size, 0.956 * size, 1.044 * size), unit)
    assert usable.text == words
    assert (usable.value, usable.unit) == (size, unit)


def test_a_figure_far_below_its_interval_has_the_unit_of_that() -> None:
    small = express("wind-up", Range(421e-6, 0.0, 67.5e-3), "mrad")
    assert small.text == "wind-up 0.421 µrad (95 %: 0 to 67.5)"


def test_the_ends_of_a_narrow_interval_are_told_apart() -> None:
    narrow = express("amplitude", Range(1.41, 1.4095, 1.4104), "mm")
    assert narrow.text == "amplitude 1.41 mm (95 %: 1.409 to 1.410)"
    assert express("amplitude", Range(1.41, 1.41, 1.41), "mm").text == "amplitude 1.41 mm"


def test_ripple_has_its_amplitude_and_its_worst_at_the_target() -> None:
    one = build_mechanisms("gear-ripple:3:17", ARM)[0]
    effect = fitted(one, 3e-5, 4e-5)
    got = numbers(one, effect)
    assert got["amplitude"] == (pytest.approx(5e-5 * 180 / np.pi * 3600), "arcsec")
    angle = effect.workspace.q[:, 2]
    by = 3e-5 * np.sin(17 * angle) + 4e-5 * np.cos(17 * angle)
    assert got["amplitude at the target"][0] == pytest.approx(
        moved_by(effect, 3, by).max(), rel=1e-3
    )


def test_compliance_is_wind_up_at_full_stretch_and_one_stiffness() -> None:
    """Of an arm whose masses are known: 1 / c, with the ends of c's interval the other way round."""
    one = build_mechanisms("joint-compliance:2", ARM)[0]
    effect = fitted(one, 2e-5)
    usable = {u.quantity.partition(" (")[0]: u for u in list_usable(one, effect)}
    q = effect.workspace.q
    torque = np.abs(compute_joint_torques(ARM, pose(ARM, q, TOOL), q)[1])
    wound = usable["wind-up of joint 2 at full stretch"]
    assert wound.value == pytest.approx(2e-5 * torque.max() * 1e3)
    assert f"({torque.max():.0f} N m)" in wound.quantity
    there = usable["wind-up of joint 2 at full stretch, at the target"].value
    row = int(torque.argmax())
    assert there == pytest.approx(moved_by(effect, 2, 2e-5 * torque)[row], rel=1e-2)
    stiffness = usable["stiffness"]
    assert stiffness.unit == "N m/rad"
    assert stiffness.value == pytest.approx(1 / 2e-5)
    assert stiffness.low == pytest.approx(1 / (2e-5 * (1 + 1.96 * 0.05)))
    assert stiffness.high == pytest.approx(1 / (2e-5 * (1 - 1.96 * 0.05)))


def test_a_spring_under_weight_and_payload_has_its_stiffness_where_both_together_are_largest() -> (
    None
):
    one = build_mechanisms("joint-compliance:2", ARM)[-1]
    effect = fitted(one, 2e-5)
    workspace = effect.workspace
    q, problem = workspace.q, workspace.problem
    own = compute_joint_torques(ARM, pose(ARM, q, TOOL), q)[1]
    held = problem.value("payload_kg") * problem.value("torque2_7")
    largest = np.abs(own + held).max()
    usable = {u.quantity.partition(" (")[0]: u for u in list_usable(one, effect)}
    wound = usable["wind-up of joint 2 under the arm's weight and the payload at full stretch"]
    assert wound.value == pytest.approx(2e-5 * largest * 1e3)
    assert f"({format_figure(float(largest))} N m)" in wound.quantity
    assert "stiffness" not in usable
    assert usable["stiffness with the arm's masses as declared"].value == pytest.approx(1 / 2e-5)


def test_an_arm_whose_masses_are_all_zero_has_no_stiffness() -> None:
    """As files have them whose author knew none: its torques are those of 1 kg everywhere."""
    massless = tuple(replace(joint, mass=0.0) for joint in ARM.joints)
    one = build_mechanisms("joint-compliance:3", ARM)[0]
    effect = fitted(one, 2e-5)
    arm = replace(ARM, joints=massless)
    problem = replace(effect.workspace.problem, robot=arm)
    there = replace(effect, workspace=replace(effect.workspace, problem=problem))
    usable = list_usable(one, there)
    assert not [number for number in usable if number.quantity.startswith("stiffness")]
    assert "the robot file gives no masses" in " ".join(number.text for number in usable)


def test_without_one_of_the_masses_that_a_joint_carries_it_has_no_stiffness() -> None:
    """A torque without that mass is none in N m; that of a joint beyond the link is."""
    joints = list(ARM.joints)
    joints[2] = replace(joints[2], mass=None)
    arm = replace(ARM, joints=tuple(joints))
    for joint in (3, 5):
        one = build_mechanisms(f"joint-compliance:{joint}", ARM)[0]
        effect = fitted(one, 2e-5)
        problem = replace(effect.workspace.problem, robot=arm)
        there = replace(effect, workspace=replace(effect.workspace, problem=problem))
        usable = list_usable(one, there)
        has_stiffness = any(number.quantity == "stiffness" for number in usable)
        told = " ".join(number.text for number in usable)
        assert has_stiffness == (joint == 5)
        assert ("does not give all masses" in told) == (joint == 3)
        assert ("N m" in told) == (joint == 5)


def test_two_functions_of_one_torque_have_the_size_of_their_sum_and_no_stiffness() -> None:
    """At the largest torque that was measured, with the covariance of both."""
    load = torque(2)
    both = build_cell((2, "rz"), (load, load * Applied("abs", load)))
    workspace = workspace_of()
    q = workspace.q
    seen = np.abs(compute_joint_torques(ARM, pose(ARM, q, TOOL), q)[1])
    row = int(seen[: workspace.measured].argmax())
    largest = seen[row]
    theta = np.array([4e-3, -3e-3 / largest]) / largest
    shares = np.array([largest, largest**2])
    spread = np.diag(0.1 * theta)
    correlation = np.array([[1.0, 0.9], [0.9, 1.0]])
    covariance = spread @ correlation @ spread
    effect = Fitted(both.terms, theta, covariance, workspace)
    angle, moved = list_usable(both, effect)
    half = 1.96 * np.sqrt(shares @ covariance @ shares) * 1e3
    assert angle.unit == "mrad"
    assert (angle.value, angle.low, angle.high) == pytest.approx((1.0, 1.0 - half, 1.0 + half))
    assert f"({largest:.3g} N m)" in angle.text
    massless = replace(ARM, joints=tuple(replace(joint, mass=None) for joint in ARM.joints))
    assert "N m" not in list_usable(both, replace(effect, workspace=workspace_of(massless)))[0].text
    assert moved.value == pytest.approx(moved_by(effect, 2, 1e-3)[row], rel=1e-2)


def test_a_stiffness_whose_compliance_may_be_none_has_no_upper_end() -> None:
    one = build_mechanisms("joint-compliance:2", ARM)[0]
    stiffness = list_usable(one, fitted(one, 2e-5, error=1.0))[-1]
    assert stiffness.high is None
    assert "at least" in stiffness.text


def test_a_bent_flange_has_its_turn_and_its_stiffness_where_the_payload_hangs_at_the_target() -> (
    None
):
    """By the lever of the target about the flange's place."""
    known, anywhere, _ = build_mechanisms("payload-bending:6", ARM)
    effect = fitted(known, 2e-4)
    workspace = effect.workspace
    lever = forward(ARM, workspace.q, TOOL) - forward(ARM, workspace.q, np.zeros(3))
    across = np.hypot(lever[:, 0], lever[:, 1]) / 1e3
    moment = 9.81 * across * workspace.problem.value("payload_kg")
    usable = {u.quantity.partition(" (")[0]: u for u in list_usable(known, effect)}
    turned = usable["turn of the flange under the payload"]
    assert turned.value == pytest.approx(2e-4 * moment.max() * 1e3)
    assert f"({format_figure(moment.max())} N m)" in turned.quantity
    assert usable["stiffness"].value == pytest.approx(1 / 2e-4)
    units = {u.unit for u in list_usable(anywhere, fitted(anywhere, 1e-4, 1e-4, 1e-4))}
    assert units == {"mrad", "mm"}


def test_the_end_of_a_link_that_a_payload_bends_has_its_stiffness() -> None:
    (end,) = build_mechanisms("payload-bending:3:0", ARM)
    turned, *_, stiffness = list_usable(end, fitted(end, 1e-5))
    assert turned.quantity.startswith("turn of the end of link 3 under the payload (")
    assert stiffness.value == pytest.approx(1e5)


def test_no_stiffness_is_said_of_an_arm_without_masses() -> None:
    joints = tuple(replace(joint, mass=None) for joint in ARM.joints)
    arm = replace(ARM, joints=joints)
    one = build_mechanisms("joint-compliance:2", arm)[0]
    usable = list_usable(one, fitted(one, 2e-5, arm=arm))
    assert {u.unit for u in usable} == {"mrad", "mm"}
    assert usable[0].text.endswith("(no stiffness: the robot file gives no masses)")


def test_growth_is_told_per_10_kelvin_with_its_reference() -> None:
    one = mechanism("thermal-growth:2", ARM)
    got = numbers(one, fitted(one, 12e-6))
    length = np.linalg.norm(ARM.joints[2].before[:3, 3])
    assert got["expansion"] == (pytest.approx(12.0), "ppm/K")
    growth = got["growth of the link per 10 K, counted from 20 °C"]
    assert growth == (pytest.approx(12e-6 * length * 10), "mm")
    assert got["at the target per 10 K, counted from 20 °C"][0] == pytest.approx(growth[0])


def test_a_curve_is_told_from_its_lowest_to_its_highest_point_where_it_was_measured() -> None:
    centres = np.arange(-7, 8) * 0.5
    terms = tuple(
        Term(f"f{k}", (Screw(1, "rz", Bump("q1", c, 0.5)),)) for k, c in enumerate(centres)
    )
    one = Mechanism("free(q1) 29", terms)
    effect = fitted(one, *np.sin(centres * 1.7) * 1e-4)
    seen = effect.workspace.q[: effect.workspace.measured, 0]
    curve = sum(1e-4 * np.sin(c * 1.7) * Bump("q1", c, 0.5).shape(seen) for c in centres)
    got = numbers(one, effect)["peak to peak"]
    assert got == (pytest.approx(np.ptp(curve) * 180 / np.pi * 3600), "arcsec")


@pytest.mark.parametrize(
    ("axis", "cause", "expected"),
    [
        ("tx", Named("approach3"), {"difference between the two directions": (4e-3, "mm")}),
        (
            "ry",
            Named("approach3"),
            {"difference between the two directions": (4e-3 * 180 / np.pi * 3600, "arcsec")},
        ),
        # from half a rad ahead on the one side to the other
        ("tx", Named("drag1_500", "rad"), {"difference between the two directions": (2e-3, "mm")}),
        (
            "tz",
            temperature_rise(23.0),
            {
                "per 10 K, counted from 23 °C": (2e-2, "mm"),
                "at the target per 10 K, counted from 23 °C": (2e-2, "mm"),
            },
        ),
        # 10 K that have lasted
        (
            "tz",
            temperature_rise(23.0, lag=25),
            {
                "per 10 K, counted from 23 °C": (2e-2, "mm"),
                "at the target per 10 K, counted from 23 °C": (2e-2, "mm"),
            },
        ),
        ("tz", temperature_rise(23.0) * q(2), {}),
        ("tz", Named("approach3") * q(2), {}),
        ("tz", q(2), {}),
    ],
)
def test_a_place_without_a_name_has_numbers_where_its_driver_has(axis, cause, expected) -> None:
    place = one_screw(4, axis, cause)
    got = numbers(place, fitted(place, 2e-3))
    assert got == {key: (pytest.approx(value), unit) for key, (value, unit) in expected.items()}


def test_a_shift_of_the_target_is_told_by_kelvin_or_kilogram() -> None:
    warm = mechanism("thermal-shift", ARM)
    (shift,) = list_usable(warm, fitted(warm, 0.02, -0.01, 0.02))
    assert (shift.value, shift.unit) == (pytest.approx(0.3), "mm")
    assert shift.text.endswith("per 10 K, counted from 20 °C")
    loaded = mechanism("payload-shift", ARM)
    got = numbers(loaded, fitted(loaded, 0.03, 0.0, -0.04))
    assert got == {"shift on the flange by 1 kg": (pytest.approx(0.05), "mm")}


def test_a_step_of_the_target_is_its_whole_shift() -> None:
    step = build_mechanisms("target-step:0.5", ARM)[0]
    assert numbers(step, fitted(step, 0.3, 0.4, 0.0)) == {"shift": (pytest.approx(0.5), "mm")}


@pytest.mark.integration
@pytest.mark.parametrize("name", builtin_names())
def test_every_mechanism_has_numbers_in_known_units_and_words_without_a_part(name: str) -> None:
    arm = load_robot(name)
    at = bind(arm, drawn(arm, np.random.default_rng(1), 30, TOOL).data, TOOL)
    workspace = build_workspace(at, np.random.default_rng(2))
    seen = {m.name: m for m in reversed(every(arm)) if m.name != "geometric"}
    for one in seen.values():
        theta = np.array([1e-5 * (t.sign or 1) for t in one.terms])
        effect = Fitted(one.terms, theta, np.diag(theta**2) / 100, workspace)
        usable = list_usable(one, effect)
        is_free = one.stem in ("refraction", "payload-tilt", "counterbalance")
        assert bool(usable) != is_free, one.name
        assert {u.unit for u in usable} <= UNITS
        assert all(u.low is None or u.low <= u.value for u in usable)
        assert one.usual_causes, one.name
        said = one.sentence.lower()
        assert not [part for part in PARTS if part in said], one.sentence


# -- the workspace
# --------------------------------------------------------------------------------------------------


def test_the_worst_is_where_the_chain_moves_most_and_the_same_every_time() -> None:
    one = mechanism("encoder-scale:2", ARM)
    effect = fitted(one, 1e-4)
    worst = find_worst(effect)
    angle = effect.workspace.q[:, 1]
    moved = moved_by(effect, 2, 1e-4 * angle)
    assert worst.moved.value == pytest.approx(moved.max(), rel=2e-3)
    assert np.radians(worst.readings) == pytest.approx(effect.workspace.q[moved.argmax()])
    assert find_worst(fitted(one, 1e-4)) == worst
    margin = 1.96 * 0.05 * worst.moved.value
    assert worst.moved.high - worst.moved.value == pytest.approx(margin)


def test_configurations_are_drawn_within_limits_or_where_the_arm_was_measured() -> None:
    joints = list(ARM.joints)
    joints[0] = replace(joints[0], limits=(-0.5, 0.25))
    joints[1] = replace(joints[1], limits=None)
    arm = replace(ARM, joints=tuple(joints))
    rng = np.random.default_rng(3)
    q = rng.uniform(-0.1, 0.1, (40, 6))
    at = bind(arm, build_measurements(q, forward(arm, q, TOOL)), TOOL)
    workspace = build_workspace(at, rng)
    assert (workspace.q[:40] == q).all()
    drawn_ones = workspace.q[40:]
    low, high = drawn_ones.min(0), drawn_ones.max(0)
    assert -0.5 <= low[0] < -0.49
    assert 0.24 < high[0] <= 0.25
    assert low[1] >= q[:, 1].min()
    assert high[1] <= q[:, 1].max()
    worst = find_worst(
        Fitted(
            mechanism("encoder-scale:1", arm).terms, np.array([1e-3]), np.zeros((1, 1)), workspace
        )
    )
    assert 1 in worst.beyond
    assert "beyond the measured range of joint" in worst.text


@pytest.mark.parametrize(
    ("name", "estimate"),
    [
        ("gear-eccentricity:2", (1e-4, 1e-4)),
        ("zero-step:2", (1e-3,)),
        ("joint-compliance:2", (1e-5,)),
    ],
)
def test_a_number_of_readings_that_nobody_measured_says_so(name, estimate) -> None:
    """Of a posture within the measured range nothing is said."""
    rng = np.random.default_rng(3)
    q = rng.uniform(-0.1, 0.1, (40, 6))
    at = bind(ARM, build_measurements(q, forward(ARM, q, TOOL)), TOOL)
    far = build_workspace(at, rng)
    near = replace(far, problem=far.problem.take(np.arange(40)))
    one = mechanism(name, ARM)
    said = []
    for workspace in (far, near):
        effect = Fitted(one.terms, np.array(estimate), np.eye(len(estimate)) * 1e-14, workspace)
        texts = [
            number.text for number in list_usable(one, effect) if "at the target" in number.text
        ]
        assert texts
        said.append({"beyond the measured range of joints" in text for text in texts})
    assert said == [{True}, {False}]


def test_an_effect_that_only_turns_the_target_has_its_worst_in_mrad() -> None:
    """About an axis of the target's own frame: the amplitude of the turn, and no displacement."""
    turn = one_screw(7, "rx", sin(q(3)))
    effect = fitted(turn, 2e-3)
    still, turned = find_worst(effect), find_worst_turn(effect)
    assert still.moved == Range(0.0, 0.0, 0.0)
    assert still.text == "the target's position does not change"
    largest = np.abs(np.sin(effect.workspace.q[:, 2])).max()
    assert turned.moved.value == pytest.approx(2.0 * largest)
    assert turned.moved.low == pytest.approx(2.0 * largest * (1 - 1.96 * 0.05))
    assert turned.describe()["mrad"] == turned.moved.value
    assert turned.text.startswith("at most 2.00 mrad (95 %: 1.80 to 2.20) of the target's orientat")


def test_a_joint_turns_the_target_by_its_own_error() -> None:
    effect = fitted(mechanism("encoder-scale:2", ARM), 1e-4)
    turned = find_worst_turn(effect)
    assert turned.moved.value == pytest.approx(0.1 * np.abs(effect.workspace.q[:, 1]).max())


def test_a_shift_turns_nothing() -> None:
    turned = find_worst_turn(fitted(one_screw(4, "tz", q(2)), 1.0))
    assert turned.text == "the target's orientation does not change"


def test_no_usable_number_is_zero_mm_at_the_target() -> None:
    wave = (Screw(7, "rx", sin(q(3))),), (Screw(7, "rx", cos(q(3))),)
    only_turns = Mechanism("wave", tuple(Term(f"m{k}", of) for k, of in enumerate(wave)))
    assert set(numbers(only_turns, fitted(only_turns, 1e-3, 1e-3))) == {"amplitude"}


# -- sizes
# --------------------------------------------------------------------------------------------------


def three_effects() -> tuple[list[Fitted], tuple[Term, ...]]:
    """Two that move the target alike, and a small one; the base's terms."""
    workspace = workspace_of()
    scale, wave, small = (
        mechanism(name, ARM)
        for name in ("encoder-scale:2", "gear-eccentricity:4", "approach-backlash:5")
    )
    effects = []
    for one, theta in ((scale, [2e-4]), (scale, [3e-4]), (wave, [1e-3, 2e-3]), (small, [-1e-6])):
        estimate = np.array(theta)
        effects.append(Fitted(one.terms, estimate, np.zeros((len(theta),) * 2), workspace))
    return effects, mechanism("geometric", ARM).terms


def beyond(own: list[Fitted], others: list[Fitted], base: Sequence[Term]) -> float:
    """By least squares on the measured rows."""
    rows = own[0].workspace.measured
    moved = sum(one.moved()[:, :rows].reshape(-1) for one in own)
    columns = np.concatenate([own[0].workspace.displace(base), *(one.columns for one in others)])[
        :, :, :rows
    ]
    X = columns.reshape(len(columns), -1).T
    X = X / np.linalg.norm(X, axis=0)
    left = moved - X @ np.linalg.lstsq(X, moved, rcond=1e-10)[0]
    return float(np.sqrt(np.square(left).sum() / rows))


def test_of_two_that_stand_for_each_other_one_stays_and_small_ones_are_set_aside() -> None:
    effects, base = three_effects()
    sizes = measure_sizes(effects, base, 0.01)
    assert sizes.matters.tolist() in ([True, False, True, False], [False, True, True, False])
    kept = [one for one, matters in zip(effects, sizes.matters, strict=True) if matters]
    small = [one for one, matters in zip(effects, sizes.matters, strict=True) if not matters]
    assert sizes.small_rms == pytest.approx(beyond(small, kept, base), rel=1e-3)
    for one, rms in zip(effects, sizes.rms, strict=True):
        others = [other for other in kept if other is not one]
        assert rms == pytest.approx(beyond([one], others, base), rel=1e-3, abs=1e-5)


def test_what_is_above_the_threshold_matters() -> None:
    effects, base = three_effects()
    assert measure_sizes(effects[1:], base, 1e-9).matters.all()
    assert not measure_sizes(effects[1:], base, 1e3).matters.any()


def test_effects_have_their_sizes_without_a_base() -> None:
    effects, _ = three_effects()
    assert measure_sizes(effects[1:], (), 1e-9).matters.all()


def test_what_only_turns_the_target_matters_by_how_far_it_turns_it() -> None:
    """Beyond the base in mrad; of no size and no matter where no orientation was measured."""
    effects, base = three_effects()
    turn = one_screw(7, "rx", sin(q(3)))
    effects = [*effects[1:], Fitted(turn.terms, np.array([2e-3]), np.eye(1), effects[0].workspace)]
    assert measure_sizes(effects, base, 0.01).matters.tolist() == [True, True, False, False]
    sizes = measure_sizes(effects, base, 0.01, mm_per_rad=1000.0)
    assert sizes.matters.tolist() == [True, True, False, True]
    assert sizes.rms[-1] == pytest.approx(0.0, abs=1e-9)
    assert sizes.rms.tolist()[:2] == pytest.approx(measure_sizes(effects, base, 0.01).rms[:2])
    workspace = effects[0].workspace
    rows = workspace.measured
    X = workspace.turn_target(base)[:, :, :rows].reshape(len(base), -1).T
    turned = effects[-1].turned()[:, :rows].reshape(-1)
    left = turned - X @ np.linalg.lstsq(X, turned, rcond=1e-10)[0]
    assert sizes.rms_rad[-1] == pytest.approx(np.sqrt(np.square(left).sum() / rows))
    assert sizes.rms_rad[-1] > 1e-3
    assert measure_sizes(effects, base, 0.01, mm_per_rad=1.0).matters.tolist()[-1] is False


def test_a_shape_of_the_data_is_told_where_it_was_measured() -> None:
    """Beyond, where a joint's limits reach further than the readings, it is nobody's."""
    rng = np.random.default_rng(5)
    at = drawn(ARM, rng, 60, TOOL)
    narrow = at.take(np.flatnonzero(np.abs(at.data.q[:, 1]) < 1.0))
    workspace = build_workspace(narrow, rng)
    growing = mechanism("encoder-scale:2", ARM)
    size = np.array([1e-3]), np.eye(1) * 1e-10
    everywhere = Fitted(growing.terms, *size, workspace)
    measured = Fitted(growing.terms, *size, workspace, reaches=False)
    assert everywhere.find_worst() >= workspace.measured
    assert measured.find_worst() < workspace.measured
    assert measured.find_worst_turn() < workspace.measured
    assert (
        measured.moved_at(measured.find_worst()).value
        < everywhere.moved_at(everywhere.find_worst()).value
    )


def test_axes_that_are_not_square_are_told_by_their_angles() -> None:
    one = mechanism("tracker-axes", ARM)
    size = dict(zip((t.symbol for t in one.terms), (2e-4, 1e-4, 1e-4, 0.0, 2e-4), strict=True))
    told = numbers(one, fitted(one, *size.values()))
    assert told["scale along x"] == (pytest.approx(200), "ppm")
    angle, unit = told["x and y off a right angle"]
    assert (angle, unit) == (pytest.approx(np.degrees(2 * size["gxy"]) * 3600), "arcsec")


@pytest.mark.parametrize(("name", "words"), [("transit", "axes off a right"), ("index", "off by")])
def test_an_angle_of_an_instrument_is_told_in_arc_seconds(name: str, words: str) -> None:
    one = mechanism(f"tracker-{name}", ARM)
    ((quantity, told),) = numbers(one, fitted(one, -1e-4)).items()
    assert words in quantity
    assert told == (pytest.approx(np.degrees(1e-4) * 3600), "arcsec")


def test_waves_of_an_angle_and_a_beam_beside_the_axes_are_told_by_their_length() -> None:
    wave, beam = mechanism("tracker-azimuth", ARM), mechanism("tracker-offset", ARM)
    of_wave, of_beam = numbers(wave, fitted(wave, 3e-4, -4e-4)), numbers(beam, fitted(beam, 3, 4))
    amplitude = of_wave["amplitude of the angle's error"]
    assert amplitude == (pytest.approx(np.degrees(5e-4) * 3600), "arcsec")
    assert of_beam == {"beam beside the axes": (pytest.approx(5.0), "mm")}


def test_a_reflectors_error_is_told_of_distances_that_were_measured() -> None:
    one = mechanism("reflector-incidence", ARM)
    effect = fitted(one, *np.linspace(0.1, 0.4, len(one.terms)))
    ((value, unit),) = numbers(one, effect).values()
    measured = effect.moved()[:, : effect.workspace.measured]
    assert unit == "mm"
    assert value == pytest.approx(np.linalg.norm(measured, axis=0).max())


@pytest.mark.parametrize("name", ["approach-backlash:2", "encoder-scale:5", "settle:3"])
def test_only_the_worst_is_told_as_at_most(name: str) -> None:
    """A second "at most" beside that of the worst said nothing of how the two differ."""
    one = mechanism(name, ARM)
    texts = [number.text for number in list_usable(one, fitted(one, -1e-4))]
    assert texts
    assert not any("at most" in text for text in texts)


@pytest.mark.parametrize(("sign", "side"), [(1, "long"), (-1, "short")])
def test_distances_are_too_long_or_too_short_by_their_sign(sign: int, side: str) -> None:
    one = mechanism("tracker-range", ARM)
    effect = fitted(one, sign * 0.1)
    (number,) = list_usable(one, effect)
    assert number.text.startswith(f"every distance too {side} by 0.100 mm")
