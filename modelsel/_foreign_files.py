"""Files of other programs in formats of their own, which are not read: what they are, and what to give
instead."""

from __future__ import annotations

import re
from pathlib import Path

# what a file is, by its suffix
FOREIGN = {
    ".rdk": "a station of RoboDK",
    ".robot": "a robot of RoboDK",
    ".xit": "a job of Spatial Analyzer",
    ".xit64": "a job of Spatial Analyzer",
    ".mat": "a file of MATLAB",
}
# how to write its rows as text
ROWS = {
    ".rdk": "In RoboDK, run the script of docs/how-to/your-files.md (Tools, Run Script): it writes the "
    "joints of all targets to a CSV file; give that",
    ".robot": "Give a table of measured points or targets",
    ".xit": "Export its points as text (File, Export), and give that",
    ".xit64": "Export its points as text (File, Export), and give that",
    ".mat": "Write the table with writetable(T, 'measurements.csv'), and give that",
}
# how robots' programs begin, and what they are
PROGRAMS = {
    re.compile(
        r"\s*(%%%.*?%%%\s*)?MODULE[ \t]+\w+[ \t]*(\([^)\n]*\))?[ \t]*\n", re.DOTALL
    ): "a RAPID program",
    re.compile(r"\s*(&\w+[^\n]*\n\s*)*DEF(DAT)?\s+\w+"): "a KRL program",
    re.compile(
        r"\s*(;[^\n]*\n\s*)*(DECL\s+)?(GLOBAL\s+)?((E6)?(AXIS|POS)\s+)?\w+\s*=\s*\{[^}\n]*\b(A1|X)[ \t]",
        re.IGNORECASE,
    ): "a list of KRL positions",
    re.compile(
        r"\s*(![^\n]*\n\s*)*((LOCAL|TASK)\s+)?(CONST|PERS|VAR)\s+(jointtarget|robtarget)\s",
        re.IGNORECASE,
    ): "a list of RAPID targets",
    re.compile(r"\s*/PROG\s"): "a TP program of Fanuc",
    re.compile(r"\s*def\s+\w+\(\)\s*:"): "a program of Universal Robots",
}
PROGRAM_REMEDY = (
    "Give a table instead, a row for each point with its name and the joint readings (CSV or a "
    "spreadsheet)."
)
# how other formats begin, what they are, and what to do
PACKED = "Unpack it, and give the table that is in it."
AS_TABLE = "Export its rows as CSV or a spreadsheet, a row for each measured point, and give that."
SIGNATURES = {
    re.compile(r"\s*\[\s*[{\[]"): (
        "JSON",
        "Write it as CSV: in Python, pandas.read_json(FILE).to_csv('measurements.csv').",
    ),
    re.compile(r'\s*\{\s*"'): (
        "JSON",
        "Write it as CSV: in Python, pandas.read_json(FILE, lines=True).to_csv('measurements.csv').",
    ),
    re.compile(r"\s*(<!--.*?-->\s*)?<(!doctype\s+html|html|table)\b", re.IGNORECASE | re.DOTALL): (
        "a page in HTML",
        "Open it in a spreadsheet program, and save it as a workbook (.xlsx) or CSV.",
    ),
    re.compile(r"\x1f\x8b|BZh\d|\xfd7zXZ|7z\xbc\xaf|Rar!|\x28\xb5\x2f\xfd"): (
        "a packed file",
        PACKED,
    ),
    re.compile(r"#ROSBAG|\x89MCAP"): ("a bag of ROS", AS_TABLE),
    re.compile(r"SQLite format 3"): ("a database", AS_TABLE),
    re.compile(r"\x89HDF"): ("a file of HDF5", AS_TABLE),
    re.compile(r"\x93NUMPY"): ("an array of NumPy", AS_TABLE),
    re.compile(r"%PDF-"): ("a PDF", AS_TABLE),
    re.compile(r"ARROW1"): (
        "a file of Arrow or Feather",
        "Write it as Parquet or CSV, and give that.",
    ),
}
ZIP = "PK\x03\x04"  # workbooks begin so, too
WORKBOOKS = {".xlsx", ".xlsm", ".xlsb", ".ods"}
SHEETS = {*WORKBOOKS, ".xls"}
AS_TEXT = "Give it an ending of text: .csv or .txt."
# what Excel and LibreOffice write beside a workbook that is open, with the workbook's name
LOCK = re.compile(r"~(\$)(.+)|\.~lock\.(.+)#")
UTF16_MARK = "ÿþ"
# TOML: what a study and a robot are written in
OWN_SUFFIX = ".toml"
OWN_FILE = "this is a study file or a robot file, not a table of measured points."
OWN_REMEDY = "Give the measurements; modelsel study runs a study file."
# what a study writes
RESULTS = ("result.json", "calibration.json", "details.json")
BYTE_ORDER_MARK = "ï»¿"
# characters of a file's beginning that are looked at
BEGINNING = 2000


