"""A study described in Python, and its result as tables, on a notebook's page, in a folder and
back."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from builders import OFF_AXIS, one, planted, small_arm
from builders import drawn as scene_of
from contract_tables import write_result_tables

from modelsel import Study, load_result, run_study
from modelsel._files import write_all
from modelsel.calibration.calibration_file import calibration_text
from modelsel.config.study_file import parse_study
from modelsel.exceptions import StudyError
from modelsel.mechanisms.causes import Applied, cos, q
from modelsel.results.residual_table import RESIDUALS, pack_residuals, read_residuals
from modelsel.results.sentences.tables import TABLES
from modelsel.results.storage import WRITES
from modelsel.robot.files import load_robot
from modelsel.study.pipeline.result import Result

TOML = """name = "arm <b>7</b>"
seed = 5
[robot]
name = "puma760"
tool_mm = [40, -25, 100]
[measurements]
file = "m.csv"
[split]
estimation = 40
[model]
candidates = ["wrist-coupling"]
"""
TABLES_OF_IT = {
    "seed": 5,
    "robot": {"name": "puma760", "tool_mm": OFF_AXIS},
    "split": {"estimation": 40},
    "model": {"candidates": ("wrist-coupling",)},
}


def table(m: int = 60) -> pd.DataFrame:
    """The PUMA with a wrist coupling, as a DataFrame."""
    rng = np.random.default_rng(5)
    at = planted(
        scene_of("puma760", rng, m, covariates={}),
        one(5, "rz", q(4)).terms,
        np.array([1e-3]),
        rng,
        0.03,
    )
    return at.data.to_frame()[[f"q{j}_rad" for j in range(1, 7)] + ["x_mm", "y_mm", "z_mm"]]


@pytest.fixture(scope="module")
def frame() -> pd.DataFrame:
    return table()


@pytest.fixture(scope="module")
def result(frame) -> Result:
    return run_study(Study(name="arm <b>7</b>", measurements=frame, **TABLES_OF_IT), sampling=False)


# -- a study in Python
# -------------------------------------------------------------------------------------------------


@pytest.mark.integration
def test_a_study_in_python_is_that_of_the_file(frame, result, tmp_path) -> None:
    """The same values; the same bytes of the result but for the hash of the study, whose data have
    no file's name."""
    frame.to_csv(tmp_path / "m.csv", index=False)
    (tmp_path / "study.toml").write_text(TOML)
    described = Study(name="arm <b>7</b>", measurements={"file": Path("m.csv")}, **TABLES_OF_IT)
    assert described == parse_study(TOML, "study.toml")
    assert described == Study(name="arm <b>7</b>", measurements="m.csv", **TABLES_OF_IT)
    from_file = run_study(tmp_path, sampling=False).record
    assert from_file.provenance.study_sha256 != result.record.provenance.study_sha256
    for record in (one := from_file.to_dict(), other := result.record.to_dict()):
        record["provenance"] = {
            k: v for k, v in record["provenance"].items() if k != "study_sha256"
        }
    assert one == other
    assert [f["credible_set"][0]["mechanism"] for f in one["findings"]] == ["wrist-coupling:5"]


def test_a_robot_may_be_an_object(rng) -> None:
    arm, other = small_arm(), small_arm(prismatic=True)
    at = scene_of(arm, rng, 30)
    split = {"estimation": 20}
    study = Study(
        name="small",
        robot={"nominal": arm, "register": True},
        measurements=at.data.to_frame(),
        split=split,
        model={"candidates": ["encoder-scale"]},
    )
    assert run_study(study, sampling=False).robot is arm
    text = study.model_dump_json()
    assert (
        text
        != Study(
            name="small",
            robot={"nominal": other, "register": True},
            measurements=at.data.to_frame(),
            split=split,
            model={"candidates": ["encoder-scale"]},
        ).model_dump_json()
    )


