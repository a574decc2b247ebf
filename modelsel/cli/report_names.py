"""Names that stand in reports and are in no registry: faults of the data, derived names, places with
their causes."""

from __future__ import annotations

import re

from ..diagnosis.faults.data_faults import EXCHANGES
from ..diagnosis.findings.name_legend import FRAME, describe_variable, explain_member, explain_names
from ..measurements.campaign.state_names import parse_state_name
from ..mechanisms.registry import build_faults
from ..mechanisms.terms import Mechanism
from ..robot.kinematics import Robot

# what a report adds to a name
ADDED = re.compile(r" \(\d+\)$| \(doubtful\)$| with the opposite sign$")


def bare_name(name: str) -> str:
    """Return a name without what a report adds to it: a number, a doubt, that its sign is opposite."""
    while (bare := ADDED.sub("", name)) != name:
        name = bare
    return name


def find_faults(name: str, robot: Robot) -> tuple[Mechanism, ...]:
    """Find the faults of the data of a name that act as screws, one a moment; none of other names."""
    return tuple(fault for fault in build_faults(robot) if fault.name == name)


def explain_unregistered(name: str, robot: Robot) -> list[str]:
    """Explain a name that no registry has, in lines; nothing of one that is unknown."""
    exchanges = {kind.label: words for kind, words in EXCHANGES.items()}
    if name in exchanges:
        return [f"{name}: A fault of the data: {exchanges[name]}."]
    variable = parse_state_name(name)
    if variable is not None and variable.exists(robot):
        unit = variable.unit(robot)
        bracket = "" if unit == "1" else f" [{unit}]"
        return [f"{name}: {describe_variable(variable)}{bracket}. Causes use this name."]
    member = explain_member(name)
    if member is not None:
        return [f"{member}. Causes use this name."]
    if name.startswith((FRAME, "free(")):
        return explain_names([name], robot.n)
    return []
