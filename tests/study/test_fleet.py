"""Many studies as one job: two workers, one of which dies; what fails stops nothing; results as
alone, byte for byte."""

from __future__ import annotations

import json
import os
import shutil
import signal
import time
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from threading import Thread
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from builders import drawn
from click.testing import CliRunner

from modelsel._files import claim_folder
from modelsel.cli.main import run_command_line
from modelsel.config.fleet_file import Task, read_fleet
from modelsel.config.study_file import read_study
from modelsel.exceptions import StudyError
from modelsel.fitting.design import Model
from modelsel.fitting.least_squares import fit
from modelsel.fitting.problem import Problem
from modelsel.measurements.reader import read_measurements
from modelsel.mechanisms.registry import mechanism
from modelsel.results.storage import WRITES
from modelsel.robot.files import load_robot
from modelsel.selection.streaming import Parts, fit_parts, list_parts
from modelsel.study import fleet_runner as fleets
from modelsel.study.fleet_runner import FleetOptions, _read_row, cluster, run_fleet, save_summary
from modelsel.study.pipeline.result import load_result
from modelsel.study.pipeline.runner import run_study

pytestmark = pytest.mark.integration

TOOL = (40.0, -25.0, 100.0)
QUICK = FleetOptions(sampling=False)
STUDY = """
name = "arm {k}"
seed = {k}
[robot]
name = "puma760"
tool_mm = [40, -25, 100]
[measurements]
file = "measurements.csv"
[split]
estimation = 40
[model]
candidates = ["backlash:3", "wrist-coupling"]
[comparison]
folds = 4
"""


def table(rng: np.random.Generator, m: int = 60) -> pd.DataFrame:
    at = drawn("puma760", rng, m)
    position = at.data.position + rng.normal(0, 0.05, (m, 3))
    names = [*(f"q{j}_rad" for j in range(1, 7)), "x_mm", "y_mm", "z_mm"]
    return pd.DataFrame(np.column_stack([at.data.q, position]), columns=names)


@pytest.fixture
def folder(rng, tmp_path) -> Path:
    """Five studies, of which the third has broken data, and a measurement set in two files."""
    for k in range(5):
        place = tmp_path / f"arm{k}"
        place.mkdir()
        (place / "study.toml").write_text(STUDY.format(k=k))
        frame = table(rng)
        if k == 2:
            frame.loc[7, "x_mm"] = np.nan
        frame.to_csv(place / "measurements.csv", index=False)
    for k in range(2):
        table(rng, 150).to_parquet(tmp_path / f"day{k}.parquet", index=False, row_group_size=60)
    (tmp_path / "fleet.toml").write_text("""
name = "five arms"
studies = ["arm*/study.toml"]
[[study]]
file = "arm0/study.toml"
name = "what-if"
measurements = "arm1/measurements.csv"
[[parts]]
name = "whole"
files = ["day*.parquet"]
robot = "puma760"
tool_mm = [40, -25, 100]
""")
    return tmp_path


def opened(file: Path) -> Any:
    """A PDF, read."""
    from pypdf import PdfReader

    return PdfReader(file)


def test_a_study_is_finished_until_one_of_its_files_changes(folder) -> None:
    """The robot's file, too, of which the study file has the name alone."""
    place, out = folder / "arm0", folder / "out"
    file = place / "robot.toml"
    catalogue = files("modelsel") / "robot" / "catalogue"
    robot = (catalogue / "puma760.toml").read_text("utf-8")
    file.write_text(robot)
    text = STUDY.format(k=0).replace('name = "puma760"', 'file = "robot.toml"')
    (place / "study.toml").write_text(text)
    study = read_study(place)
    task = Task("arm0", study, place)
    run_study(study, place, sampling=False).save(out)
    assert fleets._is_finished(task, out, QUICK)
    file.write_text(robot.replace("[1, 0, 0, 650]", "[1, 0, 0, 651]"))
    assert not fleets._is_finished(task, out, QUICK)
    file.write_text(f"# the same robot\n{robot}")
    assert fleets._is_finished(task, out, QUICK)
    file.unlink()
    assert not fleets._is_finished(task, out, QUICK)


