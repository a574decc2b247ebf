"""The table of the calibrated parameters: nominal, calibrated, U, p, and what the symbols mean."""

from __future__ import annotations

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from report_studies import read_source

from modelsel.mechanisms.causes import ONE
from modelsel.mechanisms.environment import target_step
from modelsel.mechanisms.geometry import geometric
from modelsel.mechanisms.moved_targets import limit_to_targets
from modelsel.mechanisms.terms import Screw
from modelsel.results.pictures.arm_details import (
    describe_arm,
    describe_meaning,
    describe_place,
    find_nominal,
)
from modelsel.results.sentences.parameter_table import (
    compute_parameter_p,
    find_standard_uncertainty,
    number_owners,
    tabulate_calibrated,
    write_number_plainly,
)
from modelsel.results.sentences.study_sentences import format_motion
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import pose

TOOL = np.array([0.0, 0.0, 100.0])


def test_a_row_for_every_number_and_nominal_plus_estimate_is_calibrated(drawn) -> None:
    source = read_source(drawn)
    rows = {row.symbol: row for row in tabulate_calibrated(source.record, source.details)}
    meanings = {one.symbol: one for one in source.details.parameters}
    assert set(rows) == {one.symbol for one in source.record.parameters} == set(meanings)
    for one in source.record.parameters:
        row = rows[one.symbol]
        factor = {"mm": 1.0, "rad": 1.0, "mrad": 1e3, "µrad": 1e6}.get(row.unit)
        if factor is None:
            continue
        u = max(one.standard_error, one.bootstrap_error)
        expanded = float(row.expanded)
        assert expanded == pytest.approx(2 * u * factor, rel=0.06)
        calibrated = float(row.calibrated.replace("−", "-"))
        nominal = meanings[one.symbol].nominal
        assert calibrated == pytest.approx(
            nominal * factor + one.estimate * factor, abs=expanded / 10
        )
    assert rows["a3"].nominal == "650.000"
    assert rows["a3"].meaning == "joint 3, its axis along x"
    assert rows["w54"].meaning == "joint 5, its turn × q4"


def test_an_angle_has_one_unit_in_the_table_and_in_sentences(drawn) -> None:
    """That which its size asks for."""
    source = read_source(drawn)
    rows = {row.symbol: row for row in tabulate_calibrated(source.record, source.details)}
    told = 0
    for finding in source.record.findings:
        pattern = r"(\S+) = \S+ ± \S+ (\S*rad[^\s,;]*)"
        for symbol, unit in re.findall(pattern, finding.sentence):
            if symbol in rows:
                assert rows[symbol].unit == unit
                told += 1
    assert told > 3


def test_p_is_below_a_twentieth_where_the_interval_leaves_out_zero(drawn) -> None:
    """p, U and the interval are of one standard uncertainty."""
    parameters = read_source(drawn).record.parameters
    for one in parameters:
        assert (compute_parameter_p(one) < 0.05) == (not one.low < 0 < one.high), one.symbol
    outside = [one for one in parameters if compute_parameter_p(one) < 0.05]
    assert 0 < len(outside) < len(parameters)


def test_undefined_figures_are_dashes(drawn) -> None:
    source = read_source(drawn)
    first = source.record.parameters[0]
    unknown = {"standard_error": None, "bootstrap_error": None, "configurations": None}
    bare = first.model_copy(update=unknown)
    assert find_standard_uncertainty(bare) is None
    assert compute_parameter_p(bare) is None
    record = source.record.model_copy(update={"parameters": [bare]})
    (row,) = tabulate_calibrated(record, source.details)
    assert row.expanded == row.p == "–"
    assert write_number_plainly(-0.0001, 2) == "0.00"
    assert write_number_plainly(-0.25, 1) == "−0.2"


@pytest.mark.parametrize("name", ["puma760", "ur5", "irb1600"])
def test_nominal_shifts_are_those_of_the_chain(name) -> None:
    """By the chain itself: where a frame's origin stands beyond the one before, along its own axes."""
    robot = load_robot(name)
    at = pose(robot, np.zeros((1, robot.n)), TOOL)
    problem = SimpleNamespace(robot=robot, tools=TOOL[None])
    terms = [term for term in geometric(robot).terms if term.screws[0].axis[0] == "t"]
    assert len(terms) == 3 * (robot.n + 1)
    origins = np.concatenate([np.zeros((1, 3)), at.origins[:, :, 0]])
    for term in terms:
        screw = term.screws[0]
        k, axis = screw.frame - 1, "xyz".index(screw.axis[1])
        expected = at.axes[k, axis, :, 0] @ (origins[k + 1] - origins[k])
        if screw.frame > robot.n:
            expected = TOOL[axis]
        assert find_nominal(problem, screw) == pytest.approx(expected, abs=1e-5)


