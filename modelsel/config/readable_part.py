"""What of a study file can be read where some of it cannot: the rest of its errors is found in
that."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

from ..exceptions import StudyError
from .study_file import Study
from .study_tables import SplitTable

Place = tuple[Any, ...]
# tables without which there is no study, and what stands for those that cannot be read
STAND_INS: dict[str, Any] = {
    "name": "study",
    "robot": {"name": "puma560", "register": True},
    "measurements": {"file": "none"},
}
# what stands for a wrong value whose presence says something of its table
PRESENT: dict[Place, Any] = {
    ("robot", "name"): "puma560",
    ("robot", "file"): "none",
    ("robot", "base"): "none",
    ("robot", "tip"): "none",
    ("robot", "tool_mm"): [0.0, 0.0, 0.0],
    ("robot", "tools_mm"): {"none": [0.0, 0.0, 0.0]},
    ("split", "estimation"): 1,
    ("split", "column"): "none",
}
# keys of [robot] that say which it is
ROBOT_KEYS = ("name", "file", "base", "tip")
# a harmless effect, whose values stand for wrong ones: the effects after it keep their numbers
HARMLESS_EFFECT = {"frame": 1, "axis": "tx", "cause": "1", "size": 0.0}
EFFECTS = "effect"
COVARIATES = "covariate"
MODEL = "model"


@dataclass(frozen=True)
class ReadablePart:
    """A study without what is wrong with its file; whether its robot, the name of its measurements
    file, and all that says how that is read, are the study file's own. `problems`: those of its
    tables that their wrong values have hidden."""

    study: Study
    problems: tuple[str, ...]
    has_robot: bool
    has_file: bool
    has_measurements: bool


def read_part(table: Mapping[str, Any]) -> ReadablePart | None:
    """Read what can be read of a study file's table; None where nothing can."""
    tables = deepcopy(dict(table))
    wrong: set[Place] = set()
    hidden: list[str] = []
    for name, value in STAND_INS.items():
        if name not in tables:
            wrong.add((name,))
            tables[name] = value
    first = True
    while True:
        try:
            study = Study(**tables)
            return _describe(study, wrong, hidden)
        except RecursionError:
            return None
        except StudyError as error:
            if not error.places:
                return None
            if not first:
                hidden += error.problems
            first = False
            before = repr(tables)
            for place in _order(error.places):
                wrong |= _mend(tables, place)
            # values are compared as they are written: true equals 1, and is no 1
            if repr(tables) == before:
                return None


def _describe(study: Study, wrong: set[Place], hidden: Sequence[str]) -> ReadablePart:
    """Describe what could be read, beside the places that could not."""
    has_robot = not any(("robot", key) in wrong for key in ROBOT_KEYS)
    measured = [place for place in wrong if place[:1] == ("measurements",)]
    has_file = not {("measurements",), ("measurements", "file")} & set(measured)
    if any(place[:1] == ("split",) for place in wrong):
        study = study.model_copy(update={"split": SplitTable()})
    return ReadablePart(
        study, tuple(hidden), has_robot and ("robot",) not in wrong, has_file, not measured
    )


def _order(places: Sequence[Place]) -> list[Place]:
    """Order places so that of one list the last comes first: what is left out there moves no other."""
    distinct = list(dict.fromkeys(places))
    return sorted(distinct, key=_sort_key, reverse=True)


def _sort_key(place: Place) -> tuple[tuple[int, str], ...]:
    return tuple((part, "") if isinstance(part, int) else (-1, str(part)) for part in place)


def _mend(tables: dict[str, Any], place: Place) -> set[Place]:
    """Take a wrong value out of the tables, in place; return what is left out, or replaced."""
    match place:
        case ("covariate", *numbers):
            _cut_covariates(tables, numbers)
        case (str(table), str(key), *_) if place[:2] in PRESENT and key in tables[table]:
            tables[table][key] = PRESENT[table, key]
            return {(table, key)}
        case ("simulate", "effect", int(number), *keys) if keys:
            _mend_effect(tables["simulate"][EFFECTS], number, str(keys[0]))
        case ("robot",) if _loosen_robot(tables["robot"]):
            pass
        case (_, *_):
            _remove(tables, place)
            return {place}
    return set()


def _remove(tables: dict[str, Any], place: Place) -> None:
    """Remove what is at a place; where nothing is, what should have it."""
    *above, last = place
    holder: Any = tables
    for key in above:
        holder = _get(holder, key)
    if _get(holder, last) is None and above:
        _remove(tables, tuple(above))
        return
    if isinstance(holder, (dict, list)):
        del holder[last]
    if last in STAND_INS and not above:
        tables[last] = STAND_INS[last]


def _get(holder: Any, key: Any) -> Any:
    """Return what a table or a list has at a key; None where it has nothing there."""
    if isinstance(holder, dict):
        return holder.get(key)
    is_index = isinstance(holder, list) and isinstance(key, int)
    return holder[key] if is_index and key < len(holder) else None


def _mend_effect(effects: list[Any], number: int, key: str) -> None:
    """Put a harmless value for a wrong one of an effect, or leave an unknown key out."""
    effect = effects[number]
    if not isinstance(effect, dict):
        effects[number] = dict(HARMLESS_EFFECT)
    elif key in HARMLESS_EFFECT:
        effect[key] = HARMLESS_EFFECT[key]
    else:
        effect.pop(key, None)


def _loosen_robot(robot: Any) -> bool:
    """Register a robot, in place, whose target is not told rightly; whether that can mend its
    table."""
    if not isinstance(robot, dict) or ("name" in robot) == ("file" in robot):
        return False
    before = dict(robot)
    for key in ("tool_mm", "tools_mm"):
        robot.pop(key, None)
    robot["register"] = True
    return robot != before


def _cut_covariates(tables: dict[str, Any], place: Sequence[Any]) -> None:
    """Leave out the study's own causes from the one at a place on, all where there is none, and
    their names where they are used."""
    causes = tables.get(COVARIATES)
    listed = causes if isinstance(causes, list) else [causes]
    first = place[0] if place else 0
    left_out = listed[first:]
    names = [cause.get("name") for cause in left_out if isinstance(cause, dict)]
    tables[COVARIATES] = listed[:first]
    model = tables.get(MODEL)
    if isinstance(model, dict):
        tables[MODEL] = {key: _without(value, names) for key, value in model.items()}


def _without(value: Any, names: Sequence[Any]) -> Any:
    """Return lists of names, or of lists of them, without some names."""
    if not isinstance(value, list):
        return value
    return [_without(item, names) for item in value if item not in names]
