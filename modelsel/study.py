"""One study, from its file to its result: the module that calls all the others."""
from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from . import __version__
from .causes import parse
from .compare import Comparison, Data, Rung, applicable, compare, rung
from .config import Study, find_data, read_study
from .design import Model
from .errors import StudyError
from .fit import Fit
from .identify import Unidentifiable, unidentifiable
from .io import read_labels, read_measurements
from .measurements import Measurements, Note, measurements
from .mechanisms.geometry import setup
from .noise import Floor, Instrument
from .prepare import Plan, generator, prepare, reweigh_rotation
from .registry import BUILTIN, Registry, every, mechanism, parts
from .result import candidates_dict, dumps, rung_dict
from .rigid import Array
from .robot import Robot
from .robotfile import load, read_robot
from .scene import scene
from .screws import Mechanism, Screw
from .simulate import simulate
from .validate import Gain, gain
from .write import write_beside

if TYPE_CHECKING:
    import pandas as pd

Say = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class Result:
    """A finished study: values for programs, `to_json` for the contract's file."""

    study: Study
    robot: Robot
    data: Data
    floor: Floor
    ladder: tuple[Rung, ...]
    comparison: Comparison | None
    chosen: Rung
    gain: Gain
    unidentifiable: tuple[Unidentifiable, ...]
    warnings: tuple[Note, ...]
    provenance: Mapping[str, str] = field(repr=False)

    def to_dict(self) -> dict[str, Any]:
        """The contract's result."""
        data = self.data.scene.data
        estimation = self.data.estimation
        return {
            "schema": 1, "study": self.study.name, "robot": self.robot.name, "seed": self.study.seed,
            "provenance": dict(self.provenance),
            "configurations": {"estimation": data.take(estimation).configurations,
                               "held_out": data.take(~estimation).configurations,
                               "estimation_rows": data.row[estimation]},
            "noise_floor": {"coordinate_mm": self.floor.coordinate_mm, "source": self.floor.source},
            "ladder": [rung_dict(r) for r in self.ladder],
            "candidates": candidates_dict(self.comparison),
            "findings": [],
            "nothing_else": {"sentence": "", "detection_limit_mm": None},
            "nested_cv": None,
            "chosen": {"mechanisms": list(self.chosen.names), "cells": []},
            "outliers": data.row[self.data.outlying],
            "unidentifiable": [{"sentence": u.sentence, "parameters": list(u.parameters)} for u in self.unidentifiable],
            "warnings": [{"code": w.code, "sentence": w.sentence} for w in self.warnings],
            "sampling": None,
        }

    def to_json(self) -> str:
        """result.json's text."""
        return dumps(self.to_dict())


def robot_of(study: Study, folder: Path) -> Robot:
    """The study's nominal robot. Raises StudyError."""
    if study.robot.name is not None:
        return load(study.robot.name)
    return read_robot(folder / str(study.robot.file))


def plan_of(study: Study) -> Plan:
    """The study's set-up as plain values."""
    table, noise = study.robot, study.noise
    tools = {k: tuple(v) for k, v in table.tools_mm.items()} if table.tools_mm else (
        tuple(table.tool_mm) if table.tool_mm else None)
    x, y, z = noise.tracker_mm
    instrument = Instrument(noise.range_mm, noise.range_ppm, noise.angle_urad, (x, y, z)) if noise.instrument else None
    return Plan(study.seed, tools, bool(table.register_), table.register_ == "per group", study.split.estimation,
                study.split.column, study.split.held_out, study.comparison.folds, study.comparison.by, noise.floor_mm, instrument)


def check_names(study: Study, robot: Robot, registry: Registry) -> None:
    """Every mechanism a study names is known and applies; all problems at once. Raises StudyError."""
    problems: dict[str, None] = {}
    named = [("model.base", study.model.base), *(("model.ladder", rung_) for rung_ in study.model.ladder)]
    if study.model.candidates != "all":
        named.append(("model.candidates", list(study.model.candidates)))
    for place, names in named:
        for name in names:
            try:
                mechanism(name, robot, registry)
            except StudyError as error:
                problems[f"{place}: {error}"] = None
    if problems:
        raise StudyError(*problems)


def candidates_of(study: Study, robot: Robot, registry: Registry) -> tuple[Mechanism, ...]:
    """The mechanisms that may extend the base, one a joint."""
    if study.model.candidates == "all":
        return every(robot, registry)
    return tuple(part for name in study.model.candidates for part in parts(name, robot, registry))


def run(study: Study, folder: Path, *, registry: Registry = BUILTIN, say: Say = lambda _: None) -> Result:
    """Run a study whose files stand beside `folder`. Raises StudyError, DataError or NotEstimable; writes nothing."""
    robot = robot_of(study, folder)
    check_names(study, robot, registry)
    path = find_data(study.measurements.file, folder)
    say(f"reading {study.measurements.file}")
    measured = read_measurements(path, [j.prismatic for j in robot.joints], study.measurements.columns)
    labels = None
    if study.split.column is not None:
        labels = read_labels(path, study.split.column)[measured.row]
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    return analyse(study, robot, measured, labels, registry=registry, say=say, data_sha256=digest)


