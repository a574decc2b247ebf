"""The report in PDF: tagged, embedded, silent, the same bytes twice; from files alone; sound where
there is little to draw."""

from __future__ import annotations

import io
import itertools
import json
import re
import shutil
import subprocess
import sys
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from report_studies import read_source, source_of, written

from modelsel import read_study
from modelsel.cli.main import run_command_line
from modelsel.exceptions import StudyError
from modelsel.report import drawing
from modelsel.report.document import (
    bind_words,
    collect_blocks,
    make_table,
    make_text,
    share_room,
    use_minus,
    walk_blocks,
)
from modelsel.report.pages.appendix import write_outliers_page
from modelsel.report.pdf import (
    ReportError,
    _export,
    _write_inputs,
    compile_pdf,
    fill_template,
    find_missing_letters,
)
from modelsel.report.terminal_summary import summarise_study
from modelsel.results.numbers.quantities import format_figure
from modelsel.results.sentences.study_sentences import TABLE_PURPOSE
from modelsel.results.storage import WRITES
from modelsel.study.pipeline.runner import run_study

ROOT = Path(__file__).parents[2]
PUMA = ROOT / "studies" / "puma760"
A4 = (595, 842)
FOOT = 54  # points: below it stands the foot of a page
LARGE_PICTURES = {  # heading, first words of the caption
    "Residuals against what may drive them": "Residuals of the chosen model along x",
    "Error map": "Why (rows) and where (columns) the base model errs",
    "Data and split": "Joint coverage. A stroke is one reading",
}


@cache
def pages(folder: Path) -> list[str]:
    return texts((folder / "report.pdf").read_bytes())


def texts(pdf: bytes) -> list[str]:
    """The text of every page."""
    from pypdf import PdfReader

    return [page.extract_text() for page in PdfReader(io.BytesIO(pdf)).pages]


def walked(node: object) -> list[dict]:
    """All structure elements below a node of the tag tree."""
    from pypdf.generic import ArrayObject, DictionaryObject

    node = node.get_object() if hasattr(node, "get_object") else node
    if isinstance(node, ArrayObject):
        return [e for kid in node for e in walked(kid)]
    if not isinstance(node, DictionaryObject):
        return []
    return ([node] if "/S" in node else []) + (walked(node["/K"]) if "/K" in node else [])


def plain(text: str) -> str:
    return re.sub(r"[\s\u200b]+", "", text)


def test_files_are_there_and_small(drawn) -> None:
    assert {p.name for p in drawn.iterdir()} == {*WRITES, "report.pdf", "report.html"}
    assert (drawn / "report.pdf").stat().st_size < 3e6
    # poppler says "Suspects object is wrong type" of the key, whatever its value
    assert b"/Suspects" not in (drawn / "report.pdf").read_bytes()
    assert (drawn / "details.json").stat().st_size < 2e6


@pytest.mark.slow
def test_tagged_titled_every_figure_with_a_text(drawn) -> None:
    from pypdf import PdfReader

    reader = PdfReader(drawn / "report.pdf")
    root = reader.trailer["/Root"]
    assert root["/MarkInfo"]["/Marked"]
    assert root["/Lang"] == "en"
    assert reader.metadata.title == "Calibration report: PUMA 760 (simulated stand-in)"
    assert "pdfuaid:part" in root["/Metadata"].get_object().get_data().decode()
    tags = walked(root["/StructTreeRoot"])
    figures, source = [t for t in tags if t["/S"] == "/Figure"], read_source(drawn)
    blocks = collect_blocks(source, drawing.PAGES)
    assert len(figures) >= len(source.pictures) > 10
    told = {b["alt"] for b in walk_blocks(blocks) if b["kind"] == "figure"}
    assert len(told) == len(source.pictures)
    assert told <= {str(t["/Alt"]) for t in figures}
    assert (
        compile_pdf(fill_template(source, blocks), source.pictures)[1] == []
    )  # no word of the compiler
    assert all(len(str(t["/Alt"])) > 20 for t in figures)
    assert sum(t["/S"] == "/Table" for t in tags) >= 5


def test_fonts_are_embedded(drawn) -> None:
    from pypdf import PdfReader

    fonts = [
        f.get_object() for page in PdfReader(drawn / "report.pdf").pages for f in fonts_of(page)
    ]
    assert fonts
    for font in fonts:
        inner = font["/DescendantFonts"][0].get_object()["/FontDescriptor"].get_object()
        assert {"/FontFile2", "/FontFile3"} & set(inner)
        assert "DejaVuSans" in str(font["/BaseFont"])


