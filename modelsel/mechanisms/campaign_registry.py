"""The registry as a campaign has it: thermal effects counted from its temperature, the turns of the
robot's motors, its targets by their names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TypeGuard

from .._arguments import check_type
from ..robot.kinematics import Robot
from . import drives, environment
from .registry import BUILTIN, REGISTRY_EXPECTED, Entry, Registry, Scanned, build_thermal
from .target_entries import PerTarget
from .target_names import number_targets

TARGET_STEP = "target-step"


def set_reference(registry: Registry, reference: float, lags: Sequence[int] = ()) -> Registry:
    """Return the registry with modelsel's own thermal mechanisms counted from a reference [°C], and of a
    temperature that is late by some `lags` [min], too."""
    thermal = build_thermal(reference)
    if lags:
        thermal = {**thermal, **_build_late(reference, (0, *lags))}
    counted = dict(registry)
    for name, own in thermal.items():
        entry = registry.get(name)
        builtin = BUILTIN[name]
        if entry is builtin:
            counted[name] = own
        elif isinstance(entry, PerTarget) and _is_but_for_targets(entry, builtin):
            counted[name] = _name_targets(own, entry.targets or (), entry.numbers)
    return counted


def _is_but_for_targets(entry: PerTarget, builtin: Entry) -> bool:
    """Return whether an entry is modelsel's own but for the names of targets."""
    bare = replace(entry, targets=None, numbers=())
    return bare == builtin


def _name_targets(entry: Entry, targets: tuple[str, ...], numbers: tuple[int, ...]) -> Entry:
    """Return an entry that acts on the target with the names of several."""
    if is_of_targets(entry):
        return replace(entry, targets=targets, numbers=numbers)
    return entry


def _build_late(reference: float, lags: tuple[int, ...]) -> Registry:
    """Build the thermal mechanisms of a temperature that is late by any of some lags [min]."""
    growth = partial(environment.thermal_growth, reference=reference)
    expansion = partial(environment.late_expansion, reference=reference)
    zero = partial(environment.thermal_zero, reference=reference)
    shift = partial(environment.thermal_shift, reference=reference)
    list_lags = partial(_choose_lags, lags=lags)
    return {
        "thermal-growth": Scanned(growth, list_lags, environment.growing_links),
        "thermal-expansion": Scanned(expansion, partial(_choose_of_growing, lags=lags)),
        "thermal-zero": Scanned(zero, list_lags, drives.all_joints),
        # it takes the names of several targets
        "thermal-shift": Scanned(shift, list_lags, targets=()),
    }


def _choose_lags(*at: object, lags: tuple[int, ...]) -> tuple[int, ...]:
    """Choose the lags: the same for every joint of a robot."""
    return lags


def _choose_of_growing(robot: Robot, lags: tuple[int, ...]) -> tuple[int, ...]:
    """Choose the lags of an arm that lengthens; none where nothing of it can."""
    return lags if environment.thermal_expansion(robot) is not None else ()


def set_gear_ratios(registry: Registry, ratios: Sequence[float]) -> Registry:
    """Return the registry with gear ripple that is scanned at the turns of the motors, too; `ratios`:
    turns of the motor per turn of each joint, 0 where it is not known."""
    entry = registry.get("gear-ripple")
    is_own = entry is BUILTIN["gear-ripple"]
    if not is_own or not isinstance(entry, Scanned):
        return registry
    waves = partial(drives.list_waves, ratios=tuple(ratios))
    ripple = replace(entry, constants=waves)
    return {**registry, "gear-ripple": ripple}


def set_targets(registry: Registry, targets: Sequence[str], listed: Sequence[str] = ()) -> Registry:
    """Return the registry with modelsel's own step of the target, and whatever else acts on one, for
    each of several, too, by the names that the measurements give them; `listed`: those of the file, where some were left out.
    Raises ArgumentError for another type."""
    check_type("registry", registry, Mapping, REGISTRY_EXPECTED)
    names = tuple(targets)
    several = len(names) > 1 or len(listed) > 1
    if not several:
        names = ()
    numbers = number_targets(names, listed)
    named = dict(registry)
    for name, entry in registry.items():
        named[name] = _name_targets(entry, names, numbers)
    return named


def waits_for_targets(name: str, registry: Registry) -> bool:
    """Return whether a name may be of one target of several, before the measurements say how these
    are called."""
    stem, colon, _ = name.partition(":")
    if not colon:
        return False
    entry = registry.get(stem)
    return is_of_targets(entry) and entry.targets is None


def is_of_targets(entry: Entry | None) -> TypeGuard[Scanned | PerTarget]:
    """Return whether an entry is modelsel's own step of the target or one that acts on the target, with
    or without names."""
    if isinstance(entry, Scanned):
        return entry.build is environment.target_step or entry.targets is not None
    return isinstance(entry, PerTarget)
