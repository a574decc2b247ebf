"""The positioner's public YAML file -> one file in modelsel's form. Needs PyYAML.

    python convert.py POSITIONER_KINEMATIC_MEASUREMENTS.yaml OUT.csv

Raw form: time [unix s] -> target_joints [rad] and pose, of the target in the camera's frame: x y z
[m], qw qx qy qz."""

from __future__ import annotations

import csv
import sys
from pathlib import Path
from typing import Any

try:
    import yaml
except ImportError:
    sys.exit("This script reads YAML: python -m pip install pyyaml")

TURNS = ["qw", "qx", "qy", "qz"]


def converted(time: str, start: int, entry: dict[str, Any]) -> list[str]:
    """One row: joint readings [rad], position [mm], quaternion, seconds since the first row."""
    joints, pose = entry.get("target_joints") or [], entry.get("pose") or {}
    if len(joints) != 2 or not {"x", "y", "z", *TURNS} <= set(pose):
        sys.exit(
            f"The entry {time} has the keys {', '.join(entry)}, {len(joints)} target_joints and a pose of "
            f"{', '.join(pose) or 'nothing'}; needed: 2 target_joints and a pose of x, y, z, {', '.join(TURNS)}."
        )
    return [
        *(f"{angle:.9f}" for angle in joints),
        *(f"{1000 * pose[axis]:.6f}" for axis in "xyz"),
        *(f"{pose[part]:.12f}" for part in TURNS),
        str(int(time) - start),
    ]


def main() -> None:
    """Convert the file named first into the file named second, rows in order of time."""
    if len(sys.argv) != 3:
        sys.exit("usage: python convert.py POSITIONER_KINEMATIC_MEASUREMENTS.yaml OUT.csv")
    raw, out = Path(sys.argv[1]), Path(sys.argv[2])
    entries = yaml.safe_load(raw.read_text(encoding="utf-8")) if raw.is_file() else None
    if not isinstance(entries, dict) or not all(str(time).isdigit() for time in entries):
        sys.exit(
            f"{raw} is not a file with one entry per unix time; see README.md for where to get it."
        )
    times = sorted(entries, key=int)
    rows = [converted(time, int(times[0]), entries[time]) for time in times]
    out.parent.mkdir(parents=True, exist_ok=True)
    with out.open("w", newline="", encoding="utf-8") as file:
        header = ["q1_rad", "q2_rad", "x_mm", "y_mm", "z_mm", *TURNS, "time_s"]
        csv.writer(file, lineterminator="\n").writerows([header, *rows])
    print(f"{len(rows)} configurations written to {out}")


if __name__ == "__main__":
    main()