def fonts_of(page: dict) -> list:
    """Fonts of a page and of the pictures on it."""
    resources = page["/Resources"].get_object()
    out = list(resources.get("/Font", {}).values())
    for inner in resources.get("/XObject", {}).values():
        if "/Resources" in inner.get_object():
            out += fonts_of(inner.get_object())
    return out


@pytest.mark.slow
def test_first_page_stands_alone(drawn) -> None:
    """Its sentences are those of result.json; so is every number outside the picture."""
    result, first = json.loads((drawn / "result.json").read_text()), pages(drawn)[0]
    assert len(result["verdict"]) == 3
    for sentence in result["verdict"]:
        assert plain(sentence) in plain(first)
    for finding, said in zip(result["findings"], read_source(drawn).details.findings, strict=True):
        assert plain(said.label) in plain(first)
        assert finding["sentence"].startswith(said.what)
    captions = [
        b["caption"]
        for b in collect_blocks(read_source(drawn), drawing.PAGES, ("first",))
        if "caption" in b
    ]
    assert captions
    assert not [c for c in captions if re.search(r"\d", c)]


@pytest.mark.slow
def test_numbers_of_the_ladder_are_the_result_s(drawn) -> None:
    result, text = json.loads((drawn / "result.json").read_text()), plain("".join(pages(drawn)))
    for rung in result["ladder"]:
        row = "".join(
            f"{rung[s][k]:.3f}" if rung[s][k] < 9.9995 else f"{rung[s][k]:.2f}"
            for s in ("estimation", "held_out")
            for k in ("rms_mm", "max_mm")
        )
        assert row in text


@pytest.mark.slow
def test_what_the_table_of_subsets_is_for_is_said_with_it(drawn) -> None:
    """It may add names where nothing else was found: in the PDF, and below the table on a
    terminal."""
    (page,) = [p for p in pages(drawn) if "The table of subsets" in p]
    assert plain(TABLE_PURPOSE) in plain(page)
    folder = shutil.copytree(drawn, drawn.parent / "said")
    ran = CliRunner().invoke(run_command_line, ["report", str(folder), "--verbose"])
    assert plain(TABLE_PURPOSE) in plain(ran.output)


def test_every_finding_stands_whole_on_a_page(drawn) -> None:
    """Its sentence, what to do and its verdict, none of them parted from its title."""
    result, found = json.loads((drawn / "result.json").read_text()), pages(drawn)
    for k, finding in enumerate(result["findings"], 1):
        (page,) = [p for p in found if f"Finding {k}:" in p]
        own = plain(page).partition(f"Finding{k}:")[2].partition(f"Finding{k + 1}:")[0]
        assert plain(use_minus(finding["sentence"])) in own
        assert "Whattodo." in own
        assert f"Verdict:{plain(finding['verdict'])}" in own
        assert ("Whatitcouldbe" in own) == (len(finding["credible_set"]) > 1)


def measure_rests(file: Path | io.BytesIO) -> list[float]:
    """The share of every page below its last line."""
    from pdfminer.high_level import extract_pages

    left = []
    for page in extract_pages(file, laparams=None):
        low = min(item.y0 for item in page if item.y0 > FOOT)
        left.append((low - FOOT) / (A4[1] - 2 * FOOT))
    return left


@pytest.mark.slow
def test_nine_pages_at_most_and_none_half_empty(drawn) -> None:
    """Of the PUMA: below the last line of a page, a fifth of it is left at most; of the last, three fifths."""
    left = measure_rests(drawn / "report.pdf")
    assert len(left) <= 9
    assert max(left[:-1]) < 0.2
    assert left[-1] < 0.6


@pytest.mark.slow
@pytest.mark.parametrize(
    "count", [0, 1, 3, *(pytest.param(count, marks=pytest.mark.long) for count in (2, 4, 5))]
)
def test_no_page_is_half_empty_whatever_was_found(drawn, count) -> None:
    """With more and fewer findings, large pictures meet other ends of pages."""
    result, details = written(drawn)
    del result["findings"][count:], details["findings"][count:]
    source = source_of(result, details)
    blocks = collect_blocks(source, drawing.PAGES)
    pdf, warnings = compile_pdf(fill_template(source, blocks), source.pictures)
    assert not warnings
    *left, last = measure_rests(io.BytesIO(pdf))
    assert max(left) < 0.3
    assert last < 0.65


