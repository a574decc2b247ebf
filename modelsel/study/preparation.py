"""From a study and its measurements to one problem, registered, weighed, split and folded."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .._random import generator
from .._typing import Array
from ..exceptions import DataError, NotEstimable, StudyError, sentence_list, suggest
from ..fitting.design import residuals
from ..fitting.noise import Floor, Instrument, weigh
from ..fitting.problem import Problem
from ..measurements.features import KINDS
from ..measurements.measurements import Measurements
from ..notices import Note
from ..robot.kinematics import Robot
from ..selection.evaluation import Split
from ..selection.splits import assign_folds, split_configurations
from ..setup.feature_positions import find_unmeasured_features, place_features
from ..setup.registration import note_undetermined, register
from .checks import setup_notes


@dataclass(frozen=True)
class Plan:
    """What `prepare` needs of a study file, as plain values."""

    seed: int
    tools: Mapping[str, tuple[float, ...]] | tuple[float, ...] | None
    register: bool = False
    per_group: bool = False
    estimation: int | None = None
    column: str | None = None
    held_out: str = "held-out"
    folds: int = 10
    by: str = "configuration"
    stated_mm: float | None = None
    instrument: Instrument | None = None
    tracker: tuple[float, float, float] = (
        0.0,
        0.0,
        0.0,
    )  # where the instrument stands, in the data's frame


def tools_of(
    data: Measurements, tools: Mapping[str, tuple[float, ...]] | tuple[float, ...] | None
) -> Array:
    """(T, 3) nominal targets in the data's order. Raises StudyError for a target without one."""
    if tools is None:
        return np.zeros((len(data.targets), 3))
    if not isinstance(tools, Mapping):
        return np.tile(np.array(tools, float), (len(data.targets), 1))
    missing = [name for name in data.targets if name not in tools]
    if missing:
        raise StudyError(
            *(
                f'robot.tools_mm: no line for target "{name}". {suggest(name, tools)}'
                for name in missing
            )
        )
    return np.array([tools[name] for name in data.targets], float)


def split(
    data: Measurements, labels: NDArray[np.object_] | None, plan: Plan, prismatic: tuple[bool, ...]
) -> NDArray[np.bool_]:
    """(m,) mask of the estimation rows. Raises StudyError where the split cannot be made."""
    if plan.column is not None and labels is not None:
        held = labels == plan.held_out
        other = (
            sorted({str(v) for v in labels[~held]} - {"estimation"})
            if plan.held_out == "held-out"
            else []
        )
        if other:
            raise StudyError(
                f'split.column: column {plan.column} holds "{other[0]}"; expected "estimation" or "held-out" '
                f'(or name the held-out value: held_out = "{other[0]}").'
            )
        if held.all():
            raise StudyError(
                f'split.column: every row of column {plan.column} is "{plan.held_out}": nothing is left for '
                "estimation."
            )
        torn = np.intersect1d(data.block[held], data.block[~held])
        if len(torn):
            place = data.where.named(int(data.row[np.flatnonzero(data.block == torn[0])[0]]))
            raise StudyError(
                f"split.column: equal joint readings stand on both sides of the split ({place}, for one): "
                "held-out configurations must not have been seen."
            )
        return np.asarray(~held)
    count = data.configurations
    wanted = plan.estimation
    if wanted is None:
        wanted = count if count < 30 else max(20, round(0.4 * count))
    if wanted > count:
        raise StudyError(
            f"split.estimation = {wanted}, but the file has {count} configurations: ask for fewer."
        )
    return split_configurations(data, wanted, prismatic, generator(plan.seed, "split"))


