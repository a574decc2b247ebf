"""Names of single targets in names of mechanisms."""

from __future__ import annotations

from collections.abc import Sequence

from ..exceptions import StudyError, sentence_list
from .environment import limit_to_target
from .terms import Mechanism


def choose_target(given: str, targets: Sequence[str]) -> int | None:
    """Choose the target that `given` names, alone or before a constant; of several that do, the one
    with the longest name. None where none does."""
    numbers = []
    for number, target in enumerate(targets):
        is_named = given == target or given.startswith(f"{target}:")
        if is_named:
            numbers.append(number)
    return max(numbers, key=lambda number: len(targets[number]), default=None)


def number_targets(targets: Sequence[str], listed: Sequence[str] = ()) -> tuple[int, ...]:
    """Number targets from 1 as their file does, which has `listed` more where some were left out."""
    order = list(listed or targets)
    return tuple(order.index(target) + 1 for target in targets)


def limit_steps(
    steps: Sequence[Mechanism], place: int, targets: Sequence[str], numbers: Sequence[int]
) -> tuple[Mechanism, ...]:
    """Limit steps of the targets to one of several (0-based), by its name and number."""
    name, number = targets[place], numbers[place]
    return tuple(limit_to_target(step, place, name, number) for step in steps)


def refuse_target(name: str, given: str, targets: Sequence[str]) -> StudyError | None:
    """Return the error of a mechanism of a target that there is not; None where a number is given,
    which may be a constant."""
    try:
        float(given)
    except ValueError:
        there = "there is only one target"
        if len(targets) > 1:
            there = f"the targets are {sentence_list(targets)}"
        return StudyError(f'"{name}": in the measurements {there}.')
    return None


def add_targets(error: StudyError, targets: Sequence[str]) -> StudyError:
    """Add to the error of a constant the targets that might have been meant, where there are several."""
    if len(targets) < 2:
        return error
    listed = sentence_list(targets)
    return StudyError(f"{error} In the measurements the targets are {listed}.")