def test_a_large_picture_stands_on_the_page_of_its_heading(drawn) -> None:
    """With its caption; what follows it begins with a heading of its own."""
    text = [plain(page) for page in pages(drawn)]
    for heading, caption in LARGE_PICTURES.items():
        (page,) = [k for k, one in enumerate(text) if plain(caption) in one]
        (place,) = [k for k, one in enumerate(text) if plain(heading) in one]
        assert page == place
        assert text[page].index(plain(heading)) < text[page].index(plain(caption))


@pytest.mark.parametrize("room", ["1", "0.5"])
def test_lines_do_not_touch_with_less_room(drawn, tmp_path, room) -> None:
    """The title and the line below it are apart, and paragraphs more than the lines of one."""
    from pdfminer.high_level import extract_pages
    from pdfminer.layout import LTTextLine

    source = read_source(drawn)
    blocks = collect_blocks(source, drawing.PAGES, ["first"])
    content = fill_template(source, blocks)
    _write_inputs(tmp_path, source.pictures)
    pdf, _ = _export(tmp_path, content, [blocks], room)
    (page,) = extract_pages(io.BytesIO(pdf))
    lines = [line for box in page for line in (box if hasattr(box, "__iter__") else [])]
    rows = {line.get_text().strip(): line for line in lines if isinstance(line, LTTextLine)}
    title = rows[source.record.study]
    robot = next(line for text, line in rows.items() if text.startswith("Robot "))
    assert title.y0 > robot.y1 - 1
    lead = [line for line in rows.values() if abs(line.height - 9.6) < 0.7]
    steps = sorted({round(one.y1 - other.y1, 1) for one, other in itertools.pairwise(lead)})
    assert steps[-1] > 1.2 * steps[0]


def test_words_are_found_as_they_are_written(drawn) -> None:
    """No character that nobody sees stands in the text, and names of mechanisms are whole."""
    text = "".join(pages(drawn))
    assert not set(text) & {"\u200b", "\u00ad", "\u2060", "\ufeff"}
    result = json.loads((drawn / "result.json").read_text())
    first, second = pages(drawn)[:2]
    for finding in result["findings"]:
        assert finding["credible_set"][0]["mechanism"] in first
    for parameter in result["parameters"]:
        assert parameter["symbol"] in second


@pytest.mark.slow
def test_one_measure_of_error_in_text_and_pictures(drawn) -> None:
    """Errors are root mean squares wherever one figure stands for many; a mean error stands nowhere."""
    source = read_source(drawn)
    blocks = collect_blocks(source, drawing.PAGES, ("first", "residuals", "models", "map", "data"))
    words = json.dumps(list(walk_blocks(blocks)), ensure_ascii=False)
    assert "mean error" not in words
    assert "mean position" not in words + source.pictures["ladder.svg"].decode()
    last = source.record.ladder[-1].held_out
    assert format_figure(last.rms_mm) in source.pictures["ladder.svg"].decode()


def within_margins(file: Path | io.BytesIO) -> None:
    """Every letter stands within the margins, those of pictures, too; header and footer stand above
    and below."""
    from pdfminer.high_level import extract_pages
    from pdfminer.layout import LTChar

    def letters(node: object) -> list[LTChar]:
        if isinstance(node, LTChar):
            return [node]
        return [c for kid in node for c in letters(kid)] if hasattr(node, "__iter__") else []

    for page in extract_pages(file, laparams=None):
        found = letters(page)
        assert len(found) > 100
        assert min(c.x0 for c in found) > 60
        assert min(c.y0 for c in found) > 20
        assert max(c.x1 for c in found) < A4[0] - 55
        assert max(c.y1 for c in found) < A4[1] - 20


@pytest.mark.slow
def test_nothing_runs_off_the_page(drawn) -> None:
    within_margins(drawn / "report.pdf")


