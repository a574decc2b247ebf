"""What a finding claims, in words: where something moves, with what, how, and why."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from ...exceptions import choice_list, sentence_list
from ...measurements.campaign.state_names import is_where_target_is
from ...mechanisms.causes import Bump
from ...mechanisms.terms import describe_frame_motion
from ..candidates.signatures import LEVELS, PROVEN
from ..inference.credible_sets import FOUND
from ..shapes.candidate_kinds import CandidateKind
from ..shapes.cause_words import append_cause, name_driver
from .effect_sentences import describe_effect, list_cautions
from .effects import Effect
from .rival_names import NAMED_RIVALS
from .sentences import (
    describe_amount,
    describe_cause,
    has_contrary_signs,
    name_alike,
    name_joint,
    sum_of_name,
    weigh_listed,
)
from .stated_probability import format_probability

# causes that a shape is told with; a mechanism that has more is told by its name
MOST_DRIVERS = 6
# what all errors of an instrument say that follow from where the target is
SEEN_WRONGLY = "The instrument measures wrongly, by an amount that depends on where the target is"
# kinds whose coefficients say little one by one
WITHOUT_SIZE = (CandidateKind.SHAPE, CandidateKind.DISTORTION)
# kinds whose own sentences say what they move, and with what
TOLD_IN_FULL = (CandidateKind.TARGET_CELL, CandidateKind.TARGET_SHIFT, CandidateKind.MOVED_LINK)
# what else a finding could be that is proven down to a level
REST = {
    "place": "something else there",
    "drivers": "another function of these",
    "shape": "another cause of this shape",
    "cause": "another cause",
}
# probability of what is not named beside them, above which that is said
MOST = 0.5
SOMETHING_ELSE = "something else"


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


def is_settled(effect: Effect) -> bool:
    """Whether the data settle an effect's name: its entries hold together, and so does the level that
    the name says, which is the shape where no mechanism is named."""
    if effect.named.verdict != FOUND:
        return False
    if effect.claim is None:
        return True
    level = LEVELS.index("shape" if claims_shape(effect) else "cause")
    return effect.claim.levels[level] >= PROVEN


def claims_shape(effect: Effect) -> bool:
    """Whether an effect claims a shape at most, since no registered mechanism describes it."""
    candidate = effect.candidate
    if not candidate.registered:
        return True
    mechanism = candidate.mechanism
    return has_contrary_signs(mechanism, effect.estimate)


def list_likelier(effect: Effect) -> list[str]:
    """List the labels that are likelier than that of the effect, the likeliest first."""
    weights = effect.named.sum_by_label()
    own = sum_of_name(effect)
    likelier = [label for label, weight in weights.items() if weight > own]
    return sorted(likelier, key=lambda label: -weights[label])


def describe_proven(effect: Effect, doubt: str = "") -> str:
    """Describe one finding in one sentence, as deep as it is proven.

    `doubt`, where there is one, stands beside its name."""
    claimed = _find_shorter_claim(effect)
    if claimed is None:
        return describe_effect(effect, doubt)
    probability = claimed.probability
    written = format_probability(probability)
    of = f"probability {written} for the {claimed.level}"
    sizes = _list_sizes(effect)
    listed = ", ".join([*sizes, of])
    what = f"{claimed.text} ({listed})"
    if doubt:
        what += f", {doubt}"
    parts = [what]
    kind = effect.candidate.kind
    is_listed = probability < PROVEN
    if kind is not CandidateKind.SHAPE and not is_listed:
        parts.append(_describe_entries(effect))
    cautions = list_cautions(effect)
    return "; ".join([*parts, *cautions]) + "."


def describe_what(effect: Effect) -> str:
    """Describe what a finding says of the arm, without its size, as deep as it is proven."""
    claimed = _find_shorter_claim(effect)
    if claimed is None:
        return describe_cause(effect, name_joint(effect))
    return claimed.text


def _find_shorter_claim(effect: Effect) -> ClaimedLevel | None:
    """Find the claim of a finding of which the candidate's own sentence would say more; None where
    that says as much."""
    claimed = describe_claim(effect)
    if claimed is None or claimed.level == "cause":
        return None
    if claimed.probability < PROVEN:
        return claimed
    candidate = effect.candidate
    is_contrary = has_contrary_signs(candidate.mechanism, effect.estimate)
    is_told = {
        "place": False,
        "drivers": candidate.kind is CandidateKind.FREE_FUNCTION,
        "shape": is_contrary or not candidate.registered,
    }
    return None if is_told[claimed.level] else claimed


def _list_sizes(effect: Effect) -> list[str]:
    """List the size of an effect, where a few numbers do."""
    mechanism = effect.candidate.mechanism
    causes = [term.screws[0].cause for term in mechanism.terms]
    is_plain = all(isinstance(cause, Bump) for cause in causes)
    if effect.candidate.kind in WITHOUT_SIZE and not is_plain:
        return []
    amount = describe_amount(mechanism.terms, effect.estimate, effect.standard_error)
    if list_likelier(effect):
        # the size is of the name that is fitted, and another one comes first
        amount = f"fitted as {effect.label}: {amount}"
    return [amount]


def name_drivers(names: Iterable[str]) -> str:
    """Name what something depends on, in words; nothing where that is nothing."""
    words = list(dict.fromkeys(name_driver(name) for name in sorted(names)))
    return sentence_list(words) if words else ""


def name_places(effect: Effect) -> str:
    """Name what moves, in words: "Joint 3 is off its reading", "Frame 5 shifts along its y axis"."""
    places = list(_find_acts(effect))
    if effect.claim is not None and effect.claim.moves_joints:
        joints = _name_joints(sorted(frame for frame, _ in places))
        return f"{joints}{name_alike(effect)}"
    if len(places) == 1:
        ((frame, axis),) = places
        where = describe_frame_motion(frame, axis)
        return f"{where}{name_alike(effect)}"
    frames = [str(frame) for frame in sorted({frame for frame, _ in places})]
    if len(frames) == 1:
        return f"Frame {frames[0]} moves"
    return f"Frames {sentence_list(frames)} move"


def _find_acts(effect: Effect) -> dict[tuple[int, str], frozenset[str]]:
    """Find the places where an effect acts, each with the names that it depends on there."""
    claim = effect.claim
    if claim is not None and claim.acts:
        return dict(claim.acts)
    return effect.candidate.mechanism.names_by_place()


def _name_joints(joints: Sequence[int]) -> str:
    """Name the joints that are not where they are read to be."""
    if len(joints) == 1:
        (joint,) = joints
        return f"Joint {joint} is off its reading"
    listed = sentence_list([str(joint) for joint in joints])
    return f"Joints {listed} are off their readings"


def _describe_place(effect: Effect, probability: float) -> str:
    where = name_places(effect)
    if probability >= PROVEN:
        sure = _list_sure_drivers(effect)
        if sure:
            return (
                f"{where}, depending on {sure}; whether it depends on anything else is not proven"
            )
        return f"{where}; what this depends on is not proven"
    return f"What moves is not proven: {_list_entries(effect)}"


def _list_sure_drivers(effect: Effect) -> str:
    """List the drivers that are proven with their probabilities; nothing where none or all are."""
    claim = effect.claim
    words = []
    for name, probability in claim.drivers if claim is not None else ():
        if probability >= PROVEN:
            is_own = _is_own_reading(effect, [name])
            driver = "its own reading" if is_own else name_driver(name)
            written = format_probability(probability)
            words.append(f"{driver} ({written})")
    return sentence_list(words) if words else ""


def _describe_entries(effect: Effect) -> str:
    """Describe what a finding could be, and whether that would do the same."""
    named = effect.named
    text = f"it could be {_list_entries(effect)}"
    labels = dict.fromkeys(entry.candidate.label for entry in named.entries if entry.alike)
    alike = list(labels)[:NAMED_RIVALS]
    if len(alike) > 1:
        names = [_name_entry(effect, label) for label in alike]
        text += f"; {sentence_list(names)} would move the target in the same way"
    return text


def _list_entries(effect: Effect) -> str:
    """List names with their probabilities, that of the first as its own level has it."""
    scale = weigh_listed(effect)
    weights = effect.named.sum_by_label()
    listed = list(weights.items())
    words = []
    left = 1.0
    for label, weight in listed[:NAMED_RIVALS]:
        name = _name_entry(effect, label)
        probability = scale * weight
        left -= probability
        written = format_probability(probability)
        word = f"{name} ({written})"
        words.append(word)
    if round(left, 2) >= MOST:
        words += _list_rest(effect, left)
    return choice_list(words)


def _list_rest(effect: Effect, left: float) -> list[str]:
    """List what an effect is where it is none of the names that are listed, with its probability: what
    the place holds beyond them is no chance."""
    claim = effect.claim
    if claim is not None and claim.probability >= PROVEN:
        written = format_probability(left)
        return [f"{REST[claim.level]} ({written})"]
    there = min(_find_rest_of_place(effect), left)
    words = []
    if round(there, 2):
        written = format_probability(there)
        words.append(f"something else at the place of the first ({written})")
    # several effects together, or none
    elsewhere = left - there
    if round(elsewhere, 2):
        written = format_probability(elsewhere)
        words.append(f"something else, or chance ({written})")
    return words


def _find_rest_of_place(effect: Effect) -> float:
    """Find what the probability of an effect's place holds beyond the listed names that have it."""
    if effect.claim is None:
        return 0.0
    own = effect.candidate.mechanism.names_by_place().keys()
    listed = list(effect.named.sum_by_label())[:NAMED_RIVALS]
    scale = weigh_listed(effect)
    there = 0.0
    for entry in effect.named.entries:
        places = entry.candidate.mechanism.names_by_place().keys()
        if places == own and entry.candidate.label in listed:
            there += scale * entry.probability
    place = effect.claim.levels[0]
    return max(place - there, 0.0)


