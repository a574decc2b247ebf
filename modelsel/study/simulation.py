"""Simulate measurements: the exact kinematic chain with planted screws and noise.

The result is a DataFrame with the columns of a measurements file.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .._random import generator
from .._typing import Array
from ..config.study_file import Study, find_source
from ..exceptions import StudyError
from ..fitting.design import residuals
from ..fitting.problem import Problem
from ..measurements.measurements import Gauges, Measurements, build_measurements
from ..measurements.observation_columns import apply_known_features
from ..measurements.reader import read_measurements
from ..mechanisms.causes import parse
from ..mechanisms.terms import Screw, Term
from ..robot.kinematics import Robot
from ..setup.feature_positions import place_features
from .inputs import open_study, read_known_features, read_nominal_robot
from .preparation import arrange_tools

if TYPE_CHECKING:
    import pandas as pd

Effects = Sequence[tuple[Screw, float]]  # screws with their size, mm or rad per unit of the cause


def simulate_study(study: Study | Path | str, folder: Path | str | None = None) -> pd.DataFrame:
    """Simulate a study's measurements with its planted effects.

    The configurations are those of the study's measurements where there are any, else drawn within
    the joint limits. Raises StudyError or DataError.
    """
    study, folder = open_study(study, folder)
    robot = read_nominal_robot(study, folder)
    rng = generator(study.seed, "simulate")
    noise_mm = study.noise.floor_mm
    if noise_mm is None:
        noise_mm = study.simulate.noise_mm
    measured = _read_configurations(study, folder, robot)
    if measured is None:
        q = robot.draw(rng, study.simulate.configurations)
        configurations = build_measurements(q, np.zeros((len(q), 3)))
    else:
        configurations = _take_one_row_each(measured)
    effects = _parse_effects(study, robot, configurations)
    if measured is not None and measured.gauges is not None:
        rows = apply_known_features(measured, read_known_features(study))
        tools = arrange_tools(study.robot, rows)
        return simulate_readings(robot, tools, effects, data=rows, noise_mm=noise_mm, rng=rng)
    simulate = partial(
        simulate_points, robot, effects=effects, at=configurations, noise_mm=noise_mm, rng=rng
    )
    if study.robot.tools_mm:
        tools_mm = study.robot.tools_mm
        return _interleave({name: simulate(np.array(tool)) for name, tool in tools_mm.items()})
    return simulate(np.array(study.robot.tool_mm or (0.0, 0.0, 0.0)))


def _read_configurations(study: Study, folder: Path, robot: Robot) -> Measurements | None:
    """Read the study's measurements, positions or not; None where there is no such file."""
    source = find_source(study, folder)
    if isinstance(source, Path) and not source.is_file():
        return None
    return read_measurements(source, robot.prismatic, study.measurements.columns, positions=False)


def _take_one_row_each(data: Measurements) -> Measurements:
    """Return the first row of every configuration, as a point of a single target."""
    _, first = np.unique(data.configuration, return_index=True)
    rows = data.take(first)
    target = np.zeros(len(rows), np.intp)
    return replace(rows, target=target, targets=("target",), gauges=None)


def _parse_effects(study: Study, robot: Robot, data: Measurements) -> Effects:
    """Return the study's planted effects. Raises StudyError."""
    units = Problem(robot, data, np.zeros((1, 3))).names()
    effects = []
    for number, effect in enumerate(study.simulate.effect, 1):
        place_features = f"simulate.effect {number}"
        if effect.frame > robot.n + 1:
            raise StudyError(
                f"{place_features}: frame {effect.frame}, but {robot.name} has frames 1 to {robot.n + 1}"
            )
        cause = parse(effect.cause, units, place_features)
        effects.append((Screw(effect.frame, effect.axis, cause), effect.size))
    return effects


def _interleave(frames: Mapping[str, pd.DataFrame]) -> pd.DataFrame:
    """Join the rows of several targets (by name), those of one configuration together."""
    import pandas as pd

    named = [
        frame.assign(target=name, configuration=range(len(frame))) for name, frame in frames.items()
    ]
    rows = pd.concat(named)
    return rows.sort_values("configuration", kind="stable", ignore_index=True)


