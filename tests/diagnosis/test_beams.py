"""A link that bends all along is told as that, and no link or joint before it is blamed: planted in exact
positions, by the curvature of a beam summed up along its length, under masses times lever arms."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bent_links import bend, line_of
from builders import bind, seeds
from exact import flanges_of
from held_loads import WEIGHT, frame_of, place_of
from scipy.spatial.transform import Rotation
from searches import find_cause, search_separated

from modelsel._typing import Array
from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.candidates.nested_loads import find_nested_loads
from modelsel.diagnosis.candidates.signatures import number_forms
from modelsel.diagnosis.findings.outcome import Diagnosis
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.fitting.design import Model
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.bending import (
    AT_TARGET,
    BEAM,
    OF_EACH,
    OF_EACH_TWISTED,
    OF_MAIN,
    TUBE,
    list_bendings,
    list_loads,
)
from modelsel.mechanisms.compliance import DECLARED, UNKNOWN, WITH_PAYLOAD
from modelsel.mechanisms.registry import build_mechanisms, every, mechanism
from modelsel.robot.files import load_robot
from modelsel.robot.gravity import declares_masses
from modelsel.robot.kinematics import Robot

NOISE_MM = 0.02
ROWS = 100
TOOL = np.array([60.0, -50.0, 80.0])
# kg
RATED = {"irb120": 3.0, "ur5e": 5.0, "ur10e": 12.0}
Rng = np.random.Generator


def load_end(arm: Robot, link: int, q: Array, payload: Array) -> tuple[Array, Array, Array]:
    """Poses of a link's far end, and the moment [N m] and force [N] (m, 3) there in its axes: of the masses
    beyond it, and of a payload at the target."""
    joint = arm.joints[link]
    end = frame_of(arm, link, q) @ joint.before
    places = [place_of(flanges_of(arm, q), TOOL)]
    masses = [payload]
    for k in range(link + 1, arm.n + 1):
        if declares_masses(arm):
            one = arm.joints[k - 1]
            places.append(place_of(frame_of(arm, k, q), np.array(one.com)))
            masses.append(np.full(len(q), one.mass or 0.0))
        else:
            later = k + 1
            there = place_of(flanges_of(arm, q), TOOL)
            if later <= arm.n:
                there = frame_of(arm, later, q)[:, :3, 3]
            places.append(there)
            masses.append(np.ones(len(q)))
    moment, force = np.zeros((2, len(q), 3))
    for place, mass in zip(places, masses, strict=True):
        pull = mass[:, None] * WEIGHT
        moment += np.cross((place - end[:, :3, 3]) / 1e3, pull)
        force += pull
    turned = end[:, :3, :3]
    return end, np.einsum("mji,mj->mi", turned, moment), np.einsum("mji,mj->mi", turned, force)


def move_target(
    arm: Robot, link: int, q: Array, payload: Array, numbers: tuple[float, float]
) -> Array:
    """Places of the target of an arm of which one link bends with a compliance, and twists so many
    times as much."""
    size, twist = numbers
    end, moment, force = load_end(arm, link, q, payload)
    turn, shift = bend(line_of(arm, link), moment, force, twist)
    axes = end[:, :3, :3]
    turned = Rotation.from_rotvec(np.einsum("mij,mj->mi", axes, size * turn))
    shifted = np.einsum("mij,mj->mi", axes, size * shift)
    lever = place_of(flanges_of(arm, q), TOOL) - end[:, :3, 3]
    return np.asarray(end[:, :3, 3] + shifted + turned.apply(lever))


def diagnose(arm: Robot, q: Array, payload: Array | None, seen: Array, rng: Rng) -> Diagnosis:
    measured = seen + rng.normal(0, NOISE_MM, seen.shape)
    covariates = {} if payload is None else {"payload_kg": payload}
    at = bind(arm, build_measurements(q, measured, covariates=covariates), TOOL)
    base = Model((mechanism("geometric", arm),))
    return search_separated(at, base, build_candidates(at, base, every(arm)))


def draw(rng: Rng) -> tuple[Robot, Array, Array, int]:
    """An arm with its masses, readings, a payload of each, and the upper arm."""
    name = str(rng.choice(list(RATED)))
    arm = load_robot(name)
    payload = RATED[name] * rng.choice([0.0, 0.4, 1.0], ROWS)
    return arm, arm.draw(rng, ROWS), payload, 2


def size_for(arm: Robot, link: int, q: Array, payload: Array, millimetres: float) -> float:
    """The compliance with which a link that bends moves the target so far (rms)."""
    straight = move_target(arm, link, q, payload, (0.0, 0.0))
    moved = move_target(arm, link, q, payload, (1e-6, 1.3)) - straight
    return float(millimetres * 1e-6 / np.sqrt(np.square(moved).sum(1).mean()))


@pytest.mark.slow
@seeds(1, 2)
@pytest.mark.parametrize("twist", [1.3, 0.2])
def test_a_link_that_bends_is_one_finding(twist: float, rng: Rng) -> None:
    """Under its own weight and the payload; as a tube, and where it is stiff against twist."""
    arm, q, payload, link = draw(rng)
    size = size_for(arm, link, q, payload, float(rng.uniform(0.3, 0.5)))
    seen = move_target(arm, link, q, payload, (size, twist))
    effect = find_cause(diagnose(arm, q, payload, seen, rng), f"link-bending:{link}")
    assert effect.estimate[0] == pytest.approx(size, abs=5 * effect.standard_error[0])


@pytest.mark.slow
@seeds(1, 2)
def test_a_link_that_bends_under_its_own_weight_is_one_finding(rng: Rng) -> None:
    arm, q, payload, link = draw(rng)
    size = size_for(arm, link, q, 0 * payload, float(rng.uniform(0.3, 0.5)))
    seen = move_target(arm, link, q, 0 * payload, (size, 1.3))
    effect = find_cause(diagnose(arm, q, None, seen, rng), f"link-bending:{link}")
    assert effect.estimate[0] == pytest.approx(size, abs=5 * effect.standard_error[0])


def twist_of(at: Problem, link: int, number: int, name: str) -> Array:
    """What one form of a mechanism does to a link's end, with all its numbers 1: (m, 6)."""
    one = build_mechanisms(f"{name}:{link}:{number}", at.robot)[0]
    done = {axis: np.zeros(len(at)) for axis in ("rx", "ry", "rz", "tx", "ty", "tz")}
    for term in one.terms:
        for screw in term.screws:
            assert screw.frame == link + 1
            done[screw.axis] = done[screw.axis] + at.cause(screw.cause)
    return np.stack(list(done.values()), axis=1)


