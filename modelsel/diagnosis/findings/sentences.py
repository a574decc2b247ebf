"""Findings in sentences: what is wrong, how much, how sure that is, and what else it could be."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from ..._typing import Array
from ...exceptions import choice_list, count_words, write_rounded
from ...measurements.campaign.state_names import StateKind, describe_state_name, parse_state_name
from ...mechanisms.causes import Applied, Bump, find_bump
from ...mechanisms.compliance import AS_DECLARED
from ...mechanisms.terms import Mechanism, Term, describe_frame_motion, letter
from ..candidates.candidate import Candidate
from ..inference.sign_constraints import are_unsigned_negative
from ..shapes.cause_words import append_cause, find_constant_of
from ..shapes.driver_functions import IN_TIME
from .effects import Claim, Effect
from .fitted_curves import find_waves, measure_heights
from .stated_probability import scale_listed

# sizes [rad] below which an angle has the next smaller unit
PREFIXES = ((1e-6, 1e-9, "n"), (1e-4, 1e-6, "µ"), (0.5, 1e-3, "m"))
# lever at which a rotation is compared with a shift, and the share of the larger one below which
# the smaller is not mentioned
LEVER_MM = 1000.0
MIN_SHARE = 1e-3
# ends what is said of a cell
UNREGISTERED = "; no registered mechanism describes this"
# s up to which a time is in ms
LARGEST_MS = 0.5
# rad from which an angle in a sentence is in degrees
LARGEST_MRAD = 0.05


def choose_prefix(size: float, unit: str) -> tuple[float, str]:
    """Choose (factor, prefixed unit) in which a value of this size [unit] reads well.

    The value is to be divided by the factor."""
    if unit.startswith("1/"):
        return 1e-6, f"ppm{unit[1:]}"
    if unit.startswith("rad"):
        factor, prefix = _choose_angle_prefix(size)
        return factor, prefix + unit
    if unit.startswith("mm") and 0 < size < 1e-3:
        return 1e-3, "µm" + unit[2:]
    if unit == "s" and 0 < size < LARGEST_MS:
        return 1e-3, "ms"
    if unit == "1":
        return 1.0, ""
    return 1.0, unit


def _choose_angle_prefix(size: float) -> tuple[float, str]:
    if size == 0:
        return 1e-3, "m"
    for limit, factor, prefix in PREFIXES:
        if size < limit:
            return factor, prefix
    return 1.0, ""


def format_quantity(value: float, error: float | None, unit: str, size: float = 0.0) -> str:
    """Format a value with its standard error and a prefixed unit: 1.204 ± 0.031 mrad/rad.

    The error has two digits and the value ends at the same place (GUM 7.2.6); without an error the
    value has three digits. `size`: of the largest value of this kind beside it, which has the same
    prefix."""
    largest = max(abs(value), error or 0.0, size)
    factor, shown_unit = choose_prefix(largest, unit)
    size = value / factor
    if error and np.isfinite(error):
        shown_error = error / factor
        exponent = int(f"{shown_error:.1e}".partition("e")[2])
        places = max(1 - exponent, 0)
        # z: what rounds to nought has no sign
        shown = f"{size:z.{places}f} ± {shown_error:.{places}f}"
    elif value:
        shown = f"{size:#.3g}".rstrip(".")
    else:
        shown = "0"
    return f"{shown} {shown_unit}".rstrip()


def format_angle(rad: float) -> str:
    """Format an angle [rad] with three digits: in µrad or mrad, degrees from some tens of mrad on."""
    if abs(rad) >= LARGEST_MRAD:
        return f"{write_rounded(float(np.degrees(rad)))}°"
    return format_quantity(rad, None, "rad")


def format_length(mm: float) -> str:
    """Format a length [mm] with three digits."""
    return f"{write_rounded(mm)} mm"


def is_wave(terms: Sequence[Term]) -> bool:
    """Return whether the terms are a sine and a cosine at one place: a wave of unknown phase."""
    if len(terms) != 2:
        return False
    functions = set()
    axes = set()
    for term in terms:
        screw = term.screws[0]
        axes.add(screw.axis)
        if isinstance(screw.cause, Applied):
            functions.add(screw.cause.function)
    return functions == {"sin", "cos"} and len(axes) == 1


def describe_amount(terms: Sequence[Term], estimate: Array, error: Array) -> str:
    """Describe the size of an effect.

    That is the amplitude of a wave, the range of a free function, else every term (k,) with its
    standard error."""
    first_term = terms[0]
    if is_wave(terms):
        return _describe_amplitude(first_term.unit, estimate, error)
    first_screw = first_term.screws[0]
    if isinstance(first_screw.cause, Bump):
        return _describe_free_function(terms, estimate)
    if find_bump(first_screw.cause) is not None:
        return f"a function of {count_words(len(terms), 'coefficient')}"
    if len(terms) == 1 and find_constant_of(first_screw.cause) is not None:
        change = format_quantity(abs(float(estimate[0])), float(error[0]), first_term.unit)
        return f"by {change} in all"
    amounts = []
    largest = _find_largest(terms, estimate, error)
    for term, value, sigma in zip(terms, estimate, error, strict=True):
        size = largest[term.unit.startswith("rad")]
        amount = format_quantity(float(value), float(sigma), term.unit, size)
        amounts.append(f"{term.symbol} = {amount}")
    return ", ".join(amounts)


def _find_largest(terms: Sequence[Term], estimate: Array, error: Array) -> dict[bool, float]:
    """Find the largest value or standard error of terms that turn (True), and of those that shift."""
    largest = {True: 0.0, False: 0.0}
    for term, value, sigma in zip(terms, estimate, error, strict=True):
        turns = term.unit.startswith("rad")
        size = max(abs(float(value)), float(sigma))
        if np.isfinite(size):
            largest[turns] = max(largest[turns], size)
    return largest


def _describe_amplitude(unit: str, estimate: Array, error: Array) -> str:
    amplitude = float(np.hypot(*estimate))
    if amplitude:
        products = np.square(estimate * error)
        root_sum = float(np.sqrt(products.sum()))
        sigma = root_sum / amplitude
    else:
        sigma = float(error.max())
    shown = format_quantity(amplitude, sigma, unit)
    return f"amplitude {shown}"


def _describe_free_function(terms: Sequence[Term], estimate: Array) -> str:
    """Describe the range of a free function, of shifts and of rotations, and its strongest waves."""
    heights = measure_heights(terms, estimate)
    moved = dict(heights)
    if "rad" in moved:
        moved["rad"] *= LEVER_MM
    least_shown = MIN_SHARE * max(moved.values())
    sizes = []
    for unit, size in heights.items():
        shown = format_quantity(size, None, unit)
        if moved[unit] >= least_shown:
            sizes.append(shown)
    text = f"peak to peak {' and '.join(sizes)}"
    variables = [parse_state_name(name) for name in terms[0].screws[0].cause.names()]
    is_of_angle = all(v is not None and v.kind is StateKind.READING for v in variables)
    if set(heights) != {"rad"} or not is_of_angle:
        return text
    named = []
    for count, amplitude in find_waves(terms, estimate):
        shown = format_quantity(amplitude, None, "rad", heights["rad"])
        named.append(f"{shown} in {count} waves a turn")
    if named:
        text += f", mostly {' and '.join(named)}"
    return text


def has_contrary_signs(mechanism: Mechanism, estimate: Array) -> bool:
    """Return whether every term (k,) that physics gives a sign is fitted with the opposite one."""
    signs = np.array([term.sign for term in mechanism.terms])
    is_contrary = signs * estimate < 0
    return bool(signs.any() and is_contrary[signs != 0].all())


def describe_candidate(candidate: Candidate, estimate: Array, joint: str = "") -> str:
    """Describe what a candidate says of the arm, without its size.

    The sentence follows the signs of its fitted terms `estimate` (k,): what physics forbids is not
    told as the mechanism. `joint`: the words for the joint that a cell moves, where it moves one."""
    mechanism = candidate.mechanism
    if has_contrary_signs(mechanism, estimate):
        if mechanism.contrary:
            return mechanism.contrary.rstrip(".")
        return (
            f"{_describe_place(candidate, joint)}; {mechanism.name} would have the opposite sign, so this "
            "is something else"
        )
    if mechanism.contrary and are_unsigned_negative(mechanism, estimate):
        return mechanism.contrary.rstrip(".")
    if mechanism.sentence:
        return mechanism.sentence.rstrip(".")
    return f"{_describe_place(candidate, joint)}{UNREGISTERED}"


def describe_cause(effect: Effect, joint: str = "") -> str:
    """Describe what an effect's candidate says of the arm, as the fit has it: one spring under the arm's
    weight and the payload in other words where the data speak for two."""
    words = describe_candidate(effect.candidate, effect.estimate, joint)
    if effect.apart is None or not effect.apart.is_doubted:
        return words
    both = words.removesuffix(f",{AS_DECLARED}")
    return f"{both}; that one stiffness holds for both{AS_DECLARED} is not proven"


def name_joint(effect: Effect) -> str:
    """Name the one joint along whose motion an effect acts, in words; empty where it acts otherwise."""
    claim = effect.claim
    if claim is None or not claim.moves_joints:
        return ""
    candidate = effect.candidate
    places = candidate.mechanism.names_by_place()
    if len(places) != 1:
        return ""
    ((joint, _),) = places
    return f"Joint {joint} is off its reading{name_alike(effect)}"


def name_alike(effect: Effect) -> str:
    """Name what would move every target in the same way as what moves: other frames, and the instrument
    against the base; nothing beside a joint that moves with how it stands, moves or is loaded itself."""
    claim = effect.claim
    if claim is None:
        return ""
    if claim.moves_joints and any(
        _depends_on_own(joint, names) for (joint, _), names in claim.acts
    ):
        return ""
    alike = []
    if claim.alike:
        frames = sorted({str(frame) for frame, _ in claim.alike})
        alike.append(f"frame {choice_list(frames)}")
    if _may_be_instrument(claim):
        alike.append("the instrument")
    if not alike:
        return ""
    named = ", or ".join(alike)
    comma = "," if len(alike) > 1 else ""
    return f" ({named}{comma} would move the target alike)"


def _may_be_instrument(claim: Claim) -> bool:
    """Whether what is claimed moves along the campaign as the instrument would against the base, to
    which frame 1 belongs."""
    if len(claim.acts) != 1:
        return False
    ((place, names),) = claim.acts
    frames = {frame for frame, _ in (place, *claim.alike)}
    return 1 in frames and bool(names) and names <= IN_TIME


def _depends_on_own(joint: int, names: Iterable[str]) -> bool:
    """Whether some names are of a joint's own state."""
    variables = map(parse_state_name, names)
    return any(one is not None and one.joint == joint for one in variables)


