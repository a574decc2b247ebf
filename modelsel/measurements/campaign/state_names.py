"""State variables: the quantities that a cause may look at, by name.

One table says how each name is written, in which unit it is and what it needs. Whoever evaluates
the state (`fitting.state_variables`), reserves its names in a file (`reader`) or writes them into
an exported module asks here; no name is taken apart anywhere else. Joints and frames count from 1;
covariates of a file come under the names of their columns."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from enum import Enum
from functools import cached_property, lru_cache
from itertools import product
from math import log

from ...robot.kinematics import Robot
from .clock_history import LAGS
from .preferred_numbers import list_preferred

THOUSAND = 1000.0  # mrad in a rad, µm in a mm
# widths up to which a joint gets ahead of what it drags along: of one that turns [mrad], and of a
# slide [µm]
TURNED = list_preferred(4, 1400)
SLID = list_preferred(200, 90_000)


DRAG_NAME = re.compile(r"drag(?P<joint>\d{1,3})(_(?P<width>\d{1,9}))?")
USUAL_WIDTH = 500


class StateKind(Enum):
    """What a state variable is."""

    READING = "reading of a joint"
    POSITION = "coordinate of the target in frame 0"
    RANGE = "distance of the target from the instrument"
    BEAM = "direction from the instrument to the target"
    AZIMUTH = "horizontal angle of the beam"
    ZENITH = "angle of the beam to the instrument's upright axis"
    ASIDE = "level direction across the beam"
    RISE = "upward direction across the beam"
    FACE = "direction of the beam in the target's frame"
    REACH = "distance of the target from joint 1's axis"
    ON_FLANGE = "coordinate of the target in the flange"
    LOAD_POSITION = "coordinate in frame 0 of where a payload hangs"
    LOAD_ON_FLANGE = "coordinate in the flange of where a payload hangs"
    TARGET = "index of the target"
    GROUP = "index of the group"
    PROGRESS = "place in the campaign, 0 to 1"
    APPROACH = "direction of a joint's last motion"
    MOVE = "size of a joint's last motion"
    DRAG = "how far a joint is ahead of what it drags along"
    RATE = "how fast a joint moves"
    SINCE_REST = "how long the arm has been at work"
    LATE = "temperature as a slow mass has it"
    TORQUE = "gravity torque about a joint's axis"
    BASE_MOMENT = "moment of the arm's weight about frame 0"
    DOWN = "direction of gravity in the target's frame"
    DOWN_AT_JOINT = "direction of gravity in a joint's frame"
    BENDING = "moment of the links' weight across a joint's axis"
    UNIT_BENDING = "moment of 1 kg at a frame across a joint's axis"
    UNIT_TORQUE = "torque of 1 kg at a frame about a joint's axis"


@dataclass(frozen=True)
class StateVariable:
    """One quantity of the state: its kind, and where its name has them the joint (from 1), the
    axis ("x", "y" or "z"), the frame (from 2) at whose origin 1 kg is thought to hang, the width
    [mrad or µm] up to which a joint gets ahead of what it drags along, and the lag [min] of a mass
    that follows the temperature."""

    kind: StateKind
    joint: int | None = None
    axis: str | None = None
    frame: int | None = None
    width: int | None = None
    lag: int | None = None

    @property
    def family(self) -> StateFamily:
        """The row of the table that it belongs to."""
        return BY_KIND[self.kind]

    @property
    def name(self) -> str:
        """Name as a cause prints it: "moment2_x_3"."""
        return self._fill(self.family.template)

    @property
    def words(self) -> str:
        """What it is, within a sentence: "the reading of joint 2"."""
        return self._fill(self.family.words)

    @property
    def most(self) -> float:
        """The most that it is on either side [rad or mm] of a joint's drag; 1 of a side alone."""
        return 1.0 if self.width is None else self.width / THOUSAND

    def _fill(self, template: str) -> str:
        return template.format(
            joint=self.joint, axis=self.axis, frame=self.frame, width=self.width, lag=self.lag
        )

    def unit(self, robot: Robot) -> str:
        """Return the unit on an arm, "1" where it has none."""
        family_unit = self.family.unit
        if family_unit is not None:
            return family_unit
        assert self.joint is not None
        if self.kind is StateKind.TORQUE:
            joint = robot.joints[self.joint - 1]
            return "N" if joint.prismatic else "N m"
        if self.kind is StateKind.RATE:
            return f"{robot.unit(self.joint)}/s"
        return robot.unit(self.joint)

    def exists(self, robot: Robot) -> bool:
        """Whether an arm has it: the joint, the frame, the direction of gravity."""
        needs_gravity = self.family.by_gravity
        if needs_gravity and robot.gravity is None:
            return False
        joint = self.joint or 1
        last_frame = robot.n + 1
        frame = self.frame or last_frame
        if not 1 <= joint <= robot.n:
            return False
        if self.lag is not None and self.lag not in LAGS:
            return False
        if self.width is not None and self.width not in list_widths(robot, joint):
            return False
        return joint < frame <= last_frame


