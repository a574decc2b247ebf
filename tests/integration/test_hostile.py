"""Names are data: strings made to break programs in every name of every file; every output and the
file system looked at."""

from __future__ import annotations

import csv
import io
import json
import re
import subprocess
import sys
import tomllib
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from fuzz_base import ROBOT, STUDY, base_files
from hostile import NAMES, REFUSED
from report_studies import read_source

from modelsel._names import find_name_problem, guard_cell, unguard_cell
from modelsel.calibration.constant_part import sample_workspace
from modelsel.calibration.export import FORMS as EVERY_FORM
from modelsel.calibration.export import export
from modelsel.calibration.export.python import read_module_data, write_module
from modelsel.calibration.loading import parse_calibration
from modelsel.calibration.prediction import predict
from modelsel.cli.main import run_command_line
from modelsel.config.fleet_file import read_fleet
from modelsel.config.study_file import Study, parse_study
from modelsel.exceptions import DataError, ModelselError, StudyError
from modelsel.measurements.reader import read_measurements
from modelsel.mechanisms.causes import q, sin
from modelsel.mechanisms.registry import find_entry_problem
from modelsel.mechanisms.terms import Mechanism, Screw, Term
from modelsel.report.html import write_page as page_of
from modelsel.robot.files import load_robot, robot_from_table
from modelsel.robot.urdf import read_urdf_text
from modelsel.study.pipeline.result import load_result

SIGNS = "=+-@\t\r\uff1d\uff0b\uff0d\uff20"
INSIDE = re.compile(
    r"[\x00-\x09\x0b-\x1f\x7f\x85\u2028\u2029\u061c\u200b\u200e\u200f\u202a-\u202e\u2066-\u2069\ufeff]"
)


def every(table: dict[str, str]) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("name", table.values(), ids=table)


def quoted(name: str) -> str:
    """A TOML string of its own escapes, other than the program's."""
    return '"' + "".join(f"\\U{ord(c):08X}" for c in name) + '"'


def folder_of(
    place: Path,
    name: str,
    *,
    study: str | None = None,
    robot: str | None = None,
    source: str | None = None,
    target: str | None = None,
    group: str | None = None,
    column: str = "load",
) -> Path:
    """A study folder with the name in every place, or another where it is given."""
    place.mkdir(parents=True, exist_ok=True)
    study, robot, source, target, group = (
        name if v is None else v for v in (study, robot, source, target, group)
    )
    (place / "robot.toml").write_text(
        ROBOT.replace('"arm3"', quoted(robot)).replace('"made up"', quoted(source)), "utf-8"
    )
    text = STUDY.replace('name = "small"', f"name = {quoted(study)}", 1).replace(
        "tool_mm = [10, 20, 80]\n", ""
    )
    tools = f"[robot.tools_mm]\n{quoted(target)} = [10, 20, 80]\nother = [0, 0, 0]\n[measurements]"
    text = text.replace("[measurements]", tools).replace(
        '"measurements.csv"', f'"measurements.csv"\ncolumns = {{ payload_kg = {quoted(column)} }}'
    )
    (place / "study.toml").write_text(text, "utf-8")
    frame = pd.read_csv(io.BytesIO(base_files()["measurements.csv"]), dtype=str)
    group, target = (
        guard_cell(label) if label[:1] == "'" else label for label in (group, target)
    )  # as any program writes them
    frame["group"] = pd.Series([group] * 18 + ["tuesday"] * 18, dtype=object)
    frame["target"] = pd.Series([target] * 36, dtype=object)
    frame = frame.rename(columns={"payload_kg": column})
    # no number, whatever the name
    frame["operator"] = pd.Series([f"{name} Smith"] * 36, dtype=object)
    frame[f"{name} too"] = np.linspace(1, 2, 36)
    frame.to_csv(
        place / "measurements.csv",
        index=False,
        lineterminator="\n",
        encoding="utf-8",
        errors="surrogatepass",
    )
    return place


def everything(place: Path) -> set[str]:
    return {str(p.relative_to(place)) for p in place.rglob("*")}


def told(*words: str, status: int = 0) -> str:
    """What a command says, with the status it must have."""
    ran = CliRunner().invoke(run_command_line, list(words))
    assert ran.exit_code == status, ran.output
    assert not INSIDE.search(ran.output)
    assert "Traceback" not in ran.output
    return ran.output


