"""How far a joint is ahead of what it drags along, from the way through all visits."""

from __future__ import annotations

import pickle
from collections.abc import Sequence

import numpy as np
import pytest
from builders import bind, drawn, seeds

from modelsel._typing import Array
from modelsel.measurements.campaign.joint_path import JointPath
from modelsel.measurements.campaign.motion import Waypoints
from modelsel.measurements.campaign.state_names import SLID, TURNED, parse_state_name, state_units
from modelsel.measurements.measurements import build_measurements
from modelsel.robot.coupling import Coupling
from modelsel.robot.files import load_robot

WIDTHS = [4, 90, 500, 1400]


def drag_block(path: Sequence[float], slack: float) -> list[float]:
    """A block between two stops that the joint carries: how far the joint is ahead of it."""
    block = path[0]
    ahead = []
    for place in path:
        if place > block + slack:
            block = place - slack
        if place < block - slack:
            block = place + slack
        ahead.append(place - block)
    return ahead


def measure(q: Array, **more: object):
    return bind("puma760", build_measurements(q, np.zeros((len(q), 3)), **more))


@pytest.mark.parametrize("width", WIDTHS)
@seeds(1, 2)
def test_a_joint_is_ahead_of_a_block_between_stops(width: int, rng: np.random.Generator) -> None:
    q = np.cumsum(rng.normal(0, 0.3, (80, 6)), 0)
    at = measure(q)
    for joint in (1, 4):
        expected = drag_block(q[:, joint - 1], width / 1000)
        found = at.value(f"drag{joint}_{width}")
        np.testing.assert_allclose(found, expected, atol=1e-12)


@seeds(1, 2, 3)
def test_long_ways_in_groups_are_gone_as_one_by_one(rng: np.random.Generator) -> None:
    count = int(rng.integers(1, 6000))
    steps = rng.normal(0, 0.2, (count, 2))
    group = np.sort(rng.integers(0, 5, count))
    opens = np.diff(group, prepend=-1) > 0
    steps[opens] = 0.0
    lead = JointPath(steps, opens).lead(2, 0.5)
    for each in np.unique(group):
        own = group == each
        way = np.cumsum(steps[own, 1])
        np.testing.assert_allclose(lead[own], drag_block(way.tolist(), 0.5), atol=1e-11)


@seeds(1, 2)
def test_rows_keep_it_whichever_are_taken(rng: np.random.Generator) -> None:
    at = measure(np.cumsum(rng.normal(0, 0.3, (60, 6)), 0))
    whole = at.value("drag3_250")
    for rows in (np.array([40, 7, 7, 21]), rng.random(60) < 0.5, slice(20, None, 3)):
        fresh = bind("puma760", at.data.take(rows))
        np.testing.assert_array_equal(fresh.value("drag3_250"), whole[rows])
        np.testing.assert_array_equal(at.take(rows).value("drag3_250"), whole[rows])


@seeds(1, 2)
def test_it_follows_the_order_and_begins_anew_with_a_group(rng: np.random.Generator) -> None:
    q = np.cumsum(rng.normal(0, 0.3, (40, 6)), 0)
    group = np.repeat(["a", "b"], 20)
    expected = [*drag_block(q[:20, 1], 0.25), *drag_block(q[20:, 1], 0.25)]
    shuffled = rng.permutation(40)
    order = np.arange(40.0)[shuffled]
    at = measure(q[shuffled], group=group[shuffled], order=order)
    np.testing.assert_allclose(at.value("drag2_250"), np.array(expected)[shuffled], atol=1e-12)


@seeds(1)
def test_rows_of_one_visit_have_one_value(rng: np.random.Generator) -> None:
    q = np.cumsum(rng.normal(0, 0.3, (30, 6)), 0)
    at = measure(np.repeat(q, 2, 0), target=["a", "b"] * 30)
    expected = np.repeat(drag_block(q[:, 0], 0.09), 2)
    np.testing.assert_allclose(at.value("drag1_90"), expected, atol=1e-12)


