"""Shifts of one target of several that nobody registered, and with columns that have no words."""

from __future__ import annotations

import numpy as np
import pytest

from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.diagnosis.shapes.target_cells import generate_target_cells
from modelsel.diagnosis.shapes.unregistered import Unregistered
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.robot.files import load_robot

ROBOT = load_robot("puma760")


def offered(rng: np.random.Generator, count: int, *columns: str) -> list[Unregistered]:
    """What is offered for eight configurations of some targets, with columns of the data."""
    rows = 8 * count
    names = [f"t{k}" for k in range(count)] * 8
    drawn = {name: np.repeat(rng.normal(size=8), count) for name in columns}
    q = np.repeat(ROBOT.draw(rng, 8), count, axis=0)
    data = build_measurements(q, np.zeros((rows, 3)), target=names, covariates=drawn)
    at = Problem(ROBOT, data, np.zeros((count, 3)))
    return list(generate_target_cells(at))


def test_one_target_has_none_with_what_the_error_map_knows(rng: np.random.Generator) -> None:
    assert not offered(rng, 1, "temperature_C", "payload_kg")


@pytest.mark.parametrize("count", [2, 4])
def test_one_of_several_is_as_likely_as_all_of_them(count: int, rng: np.random.Generator) -> None:
    cells = offered(rng, count, "temperature_C")
    # gravity along three axes and its sign, the rise in temperature and its square
    alike = 3 * (3 + 3 + 2)
    assert len(cells) == (count + 1) * alike
    assert {one.kind for one in cells} == {CandidateKind.TARGET_CELL}
    assert sum(one.weight for one in cells) == pytest.approx(2 * alike)
    names = {one.mechanism.name: one.mechanism.sentence for one in cells}
    assert names["7 ty down_z"].startswith("The target shifts along the flange's y axis ")
    assert names["7 ty down_z*target_2"] == (
        "Target t1 shifts along the flange's y axis in proportion to the gravity along the flange's "
        "z axis"
    )


def test_a_shift_with_a_column_is_one_explanation_of_three_numbers(
    rng: np.random.Generator,
) -> None:
    (together,) = offered(rng, 1, "speed_pct")
    assert len(together.mechanism.terms) == 3
    assert together.kind is CandidateKind.TARGET_SHIFT
    assert together.mechanism.sentence == (
        "The target shifts on the flange in proportion to the column speed_pct"
    )
    shifts = [one for one in offered(rng, 2, "speed_pct") if len(one.mechanism.terms) == 3]
    assert [one.mechanism.sentence.split(" shifts")[0] for one in shifts] == [
        "The target",
        "Target t0",
        "Target t1",
    ]
