"""What to do about a finding, in one line: adjust, replace, model or measure; and what it is worth.

It speaks of what moves and never says which part is to blame: that the data do not tell."""

from __future__ import annotations

from math import inf
from typing import NamedTuple

from ...diagnosis.candidates.fault_kinds import FaultKind
from ...diagnosis.candidates.signatures import LEVELS
from ...diagnosis.findings.claim_sentences import name_drivers
from ...exceptions import one_line, sentence_list
from ...measurements.campaign.state_names import parse_state_name
from ...mechanisms.compliance import PAYLOAD
from ...mechanisms.instrument import MISREADINGS
from ...selection.gain import Change
from ...setup.registration import MIN_CONFIGURATIONS
from ..schemas.finding_schema import EntryRecord, FindingRecord
from ..schemas.schema import StudyRecord
from .study_sentences import format_gain

MODEL, ADJUST, MEASURE, REPLACE = "Model", "Adjust", "Measure", "Replace"
# effects of the instrument, its set-up or the target: nothing of them belongs in a controller
SET_UP = ("tracker-drift", "tracker-step", "target-step", *MISREADINGS)
LARGE = "larger than usual"
CONTRARY = "has the other sign"


class Advice(NamedTuple):
    """What to do (one of the four words), how, and what it changes of the held-out rms error; None
    where nothing is held out."""

    action: str
    how: str
    change: Change | None

    @property
    def sentence(self) -> str:
        """The line."""
        return f"{self.action}: {self.how}."

    @property
    def worth(self) -> str:
        """The fall of the error in figures with its unit; a dash where undefined."""
        change = self.change
        if change is None:
            return "–"
        text = f"{format_gain(change.fall)} {change.unit}"
        if change.interval is None:
            return text
        low, high = map(format_gain, change.interval)
        return f"{text} ({low} to {high})"


