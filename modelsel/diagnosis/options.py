"""Limits of a diagnosis that a caller may change."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class DiagnosisOptions:
    """Sizes that bound the memory of a diagnosis.

    `max_rows`: estimation rows whose candidate columns are scanned; of more, whole configurations
    are drawn by the seed (2,500 rows and 5,000 candidates take about a gigabyte).
    `max_cells`: cells of the error map; where the robot has more (some fifteen joints), a cell's
    cause may only depend on joints next to its place."""

    max_rows: int = 2500
    max_cells: int = 40_000


DEFAULT_OPTIONS = DiagnosisOptions()
