"""Benchmarks, run from the repository: `python -m benchmarks.naming`. The tests' independent arm
makes the data."""

import os
import sys
from pathlib import Path

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")  # before numpy: a core a worker
sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))
