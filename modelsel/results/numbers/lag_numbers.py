"""Usable numbers of a joint that follows its reading late: how far it is behind."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...mechanisms.terms import Mechanism
from .quantities import ARC_SECONDS, Usable, express
from .workspace import Fitted

WORDS = "behind at the fastest measured speed"


def measure_servo_lag(mechanism: Mechanism, fitted: Fitted) -> Iterator[Usable]:
    """Measure how far a joint is behind its reading at the fastest speed that was measured."""
    screw = mechanism.terms[0].screws[0]
    problem = fitted.workspace.problem
    speed = problem.cause(screw.cause)
    fastest = float(np.abs(speed).max())
    lag = fitted.range_of(-np.ones(1))
    behind = lag.scale(fastest)
    if screw.axis == "tz":
        yield express(WORDS, behind, "mm", WORDS)
        return
    turn = behind.scale(ARC_SECONDS)
    yield express(WORDS, turn, "arcsec", WORDS)
