"""Simulate measurements: the exact kinematic chain with planted screws and noise.

The result is a DataFrame with the columns of a measurements file.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .._random import generator
from .._typing import Array
from ..config.study_file import Study, find_source
from ..config.study_tables import SimulateTable
from ..exceptions import StudyError
from ..fitting.design import residuals
from ..fitting.problem import Problem
from ..measurements.gauges import Gauges
from ..measurements.known_features import apply_known_features
from ..measurements.measurements import ONE_TARGET, Measurements, build_measurements
from ..measurements.reader import read_measurements
from ..mechanisms.cause_formulas import list_members, parse
from ..mechanisms.terms import Screw, Term
from ..robot.kinematics import Robot
from ..setup.feature_positions import place_features
from .inputs.found_problems import name_study_file
from .inputs.inputs import read_known_features, read_nominal_robot
from .inputs.noise_parts import check_parts
from .inputs.planted_effects import list_frame_problems, list_motion_problems, tell_cause_problems
from .inputs.whole_study import open_study
from .preparation.own_causes import describe_columns
from .preparation.preparation import arrange_tools
from .unrepeated import NOTHING, Unrepeated, check_planted_rows, draw_unrepeated

if TYPE_CHECKING:
    import pandas as pd

Effects = Sequence[tuple[Screw, float]]  # screws with their size, mm or rad per unit of the cause


def simulate_study(study: Study | Path | str, folder: Path | str | None = None) -> pd.DataFrame:
    """Simulate a study's measurements with its planted effects.

    The configurations are those of the study's measurements where there are any, else drawn within
    the joint limits. Raises StudyError or DataError.
    """
    study, folder = open_study(study, folder, measured=False)
    robot = read_nominal_robot(study, folder)
    with name_study_file(study.file_name):
        check_parts(study, robot)
        return _simulate(study, folder, robot)


def _simulate(study: Study, folder: Path, robot: Robot) -> pd.DataFrame:
    """Simulate the measurements of a study of a robot."""
    rng = generator(study.seed, "simulate")
    noise_mm = study.noise.floor_mm
    if noise_mm is None:
        noise_mm = study.simulate.noise_mm
    measured = _read_configurations(study, folder, robot)
    if measured is None:
        configurations = _draw_visits(study.simulate, robot, rng)
    else:
        configurations = _take_one_row_each(measured)
    if measured is None:
        columns = f"Columns are those of {study.measurements.file}, which is not there."
    else:
        columns = describe_columns(measured)
    table = study.robot
    tools_mm = table.tools_mm or {}
    targets = tuple(tools_mm) or ONE_TARGET
    if measured is not None and measured.gauges is not None:
        targets = measured.targets
    effects = _parse_effects(study, robot, configurations, targets, columns)
    if measured is not None and measured.gauges is not None:
        _refuse_parts(study.simulate)
        features = read_known_features(study)
        rows = apply_known_features(measured, features)
        tools = arrange_tools(study.robot, rows)
        return simulate_readings(robot, tools, effects, data=rows, noise_mm=noise_mm, rng=rng)
    planted = study.simulate.parts
    check_planted_rows(planted, targets, configurations.groups)
    unrepeated = draw_unrepeated(study.simulate, configurations, rng)
    simulate = partial(simulate_points, robot, effects=effects, noise_mm=noise_mm, rng=rng)
    if tools_mm:
        tools = np.array(list(tools_mm.values()))
        frames = {}
        for number, name in enumerate(targets):
            at = _give_target(configurations, number, targets)
            own = unrepeated.raise_noise(name, planted)
            frames[name] = simulate(tools, at=at, unrepeated=own)
        return _interleave(frames)
    tool_mm = table.tool_mm or (0.0, 0.0, 0.0)
    tool = np.array(tool_mm)
    (name,) = targets
    own = unrepeated.raise_noise(name, planted)
    return simulate(tool, at=configurations, unrepeated=own)


def _draw_visits(table: SimulateTable, robot: Robot, rng: np.random.Generator) -> Measurements:
    """Draw configurations, measured in rounds and in groups."""
    drawn = robot.draw(rng, table.configurations)
    q = np.tile(drawn, (table.repeats, 1))
    visits = len(q)
    group = None
    if table.groups > 1:
        group = [str(k * table.groups // visits + 1) for k in range(visits)]
    return build_measurements(
        q,
        np.zeros((visits, 3)),
        configuration=range(visits),
        group=group,
        prismatic=robot.prismatic,
        coupling=robot.coupling,
    )


def _refuse_parts(table: SimulateTable) -> None:
    """Refuse parts of the noise where rows are no points. Raises StudyError."""
    if table.parts:
        raise StudyError(
            "simulate.parts: the measurements have rows that are not points, for which parts of the "
            "noise are not simulated; leave parts out."
        )


def _read_configurations(study: Study, folder: Path, robot: Robot) -> Measurements | None:
    """Read the study's measurements, positions or not; None where there is no such file."""
    source = find_source(study, folder)
    if isinstance(source, os.PathLike) and not Path(source).is_file():
        return None
    columns = study.measurements.columns
    return read_measurements(source, robot, columns, positions=False)


def _take_one_row_each(data: Measurements) -> Measurements:
    """Return the first row of every configuration, as a point of a single target."""
    _, first = np.unique(data.configuration, return_index=True)
    rows = data.take(first)
    points = replace(rows, gauges=None)
    return _give_target(points, 0, ONE_TARGET)


