"""The effects that a study plants in simulated data, `[[simulate.effect]]`, as far as its robot and
their formulas tell what is wrong with them."""

from __future__ import annotations

from collections.abc import Mapping

from ..config.study_file import Study
from ..exceptions import StudyError
from ..mechanisms.cause_formulas import parse
from ..mechanisms.causes import Member
from ..robot.kinematics import Robot
from .own_causes import add_columns


class _AnyName(dict[str, str]):
    """Units of names of which none is unknown: columns of data that were not read may be any."""

    def __contains__(self, name: object) -> bool:
        return True

    def __missing__(self, name: str) -> str:
        return "1"


def name_effect(number: int) -> str:
    """Name the place of an effect in the study file, counted from 1."""
    return f"simulate.effect {number}"


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