def test_a_study_keeps_the_data_it_was_given(frame) -> None:
    mine = frame.copy()
    study = Study(name="x", measurements=mine, **TABLES_OF_IT)
    mine["x_mm"] += 1.0
    assert study.measurements.frame.frame["x_mm"].equals(frame["x_mm"])
    assert study == Study(name="x", measurements={"frame": frame}, **TABLES_OF_IT)
    assert study != Study(name="x", measurements=mine, **TABLES_OF_IT)


@pytest.mark.parametrize(
    ("tables", "says"),
    [
        ({"robot": "puma760"}, 'robot: expected a table: name = "puma760"'),
        ({"robot": load_robot("ur5")}, "nominal = the Robot"),
        ({"split": 80}, "split: expected a table, found"),
        ({"robot": {"nominal": "puma760", "tool_mm": OFF_AXIS}}, "robot.nominal"),
        ({"measurements": 3}, "measurements: expected a file or a pandas DataFrame, found int"),
        ({"measurements": {"file": "m.csv", "frame": pd.DataFrame()}}, "give file or frame"),
        ({"seeds": 1}, 'Did you mean "seed"'),
        (
            {"robot": {"nominal": load_robot("ur5"), "name": "ur5", "tool_mm": OFF_AXIS}},
            "give either name",
        ),
        ({"split": {"estimation": "all"}}, "split.estimation"),
    ],
)
def test_problems_are_said_as_of_a_file(tables, says) -> None:
    with pytest.raises(StudyError) as refused:
        Study(
            **(
                {
                    "name": "x",
                    "robot": {"name": "puma760", "tool_mm": OFF_AXIS},
                    "measurements": "m.csv",
                }
                | tables
                | {"noise": {"floor_mm": -1}}
            )
        )
    assert says in str(refused.value)
    assert "noise.floor_mm" in str(refused.value)  # all at once


def test_when_every_candidate_is_in_nothing_is_left_to_name(frame) -> None:
    """Without a warning of the arithmetic: pytest makes one an error."""
    study = Study(
        name="x",
        measurements=frame,
        **TABLES_OF_IT | {"model": {"candidates": ["wrist-coupling:5"]}},
    )
    said = run_study(study, sampling=False).record.nothing_else.sentence
    assert "by chance with probability 1." in said


@pytest.mark.slow
def test_the_chosen_model_says_its_free_functions_as_fitted(rng) -> None:
    """A soft step of joint 3 and a wave beside it, found as one free function, at every row."""
    step = Applied("tanh", float(rng.uniform(3.0, 5.0)) * q(3)) + 0.7 * cos(3.3 * q(3))
    at = planted(
        scene_of("puma760", rng, 90, covariates={}),
        one(3, "rz", step).terms,
        np.array([1e-3]),
        rng,
        0.03,
    )
    study = Study(
        name="x",
        robot={"name": "puma760", "tool_mm": OFF_AXIS},
        measurements=at.data.to_frame(),
        split={"estimation": 80},
    )
    record = run_study(study, sampling=False).record.to_dict()
    rows = record["configurations"]["estimation_rows"]
    truth = 1e-3 * step.of(at.state)[rows]
    cells = [cell for cell in record["chosen"]["cells"] if cell["cause"] == "free(q3)"]
    assert [(cell["frame"], cell["axis"]) for cell in cells] == [(3, "rz")]
    fitted = np.array(cells[0]["values"])
    left = (fitted - fitted.mean()) - (truth - truth.mean())
    assert np.std(left) < 0.1 * np.std(truth)
    (finding,) = record["findings"]
    screws = finding["credible_set"][0]["screws"]
    assert screws == cells


# -- tables
# ------------------------------------------------------------------------------------------------------------


