"""Registration from scratch: where the tracker stands and where the targets sit, without a start value.

One linear solve for a free affine map tracker -> frame 0 per placement and every target's offset (12 G + 3 T unknowns),
reweighted so that gross outliers do not matter; the affine maps are projected to rotations; Gauss-Newton on the exact
set-up model then settles it (methods.md N). Where orientations are measured they give the tracker's rotation first: the
affine map is lost where the target may sit at a point that no joint moves, as on a two-axis positioner.
"""
from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..data.measurements import Index
from ..matrix.design import Model, residuals
from ..matrix.scene import Scene
from ..words.errors import DataError
from ..words.rigid import AXES, Array, inverse, nearest_rotation, rotation_vector, transform, turn
from ..wrong.mechanisms.geometry import setup
from .fit import fit

REWEIGHT = 12
LEAST = 4  # configurations per placement
FAR = 2.8  # rad between two orientations, beyond which the axis of their turn is not trusted


def register(scene: Scene, use: NDArray[np.bool_], per_group: bool) -> Scene:
    """The scene with placement(s) and tools found from the rows `use` (mask). Raises DataError with too few rows."""
    if scene.data.gauges is not None:
        return _by_points(scene, use & scene.data.gauges.of("point"), per_group)
    some = scene.take(use)
    group = some.data.group if per_group else np.zeros(len(some), np.intp)
    count = len(scene.data.groups) if per_group else 1
    for g in range(count):
        seen = len(np.unique(some.data.configuration[group == g]))
        if seen < LEAST:
            where = f"group {scene.data.groups[g]}" if per_group else "the data"
            raise DataError(f"{where} has {seen} estimation configurations; registration needs {LEAST} per placement.",
                            remedy="Measure more, or choose another [split].")
    start = None if scene.tool_rotations is None else _oriented(some, group, count)
    placement, tools = start or _affine(some, group, count)
    rows = np.concatenate([[g] for g in (range(count) if per_group else [0] * len(scene.data.groups))]).astype(int)
    scene = scene.anew(placement=(placement[0][rows], placement[1][rows]), tools=tools)
    if scene.tool_rotations is not None:
        scene = replace(scene, tool_rotations=_target_rotations(scene.take(use)))
    return _settle(scene, use, count)


def _by_points(scene: Scene, use: NDArray[np.bool_], per_group: bool) -> Scene:
    """The same where not every row is a point: from the points alone."""
    some = scene.take(use)
    seen = some.data.configurations
    if seen < LEAST:
        raise DataError(f"{seen} estimation configurations have a measured point; registration needs {LEAST}.",
                        remedy="Measure more points, or leave register out: the rest is told in the robot's own frame.")
    found = register(replace(some, data=replace(some.data, gauges=None)), np.ones(len(some), bool), per_group)
    return scene.anew(placement=found.placement, tools=found.tools, tool_rotations=found.tool_rotations)


def _affine(some: Scene, group: Index, count: int) -> tuple[tuple[Array, Array], Array]:
    """Linear start: A_g x + b_g − R_i t_i = o_i, with x the measured and o_i, R_i the flange's nominal position, rotation."""
    bare = some.anew(tools=np.zeros_like(some.tools)).pose(slice(None))
    m, targets = len(some), len(some.tools)
    flange = bare.axes[-1, :3].transpose(2, 1, 0)                    # (m, 3, 3): columns are the flange's axes
    x = some.data.position
    middle = np.array([np.median(x[group == g], axis=0) for g in range(count)])
    span = max(float(np.abs(x - middle[group]).max()), 1.0)
    row = np.concatenate([(x - middle[group]) / span, np.ones((m, 1))], 1)
    M = np.zeros((m, 3, 12 * count + 3 * targets))
    for a in range(3):
        M[np.arange(m)[:, None], a, 12 * group[:, None] + 4 * a + np.arange(4)] = row
    M[np.arange(m)[:, None, None], np.arange(3)[:, None], (12 * count + 3 * some.data.target)[:, None, None] + np.arange(3)
      ] = -flange
    y = bare.target.T + np.einsum("mij,mj->mi", flange, some.tool)   # deviations from the nominal tool stay small where lost
    solution = _reweighted(M, y)
    R, t = np.empty((count, 3, 3)), np.empty((count, 3))
    for g in range(count):
        part = solution[12 * g:12 * g + 12].reshape(3, 4)
        to_base = nearest_rotation(part[:, :3] / span)
        R[g] = to_base.T
        t[g] = middle[g] - to_base.T @ part[:, 3]
    return (R, t), some.tools + solution[12 * count:].reshape(targets, 3)


