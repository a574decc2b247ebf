"""Findings in a metrologist's words: what, how much, how sure, what else it could be."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .._typing import Array
from ..mechanisms.causes import Bump
from ..mechanisms.terms import LETTERS, Mechanism, Term
from .candidates import Candidate
from .stepwise import Effect

PREFIXES = ((1e-9, "n"), (1e-6, "µ"), (1e-3, "m"))
MOST_WAVES = 90
LEVER_MM, MIN_SHARE = (
    1000.0,
    1e-3,
)  # a turn counts as a shift at this lever; a smaller share of the other is not said
USUAL_SIZE = {
    "mm": 10.0,
    "rad": 0.02,
}  # beyond it no error of an arm is usual, where the catalogue has no range of its own
PLACES = {"t": "shifts along", "r": "turns about"}


def choose_prefix(size: float, unit: str) -> tuple[float, str]:
    """(factor, unit): a value of this size [unit], divided by the factor, reads well in the unit
    given back."""
    if unit.startswith("1/"):
        return 1e-6, f"ppm{unit[1:]}"
    if unit.startswith("rad"):
        factor, prefix = (
            next(((f, p) for f, p in PREFIXES if size < 1000 * f and size < 0.5), (1.0, ""))
            if size
            else (1e-3, "m")
        )
        return factor, prefix + unit
    return (
        (1e-3, "µm" + unit[2:])
        if unit.startswith("mm") and 0 < size < 1e-3
        else (1.0, "" if unit == "1" else unit)
    )


def format_quantity(value: float, error: float | None, unit: str) -> str:
    """A value with its standard error and a prefixed unit: 1.204 ± 0.031 mrad/rad. The error has
    two digits and the value ends at the same place (GUM 7.2.6); without an error the value has
    three."""
    factor, shown_unit = choose_prefix(max(abs(value), error or 0.0), unit)
    if error and np.isfinite(error):
        places = max(1 - int(f"{error / factor:.1e}".partition("e")[2]), 0)
        shown = f"{value / factor:.{places}f} ± {error / factor:.{places}f}"
    else:
        shown = f"{value / factor:#.3g}".rstrip(".") if value else "0"
    return f"{shown} {shown_unit}".rstrip()


def is_wave(terms: Sequence[Term]) -> bool:
    """Whether the terms are a sine and a cosine at one place."""
    return (
        len(terms) == 2
        and {str(t.screws[0].cause)[:4] for t in terms} == {"sin(", "cos("}
        and (terms[0].screws[0].axis == terms[1].screws[0].axis)
    )


def describe_amount(terms: Sequence[Term], estimate: Array, error: Array) -> str:
    """How much: an amplitude for a wave, the range of a free function, else each number with its
    standard error."""
    if is_wave(terms):
        size = float(np.hypot(*estimate))
        spread = (
            float(np.sqrt(np.square(estimate * error).sum())) / size if size else float(error.max())
        )
        return f"amplitude {format_quantity(size, spread, terms[0].unit)}"
    if isinstance(terms[0].screws[0].cause, Bump):
        spans: dict[str, list[float]] = {}
        for t, value in zip(terms, estimate, strict=True):
            spans.setdefault(t.unit, []).append(float(value))
        ranges = {unit: float(np.ptp(v)) for unit, v in spans.items()}
        moved = {unit: size * (LEVER_MM if unit == "rad" else 1.0) for unit, size in ranges.items()}
        seen = [unit for unit in ranges if moved[unit] >= MIN_SHARE * max(moved.values())]
        whole = "from top to bottom " + " and ".join(
            format_quantity(ranges[unit], None, unit) for unit in seen
        )
        strongest = (
            find_waves(terms, estimate) if len(spans) == 1 and terms[0].unit == "rad" else []
        )
        if strongest:
            whole += ", mostly " + " and ".join(
                f"{count} waves per turn of {format_quantity(size, None, 'rad')}"
                for count, size in strongest
            )
        return whole
    return ", ".join(
        f"{t.symbol} = {format_quantity(float(v), float(e), t.unit)}"
        for t, v, e in zip(terms, estimate, error, strict=True)
    )


def find_waves(terms: Sequence[Term], estimate: Array) -> list[tuple[int, float]]:
    """(waves per turn, amplitude) of the two strongest waves of a free function beyond a straight
    line, one after the other; a wave must go round at least twice within the range and carry a
    tenth of what is left."""
    bumps = [t.screws[0].cause for t in terms]
    centres = np.array([b.centre for b in bumps if isinstance(b, Bump)])
    grid = np.linspace(centres.min(), centres.max(), 1000)
    curve = np.zeros(len(grid))
    for bump, value in zip(bumps, estimate, strict=True):
        if isinstance(bump, Bump):
            curve += value * bump.shape(grid)
    line = np.stack([np.ones_like(grid), grid], 1)
    counts = range(max(1, int(np.ceil(2 * 2 * np.pi / np.ptp(grid)))), MOST_WAVES + 1)
    out: list[tuple[int, float]] = []
    for _ in range(2):
        fits = []
        for k in counts:
            X = np.column_stack([line, np.sin(k * grid), np.cos(k * grid)])
            beta = np.linalg.lstsq(X, curve, rcond=None)[0]
            fits.append((float(np.square(curve - X @ beta).sum()), k, beta))
        left, k, beta = min(fits, key=lambda f: f[0])
        flat = float(np.square(curve - line @ np.linalg.lstsq(line, curve, rcond=None)[0]).sum())
        if flat == 0 or left > 0.9 * flat:
            break
        out.append((k, float(np.hypot(*beta[2:]))))
        curve = curve - np.column_stack([np.sin(k * grid), np.cos(k * grid)]) @ beta[2:]
    return out


def has_contrary_signs(mechanism: Mechanism, estimate: Array) -> bool:
    """Whether a fit has the signs that a mechanism's terms should not have: all that have one."""
    wrong = [
        value * t.sign < 0 for t, value in zip(mechanism.terms, estimate, strict=True) if t.sign
    ]
    return bool(wrong) and all(wrong)


