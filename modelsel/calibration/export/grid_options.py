"""What a correction table is over, and where everything else is held."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from ..._typing import Array
from ...exceptions import StudyError, sentence_list, suggest
from ...measurements.campaign.reference_temperature import TEMPERATURE
from ...measurements.campaign.state_names import StateKind, is_state_name, state_kind
from ..commands.command_notes import RANGE_TOLERANCE

if TYPE_CHECKING:
    from ..calibration import Calibration

MAX_JOINTS = 3  # of a grid: with more its points are too many, or too far apart
LARGEST_MM = 0.01
NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)"
RANGE = re.compile(rf"(\d{{1,3}})(?:=({NUMBER}):({NUMBER}))?")
UNITS = {"deg": np.pi / 180, "rad": 1.0, "mm": 1.0}


@dataclass(frozen=True)
class GridOptions:
    """What a grid is over: `joints` (from 1), until it is within `largest_mm` between its points;
    `at`: readings (q4_deg) and covariates that the others are held at; `ranges` of the joints
    [rad, mm], where they are not all that the calibration has seen."""

    joints: tuple[int, ...] = (1, 2, 3)
    largest_mm: float = LARGEST_MM
    at: Mapping[str, float] = field(default_factory=dict)
    ranges: Mapping[int, tuple[float, float]] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Held:
    """What every point of a grid shares: readings (n,) [rad, mm], covariates, sizes of moves
    (n,)."""

    q: Array
    covariates: Mapping[str, float]
    move: Array


def default_joints(c: Calibration) -> tuple[int, ...]:
    """Return the first joints that the calibration has seen move, as many as a grid is over.
    Raises StudyError where none moved."""
    joints = range(1, c.robot.n + 1)
    moved = [joint for joint in joints if _has_width(c, f"q{joint}")]
    if not moved:
        raise StudyError(
            "grid: the calibration has seen no joint move, and a grid is over joints that did. "
            "Export another form, such as json."
        )
    return tuple(moved[:MAX_JOINTS])


def read_ranges(
    c: Calibration, text: str
) -> tuple[tuple[int, ...], dict[int, tuple[float, float]]]:
    """Read joints as people write them, "1=-90:90,2": their numbers, and the ends [rad, mm] of
    those that have some. Raises StudyError."""
    numbers = []
    ranges = {}
    for part in text.split(","):
        written = RANGE.fullmatch(part.strip())
        if written is None:
            raise StudyError(
                f"--joints {text}: expected joints such as 1,2,3, or 1=-90:90 from -90 to 90 (degrees "
                "or mm)."
            )
        number = int(written[1])
        numbers.append(number)
        if written[2] is None or not 1 <= number <= c.robot.n:
            continue
        scale = 1.0 if c.robot.prismatic[number - 1] else np.pi / 180
        ranges[number] = (float(written[2]) * scale, float(written[3]) * scale)
    return tuple(numbers), ranges


def check_joints(c: Calibration, joints: Sequence[int]) -> None:
    """Raise StudyError where a grid cannot be over these joints (from 1)."""
    distinct = len(set(joints)) == len(joints)
    known = all(1 <= joint <= c.robot.n for joint in joints)
    if not (distinct and known and 1 <= len(joints) <= MAX_JOINTS):
        listed = ",".join(map(str, joints))
        raise StudyError(
            f"--joints {listed}: a grid is over one to {MAX_JOINTS} of the joints 1 to {c.robot.n}, "
            "each once."
        )


def find_ranges(c: Calibration, options: GridOptions) -> list[tuple[float, float]]:
    """Find the ends of the grid along every joint [rad, mm]. Raises StudyError beyond what the
    calibration has seen."""
    ranges = []
    for joint in options.joints:
        slides = c.robot.prismatic[joint - 1]
        seen_low, seen_high = c.ranges[f"q{joint}"]
        low, high = options.ranges.get(joint, (seen_low, seen_high))
        inside = _is_seen(c, f"q{joint}", low) and _is_seen(c, f"q{joint}", high)
        if not (inside and low < high):
            ends = np.array([seen_low, seen_high])
            unit = "mm" if slides else "deg"
            first, last = (ends if slides else np.degrees(ends)).tolist()
            raise StudyError(
                f"--joints: the grid of joint {joint} must lie within the {first:.6g} to {last:.6g} "
                f"{unit} that the calibration has seen, and start below its end."
            )
        ranges.append((low, high))
    return ranges


def hold_others(c: Calibration, options: GridOptions) -> Held:
    """Hold every value in the middle of what the calibration has seen, or where it is asked to be.
    Raises StudyError for a value that it does not know, or has not seen."""
    middles = {name: _round_middle(c, name) for name in c.ranges}
    given = {}
    for name, value in options.at.items():
        key, factor = _find_key(c, name, options.joints)
        given[key] = value * factor
        low, high = c.ranges[key]
        if not _is_seen(c, key, given[key]):
            raise StudyError(
                f"--at {name}={value:g}: the calibration has seen {low / factor:.6g} to "
                f"{high / factor:.6g}."
            )
    if c.refits is not None and c.refits.mean_celsius is not None and TEMPERATURE in middles:
        # as the other forms hold it
        middles[TEMPERATURE] = c.refits.mean_celsius
    middles |= given
    joints = range(1, c.robot.n + 1)
    q = np.array([middles[f"q{joint}"] for joint in joints])
    move = np.array([middles.get(f"move{joint}", 1.0) for joint in joints])
    covariates = {name: middles[name] for name in c.ranges if not is_state_name(name)}
    return Held(q, covariates, move)


def _find_key(c: Calibration, name: str, joints: Sequence[int]) -> tuple[str, float]:
    """Find the value of the state that --at names, and the factor to its unit."""
    known = {name: (name, 1.0) for name in c.ranges if not is_state_name(name)}
    for joint, slides in enumerate(c.robot.prismatic, 1):
        if joint in joints:
            continue
        for unit in ("mm",) if slides else ("deg", "rad"):
            known[f"q{joint}_{unit}"] = (f"q{joint}", UNITS[unit])
    if name not in known:
        raise StudyError(
            f"--at {name}: the calibration has no such value beside those of the grid. {suggest(name, known)}"
        )
    return known[name]


def _round_middle(c: Calibration, name: str) -> float:
    """Return the middle of a range: of a joint in whole degrees, of others to three digits."""
    low, high = c.ranges[name]
    middle = (low + high) / 2
    joints = {f"q{k}" for k, slides in enumerate(c.robot.prismatic, 1) if not slides}
    rounded = float(f"{middle:.3g}")
    if name in joints:
        rounded = float(np.radians(round(np.degrees(middle))))
    return min(max(rounded, low), high)


def _has_width(c: Calibration, name: str) -> bool:
    """Whether the calibration has seen more than one value."""
    seen = c.ranges[name]
    low, high = seen
    return low < high


def _is_seen(c: Calibration, name: str, value: float) -> bool:
    """Whether the calibration has seen a value, or one so near that it is no extrapolation."""
    low, high = c.ranges[name]
    slack = RANGE_TOLERANCE * (high - low)
    return low - slack <= value <= high + slack


def describe_validity(c: Calibration, joints: Sequence[int], held: Held) -> list[str]:
    """Say where alone a table is valid: at which values of the joints and covariates that it has no
    column of, and for which motion."""
    said = []
    values = [f"{name} = {value}" for name, value in _list_values(c, joints, held)]
    if values:
        said.append(f"it is valid only at {sentence_list(values)}")
    needs = c.needs()
    if any(name.startswith("approach") for name in needs):
        said.append("for the direction of approach, the middle of the play is taken")
    if any(name.startswith("move") for name in needs):
        said.append("the size of the last move is not taken into account")
    if any(state_kind(name) is StateKind.DRAG for name in needs):
        said.append("for what a joint drags along, the middle between both sides is taken")
    return said


def _list_values(c: Calibration, joints: Sequence[int], held: Held) -> list[tuple[str, str]]:
    """List the joints, and what else the model needs, that a table holds at one value: name, value."""
    out = []
    for joint, slides in enumerate(c.robot.prismatic, 1):
        if joint in joints:
            continue
        value = float(held.q[joint - 1])
        shown = f"{value:.6g} mm" if slides else f"{np.degrees(value):.6g} deg"
        out.append((f"joint {joint}", shown))
    needs = c.needs()
    for name, value in held.covariates.items():
        if name in needs:
            out.append((name, f"{value:.6g}"))
    return out


def list_held(c: Calibration, joints: Sequence[int], held: Held) -> tuple[str, ...]:
    """List what the table does not look at, with where it is held."""
    out = [f"{name} away from {value}" for name, value in _list_values(c, joints, held)]
    kinds = {state_kind(name) for name in c.needs()}
    if StateKind.APPROACH in kinds:
        out.append("the direction of approach (the middle of the play is taken)")
    if StateKind.MOVE in kinds:
        out.append("the size of the last move")
    if StateKind.DRAG in kinds:
        out.append("what a joint drags along (the middle between both sides is taken)")
    if StateKind.RATE in kinds:
        out.append("the speed (the arm stands still)")
    return tuple(out)
