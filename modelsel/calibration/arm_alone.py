"""The arm without the errors of the instrument that measured it.

A calibration says what an instrument sees, its own errors among that. Where the hand really goes, which
commands correct and files for other programs describe, is what it says without these."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from .._typing import Index
from ..exceptions import sentence_list
from ..fitting.design import Model
from ..mechanisms.instrument import MISREADINGS
from ..mechanisms.terms import TermKey

if TYPE_CHECKING:
    from .calibration import Calibration


def leave_out_instrument(c: Calibration) -> Calibration:
    """Return a calibration whose errors of the instrument are none, and are known to be none."""
    places = _find_places(c)
    if not len(places):
        return c
    theta = c.theta.copy()
    factor = c.factor.copy()
    theta[places] = 0.0
    factor[places] = 0.0
    return replace(c, theta=theta, factor=factor)


def describe_left_out_instrument(c: Calibration) -> list[str]:
    """Describe which errors of the instrument commands do not correct; what may be the arm's as well is
    described by `describe_other_sides`."""
    names = [name for name in list_instrument_names(c) if name not in c.other_sides]
    if not names:
        return []
    listed = sentence_list(names)
    what, rest = "is an error", "it is"
    if len(names) > 1:
        what, rest = "are errors", "they are"
    return [f"{listed} {what} of the instrument, not of the arm: {rest} not corrected."]


def list_instrument_names(c: Calibration) -> list[str]:
    """List the names of the errors of the instrument that a calibration has."""
    return [one.name for one in c.model.mechanisms if one.stem in MISREADINGS]


def _find_places(c: Calibration) -> Index:
    """Find the places in theta of the terms that errors of the instrument alone have."""
    of_instrument = list_misreadings(c.model)
    places = [k for k, term in enumerate(c.terms) if term.key in of_instrument]
    return np.array(places, dtype=np.intp)


def list_misreadings(model: Model) -> set[TermKey]:
    """List the keys of the terms of a model that errors of the instrument alone have."""
    of_instrument = set[TermKey]()
    of_arm = set[TermKey]()
    for one in model.mechanisms:
        keys = {term.key for term in one.terms}
        if one.stem in MISREADINGS:
            of_instrument |= keys
        else:
            of_arm |= keys
    return of_instrument - of_arm
