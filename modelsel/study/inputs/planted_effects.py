"""The effects that a study plants in simulated data, `[[simulate.effect]]`, as far as its robot and
their formulas tell what is wrong with them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from ...config.study_file import Study
from ...exceptions import StudyError
from ...measurements.campaign.state_names import StateKind, StateVariable, parse_state_name
from ...measurements.measurements import Measurements
from ...mechanisms.cause_formulas import parse
from ...mechanisms.causes import Member
from ...robot.kinematics import Robot
from ..preparation.own_causes import add_columns


class _AnyName(dict[str, str]):
    """Units of names of which none is unknown: columns of data that were not read may be any."""

    def __contains__(self, name: object) -> bool:
        return True

    def __missing__(self, name: str) -> str:
        return "1"


def name_effect(number: int) -> str:
    """Name the place of an effect in the study file, counted from 1."""
    return f"simulate.effect.{number}"


def list_frame_problems(study: Study, robot: Robot) -> list[str]:
    """List the effects whose frame the robot does not have."""
    last_frame = robot.n + 1
    numbered_effects = enumerate(study.simulate.effect, 1)
    return [
        f"{name_effect(number)}: frame {effect.frame}, but {robot.name} has frames 1 to {last_frame}."
        for number, effect in numbered_effects
        if effect.frame > last_frame
    ]


def list_formula_problems(study: Study) -> list[str]:
    """List the effects whose cause is no formula; whether its names are known, data tell."""
    return list_cause_problems(study, _AnyName())


def list_name_problems(
    study: Study, units: Mapping[str, str], members: Mapping[str, Member], columns: str
) -> list[str]:
    """List the names in the effects' causes that are not among the known ones, `units` and
    `members`, with a sentence on the `columns` that there are."""
    malformed = list_formula_problems(study)
    problems = tell_cause_problems(study, units, members, columns)
    return [problem for problem in problems if problem not in malformed]


def tell_cause_problems(
    study: Study, units: Mapping[str, str], members: Mapping[str, Member], columns: str
) -> list[str]:
    """List what is wrong with the effects' causes, effect by effect; the last unknown name with a
    sentence on the `columns` that there are."""
    malformed = list_formula_problems(study)
    problems = list_cause_problems(study, units, members)
    unknown = [k for k, problem in enumerate(problems) if problem not in malformed]
    if unknown:
        last = unknown[-1]
        until = last + 1
        own = problems[last:until]
        problems[last:until] = add_columns(own, columns)
    return problems


def list_cause_problems(
    study: Study, units: Mapping[str, str], members: Mapping[str, Member] | None = None
) -> list[str]:
    """List what is wrong with the effects' causes, effect by effect, where the known names are
    `units`, and those of single targets and groups `members`."""
    problems: list[str] = []
    for number, effect in enumerate(study.simulate.effect, 1):
        try:
            parse(effect.cause, units, name_effect(number), members)
        except StudyError as error:
            problems += error.problems
    return problems


def list_motion_problems(
    study: Study, units: Mapping[str, str], members: Mapping[str, Member], data: Measurements
) -> list[str]:
    """List the names in the effects' causes that tell of a motion of which the measurements say
    nothing, and whose effect would be nothing."""
    problems: list[str] = []
    for number, effect in enumerate(study.simulate.effect, 1):
        place = name_effect(number)
        try:
            cause = parse(effect.cause, units, place, members)
        except StudyError:
            # told with the formulas
            continue
        names = sorted(cause.names())
        for name in names:
            problems += _tell_unknown_motion(place, name, data)
    return problems


def _tell_unknown_motion(place: str, name: str, data: Measurements) -> Iterator[str]:
    """Tell that a name's values follow from a motion that is not known."""
    variable = parse_state_name(name)
    if variable is None or name in data.covariates:
        return
    joint = variable.joint
    if variable.kind is StateKind.DRAG and data.path is None:
        yield (
            f'{place}: "{name}" is not known: the approach columns are not those of the order of the '
            f"rows, so nobody knows which way joint {joint} went. Leave these columns out if the arm "
            "goes straight from row to row."
        )
    if variable.kind is StateKind.RATE and data.rate is None:
        yield (
            f'{place}: "{name}" is not known: without a column time_s nobody knows how fast joint '
            f"{joint} moves. Give measurements that have it."
        )
    if _lacks_history(variable, data):
        yield (
            f'{place}: "{name}" is not known: without a column time_s nobody knows what went before a row. '
            "Give measurements that have it."
        )


def _lacks_history(variable: StateVariable, data: Measurements) -> bool:
    """Return whether a variable follows from the rows before by a clock that there is not."""
    if variable.kind is StateKind.SINCE_REST:
        return data.since_rest is None
    return variable.kind is StateKind.LATE and data.late_temperature is None