@pytest.mark.slow
def test_fleet_on_two_workers(folder) -> None:
    """One worker is killed at work; one study fails; the others are as alone; a second run takes up
    what is there."""
    fleet, out = read_fleet(folder / "fleet.toml"), folder / "out"
    said: list[str] = []
    killed: list[int] = []
    with cluster(2) as client:
        first = dict(client.run(os.getpid))

        def kill() -> None:
            while not (busy := [address for address, keys in client.processing().items() if keys]):
                time.sleep(0.01)
            victim = busy[0]
            killed.append(first[victim])
            os.kill(first[victim], signal.SIGKILL)

        thread = Thread(target=kill)
        thread.start()
        rows = run_fleet(fleet, out, client, QUICK, say=said.append)
        thread.join()
        shutil.rmtree(out / "arm3")
        kept = (out / "arm0" / "result.json").stat().st_mtime_ns
        again = run_fleet(fleet, out, client, replace(QUICK, resume=True), say=said.append)
    assert killed
    assert [row["name"] for row in rows] == [
        "arm0",
        "arm1",
        "arm2",
        "arm3",
        "arm4",
        "what-if",
        "whole",
    ]
    assert [row["state"] for row in rows] == ["done", "done", "failed", *4 * ["done"]]
    assert (rows[2]["exit"], "line 9" in rows[2]["why"], "x_mm" in rows[2]["why"]) == (
        3,
        True,
        True,
    )
    assert again == rows
    assert (out / "arm0" / "result.json").stat().st_mtime_ns == kept
    assert any("4 of 6 are finished already" in line for line in said)
    for name in ("arm0", "arm4"):
        alone = run_study(read_study(folder / name), folder / name, sampling=False)
        assert (out / name / "result.json").read_bytes() == alone.to_json().encode()
        assert (
            load_result(out / name).to_json() == alone.to_json()
        )  # with all that a report is drawn from
    assert (
        json.loads((out / "what-if" / "result.json").read_text())["provenance"]["data_sha256"]
        == json.loads((out / "arm1" / "result.json").read_text())["provenance"]["data_sha256"]
    )
    found = json.loads((out / "whole" / "parts.json").read_text())
    assert (found["rows"], found["pieces"]) == (300, 6)
    assert found["sigma_mm"] == pytest.approx(0.05, rel=0.15)
    written = save_summary(rows, out, fleet.name)
    assert pd.read_csv(written[0])["name"].tolist() == [row["name"] for row in rows]
    assert pd.read_parquet(written[1])["exit"].tolist() == [row["exit"] for row in rows]
    before = [path.read_bytes() for path in written]
    assert [path.read_bytes() for path in save_summary(again, out, fleet.name)] == before
    pdf = opened(written[2])
    metadata, words = (
        pdf.xmp_metadata,
        " ".join("".join(page.extract_text() for page in pdf.pages).split()),
    )
    assert b"pdfuaid" in metadata.stream.get_data()
    assert len(pdf.pages) <= 3
    assert "five arms" in words
    assert "1 study of 7 failed: arm2" in words
    assert all(row["name"] in words for row in rows)
    assert "line 9" in words
    assert {path.name for path in (out / "arm0").iterdir()} == set(WRITES)
    drawn_again = CliRunner().invoke(
        run_command_line, ["report", str(out / "arm0"), "--pages", "provenance"]
    )
    assert drawn_again.exit_code == 0, drawn_again.output
    assert "Written" in drawn_again.output


