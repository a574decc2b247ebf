"""Rows of a file as people see them."""
from __future__ import annotations

import numpy as np

from .measurements import Index

SHOWN = 8       # runs of lines


def lines(row: Index) -> str:
    """"lines 12 to 40, 52 and 60" of rows of a file (0-based; the header is line 1)."""
    at = np.unique(row) + 2
    runs = np.split(at, np.flatnonzero(np.diff(at) > 1) + 1) if len(at) else []
    words = [str(run[0]) if len(run) == 1 else f"{run[0]} to {run[-1]}" for run in runs[:SHOWN]]
    return f"line{'s' * (len(at) > 1)} {', '.join(words)}" + (" …" if len(runs) > SHOWN else "")
