"""Joint commands whose real position is the wanted one: the calibrated exact chain, inverted near
the nominal command.

Damped Gauss-Newton of least joint change, all rows at once (Levenberg 1944; Nakamura & Hanafusa
1986): the joints' own columns of the screw field are the derivative; that causes change with the
reading as well is second order and left to the iteration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .._typing import Array
from ..exceptions import sentence_list
from ..fitting.problem import Problem
from ..measurements.measurements import Measurements
from ..measurements.reader import read_measurements
from ..measurements.table import Source
from ..robot.kinematics import forward
from ..robot.rigid import rotation_vector
from .calibration import Calibration, in_tracker, pose_of, uncertainty

if TYPE_CHECKING:
    import pandas as pd

ITERATIONS = 60
REACHED_MM = 1e-3  # 1 µm
SETTLED_MM = 1e-7
# what a radian of a wanted orientation weighs against a mm, and a slide's mm against a radian
LEVER_MM = 100.0
BOUND = (10e-3, 20.0)  # rad, mm: what a correction may change before it is more likely a mistake
EDGE = 0.01  # of a range: further beyond it is said
AT_LIMIT = 1e-9  # rad, mm: a command at the limit, as it comes back from degrees
READ_IN = {"rad": 1.0, "deg": 180 / np.pi, "mm": 1.0, "m": 1e-3}  # units of readings, in rad or mm


@dataclass(frozen=True, eq=False)
class Commands:
    """Corrected commands q (m, n) and where they lead: `wanted` (m, 3) in the tracker's frame;
    `before_mm` the error of the nominal command, `left_mm` what the corrected one leaves on the
    calibrated model, `model_mm` the standard uncertainty of that model there (length),
    `expected_mm` the root of the sum of squares of the two and of the measuring noise; `before_rad`
    and `left_rad` the same of wanted orientations, None without; `beyond` (m, n) commands beyond a
    joint's limits."""

    q: Array
    change: Array
    wanted: Array
    before_mm: Array
    left_mm: Array
    model_mm: Array
    expected_mm: Array
    before_rad: Array | None = None
    left_rad: Array | None = None
    beyond: NDArray[np.bool_] = field(default_factory=lambda: np.zeros((0, 0), bool))

    @property
    def reached(self) -> NDArray[np.bool_]:
        """(m,) rows that land on the wanted position to 1 µm of the model, and have the wanted
        orientation to 10 µrad."""
        near = self.left_mm <= REACHED_MM
        return near if self.left_rad is None else near & (self.left_rad <= REACHED_MM / LEVER_MM)

    @property
    def where_left(self) -> str:
        """The columns that say how far from the wanted place a row ends."""
        return (
            "error_left_mm" if self.left_rad is None else "error_left_mm and orientation_left_mrad"
        )

    def figures(self) -> dict[str, Array]:
        """What is expected of every row, by the names of a table's columns."""
        out = {
            "error_before_mm": self.before_mm,
            "error_left_mm": self.left_mm,
            "model_uncertainty_mm": self.model_mm,
            "expected_error_mm": self.expected_mm,
        }
        if self.before_rad is not None and self.left_rad is not None:
            out |= {
                "orientation_before_mrad": self.before_rad * 1e3,
                "orientation_left_mrad": self.left_rad * 1e3,
            }
        return out


def commanded(at: Problem, q: Array) -> Problem:
    """The problem at other joint readings, all else as it was: the direction and size of the moves
    are those of the plan."""
    return replace(at, data=replace(at.data, q=q))


def nominal(at: Problem) -> Array:
    """(m, 3) where the nominal robot has the target, in the tracker's frame."""
    return in_tracker(at, forward(at.robot, at.data.q, at.tool))


def _error(c: Calibration, at: Problem, wanted: Array) -> tuple[Array, Array]:
    """(what is missing (m, c), its derivative to the joints (m, c, n)) in frame 0: mm, and with
    orientations rad · LEVER_MM."""
    pose, R = pose_of(at, c.terms, c.theta), at.placement[0][at.data.group]
    inside = np.einsum("mji,mj->mi", R, wanted - at.placement[1][at.data.group])
    joint = [2 if j.prismatic else 5 for j in at.robot.joints]
    J = pose.displacement()[range(at.robot.n), joint].transpose(2, 1, 0)
    error = inside - pose.target.T
    if at.data.rotation is None:
        return error, J
    turned = np.einsum("mji,mjk,mlk->mil", R, at.data.rotation, pose.rotation.transpose(2, 0, 1))
    turns = np.array([not j.prismatic for j in at.robot.joints])
    K = pose.axes[range(at.robot.n), joint].transpose(2, 1, 0) * turns
    return np.concatenate([error, LEVER_MM * rotation_vector(turned)], 1), np.concatenate(
        [J, LEVER_MM * K], 1
    )


