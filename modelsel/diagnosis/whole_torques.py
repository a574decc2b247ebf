"""Where measurements tell a joint's whole gravity torque, of the arm's own weight and of the payload,
from that of the payload alone.

The payload must differ from row to row. About a wrist's joint the arm's own weight is next to nothing:
the payload's torque is the whole one there, and has a name already."""

from __future__ import annotations

import numpy as np

from ..fitting.problem import Problem
from ..mechanisms.compliance import PAYLOAD, payload_torque
from ..mechanisms.motors import motor_torque
from ..mechanisms.terms import Mechanism

# share of the payload's torque, both by how much they change, from which the arm's own is seen
LEAST_OWN = 0.1


def has_both_loads(problem: Problem, mechanism: Mechanism) -> bool:
    """Return whether the payload changes on these rows and a drive's own torque is seen beside it."""
    joint = mechanism.joint
    payload = problem.value(PAYLOAD)
    if joint is None or not np.ptp(payload):
        return False
    own = problem.cause(motor_torque(problem.robot, joint))
    held = problem.cause(payload_torque(problem.robot, joint))
    return bool(np.std(own) >= LEAST_OWN * np.std(held))
