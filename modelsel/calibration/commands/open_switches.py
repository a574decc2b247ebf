"""How far commands are off where an error switches with the side of a gravity torque that is computed from masses
which nobody declared."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..._typing import Array
from ...fitting.problem import Problem
from ...measurements.campaign.state_names import StateKind, parse_state_name
from ...mechanisms.causes import Applied
from ...mechanisms.terms import Term
from ...robot.gravity import declares_masses_beyond
from ..prediction import compute_sensitivities

if TYPE_CHECKING:
    from ..calibration import Calibration


def count_open_switches(c: Calibration, at: Problem) -> Array:
    """Count the variance (m,) [mm²] that each row of commands has to reckon with, since an error may have
    switched: the square of its step, as often as a mass at a later frame alone has its torque on the other
    side. Where all have it on one side, no masses there would switch it."""
    variance = np.zeros(len(at))
    for term, value in zip(c.terms, c.theta, strict=True):
        joint = _find_switch(term)
        if joint is None or declares_masses_beyond(c.robot, joint):
            continue
        step = np.array([[2.0 * value]])
        moved = compute_sensitivities(c, at, (term,), step)
        square = np.square(moved[:, :3, 0])
        share = _share_other_side(at, joint)
        variance += share * square.sum(1)
    return variance


def _find_switch(term: Term) -> int | None:
    """Find the joint (from 1) with the side of whose gravity torque alone a term switches; None where it does
    not."""
    causes = {screw.cause for screw in term.screws}
    (cause, *others) = causes
    if others or not isinstance(cause, Applied) or cause.function != "sign":
        return None
    names = cause.names()
    if len(names) != 1:
        return None
    (name,) = names
    variable = parse_state_name(name)
    if variable is None or variable.kind is not StateKind.TORQUE:
        return None
    return variable.joint


def _share_other_side(at: Problem, joint: int) -> Array:
    """Return the share (m,) of the later frames at which a mass alone has a joint's torque on the other side."""
    own = at.value(f"torque{joint}")
    side = np.sign(own)
    bodies = range(joint + 1, at.robot.n + 2)
    others = []
    for body in bodies:
        alone = at.value(f"torque{joint}_{body}")
        is_other = np.sign(alone) == -side
        others.append(is_other)
    return np.asarray(np.mean(others, axis=0))
