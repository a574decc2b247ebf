"""What was measured: joint readings, positions, and what else is known of each row. Frozen;
indexable by row."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .._typing import Array, Index
from ..exceptions import DataError
from ..notices import Note
from ..robot.rigid import to_quaternion
from .features import COORDINATES, KINDS, Feature, features_of, framed
from .reference_temperature import REFERENCE, reference
from .resting_joints import resting, said
from .row_order import campaign
from .table import Where

if TYPE_CHECKING:
    import pandas as pd
SAME_READING = 1e-6  # rad or mm: two readings closer than this are the same configuration


@dataclass(frozen=True, eq=False)
class Gauges:
    """What m rows measure where not every row is a point: `kind` (m,) index into KINDS, `feature`
    (m,) index into `features` (-1: none), `length` (m,) mm (nan: none); `origin`: for rows of kind
    distance, where the length begins (the others: the row itself), None where there are none."""

    kind: Index
    feature: Index
    length: Array
    features: tuple[Feature, ...] = ()
    origin: Measurements | None = None

    @property
    def coordinates(self) -> NDArray[np.bool_]:
        """(m, 3) which coordinates of a row's residual are measured; a single number stands in the
        first (y, z in their own)."""
        return COORDINATES[self.kind]

    def of(self, *kinds: str) -> NDArray[np.bool_]:
        """(m,) rows of some kinds."""
        return np.isin(self.kind, [KINDS.index(k) for k in kinds])

    def take(self, index: NDArray[np.intp] | NDArray[np.bool_] | slice) -> Gauges:
        """Of some rows."""
        origin = None if self.origin is None else self.origin.take(index)
        return replace(
            self,
            kind=self.kind[index],
            feature=self.feature[index],
            length=self.length[index],
            origin=origin,
        )


@dataclass(frozen=True, eq=False, repr=False)
class Measurements:
    """m measured points. Positions in the tracker's frame [mm]; residual = measured - predicted
    everywhere."""

    q: Array  # (m, n) joint readings, rad or mm
    position: Array  # (m, 3) mm
    row: Index  # (m,) row of the file, 0-based
    configuration: Index  # (m,) visit of the arm; several targets share one
    block: Index  # (m,) readings alike to 1e-6: never apart in folds or split
    target: Index  # (m,) index into `targets`
    group: Index  # (m,) index into `groups`
    order: Array  # (m,) order of motion within the group
    approach: Array  # (m, n) sign of each joint's last motion, 0 unknown
    move: Array  # (m, n) size of the motion that led here, rad or mm
    progress: Array  # (m,) place in the order of motion of the whole campaign, 0 to 1
    targets: tuple[str, ...] = ("target",)
    groups: tuple[str, ...] = ("all",)
    covariates: Mapping[str, Array] = field(default_factory=dict)
    sigma: Array | None = None  # (m, 3) standard uncertainty of each coordinate [mm]
    rotation: Array | None = None  # (m, 3, 3) measured orientation of the target frame
    sigma_rotation: Array | None = None  # (m, 3) rad
    notes: tuple[Note, ...] = ()
    prismatic: tuple[bool, ...] = ()  # joints that slide; empty: none does
    gauges: Gauges | None = None  # None: every row is a point; else what is not measured is nan
    where: Where = field(
        default_factory=Where
    )  # what a `row` is called: a line of a file, a row of a table
    units: tuple[
        str, ...
    ] = ()  # rad, deg, mm or m: of the readings as they were given; empty: rad, mm
    reference_celsius: float = (
        REFERENCE  # °C from which thermal effects are counted, of the whole campaign
    )

    def __len__(self) -> int:
        return len(self.position)

    @property
    def features(self) -> tuple[Feature, ...]:
        """The features that rows share; empty where every row is a point."""
        return () if self.gauges is None else self.gauges.features

    @property
    def points(self) -> NDArray[np.bool_]:
        """(m,) rows that are points."""
        return np.ones(len(self), bool) if self.gauges is None else self.gauges.of("point")

    @property
    def configurations(self) -> int:
        """Number of configurations (visits)."""
        return len(np.unique(self.configuration))

    def take(self, index: NDArray[np.intp] | NDArray[np.bool_] | slice) -> Measurements:
        """The rows `index` (integers, a mask or a slice); approach and move stay as first read."""
        rows = {
            f.name: getattr(self, f.name)[index]
            for f in fields(self)
            if isinstance(getattr(self, f.name), np.ndarray)
        }
        gauges = None if self.gauges is None else self.gauges.take(index)
        return replace(
            self,
            **rows,
            covariates={k: v[index] for k, v in self.covariates.items()},
            gauges=gauges,
        )

    def to_frame(self) -> pd.DataFrame:
        """The measurements in contract form, in rad and mm, indexed by the row of the file they
        came from; `read_measurements` reads it back. Positions that were not measured have no
        columns; of rows that were left out, no move is known any more."""
        import pandas as pd

        slides = self.prismatic or (False,) * self.q.shape[1]
        columns: dict[str, object] = {
            f"q{j}_{'mm' if s else 'rad'}": self.q[:, j - 1] for j, s in enumerate(slides, 1)
        }
        several = (
            ("position", ("x_mm", "y_mm", "z_mm"), self.position),
            ("sigma", ("sx_mm", "sy_mm", "sz_mm"), self.sigma),
            (
                "rotation",
                ("qw", "qx", "qy", "qz"),
                None if self.rotation is None else to_quaternion(self.rotation),
            ),
            ("sigma_rotation", ("srx_rad", "sry_rad", "srz_rad"), self.sigma_rotation),
        )
        for what, names, values in several:
            if values is not None and not (what == "position" and np.isnan(values).all()):
                columns |= dict(zip(names, values.T, strict=True))
        for name, index, known, plain in (
            ("target", self.target, self.targets, ("target",)),
            ("group", self.group, self.groups, ("all",)),
        ):
            if known != plain:
                columns[name] = np.array(known, dtype=object)[index]
        columns |= {"configuration": self.configuration, "order": self.order}
        columns |= {f"approach{j}": self.approach[:, j - 1] for j in range(1, len(slides) + 1)}
        frame = pd.DataFrame(columns | dict(self.covariates), index=pd.Index(self.row, name="row"))
        return frame if self.gauges is None else self._framed(frame, self.gauges)

    def _framed(self, frame: pd.DataFrame, gauges: Gauges) -> pd.DataFrame:
        """The same where not every row is a point, the rows where distances begin back in their
        places."""
        import pandas as pd

        names, distance = (
            [*(f.name for f in gauges.features), ""],
            np.flatnonzero(gauges.of("distance")),
        )
        out = framed(
            frame,
            [KINDS[k] for k in gauges.kind],
            [names[k] for k in gauges.feature],
            gauges.length,
        )
        if gauges.origin is None or not len(distance):
            return out
        feature, first = np.unique(gauges.feature[distance], return_index=True)
        start = gauges.origin.take(distance[first]).to_frame()
        begins = framed(
            start,
            ["distance"] * len(first),
            [names[k] for k in feature],
            np.full(len(first), np.nan),
        )
        return pd.concat([out, begins.dropna(axis="columns", how="all")]).sort_index(kind="stable")

    def __repr__(self) -> str:
        targets = f"{len(self.targets)} target{'s' * (len(self.targets) > 1)}"
        return f"Measurements: {len(self)} rows, {self.configurations} configurations, {targets}"

    def _repr_html_(self) -> str:
        """How much was measured, and the first rows, for a notebook."""
        return f"<p>{self!r}</p>{self.to_frame().to_html(max_rows=6, max_cols=10, float_format='%.4g')}"


def numbered(keys: Sequence[object] | NDArray[np.generic]) -> tuple[Index, tuple[str, ...]]:
    """Index of each key's first appearance, and the distinct keys in that order."""
    names: dict[str, int] = {}
    index = np.array([names.setdefault(str(key), len(names)) for key in keys], dtype=np.intp)
    return index, tuple(names)


