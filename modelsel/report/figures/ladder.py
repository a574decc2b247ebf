"""The ladder of models against the noise floor, and what each rung leaves on held-out
configurations."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...results.tables import adds
from ..style import AFTER, BLUE, GREY, INK, ORANGE, QUIET, WIDTH, shortened, styled, svg

MOST, CURVES = 26, 6  # rungs that the ladder can hold, and the picture of their errors


def rungs(result: dict[str, Any]) -> list[int]:
    """Indices of the nominal model and of the rungs whose mechanisms the chosen model begins
    with."""
    ladder = result["ladder"]
    chosen = ladder[-1]["mechanisms"]
    return [
        k
        for k, r in enumerate(ladder)
        if k == len(ladder) - 1 or r["mechanisms"] in (["nominal"], chosen[: len(r["mechanisms"])])
    ]


def names(result: dict[str, Any], which: list[int]) -> list[str]:
    """What each rung adds to the one before it, or all of it, in the ladder's own words."""
    return adds([result["ladder"][k]["mechanisms"] for k in which])


def ladder(result: dict[str, Any]) -> bytes:
    """Mean length of the residual vectors, estimation and held-out, a row per rung; grey: what
    noise alone would leave."""
    which = rungs(result)[-MOST:]
    steps, rows = [result["ladder"][k] for k in which], np.arange(len(which))
    used, held = (
        np.array([np.nan if r[side]["mean_mm"] is None else r[side]["mean_mm"] for r in steps])
        for side in ("estimation", "held_out")
    )
    noise = result[
        "noise_floor"
    ]  # mean length of three normal coordinates, unless the file says what its rows have
    floor = noise["mean_mm"] if "mean_mm" in noise else noise["coordinate_mm"] * np.sqrt(8 / np.pi)
    both = np.concatenate([used, held, [floor]])
    low, high = max(np.nanmin(both) / 1.7, 1e-9), np.nanmax(both) * 2.2
    few = np.log10(high / low) < 2
    shown = held if np.isfinite(held).any() else used
    with styled() as sheets:
        fig, ax = sheets.subplots(
            figsize=(WIDTH, min(0.22 * len(steps) + 0.75, 4.1)), layout="constrained"
        )
        ax.set_xscale("log")
        ax.set_xlim(low, high)
        ax.axvspan(low, floor, color="#EFEFEF", lw=0)
        ax.axvline(floor, color="#9A9A9A", lw=0.8)
        ax.text(
            np.sqrt(low * floor),
            len(rows) / 2 - 0.5
            if len(rows) > 4
            else -0.55,  # few rows: above them, where no name and no mark is
            f"noise alone: {floor:.2g} mm",
            rotation=90 if len(rows) > 4 else 0,
            ha="center",
            va="center",
            fontsize=7,
            color=QUIET,
        )
        ax.hlines(rows, floor, shown, color=GREY, lw=1, zorder=1)
        ax.plot(
            used,
            rows,
            "s",
            ms=5.5,
            mfc="none",
            mec=ORANGE,
            mew=1.2,
            label="estimation configurations",
        )
        if shown is held:
            ax.plot(held, rows, "o", ms=4.5, color=AFTER, label="held-out configurations")
        for y, (a, b) in enumerate(zip(used, shown, strict=True)):
            ax.annotate(
                f"{b:.2g}" if b < 0.1 else f"{b:.2f}",
                (np.nanmax([a, b]), y),
                (6, 0),
                textcoords="offset points",
                va="center",
                fontsize=7.5,
                color=BLUE,
                fontweight="bold" if y == len(rows) - 1 else "normal",
            )
        ax.set_yticks(rows, [shortened(n, 44) for n in names(result, which)], color=INK)
        ax.set_ylim(len(steps) - 0.5, -0.6 if len(rows) > 4 else -0.8)
        ax.set_xticks(
            [
                t
                for t in np.outer(10.0 ** np.arange(-6, 5), (1, 2, 5) if few else (1,)).ravel()
                if low <= t <= high
            ]
        )
        ax.xaxis.set_major_formatter(lambda v, _: f"{v:g}")
        ax.xaxis.set_minor_formatter(lambda v, _: "")
        ax.set_xlabel("mean position error [mm], logarithmic")
        ax.tick_params(axis="y", length=0)
        ax.spines["left"].set_visible(False)
        ax.legend(loc="lower right", fontsize=7)
        return svg(fig, f"Ladder of models: {result['study']}")


def held_out(result: dict[str, Any], details: dict[str, Any]) -> bytes | None:
    """Share of configurations whose error stays below a length, a curve per rung of the way; None
    where there is no row."""
    rows = details["rows"]
    estimation, outlying = np.array(rows["estimation"], bool), np.array(rows["outlying"], bool)
    side = ~estimation & ~outlying if (~estimation & ~outlying).any() else ~outlying
    if not side.any():
        return None
    which = rungs(result)
    which = (
        which
        if len(which) <= CURVES
        else [which[round(k)] for k in np.linspace(0, len(which) - 1, CURVES)]
    )
    labels = names(result, rungs(result))
    import matplotlib as mpl

    with styled() as sheets:
        fig, ax = sheets.subplots(figsize=(WIDTH, 2.4), layout="constrained")
        for n, k in enumerate(which):
            size = np.sort(
                np.linalg.norm(np.array(details["rungs"][k]["residual_mm"])[side], axis=1)
            )
            share = np.arange(1, len(size) + 1) / len(size)
            last = n == len(which) - 1
            ax.step(
                np.maximum(size, 1e-4),
                share,
                where="post",
                lw=1.8 if last else 1.1,
                ls=("-", "--", "-.", ":", (0, (5, 1)), "-")[n],
                color=BLUE if last else mpl.colormaps["Greys"](0.45 + 0.08 * n),
                label=shortened(labels[rungs(result).index(k)], 36),
            )
        ax.set_xscale("log")
        ax.xaxis.set_major_formatter(lambda v, _: f"{v:g}")
        ax.xaxis.set_minor_formatter(lambda v, _: "")
        ax.set_ylim(0, 1.01)
        ax.yaxis.set_major_formatter(lambda v, _: f"{v:.0%}")
        ax.set_xlabel("position error [mm], logarithmic")
        ax.set_ylabel("configurations below it")
        ax.grid(True)
        ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
        return svg(fig, "Distribution of held-out errors")
