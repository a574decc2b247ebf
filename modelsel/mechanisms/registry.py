"""The table of mechanisms: explicit, passed as an argument, never changed by an import.

An entry is a function `robot -> Mechanism` (None where it does not apply), or PerJoint for one that exists once
a joint. Outsiders join by the entry point group `modelsel.mechanisms`: () -> dict of entries (`with_plugins`)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from .._arguments import check_type, describe_value, name_type
from ..exceptions import StudyError, one_line, suggest
from ..measurements.campaign.reference_temperature import REFERENCE
from ..robot.files import as_robot
from ..robot.gravity import find_bearing_joints
from ..robot.kinematics import Robot
from . import (
    base_tilts,
    bending,
    compliance,
    drifts,
    drives,
    environment,
    geometry,
    gravity_effects,
    instrument,
    motors,
    tools,
    wobbles,
)
from . import target_names as by_target
from .entry_joints import Joints, choose_entry_joints
from .target_entries import PerTarget, build_of_target
from .terms import Mechanism, unstorable


@dataclass(frozen=True)
class PerJoint:
    """A mechanism that exists once a joint: `build(robot, joint)` for each of `joints`, which are
    their numbers or a function of the robot that returns them."""

    build: Callable[[Robot, int], Mechanism]
    joints: Joints


@dataclass(frozen=True)
class Scanned:
    """A mechanism with an inner constant (waves a turn, a moment, masses): `build(robot, joint, constant)`, or
    `build(robot, constant)` where `joints` is None; naming scans the constants and counts them all. `range`:
    between which real numbers it may lie where it is one that sampling takes as continuous. `targets`: names
    of several targets, each of which may move by itself, None where they are not known; `numbers`: theirs in
    their file; `more`: constants that a name may have beyond those that every search offers."""

    build: Callable[..., Mechanism]
    constants: Callable[..., tuple[float, ...]]
    joints: Joints | None = None
    range: tuple[float, float] | None = None
    targets: tuple[str, ...] | None = None
    numbers: tuple[int, ...] = ()
    more: tuple[float, ...] = ()


Entry = Callable[[Robot], Mechanism | None] | PerJoint | Scanned
Registry = Mapping[str, Entry]
REGISTRY_EXPECTED = 'a registry, as {**BUILTIN, "mine": mine}'


def build_thermal(reference: float = REFERENCE) -> Registry:
    """Build the thermal mechanisms, counted from the reference [°C]."""
    return {
        "thermal-growth": PerJoint(
            partial(environment.thermal_growth, reference=reference), environment.growing_links
        ),
        "thermal-expansion": partial(environment.thermal_expansion, reference=reference),
        "thermal-zero": PerJoint(
            partial(environment.thermal_zero, reference=reference), drives.all_joints
        ),
        "thermal-shift": PerTarget(partial(environment.thermal_shift, reference=reference)),
    }


class _Builtin(dict[str, Entry]):
    """The mechanisms of this program, which a signature shows by their name."""

    def __repr__(self) -> str:
        return "BUILTIN"


_BUILTIN: Registry = {
    "geometric": geometry.geometric,
    "joint2-twist": gravity_effects.joint2_twist,
    "joint3-twist": gravity_effects.joint3_twist,
    "gravity-twist": gravity_effects.gravity_twist,
    "backlash": Scanned(
        gravity_effects.backlash, gravity_effects.list_sides, motors.find_gravity_motors
    ),
    "wrist-coupling": PerJoint(drives.wrist_coupling, drives.wrist_joints),
    "base-tilt": Scanned(base_tilts.base_tilt, base_tilts.list_tilts),
    "base-rocking": Scanned(gravity_effects.base_rocking, gravity_effects.list_edges),
    "gear-eccentricity": PerJoint(drives.gear_eccentricity, drives.revolute_joints),
    "encoder-eccentricity": PerJoint(drives.encoder_eccentricity, drives.revolute_joints),
    "encoder-scale": PerJoint(drives.encoder_scale, drives.all_joints),
    "slide-scales": drives.slide_scales,
    "gear-ripple": Scanned(
        drives.gear_ripple, drives.list_waves, drives.revolute_joints, more=drives.HIGH_WAVES
    ),
    "axis-wobble": Scanned(wobbles.axis_wobble, wobbles.list_wobbles, drives.revolute_joints),
    "joint-compliance": Scanned(
        compliance.joint_compliance, compliance.mass_choices, motors.find_payload_motors
    ),
    "lateral-compliance": Scanned(
        compliance.lateral_compliance, compliance.list_bearing_loads, find_bearing_joints
    ),
    bending.LINK_BENDING: Scanned(
        bending.link_bending, bending.list_bendings, bending.find_bending_links
    ),
    compliance.PAYLOAD_DEFLECTION: Scanned(
        compliance.payload_deflection, compliance.list_hangs, motors.find_payload_motors
    ),
    bending.PAYLOAD_BENDING: Scanned(
        bending.payload_bending, bending.list_loads, bending.find_loaded_links
    ),
    "payload-tilt": gravity_effects.payload_tilt,
    "counterbalance": compliance.counterbalance,
    "tool-droop": PerTarget(tools.tool_droop, others=(tools.tool_bending,)),
    "tool-stretch": PerTarget(tools.tool_stretch),
    "tool-play": PerTarget(tools.tool_play),
    "payload-droop": PerTarget(tools.payload_droop),
    "payload-shift": PerTarget(tools.payload_shift),
    "approach-backlash": PerJoint(drives.approach_backlash, drives.all_joints),
    "overshoot": PerJoint(drives.overshoot, drives.all_joints),
    "settle": PerJoint(drives.settling, drives.all_joints),
    drives.SERVO_LAG: PerJoint(drives.servo_lag, drives.all_joints),
    **build_thermal(),
    "tracker-drift": Scanned(drifts.tracker_drift, drifts.list_drifts),
    "tracker-step": Scanned(
        environment.tracker_step, lambda robot: environment.STEPS, range=(0.0, 1.0)
    ),
    "target-step": Scanned(
        environment.target_step, lambda robot: environment.STEPS, range=(0.0, 1.0)
    ),
    "zero-step": Scanned(
        environment.zero_step,
        lambda robot, joint: environment.STEPS,
        drives.all_joints,
        range=(0.0, 1.0),
    ),
    "tracker-scale": environment.tracker_scale,
    "tracker-range": instrument.tracker_range,
    "tracker-axes": environment.tracker_axes,
    "tracker-azimuth": Scanned(instrument.tracker_azimuth, lambda robot: instrument.WAVES),
    "tracker-zenith": Scanned(instrument.tracker_zenith, lambda robot: instrument.WAVES),
    "tracker-index": instrument.tracker_index,
    "tracker-transit": instrument.tracker_transit,
    "tracker-collimation": instrument.tracker_collimation,
    "tracker-offset": instrument.tracker_offset,
    "tracker-errors": instrument.tracker_errors,
    "reflector-incidence": Scanned(
        instrument.reflector_incidence, lambda robot: instrument.DEGREES
    ),
    "refraction": environment.refraction,
}
BUILTIN: Registry = _Builtin(_BUILTIN)


def build_faults(robot: Robot) -> tuple[Mechanism, ...]:
    """Build the faults of the data that act as screws; naming offers them beside the mechanisms,
    under `fault:` names."""
    return (
        drives.read_too_early(robot),
        drives.time_offset(robot),
        *(environment.tracker_bumped(robot, at) for at in environment.STEPS),
    )


def refuse_unknown_mechanism(name: str, registry: Registry) -> StudyError:
    """Return the error of an unknown name: with the nearest one, or where all are listed."""
    hint = suggest(name.partition(":")[0], registry) or "`modelsel mechanisms` lists them."
    return StudyError(f'unknown mechanism "{name}". {hint}')


def build_mechanisms(
    name: str, robot: Robot, registry: Registry = BUILTIN
) -> tuple[Mechanism, ...]:
    """Build the mechanisms that a registered name stands for on this robot, one a joint and a
    constant where it has them.

    "backlash:3" is joint 3's alone; "gear-ripple:4:23" is one constant of a scanned one. Empty
    where the name does not apply to the robot. Raises StudyError for an unknown name or joint, and
    for an entry that builds none, or one that the robot cannot have."""
    check_type("registry", registry, Mapping, REGISTRY_EXPECTED)
    built = _build_named(name, robot, registry)
    for mechanism in built:
        problem = find_misbuilt(mechanism, robot)
        if problem is not None:
            raise StudyError(f'the registry\'s "{name}": {problem}.')
    return built


def find_misbuilt(mechanism: Any, robot: Robot) -> str | None:
    """Find what keeps a builder's result from acting on a robot, in words, if anything does."""
    if not isinstance(mechanism, Mechanism):
        found = describe_value(mechanism)
        return f"a Mechanism was expected (None where it does not apply), and {found} was built"
    last_frame = robot.n + 1
    for term in mechanism.terms:
        beyond = any(screw.frame > last_frame for screw in term.screws)
        if beyond or not (term.screws or term.fixture):
            return (
                f"{term.symbol} drives no screw, or one on a frame that {robot.name} does not have: "
                f"its frames are 1 to {last_frame}"
            )
    return None