def visits(q: Array, explicit: Sequence[object] | None, group: Index) -> Index:
    """Configuration of every row: the given column, else adjacent rows with equal readings in one
    group."""
    if explicit is not None:
        return numbered(explicit)[0]
    new = np.ones(len(q), bool)
    new[1:] = (np.abs(np.diff(q, axis=0)).max(1) > SAME_READING) | (np.diff(group) != 0)
    return np.asarray(np.cumsum(new) - 1, dtype=np.intp)


def _near(q: Array, order: Index, close: NDArray[np.bool_]) -> Index | None:
    """Pairs (k, 2) of rows with readings alike, among those that an order along one direction
    leaves `close` to the one before; None where too many are."""
    pairs = [np.zeros((0, 2), dtype=np.intp)]
    later = np.flatnonzero(close)  # places in the order, each close to the place before
    for lag in range(1, 17):
        if not len(later):
            return np.concatenate(pairs)
        couple = np.stack([order[later - lag], order[later]], 1)
        alike = np.abs(q[couple[:, 0]] - q[couple[:, 1]]).max(1) <= SAME_READING
        pairs.append(couple[alike])
        later = later[(later > lag) & close[np.maximum(later - lag, 0)]]
    return None


def blocks(q: Array, configuration: Index) -> Index:
    """Rows whose readings agree to 1e-6, or that share a configuration, get one number."""
    visit, first, which = np.unique(configuration, return_index=True, return_inverse=True)
    slant = np.sqrt(
        np.arange(1, q.shape[1] + 1)
    )  # readings alike in every joint are alike along any one direction
    along = q[first] @ slant
    order = np.argsort(along, kind="stable")
    near = _near(
        q[first], order, np.diff(along[order], prepend=-np.inf) <= SAME_READING * slant.sum()
    )
    if near is not None and not len(near):
        return np.asarray(which.reshape(-1), dtype=np.intp)
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    if near is None:
        from scipy.spatial import cKDTree

        near = cKDTree(q[first]).query_pairs(SAME_READING, p=np.inf, output_type="ndarray")
    graph = coo_array(
        (np.ones(len(near)), (near[:, 0], near[:, 1])), shape=(len(visit), len(visit))
    )
    return np.asarray(
        connected_components(graph, directed=False)[1][which.reshape(-1)], dtype=np.intp
    )