def simulate_points(
    robot: Robot,
    tool: Array,
    effects: Effects,
    *,
    at: Measurements,
    noise_mm: float,
    rng: np.random.Generator,
) -> pd.DataFrame:
    """Simulate measured points at the configurations of `at`.

    The positions are those of the exact chain with every effect, plus normal noise of `noise_mm`
    per coordinate; the tracker's frame is frame 0. All else that is known of a configuration is
    kept. Raises StudyError for an effect that is not finite.
    """
    import pandas as pd

    origin = replace(at, position=np.zeros_like(at.position))
    problem = Problem(robot, origin, np.atleast_2d(tool))
    position = -_predict_residuals(problem, effects)  # measured 0, so that it is minus the position
    _check_finite(position)
    position = position + rng.normal(0.0, noise_mm, position.shape)
    columns: dict[str, Any] = {}
    for j, prismatic in enumerate(robot.prismatic):
        unit = "mm" if prismatic else "rad"
        columns[f"q{j + 1}_{unit}"] = at.q[:, j]
    for axis, values in zip("xyz", position.T, strict=True):
        columns[f"{axis}_mm"] = values
    columns |= at.covariates
    columns |= _list_stated_columns(at)
    return pd.DataFrame(columns)


def _predict_residuals(problem: Problem, effects: Effects) -> Array:
    """Return the positional residuals (m, 3) [mm] with the effects in the chain."""
    terms = []
    for k, (screw, _) in enumerate(effects):
        terms.append(Term(f"p{k}", (screw,)))
    sizes = np.array([size for _, size in effects])
    with np.errstate(all="ignore"):
        residual = residuals(problem, terms, sizes)
    return residual[:, :3]


def _check_finite(values: Array) -> None:
    if not np.isfinite(values).all():
        raise StudyError(
            "simulate: a planted effect is not finite at some configurations; check its cause and "
            "size."
        )


def _list_stated_columns(data: Measurements) -> dict[str, Any]:
    """Return the columns of what reading the simulated file would not find by itself."""
    columns: dict[str, Any] = {}
    if data.groups != ("all",):
        names = np.array(data.groups, dtype=object)
        columns["group"] = names[data.group]
    if not np.array_equal(data.order, data.row):
        columns["order"] = data.order
    if not _approach_is_derived(data):
        for j, approach in enumerate(data.approach.T, 1):
            columns[f"approach{j}"] = approach.astype(int)
    groups = data.group.tolist()
    read_again = build_measurements(data.q, data.position, group=groups)
    if read_again.configurations != len(data):  # successive visits with the same readings
        columns["configuration"] = np.arange(len(data))
    return columns


def _approach_is_derived(data: Measurements) -> bool:
    """Return whether the directions of approach were derived from the order on reading."""
    codes = [note.code for note in data.notes]
    return "approach-from-order" in codes


def simulate_readings(
    robot: Robot,
    tools: Array,
    effects: Effects,
    *,
    data: Measurements,
    noise_mm: float,
    rng: np.random.Generator,
) -> pd.DataFrame:
    """Simulate the readings of rows that are not all points, each by its kind.

    Features are where the study or the measurements' own rows have them. Raises StudyError for
    kinds that hold the arm to a place (their readings cannot be simulated), and for an effect that
    is not finite.
    """
    gauges = data.gauges
    assert gauges is not None
    _check_kinds(gauges)
    problem = place_features(Problem(robot, data, tools), np.ones(len(data), bool))
    readings = problem.readings.T - _predict_residuals(problem, effects)
    _check_finite(readings)
    readings = readings + rng.normal(0.0, noise_mm, readings.shape)
    readings = np.where(gauges.coordinates, readings, np.nan)

    is_length = gauges.of("wire", "ball-bar", "distance")
    origin = None if gauges.origin is None else _drop_uncertainties(gauges.origin)
    length = np.where(is_length, readings[:, 0], np.nan)
    simulated = replace(
        _drop_uncertainties(data),
        position=np.where(is_length[:, None], np.nan, readings),
        gauges=replace(gauges, length=length, origin=origin),
    )
    frame = simulated.to_frame().reset_index(drop=True)
    if not _approach_is_derived(data):
        return frame
    return frame.drop(columns=[f"approach{j + 1}" for j in range(robot.n)])


def _check_kinds(gauges: Gauges) -> None:
    """Check that no row holds the arm to a place. Raises StudyError."""
    kinds = [kind for kind in ("same-point", "plane") if gauges.of(kind).any()]
    bars = [k for k, feature in enumerate(gauges.features) if feature.kind == "ball-bar"]
    on_bar = np.isin(gauges.feature, bars)
    if np.isnan(gauges.length[on_bar]).any():
        kinds.append("ball-bar")
    if kinds:
        raise StudyError(
            f"simulate: rows of kind {' and '.join(kinds)} hold the arm to a place: the joint "
            "readings, not a measured value, would have to be simulated; leave these rows out."
        )


def _drop_uncertainties(data: Measurements) -> Measurements:
    """Return measurements without uncertainties and orientations."""
    return replace(data, sigma=None, rotation=None, sigma_rotation=None)