class Page(HTMLParser):
    """The elements of a page with their attributes, and its text."""

    def __init__(self, text: str):
        super().__init__()
        self.elements: list[tuple[str, tuple[str, ...]]] = []
        self.text: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, tuple(key for key, _ in attrs)))

    def handle_data(self, data: str) -> None:
        self.text.append(data)


FORMS = [
    form for form in EVERY_FORM if form not in ("grid", "ur-calibration")
]  # of any arm, quickly


@cache
def plain() -> dict[str, str]:
    """What a study of harmless names leaves, as text."""
    import tempfile

    with tempfile.TemporaryDirectory() as name:
        folder = folder_of(Path(name) / "study", "harmless")
        told("study", str(folder), "--out", str(Path(name) / "out"), "--no-sampling", "--no-report")
        out = Path(name) / "out"
        (out / "report.html").write_bytes(page_of(read_source(out)))
        for form in FORMS:
            told(
                "export",
                str(Path(name) / "out"),
                "--format",
                form,
                "--out",
                str(Path(name) / "out" / f"x.{form}"),
            )
        return {
            p.name: p.read_text("utf-8")
            for p in (Path(name) / "out").iterdir()
            if p.suffix not in (".pdf", ".parquet")
        }


@every(NAMES)
@pytest.mark.long
def test_every_output_of_a_study(name, tmp_path, monkeypatch) -> None:
    """A study with the name everywhere: its files, its page, its exports, what it says; nothing
    runs, nothing else is written."""
    work, out = tmp_path / "work", tmp_path / "out"
    folder = folder_of(tmp_path / "study", name)
    work.mkdir()
    monkeypatch.chdir(work)
    before = everything(tmp_path)
    said = told("study", str(folder), "--out", str(out), "--no-sampling", "--no-report")
    assert name[:60] in said.replace("\n", "")
    assert (
        name
        in json.loads(told("study", str(folder), "--dry-run", "--json", "--out", str(out)))["study"]
    )
    (out / "report.html").write_bytes(page_of(read_source(out)))
    told(
        "check",
        str(folder / "measurements.csv"),
        "--robot",
        str(folder / "robot.toml"),
        "--column",
        "payload_kg=load",
    )
    wrote = {"report.html", "result.json", "details.json", "calibration.json", "residuals.parquet"}
    assert everything(tmp_path) - before == {"out", *(f"out/{file}" for file in wrote)}
    result, details, stored = (
        json.loads((out / file).read_text("utf-8"))
        for file in ("result.json", "details.json", "calibration.json")
    )
    assert (result["study"], result["robot"]) == (name, name)
    assert (stored["study"], stored["robot"]["name"], stored["robot"]["source"]) == (
        name,
        name,
        " ".join(name.split()),
    )
    assert [t["name"] for t in stored["targets"]] == [name]
    assert [g["name"] for g in stored["groups"]] == [name, "tuesday"]
    assert details["places"] == {"word": "line", "first": 2, "at": None, "labels": None}
    page, harmless = Page((out / "report.html").read_text("utf-8")), Page(plain()["report.html"])
    assert page.elements == harmless.elements
    assert name in page.text
    assert load_result(out).record.study == name
    _exports(name, out)


@every(
    {
        k: NAMES[k]
        for k in (
            "three quotes",
            "script",
            "doctype",
            "dollars",
            "typst",
            "markdown",
            "emoji",
            "hebrew",
            "combining",
            "up",
        )
    }
)
@pytest.mark.long
def test_report_of_a_study(name, tmp_path) -> None:
    """The PDF: its title is the name, no word of it is markup, no other file is read."""
    from pypdf import PdfReader

    folder = folder_of(tmp_path / "study", name)
    told("study", str(folder), "--out", str(tmp_path / "out"), "--no-sampling", "--no-report")
    told("report", str(tmp_path / "out"), "--pages", "first,provenance")
    reader = PdfReader(tmp_path / "out" / "report-pages.pdf")
    assert reader.metadata.title == f"Calibration report: {name}"
    words = re.sub(r"\s", "", "".join(p.extract_text() for p in reader.pages))
    if name.isascii():
        assert words.count(re.sub(r"\s", "", name)) >= 3  # as title, study and robot
    assert "root:x:" not in words


