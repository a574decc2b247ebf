"""Where was measured: joint coverage, the workspace in three dimensions, and the residual vectors
in it."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..._typing import Array
from ..style import AFTER, BLUE, INK, ORANGE, QUIET, WIDTH, shortened, styled, svg

VECTORS = 220  # drawn in one picture
VIEW = (22.0, -58.0)  # elevation, azimuth in degrees: the same in every picture


def _rows(details: dict[str, Any]) -> tuple[Any, Any]:
    rows = details["rows"]
    return np.array(rows["estimation"], bool), np.array(rows["outlying"], bool)


def joints(details: dict[str, Any]) -> bytes:
    """A strip per joint: its range in grey, readings of estimation above and held-out below."""
    estimation, _ = _rows(details)
    q = np.array(details["rows"]["q"])
    n = q.shape[1]
    with styled() as sheets:
        fig, axes = sheets.subplots(
            n, 1, figsize=(WIDTH, 0.36 * n + 0.35), layout="constrained", squeeze=False
        )
        for j, ax in enumerate(axes[:, 0]):
            joint = details["joints"][j]
            turn = np.degrees if joint["unit"] == "rad" else np.asarray
            values = turn(q[:, j])
            limits = turn(np.array(joint["limits"])) if joint["limits"] is not None else None
            low, high = (
                (values.min(), values.max())
                if limits is None
                else (min(limits[0], values.min()), max(limits[1], values.max()))
            )
            room = max(high - low, 1e-6)
            if limits is not None:
                ax.axvspan(*limits, color="#F0F0F0", lw=0)
            for side, height, colour in ((estimation, 0.55, ORANGE), (~estimation, -0.55, BLUE)):
                ax.plot(
                    values[side],
                    np.full(int(side.sum()), height),
                    "|",
                    ms=6.5,
                    mew=0.6,
                    color=colour,
                )
            ax.set_xlim(low - 0.02 * room, high + 0.02 * room)
            ax.set_ylim(-1.15, 1.15)
            ax.set_yticks([])
            ax.spines[["left", "bottom"]].set_visible(False)
            ax.set_ylabel(f"joint {j + 1}", rotation=0, ha="right", va="center", color=INK)
            ax.tick_params(labelsize=6.5, length=2, pad=1)
            ax.xaxis.set_major_formatter(
                lambda v, _, u="°" if joint["unit"] == "rad" else " mm": f"{v:.0f}{u}"
            )
        return svg(fig, "Joint coverage")


def _frame(ax: Any, points: Array) -> None:
    """Equal scales about the points, a quiet box."""
    low, high = points.min(0), points.max(0)
    middle, half = (low + high) / 2, max(float((high - low).max()) / 2, 1.0) * 1.05
    for k, side in enumerate("xyz"):
        getattr(ax, f"set_{side}lim")(middle[k] - half, middle[k] + half)
        getattr(ax, f"set_{side}label")(
            f"{side} [mm]", fontsize=6.5, labelpad=-7 if side != "z" else -4
        )
        axis = getattr(ax, f"{side}axis")
        axis.set_pane_color((1, 1, 1, 0))
        axis._axinfo["grid"].update(color="#E4E4E4", linewidth=0.5)
        axis.set_major_locator(_few())
        axis.line.set_color("#BBBBBB")
    ax.tick_params(labelsize=5.5, pad=-3, colors=QUIET)
    ax.view_init(*VIEW)
    ax.set_box_aspect((1, 1, 1), zoom=0.9)


def _few() -> Any:
    from matplotlib.ticker import MaxNLocator

    return MaxNLocator(4)


def workspace(details: dict[str, Any]) -> bytes:
    """Measured targets in the tracker's frame, seen from two sides, with the arm at a middling
    configuration."""
    estimation, outlying = _rows(details)
    x, chain = np.array(details["rows"]["measured_mm"]), np.array(details["arm_mm"])
    with styled() as sheets:
        fig = sheets.figure(figsize=(WIDTH, 3.1))
        for k, azimuth in enumerate((VIEW[1], VIEW[1] + 90)):
            ax = fig.add_axes((0.5 * k, 0.08, 0.48, 0.92), projection="3d")
            ax.plot(
                *chain.T,
                color=INK,
                lw=1.6,
                marker="o",
                ms=2.5,
                zorder=1,
                label="the arm, one configuration",
            )
            ax.scatter(
                *x[estimation].T,
                marker="s",
                s=9,
                facecolors="none",
                edgecolors=ORANGE,
                linewidths=0.7,
                depthshade=False,
                label="estimation",
            )
            if (~estimation).any():
                ax.scatter(
                    *x[~estimation].T,
                    marker="o",
                    s=5,
                    color=BLUE,
                    linewidths=0,
                    depthshade=False,
                    label="held-out",
                )
            if outlying.any():
                ax.scatter(
                    *x[outlying].T,
                    marker="x",
                    s=22,
                    color=INK,
                    linewidths=1,
                    depthshade=False,
                    label="outlier",
                )
            _frame(ax, np.vstack([x, chain]))
            ax.view_init(VIEW[0], azimuth)
        fig.legend(*ax.get_legend_handles_labels(), loc="lower center", ncols=4, fontsize=7)
        return svg(fig, "Workspace")


def magnification(residual: Array, room: float) -> float:
    """A round factor (1, 2 or 5 times a power of ten) that draws the 95th percentile about a tenth
    of the workspace long."""
    typical = float(np.percentile(np.linalg.norm(residual, axis=1), 95))
    if typical <= 0:
        return 1.0
    wanted = 0.12 * room / typical
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(power * max(k for k in (1, 2, 5) if k * power <= wanted * (1 + 1e-9)))


def vectors(details: dict[str, Any], which: list[tuple[int, str]]) -> bytes:
    """Residual vectors (measured minus predicted) of some rungs, each at its own stated
    magnification; the last one again at that of the first."""
    from mpl_toolkits.mplot3d.art3d import Line3DCollection

    _, outlying = _rows(details)
    x = np.array(details["rows"]["measured_mm"])[~outlying]
    thin = np.unique(np.linspace(0, len(x) - 1, min(len(x), VECTORS)).astype(int))
    x, room = x[thin], max(float(np.ptp(x, axis=0).max()), 1.0)
    shown = [
        (np.array(details["rungs"][k]["residual_mm"])[~outlying][thin], name) for k, name in which
    ]
    panels = [(r, name, magnification(r, room)) for r, name in shown]
    if len(panels) > 1:
        panels.append((panels[-1][0], f"{panels[-1][1]}, drawn as the first", panels[0][2]))
    lines = -(-len(panels) // 2)
    with styled() as sheets:
        fig = sheets.figure(figsize=(WIDTH, 2.3 * lines))
        for n, (r, name, factor) in enumerate(panels):
            left, bottom, high = 0.5 * (n % 2), 1 - (n // 2 + 1) / lines, 1 / lines
            ax = fig.add_axes((left, bottom, 0.47, 0.93 * high), projection="3d")
            colour = AFTER if n >= len(which) - 1 else "#555555"
            ax.add_collection3d(
                Line3DCollection(np.stack([x, x + factor * r], 1), colors=colour, linewidths=0.8)
            )
            ax.scatter(*x.T, s=1.5, color=INK, linewidths=0, depthshade=False)
            _frame(ax, x)
            fig.text(
                left + 0.02,
                bottom + 0.95 * high,
                shortened(name, 34),
                fontsize=8,
                fontweight="bold",
            )
            fig.text(
                left + 0.02,
                bottom + 0.905 * high,
                f"drawn {factor:,.0f} times as long",
                fontsize=7,
                color=QUIET,
            )
        return svg(fig, "Residual vectors")
