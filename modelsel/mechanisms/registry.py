"""The table of mechanisms: explicit, passed as an argument, never changed by an import.

An entry is a function `robot -> Mechanism` (None where it does not apply), or PerJoint for one that
exists once a joint. Outsiders join by the entry point group `modelsel.mechanisms`: () -> dict of
entries (`with_plugins`)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

from ..exceptions import StudyError, one_line, suggest
from ..measurements.reference_temperature import REFERENCE
from ..robot.kinematics import Robot
from . import compliance, environment, geometry, gravity_effects
from . import drives as couplings
from . import drives as motion
from . import drives as transmission
from .terms import Mechanism, unstorable


@dataclass(frozen=True)
class PerJoint:
    """A mechanism that exists once a joint: `build(robot, joint)` for each of `joints(robot)`."""

    build: Callable[[Robot, int], Mechanism]
    joints: Callable[[Robot], tuple[int, ...]]


@dataclass(frozen=True)
class Scanned:
    """A mechanism with an inner constant (waves a turn, a moment in time, masses): `build(robot,
    joint, constant)`, or `build(robot, constant)` where `joints` is None; naming scans the
    constants and counts them all. `range`: between which real numbers the constant may lie where it
    is one; sampling then takes it as continuous."""

    build: Callable[..., Mechanism]
    constants: Callable[..., tuple[float, ...]]
    joints: Callable[[Robot], tuple[int, ...]] | None = None
    range: tuple[float, float] | None = None


Entry = Callable[[Robot], Mechanism | None] | PerJoint | Scanned
Registry = Mapping[str, Entry]


def build_thermal(reference: float = REFERENCE) -> Registry:
    """What temperature does, counted from the reference [°C]."""
    return {
        "thermal-growth": PerJoint(
            partial(environment.thermal_growth, reference=reference), environment.growing_links
        ),
        "thermal-expansion": partial(environment.thermal_expansion, reference=reference),
        "thermal-zero": PerJoint(
            partial(environment.thermal_zero, reference=reference), transmission.all_joints
        ),
    }


BUILTIN: Registry = {
    "geometric": geometry.geometric,
    "joint2-twist": gravity_effects.joint2_twist,
    "joint3-twist": gravity_effects.joint3_twist,
    "gravity-twist": gravity_effects.gravity_twist,
    "backlash": PerJoint(gravity_effects.backlash, gravity_effects.gravity_joints),
    "wrist-coupling": PerJoint(couplings.wrist_coupling, couplings.wrist_joints),
    "base-tilt": gravity_effects.base_tilt,
    "gear-eccentricity": PerJoint(transmission.gear_eccentricity, transmission.revolute_joints),
    "encoder-eccentricity": PerJoint(
        transmission.encoder_eccentricity, transmission.revolute_joints
    ),
    "encoder-scale": PerJoint(transmission.encoder_scale, transmission.all_joints),
    "gear-ripple": Scanned(
        transmission.gear_ripple,
        lambda robot, joint: transmission.WAVES,
        transmission.revolute_joints,
    ),
    "axis-wobble": Scanned(
        transmission.axis_wobble, lambda robot, joint: (1, 2), transmission.revolute_joints
    ),
    "joint-compliance": Scanned(
        compliance.joint_compliance, compliance.mass_choices, compliance.gravity_joints
    ),
    "lateral-compliance": PerJoint(compliance.lateral_compliance, compliance.gravity_joints),
    "link-bending": Scanned(
        compliance.link_bending, compliance.mass_choices_beyond, compliance.find_bending_links
    ),
    "payload-deflection": PerJoint(compliance.payload_deflection, compliance.gravity_joints),
    "payload-tilt": gravity_effects.payload_tilt,
    "counterbalance": compliance.counterbalance,
    "tool-droop": compliance.tool_droop,
    "approach-backlash": PerJoint(motion.approach_backlash, transmission.all_joints),
    "overshoot": PerJoint(motion.overshoot, transmission.all_joints),
    "settle": PerJoint(motion.settling, transmission.all_joints),
    **build_thermal(),
    "tracker-drift": Scanned(environment.tracker_drift, lambda robot: (1.0, 0.25, 0.1)),
    "tracker-step": Scanned(
        environment.tracker_step, lambda robot: environment.STEPS, range=(0.0, 1.0)
    ),
    "target-step": Scanned(
        environment.target_step, lambda robot: environment.STEPS, range=(0.0, 1.0)
    ),
    "tracker-scale": environment.tracker_scale,
    "refraction": environment.refraction,
}


def set_reference(registry: Registry, reference: float) -> Registry:
    """The registry with modelsel's own thermal mechanisms counted from a reference [°C]."""
    own = build_thermal(reference)
    return {
        name: own[name] if name in own and entry is BUILTIN[name] else entry
        for name, entry in registry.items()
    }


def build_faults(robot: Robot) -> tuple[Mechanism, ...]:
    """Faults of the data that act as screws; naming offers them beside the mechanisms, under
    `fault:` names."""
    return (
        motion.read_too_early(robot),
        *(environment.tracker_bumped(robot, at) for at in environment.STEPS),
    )