def tell_rest(effect: Effect, labels: Sequence[str]) -> list[str]:
    """Tell what is not listed in place of those labels that are less probable, where that is likelier
    than everything that is."""
    scale = weigh_listed(effect)
    weights = effect.named.sum_by_label()
    listed = sum(weights.values())
    left = 1.0 - scale * listed
    if left <= MOST:
        return list(labels)
    likely = []
    for label in labels:
        probability = scale * weights[label]
        if probability > left:
            likely.append(label)
    likely.append(SOMETHING_ELSE)
    return likely


def _name_entry(effect: Effect, label: str) -> str:
    """Name an explanation as the effect is named where both have one label: with its number."""
    own = effect.candidate.label
    if label == own:
        return effect.label
    return label


def _describe_drivers(effect: Effect) -> str:
    claim = effect.claim
    if claim is not None and claim.bend:
        ((joint, _), _), *_ = claim.acts
        return f"Joint {joint} yields to the gravity torque about it, not in proportion: it {claim.bend}"
    names = frozenset[str]().union(*_find_acts(effect).values())
    if names and all(map(is_where_target_is, names)):
        return f"{SEEN_WRONGLY}; how is not proven"
    drivers = name_drivers(names)
    if _is_own_reading(effect, names):
        drivers = "its own reading"
    if not drivers:
        return f"{name_places(effect)} by a constant amount"
    shape = "how is not proven"
    if effect.candidate.kind is CandidateKind.SHAPE:
        shape = "no registered mechanism describes how"
    return f"{name_places(effect)}, depending on {drivers}; {shape}"


def _is_own_reading(effect: Effect, names: Iterable[str]) -> bool:
    """Whether an effect turns or shifts one joint and depends on nothing but that joint's reading."""
    places = list(_find_acts(effect))
    if effect.claim is None or not effect.claim.moves_joints or len(places) != 1:
        return False
    ((joint, _),) = places
    return set(names) == {f"q{joint}"}


def _describe_shape(effect: Effect) -> str:
    candidate = effect.candidate
    causes = candidate.causes(" and ")
    if candidate.kind is CandidateKind.FREE_FUNCTION:
        return f"{name_places(effect)} by a free function of its own angle"
    if candidate.kind is CandidateKind.DISTORTION:
        return f"The instrument measures wrongly, by a {candidate.label}"
    if candidate.kind in TOLD_IN_FULL:
        return candidate.mechanism.sentence
    if candidate.registered and len(candidate.mechanism.names()) > MOST_DRIVERS:
        return f"{name_places(effect)} as {candidate.label} describes, but with other signs"
    return f"{name_places(effect)}{append_cause(candidate.mechanism, causes)}"


def _describe_cause(effect: Effect) -> str:
    if not effect.candidate.registered:
        return "No registered mechanism describes this"
    return describe_cause(effect)