@seeds(1)
@pytest.mark.parametrize("name", ["irb120", "ur10e", "puma760"])
def test_the_end_of_a_beam_moves_as_the_sum_of_its_curvature_says(name: str, rng: Rng) -> None:
    arm = load_robot(name)
    q, payload = arm.draw(rng, 20), rng.uniform(0, 5, 20)
    at = bind(
        arm, build_measurements(q, np.zeros((20, 3)), covariates={"payload_kg": payload}), TOOL
    )
    for link in range(1, arm.n):
        if TUBE not in list_bendings(arm, link):
            continue
        length = line_of(arm, link)
        _, moment, force = load_end(arm, link, q, 0 * payload)
        _, held, pull = load_end(arm, link, q, payload)
        for number, twist in ((TUBE, 1.3), (BEAM, 1.0)):
            own = np.hstack(bend(length, moment, force, twist))
            both = np.hstack(bend(length, held, pull, twist))
            of_own = twist_of(at, link, number + DECLARED, "link-bending")
            of_held = twist_of(at, link, number, "payload-bending")
            np.testing.assert_allclose(of_own, own, atol=1e-4 * np.abs(own).max())
            np.testing.assert_allclose(of_held, both - own, atol=1e-4 * np.abs(both).max())
            if declares_masses(arm):
                of_both = twist_of(at, link, number + WITH_PAYLOAD, "link-bending")
                np.testing.assert_allclose(of_both, of_own + of_held)