@seeds(1)
def test_waypoints_count(rng: np.random.Generator) -> None:
    q = np.cumsum(rng.normal(0, 0.3, (40, 6)), 0)
    passed = np.arange(40) % 3 == 1
    rows = np.arange(40)
    between = Waypoints(q[passed], rows[passed])
    at = measure(q[~passed], row=rows[~passed], waypoints=between)
    expected = np.array(drag_block(q[:, 3], 0.18))
    np.testing.assert_allclose(at.value("drag4_180"), expected[~passed], atol=1e-12)
    # without them it is another
    other = measure(q[~passed]).value("drag4_180")
    assert np.abs(other - expected[~passed]).max() > 0.05


@seeds(1)
def test_a_reading_that_flickers_is_no_motion(rng: np.random.Generator) -> None:
    q = np.cumsum(rng.normal(0, 0.3, (60, 6)), 0)
    rests = np.repeat(rng.random(20) < 0.5, 3)
    place = np.cumsum(np.where(rests, 0.0, rng.choice([-0.2, 0.2], 60)))
    q[:, 4] = place + rng.choice([-1e-5, 1e-5], 60)
    plain = np.array(drag_block(place, 0.09))
    np.testing.assert_allclose(measure(q).value("drag5_90"), plain, atol=5e-4)
    still = q.copy()
    still[:, 4] = rng.choice([-1e-5, 1e-5], 60)
    assert not measure(still).value("drag5_4").any()


@seeds(1)
def test_it_is_of_motors_where_joints_are_coupled(rng: np.random.Generator) -> None:
    matrix = np.eye(6)
    matrix[2, 1] = 0.8
    coupling = Coupling(matrix)
    q = np.cumsum(rng.normal(0, 0.3, (40, 6)), 0)
    motors = np.linalg.solve(matrix, q.T).T
    at = measure(q, coupling=coupling)
    np.testing.assert_allclose(at.value("drag3_180"), drag_block(motors[:, 2], 0.18), atol=1e-12)


@seeds(1)
def test_given_directions_leave_the_path_unknown(rng: np.random.Generator) -> None:
    q = np.cumsum(rng.normal(0, 0.3, (40, 6)), 0)
    at = measure(q, approach=np.ones((40, 6)))
    assert at.data.path is None
    assert not at.value("drag3_180").any()


@seeds(1)
def test_given_directions_of_the_order_leave_the_path_known(rng: np.random.Generator) -> None:
    q = np.cumsum(rng.normal(0, 0.3, (40, 6)), 0)
    plain = measure(q)
    again = measure(q, approach=plain.data.approach)
    np.testing.assert_array_equal(again.value("drag3_180"), plain.value("drag3_180"))
    assert again.value("drag3_180").any()


@seeds(1)
def test_leads_do_not_travel(rng: np.random.Generator) -> None:
    at = measure(np.cumsum(rng.normal(0, 0.3, (40, 6)), 0))
    path = at.data.path
    assert path is not None
    before = len(pickle.dumps(path))
    lead = path.lead(3, 0.18)
    assert len(pickle.dumps(path)) == before
    again = pickle.loads(pickle.dumps(path))  # noqa: S301  our own
    np.testing.assert_array_equal(again.lead(3, 0.18), lead)


@seeds(1)
def test_another_path_is_evaluated_afresh(rng: np.random.Generator) -> None:
    at = drawn("puma760", rng, 20)
    other = drawn("puma760", rng, 20)
    moved = bind("puma760", build_measurements(other.data.q, at.data.position))
    assert not np.array_equal(at.value("drag2_500"), moved.value("drag2_500"))


def test_widths_have_names_of_the_joints_unit() -> None:
    units = state_units(load_robot("puma760"))
    named = {name: unit for name, unit in units.items() if name.startswith("drag4_")}
    assert named == {f"drag4_{width}": "rad" for width in TURNED}
    for widths in (TURNED, SLID):
        near = np.array([*widths])
        # neighbours differ by a tenth at most, or by one
        assert (np.diff(near) <= np.maximum(1, 0.1 * near[:-1])).all()
    variable = parse_state_name("drag4_45")
    assert variable is not None
    assert (variable.joint, variable.width, variable.name) == (4, 45, "drag4_45")
    assert variable.words == "how far joint 4 is ahead of what it drags along"
    assert "drag4_101" not in units
