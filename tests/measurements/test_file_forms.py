"""Measurements in the forms that other programs write: separators, decimal commas, encodings,
comments, empty rows, units, spreadsheets. Every form holds the numbers of one plain CSV."""

from __future__ import annotations

import zipfile
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np
import pandas as pd
import pytest

from modelsel.config.study_file import find_source, parse_study
from modelsel.exceptions import DataError, StudyError
from modelsel.measurements.formats.number_format import (
    convert_number_text,
    find_decimal_mark,
    find_mark_by_range,
)
from modelsel.measurements.formats.row_places import where_from_record
from modelsel.measurements.formats.table import DataFile, load_table
from modelsel.measurements.reader import read_measurements
from modelsel.robot.files import load_robot

NAMES = ["target", "q1_deg", "q2_deg", "q3_deg", "x_mm", "y_mm", "z_mm"]
ROWS = 8


def numbers() -> list[list[float]]:
    rng = np.random.default_rng(18)
    scale = np.array([170.0, 90, 120, 1500, 1500, 1500])
    return np.round(rng.uniform(-1, 1, (ROWS, 6)) * scale, 4).tolist()


def cells(decimal: str = ".") -> list[list[str]]:
    return [
        [f"Prüfkugel {k % 2}", *(str(value).replace(".", decimal) for value in row)]
        for k, row in enumerate(numbers())
    ]


def written(separator: str = ",", decimal: str = ".", end: str = "\n") -> str:
    return "".join(separator.join(row) + end for row in [NAMES, *cells(decimal)])


def german_excel() -> bytes:
    """As Excel in a German locale saves CSV, with a title above and an empty row at the end."""
    title = "Kalibrierung Halle 3;;;;;;\r\n;;;;;;\r\n"
    return (title + written(";", ",", "\r\n") + ";;;;;;\r\n").encode("cp1252")


def commented() -> bytes:
    """With comments of three kinds, one of them with an open quote, and an empty line between."""
    lines = written().splitlines()
    lines[4:4] = ["", '# 5" sphere, "cleaned', "// paused"]
    return "\n".join(["% tracker 1", *lines]).encode()


def with_units() -> bytes:
    lines = written("\t").splitlines()
    return "\n".join([lines[0], "-\t[°]\t[°]\t[°]\t[mm]\t[mm]\t[mm]", *lines[1:]]).encode()


def from_numpy() -> bytes:
    """As numpy.savetxt writes it: the header is a comment, blanks between."""
    rows = [[cell.replace(" ", "_") for cell in row] for row in [NAMES, *cells()]]
    return "\n".join(["# " + "   ".join(rows[0]), *("   ".join(row) for row in rows[1:])]).encode()


FORMS = {
    "plain": (written().encode(), 2, ""),
    "semicolons": (written(";").encode(), 2, "cells separated by semicolons"),
    "tabs, mark": (written("\t").encode("utf-8-sig"), 2, "cells separated by tabs"),
    "UTF-16": (written("\t").encode("utf-16"), 2, "text in UTF-16"),
    "UTF-16 without mark": (written(",").encode("utf-16-le"), 2, "text in UTF-16"),
    "German Excel": (
        german_excel(),
        4,
        "text in Windows-1252, cells separated by semicolons, decimal commas, the header on line 3",
    ),
    "quoted decimal commas": (
        "\n".join(",".join(f'"{cell}"' for cell in row) for row in [NAMES, *cells(",")]).encode(),
        2,
        "decimal commas",
    ),
    "comments": (commented(), 3, "3 lines are comments (1, 7, 8), line 6 is empty"),
    "units": (with_units(), 3, "cells separated by tabs, a row of units below the header"),
    "numpy": (from_numpy(), 2, "cells separated by blanks"),
    "Excel's hint": (b"sep=;\n" + written(";").encode(), 3, "the header on line 2"),
    "separators at the ends": (
        "\n".join(line + ";;" for line in written(";").splitlines()).encode(),
        2,
        "semicolons",
    ),
}


def read(path: Path):
    return read_measurements(path, (False,) * 3)


