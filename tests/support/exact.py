"""An independent chain and an exact fit of a set-up for tests: own kinematics, scipy's
least_squares, nothing of modelsel."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]


def flanges(before: list[Array], slides: list[bool], last: Array, q: Array) -> Array:
    """(m, 4, 4) flange poses of readings q (m, n): homogeneous matrices multiplied one after the
    other."""
    T = np.tile(np.eye(4), (len(q), 1, 1))
    for N, slide, value in zip(before, slides, q.T, strict=True):
        J = np.tile(np.eye(4), (len(q), 1, 1))
        if slide:
            J[:, 2, 3] = value
        else:
            J[:, :3, :3] = Rotation.from_rotvec(np.outer(value, [0.0, 0.0, 1.0])).as_matrix()
        T = T @ N @ J
    return T @ last


def flanges_of(robot: object, q: Array) -> Array:
    """The same of a robot as modelsel reads it: its numbers alone are taken."""
    joints = robot.joints  # type: ignore[attr-defined]
    return flanges([j.before for j in joints], [j.prismatic for j in joints], robot.last, q)  # type: ignore[attr-defined]


def seen(
    T: Array, tools: Array, target: NDArray[np.intp], R: Array, t: Array, group: NDArray[np.intp]
) -> Array:
    """(m, 3) where targets stand in the trackers' frames."""
    y = T[:, :3, 3] + np.einsum("mij,mj->mi", T[:, :3, :3], tools[target])
    return np.einsum("mij,mj->mi", R[group], y) + t[group]


def best(
    T: Array,
    x: Array,
    target: NDArray[np.intp],
    group: NDArray[np.intp],
    start: tuple[Array, Array, Array],
    rows: NDArray[np.bool_] | None = None,
) -> float:
    """rms length [mm] that the exact fit of every group's placement and every target leaves, from a
    start near the truth (R, t, tools), of the `rows` alone where given."""
    R0, t0, tools0 = start
    G, rows = len(R0), np.ones(len(x), bool) if rows is None else rows

    def f(p: Array) -> Array:
        R = Rotation.from_rotvec(p[: 3 * G].reshape(G, 3)).as_matrix() @ R0
        return (
            x - seen(T, p[6 * G :].reshape(-1, 3), target, R, p[3 * G : 6 * G].reshape(G, 3), group)
        )[rows].ravel()

    p0 = np.concatenate([np.zeros(3 * G), t0.ravel(), tools0.ravel()])
    return float(
        np.sqrt(
            2
            * least_squares(f, p0, x_scale="jac", xtol=1e-14, ftol=1e-14, gtol=1e-14).cost
            / rows.sum()
        )
    )


def reached(
    robot: object, tool: Array, goals: Array, start: Array, orientation: Array | None = None
) -> Array:
    """(m, n) readings that bring the target to goals (m, 3), one after the other from `start` (n,),
    the flange turned as `orientation` (3, 3) says where given."""
    out, q = np.empty((len(goals), len(start))), start.copy()
    for k, goal in enumerate(goals):

        def f(p: Array, goal: Array = goal, before: Array = q) -> Array:
            T = flanges_of(robot, p[None])[0]
            turned = np.zeros(0) if orientation is None else 300 * (T[:3, :3] - orientation).ravel()
            calm = np.zeros(0) if orientation is not None else 1e-4 * (p - before)
            return np.concatenate([T[:3, 3] + T[:3, :3] @ tool - goal, turned, calm])

        q = least_squares(f, q).x
        out[k] = q
    return out
