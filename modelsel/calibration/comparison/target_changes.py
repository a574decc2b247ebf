"""Which of several targets moved on the flange between two campaigns: one, several each on its own,
or all together, as on an adapter that was taken off and put back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..._linalg import RANK_TOLERANCE, TINY
from ..._typing import Array
from ..known_names import Names
from .common_space import CommonSpace
from .fewest_terms import Step
from .mechanism_changes import SIGNIFICANCE

POWER = 0.9  # with which a move so large is detected
Three = tuple[float, float, float]


@dataclass(frozen=True)
class TargetChange:
    """One of several targets in both campaigns: how far it moved on the flange [mm] along the
    flange's axes, with standard errors; `p` corrected for the number tested; a move of `seen_mm` in
    the least determined direction would have been detected."""

    target: str
    moved_mm: Three
    standard_errors: Three
    p: float
    seen_mm: float


@dataclass(frozen=True)
class TargetMotion:
    """A move of targets on the flange that explains the difference of two campaigns, each by
    `moved_mm` along the flange's axes, with the standard error along its own direction: one target,
    or all of them together as one body. The terms and motions `alike` would explain it as well."""

    targets: Names
    together: bool
    moved_mm: tuple[Three, ...]
    standard_errors: tuple[float, ...]
    alike: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class TargetGroup:
    """Targets that may have moved: `of_terms` (d, p) what a unit of each of d motions changes in the
    terms; `members`: which of the compared targets."""

    label: str
    members: tuple[int, ...]
    together: bool
    of_terms: Array


def name_targets(space: CommonSpace) -> Names:
    """Name the targets that are compared one by one."""
    if not len(space.offsets):
        return ()
    names = space.targets.names
    shared = space.targets.shared.tolist()
    return tuple(names[k] for k in shared)


def build_target_groups(space: CommonSpace) -> list[TargetGroup]:
    """Build the motions that are tried: of each target, of all by one shift, and of all as a body
    that also turns."""
    names = name_targets(space)
    if not names:
        return []
    alone = _list_alone(space)
    groups = []
    for k, name in enumerate(names):
        label = f'the place of the target "{name}" on the flange'
        group = TargetGroup(label, (k,), False, alone[k])
        groups.append(group)
    shift = np.sum(alone, axis=0)
    first, _ = space.campaigns
    tools = first.tools[space.targets.shared]
    arms = tools - tools.mean(0)
    turn = np.zeros_like(shift)
    identity = np.eye(3)
    for of_one, arm in zip(alone, arms, strict=True):
        turning = np.cross(identity, arm)
        turn += turning @ of_one
    body = np.concatenate([shift, turn])
    label = "the place of all targets together on the flange"
    members = tuple(range(len(names)))
    for of_terms in (shift, body):
        group = TargetGroup(label, members, True, of_terms)
        groups.append(group)
    return groups


def _list_alone(space: CommonSpace) -> list[Array]:
    """List what a move of each target along the flange's axes changes in the terms (3, p)."""
    count = len(space.terms)
    alone = []
    for places in space.offsets.tolist():
        of_one = np.zeros((3, count))
        of_one[range(3), places] = 1.0
        alone.append(of_one)
    return alone


def build_motion(
    space: CommonSpace, group: TargetGroup, step: Step, alike: tuple[str, ...]
) -> TargetMotion:
    """Build the motion of a group from its step: how far each of its targets moved."""
    names = name_targets(space)
    moves = list[Three]()
    errors = list[float]()
    for k in group.members:
        places = space.offsets[k]
        of_motion = group.of_terms[:, places].T
        move = of_motion @ step.changes
        factor = of_motion @ step.factor
        length = float(np.linalg.norm(move))
        direction = move / max(length, TINY)
        along = direction @ factor
        error = np.linalg.norm(along)
        told = _three(move)
        moves.append(told)
        errors.append(float(error))
    moved = tuple(names[k] for k in group.members)
    return TargetMotion(moved, group.together, tuple(moves), tuple(errors), alike)


def _three(vector: Array) -> Three:
    x, y, z = vector.tolist()
    return x, y, z


# -- tests
# ------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Tested:
    """A motion of targets between the campaigns: how large (d,), its covariance factor (d, k), and
    the same in r independent directions, each over its standard error `scale` (r,)."""

    difference: Array
    factor: Array
    standardised: Array
    scale: Array


def compute_target_p(space: CommonSpace) -> Array:
    """Test where each target sits, and where they sit among each other: p-values (targets + 1,),
    not corrected for their number; none where targets are not compared one by one."""
    from scipy.special import chdtrc

    alone = _list_alone(space)
    if not alone:
        return np.zeros(0)
    middle = np.mean(alone, axis=0)
    among = [of_one - middle for of_one in alone[1:]]
    p = []
    for of_terms in (*alone, np.concatenate(among)):
        tested = _estimate(space, of_terms)
        z = tested.standardised
        dims = len(z)
        chi2 = z @ z
        own = chdtrc(dims, chi2) if dims else 1.0
        p.append(own)
    return np.array(p)


def build_target_changes(space: CommonSpace, p: Array, count: int) -> tuple[TargetChange, ...]:
    """Build the change of every target that is compared one by one, of `p` among `count` tests."""
    changes = []
    names = name_targets(space)
    alone = _list_alone(space)
    # the last test is of all of them
    tests = zip(names, alone, p.tolist(), strict=False)
    for name, of_terms, own in tests:
        tested = _estimate(space, of_terms)
        errors = np.linalg.norm(tested.factor, axis=1)
        change = TargetChange(
            target=name,
            moved_mm=_three(tested.difference),
            standard_errors=_three(errors),
            p=own,
            seen_mm=_find_seen(tested, count),
        )
        changes.append(change)
    return tuple(changes)


def _estimate(space: CommonSpace, of_terms: Array) -> _Tested:
    """Estimate a motion of targets; what another term represents is taken as no motion."""
    coefficients = of_terms[:, space.kept]
    difference = coefficients @ space.difference
    factor = coefficients @ space.difference_factor
    U, singular, _ = np.linalg.svd(factor, full_matrices=False)
    largest = singular.max(initial=0.0)
    counts = singular > RANK_TOLERANCE * largest
    scale = singular[counts]
    directions = U[:, counts]
    along = difference @ directions
    standardised = along / scale
    return _Tested(difference, factor, standardised, scale)


def _find_seen(tested: _Tested, count: int) -> float:
    """Return the move [mm] in the least determined direction that would have been detected among
    `count` tests."""
    from scipy.special import chdtri, chndtrinc

    dims = len(tested.scale)
    if not dims:
        return 0.0
    limit = chdtri(dims, SIGNIFICANCE / count)
    noncentrality = chndtrinc(limit, dims, 1 - POWER)
    errors = np.sqrt(noncentrality)
    worst = tested.scale.max()
    return float(errors * worst)