def test_ladder_and_findings_are_those_of_the_file(result) -> None:
    ladder, record = result.to_frame(), result.record.to_dict()
    assert ladder["model"].tolist() == ["nominal", "geometric", "+ wrist-coupling:5"]
    assert ladder["held_out_mean_mm"].tolist() == [
        r["held_out"]["mean_mm"] for r in record["ladder"]
    ]
    (found,) = result.to_frame("findings").to_dict("records")
    assert (found["name"], found["verdict"], found["screws"]) == (
        "wrist-coupling:5",
        "found",
        "frame 5 rz · q4",
    )
    assert found["sentence"] == record["findings"][0]["sentence"]
    (estimate,) = result.to_frame("estimates").to_dict("records")
    assert abs(estimate["value"] - 1e-3) < 4 * estimate["standard_error"]
    assert result.to_frame("credible sets").query("finding == 0")["probability"].sum() >= 0.95
    assert len(result.to_frame("parameters")) == len(record["parameters"])
    assert result.to_frame("error map").shape == np.shape(record["error_map"]["f"])


def test_residuals_of_the_first_version_are_read(result, tmp_path) -> None:
    """They do not tell the rows on an unknown side of a step."""
    columns = result.run.residual_columns()
    del columns["side_open"]
    path = tmp_path / "residuals.parquet"
    path.write_bytes(pack_residuals(columns, ("0", "1")))
    read, hashes = read_residuals(path, len(columns["row"]))
    assert read.keys() == columns.keys()
    assert hashes == ("0", "1")


def test_residuals_make_the_ladder_s_errors(result, frame) -> None:
    """Of the rows measured, joined to the user's own table by their row."""
    joined = frame.join(result.to_frame("residuals"))
    for name, rung in (
        ("nominal", result.models.ladder[0]),
        ("base", result.models.ladder[1]),
        ("chosen", result.models.chosen),
    ):
        for held, errors in ((False, rung.estimation), (True, rung.held_out)):
            rows = joined[
                (joined["estimation"] != held) & ~(joined["outlier"] | joined["side_open"])
            ]
            size = np.linalg.norm(rows[[f"{name}_{axis}_mm" for axis in "xyz"]], axis=1)
            assert size.mean() == pytest.approx(errors.mean_mm, rel=1e-12)


def test_another_table_is_refused(result) -> None:
    with pytest.raises(StudyError, match=r'no table "findigs"\. Did you mean "findings"'):
        result.to_frame("findigs")


def test_page_says_verdict_and_findings_and_escapes(result) -> None:
    page = result._repr_html_()
    assert "<b>7" not in page
    assert "arm &lt;b&gt;7&lt;/b&gt;" in page
    assert all(sentence in page for sentence in result.record.verdict)
    assert "wrist-coupling:5" in page
    assert len(page) < 8000


# -- the folder
# --------------------------------------------------------------------------------------------------------


def files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_what_is_saved_comes_back(result, tmp_path) -> None:
    assert sorted(path.name for path in result.save(tmp_path / "a")) == sorted(WRITES)
    back = load_result(tmp_path / "a" / "result.json")
    assert back.record == result.record
    for what in (*TABLES, "residuals"):
        pd.testing.assert_frame_equal(back.to_frame(what), result.to_frame(what), check_exact=True)
    assert back._repr_html_() == result._repr_html_()
    assert hasattr(result, "problem")
    assert not hasattr(back, "problem")
    assert calibration_text(back.calibration) == calibration_text(result.calibration)
    back.save(tmp_path / "b")
    assert files(tmp_path / "b") == files(tmp_path / "a")


@pytest.mark.slow
def test_report_of_a_loaded_result_is_the_fresh_one_s(result, drawn, tmp_path) -> None:
    """Byte for byte: of a result in memory, and of a whole study as the command leaves it, sampling
    and all."""
    result.save(tmp_path / "a")
    result.report(tmp_path / "a", ("first",))
    load_result(tmp_path / "a").report(tmp_path / "b", ("first",))
    load_result(drawn).save(tmp_path / "c")
    load_result(tmp_path / "c").report(tmp_path / "c")
    fresh, loaded = (tmp_path / folder / "report-pages.pdf" for folder in "ab")
    assert loaded.read_bytes() == fresh.read_bytes()
    assert files(tmp_path / "c") == files(drawn)


