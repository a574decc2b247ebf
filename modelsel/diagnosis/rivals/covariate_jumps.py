"""Where a covariate jumps, and the stretch of the campaign that it tells from the rest."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ...exceptions import sentence_list, write_percent
from ...measurements.measurements import Measurements
from ...mechanisms.causes import Cause
from ...mechanisms.environment import step_after
from ..candidates.session_steps import list_changes, round_between

# steps, at most
MOST_STEPS = 6
# share of a covariate's range by which it jumps
JUMP = 0.4


class Stretch(NamedTuple):
    """A part of the campaign: 1 there and 0 elsewhere, and when that is in words."""

    course: Cause
    when: str


def list_moments(data: Measurements, name: str) -> list[tuple[float, str]]:
    """List the moments where sessions meet, or else those where a covariate jumps, each with what begins
    there in words; none of many."""
    moments = list_changes(data) or list(_list_jumps(data, name))
    if len(moments) > MOST_STEPS:
        return []
    return moments


def say_moments(data: Measurements, moments: Sequence[tuple[float, str]]) -> str:
    """Say from when on something is another one, at moments that were listed."""
    words = [text for _, text in moments]
    if len(words) > 1 and list_changes(data):
        return "in every session"
    return sentence_list(words)


def _list_jumps(data: Measurements, name: str) -> Iterator[tuple[float, str]]:
    """List the moments where a covariate jumps, in words, too."""
    for moment, _ in measure_jumps(data, name):
        yield moment, f"after {_write_moment(moment)} of the campaign"


def measure_jumps(data: Measurements, name: str) -> Iterator[tuple[float, float]]:
    """Measure where a covariate jumps, and by how much."""
    column = data.covariates.get(name)
    # what follows a column late does not jump
    if column is None or not len(column):
        return
    order = np.argsort(data.progress, kind="stable")
    progress = data.progress[order]
    values = column[order]
    least = JUMP * np.ptp(values)
    size = np.diff(values)
    for k in np.flatnonzero(np.abs(size) > least):
        before, after = progress[k : k + 2]
        yield round_between(before, after), float(size[k])


def find_stretch(data: Measurements, name: str) -> Stretch | None:
    """Find the stretch of the campaign that a covariate tells from the rest: from its one jump on, or
    from a jump to the one back; None where it jumps otherwise."""
    jumps = list(measure_jumps(data, name))
    if not 1 <= len(jumps) <= 2:
        return None
    (begins, up), (ends, down) = jumps[0], jumps[-1]
    start = _write_moment(begins)
    course = step_after(begins)
    if len(jumps) == 1:
        return Stretch(course, f"after {start} of the campaign")
    if up * down > 0:
        return None
    back = step_after(ends)
    end = _write_moment(ends)
    return Stretch(course - back, f"between {start} and {end} of the campaign")


def _write_moment(moment: float) -> str:
    return write_percent(moment, 1)