def _build_named(name: str, robot: Robot, registry: Registry) -> tuple[Mechanism, ...]:
    """Build what a name stands for, as its entry builds it."""
    stem, *given = name.split(":")
    if stem not in registry:
        raise refuse_unknown_mechanism(name, registry)
    entry = registry[stem]
    if isinstance(entry, Scanned) and entry.targets is not None:
        return _build_of_targets(name, robot, entry, entry.targets)
    if isinstance(entry, PerTarget):
        return build_of_target(name, robot, entry)
    is_scanned = isinstance(entry, Scanned)
    has_joints = isinstance(entry, (PerJoint, Scanned)) and entry.joints is not None
    if len(given) > has_joints + is_scanned:
        parts = "no joint"
        if has_joints:
            parts = "a joint only"
        raise StudyError(f'"{name}": {stem} takes {parts}.')
    joint = None
    if given and has_joints:
        joint = given.pop(0)
    if isinstance(entry, PerJoint):
        joints = choose_entry_joints(name, joint, robot, entry.joints)
        return tuple(entry.build(robot, j) for j in joints)
    if isinstance(entry, Scanned):
        constant = None
        if given:
            constant = given[0]
        return _build_scanned(name, joint, constant, robot, entry)
    _check_function(stem, entry)
    built = entry(robot)
    if built is None:
        return ()
    return (built,)


