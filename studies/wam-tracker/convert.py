"""The WAM's public CSV files -> one file in modelsel's form.

    python convert.py CLONE OUT.csv        CLONE: a copy of github.com/pauljac7700/serial_robots_datasets

The files have the form of the UR5's, by the same author: its script does the work.
"""

from __future__ import annotations

import runpy
from pathlib import Path

if __name__ == "__main__":
    script = Path(__file__).parents[1] / "ur5-tracker" / "convert.py"
    runpy.run_path(str(script))["main"]("WAM", joints=7)