def check(data) -> None:
    expected = np.array(numbers())
    assert np.allclose(np.degrees(data.q), expected[:, :3], rtol=0, atol=1e-12)
    assert np.array_equal(data.position, expected[:, 3:])
    names = [name.replace("_", " ") for name in data.targets]
    assert names == ["Prüfkugel 0", "Prüfkugel 1"]


@pytest.mark.parametrize("form", FORMS)
def test_forms_of_text_hold_the_same_numbers(form, tmp_path) -> None:
    content, first, said = FORMS[form]
    path = tmp_path / "m.csv"
    path.write_bytes(content)
    data = read(path)
    check(data)
    assert data.where.number(0) == first
    notes = [note.sentence for note in data.notes if note.code == "file-format"]
    assert (said in notes[0]) if said else not notes


@pytest.mark.parametrize("form", FORMS)
def test_a_spoilt_cell_is_told_at_the_line_of_the_users_file(form, tmp_path) -> None:
    """The line as an editor counts it, whatever stands above and between."""
    content, _, _ = FORMS[form]
    path = tmp_path / "m.csv"
    encoding = "utf-16" if b"\0" in content else "cp1252" if b"\xfc" in content else "utf-8"
    encoding = "utf-16-le" if form == "UTF-16 without mark" else encoding
    text = content.decode(encoding)
    value = str(numbers()[5][2])
    value = value if value in text else value.replace(".", ",")
    lines = text.splitlines()
    (line,) = [k for k, content in enumerate(lines, 1) if value in content]
    path.write_bytes(text.replace(value, "n/a").encode(encoding))
    with pytest.raises(DataError, match=f'line {line}, column q3_deg: .*found "n/a"'):
        read(path)


@pytest.mark.parametrize(
    ("texts", "mark"),
    [
        (["1,5", "2,25"], ","),
        (["1,234", "12,345"], None),
        (["1,234", "12,345", "0,5"], ","),
        (["1,234", "12.5"], "."),
        (["1.234,5", "7"], ","),
        (["1,234.5", "7"], "."),
        (["1,5", "1.5"], "."),
        (["1 234,5"], ","),
        (["−1,5"], ","),
        (["1", "2"], "."),
    ],
)
def test_decimal_marks_by_all_numbers(texts, mark) -> None:
    assert find_decimal_mark(texts) == mark


@pytest.mark.parametrize(
    ("text", "mark", "number"),
    [
        ("1.234,5", ",", "1234.5"),
        ("1.234", ",", "1234"),
        ("1,234.5", ".", "1234.5"),
        ("1'234.5", ".", "1234.5"),
        ("\u22121,5", ",", "-1.5"),
        ("1,5", ".", "1,5"),
        ("a,5", ",", "a,5"),
    ],
)
def test_numbers_are_written_with_points(text, mark, number) -> None:
    assert convert_number_text(text, mark) == number


@pytest.mark.parametrize("text", ["\u22121.5", "1 000", "1'000", '"1,5"', '"1,000"'])
def test_a_single_odd_cell_is_a_mistake_not_a_form(text, tmp_path) -> None:
    """One cell among hundreds that are plain; written so throughout, it is how the file is."""
    rng = np.random.default_rng(1)
    lines = [",".join(f"{value:.3f}" for value in rng.uniform(-1, 1, 6)) for _ in range(40)]
    lines[20] = f"{text},0,0,1,2,3"
    path = tmp_path / "m.csv"
    path.write_text("\n".join([",".join(NAMES[1:]), *lines]), encoding="utf-8")
    with pytest.raises(DataError, match="line 22, column q1_deg"):
        read(path)


def test_a_number_with_groups_and_a_point_is_read_wherever_it_stands(tmp_path) -> None:
    """1,067.665 can be one number only; most coordinates of an arm stay below 1000."""
    lines = [f"{k};0;0;1.5;2.5;{990 + k}.25" for k in range(10)]
    lines += [f"{k};0;0;1.5;2.5;999.25" for k in range(10, 100)]
    lines[20] = "20;0;0;1.5;2.5;1,067.665"
    path = tmp_path / "m.csv"
    path.write_text("\n".join([";".join(NAMES[1:]), *lines]), encoding="utf-8")
    data = read(path)
    assert data.position[20].tolist() == [1.5, 2.5, 1067.665]
    assert "thousands in groups of digits" in data.notes[0].sentence