def test_short_links_turn_at_their_end_alone() -> None:
    arm = load_robot("puma760")
    joints = list(arm.joints)
    before = joints[2].before.copy()
    before[:3, 3] *= 49 / np.linalg.norm(before[:3, 3])
    joints[2] = replace(joints[2], before=before)
    short = replace(arm, joints=tuple(joints))
    assert list_bendings(short, 2) == (DECLARED, UNKNOWN)
    assert list_loads(short, 2) == (AT_TARGET,)
    unknown = (OF_EACH, OF_MAIN, OF_EACH_TWISTED)
    assert list_bendings(arm, 2) == (DECLARED, UNKNOWN, TUBE, BEAM, *unknown)
    assert list_loads(arm, 2) == (AT_TARGET, TUBE, BEAM)


@pytest.mark.parametrize(("ahead", "upright"), [(0, True), (300, True), (300, False)])
def test_a_link_that_holds_a_slide_bends_where_the_slide_is_upright(
    tmp_path: Path, ahead: int, upright: bool
) -> None:
    """With a twist of its own where it is not upright itself."""
    lines = ['name = "column"', 'source = "drawing"', "gravity = [0, 0, -1]"]
    lines += ["[[joint]]", "xyz_mm = [0, 0, 200]", f"axis = {[0, 0, 1]}", "mass_kg = 20"]
    axis = [0, 0, 1] if upright else [1, 0, 0]
    lines += ["[[joint]]", f"xyz_mm = [{ahead}, 0, 500]", f"axis = {axis}", 'kind = "prismatic"']
    lines += ["limits_mm = [0, 400]", "mass_kg = 10", "com_mm = [150, 0, 0]"]
    lines += ["[[joint]]", "xyz_mm = [300, 0, 0]", "axis = [0, 1, 0]", "mass_kg = 2"]
    lines += ["com_mm = [50, 0, 0]"]
    file = tmp_path / "robot.toml"
    file.write_text("\n".join([*lines, "[last]", "xyz_mm = [80, 0, 0]"]), encoding="utf-8")
    arm = load_robot(file)
    forms = set(list_bendings(arm, 1)) - {DECLARED, UNKNOWN, WITH_PAYLOAD}
    tubes, beams = {TUBE, TUBE + WITH_PAYLOAD}, {BEAM, BEAM + WITH_PAYLOAD}
    allowed = (tubes | beams if ahead else tubes) if upright else set[int]()
    assert forms == allowed
    assert len(list_loads(arm, 1)) == 1 + upright * (1 + bool(ahead))
    for name in ("link-bending:1", "payload-bending:1"):
        for one in build_mechanisms(name, arm):
            assert all(term.screws for term in one.terms)


def test_springs_of_a_link_are_one_model_in_three_names_form_by_form() -> None:
    arm = load_robot("ur5e")
    bent = build_mechanisms("link-bending:2", arm)
    of_link = dict(zip(list_bendings(arm, 2), bent, strict=True))
    held = build_mechanisms("payload-bending:2", arm)
    of_load = dict(zip(list_loads(arm, 2), held, strict=True))
    each = []
    for form in (0, TUBE, BEAM):
        each += [of_link[form + DECLARED], of_load[form], of_link[form + WITH_PAYLOAD]]
    loads = find_nested_loads([Candidate(one, CandidateKind.MECHANISM, 0.1) for one in each])
    for first in (0, 3, 6):
        own, load, whole = range(first, first + 3)
        assert loads.tell_apart([own, whole]) == (own, load)
        assert loads.list_other_names(own, [load, own]).tolist() == [whole]
    assert loads.tell_apart([0, 5]) == (0, 5)


def test_forms_of_a_link_that_bends_say_the_same_of_it() -> None:
    """Its own weight, that with the payload, and the payload are told apart; how it bends is not, though the
    forms move it in other ways."""
    arm = load_robot("ur10e")
    forms = [one for one in every(arm) if one.name in ("link-bending:2", "payload-bending:2")]
    found = [Candidate(one, CandidateKind.MECHANISM, 0.1) for one in forms]
    loads = [(one.stem, "payload_kg" in one.names()) for one in forms]
    places = {frozenset(one.names_by_place()) for one in forms}
    assert len(places) > 1
    numbers = number_forms(found).tolist()
    assert len(set(zip(loads, numbers, strict=True))) == len(set(loads)) == len(set(numbers)) == 3
    assert min(numbers) == 0
    assert number_forms([replace(found[0], kind=CandidateKind.CELL)]).tolist() == [-1]
