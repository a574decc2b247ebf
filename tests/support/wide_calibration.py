"""A calibration with a bit of everything, fitted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from builders import drawn, planted

from modelsel.calibration.calibration import Calibration, calibrate
from modelsel.calibration.refitting import refit_forms
from modelsel.fitting.design import Model
from modelsel.fitting.least_squares import fit
from modelsel.fitting.noise import Floor
from modelsel.fitting.problem import Problem
from modelsel.fitting.whitening import Whitening
from modelsel.mechanisms.causes import Bump, Member, Named, cos, q, sign
from modelsel.mechanisms.registry import mechanism
from modelsel.mechanisms.terms import Mechanism, Screw, Term
from modelsel.robot.files import load_robot
from modelsel.selection.evaluation import Split


def wide(rng: np.random.Generator) -> tuple[Calibration, Problem]:
    """Two targets, two placements, free functions, derived causes, covariates, drift: a bit of
    everything, fitted."""
    robot = load_robot("puma760")
    terms = tuple(Term(f"f{k}", (Screw(3, "rz", Bump("q3", 0.4 * k, 0.4)),)) for k in range(-3, 3))
    offsets = tuple(
        Term(f"o{a}{t}", (Screw(7, a, Member("target", t)),))
        for t in range(2)
        for a in ("tx", "ty", "tz")
    )
    odd = Mechanism(
        "odd",
        (
            Term(
                "k",
                (Screw(4, "rx", sign(cos(q(2) + q(3))) * (Named("temperature_C", "°C") - 20.0)),),
            ),
            Term("v", (Screw(1, "tz", Named("progress")),)),
        ),
    )
    model = Model(
        (
            Mechanism("offsets", offsets),
            mechanism("geometric", robot),
            mechanism("joint-compliance:2", robot),
            mechanism("approach-backlash:3", robot),
            mechanism("refraction", robot),
            Mechanism("free(q3)", terms),
            odd,
        )
    )
    at = drawn(robot, rng, 150, target=["a", "b"] * 75, group=["mon"] * 80 + ["tue"] * 70)
    at = replace(
        at,
        tools=np.array([[30.0, 0, 90], [0, 40.0, 120]]),
        placement=(np.tile(np.eye(3), (2, 1, 1)), np.array([[1.0, 2, 3], [4.0, 5, 6]])),
        whitening=Whitening(50.0),
    )
    theta = np.array(
        [
            1e-4 * (1 if s[0].axis[0] == "r" else 100) / max(1, np.abs(s[0].cause.of(at)).max())
            for s in (t.screws for t in model.terms)
        ]
    )
    at = planted(at, model.terms, theta, rng, 0.02)
    found = fit(at, model)
    every_row = np.ones(len(at), bool)
    data = Split(at, every_row, ~every_row, np.zeros(len(at), np.intp), True)
    made = calibrate("wide", data, found, Floor(0.02, "stated"), None, True, {})
    return replace(made, refits=refit_forms(data, found)), at