def test_what_several_targets_share_has_no_nominal() -> None:
    """A correction of all of them: the drawing's value would be that of one."""
    robot = load_robot("ur5")
    *_, term = geometric(robot).terms
    screw = Screw(robot.n + 1, "tx", ONE)
    term = replace(term, screws=(screw,))
    both = SimpleNamespace(robot=robot, tools=np.array([TOOL, TOOL + 50]))
    assert find_nominal(both, screw) is None
    assert describe_meaning(both, term, "set-up") == "all targets along the flange's x"
    one = SimpleNamespace(robot=robot, tools=TOOL[None])
    assert find_nominal(one, screw) == TOOL[0]
    assert describe_meaning(one, term, "set-up") == "target along the flange's x"


def test_a_number_of_targets_that_move_alike_names_them_all() -> None:
    robot = load_robot("ur5")
    data = SimpleNamespace(targets=("A", "B", "C"))
    at = SimpleNamespace(robot=robot, data=data)
    step = target_step(robot, 0.5)
    cause = step.terms[0].screws[0].cause
    said = []
    for moved in ({1: "B"}, {0: "A", 2: "C"}):
        limited = limit_to_targets(step, moved)
        said.append(describe_meaning(at, limited.terms[0], "target-step"))
    assert said == [
        f"target along the flange's x, target B × {cause}",
        f"target along the flange's x, targets A and C × {cause}",
    ]


def test_the_drawing_stands_upright() -> None:
    """Of an arm on a wall, gravity points down the page; the frames stay as they are to each other."""
    robot = load_robot("puma760")
    wall = replace(robot, gravity=(1.0, 0.0, 0.0))
    q = np.random.default_rng(5).uniform(-1, 1, (7, 6))
    drawings = [describe_arm(_problem(one, q)) for one in (robot, wall)]
    floor, wall_mounted = (np.array(one["origins_mm"]) for one in drawings)
    axes = np.array(drawings[1]["axes"])
    assert np.allclose(axes[0] @ [-1, 0, 0], [0, 0, 1])  # frame 0's -x is up
    assert np.allclose(axes.swapaxes(1, 2) @ axes, np.eye(3), atol=1e-4)
    lengths = [np.linalg.norm(np.diff(one, axis=0), axis=1) for one in (floor, wall_mounted)]
    assert np.allclose(*lengths, atol=0.3)


def _problem(robot, q):
    """As much of a problem as a drawing needs."""

    def at(row):
        found = pose(robot, q[row], TOOL)
        return SimpleNamespace(pose=lambda _: found)

    return SimpleNamespace(robot=robot, data=SimpleNamespace(q=q), take=at)


def test_places_in_words() -> None:
    robot = load_robot("puma760")
    assert describe_place(robot, 2, "rz") == "joint 2, zero of its reading"
    assert describe_place(robot, 2, "rz", constant=False) == "joint 2, its turn"
    assert describe_place(robot, 4, "ry") == "joint 4, its axis tilted about y"
    assert describe_place(robot, 7, "tx") == "target along the flange's x"


def test_symbols_of_several_mechanisms_have_their_numbers() -> None:
    """Titles of panels were all cut to "m of 3 rz pay…"."""
    symbols = ["c5 of geometric", "c5 of joint-compliance:5", "m of 3 rz x", "h1", "m of 3 rz y"]
    labels, owners = number_owners([*symbols, "noise scale"])
    assert labels[:5] == ["c5", "c5 (1)", "m (2)", "h1", "m (3)"]
    assert labels[5:] == ["noise scale"]
    assert owners == ["joint-compliance:5", "3 rz x", "3 rz y"]


@pytest.mark.parametrize(
    ("mm", "mrad", "told"),
    [
        (0.271, 3.6, "0.271"),
        (1.4e-7, 0.101, "0.101 mrad"),
        (1.4e-7, 0.0344, "0.0344 mrad"),
        (1.4e-7, 6.76e-8, "0.000"),
        (0.0, 3.4e-7, "0.000"),
        (0.0, None, "0.000"),
        (None, None, "–"),
    ],
)
def test_what_neither_moves_nor_turns_the_target_is_zero(mm, mrad, told) -> None:
    assert format_motion(mm, mrad) == told
