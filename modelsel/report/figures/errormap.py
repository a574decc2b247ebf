"""The error map: places x causes, darker where a cell alone would explain more, ringed where it
stands out beyond chance."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..style import INK, QUIET, RING, WIDTH, shortened, styled, svg

COLUMNS = 26
PLACES = (
    3  # that a cause needs to be worth a column: the waves of one joint are on the page to explore
)
STANDS_OUT = 0.05


def strongest(result: dict[str, Any], most: int = COLUMNS) -> list[int]:
    """The causes of findings and those whose best cell stands out most, in the map's order; of the
    rest, those of few places only where there is room."""
    f = np.array(
        [[np.nan if v is None else v for v in row] for row in result["error_map"]["f"]], dtype=float
    )
    if not f.size:
        return []
    best = np.nanmax(np.where(np.isnan(f), 0.0, f), axis=0)
    best = np.where(np.isfinite(f).sum(axis=0) >= PLACES, 1e9 + best, best)
    best[[j for _, j in named_cells(result)]] += 2e9
    return sorted(np.argsort(-best, kind="stable")[:most].tolist())


def error_map(result: dict[str, Any]) -> bytes | None:
    """The strongest causes against all places; None where nothing was scanned."""
    whole, columns = result["error_map"], strongest(result)
    if not columns:
        return None
    f = np.array([[np.nan if v is None else v for v in row] for row in whole["f"]], dtype=float)[
        :, columns
    ]
    p = np.array(whole["p_family_wise"], dtype=float)[:, columns]
    shade = np.log10(np.maximum(f, 1.0))
    with styled() as sheets:
        fig, ax = sheets.subplots(
            figsize=(WIDTH, max(0.135 * len(f) + 1.55, 2.9)), layout="constrained"
        )
        mesh = ax.pcolormesh(
            np.arange(len(columns) + 1) - 0.5,
            np.arange(len(f) + 1) - 0.5,
            np.ma.masked_invalid(shade),
            cmap="Greys",
            vmin=0,
            vmax=max(float(np.nanmax(shade)), 1.0),
            edgecolors="white",
            linewidth=0.4,
        )
        out = np.argwhere((p < STANDS_OUT) & np.isfinite(f))
        best = {tuple(cell) for cell in out if f[tuple(cell)] >= 0.6 * np.nanmax(f[:, cell[1]])}
        strong = np.array([cell for cell in out if tuple(cell) in best]).reshape(-1, 2)
        ax.plot(out[:, 1], out[:, 0], ".", ms=2.6, color=RING, mew=0)
        ax.plot(strong[:, 1], strong[:, 0], "o", ms=7, mfc="none", mec=RING, mew=1.2)
        named = [(i, columns.index(j)) for i, j in named_cells(result) if j in columns]
        if named:
            ax.plot(*np.array(named).T[::-1], "s", ms=9, mfc="none", mec="white", mew=3)
            ax.plot(*np.array(named).T[::-1], "s", ms=9, mfc="none", mec=INK, mew=1.4)
        ax.set_ylim(len(f) - 0.5, -0.5)
        ax.set_xticks(
            range(len(columns)),
            [shortened(whole["causes"][j], 24) for j in columns],
            rotation=60,
            ha="left",
            rotation_mode="anchor",
            fontsize=6.5,
        )
        ax.xaxis.tick_top()
        ax.set_yticks(range(len(f)), [f"frame {name}" for name in whole["places"]], fontsize=6.5)
        ax.tick_params(length=0, colors=INK)
        frames = [name.split()[0] for name in whole["places"]]
        for i in range(1, len(frames)):
            if frames[i] != frames[i - 1]:
                ax.axhline(i - 0.5, color=QUIET, lw=0.7, zorder=3)
        ax.spines[:].set_visible(False)
        _scale(fig, ax, mesh)
        return svg(fig, "Error map")


def _scale(fig: Any, ax: Any, mesh: Any) -> None:
    """The bar that says what a shade means."""
    bar = fig.colorbar(
        mesh, ax=ax, orientation="horizontal", shrink=0.35, aspect=30, pad=0.015, anchor=(1.0, 0.5)
    )
    ticks = [k for k in (0, 1, 2, 3, 4, 5) if k <= mesh.norm.vmax]
    bar.set_ticks(ticks, labels=[f"{10**k:,}" for k in ticks])
    bar.outline.set_visible(False)
    bar.ax.tick_params(labelsize=6.5, length=0)
    bar.set_label("F of the cell alone, beyond the base", fontsize=6.5)


def named_cells(result: dict[str, Any]) -> list[tuple[int, int]]:
    """Cells of the map that a finding names: those of the first entry of its credible set."""
    places = {name: i for i, name in enumerate(result["error_map"]["places"])}
    causes = {name: j for j, name in enumerate(result["error_map"]["causes"])}
    out = []
    for finding in result["findings"]:
        by_place: dict[str, list[str]] = {}
        for s in finding["credible_set"][0]["screws"] if finding["credible_set"] else []:
            by_place.setdefault(f"{s['frame']} {s['axis']}", []).append(s["cause"])
        for place, why in by_place.items():
            known = {" & ".join(why), *why} & causes.keys() if place in places else set()
            out += [(places[place], causes[name]) for name in known]
    return sorted(set(out))
