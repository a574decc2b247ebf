"""Repeats that tell what does not repeat: which planned configurations to measure again, and how often."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..._typing import Array
from ...fitting.possible_parts import MIN_EXCESS

# postures that are measured again at most, and how often each is measured at least
MAX_POSTURES = 10
TIMES = 3
# of a column's size: one that varies by less stands still
STILL = 1e-9


@dataclass(frozen=True)
class RepeatPlan:
    """Configurations of a plan to measure again: `numbers`, from 0, of those in the plan; `times`
    that each is measured in all, in separate rounds; `freedom`: degrees of freedom of what a joint
    does not repeat that these rounds add to the `before` of the study."""

    numbers: tuple[int, ...]
    times: int
    before: int

    @property
    def freedom(self) -> int:
        """Degrees of freedom with those of the study."""
        return self.before + len(self.numbers) * (self.times - 1)

    @property
    def precision(self) -> float:
        """Relative standard error of a standard deviation of so many degrees of freedom."""
        return float(1 / np.sqrt(2 * self.freedom))


def plan_repeats(q: Array, places: Array, before: int, times: int | None = None) -> RepeatPlan:
    """Plan which of the configurations q (k, n) [rad, mm] to measure again, spread over joints and
    over the places (k, 3) [mm] of their targets.

    `before`: repeats that there are; `times`: how often each is measured (None: TIMES, and more
    where few are planned)."""
    numbers = _spread_out(np.hstack([_standardise(q), _standardise(places)]))
    least = -(-MIN_EXCESS // len(numbers)) + 1
    return RepeatPlan(tuple(numbers), times or max(TIMES, least), before)


def _standardise(values: Array) -> Array:
    """Return columns (k, c) in their standard deviations, those that do not vary as zeros."""
    away = values - values.mean(0)
    spread = away.std(0)
    varies = spread > STILL * np.abs(values).max(0)
    return np.where(varies, away / np.where(varies, spread, 1.0), 0.0)


def _spread_out(points: Array) -> list[int]:
    """Choose numbers of points (k, c) far from one another: the outermost, then ever the farthest
    from those that are chosen."""
    apart = np.linalg.norm(points[:, None] - points[None], axis=2)
    chosen = [int(np.argmax(np.linalg.norm(points, axis=1)))]
    while len(chosen) < min(MAX_POSTURES, len(points)):
        nearest = apart[:, chosen].min(1)
        nearest[chosen] = -1.0
        chosen.append(int(np.argmax(nearest)))
    return sorted(chosen)


def add_rounds(
    table: Mapping[str, Array], repeats: RepeatPlan, rng: np.random.Generator
) -> dict[str, Array]:
    """Add the rounds to the columns of a plan's table, each in an order of its own that `rng`
    draws, each visit with a `configuration` of its own."""
    count = len(next(iter(table.values())))
    rows = list(range(count))
    for _ in range(repeats.times - 1):
        order = rng.permutation(repeats.numbers)
        if order[0] == rows[-1]:
            # the arm would not have moved in between
            order = np.roll(order, 1)
        rows += order.tolist()
    columns = {name: values[rows] for name, values in table.items()}
    return columns | {"configuration": np.asarray(range(1, len(rows) + 1))}


def format_repeats(repeats: RepeatPlan) -> str:
    """Return in words which configurations to measure again, and what that tells."""
    numbers = ", ".join(str(number + 1) for number in repeats.numbers)
    own = f", {repeats.before:,} of them the study's" if repeats.before else ""
    percent = 100 * repeats.precision
    return (
        f"Repeats: configurations {numbers} of these, each measured {repeats.times} times in "
        "separate rounds, tell what a joint does not repeat, at best to "
        f"{percent:.0f} % of it (one standard error; {repeats.freedom:,} degrees of "
        f"freedom{own})."
    )
