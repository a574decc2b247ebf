"""Where was measured: joint coverage, the workspace in three dimensions, and the residual vectors
in it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..._typing import Array
from ...results.schemas.details_schema import DetailsRecord, JointRecord
from ..style import BLUE, HALF_WIDTH, INK, ORANGE, QUIET, svg, use_style

HEIGHT = 2.3  # inch
MAX_LENGTHS = 4  # intervals between the numbers below a joint that slides
VIEW = (22.0, -58.0)  # elevation, azimuth in degrees: the same in every picture

Mask = NDArray[np.bool_]


def draw_joints(details: DetailsRecord) -> bytes:
    """Draw a strip per joint: its range in grey, readings of estimation above and held-out below."""
    readings = np.array(details.rows.q)
    estimation = np.array(details.rows.estimation, bool)
    count = len(details.joints)
    with use_style() as sheets:
        fig, axes = sheets.subplots(
            count, 1, figsize=(HALF_WIDTH, 0.32 * count + 0.3), layout="constrained", squeeze=False
        )
        for index, joint in enumerate(details.joints):
            ax = axes[index, 0]
            _draw_readings(ax, joint, readings[:, index], estimation)
            label = f"joint {index + 1}"
            ax.set_ylabel(label, rotation=0, ha="right", va="center", color=INK)
        return svg(fig, "Joint coverage")


def _draw_readings(ax: Any, joint: JointRecord, readings: Array, estimation: Mask) -> None:
    """Draw one joint's strip."""
    is_angle = joint.unit == "rad"
    values = np.degrees(readings) if is_angle else readings
    low, high = float(values.min()), float(values.max())
    if joint.limits is not None:
        limits = np.degrees(joint.limits) if is_angle else np.array(joint.limits)
        ax.axvspan(*limits, color="#F0F0F0", lw=0)
        low, high = min(low, limits[0]), max(high, limits[1])
    for side, height, colour in ((estimation, 0.55, ORANGE), (~estimation, -0.55, BLUE)):
        heights = np.full(int(side.sum()), height)
        ax.plot(values[side], heights, "|", ms=6.5, mew=0.6, color=colour)
    margin = 0.02 * max(high - low, 1e-6)
    unit = "°" if is_angle else " mm"
    ax.set_xlim(low - margin, high + margin)
    ax.set_ylim(-1.15, 1.15)
    ax.set_yticks([])
    ax.spines[["left", "bottom"]].set_visible(False)
    ax.tick_params(labelsize=6.5, length=2, pad=1)
    if not is_angle:
        ax.locator_params(axis="x", nbins=MAX_LENGTHS)
    ax.xaxis.set_major_formatter(lambda value, _: f"{value:.0f}{unit}")


def _frame(ax: Any, points: Array) -> None:
    """Set equal scales about the points, and a quiet box."""
    low, high = points.min(0), points.max(0)
    middle = (low + high) / 2
    half = 1.05 * max(float((high - low).max()) / 2, 1.0)
    for index, name in enumerate("xyz"):
        ends = (middle[index] - half, middle[index] + half)
        _frame_axis(ax, name, ends)
    ax.tick_params(labelsize=5.5, pad=-3, colors=QUIET)
    ax.view_init(*VIEW)
    ax.set_box_aspect((1, 1, 1), zoom=0.9)


def _frame_axis(ax: Any, name: str, ends: tuple[float, float]) -> None:
    from matplotlib.ticker import MaxNLocator

    padding = -4 if name == "z" else -7
    getattr(ax, f"set_{name}lim")(*ends)
    getattr(ax, f"set_{name}label")(f"{name} [mm]", fontsize=6.5, labelpad=padding)
    axis = getattr(ax, f"{name}axis")
    axis.set_pane_color((1, 1, 1, 0))
    axis._axinfo["grid"].update(color="#E4E4E4", linewidth=0.5)
    axis.set_major_locator(MaxNLocator(4))
    axis.line.set_color("#BBBBBB")


def draw_workspace(details: DetailsRecord) -> bytes:
    """Draw the measured targets in the tracker's frame, with the arm at a middling configuration."""
    targets, chain = np.array(details.rows.measured_mm), np.array(details.arm_mm)
    with use_style() as sheets:
        fig = sheets.figure(figsize=(HALF_WIDTH, HEIGHT))
        ax = fig.add_axes((0.0, 0.1, 0.95, 0.9), projection="3d")
        _draw_arm(ax, chain)
        _draw_targets(ax, details, targets)
        _frame(ax, np.vstack([targets, chain]))
        fig.legend(*ax.get_legend_handles_labels(), loc="lower center", ncols=4, fontsize=6.5)
        return svg(fig, "Workspace")


def _draw_arm(ax: Any, chain: Array) -> None:
    label = "the arm"
    ax.plot(*chain.T, color=INK, lw=1.6, marker="o", ms=2.5, zorder=1, label=label)


def _draw_targets(ax: Any, details: DetailsRecord, targets: Array) -> None:
    """Draw the measured targets, the sides of the split and outliers apart."""
    estimation = np.array(details.rows.estimation, bool)
    outlying = np.array(details.rows.outlying, bool)
    squares = {"marker": "s", "s": 9, "facecolors": "none", "edgecolors": ORANGE}
    dots = {"marker": "o", "s": 5, "color": BLUE, "linewidths": 0}
    crosses = {"marker": "x", "s": 22, "color": INK, "linewidths": 1}
    ax.scatter(
        *targets[estimation].T, **squares, linewidths=0.7, depthshade=False, label="estimation"
    )
    if (~estimation).any():
        ax.scatter(*targets[~estimation].T, **dots, depthshade=False, label="held-out")
    if outlying.any():
        ax.scatter(*targets[outlying].T, **crosses, depthshade=False, label="left out")
