"""What stands beside a study's answer so that it is not taken for more: a list that was asked
alone, geometry that does harm."""

from __future__ import annotations

from collections.abc import Sequence

from ..exceptions import sentence_list
from ..notices import Note
from ..selection.evaluation import Gain


def of_those_asked(asked: Sequence[str] | str) -> str:
    """What a verdict adds where a study lets certain mechanisms extend the base and no others; else
    nothing."""
    if isinstance(asked, str) or not asked:
        return ""
    return f" Only {sentence_list(asked)} could be named: no other cause was considered."


def restricted(asked: Sequence[str] | str) -> tuple[Note, ...]:
    """The same as a warning."""
    if isinstance(asked, str) or not asked:
        return ()
    return (
        Note(
            "candidates-restricted",
            f"This study considers {sentence_list(asked)} and no other cause: their probabilities "
            "are relative to this list, and an error that has another cause may be named after one of them. "
            'candidates = "all" in the study file considers every registered mechanism and every cell of the error map.',
        ),
    )


def worse_than_nominal(base: Sequence[str], gain: Gain) -> tuple[Note, ...]:
    """A base model that errs more on held-out rows than the nominal arm does; `gain`: from the
    nominal arm to the base."""
    before, after = gain.held_out_rms_before_mm, gain.held_out_rms_after_mm
    if before is None or after is None or after <= before:
        return ()
    sure, interval = "", gain.interval_mm
    if interval is not None:
        sure = (
            f", worse by {-interval[1]:.3g} to {-interval[0]:.3g} mm (95 %)"
            if interval[1] < 0
            else ", a difference that chance may make"
        )
    return (
        Note(
            "base-worse-than-nominal",
            f"On the held-out configurations the fitted base model ({sentence_list(base)}) errs "
            f"by {after:.3g} mm rms where the nominal arm errs by {before:.3g}{sure}: the estimation configurations do not "
            "determine it well enough. Let more of them estimate; do not use the fitted parameters there.",
        ),
    )
