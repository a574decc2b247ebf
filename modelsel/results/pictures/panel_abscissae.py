"""What a finding's panel is drawn against: an angle, an argument of a sign, the one quantity that a
cause depends on, a move with its direction, or else the cause itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..._typing import Array
from ...measurements.campaign.state_names import StateKind, StateVariable, parse_state_name
from ...mechanisms.causes import Applied, Bump, Cause, Named
from ...mechanisms.waves import find_common_wave, read_wave

# waves per turn from which they are folded onto one
MIN_FOLDED_WAVES = 3
# what 1 is in the unit that is drawn: of the campaign's course, and of angles
PERCENT, DEGREES = 100.0, float(np.degrees(1.0))
DIRECTED_MOVE = {StateKind.APPROACH, StateKind.MOVE}

Kind = Literal["line", "wave", "step", "free", "curve"]


@dataclass(frozen=True)
class Abscissa:
    """What causes are drawn against, in which manner, and how many waves they make per turn of it."""

    variable: Cause
    kind: Kind
    waves: float = 1.0

    @property
    def is_angle(self) -> bool:
        """Whether it is drawn in degrees."""
        return self.variable.unit == "rad"

    @property
    def is_folded(self) -> bool:
        """Whether all waves of a turn are laid over each other."""
        return self.waves >= MIN_FOLDED_WAVES and self.is_angle

    @property
    def scale(self) -> float:
        """What its values are multiplied by to be drawn."""
        if self.is_angle:
            return DEGREES
        return PERCENT if self._is_progress else 1.0

    @property
    def unit(self) -> str:
        """The unit that is drawn."""
        if self.is_angle:
            return "deg"
        return "%" if self._is_progress else self.variable.unit

    @property
    def words(self) -> str:
        """What stands below the axis: a reading or a column by its name, a state variable in words."""
        printed = str(self.variable)
        if self.is_folded:
            return f"{self.waves:g}*{printed}, folded"
        moved = find_directed_move(self.variable)
        if moved is not None:
            return f"last move of joint {moved}, with its direction"
        state = self._state
        if state is None or state.kind is StateKind.READING:
            return printed
        return state.words.removeprefix("the ")

    @property
    def _state(self) -> StateVariable | None:
        """The state variable that it is, if it is one."""
        if not isinstance(self.variable, Named):
            return None
        return parse_state_name(self.variable.name)

    @property
    def _is_progress(self) -> bool:
        state = self._state
        return state is not None and state.kind is StateKind.PROGRESS

    def evaluate(self, cause: Cause, x: Array) -> Array:
        """Evaluate a cause where the variable is x; zero where that says too little."""
        if self.kind == "line":
            return x
        wave = read_wave(cause)
        if self.kind == "wave" and wave is not None:
            return wave.evaluate(x)
        if self.kind == "step" and isinstance(cause, Applied):
            return np.sign(x)
        line = self._lay_out(x)
        count = len(x)
        if line is None:
            return np.zeros(count)
        values = np.asarray(cause.of(line))
        return np.broadcast_to(values, x.shape)

    def _lay_out(self, x: Array) -> _Line | None:
        """Return the state where the variable is x; None of one that says too little."""
        moved = find_directed_move(self.variable)
        if moved is not None:
            return _Line({f"approach{moved}": np.sign(x), f"move{moved}": np.abs(x)})
        if isinstance(self.variable, Named):
            return _Line({self.variable.name: x})
        return None


@dataclass(frozen=True)
class _Line:
    """Values along one axis: enough of a state for a cause that depends on these alone."""

    values: Mapping[str, Array]

    def value(self, name: str) -> Array:
        """Return the values of a name."""
        return self.values[name]


def choose_abscissa(cause: Cause, siblings: Sequence[Cause], units: Mapping[str, str]) -> Abscissa:
    """Return what to draw a cause against; `siblings`: the causes at its place, `units`: of all names."""
    if isinstance(cause, Bump):
        unit = units.get(cause.name, "1")
        driver = Named(cause.name, unit)
        return Abscissa(driver, "free")
    if isinstance(cause, Applied) and cause.function == "sign":
        return Abscissa(cause.argument, "step")
    for sibling in siblings:
        wave = find_common_wave((cause, sibling))
        if wave is not None:
            angle, count = wave
            return Abscissa(angle, "wave", count)
    if isinstance(cause, Named):
        return Abscissa(cause, "line")
    variable = _find_variable(cause, units)
    if variable is None:
        return Abscissa(cause, "line")
    return Abscissa(variable, "curve")


def _find_variable(cause: Cause, units: Mapping[str, str]) -> Cause | None:
    """Find the one quantity that a cause depends on, or the move with its direction."""
    names = sorted(cause.names())
    named = [Named(name, units.get(name, "1")) for name in names]
    if len(named) == 1:
        return named[0]
    if len(named) != 2:
        return None
    approach, move = named
    directed = approach * move
    return None if find_directed_move(directed) is None else directed


def find_directed_move(cause: Cause) -> int | None:
    """Find the joint whose last move, with its direction, a cause depends on alone; None of any other."""
    states = [parse_state_name(name) for name in cause.names()]
    known = [state for state in states if state is not None]
    joints = {state.joint for state in known}
    if len(known) < len(states) or len(joints) != 1:
        return None
    if {state.kind for state in known} != DIRECTED_MOVE:
        return None
    return joints.pop()