def prepare(
    robot: Robot, data: Measurements, plan: Plan, labels: NDArray[np.object_] | None = None
) -> tuple[Split, Floor | None, tuple[Note, ...]]:
    """The problem with its split and folds, the noise floor where it is known, and what is to be
    said.

    Raises StudyError, DataError or NotEstimable.
    """
    notes = list(data.notes)
    estimation = split(data, labels, plan, robot.prismatic)
    data, unseen = _timeless(data, estimation)
    if unseen:
        notes.append(
            Note(
                "other-session",
                f"No estimation configuration is of {', '.join(unseen)}: the model does not know when "
                "in the campaign that was measured, and takes drift at the campaign's middle there.",
            )
        )
    data, estimation, more = _seen(*_known_targets(data, estimation, plan, notes), plan)
    notes += more
    bound = replace(Problem(robot, data, tools_of(data, plan.tools)), tracker=plan.tracker)
    if plan.register:
        expected = bound.tools
        bound = register(bound, estimation, plan.per_group)
        notes += note_undetermined(bound, estimation, plan.per_group, expected)
    doubts = setup_notes(bound, estimation, plan.register, plan.per_group)
    notes[:0] = doubts
    why = " ".join(n.sentence for n in doubts)
    bound = place_features(bound, estimation)
    size, reach = np.linalg.norm(residuals(bound)[:, :3], axis=1), bound.reach_mm
    if np.median(size) > reach / 4:
        hint = (
            "the coordinates look like metres: name them x_m y_m z_m."
            if np.nanmedian(np.linalg.norm(np.nan_to_num(data.position), axis=1)) < reach / 100
            and data.gauges is None
            else why
            or "This looks like "
            + (
                ""
                if plan.register
                else "a tracker frame that is not the robot's base ([robot] "
                "register = true finds it), "
            )
            + "the wrong robot or tool, metres called millimetres, or joints whose zero or "
            "sense is another than the robot file's."
        )
        raise DataError(
            f"measured and nominal positions are {np.median(size):.4g} mm apart (median), more than a quarter of "
            f"the arm's reach ({reach:.4g} mm).",
            remedy=hint[0].upper() + hint[1:],
        )
    bound, floor = weigh(bound, plan.instrument, plan.stated_mm)
    if robot.gravity is None:
        notes.append(
            Note(
                "gravity-unknown",
                f"The robot file of {robot.name} gives no direction of gravity: mechanisms that "
                "need it are left out. Of an upright robot: gravity = [0, 0, -1].",
            )
        )
    if plan.by == "group" and len(np.unique(data.group[estimation])) < 2:
        raise StudyError(
            'comparison.by = "group": the estimation rows belong to one group; two and more are needed to leave one '
            'out. Use by = "configuration".'
        )
    if len(np.unique(data.block)) < 2:
        raise NotEstimable(
            "the file has one set of joint readings: no parameter can be told from it; measure more "
            "configurations."
        )
    if len(np.unique(data.block[estimation])) < 2:
        raise StudyError(
            "split: the estimation rows have one set of joint readings: nothing can be compared or cross-validated."
        )
    fold = np.full(len(data), -1, dtype=np.intp)
    fold[estimation] = assign_folds(
        data.take(estimation), plan.folds, generator(plan.seed, "folds"), plan.by
    )
    if not (~estimation).any():
        notes.append(
            Note(
                "nothing-held-out",
                "All configurations estimate: nothing is held out, and no gain can be measured.",
            )
        )
    known = floor is not None and floor.source == "stated"
    return Split(bound, estimation, np.zeros(len(data), bool), fold, known), floor, tuple(notes)


def _known_targets(
    data: Measurements, estimation: NDArray[np.bool_], plan: Plan, notes: list[Note]
) -> tuple[Measurements, NDArray[np.bool_]]:
    """Where targets are found from the estimation rows: without the held-out rows of targets that
    none of these measures, which is said in `notes`."""
    origin = None if data.gauges is None else data.gauges.origin
    seen = np.unique(
        data.target[estimation]
        if origin is None
        else [*data.target[estimation], *origin.target[estimation]]
    )
    gone = ~np.isin(data.target, seen)
    if not plan.register or not gone.any():
        return data, estimation
    names = sentence_list([f'"{data.targets[k]}"' for k in np.unique(data.target[gone])])
    notes.append(
        Note(
            "target-unseen",
            f"{int(gone.sum())} held-out rows are left out: no estimation row measures target {names},"
            " and where it sits is found from estimation rows. Let some of its configurations "
            "estimate, or give [robot.tools_mm] without register.",
        )
    )

    def named(some: Measurements) -> Measurements:
        return replace(
            some,
            target=np.searchsorted(seen, some.target),
            targets=tuple(data.targets[k] for k in seen),
        )

    kept = named(data.take(~gone))
    if origin is not None and kept.gauges is not None:
        kept = replace(kept, gauges=replace(kept.gauges, origin=named(origin.take(~gone))))
    return kept, estimation[~gone]