def _exports(name: str, out: Path) -> None:
    """Every form: as many elements, lines and keys as of a harmless name, and the name as it is."""
    texts = {}
    for form in FORMS:
        told("export", str(out), "--format", form, "--out", str(out / f"x.{form}"))
        texts[form] = (out / f"x.{form}").read_text("utf-8")
    root, harmless = (ET.fromstring(text) for text in (texts["urdf"], plain()["x.urdf"]))
    assert [e.tag for e in root.iter()] == [e.tag for e in harmless.iter()]
    assert root.get("name") == name
    links = [link.get("name") for link in root.findall("link")]
    assert len(set(links)) == len(links)
    assert sum(link in (name, f"target_{name}") for link in links) >= 1
    for form in ("dh", "mdh", "hayati"):
        table = tomllib.loads(texts[form])
        assert (table["name"], table["source"]) == (name, f"calibrated by modelsel, study {name}")
        assert table.keys() == tomllib.loads(plain()[f"x.{form}"]).keys()
    assert list(json.loads(texts["json"])["constant"]) == [name]
    rows = list(csv.reader(io.StringIO(texts["csv"])))
    assert {unguard_cell(row[0]) for row in rows[1:]} == {name}
    assert len({len(row) for row in rows}) == 1
    for cell in (cell for row in rows for cell in row):
        assert cell[:1] not in SIGNS or not cell or re.fullmatch(r"[+-]?[\d.]+(e[+-]?\d+)?", cell)
    data = read_module_data(texts["python"])
    assert (data["study"], data["robot"], data["targets"]) == (name, name, [name])
    assert (
        texts["python"].split("\nDATA: Data = ")[0]
        == plain()["x.python"].split("\nDATA: Data = ")[0]
    )
    assert texts["table"] == plain()["x.table"]


def test_every_python_module_is_imported(tmp_path) -> None:
    """In a process of its own, where modelsel cannot be imported: each is the arm, and nothing is
    written."""
    c = parse_calibration(plain()["calibration.json"])
    at = sample_workspace(c, 0, m=5)
    np.save(tmp_path / "q.npy", at.data.q)
    for k, name in enumerate(NAMES.values()):
        record = json.loads(plain()["calibration.json"])
        record["study"] = record["robot"]["name"] = record["targets"][0]["name"] = record["groups"][
            0
        ]["name"] = name
        (tmp_path / f"arm{k}.py").write_text(
            export(parse_calibration(json.dumps(record)), "python").text, "utf-8"
        )
    before = everything(tmp_path)
    code = (
        "import sys, json, importlib; sys.modules['modelsel'] = None; sys.dont_write_bytecode = True; import numpy as np\n"
        f"q = np.load('q.npy')\nout = []\nfor k in range({len(NAMES)}):\n"
        "    m = importlib.import_module(f'arm{k}')\n    given = {n: 1.0 for n in m.DATA['needs']}\n"
        "    x = m.position(q, m.DATA['targets'][0], **given)\n"
        "    out.append([m.DATA['study'], m.DATA['robot'], m.DATA['targets'][0], x.tolist()])\nprint(json.dumps(out))"
    )
    ran = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    for name, (study, robot, target, x) in zip(NAMES.values(), json.loads(ran.stdout), strict=True):
        assert study == robot == target == name
        if not read_module_data((tmp_path / "arm0.py").read_text("utf-8"))["needs"]:
            np.testing.assert_allclose(x, predict(c, at), atol=1e-9)
    assert everything(tmp_path) == before


@every(REFUSED)
@pytest.mark.parametrize("where", ["study", "robot", "source", "target", "group"])
def test_refused_in_one_sentence(where, name, tmp_path) -> None:
    """Each place of a study folder: what cannot be seen is refused with its place, nothing is
    written, nothing is shown raw."""
    if where == "source" and (
        len(name) == 201 or find_name_problem(" ".join(name.split()) or "none") is None
    ):
        return  # a source is a text: line breaks in it are blanks
    if "\ud800" in name and where != "group":
        return  # TOML has no way to write it
    folder = folder_of(tmp_path / "study", "fine", **{where: name})
    before = everything(tmp_path)
    said = told(
        "study",
        str(folder),
        "--out",
        str(tmp_path / "out"),
        "--no-sampling",
        "--no-report",
        status=3 if where == "group" else 2,
    )
    assert len(said.splitlines()) <= 2 + (where == "target")
    assert everything(tmp_path) == before