def describe_candidate(candidate: Candidate, estimate: Array) -> str:
    """What a candidate says of the arm, without its size; `estimate` (p,) its fitted terms, whose
    sign the sentence follows."""
    contrary = candidate.mechanism.contrary
    if contrary and has_contrary_signs(candidate.mechanism, estimate):
        return contrary.rstrip(".")
    if candidate.mechanism.sentence:
        return candidate.mechanism.sentence.rstrip(".")
    screw = candidate.mechanism.terms[0].screws[0]
    return (
        f"Frame {screw.frame} {PLACES[screw.axis[0]]} its {screw.axis[1]} axis ({LETTERS[screw.axis]}{screw.frame}) with "
        f"{candidate.causes(' and ')}; no registered mechanism says so"
    )


def list_cautions(effect: Effect) -> list[str]:
    """Signs and sizes that the catalogue does not expect."""
    mechanism = effect.candidate.mechanism
    alike = [
        (effect.candidate, effect.estimate),
        *((e.candidate, e.estimate) for e in effect.named.entries if e.alike),
    ]
    others = dict.fromkeys(
        m.name for c, estimate in alike for m in c.but_for_sign if has_contrary_signs(m, estimate)
    )
    out = [
        f"{name} would do the same with the other sign only, so that this is not {name}"
        for name in others
    ]
    for term, value, error in zip(
        mechanism.terms, effect.estimate, effect.standard_error, strict=True
    ):
        if term.sign and not mechanism.contrary and value * term.sign < -2 * error:
            out.append(
                f"the sign of {term.symbol} is not the one that physics gives; it may stand for something else"
            )
        most = term.size[1] if term.size is not None else USUAL_SIZE.get(term.unit, np.inf)
        if error > most:
            out.append(
                f"the data do not tell the size of {term.symbol}: its standard error is larger than such an error usually "
                f"is ({format_quantity(most, None, term.unit)})"
            )
        elif abs(value) - 2 * error > most:
            out.append(
                f"{term.symbol} is larger than usual ({format_quantity(most, None, term.unit)})"
            )
    if effect.cancels is not None:
        out.append(
            f"{effect.cancels[0]} takes most of it back, together they move the target by {effect.cancels[1]:.0%} of what "
            "either does alone: the data do not tell the size of each"
        )
    return out


def describe_effect(effect: Effect) -> str:
    """One finding in one sentence."""
    terms = effect.candidate.mechanism.terms
    entries = effect.named.entries
    same = [e for e in entries if e.alike]
    sure = sum(e.probability for e in same)
    out = f"{describe_candidate(effect.candidate, effect.estimate)}: {describe_amount(terms, effect.estimate, effect.standard_error)}"
    rivals = list(
        dict.fromkeys(
            e.candidate.label
            for e in entries
            if e.candidate.mechanism != effect.candidate.mechanism
        )
    )
    rivals = [r for r in rivals if r != effect.candidate.label]
    if effect.named.verdict == "found":
        own = sum(e.probability for e in entries if e.candidate.label == effect.candidate.label)
        out += f" ({effect.candidate.label}, probability {own:.2f}{' of those asked' if effect.candidate.asked else ''}"
        twins = [r for r in rivals if r in {e.candidate.label for e in same}]
        out += (
            f"; {', '.join(twins[:3])} would move the target alike, together {sure:.2f})"
            if twins
            else ")"
        )
    else:
        odds = ", ".join(f"{e.candidate.label} {e.probability:.2f}" for e in entries[:4])
        out += (
            f"; the data cannot tell this apart from {', '.join(rivals[:3]) or 'others'} ({odds})"
        )
    for caution in list_cautions(effect):
        out += f"; {caution}"
    return out + "."


def format_length(mm: float) -> str:
    """A length in mm, three digits."""
    return f"{mm:.3g} mm"