def test_long_minus_signs_are_told_as_such(tmp_path) -> None:
    path = tmp_path / "m.csv"
    path.write_text(written().replace("-", "\u2212"), encoding="utf-8")
    data = read(path)
    check(data)
    (note,) = [note for note in data.notes if note.code == "file-format"]
    assert note.sentence == "m.csv is read as it is: long minus signs (U+2212)."


def doubtful() -> str:
    """Commas that may be either: 1,234 and 12,345 alone."""
    rows = [
        "1,234;2,345;3,456;111,111;222,222;333,333",
        "1,235;2,346;3,457;111,112;222,223;333,334",
    ]
    return "\n".join([";".join(NAMES[1:]), *rows]) + "\n"


def test_doubtful_commas_are_refused_with_both_readings(tmp_path) -> None:
    path = tmp_path / "m.csv"
    path.write_text(doubtful())
    with pytest.raises(DataError, match=r'"1,234" may be 1\.234 .* or 1234 .*decimal = ","'):
        read(path)
    small = read(DataFile(path, decimal=","))
    assert small.position[0].tolist() == [111.111, 222.222, 333.333]
    large = read(DataFile(path, decimal="."))
    assert large.position[0].tolist() == [111111.0, 222222.0, 333333.0]


def whole(text: str) -> str:
    """Whole numbers, but for one cell."""
    rng = np.random.default_rng(2)
    rows = rng.integers(-170, 900, (40, 6)).tolist()
    rows[7][3] = text
    return "\n".join(";".join(map(str, row)) for row in [NAMES[1:], *rows]) + "\n"


def test_a_point_among_whole_numbers_is_refused_with_both_readings(tmp_path) -> None:
    path = tmp_path / "m.csv"
    path.write_text(whole("1.019"))
    with pytest.raises(DataError, match=r'"1\.019" may be 1\.019 .* or 1019 \(a point between'):
        read(path)
    assert read(DataFile(path, decimal=".")).position[7, 0] == 1.019
    data = read(DataFile(path, decimal=","))
    assert data.position[7, 0] == 1019
    assert "thousands in groups of digits" in data.notes[0].sentence
    path.write_text(whole("1.5"))
    assert read(path).position[7, 0] == 1.5
    path.write_text(";".join(NAMES[1:]) + "\n1;2;3;1.019;1.020;1.021\n4;5;6;1.022;1.023;1.024\n")
    assert read(path).position[1, 0] == 1.022


def test_a_comma_among_points_is_told_with_both_readings(tmp_path) -> None:
    path = tmp_path / "m.csv"
    path.write_text(whole("1,019").replace("\n", ";0.5\n").replace("z_mm;0.5", "z_mm;a"))
    with pytest.raises(DataError, match=r"line 9, column x_mm: .* 1019 .* or 1\.019 \("):
        read(path)
    assert read(DataFile(path, decimal=".")).position[7, 0] == 1019


def test_the_study_file_says_which(tmp_path) -> None:
    (tmp_path / "m.csv").write_text(doubtful())
    study = parse_study(
        'name = "x"\nrobot = { name = "ur5", tool_mm = [0, 0, 0] }\n'
        '[measurements]\nfile = "m.csv"\ndecimal = ","\n',
        "study.toml",
    )
    source = find_source(study, tmp_path)
    assert read(source).position[0, 0] == 111.111
    assert "sheet" not in study.model_dump()["measurements"]


