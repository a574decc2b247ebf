"""What turns under a payload is told as itself and no joint is blamed for it, planted in exact
positions: all that lies beyond a link's end or the flange is turned there by a rotation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import bind, seeds
from exact import flanges_of
from scipy.spatial.transform import Rotation
from searches import find_cause, search_separated

from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.candidates.signatures import LEVELS, PROVEN, list_drivers_by_place
from modelsel.diagnosis.findings.outcome import Diagnosis
from modelsel.diagnosis.rivals.free_functions import generate_other_drivers
from modelsel.diagnosis.rivals.tool_falls import generate_falls
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.diagnosis.shapes.unregistered import build_cell
from modelsel.fitting.design import Model
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.bending import ANYWHERE, AT_TARGET, EACH_AXIS, list_loads
from modelsel.mechanisms.causes import Named, torque
from modelsel.mechanisms.registry import build_mechanisms, every, mechanism
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import Robot

NOISE_MM = 0.02
ROWS = 90
TOOL = np.array([70.0, -110.0, 90.0])
WEIGHT = np.array([0.0, 0.0, -9.81])


def diagnose(arm: Robot, q: np.ndarray, shifted: np.ndarray, payload: np.ndarray) -> Diagnosis:
    """Diagnose an arm whose target was measured somewhere, with payloads."""
    at = bind(arm, build_measurements(q, shifted, covariates={"payload_kg": payload}), TOOL)
    base = Model((mechanism("geometric", arm),))
    return search_separated(at, base, build_candidates(at, base, every(arm)))


def draw(rng: np.random.Generator, *arms: str) -> tuple[Robot, np.ndarray, np.ndarray]:
    names = arms or ("ur5e", "irb120")
    arm = load_robot(names[int(rng.integers(len(names)))])
    return arm, arm.draw(rng, ROWS), rng.choice([0.0, 2.0, 5.0], ROWS)


def place_of(pose: np.ndarray, point: np.ndarray) -> np.ndarray:
    return np.asarray(pose[:, :3, 3] + pose[:, :3, :3] @ point)


def ends_of(arm: Robot, link: int, q: np.ndarray) -> np.ndarray:
    """The poses (m, 4, 4) of a link's far end, where the next joint sits; the flange's of the last."""
    if link == arm.n:
        return flanges_of(arm, q)
    joints = arm.joints[:link]
    upper = replace(arm, joints=joints, last=arm.joints[link].before, coupling=None)
    return flanges_of(upper, q[:, :link])


def bend(
    arm: Robot, q: np.ndarray, moments: np.ndarray, link: int, compliance: np.ndarray
) -> np.ndarray:
    """Turn the target about a link's far end by moments (m, 3) in frame 0, yielding about each of the
    end's axes by a compliance (3,)."""
    ends = ends_of(arm, link, q)
    target = place_of(flanges_of(arm, q), TOOL)
    local = np.einsum("mji,mj->mi", ends[:, :3, :3], moments) * compliance
    turns = Rotation.from_rotvec(np.einsum("mij,mj->mi", ends[:, :3, :3], local))
    return np.asarray(ends[:, :3, 3] + turns.apply(target - ends[:, :3, 3]))


@pytest.mark.slow
@seeds(1)
@pytest.mark.parametrize("load", [AT_TARGET, ANYWHERE, EACH_AXIS])
def test_a_flange_that_a_payload_turns_is_told(load: int, rng: np.random.Generator) -> None:
    arm, q, payload = draw(rng, "ur5e", "ur10e")
    hangs = TOOL if load == AT_TARGET else rng.uniform(-1, 1, 3) * 120.0 + [0.0, 0.0, 80.0]
    axes = np.array([0.0, 1.0, 1.0]) if load == EACH_AXIS else np.ones(3)
    size = rng.uniform(2e-4, 4e-4)
    flange = flanges_of(arm, q)
    lever = (place_of(flange, hangs) - flange[:, :3, 3]) / 1e3
    moments = np.cross(lever, payload[:, None] * WEIGHT)
    shifted = bend(arm, q, moments, arm.n, size * axes) + rng.normal(0, NOISE_MM, (ROWS, 3))
    effect = find_cause(diagnose(arm, q, shifted, payload), f"payload-bending:{arm.n}")
    if load == AT_TARGET:
        assert len(effect.estimate) == 1
        assert effect.estimate[0] == pytest.approx(size, abs=5 * effect.standard_error[0])


@pytest.mark.slow
@seeds(1)
def test_the_end_of_a_link_that_is_at_the_flange_is_named_beside_it(
    rng: np.random.Generator,
) -> None:
    arm, q, payload = draw(rng, "irb120")
    flange = flanges_of(arm, q)
    lever = (place_of(flange, TOOL) - flange[:, :3, 3]) / 1e3
    moments = np.cross(lever, payload[:, None] * WEIGHT)
    size = rng.uniform(2e-4, 4e-4)
    shifted = bend(arm, q, moments, 6, size * np.ones(3)) + rng.normal(0, NOISE_MM, (ROWS, 3))
    (effect,) = diagnose(arm, q, shifted, payload).effects
    assert set(effect.named.sum_by_label()) == {"payload-bending:5", "payload-bending:6"}
    assert effect.claim is not None
    assert effect.claim.levels[LEVELS.index("cause")] < PROVEN