def analyse(study: Study, robot: Robot, measured: Measurements, labels: NDArray[np.object_] | None = None, *,
            registry: Registry = BUILTIN, say: Say = lambda _: None, data_sha256: str = "") -> Result:
    """The study of measurements already read."""
    plan = plan_of(study)
    say("registering and splitting" if plan.register else "splitting")
    data, floor, notes = prepare(robot, measured, plan, labels)
    orientation = measured.rotation is not None
    placement = setup(robot, len(measured.targets), len(measured.groups) if plan.per_group else 1, plan.register, orientation)
    fixed = (placement,) if placement.terms else ()
    base = Model((*fixed, *(mechanism(name, robot, registry) for name in study.model.base)))
    base_names = tuple(study.model.base)

    say("fitting the base")
    nominal = rung(data, Model(fixed), ("nominal",))
    if orientation:
        data = reweigh_rotation(data, plan, nominal.residual)
        data = reweigh_rotation(data, plan, rung(data, base, base_names).residual)
        nominal = rung(data, Model(fixed), ("nominal",))
    base_rung = rung(data, base, base_names) if base_names else nominal
    base_fit = _fit(base_rung)

    say("comparing all subsets of the candidates")
    candidates = applicable(data.scene, base, candidates_of(study, robot, registry))
    comparison = compare(data, base, base_fit, candidates, base_names) if candidates else None
    rungs = [nominal]
    for names in study.model.ladder or [list(base_names)]:
        model = Model((*fixed, *(mechanism(name, robot, registry) for name in names)))
        rungs.append(base_rung if tuple(names) == base_names else rung(data, model, names))
    chosen = base_rung
    if comparison is not None and comparison.choice != base_names:
        chosen = rung(data, base + tuple(c for c in candidates if c.name in comparison.choice), comparison.choice)
    if chosen.names not in [r.names for r in rungs]:
        rungs.append(chosen)

    held = ~data.estimation & ~data.outlying
    paired = gain(nominal.residual[held][:, :3], chosen.residual[held][:, :3], measured.block[held], generator(study.seed, "gain"))
    if floor is None:
        floor = estimated_floor(chosen, data)
    return Result(study, robot, data, floor, tuple(rungs), comparison, chosen, paired,
                  unidentifiable(base_fit.found, base.terms), notes, provenance(study, data_sha256))


def save(result: Result, folder: Path) -> None:
    """Write DIR/result.json, whole or not at all."""
    write_beside(folder / "result.json", result.to_json().encode())


def simulate_study(study: Study, folder: Path) -> pd.DataFrame:
    """Data with the study's planted effects, at the configurations of its measurements file where there is one, else drawn."""
    robot, rng = robot_of(study, folder), generator(study.seed, "simulate")
    path = find_data(study.measurements.file, folder)
    covariates: Mapping[str, Array] = {}
    if path.is_file():
        measured = read_measurements(path, [j.prismatic for j in robot.joints], study.measurements.columns)
        q, covariates = measured.q, measured.covariates
    else:
        q = robot.draw(rng, study.simulate.configurations)
    units = scene(robot, measurements(q, np.zeros((len(q), 3)), covariates=covariates), np.zeros((1, 3))).names()
    effects = []
    for k, effect in enumerate(study.simulate.effect, 1):
        if effect.frame > robot.n + 1:
            raise StudyError(f"simulate.effect {k}: frame {effect.frame}, but {robot.name} has frames 1 to {robot.n + 1}")
        effects.append((Screw(effect.frame, effect.axis, parse(effect.cause, units, f"simulate.effect {k}")), effect.size))
    tool = np.array(study.robot.tool_mm if study.robot.tool_mm is not None else (0.0, 0.0, 0.0))
    noise = study.noise.floor_mm if study.noise.floor_mm is not None else study.simulate.noise_mm
    return simulate(robot, tool, effects, q=q, noise_mm=noise, rng=rng, covariates=covariates)


def _fit(rung_: Rung) -> Fit:
    assert rung_.fit is not None
    return rung_.fit


def estimated_floor(rung_: Rung, data: Data) -> Floor:
    """One coordinate's standard deviation [mm] from the residuals of a fitted model."""
    fitted = _fit(rung_)
    return Floor(float(np.sqrt(np.square(rung_.residual[data.used][:, :3]).mean() * fitted.rows / fitted.freedom)), "estimated",
                 fitted.freedom)


def provenance(study: Study, data_sha256: str) -> dict[str, str]:
    """Versions and hashes; no path, time or host."""
    import scipy
    return {"modelsel": __version__, "numpy": np.__version__, "scipy": scipy.__version__, "data_sha256": data_sha256,
            "study_sha256": hashlib.sha256(study.model_dump_json().encode()).hexdigest()}