@pytest.mark.slow
def test_names_without_blanks_do_not_run_off_the_page(drawn) -> None:
    """The study's, the operator's, and those of targets in the table of parameters."""
    result, details = written(drawn)
    name = "W" * 200
    result["study"] = name
    details["campaign"] = {"operator": name}
    details["parameters"][0]["meaning"] = f"target along the flange's x, target {name}"
    source = source_of(result, details)
    blocks = collect_blocks(source, drawing.PAGES, ("first", "parameters", "provenance"))
    pdf, _ = compile_pdf(fill_template(source, blocks), source.pictures)
    within_margins(io.BytesIO(pdf))
    text = "".join(texts(pdf)).replace("\n", "")
    assert text.count(name) >= 4


def test_letters_that_no_font_has_are_told(drawn, tmp_path) -> None:
    """As the report is drawn; of what there are letters for, nothing is said."""
    result, details = written(drawn)
    assert find_missing_letters(fill_template(source_of(result, details), [])) == ""
    result["study"] = "Prüfstand ЖΩ 机器人 机"
    source = source_of(result, details)
    said: list[str] = []
    drawing.draw_records(source.record, source.details, tmp_path, ["first"], said.append)
    (note,) = [line for line in said if "no letters" in line]
    assert note.startswith("report.pdf has no letters for 机器人 and")


@pytest.mark.slow
def test_same_bytes_anywhere(drawn, tmp_path) -> None:
    for name in ("result.json", "details.json"):
        shutil.copy(drawn / name, tmp_path)
    code = f"from pathlib import Path; from modelsel.report.drawing import draw; draw(Path({str(tmp_path)!r}))"
    subprocess.run(
        [sys.executable, "-c", code], check=True, cwd=tmp_path
    )  # another process, another hash seed
    for name in ("report.pdf", "report.html"):
        assert (tmp_path / name).read_bytes() == (drawn / name).read_bytes()


@pytest.mark.slow
def test_study_writes_the_same_details_again(drawn, tmp_path) -> None:
    again = CliRunner().invoke(
        run_command_line, ["study", str(PUMA / "study.toml"), "--out", str(tmp_path), "--no-report"]
    )
    assert again.exit_code == 0
    assert {p.name for p in tmp_path.iterdir()} == set(WRITES)
    for name in ("result.json", "details.json"):
        assert (tmp_path / name).read_bytes() == (drawn / name).read_bytes()


def test_pages_are_chosen(drawn, tmp_path) -> None:
    """Into a file of their own: the full report stays as it is."""
    for name in ("result.json", "details.json", "report.pdf", "report.html"):
        shutil.copy(drawn / name, tmp_path)
    done = CliRunner().invoke(
        run_command_line, ["report", str(tmp_path), "--pages", "first, map", "--json"]
    )
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout) == {"written": ["report-pages.pdf"]}
    text = texts((tmp_path / "report-pages.pdf").read_bytes())
    assert len(text) == 2
    assert "Error map" in text[1]
    for name in ("report.pdf", "report.html"):
        assert (tmp_path / name).read_bytes() == (drawn / name).read_bytes()
    unknown = CliRunner().invoke(
        run_command_line, ["report", str(tmp_path), "--pages", "first,foo"]
    )
    assert (unknown.exit_code, unknown.stdout) == (2, "")
    assert 'no page "foo"' in unknown.stderr
    assert unknown.stderr.count("map") == 1
    wrong = CliRunner().invoke(run_command_line, ["report", str(tmp_path), "--pages", "frist"])
    assert wrong.exit_code == 2
    assert 'Did you mean "first"?' in wrong.output


def test_the_folder_of_a_study_finds_its_report(drawn, tmp_path, monkeypatch) -> None:
    """As `compare` does; a folder that has a result is taken as it is."""
    monkeypatch.chdir(tmp_path)
    report = tmp_path / "reports" / "cell"
    report.mkdir(parents=True)
    for name in ("result.json", "details.json", "calibration.json"):
        shutil.copy(drawn / name, report)
    name = json.loads((drawn / "result.json").read_text())["study"]
    (tmp_path / "cell").mkdir()
    (tmp_path / "cell" / "study.toml").write_text(f"name = {json.dumps(name)}\n")
    words = ["report", "cell", "--pages", "map", "--json"]
    done = CliRunner().invoke(run_command_line, words)
    assert done.exit_code == 0, done.output
    assert (report / "report-pages.pdf").exists()
    for name in ("result.json", "details.json"):
        shutil.move(report / name, tmp_path / "cell")
    assert CliRunner().invoke(run_command_line, words).exit_code == 0
    assert (tmp_path / "cell" / "report-pages.pdf").exists()