@pytest.mark.slow
@seeds(1, 2)
def test_a_link_that_a_payload_bends_is_not_told_as_the_joint_at_its_end(
    rng: np.random.Generator,
) -> None:
    """Of the forearm's links, whose ends a payload bends about other axes than the next joint's."""
    arm, q, payload = draw(rng)
    link = int(rng.integers(3, 5))
    ends, target = ends_of(arm, link, q), place_of(flanges_of(arm, q), TOOL)
    moments = np.cross((target - ends[:, :3, 3]) / 1e3, payload[:, None] * WEIGHT)
    size = rng.uniform(1e-4, 2e-4)
    shifted = bend(arm, q, moments, link, size * np.ones(3)) + rng.normal(0, NOISE_MM, (ROWS, 3))
    effect = find_cause(diagnose(arm, q, shifted, payload), f"payload-bending:{link}")
    assert effect.estimate[0] == pytest.approx(size, abs=5 * effect.standard_error[0])


@pytest.mark.slow
@seeds(1, 2)
def test_a_joint_that_a_payload_winds_up_keeps_its_cause(rng: np.random.Generator) -> None:
    arm, q, payload = draw(rng)
    joint = int(rng.integers(4, 6))
    ends, target = ends_of(arm, joint - 1, q), place_of(flanges_of(arm, q), TOOL)
    moments = np.cross((target - ends[:, :3, 3]) / 1e3, payload[:, None] * WEIGHT)
    turned = q.copy()
    turned[:, joint - 1] += 1e-4 * np.einsum("mi,mi->m", moments, ends[:, :3, 2])
    shifted = place_of(flanges_of(arm, turned), TOOL) + rng.normal(0, NOISE_MM, (ROWS, 3))
    find_cause(diagnose(arm, q, shifted, payload), f"payload-deflection:{joint}")


@pytest.mark.slow
@seeds(1, 2)
def test_a_target_that_falls_across_the_flange_is_told_with_its_direction(
    rng: np.random.Generator,
) -> None:
    arm, q, payload = draw(rng)
    angle = np.radians(5.0 * int(rng.integers(36)))
    across = np.array([np.cos(angle), np.sin(angle), 0.0])
    flange = flanges_of(arm, q)
    along = flange[:, :3, :3] @ across
    shift = rng.uniform(0.1, 0.2) * np.where(along[:, 2] < 0, 1.0, -1.0)[:, None] * along
    shifted = place_of(flange, TOOL) + shift + rng.normal(0, NOISE_MM, (ROWS, 3))
    effects = diagnose(arm, q, shifted, payload).effects
    falls = [one for one in effects if one.candidate.kind is CandidateKind.FALL]
    assert len(falls) == 1
    (claim,) = [one.claim for one in falls]
    assert claim is not None
    assert claim.levels[LEVELS.index("shape")] >= PROVEN
    degrees = float(falls[0].candidate.mechanism.name.rpartition(" ")[2].rstrip("°"))
    off = abs(degrees - np.degrees(angle))
    assert min(off, 180 - off) <= 10


def test_a_fall_is_offered_beside_what_moves_the_target_or_the_last_joint_with_gravity() -> None:
    arm = load_robot("ur5e")
    q = arm.draw(np.random.default_rng(1), 20)
    at = bind(arm, build_measurements(q, np.zeros((20, 3))), TOOL)
    for place, cause, offered in (
        ((7, "tx"), Named("down_x"), True),
        ((7, "tx"), torque(6), True),
        ((6, "rz"), torque(6), True),
        ((5, "tx"), torque(4), True),
        ((3, "rz"), torque(3), False),
        ((7, "tx"), Named("q6"), False),
    ):
        assert bool(list(generate_falls(at, build_cell(place, (cause,))))) is offered


def test_loads_are_weighed_at_the_flange_alone() -> None:
    arm = load_robot("irb120")
    flange = (AT_TARGET, ANYWHERE, EACH_AXIS)
    assert [list_loads(arm, link) == flange for link in range(1, 7)] == [False] * 5 + [True]
    for link in range(1, 6):
        (term, *_) = build_mechanisms(f"payload-bending:{link}:0", arm)[0].terms
        assert {f"torque{link + 1}_7"} < set().union(*(one.cause.names() for one in term.screws))
    assert build_mechanisms("payload-bending", replace(arm, gravity=None)) == ()


def test_what_never_changes_is_no_driver() -> None:
    """The target's place on the flange is among the causes, and nothing depends on it."""
    arm = load_robot("ur5e")
    for bending in build_mechanisms("payload-bending:6", arm):
        assert any(name.startswith("on_flange") for name in bending.names())
        drivers = list_drivers_by_place(Candidate(bending, CandidateKind.MECHANISM, 1.0))
        assert frozenset[str]().union(*drivers.values()) <= {
            "payload_kg",
            "down_x",
            "down_y",
            "down_z",
        }


