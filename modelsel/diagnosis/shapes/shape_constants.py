"""Constants of a found shape: how many waves it has a turn, in what time it settles."""

from __future__ import annotations

from ...mechanisms.causes import Named
from ...mechanisms.terms import Mechanism
from ...mechanisms.waves import read_wave
from .cause_words import find_constant_of


def find_own_wave(found: Mechanism) -> tuple[int, float]:
    """Find the joint of whose own reading a finding is a wave, and how many it has a turn (in 2π mm of
    a slide): 0 where it is none."""
    places = list(found.names_by_place())
    joint, _ = places[0]
    if len(places) > 1 or found.names() != {f"q{joint}"}:
        return joint, 0
    counts = []
    for term in found.terms:
        (screw,) = term.screws
        wave = read_wave(screw.cause)
        if wave is None or not isinstance(wave.angle, Named):
            return joint, 0
        counts.append(wave.count)
    return joint, min(counts)


def find_time_constant(mechanism: Mechanism) -> float | None:
    """Find the time constant of a warm-up of one place; None of anything else."""
    if len(mechanism.terms) != 1 or len(mechanism.terms[0].screws) != 1:
        return None
    found = find_constant_of(mechanism.terms[0].screws[0].cause)
    if found is None:
        return None
    _, constant = found
    return constant
