"""Notes: what reading, preparing and checking have to say, with the codes of all warnings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    pass


@dataclass(frozen=True)
class Note:
    """Something the user should know; a code for programs and a sentence for people."""

    code: str
    sentence: str


SETUP_MISTAKE, OTHER_ROBOT = "setup-mistake", "other-robot"
ROWS_MISTAKEN, HOPELESS_FIT = "rows-mistaken", "hopeless-fit"
# codes of what is told before everything else, with the words that lead it
ALARMS = {
    SETUP_MISTAKE: "Check the set-up",
    "orientation-mistake": "Check the orientations",
    "labels-swapped": "Check the targets",
    OTHER_ROBOT: "Check the robot",
    "rows-shifted": "Check the rows",
    ROWS_MISTAKEN: "Check the rows",
    "stated-uncertainty": "Check the uncertainties",
    "floor-unlike": "Check the noise floor",
    "beyond-tolerance": "Check the robot",
    HOPELESS_FIT: "Check the fit",
}
ALARM_OF_FAULT = {
    "swapped-reflectors": "labels-swapped",
    "row-order": "rows-shifted",
}  # a fault, and the alarm that says as much
NOISE_CODES = {
    "stated-uncertainty",
    "floor-unlike",
}  # of these, which say nothing of why a fit is bad


def list_alarms(notes: Sequence[Note]) -> list[str]:
    """What is told before everything else, in the order of ALARMS; a hopeless fit is the verdict's
    own first sentence."""
    return [
        f"{lead}: {n.sentence}"
        for code, lead in ALARMS.items()
        for n in notes
        if n.code == code and code != HOPELESS_FIT
    ]
