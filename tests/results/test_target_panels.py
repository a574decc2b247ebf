"""Panels of steps of some targets of several: one for each axis, over the rows of these targets."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from modelsel import load_robot
from modelsel.mechanisms.environment import target_step
from modelsel.mechanisms.moved_targets import limit_to_targets
from modelsel.results.pictures.panels import _draw_group, _group_terms

ROBOT = load_robot("ur5")


@pytest.mark.parametrize(
    ("moved", "words"), [({1: "B"}, ", target B"), ({0: "A", 2: "C"}, ", targets A and C")]
)
def test_a_common_step_is_drawn_over_the_rows_of_its_targets(moved, words: str) -> None:
    """A number of several targets had no panel."""
    rows = 60
    progress = np.linspace(0, 1, rows)
    target = np.arange(rows) % 3
    step = limit_to_targets(target_step(ROBOT, 0.5), moved)
    estimate = np.array([0.3, -0.2, 0.1])
    groups = _group_terms(step.terms, estimate, {"progress": "1"})
    assert [group.places for group in groups] == [((7, axis),) for axis in ("tx", "ty", "tz")]
    data = SimpleNamespace(target=target, targets=("A", "B", "C"))
    at = SimpleNamespace(data=data, cause=lambda cause: progress)
    problem = type("Rows", (SimpleNamespace,), {"__len__": lambda self: rows})(**vars(at))
    field = np.zeros((7, 6, 3, rows))
    field[6, :3] = np.eye(3)[:, :, None]
    residual = np.zeros((rows, 3))
    drawn = _draw_group(groups[0], problem, field, residual)
    assert drawn is not None
    _, panel = drawn
    assert panel["against"].endswith(words)
    is_own = np.isin(target, list(moved))
    before = np.asarray(panel["before"], float)
    assert len(before) == is_own.sum()
