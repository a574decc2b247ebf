"""The error map: places x causes, darker where a cell alone would explain more, ringed where it
stands out beyond chance."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..._short_numbers import round_numbers
from ..._typing import Array
from ...results.schemas.finding_schema import EntryRecord
from ...results.schemas.schema import ErrorMapRecord, StudyRecord
from ..style import INK, QUIET, RING, WIDTH, shorten, svg, use_style

MAX_CAUSES = 26
# places that a cause needs to be worth a column: the waves of one joint are on the page to explore
MIN_PLACES = 3
# family-wise p below which a cell stands out beyond chance
STANDS_OUT_P = 0.05
# share of the strongest F of its column from which a cell that stands out is ringed
MIN_RINGED_SHARE = 0.6
# added to a cause's F, so that causes of several places, then those of findings come first
SEVERAL_PLACES_RANK, FINDING_RANK = 1e9, 2e9
LONGEST_CAUSE = 24  # letters


def select_causes(record: StudyRecord) -> list[int]:
    """Return the columns to draw: the causes of findings and those whose best cell stands out most, in the map's
    order; of the rest, those of few places only where there is room."""
    f = _to_array(record.error_map.f)
    if not f.size:
        return []
    rank = np.where(np.isnan(f), 0.0, f).max(axis=0)
    rank[np.isfinite(f).sum(axis=0) >= MIN_PLACES] += SEVERAL_PLACES_RANK
    rank[[column for _, column in find_named_cells(record)]] += FINDING_RANK
    return sorted(np.argsort(-rank, kind="stable")[:MAX_CAUSES].tolist())


def _to_array(table: Sequence[Sequence[float | None]]) -> Array:
    """Return a table as an array, undefined figures as NaN."""
    return np.array(table, dtype=float)


def stands_out(whole: ErrorMapRecord, row: int, column: int) -> bool:
    """Return whether a cell explains more than chance anywhere in the map."""
    f, p = whole.f[row][column], whole.p_family_wise[row][column]
    if f is None or p is None:
        return False
    return p < STANDS_OUT_P


def find_named_cells(record: StudyRecord) -> list[tuple[int, int]]:
    """Return (row, column) of the cells that a finding names: those of the explanation that is fitted."""
    whole = record.error_map
    rows = {name: row for row, name in enumerate(whole.places)}
    columns = {name: column for column, name in enumerate(whole.causes)}
    cells: set[tuple[int, int]] = set()
    for finding in record.findings:
        for place, causes in _causes_by_place(finding.fitted_entry).items():
            names = {" & ".join(causes), *causes} & columns.keys()
            if place in rows:
                cells |= {(rows[place], columns[name]) for name in names}
    return sorted(cells)


def _causes_by_place(entry: EntryRecord) -> dict[str, list[str]]:
    causes: dict[str, list[str]] = {}
    for screw in entry.screws:
        causes.setdefault(f"{screw.frame} {screw.axis}", []).append(screw.cause)
    return causes


def draw_error_map(record: StudyRecord) -> bytes:
    """Draw the strongest causes, a row each, against all places, as the page to explore does."""
    whole, columns = record.error_map, select_causes(record)
    f = _to_array(whole.f)[:, columns]
    p = _to_array(whole.p_family_wise)[:, columns]
    with use_style() as sheets:
        height = max(0.146 * len(columns) + 1.5, 2.8)
        fig, ax = sheets.subplots(figsize=(WIDTH, height), layout="constrained")
        mesh = _draw_shades(ax, f)
        _mark_outstanding(ax, f, p)
        _mark_named(ax, record, columns)
        _label_axes(ax, whole, columns)
        _draw_scale(fig, ax, mesh)
        return svg(fig, "Error map")


def _draw_shades(ax: Any, f: Array) -> Any:
    """Draw every cell, darker the more it alone would explain."""
    shade = np.log10(np.maximum(f.T, 1.0))
    return ax.pcolormesh(
        np.arange(f.shape[0] + 1) - 0.5,
        np.arange(f.shape[1] + 1) - 0.5,
        np.ma.masked_invalid(shade),
        cmap="Greys",
        vmin=0,
        vmax=max(float(np.nanmax(shade)), 1.0),
        edgecolors="white",
        linewidth=0.4,
    )


def _mark_outstanding(ax: Any, f: Array, p: Array) -> None:
    """Mark what explains more than chance, and ring the strongest of each cause."""
    is_outstanding = (p < STANDS_OUT_P) & np.isfinite(f)
    strongest = np.where(np.isnan(f), -np.inf, f).max(axis=0)
    is_strong = is_outstanding & (f >= MIN_RINGED_SHARE * strongest)
    row, column = np.nonzero(is_outstanding)
    ax.plot(row, column, ".", ms=2.6, color=RING, mew=0)
    row, column = np.nonzero(is_strong)
    ax.plot(row, column, "o", ms=7, mfc="none", mec=RING, mew=1.2)


def _mark_named(ax: Any, record: StudyRecord, columns: Sequence[int]) -> None:
    """Frame the cells of findings."""
    cells = [cell for cell in find_named_cells(record) if cell[1] in columns]
    rows = [row for row, _ in cells]
    places = [columns.index(column) for _, column in cells]
    if cells:
        ax.plot(rows, places, "s", ms=9, mfc="none", mec="white", mew=3)
        ax.plot(rows, places, "s", ms=9, mfc="none", mec=INK, mew=1.4)


def _label_axes(ax: Any, whole: ErrorMapRecord, columns: Sequence[int]) -> None:
    """Name places and causes, and part the frames by lines."""
    count = len(whole.places)
    ax.set_ylim(len(columns) - 0.5, -0.5)
    causes = [shorten(round_numbers(whole.causes[column]), LONGEST_CAUSE) for column in columns]
    ax.set_yticks(range(len(columns)), causes, fontsize=6.5)
    places = [f"frame {name}" for name in whole.places]
    ax.set_xticks(range(count), places, rotation=90, fontsize=6)
    ax.xaxis.tick_top()
    ax.tick_params(length=0, colors=INK)
    frames = [name.split()[0] for name in whole.places]
    for place in range(1, count):
        if frames[place] != frames[place - 1]:
            ax.axvline(place - 0.5, color=QUIET, lw=0.7, zorder=3)
    ax.spines[:].set_visible(False)


def _draw_scale(fig: Any, ax: Any, mesh: Any) -> None:
    """Draw the bar that says what a shade means."""
    bar = fig.colorbar(
        mesh, ax=ax, orientation="horizontal", shrink=0.35, aspect=30, pad=0.015, anchor=(1.0, 0.5)
    )
    ticks = [power for power in range(6) if power <= mesh.norm.vmax]
    bar.set_ticks(ticks, labels=[f"{10**power:,}" for power in ticks])
    bar.outline.set_visible(False)
    bar.ax.tick_params(labelsize=6.5, length=0)
    bar.set_label("F of the cell alone, beyond the base", fontsize=6.5)
