"""Simulated measurements: the exact chain with planted screws and noise, in contract form."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from .._typing import Array
from ..exceptions import StudyError
from ..fitting.design import residuals
from ..fitting.problem import Problem
from ..measurements.measurements import Measurements, build_measurements
from ..mechanisms.terms import Screw, Term
from ..robot.kinematics import Robot
from ..setup.feature_positions import place_features

if TYPE_CHECKING:
    import pandas as pd


def simulate(
    robot: Robot,
    tool: Array,
    effects: Sequence[tuple[Screw, float]],
    *,
    at: Measurements,
    noise_mm: float,
    rng: np.random.Generator,
) -> pd.DataFrame:
    """A DataFrame in contract form: the configurations `at`, with all that is known of each but its
    positions; the exact chain's positions with every effect (screw, size in mm or rad per unit of
    its cause) in it, and normal noise of `noise_mm` per coordinate. Frame 0 is the tracker's.
    Raises StudyError for an effect that is not finite."""
    import pandas as pd

    bound = Problem(
        robot, replace(at, position=np.zeros_like(at.position)), np.atleast_2d(tool)
    )  # measured nought: minus it
    terms = tuple(Term(f"p{k}", (screw,)) for k, (screw, _) in enumerate(effects))
    with np.errstate(all="ignore"):
        position = -residuals(bound, terms, np.array([size for _, size in effects]))[:, :3]
    if not np.isfinite(position).all():
        raise StudyError(
            "simulate: a planted effect is not finite at some configurations; check its cause and size."
        )
    position = position + rng.normal(0.0, noise_mm, position.shape)
    frame = {
        f"q{j + 1}_{'mm' if joint.prismatic else 'rad'}": at.q[:, j]
        for j, joint in enumerate(robot.joints)
    }
    frame |= {f"{axis}_mm": position[:, a] for a, axis in enumerate("xyz")}
    return pd.DataFrame(frame | dict(at.covariates) | _known(at))


def _known(at: Measurements) -> dict[str, Any]:
    """Columns of what reading the simulated file would not find by itself."""
    out: dict[str, Any] = {}
    if at.groups != ("all",):
        out["group"] = np.array(at.groups, dtype=object)[at.group]
    if not np.array_equal(at.order, at.row):
        out["order"] = at.order
    if all(note.code != "approach-from-order" for note in at.notes):
        out |= {f"approach{j + 1}": at.approach[:, j].astype(int) for j in range(at.q.shape[1])}
    if build_measurements(at.q, at.position, group=at.group.tolist()).configurations != len(at):
        out["configuration"] = np.arange(
            len(at)
        )  # visits one after the other with the same readings
    return out


def simulate_rows(
    robot: Robot,
    tools: Array,
    effects: Sequence[tuple[Screw, float]],
    *,
    data: Measurements,
    noise_mm: float,
    rng: np.random.Generator,
) -> pd.DataFrame:
    """The same for a file with rows that are no points: every row reads anew what its kind reads,
    features where the study or the file's own rows have them. Raises StudyError for kinds that hold
    the arm to a place: their readings cannot be made up."""
    gauges = data.gauges
    assert gauges is not None
    fixed = [k for k in ("same-point", "plane") if gauges.of(k).any()]
    fixed += (
        ["ball-bar"]
        if any(
            f.kind == "ball-bar" and np.isnan(gauges.length[gauges.feature == k]).any()
            for k, f in enumerate(gauges.features)
        )
        else []
    )
    if fixed:
        raise StudyError(
            f"simulate: rows of kind {' and '.join(fixed)} hold the arm to a place: the readings of the joints, "
            "not a measured value, would have to be made; leave them out."
        )
    bound = place_features(Problem(robot, data, tools), np.ones(len(data), bool))
    terms = tuple(Term(f"p{k}", (screw,)) for k, (screw, _) in enumerate(effects))
    with np.errstate(all="ignore"):
        read = (
            bound.readings.T
            - residuals(bound, terms, np.array([size for _, size in effects]))[:, :3]
        )
    if not np.isfinite(read).all():
        raise StudyError(
            "simulate: a planted effect is not finite at some configurations; check its cause and size."
        )
    read = np.where(gauges.coordinates, read + rng.normal(0.0, noise_mm, read.shape), np.nan)
    length = gauges.of("wire", "ball-bar", "distance")
    origin = (
        None
        if gauges.origin is None
        else replace(gauges.origin, sigma=None, rotation=None, sigma_rotation=None)
    )
    made = replace(
        data,
        position=np.where(length[:, None], np.nan, read),
        sigma=None,
        rotation=None,
        sigma_rotation=None,
        gauges=replace(gauges, length=np.where(length, read[:, 0], np.nan), origin=origin),
    )
    found = (
        [f"approach{j + 1}" for j in range(robot.n)]
        if any(n.code == "approach-from-order" for n in data.notes)
        else []
    )
    return made.to_frame().drop(columns=found).reset_index(drop=True)