def motion(
    q: Array, configuration: Index, group: Index, order: Array, prismatic: Sequence[bool]
) -> tuple[Array, Array, Array]:
    """(approach, move), each (m, n), from the order of motion, and the largest flicker of each
    joint's reading (n,) that is no motion; the first configuration of a group has 0. Approach keeps
    its sign while a joint rests, as the play in a gear does."""
    sequence = np.lexsort((np.arange(len(q)), order, group))
    start = np.unique(configuration[sequence], return_index=True)[1]
    start = sequence[np.sort(start)]  # one row per visit, in order of motion
    step = np.zeros((len(start), q.shape[1]))
    step[1:] = np.diff(q[start], axis=0)
    step[1:][np.diff(group[start]) != 0] = 0
    step[np.abs(step) <= SAME_READING] = 0
    index = np.arange(len(start))[:, None]
    opening = np.r_[True, np.diff(group[start]) != 0] if len(start) else np.zeros(0, bool)
    still = resting(step, opening, prismatic)
    flicker = np.abs(np.where(still, step, 0.0)).max(0, initial=0.0)
    step[still] = 0
    last = np.maximum.accumulate(np.where((step != 0) | opening[:, None], index, 0), axis=0)
    sign = np.sign(np.take_along_axis(step, last, axis=0))
    where = np.empty(int(configuration.max(initial=-1)) + 1, dtype=np.intp)
    where[configuration[start]] = np.arange(len(start))
    return sign[where[configuration]], np.abs(step)[where[configuration]], flicker


