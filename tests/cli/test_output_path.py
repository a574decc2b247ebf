"""Nothing that a command reads, and nothing of a study or a result, is replaced by what it writes."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner

from modelsel.cli.main import run_command_line

PUMA = Path(__file__).parents[2] / "studies" / "puma760"
READS = "this command reads the file and would replace it. Give another file with"
RESULT = "the file belongs to the result in result and would be replaced"
PUMA_NAME = "PUMA 760 (simulated stand-in)"


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A study, a result, targets and a link to the study's measurements, whose numbers have the
    decimals that `simulate` writes."""
    shutil.copytree(PUMA, tmp_path / "study")
    (tmp_path / "study" / "more.csv").symlink_to("measurements.csv")
    (tmp_path / "result").mkdir()
    for name in ("result.json", "calibration.json"):
        (tmp_path / "result" / name).write_text("{}")
    for name in ("targets.csv", "arm.urdf"):
        (tmp_path / name).write_text("what people wrote")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def read_all(folder: Path) -> dict[str, bytes]:
    files = (path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("simulate study --out study/measurements.csv", READS),
        ("simulate study --out study/study.toml", READS),
        ("simulate study --out study/more.csv", READS),
        ("plan study --out study/measurements.csv", READS),
        ("plan study --pool targets.csv --out targets.csv", READS),
        ("plan study --out result/result.json", RESULT),
        ("compensate result targets.csv --out ./targets.csv", READS),
        ("compensate result targets.csv --format krl --out targets.csv", READS),
        (
            "compensate result targets.csv --out study/measurements.csv",
            "the file belongs to the study in study and would be replaced",
        ),
        ("export result/calibration.json --format json --out result/calibration.json", READS),
        ("export result --format json --out result/calibration.json", RESULT),
        ("export result --format urdf --urdf arm.urdf --out arm.urdf", READS),
        ("compare result result --html result/result.json", RESULT),
        ("init study/robot.toml --robot puma760 --yes --out study", "already exists"),
        ("compensate result targets.csv --out c.ods", "not as a spreadsheet (.ods)"),
        ("simulate study --out c.ods", "not as a spreadsheet (.ods)"),
        ("plan study --out c.xls", "not as a spreadsheet (.xls)"),
        (
            "compensate result targets.csv --out c.docx",
            "not as .docx. Give a file .csv, .xlsx or .parquet",
        ),
        ("simulate study --out c.PDF", "not as .pdf. Give a file .csv or .parquet"),
        ("plan study --out c.json", "not as .json. Give a file .csv or .parquet"),
    ],
)
def test_nothing_that_is_there_is_replaced(place: Path, words: str, said: str) -> None:
    before = read_all(place)
    ran = CliRunner().invoke(run_command_line, words.split())
    assert ran.exit_code == 2, ran.output
    assert said in ran.output
    assert read_all(place) == before


@pytest.mark.parametrize("words", ["study study", "simulate study", "plan study", "fleet f.toml"])
def test_an_empty_path_is_refused(place: Path, words: str) -> None:
    (place / "f.toml").write_text('name = "f"\n')
    ran = CliRunner().invoke(run_command_line, [*words.split(), "--out", ""])
    assert ran.exit_code == 2, ran.output
    assert "expected a path, found an empty text" in ran.output


def test_a_file_of_its_own_is_written_again(place: Path) -> None:
    for _ in range(2):
        ran = CliRunner().invoke(run_command_line, ["simulate", "study", "--out", "study/new.csv"])
        assert ran.exit_code == 0, ran.output


def test_the_studys_measurements_are_written_once(place: Path) -> None:
    """A second call reads them and refuses: nothing tells simulated points from measured ones."""
    own = place / "study" / "measurements.csv"
    own.unlink()
    words = ["simulate", "study", "--out", str(own)]
    assert CliRunner().invoke(run_command_line, words).exit_code == 0
    before = own.read_bytes()
    ran = CliRunner().invoke(run_command_line, words)
    assert (ran.exit_code, READS in ran.output) == (2, True)
    assert own.read_bytes() == before


def test_a_new_study_replaces_no_file_of_its_folder(place: Path) -> None:
    (place / "new").mkdir()
    own = place / "new" / "measurements.csv"
    own.write_text("what people wrote")
    words = ["init", "study/measurements.csv", "--robot", "puma760", "--yes", "--out", "new"]
    ran = CliRunner().invoke(run_command_line, words)
    assert ran.exit_code == 2, ran.output
    assert "another file of this name is there and would be replaced" in ran.output
    assert own.read_text() == "what people wrote"


