"""Public CSV files of one robot -> one file in modelsel's form.

    python convert.py CLONE OUT.csv        CLONE: a copy of github.com/pauljac7700/serial_robots_datasets

Raw columns: step_order; x_t ... target position and x_dif ... measured minus target [mm], in the
robot's base frame as the authors set it; joint_1 ... commanded angles [deg]. Measured position =
target + difference: the authors' README gives the difference without a sign, and only the sum has
the six decimals that an instrument writes."""

from __future__ import annotations

import csv
import math
import sys
from pathlib import Path


def converted(path: Path, joints: int, group: str) -> list[list[str]]:
    """Rows of one raw file: joint readings [rad], measured position [mm], group, order."""
    angles = [f"joint_{k}" for k in range(1, joints + 1)]
    axes = [(f"{axis}_t", f"{axis}_dif") for axis in "xyz"]
    needed = ["step_order", *(name for pair in axes for name in pair), *angles]
    if not path.is_file():
        sys.exit(
            f"{path} does not exist; the first argument is the folder of the cloned repository."
        )
    with path.open(newline="", encoding="utf-8-sig") as file:
        table = csv.DictReader(file)
        found = table.fieldnames or []
        if missing := [name for name in needed if name not in found]:
            sys.exit(
                f"{path} has the columns {', '.join(found) or 'none'}; missing: {', '.join(missing)}."
            )
        return [
            [f"{math.radians(float(row[name])):.9f}" for name in angles]
            + [f"{float(row[target]) + float(row[difference]):.6f}" for target, difference in axes]
            + [group, row["step_order"]]
            for row in table
        ]


def main(robot: str, joints: int) -> None:
    """Convert the grid and the random poses of a robot, `UR5` or `WAM`: its folder and its name in
    the file names."""
    if len(sys.argv) != 3:
        sys.exit("usage: python convert.py CLONE OUT.csv")
    clone, out = Path(sys.argv[1]), Path(sys.argv[2])
    rows = [
        row
        for group in ("grid", "random")
        for row in converted(
            clone / robot / f"3D_{robot}_uncalibrated_{group}_cleaned.csv", joints, group
        )
    ]
    header = [
        *(f"q{k}_rad" for k in range(1, joints + 1)),
        "x_mm",
        "y_mm",
        "z_mm",
        "group",
        "order",
    ]
    out.parent.mkdir(parents=True, exist_ok=True)
    with out.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerows([header, *rows])
    print(f"{len(rows)} configurations written to {out}")


if __name__ == "__main__":
    main("UR5", joints=6)
