"""Signatures: what a candidate says of the arm, level by level.

Where something moves (place), on what that depends (drivers), how (shape), and why (cause)."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from ..._typing import Index
from ...measurements.campaign.reference_temperature import TEMPERATURE
from ...measurements.campaign.state_names import (
    StateKind,
    is_where_target_is,
    parse_state_name,
    state_kind,
)
from ...mechanisms.bending import LINK_BENDING, PAYLOAD_BENDING
from ...mechanisms.compliance import PAYLOAD, PAYLOAD_DEFLECTION
from ..shapes.candidate_kinds import CandidateKind
from ..shapes.late_temperatures import is_late
from ..shapes.shape_constants import find_own_wave, find_time_constant
from ..shapes.unregistered import QUARTER
from .candidate import Candidate
from .fault_kinds import FaultKind
from .slide_steps import SET_UP_STEP

# what a candidate says at each level, part by part
Parts = tuple[frozenset[Hashable], ...]

LEVELS = ("place", "drivers", "shape", "cause")
# probability from which a level holds
PROVEN = 0.9
# kinds that take any shape of their drivers
SHAPELESS = (
    CandidateKind.WAVE_PRODUCT,
    CandidateKind.FREE_FUNCTION,
    CandidateKind.WOUND,
    CandidateKind.DISTORTION,
    CandidateKind.SHAPE,
)

# what yields in several forms: links by the moment at their end or all along, what a payload turns wherever
# it hangs
OF_FORMS = LINK_BENDING, PAYLOAD_BENDING, PAYLOAD_DEFLECTION
# a torque of 1 kg at a frame is the torque of masses that are not known
WITHOUT_MASSES = {
    StateKind.UNIT_TORQUE: StateKind.TORQUE,
    StateKind.UNIT_BENDING: StateKind.BENDING,
}
# what all kinds stand for that say where the target is
SEEN = "the target's place"
# names of one move that no measurement tells apart: a bump and a step of the tracker
SAME_MOVE = {FaultKind.TRACKER_BUMPED.label: SET_UP_STEP}
# kinds of one shape, whatever its constant: the reading at which it sets in, the number of slow waves,
# the way over which hysteresis builds up, the moment at which a wave changes or a link moves
OF_ONE_SHAPE = (
    CandidateKind.JUMP,
    CandidateKind.RAMP,
    CandidateKind.SAW,
    CandidateKind.PULL,
    CandidateKind.KINK,
    CandidateKind.TIME_WAVE,
    CandidateKind.HYSTERESIS,
    CandidateKind.FALL,
    CandidateKind.STEPPED_WAVE,
    CandidateKind.MOVED_LINK,
)


def read_signatures(found: Sequence[Candidate]) -> tuple[Index, ...]:
    """Read off every candidate what it says at each level: equal numbers (G,) say the same, -1
    nothing."""
    signatures = []
    for read in (_read_place, read_drivers, _read_shape, _read_cause):
        known: dict[Hashable, int] = {}
        said = [read(candidate) for candidate in found]
        signatures.append(
            np.array([-1 if key is None else known.setdefault(key, len(known)) for key in said])
        )
    return tuple(signatures)


def read_parts(candidate: Candidate, told: Candidate) -> Parts:
    """Read off what a candidate says at each level part by part: its places, these with each name
    that they depend on, and its terms.

    `told`: the candidate without the screws that hardly move the target. Several candidates that
    have its parts between them, and no others, say together what it says."""
    mechanism = candidate.mechanism
    names = list_drivers_by_place(told)
    places = frozenset(names)
    drivers = frozenset((place, name) for place in names for name in names[place])
    terms = frozenset(term.key for term in mechanism.terms)
    return places, drivers, terms, terms


def _read_place(candidate: Candidate) -> Hashable:
    part = _find_part(candidate)
    if part is not None:
        return part
    return frozenset(candidate.mechanism.names_by_place()) or None


def _find_part(candidate: Candidate) -> str | None:
    """Find what a registered mechanism says moves, where its screws do not tell that: an instrument that
    steps along the first joint's slide is not that joint."""
    mechanism = candidate.mechanism
    is_shift = mechanism.name == SET_UP_STEP and len(mechanism.terms) == 1
    return "instrument" if candidate.registered and is_shift else None