def _read_beginning(path: Path) -> str:
    """Read the beginning of a file; empty where it cannot be read. A pipe is not opened, which would
    wait for somebody to write to it."""
    if not path.is_file():
        return ""
    try:
        with path.open(encoding="latin-1") as file:
            beginning = file.read(BEGINNING)
    except OSError:
        return ""
    return beginning.removeprefix(BYTE_ORDER_MARK)


def _find_program(beginning: str) -> str | None:
    """Return which robot's program a file is by its beginning; None for none."""
    for pattern, what in PROGRAMS.items():
        if pattern.match(beginning):
            return what
    return None


def _find_signature(beginning: str, suffix: str) -> tuple[str, str] | None:
    """Return (what a file is by its beginning, what to do); None for none of these."""
    if beginning.startswith(ZIP) and suffix not in WORKBOOKS:
        return "a packed file", PACKED
    for pattern, described in SIGNATURES.items():
        if pattern.match(beginning):
            return described
    return None


def _describe_lock(name: str) -> tuple[str, str] | None:
    """Return what the small file is that Excel or LibreOffice keeps beside a workbook that is open;
    None for another name."""
    match = LOCK.fullmatch(name)
    if match is None:
        return None
    program = "Excel" if match[1] else "LibreOffice"
    workbook = match[2] or match[3]
    what = f"this is {program}'s lock file of a workbook that is open, without its rows."
    return what, f"Give {workbook}."


def _is_text(beginning: str) -> bool:
    """Whether the beginning of a file is text, in whatever encoding."""
    letters = beginning.removeprefix(UTF16_MARK).replace("\0", "")
    plain = "".join(letters.split())
    return bool(plain) and plain.isprintable()


def describe_foreign(path: Path) -> tuple[str, str] | None:
    """Return (what a file of rows is, what to do) where it has a format that is not read, else None;
    of a file that is not there its name says nothing."""
    if not path.exists():
        return None
    suffix = path.suffix.lower()
    lock = _describe_lock(path.name)
    if lock is not None:
        return lock
    if suffix == OWN_SUFFIX:
        return OWN_FILE, OWN_REMEDY
    beginning = _read_beginning(path)
    return _describe_content(beginning, suffix) or _describe_suffix(beginning, suffix)


def _describe_content(beginning: str, suffix: str) -> tuple[str, str] | None:
    """Describe a file by its beginning; None where it says nothing."""
    program = _find_program(beginning)
    if program is not None:
        return f"this is {program}; programs are not read.", PROGRAM_REMEDY
    signature = _find_signature(beginning, suffix)
    if signature is None:
        return None
    kind, remedy = signature
    return f"this is {kind}, which is not read.", remedy


def _describe_suffix(beginning: str, suffix: str) -> tuple[str, str] | None:
    """Describe a file by the ending of its name; None where this says nothing."""
    if suffix in SHEETS and _is_text(beginning):
        return f"this is text, not a workbook, though its name ends in {suffix}.", AS_TEXT
    if suffix not in FOREIGN:
        return None
    what = f"this is {FOREIGN[suffix]}, in a format of its own, which is not read."
    remedy = f"{ROWS[suffix]}."
    return what, remedy


def describe_foreign_robot(path: Path) -> str | None:
    """Return why a file is not read as a robot, and what to do; None where it may be one."""
    what = FOREIGN.get(path.suffix.lower())
    if what is None:
        return None
    return (
        f"{path.name}: this is {what}, in a format of its own, which is not read. Give the name of a built-in "
        "robot, a URDF, or the arm's DH parameters as a table (CSV or a spreadsheet)."
    )


def describe_no_robot(path: Path) -> str | None:
    """Return why what is at a path is no robot file, and what to do; None where nothing is there."""
    what = "a file, but not a robot file"
    if path.is_dir():
        what = "a folder"
    elif not path.exists():
        return None
    elif path.name in RESULTS:
        what = "a result of a study"
    return (
        f"{path}: this is {what}. Give the name of a built-in robot or a robot file: TOML, URDF, or a "
        "table of DH parameters."
    )