def test_no_rival_turns_a_target_whose_orientation_is_not_measured() -> None:
    rng = np.random.default_rng(1)
    arm, q, payload = draw(rng, "ur5e")
    data = build_measurements(q, np.zeros((ROWS, 3)), covariates={"payload_kg": payload})
    at = bind(arm, data, TOOL)
    for bending in build_mechanisms("payload-bending:6", arm):
        others = [m for group in generate_other_drivers(at, bending) for m in group]
        assert others
        places = {place for one in others for place in one.names_by_place()}
        assert places == {(7, "tx"), (7, "ty"), (7, "tz")}


@pytest.mark.slow
@seeds(1, 2)
def test_a_payload_pulls_alike_whichever_target_is_measured(rng: np.random.Generator) -> None:
    """Three reflectors beside what hangs on the flange: one torque a posture, and no joint is told not to
    repeat."""
    arm = load_robot("irb120")
    q = arm.draw(rng, ROWS)
    payload = rng.choice([0.0, 2.0, 5.0], ROWS)
    tools = TOOL + rng.uniform(-150, 150, (3, 3))
    hangs = tools.mean(0)
    joint = int(rng.integers(2, 4))
    shoulder = ends_of(arm, joint - 1, q)
    lever = (place_of(flanges_of(arm, q), hangs) - shoulder[:, :3, 3]) / 1e3
    torque_of = np.cross(lever, payload[:, None] * WEIGHT)
    about = np.einsum("mi,mi->m", torque_of, shoulder[:, :3, 2])
    size = rng.uniform(1.5e-5, 3e-5)
    wound = q.copy()
    wound[:, joint - 1] += size * about
    flange = flanges_of(arm, wound)
    seen = np.stack([place_of(flange, tool) for tool in tools], axis=1).reshape(-1, 3)
    shifted = seen + rng.normal(0, NOISE_MM, seen.shape)
    data = build_measurements(
        np.repeat(q, 3, axis=0),
        shifted,
        target=np.tile(["a", "b", "c"], ROWS),
        covariates={"payload_kg": np.repeat(payload, 3)},
    )
    at = bind(arm, data, tools)
    base = Model((mechanism("geometric", arm),))
    diagnosis = search_separated(at, base, build_candidates(at, base, every(arm)))
    effect = find_cause(diagnosis, f"payload-deflection:{joint}")
    assert effect.estimate[0] == pytest.approx(size, abs=5 * effect.standard_error[0])
    assert not [part.name for part in diagnosis.errors.parts if part.name.startswith("joint")]


@seeds(1)
def test_a_flange_turns_alike_whichever_target_is_measured(rng: np.random.Generator) -> None:
    """By the moment of what hangs at the mean of all targets; each of them shifts by its own lever."""
    arm = load_robot("irb120")
    q = np.repeat(arm.draw(rng, 10), 3, axis=0)
    payload = rng.uniform(1, 5, 30)
    tools = TOOL + rng.uniform(-150, 150, (3, 3))
    target = np.tile([0, 1, 2], 10)
    data = build_measurements(
        q, np.zeros((30, 3)), target=target, covariates={"payload_kg": payload}
    )
    at = bind(arm, data, tools)
    flange = flanges_of(arm, q)[:, :3, :3]
    pull = np.einsum("mji,mj->mi", flange, payload[:, None] * WEIGHT)
    turn = np.cross(tools.mean(0) / 1e3, pull)
    shift = np.cross(turn, tools[target])
    (term,) = build_mechanisms("payload-bending:6", arm)[AT_TARGET].terms
    found = {screw.axis: at.cause(screw.cause) for screw in term.screws}
    for kind, wanted in (("r", turn), ("t", shift)):
        for k, axis in enumerate("xyz"):
            np.testing.assert_allclose(found[f"{kind}{axis}"], wanted[:, k], atol=1e-9)


@seeds(1)
def test_a_base_tilts_alike_whichever_target_is_measured(rng: np.random.Generator) -> None:
    arm = load_robot("irb120")
    q = np.repeat(arm.draw(rng, 10), 2, axis=0)
    tools = TOOL + rng.uniform(-150, 150, (2, 3))
    target, payload = np.tile([0, 1], 10), np.full(20, 3.0)
    data = build_measurements(
        q, np.zeros((20, 3)), target=target, covariates={"payload_kg": payload}
    )
    at = bind(arm, data, tools)
    lever = place_of(flanges_of(arm, q), tools.mean(0))
    moment = 3.0 * np.cross(lever, [0.0, 0.0, -1.0])
    for k, term in enumerate(mechanism("payload-tilt", arm).terms):
        np.testing.assert_allclose(at.cause(term.screws[0].cause), moment[:, k], atol=1e-9)