def number_forms(found: Sequence[Candidate]) -> Index:
    """Number (G,) the links that registered mechanisms have bend, each under one load, and what a payload
    turns: by all of their forms they say the same, though they move it in other ways; -1 of anything else."""
    known: dict[Hashable, int] = {}
    numbers = np.full(len(found), -1)
    for g, candidate in enumerate(found):
        mechanism = candidate.mechanism
        if candidate.registered and mechanism.stem in OF_FORMS:
            load = mechanism.name, PAYLOAD in mechanism.names()
            numbers[g] = known.setdefault(load, len(known))
    return numbers


def read_drivers(candidate: Candidate) -> Hashable:
    """Read where a candidate moves the arm, and on what that depends; None for nothing."""
    part = _find_part(candidate)
    if part is not None:
        mechanism = candidate.mechanism
        return part, mechanism.stem, PAYLOAD in mechanism.names()
    return frozenset(list_drivers_by_place(candidate).items()) or None


def list_drivers_by_place(candidate: Candidate) -> dict[tuple[int, str], frozenset[str]]:
    """List the places where a candidate acts, each with what it depends on there."""
    names_by_place = candidate.mechanism.names_by_place()
    drivers = {}
    for place, names in names_by_place.items():
        drivers[place] = frozenset(_name_driver(name) for name in names if not _is_fixed(name))
    return drivers


def add_sides(drivers: frozenset[str]) -> frozenset[str]:
    """Add the sides that joints came from whose last moves are among the drivers."""
    return drivers | _list_sides(drivers)


def leave_out_sides(drivers: frozenset[str]) -> frozenset[str]:
    """Leave out the sides that joints came from whose last moves are among the drivers."""
    return drivers - _list_sides(drivers)


def _list_sides(drivers: frozenset[str]) -> frozenset[str]:
    """List the sides that the last moves among the drivers say."""
    moves = [name for name in drivers if name.startswith("move")]
    return frozenset(name.replace("move", "approach") for name in moves)


@cache
def _is_fixed(name: str) -> bool:
    """Return whether a state variable is of the set-up alone: nothing depends on what never changes."""
    return state_kind(name) in (StateKind.ON_FLANGE, StateKind.LOAD_ON_FLANGE)


@cache
def _name_driver(name: str) -> str:
    """Name what a state variable stands for: a torque, whatever masses make it; what a joint drags
    along, however far behind; the temperature, however late; where the target is, however an instrument sees that."""
    if is_where_target_is(name):
        return SEEN
    variable = parse_state_name(name)
    if variable is None:
        return name
    if variable.kind is StateKind.LATE:
        return TEMPERATURE
    if variable.kind is StateKind.DRAG:
        of_any_width = replace(variable, width=0)
        return of_any_width.name
    if variable.kind not in WITHOUT_MASSES:
        return name
    massless_kind = WITHOUT_MASSES[variable.kind]
    loaded = replace(variable, kind=massless_kind, frame=None)
    return loaded.name


def _read_shape(candidate: Candidate) -> Hashable:
    """Of a registered mechanism the name, whatever its constant; of a jump, a slow wave and a warm-up the
    place alone; waves of about one number are the same."""
    if candidate.kind in SHAPELESS:
        return None
    if candidate.kind is CandidateKind.JOINT_WAVE:
        joint, count = find_own_wave(candidate.mechanism)
        quarters = round(count / QUARTER)
        return candidate.kind, joint, quarters
    constant = find_time_constant(candidate.mechanism)
    is_warm_up = constant is not None
    if candidate.kind in OF_ONE_SHAPE or is_warm_up:
        drivers_by_place = list_drivers_by_place(candidate)
        acts = frozenset(drivers_by_place.items())
        return candidate.kind, acts
    if is_late(candidate.mechanism) and not candidate.registered:
        return candidate.kind, "late", frozenset(list_drivers_by_place(candidate).items())
    if candidate.but_for_sign:
        return candidate.but_for_sign[0].name
    return _read_cause(candidate) or candidate.screws


def _read_cause(candidate: Candidate) -> str | None:
    name = candidate.registered_name
    if name is None:
        return None
    return SAME_MOVE.get(name, name)