def test_fleet_file_says_all_at_once(folder) -> None:
    (folder / "fleet.toml").write_text("""
name = "wrong"
studies = ["nowhere*/study.toml"]
[[study]]
file = "arm0"
[[study]]
file = "arm0"
""")
    with pytest.raises(StudyError) as wrong:
        read_fleet(folder / "fleet.toml")
    assert len(wrong.value.problems) == 2
    assert 'no file matches "nowhere*' in str(wrong.value)
    assert '"arm0" stands twice' in str(wrong.value)
    (folder / "fleet.toml").write_text(
        'name = "x"\n[[study]]\nfiel = "arm0"\n[[parts]]\nname = "p"\n'
    )
    with pytest.raises(StudyError) as wrong:
        read_fleet(folder / "fleet.toml")
    assert 'unknown key "study.1.fiel". Did you mean "file"?' in str(wrong.value)
    assert "parts.1.tool_mm is missing" in str(wrong.value)
    (folder / "fleet.toml").write_text(
        'name = "x"\n[[parts]]\nname = "p"\nfiles = ["day*.parquet"]\nrobot = "puma760"\n'
        "tool_mm = [40, -25, 100]\nfolds = 1000000000000\n"
    )  # each is held
    with pytest.raises(StudyError, match=r"parts\.1\.folds.*1000"):
        read_fleet(folder / "fleet.toml")
    with pytest.raises(StudyError, match="no such fleet file"):
        read_fleet(folder / "absent.toml")


def test_an_unexpected_error_in_one_set_stops_nothing(folder, monkeypatch) -> None:
    """A set whose work breaks in a way nobody foresaw: its row says so, the set after it is
    fitted."""
    text = (folder / "fleet.toml").read_text()
    (folder / "fleet.toml").write_text(
        'name = "two"\n'
        + "".join(
            text[text.index("[[parts]]") :].replace('"whole"', f'"{name}"')
            for name in ("first", "second")
        )
    )
    found = fleets.fit_parts
    monkeypatch.setattr(
        fleets, "fit_parts", lambda *a: found(*a) if len(calls.append(1) or calls) > 1 else 1 / 0
    )
    calls: list[int] = []

    class Here:
        """A client whose work is done here."""

        loop = None

        def map(self, work, items, **_):
            return list(map(work, items))

        def gather(self, done):
            return done

    monkeypatch.setattr("distributed.as_completed", lambda futures, loop: iter(futures))
    rows = run_fleet(read_fleet(folder / "fleet.toml"), folder / "out", Here())
    assert [(row["state"], row["exit"]) for row in rows] == [("failed", 1), ("done", 0)]
    assert rows[0]["why"] == "internal error: ZeroDivisionError: division by zero"
    assert rows[1]["estimation"] == 300


@pytest.mark.parametrize(("count", "said"), [(1, "running 1 study"), (2, "running 2 studies")])
def test_one_study_is_one(count, said, monkeypatch, tmp_path) -> None:
    def run_at_once(tasks, *_):
        return [{"name": task.name, "state": "done"} for task in tasks]

    monkeypatch.setattr(fleets, "_run_tasks", run_at_once)
    tasks = [SimpleNamespace(name=f"arm{k}") for k in range(count)]
    told: list[str] = []
    run_fleet(SimpleNamespace(tasks=tasks, parts=()), tmp_path, None, say=told.append)
    assert told[0] == said


def test_a_study_alone_in_a_fleets_folder(folder) -> None:
    """Two runs never write into one folder: the fleet's row says so, what the other run does is
    left alone."""
    task, out = read_fleet(folder / "fleet.toml").tasks[0], folder / "out" / "arm0"
    with claim_folder(out):
        row = fleets.run_task(task, str(out), QUICK)
        assert (row["state"], row["exit"]) == ("failed", 2)
        assert "another run of modelsel is already working in this folder" in row["why"]
        assert not (out / "result.json").exists()
    assert fleets.run_task(task, str(out), QUICK)["state"] == "done"


def test_pieces_know_nothing_of_the_one_before(folder) -> None:
    """What hangs on the order of motion across pieces is refused; stated directions of approach are
    as in one file."""
    files = sorted(folder.glob("day*.parquet"))
    arm = load_robot("puma760")
    for name, said in (
        ("tracker-drift", "progress"),
        ("settle:2", "move2"),
        ("approach-backlash:2", "approach1"),
    ):
        model = Model((mechanism("geometric", arm), mechanism(name, arm)))
        with pytest.raises(StudyError, match=said):
            fit_parts(Parts(arm, TOOL, list_parts(files)), model)
    whole = pd.concat([pd.read_parquet(file) for file in files], ignore_index=True)
    for j in range(1, 7):
        whole[f"approach{j}"] = np.random.default_rng(j).choice([-1, 1], len(whole))
    whole.to_parquet(folder / "stated.parquet", index=False, row_group_size=70)
    model = Model((mechanism("geometric", arm), mechanism("approach-backlash:2", arm)))
    fitted, _ = fit_parts(Parts(arm, TOOL, list_parts([folder / "stated.parquet"])), model)
    at = read_measurements(folder / "stated.parquet", [False] * 6)
    np.testing.assert_allclose(
        fitted.theta, fit(Problem(arm, at, np.array([TOOL])), model).theta, atol=1e-9
    )


