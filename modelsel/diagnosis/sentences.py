"""Findings in sentences: what is wrong, how much, how sure that is, and what else it could be."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from .._typing import Array
from ..mechanisms.causes import Applied, Bump
from ..mechanisms.terms import LETTERS, Mechanism, Term
from .candidates import Candidate
from .credible_sets import FOUND
from .effects import Effect

PREFIXES = ((1e-9, "n"), (1e-6, "µ"), (1e-3, "m"))
# waves per turn that are looked for in a free function, how many are named, and the least share of
# the curve's sum of squares that one must explain
MAX_WAVES = 90
NAMED_WAVES = 2
MIN_WAVE_SHARE = 0.1
# lever at which a rotation is compared with a shift, and the share of the larger one below which
# the smaller is not mentioned
LEVER_MM = 1000.0
MIN_SHARE = 1e-3
# sizes that are unusual for an error of an arm, where the catalogue gives no range
USUAL_SIZE = {"mm": 10.0, "rad": 0.02}
MOTIONS = {"t": "shifts along", "r": "turns about"}
# alternatives that a sentence names
NAMED_RIVALS = 3


def choose_prefix(size: float, unit: str) -> tuple[float, str]:
    """Choose (factor, prefixed unit): a value of this size [unit], divided by the factor, reads well
    in the prefixed unit."""
    if unit.startswith("1/"):
        return 1e-6, f"ppm{unit[1:]}"
    if unit.startswith("rad"):
        factor, prefix = _choose_angle_prefix(size)
        return factor, prefix + unit
    if unit.startswith("mm") and 0 < size < 1e-3:
        return 1e-3, "µm" + unit[2:]
    return 1.0, "" if unit == "1" else unit


def _choose_angle_prefix(size: float) -> tuple[float, str]:
    if size == 0:
        return 1e-3, "m"
    for factor, prefix in PREFIXES:
        if size < 1000 * factor and size < 0.5:
            return factor, prefix
    return 1.0, ""


def format_quantity(value: float, error: float | None, unit: str) -> str:
    """Format a value with its standard error and a prefixed unit: 1.204 ± 0.031 mrad/rad.

    The error has two digits and the value ends at the same place (GUM 7.2.6); without an error the
    value has three digits."""
    factor, shown_unit = choose_prefix(max(abs(value), error or 0.0), unit)
    if error and np.isfinite(error):
        exponent = int(f"{error / factor:.1e}".partition("e")[2])
        places = max(1 - exponent, 0)
        shown = f"{value / factor:.{places}f} ± {error / factor:.{places}f}"
    else:
        shown = f"{value / factor:#.3g}".rstrip(".") if value else "0"
    return f"{shown} {shown_unit}".rstrip()


def format_length(mm: float) -> str:
    """Format a length [mm] with three digits."""
    return f"{mm:.3g} mm"


def is_wave(terms: Sequence[Term]) -> bool:
    """Return whether the terms are a sine and a cosine at one place: a wave of unknown phase."""
    if len(terms) != 2:
        return False
    screws = [term.screws[0] for term in terms]
    functions = {s.cause.function for s in screws if isinstance(s.cause, Applied)}
    return functions == {"sin", "cos"} and screws[0].axis == screws[1].axis


def describe_amount(terms: Sequence[Term], estimate: Array, error: Array) -> str:
    """Describe the size of an effect: the amplitude of a wave, the range of a free function, else
    every term (k,) with its standard error."""
    if is_wave(terms):
        return _describe_amplitude(terms[0].unit, estimate, error)
    if isinstance(terms[0].screws[0].cause, Bump):
        return _describe_free_function(terms, estimate)
    return ", ".join(
        f"{term.symbol} = {format_quantity(float(value), float(sigma), term.unit)}"
        for term, value, sigma in zip(terms, estimate, error, strict=True)
    )


def _describe_amplitude(unit: str, estimate: Array, error: Array) -> str:
    amplitude = float(np.hypot(*estimate))
    if amplitude:
        sigma = float(np.sqrt(np.square(estimate * error).sum())) / amplitude
    else:
        sigma = float(error.max())
    return f"amplitude {format_quantity(amplitude, sigma, unit)}"


def _describe_free_function(terms: Sequence[Term], estimate: Array) -> str:
    """Describe the range of a free function, of shifts and of rotations, and its strongest waves."""
    values: dict[str, list[float]] = {}
    for term, value in zip(terms, estimate, strict=True):
        values.setdefault(term.unit, []).append(float(value))
    ranges = {unit: float(np.ptp(v)) for unit, v in values.items()}
    moved = {unit: size * (LEVER_MM if unit == "rad" else 1.0) for unit, size in ranges.items()}
    shown = [unit for unit in ranges if moved[unit] >= MIN_SHARE * max(moved.values())]
    sizes = " and ".join(format_quantity(ranges[unit], None, unit) for unit in shown)
    text = f"peak to peak {sizes}"
    is_angle = len(values) == 1 and terms[0].unit == "rad"
    waves = find_waves(terms, estimate) if is_angle else []
    if waves:
        named = (
            f"{count} waves per turn of {format_quantity(a, None, 'rad')}" for count, a in waves
        )
        text += f", mostly {' and '.join(named)}"
    return text


def find_waves(terms: Sequence[Term], estimate: Array) -> list[tuple[int, float]]:
    """Find (waves per turn, amplitude) of the two strongest waves of a free function beyond a
    straight line, one after the other.

    A wave must repeat at least twice within the range, and explain a tenth of the rest."""
    causes = (term.screws[0].cause for term in terms)
    bumps = [(c, v) for c, v in zip(causes, estimate, strict=True) if isinstance(c, Bump)]
    centres = [bump.centre for bump, _ in bumps]
    grid = np.linspace(min(centres), max(centres), 1000)
    curve = np.zeros(len(grid))
    for bump, value in bumps:
        curve += value * bump.shape(grid)
    fewest = max(1, int(np.ceil(2 * 2 * np.pi / np.ptp(grid))))
    waves: list[tuple[int, float]] = []
    for _ in range(NAMED_WAVES):
        before = _fit_waves(grid, curve, 0)[0]
        fits = [(*_fit_waves(grid, curve, k), k) for k in range(fewest, MAX_WAVES + 1)]
        left, beta, count = min(fits, key=lambda fitted: fitted[0])
        if before == 0 or left > (1 - MIN_WAVE_SHARE) * before:
            break
        waves.append((count, float(np.hypot(*beta[2:]))))
        curve = curve - np.column_stack([np.sin(count * grid), np.cos(count * grid)]) @ beta[2:]
    return waves


def _fit_waves(grid: Array, curve: Array, count: int) -> tuple[float, Array]:
    """Fit a line, and a wave of `count` a turn unless that is 0: (sum of squares left, terms)."""
    X = np.column_stack([np.ones_like(grid), grid])
    if count:
        X = np.column_stack([X, np.sin(count * grid), np.cos(count * grid)])
    beta = np.asarray(np.linalg.lstsq(X, curve, rcond=None)[0], float)
    return float(np.square(curve - X @ beta).sum()), beta


def has_contrary_signs(mechanism: Mechanism, estimate: Array) -> bool:
    """Return whether every term (k,) that physics gives a sign is fitted with the opposite one."""
    signs = np.array([term.sign for term in mechanism.terms])
    is_contrary = signs * estimate < 0
    return bool(signs.any() and is_contrary[signs != 0].all())


def describe_candidate(candidate: Candidate, estimate: Array) -> str:
    """Describe what a candidate says of the arm, without its size; the sentence follows the signs of
    its fitted terms `estimate` (k,)."""
    mechanism = candidate.mechanism
    if mechanism.contrary and has_contrary_signs(mechanism, estimate):
        return mechanism.contrary.rstrip(".")
    if mechanism.sentence:
        return mechanism.sentence.rstrip(".")
    screw = mechanism.terms[0].screws[0]
    motion, axis = MOTIONS[screw.axis[0]], screw.axis[1]
    place = f"Frame {screw.frame} {motion} its {axis} axis ({LETTERS[screw.axis]}{screw.frame})"
    return f"{place} with {candidate.causes(' and ')}; no registered mechanism describes this"


def list_cautions(effect: Effect) -> list[str]:
    """List what the catalogue does not expect of an effect: signs, sizes, and another effect that
    cancels it."""
    cautions = list(_generate_sign_cautions(effect))
    mechanism = effect.candidate.mechanism
    for term, value, error in zip(
        mechanism.terms, effect.estimate, effect.standard_error, strict=True
    ):
        if term.sign and not mechanism.contrary and value * term.sign < -2 * error:
            cautions.append(
                f"the sign of {term.symbol} is opposite to what physics predicts, so another cause "
                "is likely"
            )
        cautions += _generate_size_cautions(term, float(value), float(error))
    if effect.cancels is not None:
        other, share = effect.cancels
        cautions.append(
            f"{other} cancels most of it; together they move the target by {share:.0%} of what "
            "either does alone: the data do not determine the size of each"
        )
    return cautions


def _generate_sign_cautions(effect: Effect) -> Iterator[str]:
    """Generate a caution for every registered mechanism with the same screws that physics allows
    with the opposite sign only."""
    alike = [(e.candidate, e.estimate) for e in effect.named.entries if e.alike]
    names: dict[str, None] = {}
    for candidate, estimate in [(effect.candidate, effect.estimate), *alike]:
        contrary = [m for m in candidate.but_for_sign if has_contrary_signs(m, estimate)]
        names |= dict.fromkeys(m.name for m in contrary)
    for name in names:
        yield f"{name} would do the same with the opposite sign only, so this is not {name}"


def _generate_size_cautions(term: Term, value: float, error: float) -> Iterator[str]:
    largest = USUAL_SIZE.get(term.unit, np.inf) if term.size is None else term.size[1]
    limit = format_quantity(largest, None, term.unit)
    if error > largest:
        yield (
            f"the data do not determine the size of {term.symbol}: its standard error is larger "
            f"than such an error usually is ({limit})"
        )
    elif abs(value) - 2 * error > largest:
        yield f"{term.symbol} is larger than usual ({limit})"


def describe_effect(effect: Effect) -> str:
    """Describe one finding in one sentence."""
    what = describe_candidate(effect.candidate, effect.estimate)
    terms = effect.candidate.mechanism.terms
    amount = describe_amount(terms, effect.estimate, effect.standard_error)
    is_found = effect.named.verdict == FOUND
    standing = _describe_probability(effect) if is_found else _describe_rivals(effect)
    return "; ".join([f"{what}: {amount}{standing}", *list_cautions(effect)]) + "."


def _list_rivals(effect: Effect) -> list[str]:
    """List the labels of other mechanisms in the credible set, the most probable first."""
    candidate = effect.candidate
    others = (e.candidate for e in effect.named.entries)
    labels = (c.label for c in others if c.mechanism != candidate.mechanism)
    return [label for label in dict.fromkeys(labels) if label != candidate.label]


def _describe_probability(effect: Effect) -> str:
    label, entries = effect.candidate.label, effect.named.entries
    probability = sum(e.probability for e in entries if e.candidate.label == label)
    scope = " among those considered" if effect.candidate.asked else ""
    alike = [e for e in entries if e.alike]
    labels_alike = {e.candidate.label for e in alike}
    twins = [rival for rival in _list_rivals(effect) if rival in labels_alike]
    text = f" ({label}, probability {probability:.2f}{scope}"
    if twins:
        together = sum(e.probability for e in alike)
        named = ", ".join(twins[:NAMED_RIVALS])
        text += f"; {named} would move the target in the same way, together {together:.2f}"
    return text + ")"


def _describe_rivals(effect: Effect) -> str:
    listed = effect.named.entries[: NAMED_RIVALS + 1]
    odds = ", ".join(f"{e.candidate.label} {e.probability:.2f}" for e in listed)
    rivals = ", ".join(_list_rivals(effect)[:NAMED_RIVALS]) or "others"
    return f"; the data cannot tell this apart from {rivals} ({odds})"
