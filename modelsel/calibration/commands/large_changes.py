"""Corrections that are larger than any that is no mistake: which rows, why, and what to do."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..._arguments import describe_value
from ..._typing import Array
from ...exceptions import ArgumentError, count_words, write_rounded
from ...measurements.campaign.visits import derive_path, describe_last_motion
from ...measurements.measurements import Measurements
from .command_notes import describe_order_dependence

if TYPE_CHECKING:
    from ..calibration import Calibration
    from .compensation import Commands

# of the arm's strongest direction: below it, and where it makes most of a change, a posture is
# nearly singular
SINGULAR = 0.1
MOST = 0.5
# of the rows: where more are beyond the bound, none is corrected
MAX_SKIPPED = 0.5
MAX_LISTED = 5

Bound = tuple[float, float]


def check_bound(bound: object) -> None:
    """Raise ArgumentError where a bound is not two positive numbers (rad, mm): nothing is beyond NaN."""
    try:
        numbers = np.asarray(bound, dtype=float)
    except (TypeError, ValueError):
        numbers = np.zeros(0)
    if numbers.shape != (2,) or not (numbers > 0).all():
        found = describe_value(bound)
        raise ArgumentError(f"bound: expected (rad, mm), two numbers above 0, found {found}.")


def find_weakest(J: Array, missing: Array) -> Array:
    """Find how far the joints turn [rad] for a millimetre along the direction in which the arm
    moves least, from its derivative J (m, k, n) and what is missing (m, k) [mm]; zero where that
    direction makes little of the change, or the arm moves in it nearly as well as in others."""
    u, s, _ = np.linalg.svd(J, full_matrices=False)
    steps = np.einsum("mki,mk->mi", u, missing) / np.maximum(s, np.finfo(float).tiny)
    total = np.square(steps).sum(1)
    share = np.divide(np.square(steps[:, -1]), total, out=np.zeros_like(total), where=total > 0)
    is_singular = (s[:, -1] < SINGULAR * s[:, 0]) & (share > MOST)
    return np.where(is_singular, 1 / np.maximum(s[:, -1], np.finfo(float).tiny), 0.0)


def measure_shares(c: Calibration, commands: Commands, bound: Bound) -> Array:
    """Measure the change of every joint, and last that of the target, in shares of the bound
    (rad, mm): (m, n + 1)."""
    bound_rad, bound_mm = bound
    bounds = np.where(c.robot.prismatic, bound_mm, bound_rad)
    joint_shares = np.abs(commands.change) / bounds
    target_share = commands.before_mm / bound_mm
    return np.column_stack([joint_shares, target_share])


def refuse_large_changes(
    c: Calibration, commands: Commands, data: Measurements, bound: Bound, file: str
) -> None:
    """Raise DataError with the first row that would be changed by more than the bound (rad, mm);
    `file`: empty for a DataFrame."""
    shares = measure_shares(c, commands, bound)
    rows = np.flatnonzero((shares > 1).any(1)).tolist()
    if not rows:
        return
    first = rows[0]
    largest = int(np.argmax(shares[first]))
    change = _describe_largest_change(c, commands, first, largest)
    count = ""
    if len(rows) > 1:
        count = f" ({len(rows)} such rows)"
    done, option = "changed", "the bound"
    if file:
        done, option = "written", "--bound"
    remedy = _advise(commands, first, data, option)
    raise data.where.refuse(
        f"{change}, beyond the {_describe_bound(bound)}{count}.",
        row=int(data.row[first]),
        remedy=f"Nothing was {done}. {remedy}",
    )


def find_skipped(
    c: Calibration, commands: Commands, data: Measurements, bound: Bound, file: str
) -> NDArray[np.bool_]:
    """Find the rows (m,) whose correction is beyond the bound (rad, mm), which are left out.

    Raises DataError where they are more than MAX_SKIPPED of all: the file is mistaken as a whole.
    """
    skipped = (measure_shares(c, commands, bound) > 1).any(1)
    if skipped.mean() > MAX_SKIPPED:
        refuse_large_changes(c, commands, data, bound, file)
    return np.asarray(skipped)


def describe_skipped(
    c: Calibration, commands: Commands, data: Measurements, bound: Bound, skipped: NDArray[np.bool_]
) -> list[str]:
    """Describe the rows that are left out, each with its own reason; of many, the first."""
    shares = measure_shares(c, commands, bound)
    rows = np.flatnonzero(skipped).tolist()
    sentences = []
    for row in rows[:MAX_LISTED]:
        largest = int(np.argmax(shares[row]))
        change = _describe_largest_change(c, commands, row, largest)
        number = int(data.row[row])
        place = data.where.name_row(number)
        remedy = _advise(commands, row, data, "--bound")
        beyond = _describe_bound(bound)
        sentences.append(f"{place} is left out: {change}, beyond the {beyond}. {remedy}")
    more = len(rows) - MAX_LISTED
    if more > 0:
        verb = "is" if more == 1 else "are"
        rest = f"{count_words(more, 'more row')} {verb} left out for the same reason."
        sentences.append(rest)
    return sentences


def leave_out_rows(data: Measurements, left_out: NDArray[np.bool_]) -> Measurements:
    """Return planned rows without some, and the motion through what remains: the row after one that
    is left out has another size of the move, and another direction where none were given."""
    rows = np.flatnonzero(~left_out)
    some = data.take(rows)
    path, on_path, _ = derive_path(
        some.readings, some.configuration, some.group, some.order, some.prismatic
    )
    approach, move = describe_last_motion(path, on_path)
    if data.approach_from_order:
        some = replace(some, approach=approach, path=path, on_path=on_path)
    return replace(some, move=move)


def describe_new_order(c: Calibration, data: Measurements) -> list[str]:
    """Say of the rows that remain that their motion is the one without those that are left out,
    where the model looks at it."""
    if not describe_order_dependence(c, data):
        return []
    return ["Approach directions were taken without the omitted rows."]


def _describe_bound(bound: Bound) -> str:
    return f"bound of {bound[0] * 1e3:g} mrad and {bound[1]:g} mm"


def _describe_largest_change(c: Calibration, commands: Commands, row: int, joint: int) -> str:
    """Describe a row's change of a joint (from 0), or of the target where `joint` is their
    number; and where the arm is nearly singular, that."""
    if joint == c.robot.n:
        distance = commands.before_mm[row]
        return f"the target would be moved by {write_rounded(distance)} mm"
    change = commands.change[row, joint]
    size = f"{write_rounded(change * 1e3)} mrad"
    if c.robot.joints[joint].prismatic:
        size = f"{write_rounded(change)} mm"
    weakest = float(commands.weakest[row])
    why = ""
    if weakest:
        why = (
            f" to move the target by {write_rounded(commands.before_mm[row])} mm, because the arm is nearly singular in this "
            f"posture (a millimetre in its weakest direction takes {write_rounded(weakest * 1e3)} mrad)"
        )
    return f"joint {joint + 1} would be changed by {size}{why}"


def _advise(commands: Commands, row: int, data: Measurements, option: str) -> str:
    """Advise what to do about a row that is changed too much."""
    if commands.weakest[row]:
        return f"Choose another posture for this point, or raise {option}."
    if np.isnan(data.position[row]).any():
        return f"Check that the command is in the units of its column, or raise {option}."
    return f"Check that the wanted position belongs to the command, or raise {option}."
