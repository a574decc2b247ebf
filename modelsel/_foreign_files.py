"""Files of other programs in formats of their own, which are not read: what they are, and what to give
instead."""

from __future__ import annotations

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


def describe_foreign(path: Path) -> tuple[str, str] | None:
    """Return (what a file of rows is, what to do) where it has a format that is not read, else None."""
    suffix = path.suffix.lower()
    if suffix not in FOREIGN:
        return None
    what = f"this is {FOREIGN[suffix]}, in a format of its own, which is not read."
    return what, f"{ROWS[suffix]}."


def describe_foreign_robot(path: Path) -> str | None:
    """Return why a file is not read as a robot, and what to do; None where it may be one."""
    what = FOREIGN.get(path.suffix.lower())
    if what is None:
        return None
    return (
        f"{path.name}: this is {what}, in a format of its own, which is not read. Give the name of a built-in "
        "robot, a URDF, or the arm's DH parameters as a table (CSV or a spreadsheet)."
    )