def _give_target(data: Measurements, number: int, targets: tuple[str, ...]) -> Measurements:
    """Return the measurements as those of one of some targets."""
    target = np.full(len(data), number)
    return replace(data, target=target, targets=targets)


def _parse_effects(
    study: Study, robot: Robot, data: Measurements, targets: Sequence[str], columns: str
) -> Effects:
    """Return the study's planted effects; `columns` is said of names that are unknown. Raises
    StudyError with all problems at once."""
    tool = np.zeros((1, 3))
    problem = Problem(robot, data, tool)
    units = problem.names()
    members = list_members(len(targets), len(data.groups))
    problems = list_frame_problems(study, robot)
    problems += tell_cause_problems(study, units, members, columns)
    problems += list_motion_problems(study, units, members, data)
    if problems:
        raise StudyError(*problems)
    effects = []
    for effect in study.simulate.effect:
        cause = parse(effect.cause, units, members=members)
        screw = Screw(effect.frame, effect.axis, cause)
        effects.append((screw, effect.size))
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
    unrepeated: Unrepeated = NOTHING,
) -> pd.DataFrame:
    """Simulate measured points at the configurations of `at`.

    The positions are those of the exact chain with every effect, the arm being where `unrepeated`
    puts it and not where the readings have it, plus normal noise of `noise_mm` per coordinate; the tracker's frame is frame 0. All else that is known of a configuration is
    kept. Raises StudyError for an effect that is not finite.
    """
    import pandas as pd

    unmeasured = np.zeros_like(at.position)
    origin = replace(at, position=unmeasured, q=at.q + unrepeated.joints)
    tools = np.atleast_2d(tool)
    problem = Problem(robot, origin, tools)
    # measured 0, so that it is minus the position
    residual = _predict_residuals(problem, effects)
    position = -residual
    _check_finite(position)
    scale = np.hypot(noise_mm, unrepeated.along)
    noise = rng.normal(0.0, scale, position.shape)
    position = position + noise + unrepeated.shift
    readings = at.readings
    columns: dict[str, Any] = {}
    for j, prismatic in enumerate(robot.prismatic):
        unit = "rad"
        if prismatic:
            unit = "mm"
        name = f"q{j + 1}_{unit}"
        columns[name] = readings[:, j]
    for axis, values in zip("xyz", position.T, strict=True):
        name = f"{axis}_mm"
        columns[name] = values
    columns |= at.covariates
    columns |= _list_stated_columns(at)
    return pd.DataFrame(columns)


def _predict_residuals(problem: Problem, effects: Effects) -> Array:
    """Return the positional residuals (m, 3) [mm] with the effects in the chain."""
    terms = []
    effect_sizes = []
    for k, (screw, size) in enumerate(effects):
        term = Term(f"p{k}", (screw,))
        terms.append(term)
        effect_sizes.append(size)
    sizes = np.array(effect_sizes)
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
    group = data.group
    if data.groups != ("all",):
        names = np.array(data.groups, dtype=object)
        columns["group"] = names[group]
    order = data.order
    if not np.array_equal(order, data.row):
        columns["order"] = order
    if not data.approach_from_order:
        approaches = data.approach.T
        for j, approach in enumerate(approaches, 1):
            name = f"approach{j}"
            columns[name] = approach.astype(int)
    groups = group.tolist()
    read_again = build_measurements(data.q, data.position, group=groups)
    count = len(data)
    # successive visits with the same readings
    if read_again.configurations != count:
        columns["configuration"] = np.arange(count)
    return columns


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
    all_rows = np.ones(len(data), bool)
    problem = Problem(robot, data, tools)
    problem = place_features(problem, all_rows)
    residual = _predict_residuals(problem, effects)
    readings = problem.readings.T - residual
    _check_finite(readings)
    noise = rng.normal(0.0, noise_mm, readings.shape)
    readings = readings + noise
    readings = np.where(gauges.coordinates, readings, np.nan)

    is_length = gauges.of("wire", "ball-bar", "distance")
    origin = gauges.origin
    if origin is not None:
        origin = _drop_uncertainties(origin)
    length = np.where(is_length, readings[:, 0], np.nan)
    position = np.where(is_length[:, None], np.nan, readings)
    simulated = replace(
        _drop_uncertainties(data),
        position=position,
        gauges=replace(gauges, length=length, origin=origin),
    )
    frame = simulated.to_frame()
    frame = frame.reset_index(drop=True)
    if not data.approach_from_order:
        return frame
    names = [f"approach{j + 1}" for j in range(robot.n)]
    return frame.drop(columns=names)


def _check_kinds(gauges: Gauges) -> None:
    """Check that no row holds the arm to a place. Raises StudyError."""
    held = ("same-point", "plane")
    kinds = [kind for kind in held if gauges.of(kind).any()]
    bars = [k for k, feature in enumerate(gauges.features) if feature.kind == "ball-bar"]
    on_bar = np.isin(gauges.feature, bars)
    lengths = gauges.length[on_bar]
    if np.isnan(lengths).any():
        kinds.append("ball-bar")
    if kinds:
        listed = " and ".join(kinds)
        raise StudyError(
            f"simulate: rows of kind {listed} hold the arm to a place: the joint "
            "readings, not a measured value, would have to be simulated; leave these rows out."
        )


def _drop_uncertainties(data: Measurements) -> Measurements:
    """Return measurements without uncertainties and orientations."""
    return replace(data, sigma=None, rotation=None, sigma_rotation=None)