def compensate(c: Calibration, data: Measurements) -> Commands:
    """Corrected commands for planned ones: `data.q` nominal commands, `data.position` wanted
    positions (nan: where the nominal robot has the target), `data.rotation` wanted orientations
    where there are any. Raises DataError."""
    start = c.problem(data)
    wanted = np.where(np.isnan(data.position), nominal(start), data.position)
    scale = np.array([LEVER_MM if j.prismatic else 1.0 for j in c.robot.joints])
    q, damping = data.q.copy(), np.full(len(data), 1e-9)
    error, J = _error(c, start, wanted)
    before, size = error, np.linalg.norm(error, axis=1)
    for _ in range(ITERATIONS):
        going = (size > SETTLED_MM) & (damping < 1e6)
        if not going.any():
            break
        Js = J[going] * scale
        inner = Js @ Js.transpose(0, 2, 1)
        weight = damping[going] * np.trace(inner, axis1=1, axis2=2)
        damped = inner + weight[:, None, None] * np.eye(inner.shape[1])
        step = Js.transpose(0, 2, 1) @ np.linalg.solve(damped, error[going, :, None])
        trial = q.copy()
        trial[going] += step[:, :, 0] * scale
        e, slope = _error(c, commanded(start, trial), wanted)
        new = np.linalg.norm(e, axis=1)
        better = going & (new < size)
        error = np.where(better[:, None], e, error)
        q[better], J[better], size[better] = trial[better], slope[better], new[better]
        damping = np.where(
            better, np.maximum(damping / 10, 1e-12), np.where(going, damping * 10, damping)
        )
    left, turned = np.linalg.norm(error[:, :3], axis=1), data.rotation is not None
    model = np.sqrt(np.square(uncertainty(c, commanded(start, q))).sum((1, 2)))
    return Commands(
        q,
        q - data.q,
        wanted,
        np.linalg.norm(before[:, :3], axis=1),
        left,
        model,
        np.sqrt(left**2 + model**2 + 3 * c.floor.coordinate_mm**2),
        np.linalg.norm(before[:, 3:], axis=1) / LEVER_MM if turned else None,
        np.linalg.norm(error[:, 3:], axis=1) / LEVER_MM if turned else None,
        past_limits(c, q),
    )


def past_limits(c: Calibration, q: Array) -> NDArray[np.bool_]:
    """(m, n) readings beyond their joint's limits; none where these are not known."""
    low, high = np.array([j.limits or (-np.inf, np.inf) for j in c.robot.joints]).T
    return np.asarray((q < low - AT_LIMIT) | (q > high + AT_LIMIT))


def correct(c: Calibration, targets: Source, *, bound: tuple[float, float] = BOUND) -> pd.DataFrame:
    """Corrected commands of a file or DataFrame of planned ones (q1_rad … or _deg, wanted x_mm y_mm
    z_mm or none, and what the model looks at), with the error before, and what is left and expected
    after. Warns of what the calibration has never seen and of rows that are not reached. `bound`:
    rad and mm that a correction may not pass. Raises DataError."""
    from warnings import warn

    data = read_measurements(targets, c.robot.prismatic, positions=False, once=False)
    made = compensate(c, data)
    refuse(c, made, data, bound, Path(targets).name if isinstance(targets, (str, PathLike)) else "")
    missed = int((~made.reached).sum())
    for said in (
        *outside(c, data),
        *from_order(c, data),
        *at_limits(made),
        *(
            [f"{missed} of {len(data)} rows are not reached: see {made.where_left}."]
            if missed
            else []
        ),
    ):
        warn(said, stacklevel=2)
    return commands_frame(c, data, made.q, made.wanted, made.figures())


def commands_frame(
    c: Calibration, data: Measurements, q: Array, x: Array, more: Mapping[str, Array]
) -> pd.DataFrame:
    """Commands q (m, n) and positions x (m, 3) as a table in the form of a measurements file, the
    commands in the units of the planned ones, with `more` columns."""
    import pandas as pd

    units = data.units or [c.robot.unit(j) for j in range(1, c.robot.n + 1)]
    columns: dict[str, object] = {
        f"q{j}_{unit}": q[:, j - 1] * READ_IN[unit] for j, unit in enumerate(units, 1)
    }
    columns |= dict(zip(("x_mm", "y_mm", "z_mm"), x.T, strict=True))
    columns["target"] = np.array(data.targets)[data.target]
    columns |= {
        f"approach{j + 1}": data.approach[:, j].astype(int) for j in range(c.robot.n)
    } | dict(data.covariates)
    return pd.DataFrame(columns | dict(more))


