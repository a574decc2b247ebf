"""Every public name of the Python API with plausible slips: swapped arguments, a path for an object,
one for a list, an array of another shape. Each ends in one sentence that says what was expected."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from builders import OFF_AXIS, small_arm, small_campaign

import modelsel as ms
from modelsel.mechanisms import Mechanism, Named, Screw, Term, cos, every, q, sign, sin, torque
from modelsel.mechanisms import with_plugins as plugins
from modelsel.testing import LawBroken, check_mechanism

ARM = small_arm()
TOOLS = np.array([OFF_AXIS])


@pytest.fixture(scope="module")
def things() -> SimpleNamespace:
    """One of everything that a user has in hand."""
    at, frame, study = small_campaign()
    geometry = ms.mechanism("geometric", ARM)
    result = ms.run_study(study, sampling=False)
    model = ms.Model((geometry,))
    return SimpleNamespace(
        problem=at,
        data=at.data,
        frame=frame,
        study=study,
        result=result,
        calibration=result.calibration,
        geometry=geometry,
        model=model,
        fit=ms.fit(at, model),
    )


def refused(act: Callable[[], object]) -> str:
    """The one sentence, or two, with which a call is refused."""
    with pytest.raises((ms.ModelselError, LawBroken)) as error:
        act()
    said = str(error.value)
    assert "\n" not in said
    assert len(said) < 300
    return said


Things = Any
Act = Callable[[Things], object]
RNG = np.random.default_rng(1)
SLIPS: Mapping[str, list[tuple[Act, str]]] = {
    "fit": [
        (lambda t: ms.fit(ARM, t.model), "problem: expected a Problem, as Problem(robot"),
        (lambda t: ms.fit(t.model, t.problem), "problem: expected a Problem"),
        (lambda t: ms.fit(t.data, t.model), "problem: expected a Problem"),
        (lambda t: ms.fit(t.frame, t.model), "found pandas.DataFrame."),
        (lambda t: ms.fit(t.problem, t.geometry), "model: expected a Model"),
        (lambda t: ms.fit(t.problem, t.model, start=[0.0]), "start has shape (1,); expected (21,)"),
        (lambda t: ms.fit(t.problem, t.model, start="x"), "start: expected one number for each"),
        (lambda t: ms.fit(t.problem, t.model, precision=3), "precision has shape ()"),
        (lambda t: ms.fit(t.problem, t.model, iterations="3"), "iterations: expected a whole"),
        (lambda t: ms.fit(t.problem, t.model, step_mm=None), "step_mm: a number is not finite"),
        (lambda t: ms.fit(t.problem, t.model, held=None), 'held: expected "geometry", "all"'),
    ],
    "compare": [
        (lambda t: ms.compare(t.data, {"a": t.model}), "problem: expected a Problem"),
        (lambda t: ms.compare(t.problem, t.model), "models: expected models by name"),
        (lambda t: ms.compare({"a": t.model}, t.problem), "problem: expected a Problem"),
    ],
    "diagnose": [
        (lambda t: ms.diagnose(t.data), "problem: expected a Problem"),
        (lambda t: ms.diagnose(t.problem, registry=None), "registry: expected a registry, as {**"),
        (lambda t: ms.diagnose(t.problem, registry=["backlash"]), "registry: expected a registry"),
        (lambda t: ms.diagnose(t.problem, options={"max_rows": 3}), "options: expected"),
        (lambda t: ms.diagnose(t.problem, progress="yes"), "progress: expected True or False"),
        (lambda t: ms.diagnose(t.problem, progress=t.frame), "progress: expected True or False"),
    ],
    "Problem": [
        (lambda t: ms.Problem(t.data, ARM, TOOLS), "robot: expected a Robot"),
        (lambda t: ms.Problem(ARM, "measurements.csv", TOOLS), "data: expected Measurements"),
        (lambda t: ms.Problem(ARM, t.data, {"x": 1}), "tools: expected numbers"),
        (lambda t: ms.Problem(ARM, t.data, TOOLS, None), "placement: expected R (groups, 3, 3)"),
        (lambda t: ms.Problem(ARM, t.data, TOOLS, [1, 2]), "placement[0] has shape ()"),
        (lambda t: ms.Problem(ARM, t.data, TOOLS, np.eye(4)), "placement: expected R (groups"),
        (
            lambda t: ms.Problem(ARM, t.data, TOOLS, (np.eye(3), np.zeros(3))),
            "placement[0] has shape (3, 3); expected (1, 3, 3)",
        ),
        (lambda t: ms.Problem(ARM, t.data, TOOLS, tracker=0.0), "tracker has shape ()"),
        (lambda t: ms.Problem(ARM, t.data, TOOLS, whitening=0.02), "whitening: expected"),
        (lambda t: t.problem.take("estimation"), "rows: expected a mask of the 40 rows"),
        (lambda t: t.problem.take(t.frame), "rows: expected a mask of the 40 rows"),
        (lambda t: t.problem.take(np.ones(39, bool)), "rows: expected a mask of the 40 rows"),
    ],
    "Model": [
        (lambda t: ms.Model(t.geometry), 'as (mechanism("geometric", robot),), found Mechanism.'),
        (lambda t: ms.Model("geometric"), "robot),), found 'geometric'."),
        (lambda t: ms.Model(["geometric"]), "found 'geometric' in it."),
        (lambda t: ms.Model(None), "robot),), found None."),
        (lambda t: ms.Model(t.model), "robot),), found Model."),
    ],
    "mechanism": [
        (lambda t: ms.mechanism(ARM, "geometric"), "name: expected a mechanism's name"),
        (lambda t: ms.mechanism("geometric", t.problem), "expected a built-in robot's name"),
        (lambda t: ms.mechanism("geometric", ARM, None), "registry: expected a registry"),
        (lambda t: ms.mechanism("geometric", ARM, ["geometric"]), "registry: expected a registry"),
        (lambda t: every(3), "expected a built-in robot's name or the path"),
        (lambda t: every(t.data), "expected a built-in robot's name or the path"),
        (lambda t: every(ARM, None), "registry: expected a registry"),
        (lambda t: plugins(ARM), "registry: expected a registry"),
    ],
    "Mechanism": [
        (lambda t: Mechanism("a", t.geometry.terms[0]), "terms: expected a list of terms, as (T"),
        (lambda t: Mechanism(t.geometry.terms, "a"), "name: expected the mechanism's name"),
        (lambda t: Mechanism("a", ("k",)), "found 'k' in it."),
        (lambda t: Term("k", Screw(1, "rz")), "screws: expected a list of screws, as (Screw(3"),
        (lambda t: Screw("2", "rz"), "no such place: frame '2', axis rz; frames count from 1"),
        (lambda t: Screw("rz", 2), "no such place: frame 'rz', axis 2"),
        (lambda t: Screw(2, None), "no such place: frame 2, axis None"),
        (lambda t: Screw(2, "rz", "q1"), "cause: expected a cause, such as q(2)"),
        (lambda t: q("2"), "joint: expected a whole number from 1 on, found '2'."),
        (lambda t: q(ARM), "joint: expected a whole number"),
        (lambda t: torque(0), "joint: expected a whole number from 1 on, found 0."),
        (lambda t: Named(3), "name: expected a value's name, such as payload_kg, found 3."),
        (lambda t: sin("q2"), "cause: expected a cause, such as q(2) or Named"),
        (lambda t: cos(None), "cause: expected a cause"),
        (lambda t: sign(t.geometry), "cause: expected a cause"),
        (lambda t: q(1) + "q2", "cause: expected a cause"),
        (lambda t: None * q(1), "cause: expected a cause"),
    ],
    "check_mechanism": [
        (lambda t: check_mechanism(ARM, t.geometry, RNG), "robot: expected a Robot"),
        (lambda t: check_mechanism(t.geometry, "puma760", RNG), "robot: expected a Robot"),
        (lambda t: check_mechanism(t.geometry, ARM, 0), "rng: expected a generator, as np.random"),
        (lambda t: check_mechanism("geometric", ARM, RNG), "a Mechanism was expected"),
    ],
    "read_measurements": [
        (lambda t: ms.read_measurements(t.frame, 3), "robot: expected a Robot, the name of a"),
        (lambda t: ms.read_measurements(t.frame, None), "robot: expected a Robot"),
        (lambda t: ms.read_measurements(t.frame, ["a", "b"]), "robot: expected a Robot"),
        (lambda t: ms.read_measurements(t.frame, t.study), "robot: expected a Robot"),
        (
            lambda t: ms.read_measurements(ARM, t.frame),
            "whether it slides, found pandas.DataFrame.",
        ),
        (lambda t: ms.read_measurements(t.frame, ARM, t.frame), "measurements.columns: expected"),
    ],
    "split_configurations": [
        (
            lambda t: ms.split_configurations(t.data, 20, ARM, 1),
            "prismatic: expected for each joint whether it slides, as robot.prismatic, found Robot.",
        ),
        (lambda t: ms.split_configurations(t.data, 20, None, 1), "prismatic: expected for each"),
        (
            lambda t: ms.split_configurations(t.data, 20, (False, False), 1),
            "prismatic has 2 values; expected 3, one for each joint",
        ),
        (lambda t: ms.split_configurations(t.frame, 20, ARM.prismatic, 1), "data: expected Meas"),
        (lambda t: ms.split_configurations(t.problem, 20, ARM.prismatic, 1), "data: expected Mea"),
        (lambda t: ms.split_configurations(20, t.data, ARM.prismatic, 1), "data: expected Meas"),
    ],
    "studies": [
        (
            lambda t: ms.run_study(t.study, 3),
            "expected the folder of the study's files, found int.",
        ),
        (lambda t: ms.rehearse_study(t.study, t.frame), "expected the folder of the study's files"),
        (lambda t: ms.rehearse_study(t.study, registry=3), "registry: expected a registry"),
        (lambda t: ms.simulate_study(t.study, 3), "expected the folder of the study's files"),
        (lambda t: ms.simulate_study(ARM), "expected a Study, or the path of a study file"),
        (lambda t: ms.run_study(t.study, say=3), "say: expected a function that takes a line"),
    ],
    "plan_next": [
        (lambda t: ms.plan_next(t.study), "result: expected a Result"),
        (lambda t: ms.plan_next(t.calibration), "result: expected a Result"),
        (lambda t: ms.plan_next(t.result, "3"), "count: expected a whole number"),
        (lambda t: ms.plan_next(t.result, 3, limits=[-1, 1]), "limits: expected True or False"),
        (lambda t: ms.plan_next(t.result, 3, purpose=t.frame), "purpose: expected the name of a"),
        (lambda t: ms.plan_next(t.result, 3, joints=t.frame), "joints: expected ranges by name"),
    ],
    "Calibration": [
        (lambda t: t.calibration.problem(t.frame), "data: expected Measurements, as read_meas"),
        (lambda t: t.calibration.export("json", urdf=3), "expected the path of a URDF file"),
        (lambda t: t.calibration.save(None), "expected the folder that calibration.json is"),
        (lambda t: t.calibration.predict(None), "measurements: expected a file"),
        (lambda t: t.calibration.correct(ARM), "measurements: expected a file"),
    ],
    "Result": [
        (lambda t: t.result.to_frame(t.frame), "table: expected the name of a table"),
        (lambda t: t.result.save(None), "expected the folder that the result is written into"),
        (lambda t: t.result.report(3), "expected the folder that the result is written into"),
        (lambda t: t.result.report(Path("x"), say="loud"), "say: expected a function that takes"),
    ],
    "Fit": [
        (lambda t: t.fit.residuals(t.data), "problem: expected a Problem"),
        (lambda t: t.fit.residuals(None), "problem: expected a Problem"),
    ],
    "Robot": [
        (lambda t: ARM.draw(3, RNG), "rng: expected a generator, as np.random.default_rng(0)"),
        (lambda t: ARM.draw(RNG, "3"), "m: expected a whole number from 0 on, found '3'."),
    ],
}
EACH = [
    pytest.param(act, says, id=f"{name}-{k}")
    for name, slips in SLIPS.items()
    for k, (act, says) in enumerate(slips)
]


@pytest.mark.parametrize(("act", "says"), EACH)
def test_a_slip_is_told_in_a_sentence(things, act, says) -> None:
    assert says in refused(lambda: act(things))


def test_lists_of_parts_are_taken_as_tuples(things) -> None:
    """A list is what one writes first; the value is the same, and has a hash."""
    assert ms.Model([things.geometry]) == things.model
    term = things.geometry.terms[0]
    assert Term(term.symbol, list(term.screws), term.size, usual=term.usual) == term
    one = Mechanism("one", [term])
    assert hash(one) == hash(Mechanism("one", (term,)))
    assert Screw(2, "rz", 1) == Screw(2, "rz")
    assert every("PUMA 760")[0].name == every(ms.load_robot("puma760"))[0].name


def test_a_start_may_be_a_list(things) -> None:
    theta = things.fit.theta
    again = ms.fit(things.problem, things.model, start=theta.tolist())
    assert again.theta == pytest.approx(theta, abs=1e-6)
