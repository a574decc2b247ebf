"""What became of one mechanism between two campaigns, in words that go no further than the evidence."""

from __future__ import annotations

from ...exceptions import write_rounded
from .mechanism_changes import CAMPAIGN_NAMES, DEFINITE_CHANGES, NOT_COMPARABLE, MechanismChange

SMALLEST_P = 0.001  # that is told as a figure


def write_p(p: float) -> str:
    """Write a p-value; below a thousandth as a bound."""
    return f"p = {p:.2g}" if p >= SMALLEST_P else f"p < {SMALLEST_P}"


def describe_change(change: MechanismChange) -> str:
    """Describe one mechanism in words that go no further than the evidence."""
    if change.what == NOT_COMPARABLE:
        return _describe_followed(change)
    if change.p is None:
        return _describe_single(change)
    name = change.name
    what = change.what
    before = write_rounded(change.before_mm)
    after = write_rounded(change.after_mm)
    turned = _describe_turns(change, " to ")
    sizes = f"{before} to {after} mm rms at the target{turned} ({write_p(change.p)})"
    if what in ("grew", "shrank"):
        return f"{name} {what}: {sizes}."
    if what == "changed":
        return f"The terms of {name} changed, its size did not beyond chance: {sizes}."
    assert change.seen_mm is not None  # of what was compared
    seen = write_rounded(change.seen_mm, 2)
    return f"{name} did not change beyond chance: {sizes}; a change of {seen} mm would have been detected."


def _describe_turns(change: MechanismChange, between: str | None = None) -> str:
    """Describe how far a mechanism turns the target, both campaigns' figures or the one there is;
    nothing where orientations are not compared."""
    if change.turns_mrad is None:
        return ""
    before, after = change.turns_mrad
    figures = write_rounded(max(before, after))
    if change.only_in is None and between is not None:
        first = write_rounded(before)
        second = write_rounded(after)
        figures = f"{first}{between}{second}"
    return f", {figures} mrad rms of its orientation"


def _describe_followed(change: MechanismChange) -> str:
    """Describe a mechanism that moves the target as the geometry does, so that nothing can be
    compared."""
    before = write_rounded(change.before_mm)
    after = write_rounded(change.after_mm)
    turned = _describe_turns(change, " and ")
    named = f"{change.name} is in the models of both campaigns, with {before} and {after} mm"
    if change.only_in is not None:
        size = before if change.only_in == CAMPAIGN_NAMES[0] else after
        named = (
            f"{change.name} is in the model of the {change.only_in} campaign only, with {size} mm"
        )
    return (
        f"{named} rms at the target{turned}. The geometry, which both have fitted, would move it in the same "
        "way, so the two campaigns cannot be compared in it."
    )


def _describe_single(change: MechanismChange) -> str:
    """Describe a mechanism that one campaign alone has named, and what it may be in the other."""
    is_first = change.only_in == CAMPAIGN_NAMES[0]
    named, other = CAMPAIGN_NAMES if is_first else CAMPAIGN_NAMES[::-1]
    largest = change.before_mm if is_first else change.after_mm
    size = f"{write_rounded(largest)} mm rms at the target{_describe_turns(change)}"
    only = f"{change.name} is in the model of the {named} campaign only, with {size}."
    if change.perhaps is not None:
        return f"{only} It may be the same error as {change.perhaps} of the {other}, which moves the target much alike."
    limit = f"From where on the {other} would have named it is not known"
    if change.seen_mm is not None:
        seen = write_rounded(change.seen_mm, 2)
        if change.what in DEFINITE_CHANGES:
            return f"{change.name} {change.what}: {size}; the {other} campaign would have named it from {seen} mm on."
        limit = f"The {other} would have named it only from {seen} mm on"
    verb = "disappeared" if is_first else "appeared"
    return f"{only} {limit}, so it cannot be said whether it {verb}."