def test_the_summary_is_two_pages_beside_the_full_report(drawn, tmp_path) -> None:
    for name in ("result.json", "details.json", "report.pdf"):
        shutil.copy(drawn / name, tmp_path)
    done = CliRunner().invoke(run_command_line, ["report", str(tmp_path), "--summary", "--json"])
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout) == {"written": ["report-summary.pdf"]}
    first, second = texts((tmp_path / "report-summary.pdf").read_bytes())
    assert plain(json.loads((drawn / "result.json").read_text())["verdict"][0]) in plain(first)
    assert "Calibrated parameters" in second
    assert "1 / 2" in first
    assert (tmp_path / "report.pdf").read_bytes() == (drawn / "report.pdf").read_bytes()
    within_margins(tmp_path / "report-summary.pdf")
    both = ["report", str(tmp_path), "--summary", "--pages", "first"]
    wrong = CliRunner().invoke(run_command_line, both)
    assert wrong.exit_code == 2
    assert "leave out --pages" in wrong.output


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda d: (d / "result.json").unlink(), "there is no result.json"),
        (lambda d: (d / "details.json").unlink(), "there is no details.json"),
        (lambda d: (d / "result.json").write_text('{"schema": 2}'), "schema 2"),
        (lambda d: (d / "result.json").write_text("{"), "cannot be read"),
        (
            lambda d: (d / "details.json").write_text('{"schema": 1, "data_sha256": "x"}'),
            "another run",
        ),
    ],
)
def test_refuses_in_one_sentence(drawn, tmp_path, change, said) -> None:
    for name in ("result.json", "details.json"):
        shutil.copy(drawn / name, tmp_path)
    change(tmp_path)
    done = CliRunner().invoke(run_command_line, ["report", str(tmp_path)])
    assert done.exit_code == 2
    assert said in done.output
    assert "modelsel study" in done.output
    assert len(done.output.strip().splitlines()) == 1


@pytest.mark.slow
def test_words_of_the_data_are_not_markup(drawn) -> None:
    """A study's name may hold what typst would read as a command."""
    result, details = written(drawn)
    name = '#panic("x") *bold* $y$ <label> @ref `raw` \\ "quoted" // gone'
    result["study"] = result["findings"][0]["sentence"] = name
    source = source_of(result, details)
    blocks = collect_blocks(source, drawing.PAGES, ("first", "findings"))
    pdf, warnings = compile_pdf(fill_template(source, blocks), source.pictures)
    assert not warnings
    assert plain(name) in plain(texts(pdf)[0])


@pytest.mark.slow
def test_long_names_keep_their_place(drawn) -> None:
    """The first page stays one, a finding stands on one, and nothing stands outside the margins."""
    result, details = written(drawn)
    name = "a-name-that-nobody-shortened-when-it-was-written-down:12"
    result["study"] = (
        "The third arm of cell 12 in hall B after the exchange of its elbow gear, measured by the night shift"
    )
    for said, finding in zip(details["findings"], result["findings"], strict=True):
        said.update(label=name, what=said["what"] + 12 * " and so on")
        finding.update(
            sentence=3 * finding["sentence"],
            credible_set=8 * [finding["credible_set"][0] | {"mechanism": name}],
        )
    for rung in result["ladder"][2:]:
        rung["mechanisms"] = ["geometric", *(len(rung["mechanisms"]) - 1) * [name]]
    result["findings"], details["findings"] = 3 * result["findings"], 3 * details["findings"]
    source = source_of(result, details)
    blocks = collect_blocks(source, drawing.PAGES, ("first", "findings"))
    pdf, warnings = compile_pdf(fill_template(source, blocks), source.pictures)
    assert not warnings
    found = texts(pdf)
    assert "Finding" not in found[0]
    for number in range(1, 1 + len(result["findings"])):
        assert sum(f"Finding {number}:" in page for page in found) == 1
    within_margins(io.BytesIO(pdf))


@pytest.mark.slow
def test_failure_leaves_the_result(monkeypatch, tmp_path) -> None:
    def broken(*_: object) -> None:
        raise ReportError("the compiler is ill")

    monkeypatch.setattr(drawing, "collect_blocks", broken)
    done = CliRunner().invoke(
        run_command_line,
        ["study", str(PUMA / "study.toml"), "--out", str(tmp_path), "--no-sampling"],
    )
    assert done.exit_code == 1
    assert "the compiler is ill" in done.output
    assert "Position error, held-out configurations" in done.output
    assert json.loads((tmp_path / "result.json").read_text())["schema"] == 1


