"""One study, from its file to its result."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .._random import generator
from .._typing import Say
from ..config.study_file import Study, find_source, read_study
from ..exceptions import DataError, StudyError
from ..fitting.noise import Instrument
from ..fitting.problem import Problem
from ..measurements.measurements import Measurements, build_measurements
from ..measurements.observation_columns import KnownFeature, apply_known_features
from ..measurements.reader import read_labels, read_measurements
from ..measurements.table import Source, hash_source
from ..mechanisms.causes import parse
from ..mechanisms.registry import (
    BUILTIN,
    Registry,
    build_faults,
    build_mechanisms,
    every,
    mechanism,
    set_reference,
)
from ..mechanisms.terms import Mechanism, Screw, unstorable
from ..robot.files import load, read_robot
from ..robot.kinematics import Robot
from .checkpoint import Checkpoint
from .pipeline import Question, analyse, provenance, with_sampling
from .preparation import Plan, prepare, tools_of
from .result import Result
from .simulation import simulate, simulate_rows

if TYPE_CHECKING:
    import pandas as pd


def robot_of(study: Study, folder: Path) -> Robot:
    """The study's nominal robot. Raises StudyError."""
    if study.robot.nominal is not None:
        return study.robot.nominal
    if study.robot.name is not None:
        return load(study.robot.name)
    return read_robot(folder / str(study.robot.file), study.robot.base, study.robot.tip)


def plan_of(study: Study) -> Plan:
    """The study's set-up as plain values."""
    table, noise = study.robot, study.noise
    tools = (
        {k: tuple(v) for k, v in table.tools_mm.items()}
        if table.tools_mm
        else (tuple(table.tool_mm) if table.tool_mm else None)
    )
    x, y, z = noise.tracker_mm
    instrument = (
        Instrument(noise.range_mm, noise.range_ppm, noise.angle_urad, (x, y, z))
        if noise.instrument
        else None
    )
    return Plan(
        study.seed,
        tools,
        bool(table.register_),
        table.register_ == "per group",
        study.split.estimation,
        study.split.column,
        study.split.held_out,
        study.comparison.folds,
        study.comparison.by,
        noise.floor_mm,
        instrument,
        (x, y, z),
    )


def known_features(study: Study) -> dict[str, KnownFeature]:
    """What a study says of its features, as plain values."""

    def vector(value: list[float] | None) -> tuple[float, float, float] | None:
        return None if value is None else (value[0], value[1], value[2])

    return {
        name: KnownFeature(
            vector(f.position_mm), vector(f.normal), f.length_mm, f.estimate, f.zero == "unknown"
        )
        for name, f in study.measurements.features.items()
    }


def check_names(study: Study, robot: Robot, registry: Registry) -> None:
    """Every mechanism a study names is known and applies, and all that it may use can be stored
    with its calibration; all problems at once. Raises StudyError."""
    problems: dict[str, None] = {}
    named = [
        ("model.base", study.model.base),
        *(("model.ladder", rung_) for rung_ in study.model.ladder),
    ]
    if study.model.candidates != "all":
        named.append(("model.candidates", list(study.model.candidates)))
    for place, names in named:
        for name in names:
            try:
                why = unstorable(mechanism(name, robot, registry))
            except StudyError as error:
                problems[f"{place}: {error}"] = None
            else:
                problems |= {} if why is None else {f"{name}: {why}": None}
    if study.model.candidates == "all":
        problems |= {
            f"{m.name}: {why}": None
            for m in every(robot, registry)
            if (why := unstorable(m)) is not None
        }
    if problems:
        raise StudyError(*problems)


def candidates_of(study: Study, robot: Robot, registry: Registry) -> tuple[Mechanism, ...]:
    """The mechanisms that may extend the base, one a joint."""
    if study.model.candidates in ("all", []):
        return (*build_faults(robot), *every(robot, registry))  # of exact twins the first is named
    return tuple(
        dict.fromkeys(
            part
            for name in study.model.candidates
            for part in build_mechanisms(name, robot, registry)
        )
    )


def opened(study: Study | Path | str, folder: Path | str | None) -> tuple[Study, Path]:
    """A study and the folder that its files stand in: given, or that of the study's own file, or
    the present one."""
    if isinstance(study, Study):
        return study, Path(folder or ".")
    path = Path(study)
    return read_study(path), Path(
        folder
    ) if folder is not None else path if path.is_dir() else path.parent


def asked(
    study: Study, folder: Path, registry: Registry
) -> tuple[Question, Measurements, NDArray[np.object_] | None, Source]:
    """What a study asks, of which measurements, with its split's labels, and where they are. Raises
    StudyError or DataError."""
    robot = robot_of(study, folder)
    check_names(study, robot, registry)
    source = find_source(study, folder)
    measured = read_measurements(source, robot.prismatic, study.measurements.columns)
    measured = apply_known_features(measured, known_features(study))
    registry = set_reference(registry, measured.reference_celsius)
    labels = None
    if study.split.column is not None:
        labels = read_labels(source, study.split.column)[measured.row]
    return (
        Question(study, plan_of(study), robot, candidates_of(study, robot, registry), registry),
        measured,
        labels,
        source,
    )


