"""How the instrument and the base drift against each other while a campaign lasts: in proportion to time, as what
warms up does, or freely."""

from __future__ import annotations

import math

from ..robot.kinematics import Robot
from ..robot.rigid import AXES
from .causes import Applied, Bump, Cause, Number
from .environment import PROGRESS
from .terms import Mechanism, Screw, Term

TRACKER_DRIFT = "tracker-drift"
# mm and rad
DRIFT = {"t": (1e-3, 2.0), "r": (1e-6, 2e-3)}
# in proportion to time; splines of time whose knots are this share of the campaign apart
LINEAR, KNOTS = 1.0, (0.25, 0.1)
# time constants of a warm-up, in shares of the campaign: what lies between two of them leaves less than a
# hundredth of its variance
WARM_UPS = (0.05, 0.06, 0.08, 0.11, 0.14, 0.18, 0.22, 0.28, 0.36, 0.45, 0.6, 0.8)
DRIFTS = (LINEAR, *KNOTS, *WARM_UPS)


def list_drifts(robot: Robot) -> tuple[float, ...]:
    """List the courses of a drift, the same for every robot."""
    return DRIFTS


def tracker_drift(robot: Robot, course: float) -> Mechanism:
    """Tracker or foundation drifts while the campaign lasts, all six: in proportion to time, by splines of it,
    or as what warms up does (`course`: one of DRIFTS)."""
    causes = _list_causes(course)
    several = len(causes) > 1
    terms = tuple(
        Term(f"v{axis}{k}" if several else f"v{axis}", (Screw(1, axis, cause),), DRIFT[axis[0]])
        for axis in AXES
        for k, cause in enumerate(causes, 1)
    )
    how = ""
    if course in WARM_UPS:
        how = f", ever more slowly, with a time constant of {100 * course:g} % of it"
    return Mechanism(
        TRACKER_DRIFT,
        terms,
        f"Instrument and base drift against each other while the campaign lasts{how}.",
        _equate(course),
        "ISO 10360-10, laser trackers: drift",
        usual_causes=(
            "instrument or its stand warming up",
            "foundation",
            "column of the arm warming up",
        ),
    )


def warms_up(mechanism: Mechanism) -> bool:
    """Return whether a mechanism is a drift that goes on as a warm-up does."""
    if mechanism.stem != TRACKER_DRIFT:
        return False
    cause = mechanism.terms[0].screws[0].cause
    return any(cause in _list_causes(course) for course in WARM_UPS)


def _list_causes(course: float) -> list[Cause]:
    """List the functions of time of a drift's course."""
    if course == LINEAR:
        return [PROGRESS]
    if course in KNOTS:
        return [
            Bump("progress", round(k * course, 6), course) for k in range(round(1 / course) + 1)
        ]
    # from 0 at the beginning to 1 at the end, so that its number is the whole change
    decay: Cause = Applied("exp", PROGRESS / -course)
    whole = 1.0 - math.exp(-1.0 / course)
    return [(Number(1.0) - decay) / float(f"{whole:.6g}")]


def _equate(course: float) -> str:
    """Write the equation of a drift."""
    if course == LINEAR:
        return "H_1 = v · progress"
    if course in KNOTS:
        return "H_1 = free function of progress"
    return f"H_1 = v · (1 - exp(-progress / {course:g})), 1 at the end of the campaign"
