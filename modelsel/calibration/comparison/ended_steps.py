"""A calibration as the arm stood at one end of its campaign: what stepped in between is part of its
constants, or is not there yet."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ...mechanisms.causes import ONE, Cause
from ...mechanisms.environment import step_after
from ...mechanisms.moved_targets import split_target
from ...mechanisms.step_moments import find_step_moments
from ...mechanisms.terms import Term, TermKey
from ..calibration import Calibration
from ..constant_part import select_terms


@dataclass(frozen=True)
class _Step:
    """A term that steps from nought at a moment of the campaign, and the key of the constant that it
    adds to from then on."""

    place: int
    constant: TermKey


def settle_steps(c: Calibration, at_end: bool) -> Calibration:
    """Return a calibration as the arm stood at the end of its campaign, or at its beginning.

    A step whose constant the model does not have stays as it is."""
    where = {term.key: place for place, term in enumerate(c.terms)}
    steps = [step for step in _list_steps(c) if step.constant in where]
    if not steps:
        return c
    theta = c.theta.copy()
    factor = c.factor.copy()
    for step in steps:
        constant = where[step.constant]
        if at_end:
            theta[constant] += theta[step.place]
            factor[constant] += factor[step.place]
    left = {step.place for step in steps}
    places = [place for place in range(len(theta)) if place not in left]
    settled = replace(c, factor=factor)
    return select_terms(settled, places, theta[places])


def _list_steps(c: Calibration) -> list[_Step]:
    """List the terms that are steps and nothing else, of one target where they are of one alone."""
    steps = []
    for place, term in enumerate(c.terms):
        constant = _find_constant(term)
        if constant is not None:
            steps.append(_Step(place, constant))
    return steps


def _find_constant(term: Term) -> TermKey | None:
    """Find the key of the constant that a step adds to; None for what is no step."""
    screws = []
    for screw in term.screws:
        target, cause = split_target(screw.cause)
        moments = find_step_moments(cause)
        if len(moments) != 1 or cause != step_after(*moments):
            return None
        constant: Cause = ONE if target is None else target
        standing = replace(screw, cause=constant)
        screws.append(standing)
    return tuple(screws)