_ANGLE = (MODEL, "correct it over the angle of {joint}; that holds until the joint is taken apart")
_LOAD = (
    MODEL,
    "correct it over the joint angles, under the load that was measured; for other loads, record payload_kg and measure again",
)
_HELD = (
    MODEL,
    "correct it over the joint angles and the payload, with payload_kg in every plan that is corrected",
)
_WARM = (MODEL, "with the temperature measured along, or calibrate and work at one temperature")
_INSTRUMENT = (
    MEASURE,
    "again with the set-up checked; it is not an error of the arm, so leave it out of the controller",
)
_INSTRUMENT_ANGLE = (
    MEASURE,
    "in both faces of the instrument, which shows it; have it compensated, and leave this out of the controller",
)
_PLAY = (
    ADJUST,
    "take up the play of {joint} if it can be, or approach every pose from one side; a model needs that side",
)
_STILL = (
    MEASURE,
    "again with a longer rest before each reading; adjust the servo of {joint} if it stays",
)
BY_STEM = {
    "gear-eccentricity": _ANGLE,
    "encoder-eccentricity": _ANGLE,
    "gear-ripple": _ANGLE,
    "axis-wobble": _ANGLE,
    "encoder-scale": (
        ADJUST,
        "the scale of {joint} in the controller where it can be set, else model it",
    ),
    "slide-scales": (
        ADJUST,
        "the scales of the slides in the controller where they can be set, else model them",
    ),
    "wrist-coupling": (
        ADJUST,
        "the coupling of {joint} in the controller where it can be set, else model it",
    ),
    "joint2-twist": _LOAD,
    "joint3-twist": _LOAD,
    "gravity-twist": _LOAD,
    "joint-compliance": _LOAD,
    "lateral-compliance": _LOAD,
    "link-bending": _LOAD,
    "payload-deflection": _LOAD,
    "payload-bending": _LOAD,
    "payload-tilt": _LOAD,
    "tool-droop": _LOAD,
    "tool-stretch": _LOAD,
    "payload-droop": _LOAD,
    "payload-shift": (
        MODEL,
        "with payload_kg measured along, or give each gripper a target offset of its own",
    ),
    "tool-play": (
        ADJUST,
        "take up the play of the tool along the flange's axis, and measure again",
    ),
    "counterbalance": (ADJUST, "the balance of the arm where it can be set, else model it"),
    "base-tilt": (ADJUST, "make what the base stands on firmer where it can be, else model it"),
    "base-rocking": (ADJUST, "hold the base fast on what it stands on, and measure again"),
    "backlash": (
        ADJUST,
        "take up the play of {joint} if it can be; until then the model predicts it from the joint angles",
    ),
    "approach-backlash": _PLAY,
    "overshoot": _STILL,
    "settle": _STILL,
    "servo-lag": (
        ADJUST,
        "the servo of {joint}, or measure with the arm at rest; the angles that it should reach do not predict it",
    ),
    "thermal-growth": _WARM,
    "thermal-expansion": _WARM,
    "thermal-zero": _WARM,
    "thermal-shift": _WARM,
    "zero-step": (
        ADJUST,
        "set the zero of {joint} anew, find out what moved it, and measure again",
    ),
    "target-step": (MEASURE, "again with the target fixed; leave it out of the controller"),
    "tracker-drift": _INSTRUMENT,
    "tracker-step": _INSTRUMENT,
    "tracker-scale": _INSTRUMENT,
    "tracker-axes": _INSTRUMENT,
    "tracker-range": _INSTRUMENT,
    "tracker-azimuth": _INSTRUMENT_ANGLE,
    "tracker-zenith": _INSTRUMENT_ANGLE,
    "tracker-index": _INSTRUMENT_ANGLE,
    "tracker-transit": _INSTRUMENT_ANGLE,
    "tracker-collimation": _INSTRUMENT_ANGLE,
    "tracker-offset": _INSTRUMENT_ANGLE,
    "tracker-errors": _INSTRUMENT_ANGLE,
    "reflector-incidence": (
        MEASURE,
        "again with the reflector turned towards the instrument; leave it out of the controller",
    ),
    "refraction": _INSTRUMENT,
}
_ONE_TARGET = (
    MEASURE,
    "again with target {target} fixed; or give it another name in the file from there on",
)
_SOME_TARGETS = (
    MEASURE,
    "again with targets {target} fixed; or give them other names in the file from there on",
)
_FAULT = (MEASURE, "the rows that it concerns again, or correct them in the file")
_TWO_PLACEMENTS = (
    MODEL,
    'each placement as a group of its own, with register = "per group"; find what moved',
)
# faults that concern all rows: to measure these again, something has to be done otherwise
_OF_ALL_ROWS = {
    FaultKind.READ_TOO_EARLY.label: (
        MEASURE,
        "again with the arm at rest when joints are read and targets measured; if joints were read too early, commanded angles may stand in for the readings; leave it out of the controller",
    ),
    FaultKind.TIME_OFFSET.label: (
        MEASURE,
        "again with positions and joint readings of the same moments, or shift the times of the one in the file",
    ),
}
_DOUBTFUL = (
    MEASURE,
    "more configurations before anything is done; held-out ones do not confirm it",
)
_RIVALS = (
    MEASURE,
    "what tells its rivals apart before {joints} touched; the model corrects it meanwhile",
)
_UNNAMED = (
    MODEL,
    "correct it by the model, but have a look at what moves: no registered mechanism describes it",
)
_OF_A_PLUGIN = (MODEL, "correct it by the model, but have a look at what moves")
_CONTRARY = (MODEL, "correct it over the joint angles; no play or spring of {joint} explains it")
_CAUSE_OPEN = (
    MODEL,
    "correct it by the model, and adjust or replace nothing yet: why it does this is not proven",
)
_INSPECT = (
    REPLACE,
    "what inspection finds worn or loose at {joint}, being larger than usual; until then model it",
)
# whose size tells of wear where it is larger than usual
WEARING = (
    "gear-eccentricity",
    "encoder-eccentricity",
    "gear-ripple",
    "axis-wobble",
    "backlash",
    "approach-backlash",
)


def advise(record: StudyRecord, finding: FindingRecord) -> Advice:
    """Advise what to do about a finding, and tell what its model is worth on held-out rows."""
    action, how = _choose(record, finding)
    places = _name_places(finding)
    joint = sentence_list(places) if places else "the joint concerned"
    is_several = len(places) > 1 or joint.startswith("joints")
    verb = "are" if is_several else "is"
    _, _, target = (finding.fitted_entry.mechanism or "").partition(":")
    sentence = how.format(joint=joint, joints=f"{joint} {verb}", target=one_line(target))
    return Advice(action, sentence, finding.gain.told)


