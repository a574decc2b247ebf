"""A Python module of a calibration: the program of `standalone.py`, the same for every arm, and
data, which are only data.

Names come from files that anyone may have written. They are written as literals, read back as
literals, and never run here."""

from __future__ import annotations

import ast
from collections.abc import Sequence
from importlib.resources import files
from pprint import pformat
from typing import TYPE_CHECKING, Any

import numpy as np

from ..._typing import Array
from ...fitting.design import PLACE
from ...fitting.problem import Problem
from ...measurements.campaign.state_names import StateKind, state_kind
from ...mechanisms.causes import Applied, Bump, Cause, Combined, Named, Number
from ..constant_part import constant_entries, split_parts
from ..prediction import compute_pose, to_tracker_frame
from .form import Exported, measure_export
from .notes import find_group
from .standalone import predict_both

if TYPE_CHECKING:
    from ..calibration import Calibration

START = "DATA: Data = "  # of the last line of standalone.py, and of what a module has in its place
# kinds of state that joint readings do not say
GIVEN_KINDS = (
    StateKind.APPROACH,
    StateKind.MOVE,
    StateKind.DRAG,
    StateKind.RATE,
    StateKind.SINCE_REST,
)


def load_program() -> str:
    """Load the text of standalone.py up to its data."""
    folder = files(__package__)
    program = folder.joinpath("standalone.py")
    text = program.read_text(encoding="utf-8")
    before, _, data = text.rpartition(START)
    assert data == "{}\n"
    return before


def write_module(data: dict[str, Any]) -> str:
    """Write the module's text: the program, then its data as one literal of plain ASCII, so that no
    letter in it changes how the lines are read."""
    literal = pformat(data, width=130, sort_dicts=False)
    escaped = literal.encode("ascii", "backslashreplace")
    ascii_literal = escaped.decode()
    program = load_program()
    return f"{program}{START}{ascii_literal}\n"


def read_module_data(text: str) -> dict[str, Any]:
    """Read the data of a module's text as a literal. Raises ValueError where the text is another
    program, or its data are no literal."""
    mark = f"\n{START}"
    before, _, literal = text.partition(mark)
    program = f"{before}\n"
    if program != load_program():
        raise ValueError("not a module of `modelsel export --format python`")
    data: dict[str, Any] = ast.literal_eval(literal)
    return data


def cause_tree(cause: Cause) -> Any:
    """Write a cause as the nested lists that `evaluate_cause` of standalone.py reads."""
    match cause:
        case Number(number):
            return float(number)
        case Named(name):
            return ["name", name]
        case Applied(function, argument):
            return [function, cause_tree(argument)]
        case Combined(operator, left, right):
            return [operator, cause_tree(left), cause_tree(right)]
        case Bump(name, centre, width):
            return ["spline", ["name", name], float(centre), float(width)]
    raise TypeError(f"{cause} is not a function of the state")


def module_data(c: Calibration) -> dict[str, Any]:
    """Return the numbers of `DATA` in standalone.py, for the first group."""
    R = c.placement[0][0]
    t = c.placement[1][0]
    tools = {}
    constants = {}
    terms = {}
    for k, target in enumerate(c.targets):
        tools[target] = c.tools[k].tolist()
        constants[target] = constant_entries(c, k).tolist()
        _, varying = split_parts(c, k)
        terms[target] = [
            [screw.frame, PLACE[screw.axis], float(part.value), cause_tree(screw.cause)]
            for part in varying
            for screw in part.term.screws
        ]
    gravity = None
    if c.robot.gravity is not None:
        gravity = list(c.robot.gravity)
    joints = c.robot.joints
    matrix = np.eye(c.robot.n)
    if c.robot.coupling is not None:
        matrix = c.robot.coupling.matrix
    return {
        "study": c.study,
        "robot": c.robot.name,
        "group": find_group(c),
        "needs": list_inputs(c),
        "after_steps": c.after_steps,
        "targets": list(c.targets),
        "prismatic": list(c.robot.prismatic),
        "coupling": matrix.tolist(),
        "before": [joint.before[:3].tolist() for joint in joints],
        "last": c.robot.last[:3].tolist(),
        "gravity": gravity,
        "masses": [float(joint.mass or 0.0) for joint in joints],
        "coms": [list(joint.com) for joint in joints],
        "tools": tools,
        "load_place": place_load(c),
        "placement": np.column_stack([R, t]).tolist(),
        "tracker": list(c.tracker),
        "constants": constants,
        "terms": terms,
    }


def place_load(c: Calibration) -> list[float]:
    """Return where a payload hangs in the flange's frame [mm]: as stated, else at the mean of the targets."""
    stated = c.robot.payload_at_mm
    if stated is not None:
        return list(stated)
    place = c.tools.mean(0)
    return list(map(float, place))


def list_inputs(c: Calibration) -> list[str]:
    """List the names that the model uses and joint readings do not say: covariates, directions of
    approach, moves, hysteresis, speeds. Their place in the campaign need not be said."""
    inputs = []
    for name in c.needs():
        kind = state_kind(name)
        if kind is None or kind in GIVEN_KINDS:
            inputs.append(name)
    return sorted(inputs)


# -- a function and a table
# ----------------------------------------------------------------------------------------------------


def to_python(c: Calibration, notes: Sequence[str] = ()) -> Exported:
    """Write a module that needs numpy only, with the numbers in it."""
    text = write_module(module_data(c))
    there = read_module_data(text)

    def run(t: int, at: Problem) -> Array:
        given = {}
        for name in there["needs"]:
            given[name] = at.value(name)
        given["progress"] = at.value("progress")
        q = at.data.readings
        _, calibrated = predict_both(there, q, c.targets[t], given)
        return calibrated

    def compute_difference(target: int, at: Problem) -> Array:
        pose = compute_pose(at, c.terms, c.theta)
        return run(target, at) - to_tracker_frame(at, pose.target.T)

    return measure_export(c, text, compute_difference)