def _build_of_targets(
    name: str, robot: Robot, entry: Scanned, targets: tuple[str, ...]
) -> tuple[Mechanism, ...]:
    """Build a scanned entry's mechanisms of all targets together, then of each by itself; or those
    that a name says. A target's name goes before a constant, and the longer name before another."""
    _, _, given = name.partition(":")
    numbers, constant = by_target.choose_targets(given, targets)
    if numbers:
        by_target.check_order(name, numbers, targets)
        steps = _build_scanned(name, None, constant or None, robot, entry)
        return by_target.limit_steps(steps, numbers, targets, entry.numbers)
    refused = by_target.refuse_target(name, given, targets)
    if given and refused is not None:
        raise refused
    try:
        together = _build_scanned(name, None, given or None, robot, entry)
    except StudyError as error:
        raise by_target.add_targets(error, targets) from None
    alone = () if given else by_target.limit_to_each(together, targets, entry.numbers)
    return (*together, *alone)


def _check_function(stem: str, entry: Any) -> None:
    """Refuse an entry of a registry that is no function. Raises StudyError."""
    if callable(entry):
        return
    found = name_type(entry)
    raise StudyError(
        f'the registry\'s "{stem}": a function robot -> Mechanism, PerJoint or Scanned was '
        f"expected, found {found}."
    )


