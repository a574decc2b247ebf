"""Where the search for tracker placements and targets starts.

An affine map from the tracker to frame 0 with the targets' offsets is linear (methods.md N), but
lost where the points lie on a line or a plane; a rigid fit needs the targets; measured orientations
give the tracker's rotation alone, which is what tells where the target may sit at a point that no
joint moves, as on a two-axis positioner."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from .._typing import Array
from ..robot.rigid import nearest_rotation, rotation_vector
from .placement import Placed, Sight, fit_placements

REWEIGHT = 12
FAR = 2.8  # rad between two orientations, beyond which the axis of their turn is not trusted
SIDE_MM = 250.0  # how far around the expected targets starts are taken
THIN = 0.1  # second over first extent of points from which they are taken for a line


def starts(sight: Sight) -> Iterator[Placed]:
    """Start values, likeliest first."""

    def placed(tools: Array) -> Placed:
        return _turned(sight, fit_placements(sight, tools))

    if sight.seen is not None and (start := _oriented(sight)) is not None:
        yield _turned(sight, start)
    affine = _affine(sight)
    yield _turned(sight, affine)
    yield placed(sight.usual)
    yield placed(affine.tools)
    yield placed(_pivot(sight))
    for axis in range(3):
        for side in (SIDE_MM, -SIDE_MM):
            yield placed(sight.usual + side * np.eye(3)[axis])


def about_lines(sight: Sight, at: Placed) -> Iterator[Placed]:
    """The placement turned about the points of every group, where they are nearly a line: what a
    rigid fit leaves open."""
    from scipy.spatial.transform import Rotation

    shapes = [
        np.linalg.svd(part - np.median(part, axis=0), full_matrices=False)[1:]
        for part in (sight.x[sight.group == g] for g in range(sight.groups))
    ]
    if not any(s[1] < THIN * s[0] for s, _ in shapes):
        return
    for angle in (np.pi / 2, np.pi, -np.pi / 2):
        W = np.array(
            [
                Rotation.from_rotvec(angle * Vt[0] * (s[1] < THIN * s[0])).as_matrix()
                for s, Vt in shapes
            ]
        )
        middle = np.array(
            [np.median(sight.x[sight.group == g], axis=0) for g in range(sight.groups)]
        )
        yield _turned(
            sight, replace(at, R=W @ at.R, t=middle + np.einsum("gij,gj->gi", W, at.t - middle))
        )


def _turned(sight: Sight, at: Placed) -> Placed:
    """With the mean rotation of every target frame on the flange, where orientations are
    measured."""
    if sight.seen is None:
        return at
    each = np.einsum("mji,mkj,mkl->mil", sight.F, at.R[sight.group], sight.seen)
    turned = np.stack([_middle(each[sight.target == k]) for k in range(len(at.tools))])
    return replace(at, turned=turned)


def _middle(each: Array) -> Array:
    """The rotation nearest to most of rotations (k, 3, 3)."""
    weight = np.ones(len(each))
    for _ in range(REWEIGHT):
        R = nearest_rotation(np.einsum("k,kij->ij", weight, each))
        size = np.linalg.norm(each - R, axis=(1, 2))
        weight = 1 / (1 + (size / max(3 * float(np.median(size)), 1e-9)) ** 2) ** 2
    return R


def _affine(sight: Sight) -> Placed:
    """Linear start: A_g x + b_g − F_i t_i = o_i, with o_i, F_i the flange's nominal position and
    rotation."""
    count, targets, m = sight.groups, len(sight.usual), len(sight.x)
    middle = np.array([np.median(sight.x[sight.group == g], axis=0) for g in range(count)])
    span = max(float(np.abs(sight.x - middle[sight.group]).max()), 1.0)
    row = np.concatenate([(sight.x - middle[sight.group]) / span, np.ones((m, 1))], 1)
    M = np.zeros((m, 3, 12 * count + 3 * targets))
    for a in range(3):
        M[np.arange(m)[:, None], a, 12 * sight.group[:, None] + 4 * a + np.arange(4)] = row
    M[
        np.arange(m)[:, None, None],
        np.arange(3)[:, None],
        (12 * count + 3 * sight.target)[:, None, None] + np.arange(3),
    ] = -sight.F
    y = sight.o + np.einsum(
        "mij,mj->mi", sight.F, sight.usual[sight.target]
    )  # deviations stay small where lost
    solution = _reweighted(M, y)
    R, t = np.empty((count, 3, 3)), np.empty((count, 3))
    for g in range(count):
        part = solution[12 * g : 12 * g + 12].reshape(3, 4)
        to_base = nearest_rotation(part[:, :3] / span)
        R[g] = to_base.T
        t[g] = middle[g] - to_base.T @ part[:, 3]
    return Placed(R, t, sight.usual + solution[12 * count :].reshape(targets, 3))


def _pivot(sight: Sight) -> Array:
    """(T, 3) targets that stay where they are, of one place per group: o_i + F_i t = b. For flanges
    that turn about a point."""
    count, targets, m = sight.groups, len(sight.usual), len(sight.x)
    M = np.zeros((m, 3, 3 * count + 3 * targets))
    for a in range(3):
        M[np.arange(m), a, 3 * sight.group + a] = 1.0
    M[
        np.arange(m)[:, None, None],
        np.arange(3)[:, None],
        (3 * count + 3 * sight.target)[:, None, None] + np.arange(3),
    ] = -sight.F
    y = sight.o + np.einsum("mij,mj->mi", sight.F, sight.usual[sight.target])
    return sight.usual + _reweighted(M, y)[3 * count :].reshape(targets, 3)


def _oriented(sight: Sight) -> Placed | None:
    """Start from measured orientations M_i = R F_i X: the turn from one row to another, seen by the
    tracker, is that of the flange turned by R (hand-eye; Park & Martin 1994); then R F_i t + b =
    x_i − R o_i is linear. None where all turn about one axis."""
    m, targets, count, seen = len(sight.x), len(sight.usual), sight.groups, np.asarray(sight.seen)
    R = np.empty((count, 3, 3))
    for g in range(count):
        pairs = [
            (i, j)
            for t in range(targets)
            for rows in [np.flatnonzero((sight.group == g) & (sight.target == t))]
            for shift in {1, len(rows) // 2}
            for i, j in zip(rows, np.roll(rows, shift), strict=True)
        ]
        i, j = np.array(pairs, dtype=np.intp).reshape(-1, 2).T
        a = rotation_vector(np.einsum("mij,mkj->mik", seen[i], seen[j]))
        b = rotation_vector(np.einsum("mij,mkj->mik", sight.F[i], sight.F[j]))
        weight = (np.linalg.norm(b, axis=1) < FAR).astype(
            float
        )  # near half a turn the axis may point either way
        if np.linalg.matrix_rank(b[weight > 0], tol=1e-3 * np.sqrt(len(b))) < 2:
            return None
        for _ in range(REWEIGHT):
            R[g] = nearest_rotation(np.einsum("m,mi,mj->ij", weight, a, b))
            size = np.linalg.norm(a - b @ R[g].T, axis=1)
            weight = (np.linalg.norm(b, axis=1) < FAR) / (
                1 + (size / max(3 * float(np.median(size)), 1e-9)) ** 2
            )
    turned = R[sight.group]
    M = np.zeros((m, 3, 3 * count + 3 * targets))
    for c in range(3):
        M[np.arange(m), c, 3 * sight.group + c] = 1.0
    M[
        np.arange(m)[:, None, None],
        np.arange(3)[:, None],
        (3 * count + 3 * sight.target)[:, None, None] + np.arange(3),
    ] = turned @ sight.F
    y = sight.x - np.einsum(
        "mij,mj->mi", turned, sight.o + np.einsum("mij,mj->mi", sight.F, sight.usual[sight.target])
    )
    solution = _reweighted(M, y)
    return Placed(
        R,
        solution[: 3 * count].reshape(count, 3),
        sight.usual + solution[3 * count :].reshape(targets, 3),
    )


def _reweighted(M: Array, y: Array) -> Array:
    """Least squares of y (m, 3) on M (m, 3, p) with Cauchy weights per row: up to a third may be
    gross."""
    weight = np.ones(len(y))
    for _ in range(REWEIGHT):
        W = weight[:, None, None]
        solution = np.linalg.lstsq(
            (M * W).reshape(-1, M.shape[2]), (y * W[:, 0]).ravel(), rcond=1e-9
        )[0]
        size = np.linalg.norm(M @ solution - y, axis=1)
        weight = 1 / (1 + (size / max(3 * float(np.median(size)), 1e-6)) ** 2)
    return np.asarray(solution)
