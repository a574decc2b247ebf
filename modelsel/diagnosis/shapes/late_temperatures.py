"""What follows the temperature late, as a link does that takes its time to warm through.

A temperature that rises and falls is a wave along the campaign to whoever does not know its column, and
to whoever does, where the arm is late; only the column says what another day brings."""

from __future__ import annotations

from collections.abc import Iterator

from ...fitting.problem import Problem
from ...measurements.campaign.clock_history import find_lags
from ...measurements.campaign.late_names import is_temperature, name_late
from ...measurements.campaign.reference_temperature import TEMPERATURE
from ...measurements.campaign.state_names import StateKind, state_kind
from ...mechanisms.causes import Cause
from ...mechanisms.environment import temperature_rise
from ...mechanisms.terms import Mechanism
from .candidate_kinds import CandidateKind
from .time_waves import generate_time_waves
from .unregistered import Unregistered, build_cell, list_distinct_places


def generate_campaign_cells(problem: Problem) -> Iterator[Unregistered]:
    """Generate what depends on the course of the campaign beside the error map: slow waves, and what
    follows the temperature late; the lags of a place weigh as much as a cell."""
    yield from generate_time_waves(problem)
    data = problem.data
    lags = find_lags(data.covariates.get(TEMPERATURE), data.late_temperature)
    rises = [_count_from_mean(problem, lag) for lag in lags]
    for place in list_distinct_places(problem):
        for rise in rises:
            cell = build_cell(place, (rise,))
            yield Unregistered(cell, CandidateKind.CELL, weight=1 / len(lags))


def _count_from_mean(problem: Problem, lag: int) -> Cause:
    """Count a late temperature from its mean: of one that hardly varies the rest would be lost beside
    what it is everywhere."""
    name = name_late(lag)
    values = problem.state.value(name)
    mean = float(f"{values.mean():.3g}")
    return temperature_rise(mean, lag)


def is_late(mechanism: Mechanism) -> bool:
    """Return whether a mechanism follows the temperature late, and depends on nothing else."""
    names = mechanism.names()
    is_of_one = bool(names) and all(map(is_temperature, names))
    return is_of_one and any(state_kind(name) is StateKind.LATE for name in names)
