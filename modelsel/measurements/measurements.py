"""Measurements: joint readings, positions, and whatever else is known of each row. Frozen;
indexable by row."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .._linalg import connected_components
from .._typing import Array, Index
from ..exceptions import DataError, count_words
from ..notices import Note
from ..robot.coupling import Coupling, readings_of
from ..robot.rigid import to_quaternion
from .campaign.clock_history import derive_late, derive_since_rest
from .campaign.continuous_motion import add_speed
from .campaign.features import KINDS, Feature, KindColumns, add_kind_columns, collect_features
from .campaign.joint_path import JointPath
from .campaign.motion import (
    APPROACH_FROM_ORDER,
    MeasuredRows,
    Waypoints,
    describe_motion,
    trace_motion,
)
from .campaign.reference_temperature import REFERENCE, TEMPERATURE, choose_reference
from .campaign.row_order import compute_progress
from .campaign.visits import count_distinct, number_blocks, number_keys
from .formats.column_names import list_named_columns
from .formats.row_places import Where
from .gauges import Gauges

if TYPE_CHECKING:
    import pandas as pd

# names where the data name none
ONE_TARGET = ("target",)
ONE_GROUP = ("all",)


@dataclass(frozen=True, eq=False, repr=False)
class Measurements:
    """m measured points. Positions in the tracker's frame [mm]; residual = measured - predicted
    everywhere."""

    q: Array  # (m, n) joint angles, rad or mm; the readings where nothing is coupled
    position: Array  # (m, 3) mm
    row: Index  # (m,) row of the file, 0-based
    configuration: Index  # (m,) visit of the arm; several targets share one
    block: Index  # (m,) posture, readings alike: never apart in folds or split
    target: Index  # (m,) index into `targets`
    group: Index  # (m,) index into `groups`
    order: Array  # (m,) order of motion within the group
    approach: Array  # (m, n) sign of each joint's (coupled: motor's) last motion, 0 unknown
    move: Array  # (m, n) size of the motion that led here, rad or mm
    progress: Array  # (m,) place in the order of motion of the whole campaign, 0 to 1
    targets: tuple[str, ...] = ONE_TARGET
    groups: tuple[str, ...] = ONE_GROUP
    # all that the file names, in its order, where some were left out; empty: `targets`
    listed_targets: tuple[str, ...] = ()
    covariates: Mapping[str, Array] = field(default_factory=dict)
    sigma: Array | None = None  # (m, 3) standard uncertainty of each coordinate [mm]
    rotation: Array | None = None  # (m, 3, 3) measured orientation of the target frame
    sigma_rotation: Array | None = None  # (m, 3) rad
    notes: tuple[Note, ...] = ()
    prismatic: tuple[bool, ...] = ()  # joints that slide; empty: none does
    gauges: Gauges | None = None  # None: every row is a point; else what is not measured is nan
    # what a `row` is called: a line of a file, a row of a table
    where: Where = field(default_factory=Where)
    # rad, deg, mm or m: of the readings as they were given; empty: rad, mm
    units: tuple[str, ...] = ()
    position_unit: str = "mm"  # mm, m or in: of the positions as they were given
    # °C from which thermal effects are counted, of the whole campaign
    reference_celsius: float = REFERENCE
    coupling: Coupling | None = None  # how motors move the joints; None: each its own
    # (m, n) how fast each joint (coupled: motor) moved, rad/s or mm/s; None without a clock
    rate: Array | None = None
    in_motion: bool = False  # whether the arm moved on while it was measured
    path: JointPath | None = None  # through all visits; None where directions of approach are given
    on_path: Index | None = None  # (m,) place of each row's visit on it
    since_rest: Array | None = None  # (m,) s since the arm last stood for long; None: no clock
    # (m, L) °C, temperature as masses of the time constants LAGS have it; None without a clock
    late_temperature: Array | None = None

    def __len__(self) -> int:
        return len(self.position)

    @property
    def features(self) -> tuple[Feature, ...]:
        """The features that rows share; empty where every row is a point."""
        if self.gauges is None:
            return ()
        return self.gauges.features

    @property
    def points(self) -> NDArray[np.bool_]:
        """(m,) rows that are points."""
        rows = len(self)
        if self.gauges is None:
            return np.ones(rows, bool)
        return self.gauges.of("point")

    @property
    def readings(self) -> Array:
        """(m, n) what the motors read, rad or mm: `q` where nothing is coupled."""
        return readings_of(self.coupling, self.q)

    @property
    def configurations(self) -> int:
        """Number of configurations (visits)."""
        return count_distinct(self.configuration)

    @property
    def approach_from_order(self) -> bool:
        """Whether directions of approach follow from the order of the rows: none were given."""
        return any(note.code == APPROACH_FROM_ORDER for note in self.notes)

    def take(self, index: NDArray[np.intp] | NDArray[np.bool_] | slice) -> Measurements:
        """Select the rows `index` (integers, a mask or a slice); approach and move stay as first
        read."""
        values: dict[str, Any] = {}
        for column in fields(self):
            name = column.name
            value = getattr(self, name)
            if isinstance(value, np.ndarray):
                values[name] = value[index]
        covariates = {}
        for name, covariate in self.covariates.items():
            covariates[name] = covariate[index]
        values["covariates"] = covariates
        gauges = self.gauges
        if gauges is not None:
            values["gauges"] = gauges.take(index)
        return replace(self, **values)

    def to_frame(self) -> pd.DataFrame:
        """Return the measurements in contract form, in rad and mm, indexed by the row of the file
        they came from; `read_measurements` reads it back. Positions that were not measured have no
        columns; of rows that were left out, no move is known any more, and of none the path."""
        import pandas as pd

        columns = {
            **self._reading_columns(),
            **self._measured_columns(),
            **self._label_columns(),
            "configuration": self.configuration,
            "order": self.order,
            **{f"approach{j}": column for j, column in enumerate(self.approach.T, 1)},
            **self.covariates,
        }
        frame = pd.DataFrame(columns, index=pd.Index(self.row, name="row"))
        return frame if self.gauges is None else self._add_gauges(frame, self.gauges)

    def _reading_columns(self) -> dict[str, Array]:
        slides = self.prismatic
        joints = self.q.shape[1]
        if not slides:
            slides = (False,) * joints
        readings = self.readings
        columns = dict[str, Array]()
        for j, slide in enumerate(slides, 1):
            unit = "rad"
            if slide:
                unit = "mm"
            name = f"q{j}_{unit}"
            column = readings[:, j - 1]
            columns[name] = column
        return columns

    def _measured_columns(self) -> dict[str, Array]:
        """Name the columns of positions, orientations and their uncertainties, of those that there
        are."""
        columns = dict[str, Array]()
        if not np.isnan(self.position).all():
            columns |= list_named_columns("x_mm y_mm z_mm", self.position)
        if self.sigma is not None:
            columns |= list_named_columns("sx_mm sy_mm sz_mm", self.sigma)
        if self.rotation is not None:
            quaternion = to_quaternion(self.rotation)
            columns |= list_named_columns("qw qx qy qz", quaternion)
        if self.sigma_rotation is not None:
            names = "srx_rad sry_rad srz_rad"
            columns |= list_named_columns(names, self.sigma_rotation)
        return columns

    def _label_columns(self) -> dict[str, NDArray[np.object_]]:
        columns = {}
        targets = self.targets
        if targets != ONE_TARGET:
            names = np.array(targets, dtype=object)
            columns["target"] = names[self.target]
        groups = self.groups
        if groups != ONE_GROUP:
            names = np.array(groups, dtype=object)
            columns["group"] = names[self.group]
        return columns

    def _add_gauges(self, frame: pd.DataFrame, gauges: Gauges) -> pd.DataFrame:
        """Add what rows measure that are no points, the rows where distances begin back in their
        places."""
        import pandas as pd

        feature_names = [feature.name for feature in gauges.features]
        names = np.array([*feature_names, ""], dtype=object)
        words = np.array(KINDS, dtype=object)
        kinds = words[gauges.kind]
        named = names[gauges.feature]
        columns = KindColumns(kinds, named, gauges.length)
        out = add_kind_columns(frame, columns)
        distances = np.flatnonzero(gauges.of("distance"))
        origin = gauges.origin
        if origin is None or not len(distances):
            return out
        distance_features = gauges.feature[distances]
        features, first = np.unique(distance_features, return_index=True)
        first_rows = distances[first]
        start = origin.take(first_rows)
        count = len(features)
        begin = KindColumns(["distance"] * count, names[features], np.full(count, np.nan))
        begins = add_kind_columns(start.to_frame(), begin)
        begins = begins.dropna(axis="columns", how="all")
        joined = pd.concat([out, begins])
        return joined.sort_index(kind="stable")

    def __repr__(self) -> str:
        count = len(self)
        rows = count_words(count, "row")
        configuration_count = self.configurations
        configurations = count_words(configuration_count, "configuration")
        target_count = len(self.targets)
        targets = count_words(target_count, "target")
        return f"Measurements: {rows}, {configurations}, {targets}"

    def _repr_html_(self) -> str:
        """Show the number of rows and the first of them, for a notebook."""
        frame = self.to_frame()
        table = frame.to_html(max_rows=6, max_cols=10, float_format="%.4g")
        return f"<p>{self!r}</p>{table}"


@dataclass(frozen=True, eq=False)
class Orientation:
    """Measured orientations: `rotation` (m, 3, 3) of the target frame, `sigma` (m, 3) their
    standard uncertainties [rad], None where they are not known."""

    rotation: Array
    sigma: Array | None = None


def build_measurements(
    q: Array,
    position: Array,
    *,
    row: Index | None = None,
    configuration: Sequence[object] | None = None,
    target: Sequence[object] | None = None,
    group: Sequence[object] | None = None,
    order: Array | None = None,
    approach: Array | None = None,
    covariates: Mapping[str, Array] | None = None,
    sigma: Array | None = None,
    orientation: Orientation | None = None,
    kinds: KindColumns | None = None,
    prismatic: Sequence[bool] = (),
    coupling: Coupling | None = None,
    waypoints: Waypoints | None = None,
) -> Measurements:
    """Build measurements from plain arrays; everything optional is derived as contract.md says.

    q: (m, n) joint angles, rad or mm; position: (m, 3) mm, nan where it is not measured;
    `prismatic`: which joints slide; `coupling`: how motors, whose motion is derived, move them. By role: `configuration`, `target`, `group` label the rows, whose number in the
    file is `row`; `order` and `approach` describe the motion; `covariates` the state; `sigma`
    (m, 3) [mm] and `orientation` the measurement; `kinds` what rows measure where not every one is
    a point; `waypoints`: where the arm went between the rows. Raises DataError for a distance of
    one row."""
    q = np.asarray(q, float)
    position = np.asarray(position, float)
    m = len(q)
    same = np.zeros(m, np.intp)
    target_index, targets = (same, ONE_TARGET) if target is None else number_keys(target)
    group_index, groups = (same, ONE_GROUP) if group is None else number_keys(group)
    place = np.arange(m) if row is None else row
    rows = MeasuredRows(q, place, group, configuration, order)
    covariates = dict(covariates or {})
    time = covariates.get("time_s")
    traced = trace_motion(rows, waypoints, coupling, prismatic)
    motion, speed = add_speed(traced, readings_of(coupling, q), group_index, time)
    given = None if approach is None else np.asarray(approach, float)
    data = Measurements(
        q,
        position,
        row=place,
        configuration=motion.visit,
        block=number_blocks(q, motion.visit, prismatic),
        target=target_index,
        group=group_index,
        order=motion.order,
        approach=motion.approach if given is None else given,
        move=motion.move,
        progress=compute_progress(group_index, motion.order, time),
        targets=targets,
        groups=groups,
        covariates=covariates,
        sigma=sigma,
        rotation=None if orientation is None else orientation.rotation,
        sigma_rotation=None if orientation is None else orientation.sigma,
        notes=describe_motion(motion, prismatic, given),
        prismatic=tuple(prismatic),
        reference_celsius=choose_reference(covariates),
        coupling=coupling,
        rate=speed.rate,
        in_motion=speed.goes_on,
        path=motion.find_path(given),
        on_path=motion.on_path,
        since_rest=derive_since_rest(group_index, time),
        late_temperature=derive_late(group_index, time, covariates.get(TEMPERATURE)),
    )
    return data if kinds is None else _add_kinds(data, kinds)


def _add_kinds(data: Measurements, kinds: KindColumns) -> Measurements:
    """Add what rows measure, where not all of them are points."""
    words = set(kinds.kind)
    if words <= {"point"}:
        return data
    index, features = collect_features(kinds)
    numbers = [KINDS.index(word) for word in kinds.kind]
    kind = np.array(numbers, dtype=np.intp)
    gauges = Gauges(kind, index, kinds.length, features)
    return _split_off_origins(data, gauges)


def _split_off_origins(data: Measurements, gauges: Gauges) -> Measurements:
    """Add gauges to measurements. A distance runs from the first row of its feature: that row is no
    measurement of its own, but the `origin` of the others, which are never apart, since they share
    it. Raises DataError for a feature with one row."""
    is_distance = gauges.of("distance")
    if not is_distance.any():
        return replace(data, gauges=gauges)
    row = np.arange(len(data))
    origin = row.copy()
    for number in np.unique(gauges.feature[is_distance]):
        is_of_feature = gauges.feature == number
        rows = np.flatnonzero(is_of_feature)
        origin[rows] = rows[0]
        if len(rows) < 2:
            feature = gauges.features[number]
            raise DataError(
                f'distance "{feature.name}" has one row.',
                remedy="The first row of a feature is where its distances begin; add the row where one ends.",
            )
    block = data.block
    count = int(block.max()) + 1
    of_origin = block[origin]
    shared = np.stack([block, of_origin], 1)
    blocks = connected_components(count, shared)
    joined = replace(data, block=blocks[block])
    is_end = origin != row
    is_kept = ~is_distance | is_end
    kept = np.flatnonzero(is_kept)
    start = replace(joined, notes=())
    start = start.take(origin[kept])
    kept_gauges = replace(gauges.take(kept), origin=start)
    measured = joined.take(kept)
    return replace(measured, gauges=kept_gauges)