def in_turn(unit: Index, progress: Array) -> tuple[Index, Index]:
    """(every row's unit (m,) numbered as the arm came to them, the first row (u,) of each): the
    same whatever the rows' order."""
    _, which = np.unique(unit, return_inverse=True)
    sequence = np.lexsort((progress, which))
    first = sequence[np.flatnonzero(np.diff(which[sequence], prepend=-1))]
    order = np.argsort(progress[first], kind="stable")
    return np.asarray(np.argsort(order, kind="stable")[which], dtype=np.intp), first[order]


def measurements(
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
    rotation: Array | None = None,
    sigma_rotation: Array | None = None,
    notes: tuple[Note, ...] = (),
    prismatic: Sequence[bool] = (),
    kind: Sequence[str] | None = None,
    feature: Sequence[str] | None = None,
    length: Array | None = None,
) -> Measurements:
    """Measurements from plain arrays; everything optional is derived as contract.md says. Units:
    rad (or mm) and mm. `kind`, `feature` ("" for none) and `length` [mm, nan for none] where not
    every row is a point; `position` is then nan where it is not measured. Raises DataError for a
    distance of one row."""
    q, position = np.asarray(q, float), np.asarray(position, float)
    m = len(q)
    target_index, targets = (
        numbered(target) if target is not None else (np.zeros(m, np.intp), ("target",))
    )
    group_index, groups = numbered(group) if group is not None else (np.zeros(m, np.intp), ("all",))
    order = np.arange(m, dtype=float) if order is None else np.asarray(order, float)
    visit = visits(q, configuration, group_index)
    derived, move, flicker = motion(q, visit, group_index, order, prismatic)
    if (rest := said(flicker, prismatic)) is not None:
        notes = (*notes, Note("joint-rests", rest))
    if approach is None:
        approach = derived
        notes = (
            *notes,
            Note(
                "approach-from-order",
                "Directions of approach are taken from the order of motion, once, "
                "on reading: the data have no approach columns.",
            ),
        )
    made = Measurements(
        q,
        position,
        np.arange(m) if row is None else row,
        visit,
        blocks(q, visit),
        target_index,
        group_index,
        order,
        np.asarray(approach, float),
        move,
        campaign(group_index, order, (covariates or {}).get("time_s")),
        targets,
        groups,
        dict(covariates or {}),
        sigma,
        rotation,
        sigma_rotation,
        notes,
        tuple(prismatic),
        reference_celsius=reference(covariates or {}),
    )
    if kind is None or set(kind) <= {"point"}:
        return made
    length = np.full(m, np.nan) if length is None else np.asarray(length, float)
    index, features = features_of(kind, [""] * m if feature is None else feature, length)
    return _from_origins(
        made,
        Gauges(
            np.array([KINDS.index(word) for word in kind], dtype=np.intp), index, length, features
        ),
    )


def _from_origins(data: Measurements, gauges: Gauges) -> Measurements:
    """The measurements with what their rows measure. A distance runs from the first row of its
    feature: that row is no measurement of its own, but the `origin` of the others, which are never
    apart, since they share it. Raises DataError for a feature with one row."""
    distance = gauges.of("distance")
    if not distance.any():
        return replace(data, gauges=gauges)
    origin = np.arange(len(data))
    for f in np.unique(gauges.feature[distance]):
        rows = np.flatnonzero(gauges.feature == f)
        origin[rows] = rows[0]
        if len(rows) < 2:
            raise DataError(
                f'distance "{gauges.features[f].name}" has one row.',
                remedy="The first row of a feature is where its distances begin; add the row where one ends.",
            )
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    count = int(data.block.max()) + 1
    graph = coo_array((np.ones(len(data)), (data.block, data.block[origin])), shape=(count, count))
    joined = replace(
        data,
        block=np.asarray(connected_components(graph, directed=False)[1][data.block], dtype=np.intp),
    )
    kept = np.flatnonzero(~distance | (origin != np.arange(len(data))))
    start = replace(joined, notes=()).take(origin[kept])
    return replace(joined.take(kept), gauges=replace(gauges.take(kept), origin=start))
