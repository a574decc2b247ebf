"""Where registration finds the tracker and the targets is said where a user looks, with units and
frames, and is right."""

from __future__ import annotations

import re

import numpy as np
import pytest
from builders import drawn, small_arm
from report_studies import read_source, terminal_lines

from modelsel import Study
from modelsel.measurements.measurements import build_measurements
from modelsel.report.document import use_minus
from modelsel.report.pages.front import write_data_page
from modelsel.results.conclusions.placements import describe_placements
from modelsel.results.schemas.schema import BaseRecord
from modelsel.robot.kinematics import forward
from modelsel.robot.rigid import from_rpy
from modelsel.study.pipeline.runner import run_study

PLACES = {
    "a": ((0.3, -0.5, 2.0), (2500.0, -800.0, 400.0)),
    "b": ((-0.1, 0.2, -1.0), (100.0, 3000.0, 0.0)),
}
TOOL = (30.0, -20.0, 80.0)


def study(rng: np.random.Generator, registered: object, **robot: object) -> Study:
    """Two groups of 30 configurations of a small arm with a tool, each group's tracker elsewhere
    where that is asked."""
    at = drawn(small_arm(), rng, 60)
    q, group = at.data.q, np.array(["a", "b"]).repeat(30)
    x = forward(at.robot, q, np.array(TOOL))
    names = list(group) if registered == "per group" else ["a"] * 60
    if registered:
        x = np.array(
            [from_rpy(*PLACES[g][0]) @ one + PLACES[g][1] for g, one in zip(names, x, strict=True)]
        )
    rows = build_measurements(q, x + rng.normal(0, 0.01, x.shape), group=list(group)).to_frame()
    return Study(
        name="small",
        robot={"nominal": at.robot, "register": registered, **robot},
        measurements=rows,
        model={"candidates": []},
        split={"estimation": 40},
    )


def near(found: BaseRecord, placed: str) -> None:
    turns, place = PLACES[placed]
    np.testing.assert_allclose(found.position_mm, place, atol=0.1)
    np.testing.assert_allclose(found.rpy_deg, np.degrees(turns), atol=0.02)


@pytest.mark.slow
def test_registered_once(rng, tmp_path) -> None:
    """In result.json, on the terminal, in the PDF and on the page; the report is drawn from the
    files alone."""
    result = run_study(study(rng, True), sampling=False)
    placed = result.record.registration
    (base,), (target,) = placed.base_in_tracker, placed.target_on_flange
    near(base, "a")
    assert base.group == "all"
    assert target.position_mm == pytest.approx(TOOL, abs=0.1)
    words = describe_placements(placed)
    assert re.fullmatch(
        r"Base of the nominal robot \(frame 0\) in the instrument's frame: [\d.]+, -[\d.]+, [\d.]+ mm, turned by "
        r"roll, pitch, yaw 17\.\d+, -28\.\d+, 114\.\d+° \(fixed x, y, z\)\.",
        words[0],
    )
    assert re.fullmatch(r"Target in the flange frame: [\d.]+, -[\d.]+, [\d.]+ mm\.", words[1])
    lines = terminal_lines(result.record, result.details)
    assert f"Registered: b{words[0][1:]}" in lines
    assert f"Registered: t{words[1][1:]}" in lines
    result.save(tmp_path)
    items = [block.get("items") for block in write_data_page(read_source(tmp_path))]
    assert [use_minus(one) for one in words] in items
    result.report(tmp_path)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "Where the instrument and the target stand</h2>" in page
    assert "turned by roll, pitch, yaw 17." in page


@pytest.mark.integration
def test_registered_per_group(rng) -> None:
    placed = run_study(study(rng, "per group"), sampling=False).record.registration
    assert [base.group for base in placed.base_in_tracker] == ["a", "b"]
    for base in placed.base_in_tracker:
        near(base, base.group)
    assert "in the instrument's frame (b): 100." in " ".join(describe_placements(placed))


@pytest.mark.slow
def test_not_registered_nothing_is_said(rng) -> None:
    result = run_study(study(rng, False, tool_mm=TOOL), sampling=False)
    assert "registration" not in result.record.to_dict()
    assert not any(
        line.startswith("Registered") for line in terminal_lines(result.record, result.details)
    )
