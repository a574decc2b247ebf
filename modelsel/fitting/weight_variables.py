"""State variables of what hangs on the arm: where it hangs, which way it pulls, and the torques and moments
that it has."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .._typing import Array
from ..measurements.campaign.state_names import StateKind, StateVariable
from ..robot.gravity import compute_base_moment, compute_joint_moments, compute_unit_moments

if TYPE_CHECKING:
    from .state_variables import StateVariables

Values = dict[StateVariable, Array]


def by_axis(kind: StateKind, components: Array) -> Values:
    """Name the components (3, m) of a vector."""
    return {
        StateVariable(kind, axis=axis): row for axis, row in zip("xyz", components, strict=True)
    }


def load_on_flange(state: StateVariables) -> Values:
    """Return where a payload hangs on the flange."""
    place = state.load_place()
    count = len(state.data)
    rows = np.tile(place, (count, 1))
    places = rows.T
    return by_axis(StateKind.LOAD_ON_FLANGE, places)


def load_position(state: StateVariables) -> Values:
    """Return where a payload hangs in frame 0."""
    at = state.loaded_pose()
    return by_axis(StateKind.LOAD_POSITION, at.target)


def down(state: StateVariables) -> Values:
    """Return the direction of gravity in the target's frame."""
    at = state.pose()
    gravity = _gravity(state)
    last_axes = at.axes[-1, :3]
    pulls = np.einsum("aim,i->am", last_axes, gravity)
    return by_axis(StateKind.DOWN, pulls)


def down_at_joints(state: StateVariables) -> Values:
    """Return the direction of gravity in the frame of every joint."""
    out: Values = {}
    at = state.loaded_pose()
    gravity = _gravity(state)
    axes = at.axes[:-1, :3]
    pulls = np.einsum("jaim,i->jam", axes, gravity)
    for joint, rows in enumerate(pulls, 1):
        for axis, row in zip("xyz", rows, strict=True):
            variable = StateVariable(StateKind.DOWN_AT_JOINT, joint, axis)
            out[variable] = row
    return out


def moment_of_base(state: StateVariables) -> Values:
    """Return the moment of the arm's weight about frame 0."""
    at = state.loaded_pose()
    readings = state.data.q
    moment = compute_base_moment(state.robot, at, readings)
    return by_axis(StateKind.BASE_MOMENT, moment)


def link_moments(state: StateVariables) -> Values:
    """Compute the torques about the joints' axes, and the moments across them."""
    out: Values = {}
    moments = compute_joint_moments(state.robot, state.loaded_pose(), state.data.q)
    for joint, rows in enumerate(moments, 1):
        out[StateVariable(StateKind.BENDING, joint, "x")] = rows[0]
        out[StateVariable(StateKind.BENDING, joint, "y")] = rows[1]
        out[StateVariable(StateKind.TORQUE, joint)] = rows[2]
    return out


def unit_moments(state: StateVariables) -> Values:
    """Compute torques and moments of 1 kg at the origin of one frame."""
    out: Values = {}
    for (joint, frame), rows in compute_unit_moments(state.robot, state.loaded_pose()).items():
        out[StateVariable(StateKind.UNIT_BENDING, joint, "x", frame)] = rows[0]
        out[StateVariable(StateKind.UNIT_BENDING, joint, "y", frame)] = rows[1]
        out[StateVariable(StateKind.UNIT_TORQUE, joint, frame=frame)] = rows[2]
    return out


def _gravity(state: StateVariables) -> Array:
    gravity = state.robot.gravity
    return np.array(gravity)