# -- little to draw
# ------------------------------------------------------------------------------------------------------


def small(
    folder: Path,
    *,
    estimation: int = 40,
    candidates: str = '["backlash"]',
    base: str = '["geometric"]',
    orientation: bool = False,
) -> Path:
    """A study of some of the PUMA's rows."""
    data = pd.read_csv(PUMA / "measurements.csv").iloc[:60].reset_index(drop=True)
    if orientation:
        from scipy.spatial.transform import Rotation

        from modelsel.robot.files import load_robot
        from modelsel.robot.kinematics import pose
        from modelsel.robot.rigid import rotation_matrix

        q = data[[f"q{j}_rad" for j in range(1, 7)]].to_numpy()
        R = pose(load_robot("puma760"), q, np.array([0.0, 0, 100])).rotation.transpose(2, 0, 1)
        data[["qx", "qy", "qz", "qw"]] = Rotation.from_matrix(
            R @ rotation_matrix(2, 1e-3)
        ).as_quat()
    data.to_csv(folder / "measurements.csv", index=False)
    text = (
        'name = "small"\nseed = 1\n[robot]\nname = "puma760"\ntool_mm = [0, 0, 100]\n'
        f'[measurements]\nfile = "measurements.csv"\n[split]\nestimation = {estimation}\n'
        f"[model]\nbase = {base}\ncandidates = {candidates}\n[comparison]\nfolds = 5\n"
    )
    (folder / "study.toml").write_text(text)
    return folder


LITTLE = {
    "nothing extends": {"candidates": "[]"},
    "nothing held out": {"estimation": 60},
    "one held out": {"estimation": 59},
    "orientations": {"orientation": True},
    "named causes only": {"candidates": '["thermal-zero"]'},
    "no base": {"base": "[]"},
    "another base": {"base": '["geometric", "gravity-twist"]'},
}


@pytest.mark.slow
@pytest.mark.parametrize("case", LITTLE)
def test_sound_with_little_to_draw(case, tmp_path) -> None:
    folder = small(tmp_path, **LITTLE[case])
    result = run_study(read_study(folder / "study.toml"), folder, sampling=False)
    out = tmp_path / "out"
    result.save(out)
    assert drawing.draw(out) == [out / "report.pdf", out / "report.html"]
    text = pages(out)
    for sentence in json.loads((out / "result.json").read_text())["verdict"]:
        assert plain(sentence) in plain(text[0])
    assert (
        "NaN"
        not in (out / "report.html")
        .read_text(encoding="utf-8")
        .partition('id="data"')[2]
        .partition("</script>")[0]
    )


def test_no_finding_no_sampling_no_outlier(drawn) -> None:
    """A result of nothing at all still makes a report."""
    result, details = written(drawn)
    result.update(
        findings=[],
        outliers=[],
        unidentifiable=[],
        warnings=[],
        path=[],
        sampling=None,
        nested_cv=None,
    )
    result["error_map"] = {"places": [], "causes": [], "f": [], "p_family_wise": []}
    result["candidates"]["best"] = []
    details.update(findings=[], map={"places": [], "columns": [], "slopes": [], "named": []})
    source = source_of(result, details)
    pdf, warnings = compile_pdf(
        fill_template(source, collect_blocks(source, drawing.PAGES)), source.pictures
    )
    assert pdf.startswith(b"%PDF")
    assert not warnings


def fault_of(finding: dict, rows: list[int]) -> dict:
    """The finding as a fault of the data that concerns some rows."""
    first, *others = finding["credible_set"]
    named = first | {"mechanism": "fault:tracker-bumped"}
    return finding | {"credible_set": [named, *others], "rows": rows}


def test_a_fault_is_told_once_and_its_rows_with_the_outliers(drawn) -> None:
    result, details = written(drawn)
    result["findings"][1] = fault_of(result["findings"][1], [3, 5])
    details["findings"][1]["label"] = "fault:tracker-bumped"
    source = source_of(result, details)
    lines = summarise_study(source.record, source.details, 80)
    assert any(line.endswith(details["findings"][1]["what"]) for line in lines)
    words = [b for b in collect_blocks(source, drawing.PAGES, ("outliers",)) if "items" in b]
    assert words[0]["items"] == [
        f"Finding 2, fault:tracker-bumped, concerns 2 rows ({source.where.listed([3, 5])})."
    ]