@dataclass(frozen=True)
class StateFamily:
    """How the names of one kind are written: `template` with {joint}, {axis} (one of `axes`), {frame},
    {width} and {lag}, and `words` for sentences with the same; `unit`, None where it depends on the joint;
    `by_gravity`: only where the direction of gravity is known."""

    kind: StateKind
    template: str
    words: str
    unit: str | None = "1"
    axes: str = ""
    by_gravity: bool = False

    @cached_property
    def pattern(self) -> re.Pattern[str]:
        """Regular expression of its names."""
        groups = {
            "joint": r"(?P<joint>\d+)",
            "axis": f"(?P<axis>[{self.axes}])",
            "frame": r"(?P<frame>\d+)",
            "width": r"(?P<width>\d+)",
            "lag": r"(?P<lag>\d+)",
        }
        return re.compile(self.template.format(**groups))

    def members(self, robot: Robot) -> Iterator[StateVariable]:
        """List its variables on an arm, joint by joint, then by frame, then by axis."""
        joints: Iterable[int | None] = (None,)
        frames: Iterable[int | None] = (None,)
        axes = self.axes or (None,)
        template = self.template
        if "{joint}" in template:
            joints = range(1, robot.n + 1)
        if "{frame}" in template:
            frames = range(2, robot.n + 2)
        widths: Iterable[int | None] = (None,)
        if "{width}" in template:
            slides = any(robot.prismatic)
            widths = (TURNED | SLID) if slides else TURNED
        lags: Iterable[int | None] = LAGS if "{lag}" in template else (None,)
        indices = product(joints, frames, axes, widths, lags)
        for joint, frame, axis, width, lag in indices:
            variable = StateVariable(self.kind, joint, axis, frame, width, lag)
            if variable.exists(robot):
                yield variable


FAMILIES = (
    StateFamily(StateKind.READING, "q{joint}", "the reading of joint {joint}", None),
    StateFamily(StateKind.POSITION, "{axis}_mm", "the target's place", "mm", "xyz"),
    StateFamily(StateKind.RANGE, "range_mm", "the distance from the instrument", "mm"),
    StateFamily(StateKind.BEAM, "beam_{axis}", "the direction of the beam", "1", "xyz"),
    StateFamily(StateKind.AZIMUTH, "beam_azimuth", "the beam's horizontal angle", "rad"),
    StateFamily(StateKind.ZENITH, "beam_zenith", "the beam's vertical angle", "rad"),
    StateFamily(StateKind.ASIDE, "beam_aside_{axis}", "the direction of the beam", "1", "xyz"),
    StateFamily(StateKind.RISE, "beam_rise_{axis}", "the direction of the beam", "1", "xyz"),
    StateFamily(
        StateKind.FACE, "beam_face_{axis}", "the beam's direction at the target", "1", "xyz"
    ),
    StateFamily(StateKind.REACH, "reach_mm", "the reach from joint 1's axis", "mm"),
    StateFamily(
        StateKind.ON_FLANGE, "on_flange_{axis}_mm", "the target's place on the flange", "mm", "xyz"
    ),
    StateFamily(StateKind.LOAD_POSITION, "load_{axis}_mm", "the payload's place", "mm", "xyz"),
    StateFamily(
        StateKind.LOAD_ON_FLANGE, "load_on_flange_{axis}_mm", "the payload's place", "mm", "xyz"
    ),
    StateFamily(StateKind.TARGET, "target", "the target"),
    StateFamily(StateKind.GROUP, "group", "the group"),
    StateFamily(StateKind.PROGRESS, "progress", "the course of the campaign"),
    StateFamily(StateKind.APPROACH, "approach{joint}", "the side that joint {joint} came from"),
    StateFamily(StateKind.MOVE, "move{joint}", "the last move of joint {joint}", None),
    StateFamily(
        StateKind.DRAG,
        "drag{joint}_{width}",
        "how far joint {joint} is ahead of what it drags along",
        None,
    ),
    StateFamily(StateKind.RATE, "rate{joint}", "the speed of joint {joint}", None),
    StateFamily(
        StateKind.SINCE_REST, "since_rest_s", "the time since the arm last stood for long", "s"
    ),
    StateFamily(
        StateKind.LATE, "temperature_{lag}_min_late", "the temperature {lag} min late", "°C"
    ),
    StateFamily(
        StateKind.TORQUE,
        "torque{joint}",
        "the gravity torque about joint {joint}",
        None,
        by_gravity=True,
    ),
    StateFamily(
        StateKind.BASE_MOMENT,
        "moment_{axis}",
        "the moment of the arm's weight about the base",
        "N m",
        "xyz",
        by_gravity=True,
    ),
    StateFamily(
        StateKind.DOWN, "down_{axis}", "the direction of gravity at the target", "1", "xyz", True
    ),
    StateFamily(
        StateKind.DOWN_AT_JOINT, "down{joint}_{axis}", "the pull at joint {joint}", "1", "xyz", True
    ),
    StateFamily(
        StateKind.BENDING,
        "moment{joint}_{axis}",
        "the moment of weight across joint {joint}",
        "N m",
        "xy",
        by_gravity=True,
    ),
    StateFamily(
        StateKind.UNIT_BENDING,
        "moment{joint}_{axis}_{frame}",
        "the moment of weight across joint {joint}",
        "N m/kg",
        "xy",
        by_gravity=True,
    ),
    StateFamily(
        StateKind.UNIT_TORQUE,
        "torque{joint}_{frame}",
        "the gravity torque about joint {joint}",
        "N m/kg",
        by_gravity=True,
    ),
)
# what follows from where the instrument stands
FROM_INSTRUMENT = frozenset(
    (
        "range_mm",
        "beam_azimuth",
        "beam_zenith",
        *(f"beam_{axis}" for axis in "xyz"),
        *(f"beam_aside_{axis}" for axis in "xyz"),
        *(f"beam_rise_{axis}" for axis in "xyz"),
        *(f"beam_face_{axis}" for axis in "xyz"),
    )
)
# kinds that no cause may look at where the instrument is not known to stand away from the arm
NEED_INSTRUMENT = (
    StateKind.AZIMUTH,
    StateKind.ZENITH,
    StateKind.ASIDE,
    StateKind.RISE,
    StateKind.FACE,
)
# kinds that say where the target is, with what hangs there
WHERE_TARGET_IS = (
    StateKind.POSITION,
    StateKind.LOAD_POSITION,
    StateKind.RANGE,
    StateKind.BEAM,
    StateKind.AZIMUTH,
    StateKind.ZENITH,
    StateKind.ASIDE,
    StateKind.RISE,
)
BY_KIND = {family.kind: family for family in FAMILIES}
COVARIATE_UNITS = {
    "C": "°C",
    "K": "K",
    "kg": "kg",
    "s": "s",
    "mm": "mm",
    "rad": "rad",
    "N": "N",
    "A": "A",
    "h": "h",
}


