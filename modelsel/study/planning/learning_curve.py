"""How many more configurations a study needs to find smaller effects."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...calibration.experiment_design import count_more_needed
from ...exceptions import count_words, write_rounded

if TYPE_CHECKING:
    from .planning import MeasurementPlan

LEARNING_SIZES = (2.0, 1.0, 0.5, 0.25)  # of the detection limit


def estimate_learning(limit_mm: float | None, configurations: int) -> tuple[tuple[float, int], ...]:
    """Return (size [mm rms], further configurations needed to find an effect of it)."""
    if limit_mm is None:
        return ()
    learning = []
    for share in LEARNING_SIZES:
        size = share * limit_mm
        more = count_more_needed(limit_mm, configurations, size)
        learning.append((size, more))
    return tuple(learning)


def format_learning(plan: MeasurementPlan) -> str:
    """Return the learning curve in words."""
    sizes = [
        f"of {write_rounded(size)} mm rms after {more:,} more"
        for size, more in plan.learning
        if more
    ]
    estimate = f"{plan.configurations:,} of {plan.measured:,} measured configurations estimate"
    return (
        f"To find smaller effects: {estimate} now; with 90 % probability an effect is found "
        f"{', '.join(sizes)} that estimate."
    )


def describe_size(plan: MeasurementPlan, size: float, more: int) -> str:
    """Say after how many more configurations that estimate an effect of a size [mm rms] is found."""
    when = "in what is measured already"
    if more:
        total = -(-more * plan.measured // plan.configurations)
        counted = count_words(more, "more configuration")
        when = f"after {counted} that estimate"
        if total > more:
            when += f", of {total:,} in all where the split stays in proportion"
    return f"An effect of {size:g} mm rms beyond the model is found with 90 % probability {when}."
