"""An arm in a rigid-body engine (mujoco): masses, springs in drives and base, gravity; nothing of
the tool's."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from hidden_arm import Arm, moved

STEPS = 30


def _quaternion(R: np.ndarray) -> str:
    import mujoco

    out = np.zeros(4)
    mujoco.mju_mat2Quat(out, np.ascontiguousarray(R).ravel())
    return " ".join(f"{v:.17g}" for v in out)


def _place(T: np.ndarray) -> str:
    return f'pos="{" ".join(f"{v / 1e3:.17g}" for v in T[:3, 3])}" quat="{_quaternion(T[:3, :3])}"'


class Engine:
    """The arm with its geometric errors as bodies; `masses` (n,) kg at `places` (n, 3) mm in the
    frame each joint moves; `drives` {joint: N m/rad} and `base` (N m/rad about x and y, pivot
    height in mm) yield."""

    def __init__(self, arm: Arm, masses: Sequence[float], places: np.ndarray):
        self.arm, self.masses, self.places = arm, masses, places

    def measure(
        self,
        q: np.ndarray,
        drives: dict[int, float] | None = None,
        base: tuple[float, float] | None = None,
    ) -> np.ndarray:
        """(m, 3) mm: where the target comes to rest under gravity at joint readings q."""
        import mujoco

        model = mujoco.MjModel.from_xml_string(self.mjcf(drives or {}, base))
        state = mujoco.MjData(model)
        site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, "target")

        def at(name: str) -> int:
            return int(model.jnt_dofadr[mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name)])

        read = [at(f"q{k}") for k in range(self.arm.n)]
        soft = [i for i in range(model.nv) if i not in read]
        stiff = model.jnt_stiffness[soft]
        out = np.empty((len(q), 3))
        for row, reading in enumerate(q):
            state.qvel[:] = 0
            state.qpos[read] = reading
            for _ in range(STEPS):
                mujoco.mj_forward(model, state)
                step = (state.qfrc_passive - state.qfrc_bias)[soft] / stiff
                if not soft or np.abs(step).max() < 1e-13:
                    break
                state.qpos[soft] += step
            out[row] = 1e3 * state.site_xpos[site]
        return out

    def mjcf(self, drives: dict[int, float], base: tuple[float, float] | None) -> str:
        """The model: every frame a body whose reading is one hinge, a yielding drive a second one
        beside it."""
        head, tail, lift = "", "", 0.0
        if base is not None:
            lift = -base[1]
            head = (
                f'<body name="pedestal" pos="0 0 {base[1] / 1e3:.17g}"><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
                + "".join(
                    f'<joint name="base{a}" axis="{axis}" stiffness="{base[0]:.17g}" armature="1"/>'
                    for a, axis in (("x", "1 0 0"), ("y", "0 1 0"))
                )
            )
            tail = "</body>"
        body = ""
        for k in reversed(range(self.arm.n + 1)):
            H = moved(self.arm.errors[None, k])[0]
            if k == self.arm.n:
                T = self.arm.last.copy()
                T[:3, 3] += T[:3, :3] @ self.arm.tool
                body = f'<site name="target" {_place(T @ H)}/>'
                continue
            T = self.arm.before[k] @ H
            if k == 0:
                T[2, 3] += lift
            spring = (
                f'<joint name="s{k}" axis="0 0 1" stiffness="{drives[k + 1]:.17g}" armature="1"/>'
                if k + 1 in drives
                else ""
            )
            com = " ".join(f"{v / 1e3:.17g}" for v in self.places[k])
            body = (
                f'<body {_place(T)}><joint name="q{k}" axis="0 0 1" armature="1"/>{spring}'
                f'<inertial pos="{com}" mass="{self.masses[k]:.17g}" diaginertia="1 1 1"/>{body}</body>'
            )
        return (
            f'<mujoco><compiler angle="radian" autolimits="false"/><option gravity="0 0 -9.81"/>'
            f"<worldbody>{head}{body}{tail}</worldbody></mujoco>"
        )