@lru_cache(maxsize=4096)
def parse_state_name(name: str) -> StateVariable | None:
    """Read a name of the table; None for any other, such as a covariate's."""
    for family in FAMILIES:
        match = family.pattern.fullmatch(name)
        if match is not None:
            parts = match.groupdict()
            axis = parts.pop("axis", None)
            numbers = {part: int(digits) for part, digits in parts.items()}
            return StateVariable(family.kind, axis=axis, **numbers)
    return None


def describe_state_name(name: str) -> str:
    """Describe a name in words: the column of that name where it is not of the table."""
    variable = parse_state_name(name)
    return f"the column {name}" if variable is None else variable.words


def state_kind(name: str) -> StateKind | None:
    """Return the kind of a name of the table; None for any other, such as a covariate's."""
    variable = parse_state_name(name)
    return None if variable is None else variable.kind


def is_where_target_is(name: str) -> bool:
    """Return whether a name is of a quantity that says where the target is."""
    return state_kind(name) in WHERE_TARGET_IS


def needs_gravity(name: str) -> bool:
    """Return whether a name is of a quantity that depends on the direction of gravity."""
    variable = parse_state_name(name)
    if variable is None:
        return False
    family = variable.family
    return family.by_gravity


def is_state_name(name: str) -> bool:
    """Return whether a name is one of the table's, of any arm: no column may have it."""
    return parse_state_name(name) is not None


def state_units(robot: Robot) -> dict[str, str]:
    """Return the names of an arm's state variables, with their units."""
    return {
        variable.name: variable.unit(robot)
        for family in FAMILIES
        for variable in family.members(robot)
    }


def find_nearest_width(name: str, known: Iterable[str]) -> str | None:
    """Find the known drag of the same joint whose width is nearest to that of a name, by their ratio, or
    that is usual where the name has none; None for any other name."""
    match = DRAG_NAME.fullmatch(name)
    if match is None:
        return None
    joint = int(match["joint"])
    wanted = int(match["width"] or USUAL_WIDTH)
    drags = [variable for each in known if (variable := parse_state_name(each)) and variable.width]
    own = [variable for variable in drags if variable.joint == joint]
    if not own or not wanted:
        return None
    nearest = min(own, key=lambda variable: abs(log(variable.most * THOUSAND / wanted)))
    return nearest.name


def list_widths(robot: Robot, joint: int) -> Mapping[int, None]:
    """List the widths [mrad, of a slide µm] up to which a joint (from 1) may get ahead of what it
    drags along, in their order."""
    return SLID if robot.joints[joint - 1].prismatic else TURNED


def covariate_unit(name: str) -> str:
    """Return the unit of a covariate by the end of its name: temperature_C -> "°C", payload_kg ->
    "kg", speed_mm_per_s -> "mm/s"; else the name itself."""
    counted, rate, of = name.rpartition("_per_")
    ends = (counted, f"_{of}") if rate else (name,)
    units = []
    for end in ends:
        _, separator, suffix = end.rpartition("_")
        unit = COVARIATE_UNITS.get(suffix) if separator else None
        if unit is None:
            return name
        units.append(unit)
    return "/".join(units)