def _state(path: Source) -> tuple[int, int, int] | None:
    """What tells whether a file was written to."""
    try:
        found = Path(path).stat()
        return found.st_ino, found.st_size, found.st_mtime_ns
    except (OSError, ValueError, TypeError):
        return None


def run(
    study: Study | Path | str,
    folder: Path | str | None = None,
    *,
    registry: Registry = BUILTIN,
    say: Say = lambda _: None,
    sampling: bool = True,
    checkpoint: Checkpoint | None = None,
) -> Result:
    """Run a study: a study file or its folder, or a Study, whose files stand in `folder`.
    `sampling`: whether emcee samples the posterior, most of the time a study takes. `checkpoint`:
    where an unfinished chain is kept and taken up again, to be cleared when the result is saved;
    without it nothing is written. Raises StudyError, DataError or NotEstimable."""
    study, folder = opened(study, folder)
    say(f"reading {study.measurements.file}")
    before = _state(find_source(study, folder))
    question, measured, labels, source = asked(study, folder, registry)
    data_sha256 = hash_source(source)
    if before is not None and before != _state(source):
        raise DataError(
            "the file changed while it was read.",
            file=study.measurements.file,
            remedy="Run again when it is complete.",
        )
    if checkpoint is not None:
        checkpoint.bind(provenance(study, data_sha256))
    result = analyse(question, measured, labels=labels, say=say, data_sha256=data_sha256)
    return with_sampling(question, result, say, checkpoint) if sampling else result


def rehearse(
    study: Study | Path | str, folder: Path | str | None = None, *, registry: Registry = BUILTIN
) -> dict[str, Any]:
    """Everything that a study checks before it computes, and what it would then do. Raises as `run`
    does."""
    study, folder = opened(study, folder)
    question, measured, labels, _ = asked(study, folder, registry)
    data, floor, notes = prepare(question.robot, measured, question.plan, labels)
    model, kept = question.model(study.model.base, measured), data.problem.data
    return {
        "study": study.name,
        "robot": question.robot.name,
        "rows": len(measured),
        "configurations": {
            "estimation": kept.take(data.estimation).configurations,
            "held_out": kept.take(~data.estimation).configurations,
        },
        "registered": question.plan.register,
        "noise_floor_mm": None if floor is None else floor.coordinate_mm,
        "base": list(model.names),
        "base_parameters": len(model.terms),
        "mechanisms": len({m.name for m in question.everything}),
        "cells": question.cells,
        "warnings": [{"code": n.code, "sentence": n.sentence} for n in notes],
    }


def simulate_study(study: Study | Path | str, folder: Path | str | None = None) -> pd.DataFrame:
    """Data with the study's planted effects, at the configurations of its measurements where there
    are any, else drawn."""
    study, folder = opened(study, folder)
    robot, rng = robot_of(study, folder), generator(study.seed, "simulate")
    source = find_source(study, folder)
    rows: Measurements | None = None
    if not isinstance(source, Path) or source.is_file():
        measured = read_measurements(
            source, robot.prismatic, study.measurements.columns, positions=False
        )
        rows = (
            None
            if measured.gauges is None
            else apply_known_features(measured, known_features(study))
        )
        at = measured.take(np.unique(measured.configuration, return_index=True)[1])
        at = replace(at, target=np.zeros(len(at), np.intp), targets=("target",), gauges=None)
    else:
        q = robot.draw(rng, study.simulate.configurations)
        at = build_measurements(q, np.zeros((len(q), 3)))
    units = Problem(robot, at, np.zeros((1, 3))).names()
    effects = []
    for k, effect in enumerate(study.simulate.effect, 1):
        if effect.frame > robot.n + 1:
            raise StudyError(
                f"simulate.effect {k}: frame {effect.frame}, but {robot.name} has frames 1 to {robot.n + 1}"
            )
        effects.append(
            (
                Screw(
                    effect.frame, effect.axis, parse(effect.cause, units, f"simulate.effect {k}")
                ),
                effect.size,
            )
        )
    noise = study.noise.floor_mm if study.noise.floor_mm is not None else study.simulate.noise_mm
    if rows is not None:
        return simulate_rows(
            robot, tools_of(rows, plan_of(study).tools), effects, data=rows, noise_mm=noise, rng=rng
        )
    if study.robot.tools_mm:
        import pandas as pd

        frames = [
            simulate(robot, np.array(tool), effects, at=at, noise_mm=noise, rng=rng).assign(
                target=name, configuration=range(len(at))
            )
            for name, tool in study.robot.tools_mm.items()
        ]
        return pd.concat(frames).sort_values("configuration", kind="stable", ignore_index=True)
    tool = np.array(study.robot.tool_mm if study.robot.tool_mm is not None else (0.0, 0.0, 0.0))
    return simulate(robot, tool, effects, at=at, noise_mm=noise, rng=rng)