@every(REFUSED)
def test_refused_everywhere_else(name, tmp_path) -> None:
    """DataFrames, features, studies from Python, URDFs, stored calibrations, plug-ins."""
    assert find_name_problem(name) is not None
    frame = pd.read_csv(io.BytesIO(base_files()["measurements.csv"]))
    with pytest.raises(
        DataError, match=r"DataFrame, row 3, column target: .*(not a name|empty cell)"
    ):
        read_measurements(
            frame.assign(target=pd.Series(["a"] * 3 + [name] + ["b"] * 32, dtype=object)),
            (False,) * 3,
        )
    with pytest.raises(StudyError, match="name: not a name"):
        Study(name=name, robot={"name": "ur5", "tool_mm": [0, 0, 0]}, measurements="m.csv")
    with pytest.raises(StudyError, match="robot's name is not valid"):
        robot_from_table({"name": name, "joint": [{"dh": {}}]}, "robot.toml")
    record = json.loads(plain()["calibration.json"])
    for place in (
        record,
        record["robot"],
        record["targets"][0],
        record["groups"][0],
        *([record["mechanisms"][0]] if len(name) < 200 else []),
    ):
        key = "study" if place is record else "name"
        kept, place[key] = place[key], name
        with pytest.raises(StudyError):
            export(parse_calibration(json.dumps(record)), "urdf")
        place[key] = kept
    if len(name) > 200:
        return  # names of mechanisms may be longer: they are made of their causes
    made = Mechanism(name, (Term("t", (Screw(1, "rz", sin(q(1))),)),))
    assert find_entry_problem(name, lambda robot: made, load_robot("ur5")) is not None


def test_a_changed_calibration_runs_nothing(tmp_path, monkeypatch) -> None:
    """calibration.json by another hand: names of causes that are no words are refused, as is a
    target that is there twice."""
    monkeypatch.chdir(tmp_path)
    text = plain()["calibration.json"]
    for old, new in (
        ('"name": "q2"', '"name": "__import__(\'os\')"'),
        ('"name": "q2"', '"name": "q2 or 1"'),
    ):
        if old in text:
            with pytest.raises(StudyError, match="damaged"):
                parse_calibration(text.replace(old, new))
    record = json.loads(text)
    record["targets"] *= 2
    with pytest.raises(StudyError, match="two targets"):
        parse_calibration(json.dumps(record))
    with pytest.raises(ValueError, match="malformed"):
        read_module_data(
            write_module({}).replace("= {}\n", "= {'a': __import__('os').system('touch PWNED')}\n")
        )
    with pytest.raises(ValueError, match="not a module"):
        read_module_data("import os\n" + write_module({}))
    assert everything(tmp_path) == set()


@every(NAMES)
def test_fleet_folders_stay_below(name, tmp_path) -> None:
    """A study's folder in a fleet: its name, or refused; never a folder elsewhere, a device or a
    hidden one."""
    folder_of(tmp_path / "arm", "fine")
    (tmp_path / "fleet.toml").write_text(
        f'name = {quoted(name)}\n[[study]]\nfile = "arm/study.toml"\nname = {quoted(name)}\n',
        "utf-8",
    )
    if name in ("../../..", "/etc/x", "CON") or set(name) & set('\\/:*?"<>|'):
        with pytest.raises(StudyError, match="is not a name for a folder"):
            read_fleet(tmp_path / "fleet.toml")
        return
    (task,) = read_fleet(tmp_path / "fleet.toml").tasks
    assert (tmp_path / "out" / task.name).resolve().parent == (tmp_path / "out").resolve()
    assert not task.name.startswith(".")


@pytest.mark.parametrize(
    "name",
    [
        "con",
        "NUL.txt",
        "com1",
        ".modelsel",
        "summary.csv",
        "a.",
        "a ",
        ".",
        "..",
        "a/b",
        "a\\b",
        "C:a",
    ],
)
def test_fleet_names_that_are_no_folder(name, tmp_path) -> None:
    folder_of(tmp_path / "arm", "fine")
    (tmp_path / "fleet.toml").write_text(
        f'name = "x"\n[[study]]\nfile = "arm/study.toml"\nname = {quoted(name)}\n'
    )
    with pytest.raises(StudyError, match="is not a name for a folder"):
        read_fleet(tmp_path / "fleet.toml")
    (tmp_path / "fleet.toml").write_text(
        'name = "x"\n'
        + "".join(f'[[study]]\nfile = "arm/study.toml"\nname = "{n}"\n' for n in ("Cell", "cell"))
    )
    with pytest.raises(StudyError, match="stands twice"):
        read_fleet(tmp_path / "fleet.toml")