def test_rows_that_are_all_narrower_than_the_header(tmp_path) -> None:
    header, *lines = written().splitlines()
    path = tmp_path / "m.csv"
    path.write_text("\n".join([f"{header},note", *lines]))
    with pytest.raises(DataError, match="line 2: 7 cells, but the header has 8"):
        read(path)


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_sentences_below_and_between_rows_are_left_out_and_quoted(separator, tmp_path) -> None:
    lines = written(separator).splitlines()
    lines[4:4] = ["Pause: tracker moved, doors closed"]
    lines += ["", "Measured by station 2 on Monday"]
    path = tmp_path / "m.csv"
    path.write_text("\n".join(lines))
    data = read(path)
    check(data)
    (note,) = [note.sentence for note in data.notes if note.code == "file-format"]
    assert 'line 5 is a remark ("Pause: tracker moved, doors closed")' in note
    assert 'line 12 is a remark ("Measured by station 2 on Monday")' in note
    assert data.where.number(int(data.row[3])) == 6


@pytest.mark.parametrize("row", ["P7,1.5,2.5", "P7", "P7 of the second day,1,2,3"])
def test_a_row_that_is_cut_off_is_no_sentence(row, tmp_path) -> None:
    lines = written().splitlines()
    path = tmp_path / "m.csv"
    path.write_text("\n".join([*lines, row]))
    with pytest.raises(DataError, match=f"line 10: {row.count(',') + 1} cells?, but the header"):
        read(path)


@pytest.mark.parametrize("rows", ["all", "one"])
def test_separators_that_end_rows(rows, tmp_path) -> None:
    """All rows may end with one that the header lacks; a single row that does is another width."""
    header, *lines = written().splitlines()
    lines = [line + "," if rows == "all" or k == 3 else line for k, line in enumerate(lines)]
    path = tmp_path / "m.csv"
    path.write_text("\n".join([header, *lines]))
    if rows == "all":
        check(read(path))
        return
    with pytest.raises(DataError, match="line 5: 8 cells, but the header has 7"):
        read(path)


def test_binary_is_no_text(tmp_path) -> None:
    path = tmp_path / "m.csv"
    path.write_bytes(bytes(range(256)) * 9)
    with pytest.raises(DataError, match=r"not UTF-8 text|empty or not text"):
        read(path)


@pytest.mark.parametrize("bad", [b"\xff", b"\xed\xa0\x80"])
def test_damaged_utf8_is_not_taken_for_another_encoding(bad, tmp_path) -> None:
    """Half a surrogate pair, or a stray byte among characters of UTF-8."""
    path = tmp_path / "m.csv"
    content = written().encode()
    path.write_bytes(content.replace(b"kugel 0", b"kugel " + bad, 1))
    with pytest.raises(DataError, match="it is not UTF-8 text, nor"):
        read(path)


def test_a_table_without_header_is_refused(tmp_path) -> None:
    path = tmp_path / "m.csv"
    path.write_text("".join(line + "\n" for line in written().splitlines()[1:]))
    with pytest.raises(DataError, match="line 1: the table begins with numbers"):
        read(path)


def test_names_with_a_hash_are_no_comments(tmp_path) -> None:
    path = tmp_path / "m.csv"
    path.write_text(written().replace("Prüfkugel ", "#"))
    assert read(path).targets == ("#0", "#1")


def test_a_row_whose_name_begins_like_a_comment_is_not_dropped(tmp_path) -> None:
    """One reflector of three is called #1: neither left out nor guessed."""
    lines = written().replace("Prüfkugel 1", "B").splitlines()
    lines[5] = lines[5].replace(lines[5].partition(",")[0], "#1")
    path = tmp_path / "m.csv"
    path.write_text("\n".join(lines))
    with pytest.raises(DataError, match='line 6: "#1" begins like a comment, but the line has'):
        read(path)
    path.write_text("\n".join(lines).replace("#1,", '"#1",'))
    assert "#1" in read(path).targets


def test_a_row_that_is_commented_out_is_left_out(tmp_path) -> None:
    """Where rows begin with numbers, a mark before one can only be a comment."""
    lines = [line.partition(",")[2] for line in written().splitlines()]
    lines[5] = "#" + lines[5]
    path = tmp_path / "m.csv"
    path.write_text("\n".join(lines))
    data = read(path)
    assert len(data) == ROWS - 1
    assert "line 6 is a comment" in data.notes[0].sentence


# -- spreadsheets
# --------------------------------------------------------------------------------------------


