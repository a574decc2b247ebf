"""Powers of the gravity torque about a joint: a spring that hardens or softens, a contact that
closes. They are told as what they are, without a cause."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..fitting.problem import Problem
from ..mechanisms.causes import Applied, Number, torque
from ..mechanisms.motors import joint_axis
from ..mechanisms.terms import Mechanism
from .unregistered import build_cell

# the power of which an error is looked for everywhere; the others stand beside a finding
SQUARE = "2"


def build_powers(problem: Problem, joint: int) -> dict[str, Mechanism]:
    """Build a joint's motions with powers of its torque over the typical one, by the power."""
    load = torque(joint)
    values = problem.state.value(f"torque{joint}")
    mean = np.abs(values).mean()
    typical = float(f"{mean:.4g}")
    if not typical:
        return {}
    share = load / Number(typical, load.unit)
    size = Applied("abs", share)
    root = Applied("root", share)
    powers = {
        "0.5": root,
        "1.5": size * root,
        SQUARE: size * share,
        "2.5": size * size * root,
        "3": size * size * share,
    }
    place = joint, joint_axis(problem.robot, joint)
    built = {}
    for power, cause in powers.items():
        words = f"torque{joint} to the power {power}"
        sentence = f"Joint {joint} yields with the gravity torque about it to the power {power}"
        built[power] = build_cell(place, (cause,), words, sentence)
    return built


def generate_powers(problem: Problem, found: Mechanism) -> Iterator[Mechanism]:
    """Generate powers of the torque about a joint that moves with it. None for any other finding."""
    places = list(found.names_by_place())
    joint, axis = places[0]
    if len(places) > 1 or joint > problem.robot.n:
        return
    is_motion = axis == joint_axis(problem.robot, joint)
    if is_motion and found.names() == {f"torque{joint}"}:
        yield from build_powers(problem, joint).values()