def _choose(record: StudyRecord, finding: FindingRecord) -> tuple[str, str]:
    """Choose the action and how, the joint left open."""
    fitted = finding.fitted_entry
    name = fitted.mechanism or ""
    stem, _, _ = name.partition(":")
    if fitted.is_fault:
        return _choose_for_fault(record, finding)
    if finding.doubtful:
        return _DOUBTFUL
    claim = finding.claim
    is_place_alone = claim is not None and claim.level == LEVELS[0]
    if not finding.is_found or is_place_alone:
        return _INSTRUMENT if stem in SET_UP else _RIVALS
    return _choose_by_name(record, finding, stem)


def _choose_for_fault(record: StudyRecord, finding: FindingRecord) -> tuple[str, str]:
    """Choose what to do about a fault of the data: a long stretch is not measured again."""
    name = finding.fitted_entry.mechanism or ""
    if name in _OF_ALL_ROWS:
        return _OF_ALL_ROWS[name]
    if name == FaultKind.TRACKER_BUMPED.label and _parts_placements(record, finding):
        return _TWO_PLACEMENTS
    return _FAULT


def _parts_placements(record: StudyRecord, finding: FindingRecord) -> bool:
    """Return whether the rows before a bump and those after it are enough for a placement each."""
    counts = record.configurations
    estimation = counts.estimation_rows
    concerned = finding.rows or []
    rows = len(estimation)
    after = len(concerned)
    before = rows - after
    fewer = min(after, before)
    least = MIN_CONFIGURATIONS * rows
    return fewer * counts.estimation >= least > 0


def _choose_by_name(record: StudyRecord, finding: FindingRecord, stem: str) -> tuple[str, str]:
    """Choose what to do about what the data single out."""
    fitted = finding.fitted_entry
    noted = [one.catalogue for one in record.significance if one.mechanism == fitted.mechanism]
    if any(CONTRARY in note for note in noted):
        return _CONTRARY
    if finding.is_name_open and stem and stem not in SET_UP:
        return _CAUSE_OPEN
    if stem in WEARING and any(LARGE in note for note in noted):
        return _INSPECT
    if stem not in BY_STEM and all(screw.is_free for screw in fitted.screws):
        return MODEL, _correct_over_drivers(fitted)
    if stem == "target-step" and fitted.mechanism != stem:
        places = {(screw.frame, screw.axis) for screw in fitted.screws}
        # each of several targets has screws of its own at these
        return _ONE_TARGET if len(places) == len(fitted.screws) else _SOME_TARGETS
    unlisted = _OF_A_PLUGIN if stem else _UNNAMED
    chosen = BY_STEM.get(stem, unlisted)
    is_held = any(PAYLOAD in screw.cause for screw in fitted.screws)
    return _HELD if is_held and chosen == _LOAD else chosen


def _correct_over_drivers(fitted: EntryRecord) -> str:
    """Return that a free function is to be corrected over what drives it, whatever frame it moves."""
    names = {screw.free_driver for screw in fitted.screws}
    drivers = name_drivers(names)
    how = f"correct it over {drivers}"
    for name in names:
        variable = parse_state_name(name)
        if variable is None:
            return how
        if variable.joint is None:
            return how
    joint = "a joint is"
    if len(names) == 1:
        joint = "the joint is"
    return f"{how}; that holds until {joint} taken apart"


def _name_places(finding: FindingRecord) -> list[str]:
    """Name what a finding moves: the base, then its joints (joint 3, joints 2 and 3), then the target."""
    frames = list_frames(finding)
    count = _count_joints(finding)
    joints = [str(frame) for frame in frames if 1 <= frame <= count]
    places = []
    if 0 in frames:
        places.append("the base")
    if joints:
        word = "joint" if len(joints) == 1 else "joints"
        places.append(f"{word} {sentence_list(joints)}")
    if any(frame > count for frame in frames):
        places.append("the target")
    return places


def _count_joints(finding: FindingRecord) -> float:
    """Count the arm's joints where the finding says how they stand; any number where it does not."""
    for place in (finding.worst, finding.turning):
        if place is not None:
            return len(place.joints_deg)
    return inf


def list_frames(finding: FindingRecord) -> list[int]:
    """Return the frames that a finding moves, in their order; 0 for what stands before the arm, as its
    base and the instrument."""
    fitted = finding.fitted_entry
    stem, _, _ = (fitted.mechanism or "").partition(":")
    if stem in SET_UP and stem != "target-step":
        return [0]
    frames = sorted({screw.frame for screw in fitted.screws})
    return [0] if fitted.is_fault and frames == [1] else frames
