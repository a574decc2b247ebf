"""A payload that hangs elsewhere than at the target, under one joint that yields: planted with exact kinematics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import bind, seeds
from hung_payloads import TOOL, chain, place, wind_up

from modelsel._typing import Array
from modelsel.fitting.design import Model
from modelsel.fitting.least_squares import fit
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.registry import mechanism
from modelsel.notices import Note
from modelsel.robot.files import load_robot
from modelsel.study.pipeline.payload_elsewhere import payload_elsewhere_notes

NOISE_MM = 0.03
ROWS = 90
Rng = np.random.Generator


def note(joint: int, hangs: Array, rng: Rng, *, stated: bool = False) -> tuple[Note, ...]:
    """What is said beside the geometry and the joint's spring under a payload at the target."""
    arm = load_robot(str(rng.choice(["ur5e", "puma760", "irb120"])))
    q = arm.draw(rng, ROWS)
    payload = rng.choice([0.0, 4.0, 8.0], ROWS)
    measured = place(chain(arm, wind_up(arm, [joint], q, payload, hangs))[-1], TOOL)
    noisy = measured + rng.normal(0, NOISE_MM, (ROWS, 3))
    if stated:
        x, y, z = hangs.tolist()
        arm = replace(arm, payload_at_mm=(x, y, z))
    at = bind(arm, build_measurements(q, noisy, covariates={"payload_kg": payload}), TOOL)
    names = ("geometric", f"payload-deflection:{joint}")
    fitted = fit(at, Model(tuple(mechanism(name, arm) for name in names)))
    return payload_elsewhere_notes(at, fitted)


@seeds(1, 2, 3)
@pytest.mark.parametrize("joint", [3, 4])
def test_the_joint_is_told_and_what_to_state(rng: Rng, joint: int) -> None:
    hangs = np.array([*rng.choice([-1, 1], 2) * rng.uniform(200, 300, 2), 80.0])
    (said,) = note(joint, hangs, rng)
    assert said.code == "payload-elsewhere"
    assert f"Joint {joint} that yields" in said.sentence
    assert "payload_at_mm" in said.sentence
    assert not note(joint, hangs, rng, stated=True)


@seeds(1, 2, 3)
@pytest.mark.parametrize("joint", [3, 4])
def test_nothing_is_said_of_one_at_the_target(rng: Rng, joint: int) -> None:
    assert not note(joint, TOOL, rng)
