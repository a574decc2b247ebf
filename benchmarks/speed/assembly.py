"""The design matrix, 3m x 43: against Pinocchio's regressor called per configuration, and against
filling the same bytes."""

from __future__ import annotations

import time
from math import copysign, cos

import numpy as np

from modelsel.fitting.design import assemble
from modelsel.fitting.reduction import STREAM
from modelsel.robot._kernels import Workspace
from modelsel.robot.kinematics import Robot

from .timing import TOOL, arm_scene, interleaved

M, PEER = 10_000, 500


def pinocchio(robot: Robot) -> object:
    """Pinocchio's model of the same chain, metres."""
    import pinocchio as pin

    model, parent = pin.Model(), 0
    for k, joint in enumerate(robot.joints):
        parent = model.addJoint(
            parent,
            pin.JointModelRZ(),
            pin.SE3(joint.before[:3, :3], joint.before[:3, 3] / 1e3),
            f"j{k}",
        )
    return model


def run() -> dict[str, float]:
    import pinocchio as pin

    problem, model = arm_scene(M)
    terms, space = model.terms, Workspace()
    parts = [part for _, part in problem.parts(STREAM)]
    chain = pinocchio(problem.robot)
    data, tool = chain.createData(), pin.SE3(np.eye(3), TOOL / 1e3)
    world = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    q = problem.data.q[:PEER].copy()
    A, peer = np.empty((44, 3, M)), np.empty((PEER, 3, 43))

    def regressor() -> None:
        """The same 43 columns of each configuration: 36 of the links, 3 of the target, 4 of flexure
        and backlash."""
        for row, out in zip(q, peer):
            pin.forwardKinematics(chain, data, row)
            out[:, :36] = pin.computeJointKinematicRegressor(chain, data, 6, world, tool)[:3]
            out[:, 36:39] = data.oMi[6].rotation
            c23, c2 = cos(row[1] + row[2]), cos(row[1])
            out[:, 39], out[:, 40], out[:, 41] = out[:, 11] * c23, out[:, 11] * c2, out[:, 17] * c23
            out[:, 42] = out[:, 17] * copysign(1.0, c23)

    def ours() -> None:
        for part in parts:
            assemble(part, terms, space=space)

    def fill() -> None:
        A[:43] = 1.0

    ours()
    seconds = interleaved({"ours": ours, "fill": fill, "pinocchio": regressor}, 9)
    return {
        "assembly_vs_pinocchio": seconds["pinocchio"] / PEER / (seconds["ours"] / M),
        "assembly_of_fill": seconds["fill"] / seconds["ours"],
        "assembly_ns_per_configuration": seconds["ours"] / M * 1e9,
    }


def growth() -> list[tuple[int, float]]:
    """(configurations, seconds) of assembling."""
    out = []
    for m in (200, 2_000, 20_000, 200_000):
        problem, model = arm_scene(m)
        start, space = time.process_time(), Workspace()
        for _, part in problem.parts(STREAM):
            assemble(part, model.terms, space=space)
        out.append((m, time.process_time() - start))
    return out
