"""Limits of a diagnosis that a caller may change."""

from __future__ import annotations

from dataclasses import dataclass

from .own_candidates import OwnCandidates


@dataclass(frozen=True)
class DiagnosisOptions:
    """Sizes that bound the time and memory of a diagnosis.

    `memory_mb`: for the values of the causes, which are kept for as many rows as take no more than 85 %
    of it, else computed wherever they are needed. `max_rows`: estimation rows that are scanned; of more, whole
    configurations are drawn by the seed.
    `parts`: names of the parts of the errors that may be looked for, "joints" for all of them (None:
    every part); `fixed_parts`: names and scales [rad or mm] of those that are known.
    `own`: explanations that a study adds to those of the registry and of the error map.
    `weights`: registered names, with or without a joint, and how much likelier than another name
    each is beforehand.
    `max_cells`: cells of the error map; where the robot has more (some fifteen joints), a cell's
    cause may only depend on joints next to its place."""

    memory_mb: float = 500.0
    max_rows: int = 12_000
    max_cells: int = 40_000
    parts: tuple[str, ...] | None = None
    fixed_parts: tuple[tuple[str, float], ...] = ()
    weights: tuple[tuple[str, float], ...] = ()
    own: tuple[OwnCandidates, ...] = ()


DEFAULT_OPTIONS = DiagnosisOptions()
