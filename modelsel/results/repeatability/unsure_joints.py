"""Joints that seem not to repeat, but may have an error that repeats: told apart from the noise.

A noise floor that was estimated from what is left holds their parts, too. Where no posture is measured
again, an error of the model would look the same, so that it is not all noise."""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot, sqrt
from typing import NamedTuple

from ...exceptions import sentence_list, write_rounded
from ...fitting.error_structure import ErrorStructure
from ...fitting.noise import Floor
from ..schemas.schema import ErrorPartRecord, StudyRecord
from .repeatability import ESTIMATED, JOINT, compute_target_rms, is_unsure

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
        rest = self.rest_mm
        least = CLEARLY_MORE * rest
        together = hypot(self.rms_mm, rest)
        is_more = together >= least
        return bool(self.names) and is_more

    @property
    def words(self) -> str:
        """The joints, and what is not sure of them, to stand within a sentence."""
        numbers = []
        for name in self.names:
            number = name.removeprefix(f"{JOINT} ")
            numbers.append(number)
        listed = sentence_list(numbers)
        if len(numbers) == 1:
            return f"{JOINT} {listed}, which may have an error that repeats,"
        return f"{JOINT}s {listed}, which may have errors that repeat,"


def tell_unsure(errors: ErrorStructure, floor: Floor) -> UnsureJoints:
    """Tell the joints apart that a noise floor holds without being sure of them: none where it was not
    estimated from what is left."""
    if floor.source != ESTIMATED:
        return UnsureJoints()
    parts = []
    for part in errors.parts:
        moved = part.name, part.told_by, part.at_target
        parts.append(moved)
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
    source = floor.source
    size = write_rounded(floor.coordinate_mm)
    whole = f"{size} mm per coordinate"
    unsure = _tell_recorded(record.repeatability)
    is_whole = source != ESTIMATED or not unsure.matter
    if is_whole:
        return f"{whole} ({source})"
    length = sqrt(3) * floor.coordinate_mm if floor.rms_mm is None else floor.rms_mm
    coordinate = floor.coordinate_mm * unsure.rest_mm / length
    alone = write_rounded(coordinate)
    return f"{alone} mm per coordinate ({source}), and with {unsure.words} {whole}"


def _tell_recorded(parts: Sequence[ErrorPartRecord]) -> UnsureJoints:
    if not parts:
        return UnsureJoints()
    moved = compute_target_rms(parts).tolist()
    recorded = []
    for own, rms in zip(parts, moved, strict=True):
        part = own.part, own.told_by, rms
        recorded.append(part)
    return _split(recorded)
