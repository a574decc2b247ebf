"""One finding: the residual about its axis against its cause, before and after; who else it could
be."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..._typing import Array
from ..style import (
    AFTER,
    BEFORE,
    BLUE,
    GREY,
    INK,
    ORANGE,
    QUIET,
    WIDTH,
    scaled,
    shortened,
    styled,
    svg,
)

BINS = 12
BARS = 8
GOLDEN = 0.6180339887  # spreads points that share a value, evenly and without chance
FEW = 6  # distinct values of a cause up to which they are drawn apart


def binned(x: Array, y: Array, weight: Array) -> tuple[Array, Array]:
    """Weighted means in bins of equally many points, or at each value where there are few: what the
    eye should follow."""
    order, values = np.argsort(x, kind="stable"), np.unique(x)
    parts = (
        [np.flatnonzero(x == v) for v in values if (x == v).sum() >= min(FEW, len(x))]
        if len(values) <= FEW
        else [p for p in np.array_split(order, min(BINS, max(len(x) // 6, 1))) if len(p)]
    )
    mean = [[float(np.average(v[p], weights=weight[p])) for p in parts] for v in (x, y)]
    return np.array(mean[0]), np.array(mean[1])


def _steps(x: Array, y: Array, weight: Array) -> tuple[Array, Array]:
    """Means on either side of nought, drawn where the points lie."""
    sides = [s for s in (x < 0, x > 0) if s.any()]
    return (
        np.array([np.average(x[s]) for s in sides]),
        np.array([np.average(y[s], weights=weight[s]) for s in sides]),
    )


def height(points: Array, curve: Array) -> float:
    """Up to where a panel is drawn: nearly all points, and the fitted effect whole unless it is
    several times as high."""
    usual = 1.15 * float(np.percentile(np.abs(points), 98))
    return max(usual, min(1.05 * float(np.abs(curve).max(initial=0.0)), 3 * usual), 1e-12)


def axis_name(panel: dict[str, Any]) -> str:
    """What turns or shifts, in words."""
    if not panel["frames"]:
        return "displacement along the effect"
    where = " and ".join(str(f) for f in panel["frames"][:3])
    return f"{'turn about' if panel['axis'][0] == 'r' else 'shift along'} {panel['axis'][1]} of frame {where}"


def finding(panels: list[dict[str, Any]]) -> bytes:
    """Up to three panels: grey, what the model without the effect leaves; blue, with it; orange,
    the fitted effect."""
    n = len(panels)
    with styled() as sheets:
        fig, axes = sheets.subplots(
            1, n, figsize=(WIDTH, 2.8 if n > 1 else 3.2), layout="constrained", squeeze=False
        )
        for ax, panel in zip(axes[0], panels, strict=True):
            x, before, after, weight = (
                np.array(panel[k], float) for k in ("x", "before", "after", "weight")
            )
            biggest = float(np.percentile(np.abs(np.concatenate([before, after])), 99))
            factor, unit = scaled(panel["unit"], biggest)
            ax.axhline(0, color="#BBBBBB", lw=0.7)
            spread = x + (
                0.05 * np.ptp(x) * (np.arange(len(x)) * GOLDEN % 1 - 0.5)
                if len(np.unique(x)) <= FEW
                else 0.0
            )
            ax.scatter(
                spread,
                factor * before,
                s=3 + 8 * weight,
                marker="s",
                facecolors="none",
                edgecolors=BEFORE,
                linewidths=0.5,
                alpha=0.7,
            )
            ax.scatter(
                spread,
                factor * after,
                s=2 + 6 * weight,
                marker="o",
                color=AFTER,
                linewidths=0,
                alpha=0.45,
            )
            group = _steps if panel["kind"] == "step" else binned
            if panel["kind"] == "step":
                for side in (-1, 1):
                    part = np.sign(panel["curve"][0]) == side
                    ax.plot(
                        np.array(panel["curve"][0])[part],
                        factor * np.array(panel["curve"][1])[part],
                        color=ORANGE,
                        lw=1.6,
                    )
            else:
                ax.plot(
                    panel["curve"][0], factor * np.array(panel["curve"][1]), color=ORANGE, lw=1.6
                )
            for y, colour, mark in ((before, INK, "s"), (after, BLUE, "o")):
                bx, by = group(x, y, weight)
                ax.plot(bx, factor * by, mark, ms=4.5, mfc="white", mec=colour, mew=1.1, zorder=4)
            top = factor * height(
                np.concatenate([before, after]), np.array(panel["curve"][1], float)
            )
            ax.set_ylim(-top, top)
            ax.set_xlabel(
                f"{shortened(panel['against'], 30)}"
                + (
                    f" [{'°' if panel['against_unit'] == 'deg' else panel['against_unit']}]"
                    if panel["against_unit"] != "1"
                    else ""
                )
            )
            ax.set_title(
                f"{axis_name(panel)} [{unit}]",
                fontsize=7.5 if n < 3 else 6.5,
                fontweight="normal",
                color=INK,
            )
        fig.legend(handles=_legend(), loc="outside lower center", ncols=3, fontsize=7)
        return svg(fig, "Residual against cause")


def _legend() -> list[Any]:
    from matplotlib.lines import Line2D as line  # noqa: N813

    return [
        line(
            [],
            [],
            ls="",
            marker="s",
            mfc="white",
            mec=INK,
            label="without this effect (large: means)",
        ),
        line([], [], ls="", marker="o", mfc="white", mec=BLUE, label="with it"),
        line([], [], color=ORANGE, lw=1.6, label="the fitted effect"),
    ]


def credible(entries: list[tuple[str, float, bool]]) -> bytes:
    """Probability of every explanation listed, the first on top; hatched where it does not move the
    target alike."""
    shown = entries[:BARS]
    rows = np.arange(len(shown))
    with styled() as sheets:
        fig, ax = sheets.subplots(figsize=(WIDTH, 0.21 * len(shown) + 0.5), layout="constrained")
        ax.barh(
            rows,
            [p for _, p, _ in shown],
            height=0.62,
            color=[BLUE if alike else "white" for *_, alike in shown],
            edgecolor=[BLUE if alike else QUIET for *_, alike in shown],
            linewidth=0.8,
            hatch=["" if a else "////" for *_, a in shown],
        )
        for y, (_, p, _) in enumerate(shown):
            ax.annotate(
                f"{p:.2f}" if p >= 0.005 else "<0.01",
                (p, y),
                (4, 0),
                textcoords="offset points",
                va="center",
                fontsize=7.5,
            )
        ax.set_yticks(rows, [shortened(name, 52) for name, *_ in shown], color=INK)
        ax.set_ylim(len(shown) - 0.4, -0.6)
        ax.set_xlim(0, 1.1)
        ax.set_xticks([0, 0.5, 1], ["0", "0.5", "1"])
        ax.axvline(1, color=GREY, lw=0.6, zorder=0)
        ax.set_xlabel("probability")
        ax.tick_params(axis="y", length=0)
        ax.spines["left"].set_visible(False)
        return svg(fig, "Credible set")