def xlsx(path: Path, name: str = "Messung", texts: bool = False) -> Path:
    """A workbook as people make it: a merged title, names and units in two rows, an empty row, a
    sheet of remarks."""
    from openpyxl import Workbook

    book = Workbook()
    sheet = book.active
    sheet.title = name
    sheet.append(["Roboter 7"])
    sheet.merge_cells("A1:G1")
    sheet.append(NAMES)
    sheet.append([None, "°", "°", "°", "mm", "mm", "mm"])
    for k, row in enumerate(numbers()):
        values = [str(value).replace(".", ",") for value in row] if texts else row
        sheet.append([f"Prüfkugel {k % 2}", *values])
        if k == 3:
            sheet.append([])
    notes = book.create_sheet("Bemerkungen")
    notes.append(["Temperatur", 21.5])
    book.save(path)
    return path


def ods(path: Path) -> Path:
    """A sheet as LibreOffice writes it, its cells without more than their values."""
    rows = ""
    for row in [NAMES, *([f"Prüfkugel {k % 2}", *row] for k, row in enumerate(numbers()))]:
        for cell in row:
            kind = "string" if isinstance(cell, str) else "float"
            value = "" if isinstance(cell, str) else f' office:value="{cell}"'
            rows += f'<table:table-cell office:value-type="{kind}"{value}><text:p>{escape(str(cell))}</text:p></table:table-cell>'
        rows = f"{rows}</table:table-row><table:table-row>"
    spaces = "".join(
        f' xmlns:{name}="urn:oasis:names:tc:opendocument:xmlns:{name}:1.0"'
        for name in ("office", "table", "text")
    )
    content = (
        f'<?xml version="1.0" encoding="UTF-8"?><office:document-content{spaces} office:version="1.2">'
        '<office:body><office:spreadsheet><table:table table:name="Tabelle1"><table:table-row>'
        f"{rows}</table:table-row></table:table></office:spreadsheet></office:body>"
        "</office:document-content>"
    )
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("mimetype", "application/vnd.oasis.opendocument.spreadsheet")
        file.writestr("META-INF/manifest.xml", "<manifest/>")
        file.writestr("content.xml", content)
    return path


def test_spreadsheets_hold_the_same_numbers(tmp_path) -> None:
    data = read(xlsx(tmp_path / "m.xlsx"))
    check(data)
    (note,) = [note.sentence for note in data.notes if note.code == "file-format"]
    assert note == (
        'm.xlsx is read as it is: the sheet "Messung", the header on row 2, a row of units below '
        "the header, row 8 is empty."
    )
    assert data.where.listed([0, 4]) == "rows 4, 9"
    assert where_from_record(data.where.record(data.row)).listed([0, 4]) == "rows 4, 9"
    check(read(ods(tmp_path / "m.ods")))


@pytest.mark.parametrize(
    ("cell", "words"),
    [
        ("=649.5+0", r'found "=649\.5\+0"\. Formulas without their values .* Excel'),
        ("#REF!", 'found "#REF!". Correct the cell'),
        (None, "found an empty cell. Correct the cell"),
    ],
)
def test_cells_of_a_workbook_without_a_value_are_shown(cell, words, tmp_path) -> None:
    from openpyxl import load_workbook

    path = xlsx(tmp_path / "m.xlsx")
    book = load_workbook(path)
    book["Messung"]["G5"] = cell
    book.save(path)
    with pytest.raises(DataError, match=f"row 5, column z_mm: expected a finite number, {words}"):
        read(path)


def test_numbers_kept_as_text_in_a_spreadsheet(tmp_path) -> None:
    check(read(xlsx(tmp_path / "m.xlsx", texts=True)))


def test_single_numbers_kept_as_text_in_a_workbook_are_read_by_their_columns(tmp_path) -> None:
    """Three decimals after a decimal comma could be a group of thousands: the other numbers of the
    column tell."""
    from openpyxl import load_workbook

    path = xlsx(tmp_path / "m.xlsx")
    book = load_workbook(path)
    sheet = book["Messung"]
    before = sheet["F9"].value
    sheet["F9"] = f"{before + 0.123:.3f}".replace(".", ",")
    book.save(path)
    data = read(path)
    assert data.position[4, 1] == pytest.approx(before + 0.123, abs=1e-3)
    (note,) = [note.sentence for note in data.notes if note.code == "file-format"]
    assert "a number kept as text with decimal commas (row 9)" in note


