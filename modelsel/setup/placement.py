"""Tracker placements and targets: what they leave of the measured rows, and robust rigid fits.

Model of a row: x = R_g (o + F c_k) + t_g, with o, F the flange's nominal position and rotation, and
c_k the target's offset on it. For known targets a placement is a rigid fit (Kabsch 1976); both
together are minimised by Levenberg-Marquardt (`adjustment`; Geman & McClure 1985). A
target is expected within STATED_MM of where the study has it, else within USUAL_MM of the flange: a
weak prior, which matters only where the rows do not determine the target."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from .._linalg import TINY
from .._typing import Array, Index
from ..robot.rigid import rotation_vector
from .robust_weights import compute_redescending_weights

# prior standard deviation of a target's coordinates: about the flange where the study states none,
# and about those that it states
USUAL_MM = 500.0
STATED_MM = 50.0
# medians beyond which a row counts less and less
LOSS = 3.0
# displacement that a radian of orientation counts for
LEVER_MM = 1.0
# smallest median that is believed
MIN_MEDIAN_MM = 1e-6
# median length of a vector of three standard normal coordinates
MEDIAN_3 = 1.538
# rounds of reweighting
MAX_ROUNDS = 6
# subsets of four rows from which rigid fits start
SUBSETS = 48


@dataclass(frozen=True, eq=False)
class Sight:
    """Rows to place: measured positions x (..., m, 3) [mm] and, where measured, orientations `seen`
    (..., m, 3, 3); the flange's nominal position o (..., m, 3) and rotation F (..., m, 3, 3) in
    frame 0; group and target (m,); `usual` (..., T, 3) where targets are expected.

    With a leading axis many sights are one, of rows of the same groups and targets."""

    x: Array
    o: Array
    F: Array
    group: Index
    target: Index
    groups: int
    usual: Array
    seen: Array | None = None

    @property
    def targets(self) -> int:
        """Number of targets."""
        *_, targets, _ = self.usual.shape
        return int(targets)

    @property
    def unknowns(self) -> int:
        """Number of unknowns of the placements and targets."""
        of_placements = 6 * self.groups
        of_targets = 3 * self.targets
        return of_placements + of_targets

    @cached_property
    def prior_sigma(self) -> Array:
        """(..., T, 1) prior standard deviation of every target's coordinates [mm]."""
        is_stated = self.usual.any(axis=-1, keepdims=True)
        sigma = np.where(is_stated, STATED_MM, USUAL_MM)
        return np.asarray(sigma)

    def take(self, rows: Index) -> Sight:
        """Select some of the rows."""
        return replace(
            self,
            x=self.x[rows],
            o=self.o[rows],
            F=self.F[rows],
            group=self.group[rows],
            target=self.target[rows],
            seen=None if self.seen is None else self.seen[rows],
        )

    def pick(self, which: Index) -> Sight:
        """Select some of many sights, with what is known of their rows."""
        picked = replace(
            self,
            x=self.x[which],
            o=self.o[which],
            F=self.F[which],
            usual=self.usual[which],
            seen=None if self.seen is None else self.seen[which],
        )
        # what is cached stays known
        known = vars(picked)
        known["pairs"] = self.pairs
        known["middles"] = self.middles[which]
        return picked

    @cached_property
    def pairs(self) -> tuple[tuple[int, int, Index], ...]:
        """(group, target, rows) of every pair that occurs."""
        key = self.group * self.targets + self.target
        pairs = []
        for k in np.unique(key).tolist():
            group, target = divmod(k, self.targets)
            is_pair = key == k
            rows = np.flatnonzero(is_pair)
            pair = (group, target, rows)
            pairs.append(pair)
        return tuple(pairs)

    def points(self, tools: Array) -> Array:
        """Compute (..., m, 3) nominal positions of the targets in frame 0 for offsets (..., T, 3)
        [mm]."""
        offset = tools[..., self.target, :]
        rotated = np.einsum("...ij,...j->...i", self.F, offset)
        points = self.o + rotated
        return np.asarray(points)

    @cached_property
    def middles(self) -> Array:
        """(..., G, 3) the median of every group's measured points [mm]."""
        medians = []
        for g in range(self.groups):
            in_group = self.group == g
            rows = np.flatnonzero(in_group)
            of_group = self.x[..., rows, :]
            middle = np.median(of_group, axis=-2)
            medians.append(middle)
        return np.stack(medians, axis=-2)


@dataclass(frozen=True, eq=False)
class Placed:
    """Placements R (..., G, 3, 3) and t (..., G, 3) [mm] of frame 0 in the tracker's frame, and
    targets `tools` (..., T, 3) [mm]; with orientations, the target frames' rotations on the flange
    `turned` (..., T, 3, 3)."""

    R: Array
    t: Array
    tools: Array
    turned: Array | None = None

    def take(self, which: Index | int) -> Placed:
        """Select one of many, or some of them."""
        turned = None if self.turned is None else self.turned[which]
        return Placed(self.R[which], self.t[which], self.tools[which], turned)

    def put(self, which: Index, others: Placed) -> Placed:
        """Return these with others in some places."""
        R = put_in_places(self.R, which, others.R)
        t = put_in_places(self.t, which, others.t)
        tools = put_in_places(self.tools, which, others.tools)
        turned = None
        if self.turned is not None and others.turned is not None:
            turned = put_in_places(self.turned, which, others.turned)
        return Placed(R, t, tools, turned)


def put_in_places(values: Array, which: Index, others: Array) -> Array:
    """Return values (k, ...) with others in the places `which`, in ascending order."""
    if len(which) == len(values):
        return others
    changed = values.copy()
    changed[which] = others
    return changed