def refuse(
    c: Calibration, made: Commands, data: Measurements, bound: tuple[float, float], file: str
) -> None:
    """Raises DataError with the first row that would be changed by more than the bound (rad, mm);
    `file`: empty for a DataFrame."""
    slides = np.array(c.robot.prismatic)
    over = np.abs(made.change) / np.where(slides, bound[1], bound[0])
    whole = np.column_stack([over, made.before_mm / bound[1]])
    bad = np.flatnonzero((whole > 1).any(1))
    if not len(bad):
        return
    row = int(bad[0])
    k = int(np.argmax(whole[row]))
    what = (
        f"the target would be moved by {made.before_mm[row]:.3g} mm"
        if k == c.robot.n
        else f"joint {k + 1} would be changed by "
        + (
            f"{made.change[row, k]:.3g} mm"
            if slides[k]
            else f"{made.change[row, k] * 1e3:.3g} mrad"
        )
    )
    raise data.where.refuse(
        f"{what}, beyond the bound of {bound[0] * 1e3:g} mrad and {bound[1]:g} mm"
        + (f" ({len(bad)} such rows)." if len(bad) > 1 else "."),
        row=int(data.row[row]),
        remedy=f"Nothing was {'written' if file else 'changed'}. Check that the wanted position belongs "
        f"to the command, or raise {'--bound' if file else 'the bound'}.",
    )


def outside(c: Calibration, data: Measurements) -> list[str]:
    """What is asked of beyond what the calibration has seen, in words: joint readings and the
    covariates its model looks at."""
    n, out = c.robot.n, []
    values = {f"q{j + 1}": data.q[:, j] for j in range(n)} | {
        k: v for k, v in data.covariates.items() if k in c.needs()
    }
    for name, seen in values.items():
        if name not in c.ranges:
            continue
        low, high = c.ranges[name]
        slack = EDGE * (high - low)
        beyond = int(((seen < low - slack) | (seen > high + slack)).sum())
        if beyond:
            factor, unit = _shown(c, name)
            known = f"{low * factor:.4g} to {high * factor:.4g}{unit}"
            out.append(
                f"{name}: {beyond} of {len(data)} rows lie beyond the {known} that the calibration has seen; there the "
                "model is a guess."
            )
    out += [
        f"joint {j}: {count} of {len(data)} rows lie beyond its limits."
        for j, count in enumerate(past_limits(c, data.q).sum(0).tolist(), 1)
        if count
    ]
    unknown = sorted(
        int(name.removeprefix("approach"))
        for name in c.needs()
        if name.startswith("approach")
        and (data.approach[:, int(name.removeprefix("approach")) - 1] == 0).any()
    )
    out += [
        f"joint {j}: the direction of approach of some rows is not known (0): its backlash is taken at the middle there."
        for j in unknown
    ]
    return out


def from_order(c: Calibration, data: Measurements) -> list[str]:
    """That the model looks at motions which nobody gave but the order of the targets, in words."""
    own, out = any(n.code == "approach-from-order" for n in data.notes), []
    for stem, what in (("approach", "directions of approach"), ("move", "sizes of the moves")):
        joints = sorted(
            int(n.removeprefix(stem))
            for n in c.needs()
            if n.removeprefix(stem).isdigit() and n.startswith(stem)
        )
        if joints and (own or stem == "move"):
            remedy = " or give approach columns" if stem == "approach" else ""
            out.append(
                f"joint{'s' * (len(joints) > 1)} {sentence_list([str(j) for j in joints])}: the {what} are taken from the "
                f"order of the targets in the file. Run them in this order{remedy}."
            )
    return out


def at_limits(made: Commands) -> list[str]:
    """Which corrected commands no joint can take, in words."""
    return [
        f"joint {j}: {count} of {len(made.q)} corrected commands lie beyond its limits."
        for j, count in enumerate(made.beyond.sum(0).tolist(), 1)
        if count
    ]


def _shown(c: Calibration, name: str) -> tuple[float, str]:
    """(factor, unit) in which people read a value: degrees and mm for joints."""
    if name not in {f"q{j}" for j in range(1, c.robot.n + 1)}:
        return 1.0, ""
    return (1.0, " mm") if c.robot.joints[int(name[1:]) - 1].prismatic else (180 / np.pi, " deg")
