"""Problem: a robot, what was measured on it, where the tracker stands and how well it measures, bound
together.

A problem gives causes their state (named values per row) and the design its blocks of rows. Frozen;
`take` selects rows."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._typing import Array, Index
from ..measurements.measurements import Measurements
from ..mechanisms.causes import Cause
from ..robot.gravity import compute_base_moment, compute_joint_moments, compute_unit_moments
from ..robot.kinematics import Pose, Robot, pose
from .observation import Fixtures, readings

REMEMBER = 20_000  # rows up to which causes are kept once evaluated
NOWHERE = Fixtures.unknown(0)
BLOCK = 4096  # rows: the arrays of one block stay in cache


@dataclass(frozen=True, eq=False)
class Problem:
    """Residuals and columns live in the tracker's frame; G groups have a placement each, T targets
    an offset each."""

    robot: Robot
    data: Measurements
    tools: Array  # (T, 3) mm, nominal target in the flange frame
    placement: tuple[Array, Array]  # R (G, 3, 3), t (G, 3) mm: frame 0 in the tracker's frame
    tool_rotations: Array | None = None  # (T, 3, 3), with orientation measured
    whiten: Array | float = 1.0  # 1/mm, or (m, c, c): times residual = unit variance
    tracker: tuple[float, float, float] = (
        0.0,
        0.0,
        0.0,
    )  # the instrument's own position, for range_mm
    fixtures: Fixtures = NOWHERE  # where features stand, of rows that are no points
    _values: dict[str, Array] = field(default_factory=dict, repr=False)
    _causes: dict[Cause, Array | float] = field(default_factory=dict, repr=False)

    def __len__(self) -> int:
        return len(self.data)

    @cached_property
    def reach_mm(self) -> float:
        """How far the arm and its longest target reach [mm]."""
        return self.robot.reach + float(np.linalg.norm(self.tools, axis=1).max(initial=0))

    @property
    def components(self) -> int:
        """3 for positions, 6 with orientations."""
        return 3 if self.data.rotation is None else 6

    @cached_property
    def measured(self) -> NDArray[np.bool_] | None:
        """(m, c) which components of a row are measured; None where all are."""
        gauges = self.data.gauges
        if gauges is None:
            return None
        turned = np.repeat(gauges.of("point")[:, None], self.components - 3, axis=1)
        return np.concatenate([gauges.coordinates, turned], axis=1)

    @property
    def coordinates(self) -> int:
        """Measured numbers, of all rows."""
        return len(self) * self.components if self.measured is None else int(self.measured.sum())

    def counted(self, of: Index, count: int) -> Index:
        """(count,) measured numbers of the rows that `of` (m,) numbers alike."""
        if self.measured is None:
            return np.asarray(np.bincount(of, minlength=count) * self.components, dtype=np.intp)
        return np.bincount(of, self.measured.sum(1), minlength=count).astype(np.intp)

    def plain_points(self) -> Problem:
        """The same rows as points alone, unweighted: without orientations and what rows that are no
        points measure."""
        data = replace(self.data, rotation=None, sigma_rotation=None, gauges=None)
        return self.anew(data=data, tool_rotations=None, whiten=1.0)

    @cached_property
    def bare(self) -> Problem:
        """The same rows as points, measured at nought: what is left is minus the target's
        position."""
        data = replace(self.data, position=np.zeros((len(self), 3)), gauges=None)
        return replace(self, data=data, whiten=1.0)

    @cached_property
    def origin(self) -> Problem | None:
        """The same of the configurations where the rows' distances begin."""
        gauges = self.data.gauges
        if gauges is None or gauges.origin is None:
            return None
        data = replace(gauges.origin, position=np.zeros((len(self), 3)))
        return self.anew(data=data, whiten=1.0)

    @cached_property
    def readings(self) -> Array:
        """(3, m) what rows that are no points read."""
        assert self.data.gauges is not None
        return readings(self.data.gauges, self.data.position)

    @cached_property
    def tool(self) -> Array:
        """(m, 3) nominal target of every row."""
        return self.tools[self.data.target]

    def anew(self, **changes: Any) -> Problem:
        """The same with some fields changed that causes look at: nothing evaluated before is
        remembered."""
        return replace(self, **changes, _values={}, _causes={})

    def take(self, index: NDArray[np.intp] | NDArray[np.bool_] | slice) -> Problem:
        """The problem of some rows; values already evaluated come along, so causes stay local in
        rows."""
        whiten = self.whiten if isinstance(self.whiten, float) else self.whiten[index]
        return replace(
            self,
            data=self.data.take(index),
            whiten=whiten,
            _causes={},
            _values={name: values[index] for name, values in self._values.items()},
        )

    def pose(self, rows: slice, twist: Array | None = None) -> Pose:
        """Kinematics of a block of rows in frame 0; twist (n+1, 6, rows)."""
        R = None if self.tool_rotations is None else self.tool_rotations[self.data.target[rows]]
        return pose(self.robot, self.data.q[rows], self.tool[rows], twist, R)

    def blocks(self, size: int = BLOCK) -> Iterator[slice]:
        """Slices that cover the rows."""
        return (slice(start, min(start + size, len(self))) for start in range(0, len(self), size))

    def parts(self, size: int = BLOCK) -> Iterator[tuple[slice, Problem]]:
        """(rows, problem of these rows): causes are evaluated block by block, so that none is ever
        held whole; a problem of one block is its own only part, and keeps what it has evaluated."""
        for rows in self.blocks(size):
            yield rows, self if rows.stop - rows.start == len(self) else self.take(rows)

    def cause(self, cause: Cause) -> Array | float:
        """A cause at every row, evaluated once where the data are few enough to keep it."""
        known = self._causes.get(cause)
        if known is None:
            known = cause.of(self)
            if len(self) <= REMEMBER:
                self._causes[cause] = known
        return known

    # -- the state that causes look at
    # -------------------------------------------------------------------------------

    def names(self) -> dict[str, str]:
        """Every name a cause may use on these data, with its unit."""
        n = self.robot.n
        known = {f"q{j}": self.robot.unit(j) for j in range(1, n + 1)} | {
            "x_mm": "mm",
            "y_mm": "mm",
            "z_mm": "mm",
            "range_mm": "mm",
            "target": "1",
            "group": "1",
            "progress": "1",
        }
        known |= {f"approach{j}": "1" for j in range(1, n + 1)} | {
            f"move{j}": self.robot.unit(j) for j in range(1, n + 1)
        }
        if self.robot.gravity is not None:
            known |= {
                f"torque{j}": "N" if self.robot.joints[j - 1].prismatic else "N m"
                for j in range(1, n + 1)
            }
            known |= {f"moment_{axis}": "N m" for axis in "xyz"} | {
                f"down_{axis}": "1" for axis in "xyz"
            }
            known |= {f"moment{j}_{axis}": "N m" for j in range(1, n + 1) for axis in "xy"}
            bodies = [(j, k) for j in range(1, n + 1) for k in range(j + 1, n + 2)]
            known |= {
                f"{stem}_{k}": "N m/kg"
                for j, k in bodies
                for stem in (f"moment{j}_x", f"moment{j}_y", f"torque{j}")
            }
        return known | {name: unit_of(name) for name in self.data.covariates}

    def value(self, name: str) -> Array:
        """(m,) values of a name at every row; KeyError for one these data do not have."""
        if name not in self._values:
            self._values.update(self._evaluate(name))
        return self._values[name]

    def _evaluate(self, name: str) -> dict[str, Array]:
        data = self.data
        if name in data.covariates:
            return {name: data.covariates[name]}
        if name == "feature":
            return {
                name: np.full(len(data), -1.0)
                if data.gauges is None
                else data.gauges.feature.astype(float)
            }
        if name in ("target", "group", "progress"):
            return {name: np.asarray(getattr(data, name), float)}
        for stem, values in (("q", data.q), ("approach", data.approach), ("move", data.move)):
            if name.removeprefix(stem).isdigit() and name.startswith(stem):
                return {f"{stem}{j + 1}": values[:, j] for j in range(self.robot.n)}
        if name not in self.names():
            raise KeyError(name)
        return self._by_pose(name)

    def _by_pose(self, name: str) -> dict[str, Array]:
        """What the chain's pose decides, with what comes along at no cost: moments of many kinds,
        and one rarely needs all."""
        data = self.data
        at, robot = self.pose(slice(None)), self.robot
        if name in ("x_mm", "y_mm", "z_mm", "range_mm"):
            R, t = self.placement
            seen = (
                np.einsum("mij,jm->mi", R[data.group], at.target)
                + t[data.group]
                - np.array(self.tracker)
            )
            return dict(zip(("x_mm", "y_mm", "z_mm"), at.target, strict=True)) | {
                "range_mm": np.linalg.norm(seen, axis=1)
            }
        if name.startswith("down_"):
            down = np.einsum("aim,i->am", at.axes[-1, :3], np.array(robot.gravity))
            return {f"down_{axis}": row for axis, row in zip("xyz", down, strict=True)}
        if name.startswith("moment_"):
            return {
                f"moment_{axis}": row
                for axis, row in zip("xyz", compute_base_moment(robot, at, data.q), strict=True)
            }
        if name.count("_") == 1 + name.startswith(
            "moment"
        ):  # moment2_x_3, torque2_3: of 1 kg at one frame
            return {
                each: row
                for (j, k), rows in compute_unit_moments(robot, at).items()
                for each, row in zip(
                    (f"moment{j}_x_{k}", f"moment{j}_y_{k}", f"torque{j}_{k}"), rows, strict=True
                )
            }
        bends = compute_joint_moments(robot, at, data.q)
        return {f"torque{j + 1}": m[2] for j, m in enumerate(bends)} | {
            f"moment{j + 1}_{axis}": m[a]
            for j, m in enumerate(bends)
            for a, axis in enumerate("xy")
        }


def unit_of(name: str) -> str:
    """Unit of a covariate by the last part of its name: temperature_C -> "°C", payload_kg -> "kg";
    else the name itself."""
    last = name.rpartition("_")[2]
    return (
        {
            "C": "°C",
            "K": "K",
            "kg": "kg",
            "s": "s",
            "mm": "mm",
            "rad": "rad",
            "N": "N",
            "A": "A",
            "h": "h",
        }.get(last, name)
        if "_" in name
        else name
    )


def make_problem(robot: Robot, data: Measurements, tools: Array, groups: int = 1) -> Problem:
    """A problem with the tracker's frame on frame 0 (no registration) and unit weights."""
    placement = (np.tile(np.eye(3), (len(data.groups), 1, 1)), np.zeros((len(data.groups), 3)))
    rotations = np.tile(np.eye(3), (len(tools), 1, 1)) if data.rotation is not None else None
    return Problem(robot, data, np.asarray(tools, float), placement, rotations)
