"""Functions of the gravity torque about a joint, told as one.

A drive that stiffens may be found as a compliance and a power of the same torque with the other sign.
Each takes most of the other back, so that neither has a size of its own: what stands is their sum."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...fitting.problem import Problem
from ...mechanisms.causes import find_bump
from ...mechanisms.motors import is_joint_motion
from ...mechanisms.terms import Mechanism, Term
from ...robot.kinematics import Robot
from ..candidates.candidate import Candidate
from ..rivals.finding_groups import build_listed
from ..search.state import Search
from ..search.views import View
from ..shapes.whole_torques import find_load
from .effects import Effect
from .sentences import has_contrary_signs

# share by which a joint yields more or less per torque at its largest torque than at smaller ones, from
# which that is told
LEAST_BEND = 0.05


def find_loaded_joint(robot: Robot, found: Mechanism) -> int | None:
    """Find the joint that moves by functions of the gravity torque about it alone, of the arm's own
    weight or with the payload's; None for anything else."""
    names_by_place = found.names_by_place()
    if len(names_by_place) != 1:
        return None
    ((place, names),) = names_by_place.items()
    joint, _ = place
    if not is_joint_motion(robot, place) or find_load(robot, joint, names) is None:
        return None
    return joint


def list_together(
    search: Search, view: View, chosen: Sequence[int]
) -> list[tuple[tuple[int, ...], Candidate]]:
    """List the effects that move one joint by functions of its torque, and their sum as one candidate.

    Where physics allows all of them as they are, a compliance and a play, they stay apart."""
    by_load: dict[tuple[int, frozenset[str]], list[int]] = {}
    for g in chosen:
        found = search.traits.acting_parts[g].mechanism
        joint = find_loaded_joint(search.problem.robot, found)
        if joint is not None and not search.candidates[g].asked:
            by_load.setdefault((joint, found.names()), []).append(g)
    together = []
    for members in by_load.values():
        are_named = all(_is_named(search.candidates[g], view) for g in members)
        if len(members) > 1 and not are_named:
            joined = _join([search.traits.acting_parts[g] for g in members])
            together.append((tuple(members), joined))
    return together


def _is_named(candidate: Candidate, view: View) -> bool:
    """Return whether a candidate is a registered mechanism with the sign that this has."""
    fitted = view.fitted
    mechanism = candidate.mechanism
    estimate = fitted.theta[fitted.locate(mechanism)]
    return candidate.registered and not has_contrary_signs(mechanism, estimate)


def _join(effects: Sequence[Candidate]) -> Candidate:
    """Join effects of one joint to one candidate, with a number for each of their terms."""
    listed = build_listed(effects)
    # a free function first: it has no value at no load
    terms = sorted(listed.mechanism.terms, key=lambda term: find_bump(term.screws[0].cause) is None)
    numbered = [Term(f"m{k}", term.screws) for k, term in enumerate(terms, 1)]
    first = terms[0].screws[0]
    # named as a place of the error map is: no registered mechanism
    name = f"{first.frame} {first.axis} {listed.mechanism.name}"
    joined = Mechanism(name, tuple(numbered))
    return Candidate(joined, listed.kind, listed.prior)


def find_bend(problem: Problem, effect: Effect) -> str:
    """Find whether a joint that yields to its torque, not in proportion, "stiffens" or "softens" with
    it; nothing of any other effect, and where a named mechanism may be what is found."""
    entries = effect.named.entries
    is_named = any(entry.candidate.registered for entry in entries)
    if is_named or effect.candidate.registered:
        return ""
    found = effect.candidate.mechanism
    causes = [term.screws[0].cause for term in found.terms]
    joint = find_loaded_joint(problem.robot, found)
    if joint is None or any(find_bump(cause) is not None for cause in causes):
        return ""
    state = problem.state
    torque = find_load(problem.robot, joint, found.names())
    assert torque is not None
    load = np.asarray(torque.of(state))
    size = np.abs(load)
    each = np.array([np.broadcast_to(cause.of(state), load.shape) for cause in causes])
    turn = np.asarray(effect.estimate) @ each
    largest = int(size.argmax())
    is_small = size < size[largest] / 2
    small_square = float(np.square(load[is_small]).sum())
    if not small_square:
        return ""
    at_most = float(turn[largest] / load[largest])
    before = float(load[is_small] @ turn[is_small]) / small_square
    if at_most <= 0 or abs(before - at_most) < LEAST_BEND * at_most:
        return ""
    return "stiffens" if before > at_most else "softens"
