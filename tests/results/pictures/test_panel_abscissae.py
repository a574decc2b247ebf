"""What a finding is drawn against: the quantity that it depends on, in words and with its unit."""

from __future__ import annotations

import numpy as np
import pytest

from modelsel.mechanisms.causes import Applied, Cause, Named, Number, q, sign
from modelsel.results.pictures.panel_abscissae import choose_abscissa

UNITS = {"progress": "1", "time_s": "s", "move6": "rad", "move2": "rad", "torque2": "N m"}
PROGRESS = Named("progress")
STEP = (sign(PROGRESS - Number(0.395)) + 1.0) / 2.0
APPROACH, MOVE = Named("approach6"), Named("move6", "rad")
CREEP = APPROACH * Applied("tanh", MOVE / 0.4089)
WARMING = Applied("exp", Named("time_s", "s") / -3705.0)


def choose(cause: Cause):
    return choose_abscissa(cause, [cause], UNITS)


@pytest.mark.parametrize(
    ("cause", "words", "unit"),
    [
        (STEP, "course of the campaign", "%"),
        (CREEP, "last move of joint 6, with its direction", "deg"),
        (WARMING, "time_s", "s"),
        (Applied("abs", Named("torque2", "N m")), "gravity torque about joint 2", "N m"),
        (q(4) * q(4), "q4", "deg"),
        (Named("drag4_45", "rad"), "how far joint 4 is ahead of what it drags along", "deg"),
        (Named("payload_kg", "kg") * q(4), "payload_kg*q4", "kg rad"),
        (APPROACH * Named("move2", "rad"), "approach6*move2", "deg"),
    ],
)
def test_axis_is_the_quantity_with_its_unit(cause: Cause, words: str, unit: str) -> None:
    units = UNITS | {"q4": "rad", "payload_kg": "kg"}
    abscissa = choose_abscissa(cause, [cause], units)
    assert (abscissa.words, abscissa.unit) == (words, unit)


def test_a_step_of_the_campaign_is_drawn_as_a_step() -> None:
    """It was a sloping line between 0 and 1."""
    abscissa = choose(STEP)
    course = np.array([0.0, 0.394, 0.396, 1.0])
    assert abscissa.evaluate(STEP, course).tolist() == [0, 0, 1, 1]
    assert (abscissa.scale * course).tolist() == [0, 39.4, 39.6, 100]


def test_a_directed_move_is_evaluated_on_either_side() -> None:
    abscissa = choose(CREEP)
    moves = np.array([-0.5, -0.1, 0.2])
    assert abscissa.evaluate(CREEP, moves) == pytest.approx(np.tanh(moves / 0.4089))
    state = {"approach6": np.sign(moves), "move6": np.abs(moves)}

    class State:
        def value(self, name: str) -> np.ndarray:
            return state[name]

    assert abscissa.variable.of(State()) == pytest.approx(moves)