@pytest.mark.integration
def test_a_report_leaves_the_session_s_figures_alone(result, tmp_path) -> None:
    """Those of a notebook: its backend, its open figures, its style."""
    import matplotlib as mpl
    import matplotlib.pyplot as plt

    with mpl.rc_context({"font.size": 31.0}):
        mine, backend = plt.figure(), mpl.get_backend()
        with mpl.rc_context():
            mpl.rcParams["backend"] = "svg"
            result.report(tmp_path, ("first", "map"))
            assert mpl.rcParams["backend"] == "svg"
        mpl.rcParams["backend"] = backend
        assert plt.fignum_exists(mine.number)
        assert mpl.rcParams["font.size"] == 31.0
        plt.close(mine)


def test_a_folder_of_parts_is_refused(result, tmp_path) -> None:
    result.save(tmp_path / "a")
    (tmp_path / "a" / RESIDUALS).unlink()  # as studies were written before: all but this table
    back = load_result(tmp_path / "a")
    with pytest.raises(StudyError, match="run the study again"):
        back.to_frame("residuals")
    assert RESIDUALS not in {path.name for path in back.save(tmp_path / "b")}
    result.save(tmp_path / "a")
    other = json.loads((tmp_path / "a" / "calibration.json").read_text())
    other["provenance"]["data_sha256"] = "another"
    (tmp_path / "a" / "calibration.json").write_text(json.dumps(other))
    with pytest.raises(StudyError, match=r"calibration\.json belongs to another run"):
        load_result(tmp_path / "a")
    result.save(tmp_path / "a")
    (tmp_path / "a" / RESIDUALS).write_bytes(b"PAR1 no")
    with pytest.raises(StudyError, match="cannot be read"):
        load_result(tmp_path / "a")
    shutil.rmtree(tmp_path / "a")
    with pytest.raises(StudyError, match=r"no result\.json"):
        load_result(tmp_path / "a")


def test_the_contract_s_tables_are_the_schema_s() -> None:
    """docs/reference/files.md has the keys of result.json and of a finding as the schema describes them."""
    page = (Path(__file__).parents[2] / "docs" / "reference" / "files.md").read_text(
        encoding="utf-8"
    )
    assert write_result_tables() in page


def test_a_stored_result_says_what_belongs_to_the_run(result, tmp_path) -> None:
    result.save(tmp_path)
    back = load_result(tmp_path)
    assert [f.sentence for f in back.findings] == [f.sentence for f in result.findings]
    for part in ("problem", "models", "diagnosis", "uncertainty"):
        with pytest.raises(StudyError, match="belong to the run and are not stored: run the study"):
            getattr(back, part)


# -- reports of an earlier result
# -------------------------------------------------------------------------------------------------


def test_a_report_stays_beside_its_own_result_alone(result, tmp_path) -> None:
    """A report that was there without a result is somebody's own; that of the same result stays."""
    reports = ("report.pdf", "report.html", "report-pages.pdf", "report-summary.pdf")
    for name in reports:
        (tmp_path / name).write_text("drawn")
    for _ in range(2):
        result.save(tmp_path)
        assert {path.name for path in tmp_path.iterdir()} == {*WRITES, *reports}
    (tmp_path / "result.json").write_text("another result")
    result.save(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == set(WRITES)


def test_an_earlier_report_stays_where_the_new_result_cannot_be_written(tmp_path) -> None:
    (tmp_path / "report.pdf").write_text("drawn")
    with pytest.raises(StudyError, match="cannot be written"):
        write_all(tmp_path, {"result.json": b"new", "b" * 300: b"new"}, ["report.pdf"])
    assert [path.name for path in tmp_path.iterdir()] == ["report.pdf"]
    write_all(tmp_path, {"result.json": b"new"}, ["report.pdf"])
    assert [path.name for path in tmp_path.iterdir()] == ["result.json"]
