"""Moments of a campaign at which something steps: a joint's zero, a target, the instrument."""

from __future__ import annotations

from collections.abc import Iterable

from .causes import Applied, Cause, Combined, Named, Number
from .terms import Term


def find_step_moments(cause: Cause) -> frozenset[float]:
    """Find the moments of the campaign at which a cause steps: none where it does not."""
    match cause:
        case Applied("sign", Combined("-", Named("progress"), Number(at))):
            return frozenset((at,))
        case Applied(_, argument):
            return find_step_moments(argument)
        case Combined(_, left, right):
            return find_step_moments(left) | find_step_moments(right)
    return frozenset()


def list_step_moments(terms: Iterable[Term]) -> set[float]:
    """List the moments at which any cause of some terms steps."""
    screws = [screw for term in terms for screw in term.screws]
    moments = [find_step_moments(screw.cause) for screw in screws]
    return set[float]().union(*moments)
