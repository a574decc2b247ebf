"""Waves of a slide's own reading: a screw's pitch, a rack's teeth, a rail that is not straight."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...exceptions import write_rounded
from ...fitting.problem import Problem
from ...mechanisms.causes import cos, q, sin
from ...mechanisms.terms import Mechanism, Screw, Term

# waves over a slide's travel
PITCHES = tuple(k / 8 for k in range(4, 481))
# the same across the slide: less than one is its bow
CROOKED = tuple(count for count in PITCHES if 1 <= count <= 30)
SLIDE_AXES = {"tz": PITCHES, "tx": CROOKED, "ty": CROOKED}
# usual leads of screws and modules of racks [mm], which are looked for where more waves of them than
# that are over the travel
SCREWS = (1, 2, 2.5, 3, 4, 5, 6, 8, 10, 12, 15, 16, 20, 25, 25.4, 30, 32)
MODULES = (1, 1.5, 2, 2.5, 3, 4, 5, 6, 8)
LEADS = (*SCREWS, *(np.pi * module for module in MODULES))
# prior weight of each where eighths of a wave are offered; a cell has 1
OF_EIGHTH = 1 / 8


def generate_pitch_waves(problem: Problem) -> Iterator[tuple[Mechanism, float]]:
    """Generate waves of every slide's own reading, half to 60 over the measured travel, and their
    prior weights.

    They stand for a screw's pitch, a rack's teeth, a scale's joints; across the slide, one to 30 stand
    for a rail that is not straight. Of shorter ones those of usual screws and racks are offered.

    The travel is no multiple of their length, so that eighths of a wave are offered, with an eighth
    of the weight each."""
    for j, joint in enumerate(problem.robot.joints, 1):
        if not joint.prismatic:
            continue
        readings = problem.data.q[:, j - 1]
        travel = float(np.ptp(readings))
        if travel <= 0:
            continue
        for axis, counts in SLIDE_AXES.items():
            for count in counts:
                yield build_pitch_wave(j, count, travel, axis), OF_EIGHTH
        for lead in LEADS:
            count = travel / lead
            if count > PITCHES[-1]:
                yield build_pitch_wave(j, count, travel), 1.0


def build_pitch_wave(joint: int, count: float, travel: float, axis: str = "tz") -> Mechanism:
    """Build a wave of a slide's own reading, `count` over its measured `travel` [mm], along the slide
    or, by another axis, across it."""
    factor = float(f"{2 * np.pi * count / travel:.6g}")
    angle = factor * q(joint, "mm")
    sine = Screw(joint, axis, sin(angle))
    cosine = Screw(joint, axis, cos(angle))
    terms = (Term("ms", (sine,)), Term("mc", (cosine,)))
    length = travel / count
    every = f"a wave every {write_rounded(length)} mm"
    sentence = f"Joint {joint} slides unevenly, {every}"
    causes: tuple[str, ...] = ("pitch of the screw", "teeth of the rack", "joints of the scale")
    if axis != "tz":
        sentence = f"Joint {joint} does not slide straight: {every} along the {axis[1]} axis of frame {joint}"
        causes = ("rail that is bent", "joints or bolts of the rail")
    name = f"{joint} {axis} wave of q{joint} every {length:.5g} mm"
    return Mechanism(name, terms, sentence, usual_causes=causes)