@every({**NAMES, **REFUSED})
def test_column_names_and_mechanisms(name, tmp_path, monkeypatch) -> None:
    """A column may be called anything: it can be mapped, and is told where it is not used. A
    package's name is a plain word."""
    monkeypatch.chdir(tmp_path)
    if name.strip() and not set(name) & set("\ud800\r\0"):  # of which no CSV can be made
        folder = folder_of(tmp_path / "study", "fine", column=f"the {name} load")
        measured = read_measurements(
            folder / "measurements.csv", (False,) * 3, {"payload_kg": f"the {name} load"}
        )
        assert measured.covariates["payload_kg"].max() == 5.0
        told("check", str(folder / "measurements.csv"), "--robot", str(folder / "robot.toml"))
    columns = (
        {f"a{name}": "text", f"b{name}": 1.0} if "\ud800" not in name else {}
    )  # which no DataFrame has, either
    frame = pd.read_csv(io.BytesIO(base_files()["measurements.csv"])).assign(**columns)
    for note in read_measurements(frame, (False,) * 3).notes:
        assert not INSIDE.search(note.sentence)
    before = everything(tmp_path)
    ran = CliRunner().invoke(run_command_line, ["mechanisms", f"--new={name}"])
    assert ran.exit_code in (0, 2)
    assert everything(tmp_path) - before <= {
        name,
        f"{name}/pyproject.toml",
        f"{name}/{name}.py",
        f"{name}/README.md",
    }
    assert ran.exit_code == 2 or name in ("base", "link2")


@every(NAMES)
def test_links_of_a_urdf(name, tmp_path) -> None:
    """Names of links and joints of the user's own file, and of what is written: quoted by the XML
    library, said as they are."""
    root = ET.Element("robot", name=name)
    for link in ("world", name, "tip"):
        ET.SubElement(root, "link", name=link)
    for joint, (parent, child) in (("turn", ("world", name)), (name, (name, "tip"))):
        element = ET.SubElement(root, "joint", name=joint, type="revolute")
        ET.SubElement(element, "parent", link=parent)
        ET.SubElement(element, "child", link=child)
    text = ET.tostring(root, encoding="unicode")
    robot = read_urdf_text(text, "arm.urdf", tip=name)
    assert (robot.n, robot.name) == (1, name)
    root[-1].set("type", "floating")
    with pytest.raises(ModelselError) as error:
        read_urdf_text(ET.tostring(root, encoding="unicode"), "arm.urdf")
    assert len(str(error.value).splitlines()) == 1


# -- cells that are formulas
# ---------------------------------------------------------------------------------------------------


@every({**NAMES, "empty": "", "two": "''=x", "sign": "-", "number": "-1.5e-3"})
def test_a_guarded_cell_comes_back(name) -> None:
    """No spreadsheet runs it, and what is read back is exact."""
    cell = guard_cell(name)
    assert unguard_cell(cell) == name
    assert not cell or cell[0] not in SIGNS or re.fullmatch(r"[+-][\d.]+(e[+-]?\d+)?", cell)
    assert cell in (name, f"'{name}")


@every(
    {
        k: NAMES[k]
        for k in (
            "formula",
            "plus",
            "plus one",
            "minus",
            "at",
            "full-width",
            "apostrophe formula",
            "csv",
            "quote",
        )
    }
)
def test_commands_are_guarded_and_read_back(name, tmp_path) -> None:
    """`simulate` and `compensate` write a target's name so that no spreadsheet runs it, and read it
    as it was."""
    folder = folder_of(tmp_path / "study", name)
    told("study", str(folder), "--out", str(tmp_path / "out"), "--no-sampling", "--no-report")
    told("simulate", str(folder), "--out", str(folder / "planted.csv"))
    told(
        "compensate",
        str(tmp_path / "out"),
        str(folder / "measurements.csv"),
        "--column",
        "payload_kg=load",
        "--out",
        str(folder / "commands.csv"),
        "--forward",
    )
    for file in ("planted.csv", "commands.csv"):
        cells = [
            row["target"] for row in csv.DictReader(io.StringIO((folder / file).read_text("utf-8")))
        ]
        assert guard_cell(name) in cells
        assert name in read_measurements(folder / file, (False,) * 3).targets


def test_study_text_is_not_pasted() -> None:
    """A study's own text with every name at once."""
    for name in NAMES.values():
        study = parse_study(
            f'name = {quoted(name)}\n[robot]\nname = "ur5"\n[robot.tools_mm]\n{quoted(name)} = [0, 0, 1]\n[measurements]\n'
            'file = "m.csv"\n',
            "study.toml",
        )
        assert study.name == name
        assert list(study.robot.tools_mm or {}) == [name]