def test_the_range_of_a_column_tells_the_mark() -> None:
    assert find_mark_by_range([[7.024, 47.805, "63,351"]]) == ","
    assert find_mark_by_range([[70240, 47805, "63,351"]]) == "."
    assert find_mark_by_range([["63,351", "12,345"]]) is None
    assert find_mark_by_range([[1.5, 2.5, "1,234"], [1500, 2500, "1,234"]]) is None


def test_a_spoilt_cell_is_told_by_sheet_and_row(tmp_path) -> None:
    from openpyxl import load_workbook

    path = xlsx(tmp_path / "m.xlsx")
    book = load_workbook(path)
    book["Messung"]["F9"] = "?"
    book.save(path)
    with pytest.raises(DataError, match=r'm\.xlsx, sheet "Messung", row 9, column y_mm: .*"\?"'):
        read(path)


def test_of_two_sheets_the_study_names_one(tmp_path) -> None:
    from openpyxl import load_workbook

    path = xlsx(tmp_path / "m.xlsx")
    book = load_workbook(path)
    copy = book.copy_worksheet(book["Messung"])
    copy.title = "Wiederholung"
    book.save(path)
    with pytest.raises(
        DataError, match=r'2 sheets .* "Messung", "Wiederholung".*sheet = "Messung"'
    ):
        read(path)
    check(read(DataFile(path, sheet="Wiederholung")))
    with pytest.raises(DataError, match=r'no sheet "Messungen". Did you mean "Messung"'):
        read(DataFile(path, sheet="Messungen"))


def test_a_file_that_is_no_spreadsheet_is_refused(tmp_path) -> None:
    path = tmp_path / "m.xlsx"
    path.write_text(written())
    with pytest.raises(DataError, match=r"this is text, not a workbook, though its name ends in"):
        read(path)
    path.write_bytes(b"PK\x03\x04" + bytes(range(200)))
    with pytest.raises(DataError, match="the spreadsheet cannot be read"):
        read(path)


def test_markers_beside_each_other_below_a_row_of_their_names(tmp_path) -> None:
    """As OptiTrack writes them: the names in line 4, numbers in line 5, X Y Z in line 8."""
    count = 3
    lines = ["Format Version,1.23,Take Name,Take 3,Frame Rate,120.0,Length Units,Meters", ""]
    for title, cells in (
        (",Type", ["Marker"] * 3 * count),
        (",Name", [f"EE:M{k // 3 + 1}" for k in range(3 * count)]),
        (",ID", [f"000{k // 3 + 1}" for k in range(3 * count)]),
        (",Parent", ["EE"] * 3 * count),
        (",", ["Position"] * 3 * count),
        ("Frame,Time (Seconds)", ["X", "Y", "Z"] * count),
    ):
        lines.append(",".join([title, *cells]))
    for row in range(6):
        values = [f"{row + k / 10:.6f}" for k in range(3 * count)]
        lines.append(",".join([f"{row},{row / 120:.6f}", *values]))
    path = tmp_path / "take.csv"
    path.write_text("\n".join(lines))
    table = load_table(path)
    assert len(table) == 6
    assert list(table.columns)[:5] == ["Frame", "Time (Seconds)", "EE:M1 X", "EE:M1 Y", "EE:M1 Z"]
    assert float(table.columns["EE:M3 Z"][1]) == 1.8


