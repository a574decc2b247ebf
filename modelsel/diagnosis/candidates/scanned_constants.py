"""Constants of scanned mechanisms, such as the moment of a step: of those that the data do not tell
apart one is enough."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from ..._typing import Array
from ...fitting.problem import Problem
from ...mechanisms.campaign_registry import TARGET_STEP
from ...mechanisms.causes import Cause
from ...mechanisms.moved_targets import find_moved_targets
from ...mechanisms.terms import Mechanism
from ...mechanisms.tools import is_bending
from ...robot.kinematics import find_flange_axis

# coordinates that a step needs before and after it, for each of its numbers: two or three rows far
# off at either end of a campaign would pass for one
COORDINATES_OF_STEP = 2
# mm aside up to which a target is on the flange's axis
ON_AXIS = 1e-3


def drop_equal_constants(problem: Problem, mechanisms: Sequence[Mechanism]) -> list[Mechanism]:
    """Keep one of a scanned mechanism's constants that do the same on these rows.

    For example, steps between the same two configurations do; of these the one in the middle is
    kept, as rows that were held out may lie between them. Steps that only a few rows have are left
    out: they are these rows' errors."""
    mechanisms = _drop_bending(problem, mechanisms)
    constants = Counter(m.name for m in mechanisms)
    probe = np.random.default_rng(0).normal(size=len(problem))
    products: dict[Cause, bytes] = {}
    earlier: dict[tuple[object, ...], list[list[Mechanism]]] = {}
    groups: list[list[Mechanism]] = []
    for m in mechanisms:
        is_own_step = m.stem == TARGET_STEP and bool(find_moved_targets(m))
        if constants[m.name] == 1 and not is_own_step:
            groups.append([m])
        elif has_both_sides(problem, m):
            key = _build_key(problem, m, probe, products)
            known = earlier.setdefault(key, [])
            same = _find_same(problem, m, known)
            if same is None:
                same = []
                known.append(same)
                groups.append(same)
            same.append(m)
    return [same[(len(same) - 1) // 2] for same in groups]


def _drop_bending(problem: Problem, mechanisms: Sequence[Mechanism]) -> list[Mechanism]:
    """Leave out tools that turn under their weight where every target is on the flange's axis: they shift it as
    tools that droop across that axis do."""
    axis = find_flange_axis(problem.robot)
    aside = np.cross(problem.tools, axis)
    if np.abs(aside).max() > ON_AXIS:
        return list(mechanisms)
    return [m for m in mechanisms if not is_bending(m)]


def _find_same(
    problem: Problem, mechanism: Mechanism, groups: Sequence[list[Mechanism]]
) -> list[Mechanism] | None:
    """Find the group whose mechanisms do the same as another one on all rows."""
    if not groups:
        return None
    values = _evaluate_causes(problem, mechanism)
    for group in groups:
        if _evaluate_causes(problem, group[0]) == values:
            return group
    return None


def has_both_sides(problem: Problem, mechanism: Mechanism) -> bool:
    """Return whether a step has enough coordinates before and after it, of every target that it moves
    where it moves some of several; true of what is no step."""
    screws = mechanism.terms[0].screws
    targets = find_moved_targets(mechanism) or (None,)
    for screw, target in zip(screws, targets, strict=False):
        values = np.asarray(screw.cause.of(problem.state))
        if target is not None:
            is_moved = target.of(problem.state) > 0
            values = values[is_moved]
            # a target that was measured on one side alone has only been somewhere else all along
            if len(np.unique(values)) < 2:
                return False
        if not _has_both(problem, mechanism, values):
            return False
    return True


def _has_both(problem: Problem, mechanism: Mechanism, values: Array) -> bool:
    """Return whether enough coordinates have either end of a cause's values, where there is nothing
    between these."""
    is_before = values == values.min()
    is_after = values == values.max()
    if not (is_before | is_after).all():
        return True
    fewest = min(is_before.sum(), is_after.sum()) * problem.components
    return bool(fewest >= COORDINATES_OF_STEP * len(mechanism.terms))


def _build_key(
    problem: Problem, mechanism: Mechanism, probe: Array, products: dict[Cause, bytes]
) -> tuple[object, ...]:
    """Build a key that two constants of a mechanism share where they do the same on all rows.

    `probe` (m,) turns the values of a cause into one number, so that none are kept; `products`: these
    numbers, to which those of the mechanism are added."""
    key: list[object] = [mechanism.name]
    for term in mechanism.terms:
        for screw in term.screws:
            if screw.cause not in products:
                values = np.atleast_1d(screw.cause.of(problem.state))
                product = values @ probe[: len(values)]
                products[screw.cause] = product.tobytes()
            key += [screw.frame, screw.axis, products[screw.cause]]
    return tuple(key)


def _evaluate_causes(problem: Problem, mechanism: Mechanism) -> list[bytes]:
    """Evaluate the causes of a mechanism's screws at all rows, one after the other."""
    causes = [screw.cause for term in mechanism.terms for screw in term.screws]
    values = {cause: np.asarray(cause.of(problem.state)).tobytes() for cause in set(causes)}
    return [values[cause] for cause in causes]
