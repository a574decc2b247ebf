"""Other programs agree: Pinocchio (of the extra `bench`) on poses, screw fields and gravity,
scikit-learn on cross-validation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import drawn

from modelsel.fitting.design import Model, compute_design
from modelsel.fitting.least_squares import fit
from modelsel.mechanisms.registry import mechanism
from modelsel.mechanisms.terms import Screw, Term
from modelsel.robot.files import builtin_names, load_robot
from modelsel.robot.gravity import compute_joint_torques
from modelsel.robot.kinematics import Robot, pose
from modelsel.selection.cross_validation import cross_validate, fold
from modelsel.selection.moments import LinearRows
from modelsel.selection.splits import assign_folds

TOOL = np.array([40.0, -25.0, 100.0])


def pinocchio(robot: Robot):
    """(the library, the same chain in metres and kilograms)."""
    pin = pytest.importorskip("pinocchio", reason="pip install 'modelsel[bench]'")
    model, parent = pin.Model(), 0
    model.gravity.linear = 9.81 * np.array(
        robot.gravity if robot.gravity is not None else (0.0, 0.0, -1.0)
    )
    for k, joint in enumerate(robot.joints):
        place = pin.SE3(joint.before[:3, :3], joint.before[:3, 3] / 1e3)
        parent = model.addJoint(
            parent, pin.JointModelPZ() if joint.prismatic else pin.JointModelRZ(), place, f"j{k}"
        )
        if joint.mass:
            body = pin.Inertia(joint.mass, np.array(joint.com) / 1e3, np.eye(3) * 1e-3)
            model.appendBodyToJoint(parent, body, pin.SE3.Identity())
    return pin, model


@pytest.mark.parametrize("name", builtin_names())
def test_poses_and_screw_fields_are_pinocchios(name, rng) -> None:
    """The target, and its displacement per unit of every screw of every joint's frame, from
    Pinocchio's kinematic regressor."""
    at = drawn(name, rng, 6, tuple(TOOL))
    robot = at.robot
    pin, model = pinocchio(robot)
    data, n = model.createData(), robot.n
    fixed = robot.last.copy()
    fixed[:3, 3] += fixed[:3, :3] @ TOOL
    flange = pin.SE3(fixed[:3, :3], fixed[:3, 3] / 1e3)
    scale = [1e-3 if j.prismatic else 1.0 for j in robot.joints]
    terms = [
        Term(f"{k}{axis}", (Screw(k, axis),))
        for k in range(1, n + 1)
        for axis in ("tx", "ty", "tz", "rx", "ry", "rz")
    ]
    columns, _ = compute_design(at, terms)
    position = pose(robot, at.data.q, TOOL).target.T
    for row, q in enumerate(at.data.q * scale):
        pin.forwardKinematics(model, data, q)
        np.testing.assert_allclose(
            (data.oMi[n] * flange).translation * 1e3, position[row], atol=1e-9 * robot.reach
        )
        theirs = pin.computeJointKinematicRegressor(
            model, data, n, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED, flange
        )[:3]
        theirs = theirs * np.tile([1, 1, 1, 1e3, 1e3, 1e3], n)
        np.testing.assert_allclose(columns[row], theirs, atol=1e-9 * robot.reach)


def test_gravity_is_pinocchios(rng) -> None:
    """Torques of the file's masses about every joint, to 1e-9 N m; the sign is that of the load,
    not of the drive."""
    robot = load_robot("puma560")
    pin, model = pinocchio(robot)
    data, q = model.createData(), robot.draw(rng, 8)
    found = compute_joint_torques(robot, pose(robot, q, np.zeros(3)), q)
    for row, angles in enumerate(q):
        np.testing.assert_allclose(
            -found[:, row], pin.computeGeneralizedGravity(model, data, angles), atol=1e-9
        )


def test_cross_validation_is_scikit_learns(rng) -> None:
    """Held-out residuals of a whole robot's model, by configuration, without a refit: those of
    LeaveOneGroupOut with one."""
    from sklearn.linear_model import LinearRegression
    from sklearn.model_selection import LeaveOneGroupOut, cross_val_predict

    at = drawn("puma760", rng, 50)
    model = Model((mechanism("geometric", at.robot), mechanism("joint-compliance:3", at.robot)))
    fitted = fit(at, model, held="nothing")
    kept, fold_of = list(fitted.found.kept), assign_folds(at.data, 10, rng)
    X, r = compute_design(at, model.terms, fitted.at())
    scale = np.linalg.norm(X, axis=(0, 1))[kept]
    A, y, groups = (
        X[:, :, kept].reshape(150, -1) / scale,
        r.ravel() + rng.normal(0, 0.1, 150),
        np.repeat(fold_of, 3),
    )
    theirs = y - cross_val_predict(
        LinearRegression(fit_intercept=False), A, y, groups=groups, cv=LeaveOneGroupOut()
    )
    moved = at.data.position + (y - r.ravel()).reshape(-1, 3)
    noisy = replace(at, data=replace(at.data, position=moved))
    found = cross_validate(fold(noisy, model.terms, fold_of, fitted.at()), kept)
    ours = LinearRows(noisy, model.terms, fitted.at()).held_out(fold_of, found.without)
    np.testing.assert_allclose(ours.ravel(), theirs, atol=1e-7)