@pytest.mark.parametrize(
    ("name", "what", "remedy"),
    [
        ("cell.rdk", "a station of RoboDK", "the script of docs/how-to/your-files.md"),
        ("Cell.RDK", "a station of RoboDK", "(Tools, Run Script)"),
        ("job.xit64", "a job of Spatial Analyzer", "Export its points as text"),
        ("data.mat", "a file of MATLAB", "writetable"),
    ],
)
def test_formats_of_other_programs_are_named_with_what_to_give(tmp_path, name, what, remedy):
    file = tmp_path / name
    file.write_bytes(b"\x00\x01RDK\xff\xfe" + bytes(range(256)))
    with pytest.raises(DataError) as refused:
        read_measurements(file, 3 * [False])
    sentence = str(refused.value)
    assert sentence.startswith(f"{name}: this is {what}, in a format of its own")
    assert remedy in sentence
    with pytest.raises(StudyError, match=f"{name}: this is .*Give the name of a built-in robot"):
        load_robot(str(file))


@pytest.mark.parametrize(
    ("beginning", "what", "remedy"),
    [
        (b'{"q1_deg": 1.0, "q2_deg": 2.0}\n', "JSON", "lines=True"),
        (
            b'\xef\xbb\xbf [ {"q1_deg": 1.0}, {"q1_deg": 2.0}]',
            "JSON",
            "pandas.read_json(FILE).to_csv",
        ),
        (
            b'<table border="1"><tr><td>q1</td></tr></table>',
            "a page in HTML",
            "save it as a workbook",
        ),
        (b"<!DOCTYPE html>\n<html>", "a page in HTML", "save it as a workbook"),
        (b"\x1f\x8b\x08\x00", "a packed file", "Unpack it"),
        (b"PK\x03\x04\x14", "a packed file", "Unpack it"),
        (b"#ROSBAG V2.0\n", "a bag of ROS", "Export its rows"),
        (b"SQLite format 3\x00", "a database", "Export its rows"),
        (b"\x89HDF\r\n", "a file of HDF5", "Export its rows"),
    ],
)
def test_formats_are_told_by_how_they_begin(beginning, what, remedy, tmp_path) -> None:
    """Whatever the file is called: workbooks of some programs are pages in HTML."""
    for name in ("m.csv", "m.xls", "m.json"):
        file = tmp_path / name
        file.write_bytes(beginning + b"\x00" * 40)
        with pytest.raises(DataError) as refused:
            read(file)
        assert str(refused.value).startswith(f"{name}: this is {what}, which is not read. ")
        assert remedy in str(refused.value)


def test_rows_that_sum_up_the_others_are_left_out_and_said(tmp_path) -> None:
    """Below the rows, with an empty line before them or not, in a text file and a workbook."""
    from openpyxl import Workbook

    rows = [[str(k + 1), *map(str, row)] for k, row in enumerate(numbers())]
    means = np.mean(numbers(), axis=0).tolist()
    below = [["Mittelwert", *map(str, means)], ["Std. Dev.", *map(str, means)]]
    table = [["Pose", *NAMES[1:]], *rows, [""] * 7, *below]
    path = tmp_path / "m.csv"
    path.write_text("\n".join(map(";".join, table)))
    data = read(path)
    assert len(data) == ROWS
    said = data.notes[0].sentence
    assert 'lines 11 to 12 sum up the others and are left out ("Mittelwert", "Std. Dev.")' in said
    book = Workbook()
    for row in table[:-1]:
        book.active.append(row)
    book.save(tmp_path / "m.xlsx")
    data = read(tmp_path / "m.xlsx")
    assert len(data) == ROWS
    assert 'row 11 sums up the others and is left out ("Mittelwert")' in data.notes[0].sentence


def test_a_summary_of_formulas_without_values_is_left_out(tmp_path) -> None:
    """As a program writes a workbook that nobody has opened yet; cells of a row of points stay an error."""
    from openpyxl import Workbook

    book = Workbook()
    names = ["A1", *NAMES[2:]]
    book.active.append(["Pose", *names])
    rows = [[f"P{k + 1}", *row] for k, row in enumerate(numbers())]
    for row in rows:
        book.active.append(row)
    book.active.append([])
    last = ["Mittelwert", "", "", "", *(f"=AVERAGE({c}2:{c}9)" for c in "EFG")]
    book.active.append(last[: len(names) + 1])
    book.save(tmp_path / "m.xlsx")
    columns = {NAMES[1]: "A1"}
    data = read_measurements(tmp_path / "m.xlsx", (False,) * 3, columns)
    assert len(data) == ROWS
    assert 'sums up the others and is left out ("Mittelwert")' in data.notes[0].sentence
    book.active.cell(3, 2).value = None
    book.save(tmp_path / "n.xlsx")
    with pytest.raises(DataError, match=r'sheet "Sheet", row 3, column "A1": expected'):
        read_measurements(tmp_path / "n.xlsx", (False,) * 3, columns)


