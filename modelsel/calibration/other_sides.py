"""Errors of the arm that may as well be the instrument's, and the reverse.

A scale error of a tracker may move every measured point of a campaign as a scale error of a slide does.
One of the two is fitted; only the arm's is corrected. Commands have to reckon with the other."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

from ..exceptions import write_rounded
from ..mechanisms.instrument import MISREADINGS
from ..mechanisms.terms import Mechanism

if TYPE_CHECKING:
    from .calibration import Calibration


class OtherSide(NamedTuple):
    """What may be true in the place of a mechanism that is fitted: an error of the instrument in the
    place of one of the arm, or the reverse.

    `label`: its most probable explanation; `share`: its probability, among all that move the target
    alike; `instrument` and `estimate`: the instrument's error of both, and its numbers, by which commands
    of both sides differ; `rms_mm`: its size at the rows that were fitted (rms)."""

    label: str
    share: float
    rms_mm: float
    instrument: Mechanism
    estimate: tuple[float, ...]


def is_misreading(mechanism: Mechanism) -> bool:
    """Return whether a mechanism is an error of the instrument."""
    return mechanism.stem in MISREADINGS


def describe_other_sides(c: Calibration) -> Iterator[str]:
    """Describe what is corrected, or is not, and may be an error of the other side."""
    for one in c.model.mechanisms:
        other = c.other_sides.get(one.name)
        if other is not None:
            yield _describe_other_side(one, other)


def _describe_other_side(one: Mechanism, other: OtherSide) -> str:
    own, opposite = "of the arm and so corrected", "instrument"
    if is_misreading(one):
        own, opposite = "of the instrument and so not corrected", "arm"
    size = write_rounded(other.rms_mm, 2)
    return (
        f"{one.name}, an error {own}, may as well be {other.label}, an error of the {opposite} "
        f"(probability {other.share:.2f}): then the calibrated arm is {size} mm rms off, "
        "which this instrument does not show. A length that is known from elsewhere tells which."
    )
