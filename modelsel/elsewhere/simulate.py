"""Simulated measurements: the exact chain with planted screws and noise, in contract form."""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..data.measurements import KINDS, Measurements, measurements
from ..fitting.fixtures import place
from ..machine.robot import Robot
from ..matrix.design import residuals
from ..matrix.scene import scene
from ..words.errors import StudyError
from ..words.rigid import Array
from ..wrong.screws import Screw, Term

if TYPE_CHECKING:
    import pandas as pd


def simulate(robot: Robot, tool: Array, effects: Sequence[tuple[Screw, float]], *, q: Array, noise_mm: float,
             rng: np.random.Generator, covariates: Mapping[str, Array] | None = None) -> pd.DataFrame:
    """A DataFrame in contract form: joint readings q (m, n), the exact chain's positions with every effect (screw, size in
    mm or rad per unit of its cause) in it, and normal noise of `noise_mm` per coordinate. Frame 0 is the tracker's."""
    import pandas as pd
    bound = scene(robot, measurements(q, np.zeros((len(q), 3)), covariates=covariates), np.atleast_2d(tool))
    terms = tuple(Term(f"p{k}", (screw,)) for k, (screw, _) in enumerate(effects))
    with np.errstate(all="ignore"):
        position = -residuals(bound, terms, np.array([size for _, size in effects]))[:, :3]
    if not np.isfinite(position).all():
        raise StudyError("simulate: a planted effect is not finite at some configurations; check its cause and size")
    position = position + rng.normal(0.0, noise_mm, position.shape)
    frame = {f"q{j + 1}_{'mm' if joint.prismatic else 'rad'}": q[:, j] for j, joint in enumerate(robot.joints)}
    frame |= {f"{axis}_mm": position[:, a] for a, axis in enumerate("xyz")}
    return pd.DataFrame(frame | dict(covariates or {}))


def simulate_rows(robot: Robot, tools: Array, effects: Sequence[tuple[Screw, float]], *, data: Measurements, noise_mm: float,
                  rng: np.random.Generator) -> pd.DataFrame:
    """The same for a file with rows that are no points: every row reads anew what its kind reads, features where the study or the
    file's own rows have them. Raises StudyError for kinds that hold the arm to a place: their readings cannot be made up."""
    import pandas as pd
    gauges = data.gauges
    assert gauges is not None
    fixed = [k for k in ("same-point", "plane") if gauges.of(k).any()]
    fixed += ["ball-bar"] if any(f.kind == "ball-bar" and np.isnan(gauges.length[gauges.feature == k]).any()
                                 for k, f in enumerate(gauges.features)) else []
    if fixed:
        raise StudyError(f"simulate: rows of kind {' and '.join(fixed)} hold the arm to a place: the readings of the joints, "
                         "not a measured value, would have to be made; leave them out")
    bound = place(scene(robot, data, tools), np.ones(len(data), bool))
    terms = tuple(Term(f"p{k}", (screw,)) for k, (screw, _) in enumerate(effects))
    read = bound.readings.T - residuals(bound, terms, np.array([size for _, size in effects]))[:, :3]
    if not np.isfinite(read).all():
        raise StudyError("simulate: a planted effect is not finite at some configurations; check its cause and size")
    read = np.where(gauges.coordinates, read + rng.normal(0.0, noise_mm, read.shape), np.nan)
    length = gauges.of("wire", "ball-bar", "distance")
    frame = _state(robot, data) | {"kind": [KINDS[k] for k in gauges.kind], "feature": [
        gauges.features[k].name if k >= 0 else "" for k in gauges.feature]} | {"length_mm": np.where(length, read[:, 0], np.nan)}
    frame |= {f"{axis}_mm": np.where(length, np.nan, read[:, a]) for a, axis in enumerate("xyz")}
    out = pd.DataFrame(frame)
    if gauges.origin is not None:                   # where distances begin: a row before the others, without a reading
        first = np.unique(np.where(gauges.of("distance"), gauges.origin.row, -1), return_index=True)[1]
        first = first[gauges.of("distance")[first]]
        start = pd.DataFrame(_state(robot, gauges.origin.take(first))).assign(
            kind="distance", feature=[gauges.features[k].name for k in gauges.feature[first]])
        out = pd.concat([out, start]).sort_values("row", kind="stable", ignore_index=True)
    return out.drop(columns="row")


def _state(robot: Robot, data: Measurements) -> dict[str, Any]:
    """What is known of rows beside what they measure, as columns of a file; `row` is their place in it."""
    named = {stem: [names[k] for k in index] for stem, index, names in (
        ("target", data.target, data.targets), ("group", data.group, data.groups)) if len(names) > 1}
    return {"row": data.row, **{f"q{j + 1}_{'mm' if joint.prismatic else 'rad'}": data.q[:, j]
                                for j, joint in enumerate(robot.joints)}, **named, **data.covariates}