@pytest.mark.parametrize("address", ["nonsense://x", "", "tcp://x:y", "localhost"])
def test_what_is_no_address_of_a_scheduler_is_refused_at_once(address) -> None:
    """Before there is a client, which would wait for its own end and show a traceback then."""
    before = time.monotonic()
    with (
        pytest.raises(StudyError, match="expected the address of a running dask scheduler"),
        cluster(scheduler=address),
    ):
        pass
    assert time.monotonic() - before < 5


def test_a_secure_scheduler_needs_certificates() -> None:
    with pytest.raises(StudyError, match="tls needs certificates"), cluster(scheduler="tls://h:1"):
        pass


def test_the_base_of_an_own_ladder_is_its_rung(tmp_path) -> None:
    """The ladder's second rung has an effect more than the base, which is the third."""
    ladder = [
        {"mechanisms": names, "rank": 30, "held_out": {"mean_mm": mean}}
        for names, mean in (
            ([], 1.0),
            (["geometric", "joint3-twist"], 0.1),
            (["geometric"], 0.2),
            (["geometric", "overshoot:4"], 0.05),
        )
    ]
    record = {
        "ladder": ladder,
        "warnings": [],
        "sampling": None,
        "robot": "puma760",
        "configurations": {"estimation": 40, "held_out": 20},
        "noise_floor": {"coordinate_mm": 0.05},
    }
    (tmp_path / "result.json").write_text(json.dumps(record))
    (tmp_path / "details.json").write_text(json.dumps({"base": 2}))
    row = _read_row("own ladder", tmp_path)
    assert (row["nominal_mm"], row["base_mm"], row["chosen_mm"]) == (1.0, 0.2, 0.05)
    assert (row["found"], row["found_as"]) == ("overshoot:4", "overshoot:4")


def test_a_study_file_that_cannot_be_read_stops_no_other(folder, monkeypatch) -> None:
    """It is no TOML, or has a key that there is not: its row says why, with its file once."""

    def run_at_once(tasks, *_):
        return [{"name": task.name, "state": "done", "exit": 0} for task in tasks]

    monkeypatch.setattr(fleets, "_run_tasks", run_at_once)
    monkeypatch.setattr(fleets, "fit_measurement_set", lambda table, *_: {"state": "done"})
    for name, old, new in (("arm1", "seed", "sed"), ("arm3", "[robot]", "[robot")):
        wrong = folder / name / "study.toml"
        wrong.write_text(wrong.read_text().replace(old, new))
    said: list[str] = []
    rows = run_fleet(
        read_fleet(folder / "fleet.toml"), folder / "out", None, QUICK, say=said.append
    )
    states = [row["state"] for row in rows]
    assert states == ["done", "failed", "done", "failed", "done", "done", "done"]
    assert [rows[k]["exit"] for k in (1, 3)] == [2, 2]
    assert rows[1]["why"].startswith("arm1/study.toml: unknown key")
    assert rows[3]["why"].startswith("arm3/study.toml: not valid TOML")
    assert any("arm3: failed" in line for line in said)


def test_a_study_file_that_is_not_there_is_a_fault_of_the_fleet_file(folder) -> None:
    (folder / "fleet.toml").write_text('name = "x"\n[[study]]\nfile = "arm9/study.toml"\n')
    with pytest.raises(StudyError, match=r"fleet\.toml: arm9/study\.toml: .*no such"):
        read_fleet(folder / "fleet.toml")
