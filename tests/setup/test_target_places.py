"""Targets that are no place on the flange of their own: two under one name, one on the floor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import drawn, planted

from modelsel import Study, run_study
from modelsel.exceptions import DataError
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import Measurements, build_measurements
from modelsel.robot.files import load_robot
from modelsel.setup.target_places import describe_wrong_targets
from modelsel.study.drafts.nominal_misfit import describe_misfit
from modelsel.study.preparation.checks import check_setup

ROBOT = load_robot("ur10")
TARGETS = np.array([[0.0, 0, 120], [640.0, 40, 180]])
COUNT = 40


def measure(rng: np.random.Generator, names: list[str]) -> Measurements:
    """Two targets, 640 mm apart on the flange, in every posture, with noise of 0.05 mm."""
    q = np.repeat(drawn(ROBOT, rng, COUNT).data.q, 2, axis=0)
    target = [k % 2 for k in range(2 * COUNT)]
    blank = build_measurements(q, np.zeros((2 * COUNT, 3)), target=target)
    at = planted(Problem(ROBOT, blank, TARGETS), [], np.zeros(0), rng, 0.05)
    given = [names[k] for k in target]
    return build_measurements(q, at.data.position, target=given)


def test_two_targets_far_apart_are_as_they_should_be(rng) -> None:
    data = measure(rng, ["A", "B"])
    assert describe_wrong_targets(data) is None
    (said,) = describe_misfit(ROBOT, data)
    assert "the nominal arm fits to 0.0" in said


def test_two_targets_under_one_name_are_told(rng) -> None:
    data = measure(rng, ["A", "A"])
    said = describe_wrong_targets(data)
    assert said is not None
    assert "are 644 mm apart, the same distance in 40 of 40 postures (rows 0, 1" in said
    assert describe_misfit(ROBOT, data) == [said]


def test_repeats_and_an_instrument_that_was_moved_are_no_two_targets(rng) -> None:
    data = measure(rng, ["A", "A"])
    again = data.position[::2].repeat(2, axis=0)
    noisy = replace(data, position=again + rng.normal(0, 4.0, again.shape))
    assert describe_wrong_targets(noisy) is None
    shift = np.where(np.arange(len(again)) % 2, 30.0, 0.0)
    assert describe_wrong_targets(replace(data, position=again + shift[:, None])) is None


def test_a_reflector_on_the_floor_is_told_and_refused(rng) -> None:
    data = measure(rng, ["SMR", "REF"])
    position = data.position.copy()
    position[1::2] = rng.normal([1000, -2000, -300], 0.03, (COUNT, 3))
    floor = replace(data, position=position)
    said = describe_wrong_targets(floor)
    assert said is not None
    assert said.startswith('Target "REF" stands still while the arm moves: its 40 positions')
    study = Study(
        name="floor", robot={"name": "ur10", "register": True}, measurements=floor.to_frame()
    )
    with pytest.raises(DataError, match="take its rows out of the file"):
        run_study(study, sampling=False)


def test_the_verdict_of_targets_without_names_says_so(rng) -> None:
    study = Study(
        name="unnamed",
        robot={"name": "ur10", "register": True},
        measurements=measure(rng, ["A", "A"]).to_frame(),
        model={"candidates": ["encoder-scale"]},
    )
    record = run_study(study, sampling=False).record
    assert "targets-mistaken" in [warning.code for warning in record.warnings]
    assert "the position error stays at" in record.verdict[1]
    assert "what the warnings say about the targets" in record.verdict[0]


@pytest.mark.parametrize(
    ("stated", "wrong"),
    [
        (TARGETS, []),
        ([[0, 0, 120], [0, 0, 120]], ["B"]),
        ([[0, 90, 120], [640, 90, 180]], ["A", "B"]),
    ],
)
def test_targets_that_are_stated_elsewhere_are_told(stated, wrong, rng) -> None:
    """Also the second, by which frame and robot are not checked."""
    data = measure(rng, ["A", "B"])
    problem = Problem(ROBOT, data, np.array(stated, float))
    notes = check_setup(problem, np.ones(len(data), bool), registered=False, per_group=False)
    places = {
        "A": "target A sits at 0.0, 0.0, 120.0 mm",
        "B": "target B sits at 640.0, 40.0, 180.0",
    }
    assert [note.code for note in notes] == ["setup-mistake"] * len(wrong)
    for note, name in zip(notes, wrong, strict=True):
        assert places[name] in note.sentence
        assert "under [robot.tools_mm]" in note.sentence