def test_notes_are_no_warnings(drawn) -> None:
    """One word for them in the terminal and in the report; what looks wrong is a warning."""
    result, details = written(drawn)
    result["warnings"] = [
        {"code": "setup-mistake", "sentence": "Something is wrong."},
        {"code": "counters-ignored", "sentence": "Columns are ignored."},
    ]
    blocks = write_outliers_page(source_of(result, details))
    kinds = [(block.get("text"), block.get("items")) for block in blocks if block["kind"] != "text"]
    assert kinds[-4:] == [
        ("Warnings", None),
        (None, ["Something is wrong."]),
        ("Notes", None),
        (None, ["Columns are ignored."]),
    ]
    assert kinds[0][0] == "Outliers and notes"


def test_words_stay_with_the_table_that_they_introduce() -> None:
    table = make_table([("a", "left")], [["1"]])
    blocks = [make_text("lead", "lead"), table, make_text("words"), table, make_text("last")]
    assert [block.get("keep") for block in bind_words(blocks)] == [False, None, True, None, False]


def test_steps_of_the_search_say_what_changed(drawn) -> None:
    result, details = written(drawn)
    result["path"] = ["+ backlash:3", "backlash:3 -> backlash:3", "- a", "b -> c"]
    blocks = collect_blocks(source_of(result, details), drawing.PAGES, ("provenance",))
    (table,) = [block for block in blocks if block.get("caption", "").startswith("In this order")]
    assert table["rows"] == [
        ["1", "+", "backlash:3", ""],
        ["2", "→", "backlash:3", "another form of the same"],
        ["3", "−", "a", ""],
        ["4", "→", "b", "c"],
    ]
    assert table["breaks"]


def extended(result: dict, rng: np.random.Generator) -> dict:
    """The result with what sampling adds."""
    symbols, low, median, high = [f"p{k}" for k in range(12)], -1e-3, 0.0, 1e-3
    r = np.corrcoef(rng.standard_normal((12, 30)))
    one = {
        "mechanism": "geometric",
        "unit": "rad",
        "standard_error": 0.3,
        "bootstrap_error": 0.3,
        "posterior_error": None,
        "mean_mm": 0.1,
        "max_mm": 0.2,
        "configurations": 80.0,
        "differ": False,
    }
    return result | {
        "parameters": [
            {**one, "symbol": s, "estimate": v, "low": v - 0.6, "high": v + 0.6}
            for s, v in zip(symbols, rng.standard_normal(12), strict=True)
        ],
        "correlation": {
            "symbols": symbols,
            "matrix": r.tolist(),
            "clusters": [["p0", "p1"], ["p4", "p7", "p9"]],
            "pairs": [{"a": "p0", "b": "p1", "r": 0.99, "sentence": "p0 goes with p1."}],
        },
        "significance": [
            {
                "mechanism": "gravity-twist",
                "parameters": ["p0"],
                "mean_mm": 1.234,
                "max_mm": 2.0,
                "f": 10.0,
                "p": 1e-9,
                "log10_evidence": -3.21,
                "cv_rms_mm": 1.0,
                "cv_rms_without_mm": 2.0,
                "held_out_rms_mm": 0.5,
                "held_out_rms_without_mm": None,
                "catalogue": "larger than usual",
                "stability": 0.925,
            }
        ],
        "sampling": {
            "effective_samples": 500,
            "r_hat": 1.001,
            "tau": 30.0,
            "steps": 1500,
            "walkers": 48,
            "converged": True,
            "sampled": symbols[:3],
            "sentence": "The named coefficients are sampled.",
            "quantiles": [
                {
                    "name": "p0",
                    "unit": "rad",
                    "low": low,
                    "median": median,
                    "high": high,
                    "closed_form_low": low,
                    "closed_form_median": median,
                    "closed_form_high": high,
                }
            ],
            "importance": {
                "draws": 100,
                "effective": 90,
                "sentence": "The closed form says the same.",
            },
            "trace": {"names": symbols[:3], "draws": rng.standard_normal((200, 3)).tolist()},
        },
    }