def _build_scanned(
    name: str, joint: str | None, constant: str | None, robot: Robot, entry: Scanned
) -> tuple[Mechanism, ...]:
    """Build a scanned entry's mechanisms, of one constant or all. Raises StudyError for another."""
    places: list[tuple[int, ...]] = [()]
    if entry.joints is not None:
        joints = choose_entry_joints(name, joint, robot, entry.joints)
        places = [(j,) for j in joints]
    built = []
    for place in places:
        values = entry.constants(robot, *place)
        if constant is not None:
            every = dict.fromkeys((*values, *entry.more))
            values = tuple(value for value in every if f"{value:g}" == constant)
        for value in values:
            mechanism = entry.build(robot, *place, value)
            built.append(mechanism)
    if not built and constant is not None:
        stem, _, _ = name.partition(":")
        hint = ""
        if stem == "gear-ripple":
            hint = " Waves beyond them: [robot] gear_ratios = [121, …] in the study file."
        raise StudyError(f'"{name}": {constant} is not among the constants of {stem}.{hint}')
    return tuple(built)


def mechanism(name: str, robot: Robot | str, registry: Registry = BUILTIN) -> Mechanism:
    """Build one mechanism for a name: all its joints together where it has joints; of several constants or
    forms, the first; of the target's, that of all targets together. `robot`: the robot, or a built-in one's
    name. Raises StudyError where none applies."""
    check_type("name", name, str, "a mechanism's name")
    robot = as_robot(robot)
    first: dict[str, Mechanism] = {}
    for built in build_mechanisms(name, robot, registry):
        first.setdefault(built.name, built)
    if not first:
        raise StudyError(f'"{name}" does not apply to {robot.name}.')
    if name in first:
        return first[name]
    each = tuple(first.values())
    return join_mechanisms(name, each)


def join_mechanisms(name: str, each: Sequence[Mechanism]) -> Mechanism:
    """Join the mechanisms that a name stands for."""
    if len(each) == 1:
        return each[0]
    return Mechanism(
        name,
        tuple(term for m in each for term in m.terms),
        " ".join(m.sentence for m in each),
        "; ".join(m.equation for m in each),
        each[0].source,
        usual_causes=each[0].usual_causes,
    )


def every(robot: Robot | str, registry: Registry = BUILTIN) -> tuple[Mechanism, ...]:
    """Build every mechanism that applies to the robot, or to a built-in one by its name, one a joint
    and a constant where it has them."""
    robot = as_robot(robot)
    check_type("registry", registry, Mapping, REGISTRY_EXPECTED)
    return tuple(m for name in registry for m in build_mechanisms(name, robot, registry))


def with_plugins(
    registry: Registry = BUILTIN, robot: Robot | None = None
) -> tuple[Registry, dict[str, str]]:
    """Return the registry with every installed plug-in's entries, and what is wrong with those left out: what
    cannot be loaded, or built for `robot`, where one is given, and names that are taken."""
    from importlib.metadata import entry_points

    check_type("registry", registry, Mapping, REGISTRY_EXPECTED)
    table = dict(registry)
    broken: dict[str, str] = {}
    for point in sorted(entry_points(group="modelsel.mechanisms"), key=lambda point: point.name):
        try:
            offered = dict(point.load()())
        except Exception as error:  # noqa: BLE001  a stranger's code may fail in any way; it is listed and stops nothing
            broken[point.name] = one_line(f"{type(error).__name__}: {error}")
            continue
        for name, entry in offered.items():
            problem = None
            if name in table:
                problem = f'the name "{name}" is taken'
            elif robot is not None:
                problem = find_entry_problem(name, entry, robot)
            if problem is None:
                table[name] = entry
            else:
                broken[one_line(f"{point.name}, {name}")] = one_line(problem)
    return table, broken


def find_entry_problem(name: str, entry: Entry, robot: Robot) -> str | None:
    """Find what keeps a stranger's entry from being used on a robot, in words; None where it can be
    built and printed."""
    try:
        for built in build_mechanisms(name, robot, {name: entry}):
            problem = _find_mechanism_problem(name, built)
            if problem is not None:
                return problem
    except StudyError as error:
        return str(error)
    except Exception as error:  # noqa: BLE001  as above
        return f"{type(error).__name__}: {error}"
    return None


def _find_mechanism_problem(name: str, mechanism: Mechanism) -> str | None:
    if mechanism.stem != name:
        return f'it is registered as "{name}" and calls itself "{mechanism.name}"'
    for term in mechanism.terms:
        str((term.unit, *term.screws))  # raises for what cannot be printed
    return unstorable(mechanism)
