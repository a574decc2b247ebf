"""A finding that turns the target and does not move it is told in mrad wherever its size is told."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from report_studies import source_of, terminal_lines, written

from modelsel import Result, read_study, run_study
from modelsel.diagnosis.findings.sentences import format_angle
from modelsel.measurements.formats.row_places import Where
from modelsel.report import drawing
from modelsel.report.comparison_page import _write_finding
from modelsel.report.document import Source, collect_blocks
from modelsel.report.pages.findings import describe_proof
from modelsel.report.terminal_summary import summarise_study
from modelsel.results.conclusions.finding_figures import (
    Figures,
    FindingFigures,
    Turning,
    describe_small,
)
from modelsel.results.conclusions.verdict import Named
from modelsel.results.sentences.finding_advice import advise
from modelsel.results.sentences.study_sentences import write_figures
from modelsel.results.sentences.tables import FINDING_COLUMNS, TABLES

TURNED = "at most 0.310 mrad (95 %: 0.200 to 0.420) of the target's orientation, where"
STILL = "the target's position does not change"


def turning(finding: dict, still: bool) -> None:
    """Make a finding one that above all turns the target."""
    worst = finding["worst"]
    sizes = {"rms_mrad": 0.12, "mrad": 0.31, "low": 0.2, "high": 0.42}
    stand = {key: worst[key] for key in ("joints_deg", "unmeasured_joints")}
    falls = {"held_out_rms_before_mrad": 0.5, "held_out_rms_after_mrad": 0.3}
    finding["gain"] |= {**falls, "interval_mrad": [0.1, 0.3]}
    text = f"{TURNED} the joints stand at 0°"
    finding["turning"] = {**sizes, **stand, "text": text, "prevails": True}
    if still:
        finding["rms_mm"] = worst["mm"] = worst["low"] = worst["high"] = 0.0
        worst["text"] = STILL


def with_turning(folder, still: bool = True, small: tuple[int, ...] = ()) -> Source:
    """The PUMA study's report, of which the first finding turns the target."""
    result, details = written(folder)
    turning(result["findings"][0], still)
    for k in small:
        result["findings"][k]["matters"] = False
    result["small_findings"] = {"count": len(small), "rms_mm": 0.02, "sentence": "Some."}
    return source_of(result, details)


def test_the_summary_has_no_zero_beside_it(drawn) -> None:
    source = with_turning(drawn)
    lines = summarise_study(source.record, source.details, 80)
    assert lines[1].startswith("     –  ")
    assert "turns the target by at most 0.310 mrad; " in " ".join(" ".join(lines).split())


def test_what_moves_and_turns_has_both_in_the_summary(drawn) -> None:
    source = with_turning(drawn, still=False)
    lines = summarise_study(source.record, source.details, 80)
    assert float(lines[1].split()[0]) == pytest.approx(source.record.findings[0].worst.mm, rel=1e-2)
    assert "turns the target by at most 0.310 mrad; " in " ".join(" ".join(lines).split())


def test_its_figures_say_how_far_and_that_nothing_moves(drawn) -> None:
    source = with_turning(drawn)
    said = write_figures(source.record.findings[0])
    assert f"{TURNED} the joints stand at 0°; {STILL}." in said
    assert any(said in line for line in terminal_lines(source.record, source.details))


def test_a_turning_that_does_not_prevail_is_not_told(drawn) -> None:
    result, details = written(drawn)
    before = write_figures(source_of(result, details).record.findings[0])
    turning(result["findings"][0], still=False)
    result["findings"][0]["turning"]["prevails"] = False
    assert write_figures(source_of(result, details).record.findings[0]) == before


def test_the_pdf_lists_it_in_mrad_among_small_ones(drawn) -> None:
    source = with_turning(drawn, small=(0, 2, 3))
    *_, table = (
        block
        for block in collect_blocks(source, drawing.PAGES, ("findings",))
        if block["kind"] == "table"
    )
    first, *others = table["rows"]
    assert first[3:5] == ["0.120 mrad", "0.310 mrad"]
    assert all(row[4].endswith(" mm") for row in others)
    assert "mrad: how far the target is turned" in table["caption"]


def test_two_studies_beside_each_other_have_it_in_mrad(drawn) -> None:
    source = with_turning(drawn)
    said = _write_finding(SimpleNamespace(record=source.record, details=source.details), 0)
    said = said.replace("\N{NO-BREAK SPACE}", " ")
    assert "at most 0.310 mrad of the target&#x27;s orientation; " in said.replace("'", "&#x27;")
    assert "0 mm" not in said


def test_the_table_of_findings_has_mrad_only_with_orientations(drawn) -> None:
    table = TABLES["findings"](with_turning(drawn).record)
    assert list(table.columns) == list(FINDING_COLUMNS)
    assert table["worst_mrad"][0] == 0.31
    assert table["worst_mrad"][1:].isna().all()
    assert table["gain_high_mrad"][0] == 0.3
    assert table["gain_high_mrad"][1:].isna().all()
    plain = TABLES["findings"](source_of(*written(drawn)).record)
    assert not [name for name in plain.columns if "mrad" in name]


def test_what_it_gains_of_orientation_is_told_in_mrad(drawn) -> None:
    source = with_turning(drawn)
    finding = source.record.findings[0]
    assert advise(source.record, finding).worth == "0.200 mrad (0.100 to 0.300)"
    said = describe_proof(finding, Where("m.csv"))
    assert ", of orientation 0.500 to 0.300 mrad rms (95 %: 0.100 to 0.300 mrad less)." in said
    assert "Held-out error when it joins the ladder: " in said


