"""The residuals against what they could still depend on: what is drawn, and what is not."""

from __future__ import annotations

import numpy as np
import pytest
from report_studies import read_source, source_of, written

from modelsel.report import drawing
from modelsel.report.document import collect_blocks
from modelsel.report.figures.residual_panels import draw_residuals, list_drivers


def test_every_joint_the_order_and_the_last_move(drawn) -> None:
    source = read_source(drawn)
    drivers = list_drivers(source.details)
    names = [driver.name for driver in drivers]
    assert names[:6] == [f"joint {joint} [°]" for joint in range(1, 7)]
    assert names[6:] == [
        "order of motion [% of the campaign]",
        "last move, the largest of a joint [°]",
    ]
    order = drivers[6].values
    assert np.all(np.diff(order) >= 0)
    assert order[0] == 0
    assert order[-1] == 100
    # by hand: readings of the row before
    q = np.degrees(source.details.rows.q)
    moved = np.abs(np.diff(q, axis=0)).max(1)
    last = drivers[7].values[1:]
    within = last > 0  # a group begins with no move
    assert within.mean() > 0.8
    assert np.allclose(last[within], moved[within], atol=0.01)


def test_the_temperature_where_it_was_measured_and_changes(drawn) -> None:
    result, details = written(drawn)
    rows = len(details["rows"]["row"])
    details["rows"]["temperature_C"] = [20.0 + 0.01 * row for row in range(rows)]
    drivers = list_drivers(source_of(result, details).details)
    assert drivers[-1].name == "temperature [°C]"
    details["rows"]["temperature_C"] = rows * [20.0]
    assert len(list_drivers(source_of(result, details).details)) == 8


@pytest.mark.slow
def test_files_of_an_earlier_version_are_drawn_without(drawn) -> None:
    """No order, no move, no frames, no meanings: less is drawn, nothing fails."""
    result, details = written(drawn)
    for key in ("progress", "move"):
        del details["rows"][key]
    for key in ("arm", "parameters", "campaign"):
        del details[key]
    source = source_of(result, details)
    blocks = collect_blocks(source, drawing.PAGES)
    assert len(list_drivers(source.details)) == 6
    assert not {"frames.svg", "marked.svg"} & set(source.pictures)
    assert "residuals.svg" in source.pictures
    assert any(block["kind"] == "title" for block in blocks)


def test_a_joint_at_rest_is_no_driver_and_few_rows_are_drawn(drawn) -> None:
    result, details = written(drawn)
    for row in details["rows"]["q"]:
        row[2] = 0.5
    found = source_of(result, details).details
    drivers = list_drivers(found)
    assert "joint 3 [°]" not in [driver.name for driver in drivers]
    assert draw_residuals(found, drivers).startswith(b"<?xml")
