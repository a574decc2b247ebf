"""Run or rehearse one study, from its file to its result."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from ..._progress import follow
from ..._typing import Say
from ..._workers import steady_arithmetic
from ...config.study_file import Study, find_source
from ...exceptions import DataError
from ...measurements.formats.table import Source, hash_source
from ...mechanisms.registry import BUILTIN, Registry
from ..inputs.found_problems import name_study_file
from ..inputs.inputs import list_candidates, read_inputs
from ..inputs.whole_study import open_study
from ..models.model_ladder import searches_cells
from ..models.rehearsed_folds import rehearse_folds
from ..preparation.own_causes import build_own_candidates
from ..preparation.preparation import prepare
from .checkpoint import Checkpoint
from .pipeline import analyse, record_provenance, sample_posterior
from .result import Result
from .steps import READING, list_steps


@steady_arithmetic()
def run_study(
    study: Study | Path | str,
    folder: Path | str | None = None,
    *,
    registry: Registry = BUILTIN,
    say: Say | None = None,
    sampling: bool = True,
    checkpoint: Checkpoint | None = None,
    progress: bool | None = None,
) -> Result:
    """Run a study and return its result; write nothing but the checkpoint.

    Args:
        study: a study file, its folder, or a Study.
        folder: where the study's files are; by default the folder of the study file.
        registry: the mechanisms by name.
        say: receives one line per step, for a progress display of your own.
        sampling: whether emcee samples the posterior, which takes most of a study's time.
        checkpoint: keeps an unfinished chain for `--resume`; clear it once the result is saved.
        progress: show what is being done and how long it will take, in a notebook or on the error stream;
            by default on a terminal, unless `say` is given.

    Raises:
        StudyError, DataError or NotEstimable.
    """
    study, folder = open_study(study, folder)
    with follow(say, progress, list_steps(study, sampling)) as tell:
        result = _analyse_study(study, folder, registry, tell, checkpoint)
        return sample_posterior(result, registry, tell, checkpoint) if sampling else result


def _analyse_study(
    study: Study, folder: Path, registry: Registry, say: Say, checkpoint: Checkpoint | None
) -> Result:
    """Read a study's files and run all of its steps but the sampling."""
    say(f"{READING} {study.measurements.file}")
    source = find_source(study, folder)
    state_before = _read_file_state(source)
    robot, registry, measured, labels = read_inputs(study, folder, registry)
    data_sha256 = hash_source(source)
    if state_before is not None and state_before != _read_file_state(source):
        raise DataError(
            "the file changed while it was read.",
            file=study.measurements.file,
            remedy="Run again when it is complete.",
        )
    if checkpoint is not None:
        checkpoint.bind(record_provenance(study, robot, data_sha256))
    with name_study_file(study.file_name):
        return analyse(
            study,
            robot,
            measured,
            registry=registry,
            labels=labels,
            say=say,
            data_sha256=data_sha256,
        )


def _read_file_state(path: Source) -> tuple[int, int, int] | None:
    """Return what changes when a file is written to; None for what is no file."""
    if not isinstance(path, (str, os.PathLike)):
        return None
    try:
        state = Path(path).stat()
    except (OSError, ValueError):
        return None
    return state.st_ino, state.st_size, state.st_mtime_ns


def rehearse_study(
    study: Study | Path | str, folder: Path | str | None = None, *, registry: Registry = BUILTIN
) -> dict[str, Any]:
    """Make every check that precedes the computation and return what the study would do.

    Raises as `run_study` does.
    """
    study, folder = open_study(study, folder)
    robot, registry, measured, labels = read_inputs(study, folder, registry)
    with name_study_file(study.file_name):
        split, floor, notes = prepare(study, robot, measured, labels)
        base, folds = rehearse_folds(study, split, notes, registry)
    kept = split.problem.data
    estimating = kept.take(split.estimation)
    held_out = kept.take(~split.estimation)
    configurations = {"estimation": estimating.configurations, "held_out": held_out.configurations}
    listed = list_candidates(study, robot, registry)
    candidates = {candidate.name for candidate in listed}
    groups = build_own_candidates(study, split.problem)
    own = [m for group in groups for m in group.mechanisms]
    beyond = [m for m in own if m not in base.mechanisms]
    return {
        "study": study.name,
        "robot": robot.name,
        "rows": len(measured),
        "configurations": configurations,
        "registered": bool(study.robot.register_),
        "noise_floor_mm": None if floor is None else floor.coordinate_mm,
        "base": list(base.names),
        "base_parameters": len(base.terms),
        "mechanisms": len(candidates),
        "cells": searches_cells(study),
        "own_explanations": len(beyond),
        "nested_folds": folds,
        "warnings": [{"code": note.code, "sentence": note.sentence} for note in notes],
    }