def _oriented(some: Scene, group: Index, count: int) -> tuple[tuple[Array, Array], Array] | None:
    """Start from measured orientations M_i = R F_i X: the turn from one row to another, seen by the tracker, is that of the
    flange turned by R (hand-eye; Park & Martin 1994); then R F_i t + b = x_i − R o_i is linear. None where all turn about one
    axis."""
    bare = some.anew(tools=np.zeros_like(some.tools)).pose(slice(None))
    flange, m, targets = bare.axes[-1, :3].transpose(2, 1, 0), len(some), len(some.tools)
    seen = np.asarray(some.data.rotation)
    R = np.empty((count, 3, 3))
    for g in range(count):
        pairs = [(i, j) for t in range(targets) for rows in [np.flatnonzero((group == g) & (some.data.target == t))]
                 for shift in {1, len(rows) // 2} for i, j in zip(rows, np.roll(rows, shift), strict=True)]
        i, j = np.array(pairs, dtype=np.intp).reshape(-1, 2).T
        a = rotation_vector(np.einsum("mij,mkj->mik", seen[i], seen[j]))
        b = rotation_vector(np.einsum("mij,mkj->mik", flange[i], flange[j]))
        weight = (np.linalg.norm(b, axis=1) < FAR).astype(float)      # near half a turn the axis may point either way
        if np.linalg.matrix_rank(b[weight > 0], tol=1e-3 * np.sqrt(len(b))) < 2:
            return None
        for _ in range(REWEIGHT):
            R[g] = nearest_rotation(np.einsum("m,mi,mj->ij", weight, a, b))
            size = np.linalg.norm(a - b @ R[g].T, axis=1)
            weight = (np.linalg.norm(b, axis=1) < FAR) / (1 + (size / max(3 * float(np.median(size)), 1e-9)) ** 2)
    turned = R[group]
    M = np.zeros((m, 3, 3 * count + 3 * targets))
    for c in range(3):
        M[np.arange(m), c, 3 * group + c] = 1.0
    M[np.arange(m)[:, None, None], np.arange(3)[:, None], (3 * count + 3 * some.data.target)[:, None, None] + np.arange(3)
      ] = turned @ flange
    y = some.data.position - np.einsum("mij,mj->mi", turned, bare.target.T + np.einsum("mij,mj->mi", flange, some.tool))
    solution = _reweighted(M, y)
    return (R, solution[:3 * count].reshape(count, 3)), some.tools + solution[3 * count:].reshape(targets, 3)


def _reweighted(M: Array, y: Array) -> Array:
    """Least squares of y (m, 3) on M (m, 3, p) with Cauchy weights per row: up to a third may be gross."""
    weight = np.ones(len(y))
    for _ in range(REWEIGHT):
        W = weight[:, None, None]
        solution = np.linalg.lstsq((M * W).reshape(-1, M.shape[2]), (y * W[:, 0]).ravel(), rcond=1e-9)[0]
        size = np.linalg.norm(M @ solution - y, axis=1)
        weight = 1 / (1 + (size / max(3 * float(np.median(size)), 1e-6)) ** 2)
    return np.asarray(solution)


def _target_rotations(some: Scene) -> Array:
    """Mean rotation of every target frame on the flange, from the measured orientations."""
    flange = some.pose(slice(None)).axes[-1, :3].transpose(2, 1, 0)
    R = some.placement[0][some.data.group]
    each = np.einsum("mji,mkj,mkl->mil", flange, R, np.asarray(some.data.rotation))
    return np.stack([nearest_rotation(each[some.data.target == t].mean(0)) for t in range(len(some.tools))])


def _settle(scene: Scene, use: NDArray[np.bool_], count: int) -> Scene:
    """Gauss-Newton on the set-up alone, its result composed into placement and tools; gross rows left out."""
    robot, targets = scene.robot, len(scene.tools)
    model = Model((setup(robot, targets, count, True, scene.tool_rotations is not None),))
    before = transform(robot.joints[0].before[:3, :3], robot.joints[0].before[:3, 3])
    for _ in range(3):
        some = scene.take(use)
        size = np.linalg.norm(residuals(some)[:, :3], axis=1)
        found = fit(some.take(size <= max(6 * float(np.median(size)), 1e-6)), model)
        value = {(s.frame, s.axis, str(s.cause)): v for t, v in zip(model.terms, found.theta, strict=True) for s in t.screws}
        tools, rotations = scene.tools.copy(), scene.tool_rotations
        turned = None if rotations is None else rotations.copy()
        for k in range(targets):
            label = f"target_{k + 1}" if targets > 1 else "1"
            H = [value.get((robot.n + 1, axis, label), 0.0) for axis in AXES]
            tools[k] += H[:3]
            if turned is not None:
                turned[k] = turn(0, H[3]) @ turn(1, H[4]) @ turn(2, H[5]) @ turned[k]
        R, t = scene.placement[0].copy(), scene.placement[1].copy()
        for g in range(len(R)):
            label = f"group_{g + 1}" if count > 1 else "1"
            H = [value.get((1, axis, label), 0.0) for axis in AXES]
            screw = transform(turn(0, H[3]) @ turn(1, H[4]) @ turn(2, H[5]), H[:3])
            P = transform(R[g], t[g]) @ before @ screw @ inverse(before)
            R[g], t[g] = nearest_rotation(P[:3, :3]), P[:3, 3]
        scene = scene.anew(placement=(R, t), tools=tools, tool_rotations=turned)
    return scene