def test_sections_come_with_their_content(drawn, rng) -> None:
    result, details = written(drawn)
    chosen = ("parameters", "significance", "posterior")
    empty = {"symbols": [], "matrix": [], "pairs": [], "clusters": []}
    bare = result | {"parameters": [], "significance": [], "correlation": empty, "sampling": None}
    assert collect_blocks(source_of(bare, details), drawing.PAGES, chosen) == []
    full = source_of(extended(result, rng), details)
    pdf, warnings = compile_pdf(
        fill_template(full, collect_blocks(full, drawing.PAGES, chosen)), full.pictures
    )
    assert not warnings
    assert set(full.pictures) == {"frames.svg", "correlation.svg", "posterior.svg"}
    text = plain("".join(texts(pdf)))
    for word in (
        "gravity-twist1.2342.000<0.001−3.2–→0.50092%",
        "gravity-twist:largerthanusual",
        "p0goeswithp1.",
        "Theclosedformsaysthesame.",
    ):
        assert word in text
    result = extended(result, rng)
    result["sampling"].update(converged=False, quantiles=[])
    full = source_of(result, details)
    blocks = collect_blocks(full, drawing.PAGES, ("posterior",))
    assert any("had not converged" in b.get("text", "") for b in walk_blocks(blocks))
    drawn_here = [b.get("file") for b in walk_blocks(blocks) if b["kind"] in ("table", "figure")]
    assert drawn_here == ["correlation.svg"]


def test_refuses_pages_before_it_draws(drawn) -> None:
    with pytest.raises(StudyError, match="no page"):
        drawing.draw(drawn, ("nothing",))


def find_overprinted(pdf: bytes) -> list[str]:
    """The letters that stand on another letter."""
    from pdfminer.high_level import extract_pages
    from pdfminer.layout import LTChar

    def walk(node: object) -> Iterator[LTChar]:
        if isinstance(node, LTChar):
            yield node
        elif isinstance(node, Iterable):
            for inner in node:
                yield from walk(inner)

    letters = [one for one in walk(extract_pages(io.BytesIO(pdf))) if one.get_text().strip()]
    boxes = np.array([one.bbox for one in letters])
    low, high = boxes[:, :2], boxes[:, 2:]
    shared = np.minimum(high[:, None], high) - np.maximum(low[:, None], low)
    # a letter's box is a little larger than the letter
    is_on = (shared > 0.3 * (high - low).min(0)).all(-1)
    np.fill_diagonal(is_on, False)
    return [letters[k].get_text() for k in np.flatnonzero(is_on.any(1))]


@pytest.mark.integration
def test_long_names_stay_in_their_columns() -> None:
    """Names without blanks were set over the next column, and 'probability' took their room."""
    names = (
        "frame 3 rz · payload_kg*cos(q2+q3-0.2278)",
        "gear-eccentricity:6 (doubtful)",
        "frame 2 rz · free(approach2, torque2) (doubtful)",
        "encoder-eccentricity-with-a-long-name:6",
    )
    words = "Joint 6 is off its reading, depending on its own reading; how is not proven"
    proven = "0.98 for the drivers, below 0.01 for the cause"
    rows = [[name, words, "0.254", proven] for name in names]
    columns = [(name, "left") for name in ("finding", "what goes wrong", "mm", "probability")]
    widths = [0.4, 1.0, 0.0, share_room([proven], 0.45)]
    table = make_table(columns, rows, "", widths)
    content = {"title": "t", "short": "t", "robot": "", "made": "", "blocks": [table]}
    pdf, _ = compile_pdf(content, {})
    assert find_overprinted(pdf) == []


def test_a_column_is_as_narrow_as_short_texts() -> None:
    assert share_room(["1.00", "0.96, rivals"], 0.4) == 0
    assert share_room(["1.00", "0.98 for the drivers, below 0.01 for the cause"], 0.4) == 0.4
    assert share_room([], 0.4) == 0


def test_sentences_of_the_pdf_have_a_true_minus() -> None:
    """As its tables have; names with a hyphen and formulas stay."""
    words = (
        "gear-ripple:4: m = -0.17 mrad, joints at -12°, -3°; sin(q1-20), 2026-11-05, exp(t/(-3))"
    )
    said = make_text(words)["text"]
    assert (
        said
        == "gear-ripple:4: m = −0.17 mrad, joints at −12°, −3°; sin(q1-20), 2026-11-05, exp(t/(-3))"
    )
