"""Joints that seem not to repeat, but may have an error that repeats: told apart from the noise.

A noise floor that was estimated from what is left holds their parts, too. Where no posture is measured
again, an error of the model would look the same, so that it is not all noise."""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot, sqrt
from typing import NamedTuple

from ..exceptions import sentence_list, write_rounded
from ..fitting.error_structure import ErrorStructure
from ..fitting.noise import Floor
from .repeatability import ESTIMATED, JOINT, compute_target_rms, is_unsure
from .schema import ErrorPartRecord, StudyRecord

# factor by which what is left is clearly more with these joints than without
CLEARLY_MORE = 1.1


class UnsureJoints(NamedTuple):
    """The names of such joints, the rms [mm] at the target of their parts together, and of all others."""

    names: tuple[str, ...] = ()
    rms_mm: float = 0.0
    rest_mm: float = 0.0

    @property
    def matter(self) -> bool:
        """Whether what is left is clearly more with them."""
        return bool(self.names) and hypot(self.rms_mm, self.rest_mm) >= CLEARLY_MORE * self.rest_mm

    @property
    def words(self) -> str:
        """The joints, and what is not sure of them, to stand within a sentence."""
        if len(self.names) == 1:
            return f"{self.names[0]}, which may have an error that repeats,"
        numbers = sentence_list([name.removeprefix(f"{JOINT} ") for name in self.names])
        return f"joints {numbers}, which may have errors that repeat,"


def tell_unsure(errors: ErrorStructure, floor: Floor) -> UnsureJoints:
    """Tell the joints apart that a noise floor holds without being sure of them: none where it was not
    estimated from what is left."""
    if floor.source != ESTIMATED:
        return UnsureJoints()
    parts = [(part.name, part.told_by, part.at_target) for part in errors.parts]
    return _split(parts)


def _split(parts: Sequence[tuple[str, str, float]]) -> UnsureJoints:
    """Split parts (name, what tells it, rms at the target [mm])."""
    names = []
    unsure = 0.0
    rest = 0.0
    for name, told_by, rms in parts:
        if is_unsure(name, told_by):
            names.append(name)
            unsure += rms**2
        else:
            rest += rms**2
    return UnsureJoints(tuple(names), sqrt(unsure), sqrt(rest))


def describe_noise_floor(record: StudyRecord) -> str:
    """Return the noise floor with its source, without a full stop: where it holds joints that are not sure,
    what it is without them first."""
    floor = record.noise_floor
    whole = f"{write_rounded(floor.coordinate_mm)} mm per coordinate"
    unsure = _tell_recorded(record.repeatability)
    if floor.source != ESTIMATED or not unsure.matter:
        return f"{whole} ({floor.source})"
    alone = write_rounded(unsure.rest_mm / sqrt(3))
    return f"{alone} mm per coordinate ({floor.source}), and with {unsure.words} {whole}"


def _tell_recorded(parts: Sequence[ErrorPartRecord]) -> UnsureJoints:
    if not parts:
        return UnsureJoints()
    moved = compute_target_rms(parts).tolist()
    return _split([(own.part, own.told_by, rms) for own, rms in zip(parts, moved, strict=True)])
