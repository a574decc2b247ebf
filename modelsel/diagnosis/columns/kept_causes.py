"""Values of causes that searches of the same rows share: they do not depend on what a row weighs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..._typing import Array
from ...fitting.problem import Problem
from ...mechanisms.causes import ARITHMETIC, Applied, Cause, Combined
from ...mechanisms.phasors import Phasors

# room for causes that come later, as a share of those that are there, and at least: memory that
# nothing is written to is not used
ROOM, LEAST_ROOM = 0.25, 64


@dataclass(frozen=True, eq=False)
class KeptCauses:
    """Causes in an order that stays, and their values at blocks of rows.

    A value never changes, so that arrays that were given out stay valid when causes are added."""

    _numbers: dict[Cause, int] = field(default_factory=dict, repr=False)
    _values: dict[tuple[int, int], tuple[Array, int]] = field(default_factory=dict, repr=False)

    def count_with(self, causes: Iterable[Cause]) -> int:
        """Count the causes that there would be with these."""
        every = {*self._numbers, *causes}
        return len(every)

    def add(self, causes: Iterable[Cause]) -> tuple[Cause, ...]:
        """Add causes, and return all."""
        numbers = self._numbers
        for cause in causes:
            numbers.setdefault(cause, len(numbers))
        return tuple(numbers)

    def count_mb(self) -> float:
        """Count the megabytes that the values take."""
        total = 0
        for values, count in self._values.values():
            known = values[:count]
            total += known.nbytes
        return total / 1e6

    def evaluate(self, problem: Problem, rows: slice) -> Array:
        """Return the values (u, m) of all causes at a block of the rows, those of `problem`."""
        causes = list(self._numbers)
        count = len(causes)
        key = rows.start, rows.stop
        if key not in self._values:
            empty = np.empty((0, len(problem)))
            self._values[key] = empty, 0
        values, known = self._values[key]
        if count > len(values):
            values = _make_room(values, count)
        new = causes[known:]
        evaluate_everywhere(problem, new, values[known:count])
        self._values[key] = values, count
        return values[:count]


def _make_room(values: Array, count: int) -> Array:
    """Copy values (u, m) where there is room for so many causes, and for some more."""
    share = int(ROOM * count)
    room = max(LEAST_ROOM, share)
    known, rows = values.shape
    shape = count + room, rows
    larger = np.empty(shape)
    larger[:known] = values
    return larger


def evaluate_everywhere(
    problem: Problem, causes: Sequence[Cause], out: Array | None = None
) -> Array:
    """Evaluate causes (u, m) at all rows, a function in several of them once, held until the last has
    it, and waves by their phasors; they are not kept by the problem, whose memory they would fill."""
    if out is None:
        shape = len(causes), len(problem)
        out = np.empty(shape)
    known: dict[Cause, Array | float] = {}
    phasors = Phasors(problem.state)
    combined = [list(_list_functions(cause)) for cause in causes]
    uses = Counter(function for functions in combined for function in functions)
    for row, cause, functions in zip(out, causes, combined, strict=True):
        row[:] = _evaluate(cause, phasors, known)
        for function in functions:
            uses[function] -= 1
            if not uses[function]:
                known.pop(function, None)
    return out


def _list_functions(cause: Cause) -> Iterator[Applied]:
    """List the functions that a cause combines, each as often as it stands there."""
    if isinstance(cause, Combined):
        yield from _list_functions(cause.left)
        yield from _list_functions(cause.right)
    elif isinstance(cause, Applied):
        yield cause


def _evaluate(cause: Cause, phasors: Phasors, known: dict[Cause, Array | float]) -> Array | float:
    """Evaluate a cause at all rows; values of functions are kept in `known`."""
    if isinstance(cause, Combined):
        left = _evaluate(cause.left, phasors, known)
        right = _evaluate(cause.right, phasors, known)
        operate = ARITHMETIC[cause.operator]
        value: Array | float = operate(left, right)
        return value
    if not isinstance(cause, Applied):
        return cause.of(phasors.state)
    if cause not in known:
        wave = phasors.evaluate(cause)
        known[cause] = cause.of(phasors.state) if wave is None else wave
    return known[cause]
