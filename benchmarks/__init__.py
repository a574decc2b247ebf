"""Benchmarks, run from the repository: `python -m benchmarks.naming`. The tests' independent arm makes the data."""
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
