"""Notes: what reading, preparing and checking have to say, and the codes of all warnings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol


class Coded(Protocol):
    """A code and a sentence: a note, or a warning of a stored result."""

    @property
    def code(self) -> str: ...

    @property
    def sentence(self) -> str: ...


@dataclass(frozen=True)
class Note:
    """Something the user should know; a code for programs, one of CODES, and a sentence for people.

    `rows`: the rows of the file (0-based) that it concerns, None where it concerns the whole file or
    none of its rows."""

    code: str
    sentence: str
    rows: tuple[int, ...] | None = None

    def __post_init__(self) -> None:
        if self.code not in CODES:
            raise KeyError(f"{self.code}: describe the code in modelsel.notices.CODES")


STEP_SIDE_OPEN = "step-side-open"
OUTLIERS_MANY = "outliers-many"
SETUP_MISTAKE, OTHER_ROBOT = "setup-mistake", "other-robot"
ROWS_MISTAKEN, ROWS_LATE, HOPELESS_FIT = "rows-mistaken", "rows-late", "hopeless-fit"

# Every code of a warning in result.json, and when it is given.
CODES = {
    # reading the measurements
    "file-format": "how the file is written, where that is not CSV with commas and points",
    "columns-ignored": "text columns that a measurements file does not have are ignored",
    "counters-ignored": "columns that only count the rows are ignored",
    "computed-ignored": "columns that were computed from the measured positions are ignored",
    "commanded-ignored": "commanded positions are ignored",
    "positions-ignored": "three coordinates of a position beside the one that is measured are ignored",
    "orientations-ignored": "columns that look like an orientation, and are not mapped to one, are ignored",
    "quaternion-ignored": "four columns that look like a quaternion, and are not mapped to one, are ignored",
    "uncertainties-ignored": "columns that look like uncertainties of the position, and are not mapped to them, are ignored",
    "covariates-ignored": "numeric columns that cannot serve as causes are ignored",
    "units-converted": "columns in units that a measurements file does not have (cm, gon, mrad) are converted",
    "missed-rows": "rows without a position are left out; their readings count as places that the arm went to",
    "coordinates-equal": "a few rows have one number for all three coordinates, as programs write for a missed shot",
    "duplicate-rows": "rows that repeat another cell for cell are counted once",
    "copied-rows": "rows that copy a measurement under another number are counted once",
    "joint-rests": "readings of a joint at rest flicker; that is not taken for motion",
    "coupled-joints": "the readings are of motors; the robot file's coupling makes joint angles of them",
    "board-seen": "poses of a board seen from the hand are turned into poses of the camera",
    "orders-equal": "rows of a group have the same order, but other joint readings",
    "approach-from-order": "directions of approach are taken from the order of motion",
    "approach-against-order": "directions of approach are not those of the order of motion",
    # preparing the study
    "gravity-unknown": "the robot file gives no direction of gravity; mechanisms that need it are left out",
    "cause-constant": "a cause of the study's own has one value in all rows",
    "gravity-upwards": "the robot's gravity points along +z of the measurements' frame",
    "gravity-elsewhere": "joints wind up as if gravity had another direction",
    "nothing-held-out": "every configuration estimates, none is held out",
    "held-out-near": "held-out configurations lie between estimation configurations of the same paths",
    "postures-repeated": "the arm came back to postures; readings that differ a little are taken as repeats",
    "other-session": "groups without an estimation configuration; drift is taken at the campaign's middle",
    "target-unseen": "held-out rows of a target without estimation rows are left out",
    "feature-unseen": "held-out rows of a feature without estimation rows are left out",
    "part-untold": "a part of the errors that the study names is left out: these data cannot tell it",
    "kinds-alike": "rows of different kinds are weighted alike, since no uncertainty is stated",
    "registration-weak": "the instrument's frame is known poorly from these points",
    "target-weak": "a target's offset is known poorly from these configurations",
    # checking the set-up (the alarms below)
    SETUP_MISTAKE: "a simple mistake in robot, tool, joints or units explains the positions",
    "orientation-mistake": "a simple mistake explains the measured orientations",
    "labels-swapped": "targets explain the positions better under each other's names",
    "targets-mistaken": "two targets have one name, or a target is not on the flange",
    OTHER_ROBOT: "another built-in robot explains the positions better",
    "rows-shifted": "positions belong to the readings of neighbouring rows",
    ROWS_MISTAKEN: "a simple mistake in the data explains the rows from some row on",
    ROWS_LATE: "along lines without a clock, positions seem to belong to other moments than readings; no cause is looked for",
    "noise-stated-twice": "the noise is stated by the file, by a floor or by an instrument's figures: the first of these is used",
    "stated-uncertainty": "the model leaves another noise than the stated uncertainties",
    "floor-unlike": "the model leaves much more noise than repeats or target pairs show",
    "beyond-tolerance": "the parameters are larger than an assembled arm's",
    HOPELESS_FIT: "the chosen model explains the positions badly",
    # selection and naming
    "candidates-restricted": "the study's list of candidates leaves out registered mechanisms",
    "candidates-untested": "a listed candidate needs what the measurements do not say",
    "base-worse-than-nominal": "the base model is worse than the nominal one on held-out rows",
    "scan-of-some": "causes were looked for in a part of the estimation rows, drawn by the seed",
    "cv-not-estimable": "a model cannot be estimated without one of the folds; its cv_rms_mm is null",
    "fit-unsettled": "a model of the ladder was not fitted to its minimum, which is far from the nominal arm",
    "table-differs": "the table of subsets chooses another model than naming",
    "search-unproven": "the best subset found by BIC is not proven to be the best",
    STEP_SIDE_OPEN: "held-out rows lie between the estimation rows that a step lies between",
    OUTLIERS_MANY: "so many rows are left out as outliers that they may be what the arm does there",
    "held-out-against": "held-out rows speak against a finding",
    "held-out-surprise": "held-out errors are larger than cross-validation promises",
    "held-out-far": "a few held-out rows err far more than any does in cross-validation",
    "map-of-neighbours": "the whole error map is too large; unregistered causes were looked for in part of it",
    "instrument-place": "a finding depends on the distance from an instrument that may stand elsewhere",
    "payload-places": "findings have the payload hang at the target and elsewhere; none of them is claimed as a cause",
    "payload-elsewhere": "a joint that yields under a payload elsewhere than at the target would explain clearly more",
    "confounded": "a finding depends on a column that went with the sessions or with time",
    "lone-posture": "one posture alone tells a finding: an error of that posture would look the same",
    "uneven-noise": "an effect is not named because uneven or shared noise would explain it too",
    "lack-of-fit": "the chosen model leaves clearly more, or less, than the noise floor",
    "limit-below-left": "more is left than the noise explains, in a form no single cause has",
    "readings-rounded": "joint readings are multiples of a coarse step: rounding to it would be a good part of the noise",
    # uncertainty
    "errors-differ": "standard errors of a parameter differ between their methods",
    "residuals-together": "residuals are correlated within groups: errors last between configurations",
    "unconverged": "the sampling has not converged",
}

# Codes of warnings that are shown before everything else, with the words that introduce them.
ALARMS = {
    SETUP_MISTAKE: "Check the set-up",
    "orientation-mistake": "Check the orientations",
    "labels-swapped": "Check the targets",
    "targets-mistaken": "Check the targets",
    OTHER_ROBOT: "Check the robot",
    "rows-shifted": "Check the rows",
    ROWS_MISTAKEN: "Check the rows",
    OUTLIERS_MANY: "Check the outliers",
    "stated-uncertainty": "Check the uncertainties",
    "floor-unlike": "Check the noise floor",
    "beyond-tolerance": "Check the robot",
    "instrument-place": "Check the instrument",
    "gravity-upwards": "Check the direction of gravity",
    "gravity-elsewhere": "Check the direction of gravity",
    HOPELESS_FIT: "Check the fit",
}
# faults of the data, each with the alarm that says as much
ALARM_OF_FAULT = {"swapped-reflectors": "labels-swapped", "row-order": "rows-shifted"}
# alarms that do not explain why a fit is bad
NOISE_CODES = {
    OUTLIERS_MANY,
    "stated-uncertainty",
    "floor-unlike",
    "gravity-upwards",
    "gravity-elsewhere",
}


def list_alarms(notes: Sequence[Coded]) -> list[str]:
    """List the sentences that are shown before everything else, in the order of ALARMS; a hopeless
    fit is the verdict's own first sentence."""
    sentences = []
    for code, lead in ALARMS.items():
        if code == HOPELESS_FIT:
            continue
        sentences += [f"{lead}: {note.sentence}" for note in notes if note.code == code]
    return sentences
