"""What does not repeat in simulated measurements: draws of the parts of the noise."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from .._part_names import (
    ALONG_AXES,
    AT_TARGET,
    IN_GROUP,
    POSTURE,
    is_of_rows,
    list_joints,
    name_rows,
)
from .._typing import Array, Index
from ..config.study_tables import SimulateTable
from ..exceptions import StudyError, sentence_list
from ..measurements.measurements import Measurements

NOWHERE = np.zeros(3)


@dataclass(frozen=True, eq=False)
class Unrepeated:
    """How far the arm is from its readings: `joints` (m, n) [rad, mm], and how far what is seen of
    it is from there: `shift` (m, 3) [mm]; `along` (3,) or (m, 3): what the instrument has along each
    axis beyond its noise in all directions and rows, as standard deviations [mm]."""

    joints: Array
    shift: Array
    along: Array

    def raise_noise(self, target: str, parts: Mapping[str, float]) -> Unrepeated:
        """Return the same at a target, with what the instrument has there alone."""
        name = AT_TARGET + target
        more = parts.get(name, 0.0)
        along = np.hypot(self.along, more)
        return replace(self, along=along)


NOTHING = Unrepeated(np.zeros(1), NOWHERE, NOWHERE)  # stands for zero of any rows


def draw_unrepeated(
    table: SimulateTable, visits: Measurements, rng: np.random.Generator
) -> Unrepeated:
    """Draw the parts of the noise that a study plants, at visits in rows of their own.

    A joint has one draw a visit; what a visit, a posture or a group shares moves all targets alike
    in the tracker's frame; what lasts does so along the order of motion."""
    count, joints = visits.q.shape
    off = np.zeros((count, joints))
    for name, joint in list_joints(table.parts).items():
        off[:, joint - 1] = rng.normal(0.0, table.parts[name], count)
    shift = np.zeros((count, 3))
    levels = {"configuration": np.arange(count), POSTURE: visits.block, "group": visits.group}
    for name, level in levels.items():
        if name in table.parts:
            shift += _draw_shared(table.parts[name], level, rng)
    if "lasting" in table.parts:
        scale, length = table.parts["lasting"], table.lasting_visits
        shift += _draw_lasting(scale, length, visits.progress, rng)
    along = np.array([table.parts.get(name, 0.0) for name in ALONG_AXES])
    in_groups = np.array([table.parts.get(f"{IN_GROUP}{name}", 0.0) for name in visits.groups])
    in_rows = in_groups[visits.group]
    return Unrepeated(off, shift, np.hypot(along, in_rows[:, None]))


def check_planted_rows(parts: Iterable[str], targets: Sequence[str], groups: Sequence[str]) -> None:
    """Check the targets and groups that are to have more noise. Raises StudyError."""
    problems = []
    for name in parts:
        what, there = "groups", groups
        if name.startswith(AT_TARGET):
            what, there = "targets", targets
        if not is_of_rows(name) or name_rows(name) in there:
            continue
        listed = sentence_list(there)
        problem = f'simulate.parts: "{name}", but the {what} are {listed}.'
        problems.append(problem)
    if problems:
        raise StudyError(*problems)


def _draw_shared(scale: float, level: Index, rng: np.random.Generator) -> Array:
    """Draw (m, 3) what rows of one level (m,) share."""
    draws = rng.normal(0.0, scale, (int(level.max()) + 1, 3))
    return draws[level]


def _draw_lasting(scale: float, length: float, progress: Array, rng: np.random.Generator) -> Array:
    """Draw (m, 3) what lasts along the order of motion, correlated by exp(-visits / length)."""
    from scipy.signal import lfilter

    kept = np.exp(-1.0 / length)
    steps = rng.normal(0.0, scale, (len(progress), 3))
    steps[1:] *= np.sqrt(1.0 - kept**2)
    lasting = np.empty_like(steps)
    lasting[np.argsort(progress, kind="stable")] = lfilter([1.0], [1.0, -kept], steps, axis=0)
    return lasting
