"""Values that a calibration takes where a file does not have them: covariates that doubtful findings
alone look at."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..exceptions import sentence_list
from ..measurements.campaign.late_names import list_sources
from ..measurements.campaign.reference_temperature import TEMPERATURE
from ..measurements.campaign.state_names import is_state_name
from ..measurements.measurements import Measurements
from ..mechanisms.environment import find_references

if TYPE_CHECKING:
    from .calibration import Calibration


def find_assumed(c: Calibration) -> dict[str, float]:
    """Find the covariates that doubtful findings alone look at, with the value at which each is
    taken where it is not known: a temperature where its effect is counted from, others in the
    middle of what the calibration has seen."""
    firm = set[str]()
    for mechanism in c.model.mechanisms:
        if mechanism.name not in c.doubtful:
            firm |= list_sources(mechanism.names())
    names = sorted(c.needs() - firm)
    return {
        name: _choose_value(c, name)
        for name in names
        if not is_state_name(name) and name in c.ranges
    }


def _choose_value(c: Calibration, name: str) -> float:
    """Choose the value at which a covariate is taken."""
    references = set[float]()
    if name == TEMPERATURE:
        for term in c.terms:
            for screw in term.screws:
                references |= find_references(screw.cause)
    if len(references) == 1:
        return references.pop()
    low, high = c.ranges[name]
    return (low + high) / 2


def add_assumed(c: Calibration, data: Measurements, missing: Collection[str]) -> Measurements:
    """Add covariates that the data lack at the values that the calibration assumes; the data as
    they are where it does not assume all of them."""
    assumed = find_assumed(c)
    if not set(missing) <= assumed.keys():
        return data
    rows = len(data)
    added = {}
    for name in missing:
        value = assumed[name]
        added[name] = np.full(rows, value)
    covariates = {**data.covariates, **added}
    return replace(data, covariates=covariates)


def describe_assumed(c: Calibration, data: Measurements) -> list[str]:
    """Describe the covariates that the data lack and that are taken at an assumed value."""
    sentences = []
    for name, value in find_assumed(c).items():
        if name in data.covariates:
            continue
        looking = [m.name for m in c.model.mechanisms if name in list_sources(m.names())]
        names = sentence_list(looking)
        sentences.append(
            f"{name} is not in the file and taken as {value:.4g}: {names}, which alone "
            f"{'looks' if len(looking) == 1 else 'look'} at it, is doubtful (held-out configurations do not confirm it)."
        )
    return sentences
