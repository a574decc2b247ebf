"""A Python module of a calibration: the program of `exported.py`, which is the same for every arm,
and data, which are only data.

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
from ...measurements.state_names import is_state_name
from ...mechanisms.causes import Applied, Bump, Cause, Combined, Named, Number
from ..constant_part import constant_entries, sample_workspace, split_parts
from ..prediction import compute_pose, to_tracker_frame
from .form import Exported
from .standalone import predict_both

if TYPE_CHECKING:
    from ..calibration import Calibration

START = "DATA: Data = "  # of the last line of exported.py, and of what a module has in its place


def load_program() -> str:
    """The text of exported.py up to its data."""
    text = files(__package__).joinpath("standalone.py").read_text(encoding="utf-8")
    before, _, data = text.rpartition(START)
    assert data == "{}\n"
    return before


def write_module(data: dict[str, Any]) -> str:
    """The module's text: the program, then its data as one literal of plain ASCII, so that no
    letter in it changes how the lines are read."""
    literal = pformat(data, width=130, sort_dicts=False)
    return f"{load_program()}{START}{literal.encode('ascii', 'backslashreplace').decode()}\n"


def read_module_data(text: str) -> dict[str, Any]:
    """The data of a module's text, read as a literal. Raises ValueError where the text is another
    program, or its data are no literal."""
    before, _, literal = text.partition(f"\n{START}")
    if f"{before}\n" != load_program():
        raise ValueError("not a module of `modelsel export --format python`")
    data: dict[str, Any] = ast.literal_eval(literal)
    return data


def cause_tree(cause: Cause) -> Any:
    """A cause as the nested lists that `exported.cause` reads."""
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
    raise TypeError(f"{cause} is no function of the state")


def module_data(c: Calibration) -> dict[str, Any]:
    """The numbers of `exported.DATA`, for the first group."""
    R, t = c.placement[0][0], c.placement[1][0]
    return {
        "study": c.study,
        "robot": c.robot.name,
        "needs": list_inputs(c),
        "targets": list(c.targets),
        "prismatic": list(c.robot.prismatic),
        "before": [j.before[:3].tolist() for j in c.robot.joints],
        "last": c.robot.last[:3].tolist(),
        "gravity": None if c.robot.gravity is None else list(c.robot.gravity),
        "masses": [float(j.mass or 0.0) for j in c.robot.joints],
        "coms": [list(j.com) for j in c.robot.joints],
        "tools": {name: c.tools[k].tolist() for k, name in enumerate(c.targets)},
        "placement": np.column_stack([R, t]).tolist(),
        "tracker": list(c.tracker),
        "constants": {name: constant_entries(c, k).tolist() for k, name in enumerate(c.targets)},
        "terms": {
            name: [
                [s.frame, PLACE[s.axis], float(p.value), cause_tree(s.cause)]
                for p in split_parts(c, k)[1]
                for s in p.term.screws
            ]
            for k, name in enumerate(c.targets)
        },
    }


def list_inputs(c: Calibration) -> list[str]:
    """Names that the model looks at and joint readings do not say: covariates, directions of
    approach, moves, progress."""
    return sorted(
        n
        for n in c.needs() - {"target", "group"}
        if n.startswith(("approach", "move")) or n == "progress" or not is_state_name(n)
    )


# -- a function and a table
# ----------------------------------------------------------------------------------------------------


def to_python(c: Calibration, notes: Sequence[str] = ()) -> Exported:
    """A module of its own: numpy only, the numbers in it."""
    text = write_module(module_data(c))
    there = read_module_data(text)

    def run(t: int, at: Problem) -> Array:
        return predict_both(
            there, at.data.q, c.targets[t], {n: at.value(n) for n in there["needs"]}
        )[1]

    worst = 0.0
    for t in range(len(c.targets)):
        at = sample_workspace(c, t)
        wanted = to_tracker_frame(at, compute_pose(at, c.terms, c.theta).target.T)
        worst = max(worst, float(np.linalg.norm(run(t, at) - wanted, axis=1).max()))
    return Exported(text, worst, len(at) * len(c.targets))
