"""Names of single targets in names of mechanisms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ..exceptions import StudyError, sentence_list
from .moved_targets import JOINED, limit_to_targets
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


def choose_targets(given: str, targets: Sequence[str]) -> tuple[tuple[int, ...], str]:
    """Choose the targets that `given` names, one or several that move alike, and what follows: the
    constant, if any. None where it names none."""
    known: dict[int, tuple[tuple[int, ...], str]] = {}
    starts = _list_starts(given)
    starts.reverse()
    for start in starts:
        known[start] = _choose_from(start, given, targets, known)
    return known[0]


def _list_starts(given: str) -> list[int]:
    """List where the name of a target may begin."""
    starts = [0]
    place = given.find(JOINED)
    while place >= 0:
        start = place + len(JOINED)
        starts.append(start)
        place = given.find(JOINED, place + 1)
    return starts


def _choose_from(
    start: int, given: str, targets: Sequence[str], known: Mapping[int, tuple[tuple[int, ...], str]]
) -> tuple[tuple[int, ...], str]:
    """Choose the targets that `given` names from one place on; `known`: those from later places on."""
    left = given[start:]
    number = choose_target(left, targets)
    if number is not None:
        constant = left[len(targets[number]) + 1 :]
        return (number,), constant
    for number, target in enumerate(targets):
        first = f"{target}{JOINED}"
        if not left.startswith(first):
            continue
        after = start + len(first)
        others, constant = known[after]
        is_new = number not in others
        if others and is_new:
            return (number, *others), constant
    return (), left


def check_order(name: str, places: Sequence[int], targets: Sequence[str]) -> None:
    """Check that targets which move alike stand in the order of their file, so that one step has one
    name. Raises StudyError with the right name."""
    ordered = sorted(places)
    if list(places) == ordered:
        return
    written = JOINED.join(targets[place] for place in places)
    right = JOINED.join(targets[place] for place in ordered)
    expected = name.replace(written, right, 1)
    raise StudyError(f'"{name}": targets stand in the order of the file, as in "{expected}".')


def limit_steps(
    steps: Sequence[Mechanism],
    places: Sequence[int],
    targets: Sequence[str],
    numbers: Sequence[int],
) -> tuple[Mechanism, ...]:
    """Limit steps of the targets to some of several (0-based), which they move alike, by their names
    and numbers."""
    named = {place: targets[place] for place in sorted(places)}
    return tuple(limit_to_targets(step, named, numbers) for step in steps)


def limit_to_each(
    steps: Sequence[Mechanism], targets: Sequence[str], numbers: Sequence[int]
) -> tuple[Mechanism, ...]:
    """Limit steps of the targets to every one of several by itself; none of one alone."""
    alone: list[Mechanism] = []
    count = len(targets)
    if count > 1:
        for place in range(count):
            alone += limit_steps(steps, [place], targets, numbers)
    return tuple(alone)


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