def build_mechanisms(
    name: str, robot: Robot, registry: Registry = BUILTIN
) -> tuple[Mechanism, ...]:
    """The mechanisms a registered name stands for on this robot, one a joint and a constant where
    it has them.

    "backlash:3" is joint 3's alone; "gear-ripple:4:23" is one constant of a scanned one. Empty
    where the name does not apply to the robot. Raises StudyError for an unknown name or joint."""
    stem, *given = name.split(":")
    if stem not in registry:
        raise StudyError(f'unknown mechanism "{name}". {suggest(stem, registry)}')
    entry = registry[stem]
    takes_joint = (
        isinstance(entry, PerJoint) or isinstance(entry, Scanned) and entry.joints is not None
    )
    if len(given) > takes_joint + isinstance(entry, Scanned):
        raise StudyError(f'"{name}": {stem} takes {"a joint only" if takes_joint else "no joint"}.')
    if isinstance(entry, (PerJoint, Scanned)) and entry.joints is not None:
        joints = entry.joints(robot)
        if given and given[0] not in map(str, joints):
            where = (
                f"no joint of {robot.name}"
                if not joints
                else f"joint{'s' * (len(joints) > 1)} {', '.join(map(str, joints))} of {robot.name}"
            )
            raise StudyError(f'"{name}": {stem} applies to {where}.')
        places: tuple[tuple[int, ...], ...] = tuple(
            (j,) for j in joints if not given or str(j) == given[0]
        )
    else:
        places = ((),)
    if isinstance(entry, Scanned):
        wanted = given[takes_joint] if len(given) > takes_joint else None
        out = tuple(
            entry.build(robot, *place, constant)
            for place in places
            for constant in entry.constants(robot, *place)
            if wanted is None or wanted == f"{constant:g}"
        )
        if wanted is not None and not out:
            raise StudyError(f'"{name}": {wanted} is not among the constants of {stem}.')
        return out
    if isinstance(entry, PerJoint):
        return tuple(entry.build(robot, j) for (j,) in places)
    built = entry(robot)
    return () if built is None else (built,)


def mechanism(name: str, robot: Robot, registry: Registry = BUILTIN) -> Mechanism:
    """One mechanism for a name: all its joints together where it has joints; of a scanned one
    without its constant, the first. Raises StudyError where none applies."""
    found = {m.name: m for m in reversed(build_mechanisms(name, robot, registry))}
    if not found:
        raise StudyError(f'"{name}" does not apply to {robot.name}.')
    each = tuple(reversed(found.values()))
    if len(each) == 1:
        return each[0]
    return Mechanism(
        name,
        tuple(t for part in each for t in part.terms),
        " ".join(p.sentence for p in each),
        "; ".join(p.equation for p in each),
        each[0].source,
    )


def every(robot: Robot, registry: Registry = BUILTIN) -> tuple[Mechanism, ...]:
    """Every mechanism that applies to the robot, one a joint and a constant where it has them."""
    return tuple(part for name in registry for part in build_mechanisms(name, robot, registry))


def with_plugins(
    registry: Registry = BUILTIN, robot: Robot | None = None
) -> tuple[Registry, dict[str, str]]:
    """The registry with every installed plug-in's entries, and what is wrong with those left out:
    plug-ins that cannot be loaded, names that are taken, and entries that cannot be built for
    `robot`, where one is given."""
    from importlib.metadata import entry_points

    table, broken = dict(registry), {}
    for point in sorted(entry_points(group="modelsel.mechanisms"), key=lambda p: p.name):
        try:
            offered = dict(point.load()())
        except Exception as error:  # noqa: BLE001  a stranger's code may fail in any way; it is listed and stops nothing
            broken[point.name] = one_line(f"{type(error).__name__}: {error}")
            continue
        for name, entry in offered.items():
            wrong = (
                f'the name "{name}" is taken'
                if name in table
                else None
                if robot is None
                else find_entry_problem(name, entry, robot)
            )
            if wrong is None:
                table[name] = entry
            else:
                broken[one_line(f"{point.name}, {name}")] = one_line(wrong)
    return table, broken


def find_entry_problem(name: str, entry: Entry, robot: Robot) -> str | None:
    """What keeps a stranger's entry from being used on a robot, in words; None where it can be
    built and printed."""
    try:
        for m in build_mechanisms(name, robot, {name: entry}):
            if m.name.partition(":")[0] != name:
                return f'it is registered as "{name}" and calls itself "{m.name}"'
            for t in m.terms:
                if not t.screws or any(s.frame > robot.n + 1 for s in t.screws):
                    return f"{t.symbol} drives no screw, or one on a frame that {robot.name} does not have"
                str((t.unit, *t.screws))
            if (why := unstorable(m)) is not None:
                return why
    except Exception as error:  # noqa: BLE001  as above
        return f"{type(error).__name__}: {error}"
    return None