def _seen(
    data: Measurements, estimation: NDArray[np.bool_], plan: Plan
) -> tuple[Measurements, NDArray[np.bool_], list[Note]]:
    """Without the held-out rows of features of which nothing estimates; what is to be said of
    kinds. Raises StudyError."""
    gauges, notes = data.gauges, list[Note]()
    if gauges is None:
        return data, estimation, notes
    for k, feature in enumerate(gauges.features):
        rows = gauges.feature == k
        groups = (
            data.group[rows]
            if gauges.origin is None
            else np.concatenate([data.group[rows], gauges.origin.group[rows]])
        )
        if plan.per_group and len(np.unique(groups)) > 1:
            raise StudyError(
                f'robot.register = "per group": feature "{feature.name}" stands in several groups, whose trackers '
                "stand apart; give it a name in each."
            )
    lost = find_unmeasured_features(data, estimation)
    gone = np.isin(gauges.feature, lost)
    if gone.any():
        names = ", ".join(gauges.features[k].name for k in lost)
        notes.append(
            Note(
                "feature-unseen",
                f"{int(gone.sum())} held-out rows are left out: no estimation row measures {names}, "
                "and where that is has to be found from estimation rows.",
            )
        )
    kinds = [KINDS[k] for k in np.unique(gauges.kind)]
    if data.sigma is None and not {"x", "y", "z"} >= set(kinds) and len(kinds) > 1:
        notes.append(
            Note(
                "kinds-alike",
                f"Rows of different kinds ({', '.join(kinds)}) are weighed alike: a column s_mm would "
                "say how sure each of them is.",
            )
        )
    return data.take(~gone), estimation[~gone], notes


def _timeless(
    data: Measurements, estimation: NDArray[np.bool_]
) -> tuple[Measurements, tuple[str, ...]]:
    """Groups that are held out whole stand at the middle of the estimated campaign: a drift must
    not be drawn out to them."""
    strange = ~np.isin(data.group, data.group[estimation])
    if not strange.any():
        return data, ()
    own = data.progress[estimation]
    gauges = data.gauges
    if gauges is not None and gauges.origin is not None:
        gauges = replace(
            gauges,
            origin=_rescaled(
                gauges.origin, own, ~np.isin(gauges.origin.group, data.group[estimation])
            ),
        )
    return replace(_rescaled(data, own, strange), gauges=gauges), tuple(
        data.groups[g] for g in np.unique(data.group[strange])
    )


def _rescaled(data: Measurements, own: Array, strange: NDArray[np.bool_]) -> Measurements:
    """With the place in the campaign from 0 to 1 over the estimated rows' `own`, the middle for
    strange ones."""
    progress = (data.progress - own.min()) / max(float(np.ptp(own)), 1e-12)
    progress[strange] = 0.5
    return replace(data, progress=progress)


def reweigh_rotation(split: Split, plan: Plan, residual: Array) -> Split:
    """With orientations: whichever of position and rotation has no stated uncertainty is weighed by
    its own residuals."""
    measured, seen = split.problem.data, split.problem.measured
    known = plan.stated_mm is not None or plan.instrument is not None or measured.sigma is not None
    if measured.rotation is None or known and measured.sigma_rotation is not None:
        return split
    used = residual[split.used]

    def spread(part: slice) -> float:
        square = np.square(used[:, part])
        return float(
            np.sqrt(
                square.mean()
                if seen is None
                else square.sum() / max(seen[split.used][:, part].sum(), 1)
            )
        )

    position = plan.stated_mm if known else spread(slice(0, 3))
    turning = spread(slice(3, 6))
    bound, _ = weigh(split.problem, plan.instrument, position, turning)
    return replace(split, problem=bound)
