"""Lookup tables: their grids, and what they cover."""

from __future__ import annotations

import csv
import io
from dataclasses import replace

import numpy as np
import pytest
from builders import drawn, planted

from modelsel.calibration.calibration import Calibration, calibrate
from modelsel.calibration.calibration_file import save_calibration
from modelsel.calibration.commands.command_notes import needs_approach
from modelsel.calibration.constant_part import compute_points, fix_members, split_parts
from modelsel.calibration.export import export
from modelsel.calibration.export.lookup import evaluate_tables
from modelsel.calibration.export.python import cause_tree, list_inputs
from modelsel.calibration.loading import load_calibration
from modelsel.fitting.design import Model
from modelsel.fitting.least_squares import fit
from modelsel.fitting.noise import Floor
from modelsel.fitting.problem import Problem
from modelsel.mechanisms.cause_formulas import list_members, parse
from modelsel.mechanisms.causes import Named
from modelsel.mechanisms.registry import mechanism
from modelsel.mechanisms.terms import Mechanism, Screw, Term
from modelsel.notices import Note
from modelsel.robot.files import load_robot
from modelsel.selection.evaluation import Split


def calibrated(at: Problem, model: Model, estimation: np.ndarray, rng) -> Calibration:
    """A model fitted to some rows of planted positions."""
    theta = np.array([1e-4 if t.screws[0].axis[0] == "r" else 0.1 for t in model.terms])
    at = planted(at, model.terms, theta, rng, 0.02)
    split = Split(at, estimation, ~estimation, np.zeros(len(at), np.intp), True)
    found = fit(split.training, model)
    return calibrate("tables", split, found, Floor(0.02, "stated"), None, False, {})


def grids(text: str) -> dict[str, dict[str, set[str]]]:
    """Of every table the points of its names, as the file has them."""
    out: dict[str, dict[str, set[str]]] = {}
    for row in csv.DictReader(io.StringIO(text)):
        points = out.setdefault(row["table"], {})
        for k in "12":
            if row["name" + k]:
                points.setdefault(row["name" + k], set()).add(row["value" + k])
    return out


def test_a_cause_of_one_target_is_nothing_at_the_others() -> None:
    """A product with what is zero there, on either side, and within a function: it was left as a
    cause that no module can hold."""
    units = {"q4": "rad", "progress": "1"}
    members = list_members(3, 1)
    for text, at_first, at_second in (
        ("q4*target_2", "0", "q4"),
        ("target_2*q4", "0", "q4"),
        ("q4/target_2", "q4/0", "q4"),
        ("target_2/q4", "0/q4", "1/q4"),
        ("sin(target_2)", "0", "0.8414709848"),
        ("sin(q4-target_2)", "sin(q4-0)", "sin(q4-1)"),
        ("(sign(progress-0.5)+1)/2*target_2", "0", "(sign(progress-0.5)+1)/2"),
    ):
        cause = parse(text, units, members=members)
        assert str(fix_members(cause, 0)) == at_first
        assert str(fix_members(cause, 1)) == at_second
        cause_tree(fix_members(cause, 2))


def test_causes_without_a_range_are_constant(rng) -> None:
    """A link whose frame has an axis along gravity: the moment about it is zero everywhere."""
    robot = load_robot("fr3")
    at = drawn(robot, rng, 60)
    model = Model((mechanism("geometric", robot), mechanism("link-bending:1", robot)))
    c = calibrated(at, model, np.ones(60, bool), rng)
    assert c.ranges["moment2_y"] == (0.0, 0.0)
    found = export(c, "table")
    assert found.error_mm < 1e-6
    assert all(len(p) > 1 for names in grids(found.text).values() for p in names.values())


def test_points_are_those_that_the_file_tells_apart(rng) -> None:
    """Seconds of an epoch: ten digits end at whole ones."""
    robot = load_robot("irb120")
    clock = 1.7e9 + np.linspace(0, 3, 60)
    drift = Mechanism(
        "drift",
        (
            Term("k", (Screw(2, "rz", Named("time_s", "s") - 1.7e9),)),
            Term("l", (Screw(3, "rz", (Named("time_s", "s") - 1.7e9) * Named("q4", "rad")),)),
        ),
    )
    at = drawn(robot, rng, 60, covariates={"time_s": clock})
    c = calibrated(at, Model((mechanism("geometric", robot), drift)), np.ones(60, bool), rng)
    found = export(c, "table")
    assert found.error_mm < 1e-3
    clocks = [names["time_s"] for names in grids(found.text).values() if "time_s" in names]
    assert [len(points) for points in clocks] == [4, 4]


def test_tables_cover_held_out_rows(rng, tmp_path) -> None:
    """The error that is claimed is that of the held-out rows: a grid that ended before them would
    leave more."""
    robot = load_robot("irb120")
    at = drawn(robot, rng, 80)
    estimation = np.abs(at.data.q[:, 1]) < 0.8 * np.abs(at.data.q[:, 1]).max()
    scale = Mechanism("scale", (Term("k", (Screw(2, "rz", Named("q2", "rad")),)),))
    made = calibrated(at, Model((mechanism("geometric", robot), scale)), estimation, rng)
    assert set(made.held_out_ranges) >= {"q2"}
    save_calibration(made, tmp_path)
    c = load_calibration(tmp_path)
    assert c.held_out_ranges == made.held_out_ranges
    read = evaluate_tables(export(c, "table").text, at)
    covariates = {f"table_{k}": values for k, (_, _, values) in enumerate(read)}
    bound = replace(at, data=replace(at.data, covariates=covariates))
    screws = [Screw(frame, axis, Named(f"table_{k}")) for k, (frame, axis, _) in enumerate(read)]
    constant, varying = split_parts(c)
    parts = [replace(varying[0], term=Term("", (screw,)), value=1.0) for screw in screws]
    found = compute_points(bound, parts)
    assert found == pytest.approx(compute_points(at, constant + varying), abs=1e-5)


@pytest.mark.slow
def test_covariates_that_begin_like_states_are_covariates(rng) -> None:
    """A speed of approach is no direction: -1, 0 and 1 are not its grid."""
    robot = load_robot("irb120")
    causes = Named("approach_speed", "mm"), Named("move_speed", "mm")
    terms = [Term(f"k{frame}", (Screw(frame, "tx", causes[frame - 1]),)) for frame in (1, 2)]
    speed = Mechanism("speed", tuple(terms))
    speeds = {cause.name: rng.uniform(10, 100, 60) for cause in causes}
    at = drawn(robot, rng, 60, covariates=speeds)
    c = calibrated(at, Model((mechanism("geometric", robot), speed)), np.ones(60, bool), rng)
    tables = export(c, "table")
    assert tables.error_mm < 1e-3
    (points,) = [
        names["approach_speed"]
        for names in grids(tables.text).values()
        if "approach_speed" in names
    ]
    assert min(map(float, points)) == pytest.approx(c.ranges["approach_speed"][0])
    left_out = export(c, "grid").left_out
    assert any(words.startswith("approach_speed away from") for words in left_out)
    assert not any("direction of approach" in words or "last move" in words for words in left_out)
    assert list_inputs(c) == ["approach_speed", "move_speed"]
    assert not needs_approach(c, replace(at.data, notes=(Note("approach-from-order", ""),)))