@pytest.mark.parametrize(
    ("stored", "named"),
    [
        ('{"study": "cell \\n4"}', '"cell \\n4"'),
        (f'{{"study": "{PUMA_NAME}", "robot": "irb120"}}', f'"{PUMA_NAME}" of robot irb120'),
        (f'{{"study": "{PUMA_NAME}"}}', None),
        (f'{{"study": "{PUMA_NAME}", "robot": "puma760"}}', None),
        ("{}", None),
        ("[", None),
    ],
)
def test_the_result_of_another_study_is_not_replaced_without_a_word(
    place: Path, stored: str, named: str | None
) -> None:
    (place / "result" / "result.json").write_text(stored)
    measured = place / "study" / "measurements.csv"
    few = measured.read_text().splitlines()[:9]
    measured.write_text("\n".join(few))
    ran = CliRunner().invoke(run_command_line, ["study", "study", "--out", "result", "--no-report"])
    if named is None:
        assert "another study" not in ran.stderr
    else:
        said = f"result has the result of another study, {named}, which this run replaces when it"
        assert said in " ".join(ran.stderr.split()), ran.stderr
    assert ran.exit_code != 1


def test_a_file_in_a_folders_place_is_called_a_file(place: Path) -> None:
    ran = CliRunner().invoke(run_command_line, ["study", "study", "--out", "targets.csv"])
    assert "targets.csv is a file; a folder is expected." in ran.output
    ran = CliRunner().invoke(run_command_line, ["simulate", "study", "--out", "result"])
    assert "result is a folder; a file is expected." in ran.output
    ran = CliRunner().invoke(run_command_line, ["report", "result/result.json"])
    assert (
        ran.exit_code,
        "the folder of a finished study is expected. Is it result?" in ran.output,
    ) == (2, True)
    assert {path.name for path in place.iterdir()} == {"study", "result", "targets.csv", "arm.urdf"}


def test_files_in_each_others_place_are_called_what_they_are(place: Path) -> None:
    """A table for a study, a study for a table."""
    ran = CliRunner().invoke(run_command_line, ["study", "study/measurements.csv"])
    said = "measurements.csv: this is a table of measurements, not a study file. modelsel init"
    assert (ran.exit_code, f"{said} study/measurements.csv --robot NAME" in ran.output) == (2, True)
    ran = CliRunner().invoke(
        run_command_line, ["init", "study/study.toml", "--robot", "ur5", "--yes", "--out", "new"]
    )
    said = "study.toml: this is a study file or a robot file, not a table of measured points."
    assert (ran.exit_code, said in ran.output) == (3, True)
    ran = CliRunner().invoke(run_command_line, ["fleet", "study/measurements.csv"])
    said = "measurements.csv: this is a table of measurements, not a fleet file. modelsel init"
    assert (ran.exit_code, said in ran.output) == (2, True)
    ran = CliRunner().invoke(run_command_line, ["report", "study/study.toml"])
    said = "study.toml: this is a file; the folder of a finished study is expected."
    assert (ran.exit_code, ran.output.strip().endswith(said)) == (2, True)


@pytest.mark.parametrize(
    ("words", "status", "said"),
    [
        (["init", "none.toml", "--robot", "ur5", "--yes"], 3, "none.toml: no such file."),
        (["check", "none.mat", "--robot", "ur5"], 3, "none.mat: no such file."),
        (["report", "nowhere"], 2, "nowhere: there is no such folder; "),
        (["report", "study"], 2, "study: the folder of a study; "),
    ],
)
def test_what_is_not_there_is_called_nothing_else(
    words: list[str], status: int, said: str, place: Path
) -> None:
    ran = CliRunner().invoke(run_command_line, words)
    assert (ran.exit_code, said in ran.output) == (status, True)
    (place / "a.pdf").write_bytes(b"%PDF-1.7\n%\xb5")
    ran = CliRunner().invoke(
        run_command_line, ["init", "a.pdf", "--robot", "ur5", "--yes", "--out", "new"]
    )
    assert (ran.exit_code, "a.pdf: this is a PDF, which is not read." in ran.output) == (3, True)


def test_a_planted_effect_names_the_file_that_its_column_is_missed_in(place: Path) -> None:
    study = place / "study" / "study.toml"
    planted = '[[simulate.effect]]\nframe = 3\naxis = "rz"\nsize = 1e-3\ncause = "{}"\n'
    with study.open("a") as file:
        file.write(planted.format("payload_kg") + planted.format("q1 +"))
    (place / "study" / "measurements.csv").unlink()
    ran = CliRunner().invoke(run_command_line, ["simulate", "study", "--out", "m.csv"])
    unknown, malformed = [line for line in ran.stderr.splitlines() if "simulate.effect" in line]
    assert unknown.endswith("Columns are those of measurements.csv, which is not there.")
    assert malformed.endswith("it cannot be read as a formula.")
