"""The user's own URDF with new origins, read by Pinocchio and by MuJoCo: within 1e-6 mm of what
modelsel predicts for what the file carries."""

from __future__ import annotations

import numpy as np
import pytest
from own_urdf import OWN, calibrated

from modelsel.calibration.constant_part import (
    compute_points,
    restrict_to_form,
    sample_workspace,
    split_parts,
)
from modelsel.calibration.export import export
from modelsel.robot.urdf import read_urdf_text

MAX_MM = 1e-6
JOINTS = [f"joint_a{k}" for k in range(1, 7)]


@pytest.fixture(scope="module")
def exported():
    """(text, target on the flange [mm], readings, positions in the link world [mm])."""
    arm = read_urdf_text(OWN, "own.urdf", tip="flange")
    c = calibrated(arm, np.random.default_rng(8))
    found = export(c, "urdf")
    (note,) = [note for note in found.notes if note.startswith("target ")]
    target = [float(v) for v in note.partition("= ")[2].removesuffix(" mm").split(", ")]
    at = sample_workspace(c, m=50)
    wanted = compute_points(at, split_parts(restrict_to_form(c, "geometry"))[0])
    assert np.linalg.norm(wanted - compute_points(at, []), axis=1).min() > 0.1  # it is calibrated
    return found.text, np.array(target), at.data.q, wanted


def test_pinocchio(exported) -> None:
    import pinocchio as pin

    text, target, q, wanted = exported
    model = pin.buildModelFromXML(text)
    data, flange = model.createData(), model.getFrameId("flange")
    for readings, x in zip(q, wanted, strict=True):
        state = pin.neutral(model)
        for name, angle in zip(JOINTS, readings, strict=True):
            joint = model.joints[model.getJointId(name)]
            value = [angle] if joint.nq == 1 else [np.cos(angle), np.sin(angle)]
            state[joint.idx_q : joint.idx_q + joint.nq] = value
        pin.framesForwardKinematics(model, data, state)
        place = data.oMf[flange]
        np.testing.assert_allclose(
            place.rotation @ target + place.translation * 1e3, x, rtol=0, atol=MAX_MM
        )


def test_mujoco(exported) -> None:
    import mujoco

    text, target, q, wanted = exported
    model = mujoco.MjModel.from_xml_string(text)
    state = mujoco.MjData(model)
    places = [model.joint(name).qposadr[0] for name in JOINTS]
    for readings, x in zip(q, wanted, strict=True):
        state.qpos[places] = readings
        mujoco.mj_kinematics(model, state)
        body = state.body("flange")
        found = body.xmat.reshape(3, 3) @ target + body.xpos * 1e3
        np.testing.assert_allclose(found, x, rtol=0, atol=MAX_MM)
