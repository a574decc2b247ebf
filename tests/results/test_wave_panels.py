"""Panels of waves: the curve that is drawn is the cause, whatever the angle and its sign."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from modelsel import load_robot
from modelsel.mechanisms.causes import cos, q, sin
from modelsel.mechanisms.registry import BUILTIN, build_mechanisms
from modelsel.mechanisms.waves import Wave, find_common_wave, read_wave
from modelsel.results.pictures.panels import _group_terms
from modelsel.robot.coupling import Coupling

X = np.array([0.3, 0.7, -1.1])


@pytest.mark.parametrize(
    ("row", "column", "element", "angle", "sign"),
    [(2, 1, -1.0, q(2) + q(3), 1.0), (2, 2, -1.0, q(3), -1.0)],
    ids=["a motor that turns two joints", "a joint that is read the other way"],
)
@pytest.mark.parametrize(("name", "count"), [("gear-ripple:3", 3), ("gear-eccentricity:3", 1)])
def test_a_wave_of_a_motor_is_drawn_as_it_is_fitted(
    row, column, element, angle, sign, name, count
) -> None:
    matrix = np.eye(6)
    matrix[row, column] = element
    robot = replace(load_robot("ur5"), coupling=Coupling(matrix))
    terms = next(iter(build_mechanisms(name, robot, BUILTIN))).terms[:2]
    (group,) = _group_terms(terms, np.array([2.0, 0.5]), {})
    assert (group.abscissa.kind, group.abscissa.waves) == ("wave", count)
    assert group.abscissa.variable == angle
    # (-1)*sin((-1)*x) is the sine, (-1)*cos((-1)*x) the negative cosine
    expected = 2.0 * np.sin(count * X) + 0.5 * sign * np.cos(count * X)
    assert group.evaluate(X) == pytest.approx(expected)


def test_waves_are_read_from_causes() -> None:
    assert read_wave(sin(1e-7 * q(2))) == Wave("sin", q(2), 1e-7)
    assert read_wave(-2.0 * cos(q(2) * 3.0)) == Wave("cos", q(2), 3.0, -2.0)
    assert read_wave(q(2)) is None
    assert find_common_wave((sin(2.0 * q(2)), cos(3.0 * q(2)))) is None
    assert find_common_wave((cos(2.0 * q(2)), sin(2.0 * q(2)))) == (q(2), 2.0)
