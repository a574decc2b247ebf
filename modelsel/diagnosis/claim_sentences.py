"""What a finding claims, in words: where something moves, with what, how, and why."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from ..mechanisms.causes import Bump
from ..mechanisms.terms import Mechanism
from .candidate_kinds import CandidateKind
from .credible_sets import CredibleSet
from .effects import Effect
from .sentences import (
    MOTIONS,
    describe_amount,
    describe_candidate,
    describe_effect,
    has_contrary_signs,
    list_cautions,
)
from .signatures import LEVELS, PROVEN
from .unlisted_shapes import list_drivers_of, list_parts_of
from .unregistered import Place

# what a name of the state stands for; {0} is its number
DRIVERS = {
    r"q(\d+)": "the reading of joint {0}",
    r"torque(\d+)(?:_\d+)?": "the gravity torque about joint {0}",
    r"approach(\d+)": "the side that joint {0} came from",
    r"move(\d+)": "the last move of joint {0}",
    r"progress|time_s": "the course of the campaign",
    r"payload_kg": "the payload",
    r"temperature_C": "the temperature",
    r"range_mm": "the distance from the instrument",
    r"[xyz]_mm": "the target's place",
    r"target": "the target",
    r"group": "the group",
}
# names of rivals that a place which is not proven is told with
NAMED_RIVALS = 3


class ClaimedLevel(NamedTuple):
    """One level of a finding: its name, its probability, and what it says."""

    level: str
    probability: float
    text: str


def describe_levels(effect: Effect) -> tuple[ClaimedLevel, ...]:
    """Describe what a finding says at every level; nothing of one that was not weighed."""
    claim = effect.claim
    if claim is None:
        return ()
    texts = (
        _describe_place(effect, claim.levels[0]),
        _describe_drivers(effect),
        _describe_shape(effect),
        _describe_cause(effect),
    )
    levels = zip(LEVELS, claim.levels, texts, strict=True)
    return tuple(ClaimedLevel(level, p, text) for level, p, text in levels)


def describe_claim(effect: Effect) -> ClaimedLevel | None:
    """Describe the deepest level that holds of a finding; None of one that was not weighed."""
    claim = effect.claim
    if claim is None:
        return None
    return describe_levels(effect)[LEVELS.index(claim.level)]


def describe_proven(effect: Effect, doubt: str = "") -> str:
    """Describe one finding in one sentence, as deep as it is proven.

    `doubt`, where there is one, stands beside its name."""
    claimed = describe_claim(effect)
    if claimed is None or _tells_as_much(effect, claimed):
        return describe_effect(effect, doubt)
    amount = describe_size(effect)
    standing = f"probability {claimed.probability:.2f}"
    if doubt:
        standing = f"{standing}, {doubt}"
    parts = [f"{claimed.text} ({amount}{standing})"]
    if effect.candidate.kind is not CandidateKind.SHAPE:
        parts.append(_describe_entries(effect.named))
    return "; ".join([*parts, *list_cautions(effect)]) + "."


def describe_what(effect: Effect) -> str:
    """Describe what a finding says of the arm, without its size, as deep as it is proven."""
    claimed = describe_claim(effect)
    if claimed is None or _tells_as_much(effect, claimed):
        return describe_candidate(effect.candidate, effect.estimate)
    return claimed.text


def describe_size(effect: Effect) -> str:
    """Describe the size of an effect, where a few numbers do: "peak to peak 0.4 mrad, "."""
    mechanism = effect.candidate.mechanism
    causes = [term.screws[0].cause for term in mechanism.terms]
    if effect.candidate.kind is CandidateKind.SHAPE and not all(
        isinstance(c, Bump) for c in causes
    ):
        return ""
    return f"{describe_amount(mechanism.terms, effect.estimate, effect.standard_error)}, "


def _tells_as_much(effect: Effect, claimed: ClaimedLevel) -> bool:
    """Whether the sentence of the named candidate says no more than is proven, or as much as can be
    where not even the place is."""
    if claimed.level == "cause" or claimed.probability < PROVEN:
        return True
    if claimed.level == "drivers":
        return effect.candidate.kind is CandidateKind.FREE_FUNCTION
    is_contrary = has_contrary_signs(effect.candidate.mechanism, effect.estimate)
    return claimed.level == "shape" and (is_contrary or not effect.candidate.registered)


def _join(words: Sequence[str]) -> str:
    """Join words: "a", "a and b", "a, b and c"."""
    *others, last = words
    return f"{', '.join(others)} and {last}" if others else last


def name_drivers(names: Iterable[str]) -> str:
    """Name what something depends on, in words."""
    words = dict.fromkeys(_name_driver(name) for name in sorted(names))
    return _join(list(words)) if words else ""


def _name_driver(name: str) -> str:
    for pattern, words in DRIVERS.items():
        found = re.fullmatch(pattern, name)
        if found:
            return words.format(*found.groups())
    return name


def name_places(mechanism: Mechanism) -> str:
    """Name what moves, in words: "Joint 3 is off its reading", "Frame 5 shifts along its y axis"."""
    parts = list_parts_of(mechanism)
    if len(parts) == 1:
        (place,) = parts
        return _name_motion(place, is_own=f"q{place[0]}" in parts[place])
    frames = [str(frame) for frame in sorted({frame for frame, _ in parts})]
    if len(frames) == 1:
        return f"Frame {frames[0]} moves"
    return f"Frames {_join(frames)} move"


def _name_motion(place: Place, is_own: bool) -> str:
    frame, axis = place
    is_slide = axis == "tz" and is_own
    if axis == "rz" or is_slide:
        return f"Joint {frame} is off its reading"
    return f"Frame {frame} {MOTIONS[axis[0]]} its {axis[1]} axis"


def _describe_place(effect: Effect, probability: float) -> str:
    where = name_places(effect.candidate.mechanism)
    if probability >= PROVEN:
        return f"{where}; on what this depends is not proven"
    return f"What moves is not proven: {_list_entries(effect.named)}"


def _describe_entries(named: CredibleSet) -> str:
    """Describe what a finding could be, and whether that would do the same."""
    text = f"it could be {_list_entries(named)}"
    labels = dict.fromkeys(entry.candidate.label for entry in named.entries if entry.alike)
    alike = list(labels)[:NAMED_RIVALS]
    if len(alike) > 1:
        text += f"; {_join(alike)} would move the target in the same way"
    return text


def _list_entries(named: CredibleSet) -> str:
    listed: dict[str, float] = {}
    for entry in named.entries:
        listed[entry.candidate.label] = listed.get(entry.candidate.label, 0.0) + entry.probability
    words = [f"{label} ({p:.2f})" for label, p in list(listed.items())[:NAMED_RIVALS]]
    return " or ".join(words)


def _describe_drivers(effect: Effect) -> str:
    mechanism = effect.candidate.mechanism
    drivers = name_drivers(list_drivers_of(mechanism))
    if not drivers:
        return f"{name_places(mechanism)} by a constant amount"
    shape = "how is not proven"
    if effect.candidate.kind is CandidateKind.SHAPE:
        shape = "no registered mechanism describes how"
    return f"{name_places(mechanism)}, depending on {drivers}; {shape}"


def _describe_shape(effect: Effect) -> str:
    mechanism = effect.candidate.mechanism
    causes = effect.candidate.causes(" and ")
    if effect.candidate.kind is CandidateKind.FREE_FUNCTION:
        return f"{name_places(mechanism)} by a free function of its own angle"
    return f"{name_places(mechanism)} with {causes}"


def _describe_cause(effect: Effect) -> str:
    if not effect.candidate.registered:
        return "No registered mechanism describes this"
    return describe_candidate(effect.candidate, effect.estimate)