def _describe_place(candidate: Candidate, joint: str) -> str:
    """Describe what a candidate's first screw moves, and with what; of many frames which, and what
    they follow."""
    frames = candidate.many_frames
    if frames:
        names = sorted(candidate.mechanism.names())
        drivers = " and ".join(map(describe_state_name, names))
        return f"Frames {frames[0]} to {frames[-1]} move together, depending on {drivers}"
    first_term = candidate.mechanism.terms[0]
    screw = first_term.screws[0]
    motion = describe_frame_motion(screw.frame, screw.axis)
    symbol = letter(screw.frame, screw.axis)
    causes = candidate.causes(" and ")
    where = joint or f"{motion} ({symbol})"
    return f"{where}{append_cause(candidate.mechanism, causes)}"


def label_effect(effect: Effect) -> str:
    """Return the short name of an effect; that its signs are not the mechanism's is part of it."""
    label = effect.label
    if has_contrary_signs(effect.candidate.mechanism, effect.estimate):
        return f"{label} with the opposite sign"
    return label


def say_shape(effect: Effect) -> str:
    """Say within a sentence what an effect does that no registered mechanism describes."""
    candidate = effect.candidate
    if candidate.registered:
        return label_effect(effect)
    joint = name_joint(effect)
    words = describe_candidate(candidate, effect.estimate, joint)
    said = words.removesuffix(UNREGISTERED)
    first = said[0].lower()
    return f"{first}{said[1:]}"


def list_usual_causes(effect: Effect) -> tuple[str, ...]:
    """List the parts that usually do what an effect does; none where its signs are not the
    mechanism's."""
    mechanism = effect.candidate.mechanism
    if has_contrary_signs(mechanism, effect.estimate):
        return ()
    return mechanism.usual_causes


def sum_of_name(effect: Effect) -> float:
    """Sum the probabilities of the listed explanations that have an effect's name."""
    return effect.named.sum_by_label().get(effect.candidate.label, 0.0)


def weigh_listed(effect: Effect) -> float:
    """Return by what the probabilities of listed explanations are multiplied where they are told
    beside that of the name."""
    levels = () if effect.claim is None else effect.claim.levels
    return scale_listed(levels, sum_of_name(effect))
