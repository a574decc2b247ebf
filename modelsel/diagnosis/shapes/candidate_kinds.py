"""Kinds of candidates, so that no code has to read them off a name."""

from __future__ import annotations

from enum import Enum


class CandidateKind(Enum):
    """What a candidate is: a mechanism of the registry, or one of the unregistered explanations."""

    MECHANISM = "registered mechanism"
    CELL = "cell of the error map"
    WAVE = "wave of unknown phase in a cell of the error map"
    WAVE_PRODUCT = "any product of waves of two joints"
    JOINT_WAVE = "wave of a turning joint's own angle"
    SLIDE_WAVE = "wave of a slide's own reading"
    FREE_FUNCTION = "free function of a joint's own angle"
    GROWTH = "function of a joint's own angle that grows along the campaign"
    TIME_WAVE = "slow wave along the campaign"
    COURSE = "course of a covariate in time, in its place"
    JUMP = "jump at one angle of a joint"
    RAMP = "step of a joint over a part of its range"
    BUMP = "error of a joint around one reading"
    POWER = "compliance of a joint that is not in proportion to its torque"
    PERIOD = "pattern of a joint's own angle that repeats on a turn"
    SAW = "joint that errs more and more and falls back, a whole number of times a turn"
    REACH = "power of the reach, at the base or the column that turns with it"
    PULL = "turn of a joint with its neighbour's reading beyond some angle"
    KINK = "turn of a joint in proportion to how far a reading is beyond some angle"
    WOUND = "turn of a joint with its own reading, more or less with another joint's"
    PRODUCT = "turn of a joint with the product of two joints' readings"
    SOFT_LAG = "lag of a joint behind its last move that levels off"
    FALL = "target that falls from one side to the other across the flange"
    TARGET_CELL = "shift of one target of several along an axis of the flange"
    TARGET_SHIFT = "shift of the target in any direction with a column of the data"
    DISTORTION = "smooth error of what an instrument measures"
    HYSTERESIS = "hysteresis of a joint that builds up over some way after each reversal"
    RIPPLE = "ripple of a joint in proportion to its torque or to where it stands"
    STEPPED_WAVE = "wave of a joint that is another one from some moment of the campaign on"
    MOVED_LINK = "link that stands differently from some moment of the campaign on"
    UNEVEN_BASE = "base that tilts with its load, more towards some sides than towards others"
    SHAPE = "shape that no list has, at the place of a finding or beside it"


# kinds that are cells of the error map
MAP_KINDS = (CandidateKind.CELL, CandidateKind.WAVE, CandidateKind.WAVE_PRODUCT)
# kinds whose labels are their names
NAMED_IN_FULL = (CandidateKind.DISTORTION, CandidateKind.TARGET_SHIFT, CandidateKind.MOVED_LINK)
# kinds whose causes have words of their own
NAMED_IN_WORDS = (
    CandidateKind.TIME_WAVE,
    CandidateKind.COURSE,
    CandidateKind.SLIDE_WAVE,
    CandidateKind.BUMP,
    CandidateKind.SOFT_LAG,
    CandidateKind.HYSTERESIS,
    CandidateKind.POWER,
    CandidateKind.REACH,
    CandidateKind.PULL,
    CandidateKind.KINK,
    CandidateKind.WOUND,
    CandidateKind.PRODUCT,
    CandidateKind.FALL,
    CandidateKind.RIPPLE,
    CandidateKind.STEPPED_WAVE,
    CandidateKind.UNEVEN_BASE,
)
