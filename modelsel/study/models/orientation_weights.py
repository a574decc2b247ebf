"""Weights of positions against orientations, where the uncertainty of either is not known.

First by what the nominal arm leaves and what the base leaves, so that something may be named; then
by the noise beside what is named, and effects are named once more with these weights."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..._typing import Array
from ...config.study_file import Study
from ...diagnosis.base_fits import keep_base
from ...diagnosis.candidates.candidate import Candidate
from ...diagnosis.candidates.options import DiagnosisOptions
from ...diagnosis.findings.outcome import Diagnosis
from ...diagnosis.procedure import diagnose_split
from ...diagnosis.separation import Inquiry
from ...fitting.component_noise import POSITION, ROTATION, compare_noise, scale_noise
from ...fitting.design import Model
from ...fitting.noise import weigh
from ...fitting.possible_parts import choose_parts, list_parts
from ...mechanisms.registry import Registry
from ...selection.evaluation import Split, evaluate
from ..preparation.preparation import read_instrument
from .model_ladder import build_model

# times that effects are named at most
MOST_NAMINGS = 3
# factor between the noise of orientations and of positions that is no change
SAME_NOISE = 1.1

Named = tuple[Split, Diagnosis, tuple[Candidate, ...]]


def diagnose_weighed(study: Study, registry: Registry, split: Split, asked: Inquiry) -> Named:
    """Diagnose a split whose orientations have the weight that is found beside what is named."""
    if not _is_open(study, split):
        return diagnose_split(split, asked)
    split = _weigh_by_models(study, registry, split, asked.base)
    named = diagnose_split(split, asked)
    asked = asked._replace(tell_base=keep_base)
    for _ in range(MOST_NAMINGS - 1):
        factor = _compare(named, asked.options)
        if 1 / SAME_NOISE < factor < SAME_NOISE:
            break
        split = _scale(split, factor)
        named = diagnose_split(split, asked)
    return named


def _is_open(study: Study, split: Split) -> bool:
    """Whether orientations are measured, and the uncertainty of these or of positions is unknown."""
    data = split.problem.data
    if data.rotation is None:
        return False
    return data.sigma_rotation is None or not _knows_positions(study, split)


def _knows_positions(study: Study, split: Split) -> bool:
    """Whether the uncertainty of positions is stated."""
    noise = study.noise
    data = split.problem.data
    if data.sigma is not None:
        return True
    if noise.floor_mm is not None:
        return True
    return read_instrument(noise) is not None


def _weigh_by_models(study: Study, registry: Registry, split: Split, base: Model) -> Split:
    """Weigh by what the nominal arm leaves, then by what the base leaves."""
    nominal = build_model(study, split.problem, registry, ())
    for model in (nominal, base):
        evaluation = evaluate(split, model, ())
        split = _weigh_by_residuals(study, split, evaluation.residual)
    return split


def _weigh_by_residuals(study: Study, split: Split, residual: Array) -> Split:
    """Weigh position against orientation by the residuals (m, 6) [mm, rad] of a model.

    Whichever of the two has no stated uncertainty takes the spread of its own residuals."""
    instrument = read_instrument(study.noise)
    position_mm = study.noise.floor_mm
    if not _knows_positions(study, split):
        position_mm = _measure_spread(split, residual, POSITION)
    rotation_rad = _measure_spread(split, residual, ROTATION)
    problem, _ = weigh(split.problem, instrument, position_mm, rotation_rad)
    return replace(split, problem=problem)


def _measure_spread(split: Split, residual: Array, part: slice) -> float:
    """Return the root mean square of the coordinates `part` over the rows that fit."""
    used = split.used
    measured = split.problem.measured
    used_residual = residual[used]
    coordinates = used_residual[:, part]
    squares = np.square(coordinates)
    if measured is None:
        mean = squares.mean()
        return float(np.sqrt(mean))
    used_measured = measured[used]
    count = used_measured[:, part].sum()
    total = squares.sum()
    mean = total / max(count, 1)
    spread = np.sqrt(mean)
    return float(spread)


def _compare(named: Named, options: DiagnosisOptions) -> float:
    """Estimate the noise of orientations over that of positions beside what is named, in units of
    their weights."""
    split, diagnosis, _ = named
    problem = split.problem
    estimation = split.estimation
    listed = list_parts(problem, estimation)
    allowed = options.parts
    fixed = options.fixed_parts
    parts = choose_parts(listed, allowed, fixed)
    used = split.used
    return compare_noise(problem, used, diagnosis.fit, parts)


def _scale(split: Split, factor: float) -> Split:
    """Weigh orientations by a noise larger by a factor; where it is stated, positions by a smaller
    one."""
    problem = split.problem
    if problem.data.sigma_rotation is None:
        scaled = scale_noise(problem, ROTATION, factor)
    else:
        scaled = scale_noise(problem, POSITION, 1 / factor)
    return replace(split, problem=scaled)