def test_the_gain_that_falls_is_told(drawn) -> None:
    source = with_turning(drawn)
    finding = source.record.findings[0]
    larger = {"held_out_rms_after_mrad": 0.6, "interval_mrad": [-0.2, 0.1]}
    gain = finding.gain.model_copy(update=larger)
    assert gain.told == gain.of_position
    gain = gain.model_copy(update={"held_out_rms_after_mm": gain.held_out_rms_before_mm})
    assert gain.told == gain.of_orientation


@pytest.mark.parametrize(
    ("sizes", "prevails", "small", "sentence"),
    [
        (
            [(0.0, 0.12), (0.03, 0.0), (0.004, 0.2)],
            (True, False, False),
            (0.031, 0.25),
            "Three smaller errors, 0.0310 mm and 0.250 mrad of orientation rms together: a 0.120 mrad, b 0.0300 mm, c 0.00400 mm and 0.200 mrad.",
        ),
        (
            [(0.0, 0.12), (0.0, 0.2), (0.0, 0.3)],
            (True, True, True),
            (0.0, 0.4),
            "Three smaller errors, 0.400 mrad of orientation rms together: a 0.120 mrad, b 0.200 mrad, c 0.300 mrad.",
        ),
        (
            [(0.01, 0.1), (0.03, 0.0), (0.004, 0.2)],
            (False, False, False),
            (0.031, 0.25),
            "Three smaller errors, 0.0310 mm rms together: a 0.0100 mm, b 0.0300 mm, c 0.00400 mm.",
        ),
    ],
)
def test_the_line_of_small_ones_has_mrad_where_one_of_them_turns(
    sizes, prevails, small, sentence
) -> None:
    each = tuple(
        Figures(mm, False, None, (), Turning(mrad, None, is_told))  # type: ignore[arg-type]
        for (mm, mrad), is_told in zip(sizes, prevails, strict=True)
    )
    figures = FindingFigures(each, *small)
    named = [Named(name, True, matters=False) for name in "abc"]
    told = describe_small(named, figures)
    assert told == {"count": 3, "rms_mm": small[0], "rms_mrad": small[1], "sentence": sentence}


def study_turned(tmp_path: Path, mrad: float, seed: int) -> Result:
    """Study an arm whose target turns about its own x axis by some mrad times the sine of joint 2's
    reading."""
    from scipy.spatial.transform import Rotation

    from modelsel.robot.files import load_robot
    from modelsel.robot.kinematics import pose

    rng = np.random.default_rng(seed)
    arm, tool = load_robot("puma760"), np.array([0.0, 0.0, 100.0])
    q = arm.draw(rng, 90)
    at = pose(arm, q, tool)
    turned = Rotation.from_rotvec(np.outer(1e-3 * mrad * np.sin(q[:, 1]), [1, 0, 0]))
    noise = Rotation.from_rotvec(rng.normal(0, 1e-4, (90, 3)))
    R = (Rotation.from_matrix(at.rotation.transpose(2, 0, 1)) * turned * noise).as_quat()
    data = pd.DataFrame(q, columns=[f"q{j}_rad" for j in range(1, 7)])
    data[["x_mm", "y_mm", "z_mm"]] = at.target.T + rng.normal(0, 0.02, (90, 3))
    data[["qx", "qy", "qz", "qw"]] = R
    data.to_csv(tmp_path / "measurements.csv", index=False)
    (tmp_path / "study.toml").write_text(
        'name = "turned"\nseed = 1\n[robot]\nname = "puma760"\ntool_mm = [0, 0, 100]\n'
        '[measurements]\nfile = "measurements.csv"\n[split]\nestimation = 60\n'
        '[model]\nbase = ["geometric"]\n[comparison]\nfolds = 5\n'
    )
    return run_study(read_study(tmp_path / "study.toml"), tmp_path, sampling=False)


@pytest.mark.slow
def test_a_turn_of_the_target_is_told_in_mrad_by_a_study(tmp_path) -> None:
    result = study_turned(tmp_path, 3.0, seed=3)
    finding = json.loads(result.to_json())["findings"][0]
    assert finding["matters"]
    assert finding["worst"]["text"] == STILL
    assert finding["turning"]["prevails"]
    assert finding["turning"]["mrad"] == pytest.approx(3.0, rel=0.1)
    assert " mrad (95 %: " in finding["turning"]["text"]
    assert not [one for one in finding["usable"] if one["unit"] == "mm"]
    rest = result.record.nothing_else
    assert (
        f" mm or {format_angle(1e-3 * rest.detection_limit_mrad)} of orientation rms"
        in rest.sentence
    )
    # noise of 0.1 mrad and of 0.02 mm
    ratio = rest.detection_limit_mrad / rest.detection_limit_mm
    assert ratio == pytest.approx(5.0, rel=0.2)


@pytest.mark.slow
def test_a_true_turn_is_not_doubtful_where_the_position_error_does_not_fall(tmp_path) -> None:
    result = study_turned(tmp_path, 0.4, seed=6)
    finding = json.loads(result.to_json())["findings"][0]
    gain = finding["gain"]
    assert finding["turning"]["prevails"]
    assert gain["held_out_rms_after_mm"] > gain["held_out_rms_before_mm"]
    assert gain["held_out_rms_after_mrad"] < 0.7 * gain["held_out_rms_before_mrad"]
    low, high = gain["interval_mrad"]
    fall = gain["held_out_rms_before_mrad"] - gain["held_out_rms_after_mrad"]
    assert 0 < low < fall < high
    assert not finding["doubtful"]
    assert not result.calibration.doubtful