def stack_sights(sights: Sequence[Sight]) -> Sight:
    """Stack sights of rows of the same groups and targets along a leading axis."""
    first = sights[0]
    seen = None
    if first.seen is not None:
        seen = np.stack([np.asarray(sight.seen) for sight in sights])
    return replace(
        first,
        x=np.stack([sight.x for sight in sights]),
        o=np.stack([sight.o for sight in sights]),
        F=np.stack([sight.F for sight in sights]),
        usual=np.stack([sight.usual for sight in sights]),
        seen=seen,
    )


def stack_placed(placed: Sequence[Placed]) -> Placed:
    """Stack placements of the same groups and targets along a leading axis."""
    first = placed[0]
    turned = None
    if first.turned is not None:
        turned = np.stack([np.asarray(at.turned) for at in placed])
    R = np.stack([at.R for at in placed])
    t = np.stack([at.t for at in placed])
    tools = np.stack([at.tools for at in placed])
    return Placed(R, t, tools, turned)


def compute_residuals(sight: Sight, at: Placed) -> Array:
    """Compute (..., m, 3) measured minus predicted positions [mm]; with orientations (..., m, 6),
    rotation vectors times LEVER_MM."""
    R = at.R[..., sight.group, :, :]
    t = at.t[..., sight.group, :]
    predicted = np.einsum("...ij,...j->...i", R, sight.points(at.tools))
    position: Array = sight.x - predicted - t
    if sight.seen is None or at.turned is None:
        return position
    of_target = at.turned[..., sight.target, :, :]
    turned = R @ sight.F @ of_target
    deviation = np.einsum("...ij,...kj->...ik", sight.seen, turned)
    matrices = deviation.reshape(-1, 3, 3)
    flat = rotation_vector(matrices)
    rotation = flat.reshape(position.shape)
    return np.concatenate([position, LEVER_MM * rotation], axis=-1)


def compute_misfits(sight: Sight, at: Placed) -> Array:
    """Compute (..., m) lengths of the residuals."""
    residuals = compute_residuals(sight, at)
    lengths = np.linalg.norm(residuals, axis=-1)
    return np.asarray(lengths)


def compute_trimmed_median(size: Array, unknowns: int) -> Array:
    """Compute (...) the length of (..., m) that more than half are below, beyond the rows that
    `unknowns` can fit exactly (Rousseeuw 1984); at least MIN_MEDIAN_MM."""
    m = size.shape[-1]
    beyond_exact = (3 * m + unknowns + 1) // 6
    k = min(beyond_exact, m - 1)
    sorted_up_to_k = np.partition(size, k, axis=-1)
    median = np.maximum(sorted_up_to_k[..., k], MIN_MEDIAN_MM)
    return np.asarray(median)


def fit_rigid_transform(x: Array, y: Array, weight: Array) -> tuple[Array, Array]:
    """Fit rigid transforms x ≈ R y + t to points (..., k, 3) with weights (..., k): R (..., 3, 3),
    t (..., 3).

    Kabsch 1976, for many point sets at once (scipy's `Rotation.align_vectors` takes one, and no
    translation)."""
    total = weight.sum(-1, keepdims=True)
    w = weight / np.maximum(total, TINY)
    x_mean = np.einsum("...k,...ki->...i", w, x)
    y_mean = np.einsum("...k,...ki->...i", w, y)
    x_centred = x - x_mean[..., None, :]
    y_centred = y - y_mean[..., None, :]
    covariance = np.einsum("...k,...ki,...kj->...ij", w, x_centred, y_centred)
    U, _, Vt = np.linalg.svd(covariance)
    handedness = np.linalg.det(U @ Vt)
    reflection = np.ones(U.shape[:-1])
    reflection[..., 2] = np.sign(handedness)
    reflected = U * reflection[..., None, :]
    R = reflected @ Vt
    rotated_mean = np.einsum("...ij,...j->...i", R, y_mean)
    return R, x_mean - rotated_mean


def fit_placements(sight: Sight, tools: Array) -> Placed:
    """Fit the placements for known targets (T, 3): the best of rigid fits to all rows and to fours
    of them by the median, then reweighted."""
    y = sight.points(tools)
    groups = sight.groups
    identity = np.eye(3)
    R = np.tile(identity, (groups, 1, 1))
    t = np.zeros((groups, 3))
    for g in np.unique(sight.group):
        in_group = sight.group == g
        rows = np.flatnonzero(in_group)
        R[g], t[g] = _fit_robustly(sight.x[rows], y[rows])
    return Placed(R, t, tools)


def _fit_robustly(x: Array, y: Array) -> tuple[Array, Array]:
    """Fit one rigid transform to points (k, 3) of which up to half may be gross."""
    m = len(x)
    irrationals = np.sqrt([5.0, 2.0, 3.0, 7.0])
    shares = np.outer(np.arange(SUBSETS) + 0.5, irrationals) % 1.0
    fours = (shares * m).astype(int)
    of_all = fit_rigid_transform(x[None], y[None], np.ones((1, m)))
    of_fours = fit_rigid_transform(x[fours], y[fours], np.ones(fours.shape))
    Rs, ts = (np.concatenate(fits) for fits in zip(of_all, of_fours, strict=True))
    rotated = y @ Rs.transpose(0, 2, 1)
    distances = np.linalg.norm(x - rotated - ts[:, None], axis=2)
    medians = compute_trimmed_median(distances, 6)
    best = int(medians.argmin())
    R = Rs[best]
    t = ts[best]
    near = distances[best]
    for _ in range(MAX_ROUNDS):
        scale = LOSS * compute_trimmed_median(near, 6)
        weight = compute_redescending_weights(near, scale)
        R, t = fit_rigid_transform(x, y, weight)
        near = np.linalg.norm(x - y @ R.T - t, axis=1)
    return R, t
