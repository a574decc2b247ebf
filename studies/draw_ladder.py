"""Draw the README's picture: the ladder of models of one result.json, from nominal to chosen, against the noise floor.

    modelsel study studies/puma760/study.toml --out reports/puma760
    python studies/draw_ladder.py reports/puma760/result.json reports/ladder.svg

The rungs drawn are those that lead to the chosen model; rungs of the study's own ladder that do not are left out. The same
result gives the same bytes.
"""
from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

BLUE, ORANGE, GREY, INK = "#0072B2", "#E69F00", "#D9D9D9", "#333333"   # Okabe and Ito 2008, colour-blind safe
STYLE = {"svg.hashsalt": "modelsel", "svg.fonttype": "none", "font.family": "sans-serif", "font.size": 10, "text.color": INK,
         "axes.labelcolor": INK, "xtick.color": INK, "ytick.color": INK, "axes.edgecolor": INK}


def rungs(result: dict[str, Any]) -> list[dict[str, Any]]:
    """The nominal model and the rungs whose mechanisms the chosen model begins with."""
    ladder = result["ladder"]
    chosen = ladder[-1]["mechanisms"]
    return [r for r in ladder if r["mechanisms"] in (["nominal"], chosen[:len(r["mechanisms"])])]


def name_of(rung: dict[str, Any], first: bool) -> str:
    return f"{rung['mechanisms'][-1]} model" if first else f"+ {rung['mechanisms'][-1]}"


def draw(result: dict[str, Any], path: Path) -> None:
    """Write the picture: mean length of the residual vectors, estimation and held-out, a row per rung."""
    mpl.use("Agg")
    import matplotlib.pyplot as plt
    steps = rungs(result)
    rows = np.arange(len(steps))
    used, held = (np.array([r[side]["mean_mm"] for r in steps]) for side in ("estimation", "held_out"))
    floor = result["noise_floor"]["coordinate_mm"] * np.sqrt(8 / np.pi)   # mean length of three normal coordinates
    with plt.rc_context(STYLE):
        fig, ax = plt.subplots(figsize=(7.4, 0.36 * len(steps) + 1.3), layout="constrained")
        ax.set_xscale("log")
        ax.set_xlim(floor / 1.6, held.max() * 2)
        ax.axvspan(floor / 1.6, floor, color=GREY, lw=0)
        ax.text(floor / 1.26, len(steps) / 2, f"noise alone: {floor:.2f} mm", ha="center", va="center", rotation=90, fontsize=9)
        ax.hlines(rows, floor, held, color=GREY, lw=1, zorder=1)
        ax.plot(used, rows, "s", ms=7, mfc="none", mec=ORANGE, mew=1.6, label="estimation configurations")
        ax.plot(held, rows, "o", ms=5.5, color=BLUE, label="held-out configurations")
        for y, (a, b) in enumerate(zip(used, held, strict=True)):
            ax.annotate(f"{b:.2f}", (max(a, b), y), (9, 0), textcoords="offset points", va="center", fontsize=9, color=BLUE)
        ax.set_yticks(rows, [name_of(r, k < 1) for k, r in enumerate(steps)])
        ax.set_ylim(len(steps) - 0.4, -0.6)
        ax.set_xticks([0.1, 1.0, 10.0], ["0.1", "1", "10"])
        ax.set_xlabel("mean position error [mm]")
        ax.tick_params(axis="y", length=0)
        ax.spines[["top", "right", "left"]].set_visible(False)
        ax.legend(loc="lower right", frameon=False, fontsize=9)
        fig.savefig(path, metadata={"Date": None, "Title": f"Ladder of models: {result['study']}"})
        plt.close(fig)


if __name__ == "__main__":
    draw(json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")), Path(sys.argv[2]))