@pytest.mark.parametrize("suffix", ["csv", "xlsx"])
def test_rows_between_groups_that_sum_these_up_are_left_out_and_said(suffix, tmp_path) -> None:
    """With words of their own in every group, and rounded."""
    rows = pd.DataFrame(numbers(), columns=NAMES[1:])
    parts = []
    for day in range(2):
        part = rows.iloc[4 * day : 4 * day + 4]
        means, most = part.mean().round(3), part.max().round(3)
        means, most = means.astype(object), most.astype(object)
        means["Pose"], most["Pose"] = f"Mean, day {day}", "max."
        parts += [part.assign(Pose=f"P{day}"), pd.DataFrame([means, most])]
    table = pd.concat(parts)[["Pose", *NAMES[1:]]]
    path = tmp_path / f"m.{suffix}"
    if suffix == "csv":
        table.to_csv(path, sep=";", decimal=",", index=False)
    else:
        table.to_excel(path, index=False)
    data = read(path)
    np.testing.assert_allclose(data.position[:, 0], rows["x_mm"][: len(data)])
    said = data.notes[0].sentence
    places = "6 to 7, 12 to 13 sum up the rows above them and are left out"
    assert f'{places} ("Mean, day 0", "max.", "Mean, day 1")' in said


def test_a_point_called_mean_that_is_none_is_a_measurement(tmp_path) -> None:
    rows = [[f"P{k}", *map(str, row)] for k, row in enumerate(numbers())]
    rows[3][0], rows[5][0] = "mean", "max"
    path = tmp_path / "m.csv"
    path.write_text("\n".join(map(",".join, [["Point", *NAMES[1:]], *rows])))
    assert len(read(path)) == ROWS


@pytest.mark.parametrize("names", [("Anna", "Max"), ("Max", "Max"), ("Max", "Anna")])
def test_a_person_called_max_sums_up_nothing(names, tmp_path) -> None:
    above, last = names
    rows = [[above, *map(str, row)] for row in numbers()]
    rows[3][0] = "Max"
    rows[-1][0] = last
    path = tmp_path / "m.csv"
    path.write_text("\n".join(map(",".join, [["Operator", *NAMES[1:]], *rows])))
    assert len(read(path)) == ROWS


def test_joints_that_a_header_only_numbers(tmp_path) -> None:
    """Below a cell that spans them, with a row of units, as people lay out a sheet."""
    from openpyxl import Workbook

    book = Workbook()
    book.active.append(["Kalibrierung Zelle 4"])
    book.active.append(["Pose", "Gelenke", None, None, "Position"])
    book.active.append(["Nr", "1", "2", "3", "X", "Y", "Z"])
    book.active.append([None, *["°"] * 3, *["mm"] * 3])
    for k, row in enumerate(numbers()):
        book.active.append([k + 1, *row])
    book.save(tmp_path / "m.xlsx")
    mapping = {f"q{k}_deg": f"Gelenke {k}" for k in (1, 2, 3)}
    mapping |= {f"{axis.lower()}_mm": axis for axis in "XYZ"}
    data = read_measurements(tmp_path / "m.xlsx", (False,) * 3, mapping)
    assert np.allclose(np.degrees(data.q), np.array(numbers())[:, :3])
    (tmp_path / "m.csv").write_text("1,2,3\n1,2,3\n4,5,6\n")
    with pytest.raises(DataError, match="no header"):
        read(tmp_path / "m.csv")


def test_columns_without_names_are_told(tmp_path) -> None:
    (tmp_path / "m.csv").write_text("q1_deg,,\n1,2,3\n4,5,6\n")
    with pytest.raises(DataError, match=r"several columns have no name .* just above the numbers"):
        read(tmp_path / "m.csv")
