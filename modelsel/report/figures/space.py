"""Where was measured: joint coverage, the workspace in three dimensions, and the residual vectors
in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..._typing import Array, Index
from ...results.details_schema import DetailsRecord, JointRecord
from ..style import AFTER, BLUE, INK, ORANGE, QUIET, WIDTH, shorten, svg, use_style

MAX_VECTORS = 220  # drawn in one picture
LONGEST_TITLE = 34  # letters
VIEW = (22.0, -58.0)  # elevation, azimuth in degrees: the same in every picture

Mask = NDArray[np.bool_]


def draw_joints(details: DetailsRecord) -> bytes:
    """Draw a strip per joint: its range in grey, readings of estimation above and held-out below."""
    readings = np.array(details.rows.q)
    estimation = np.array(details.rows.estimation, bool)
    count = len(details.joints)
    with use_style() as sheets:
        fig, axes = sheets.subplots(
            count, 1, figsize=(WIDTH, 0.36 * count + 0.35), layout="constrained", squeeze=False
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
    """Draw the measured targets in the tracker's frame, seen from two sides, with the arm at a middling
    configuration."""
    targets, chain = np.array(details.rows.measured_mm), np.array(details.arm_mm)
    with use_style() as sheets:
        fig = sheets.figure(figsize=(WIDTH, 3.1))
        elevation, azimuth = VIEW
        for index, turned in enumerate((azimuth, azimuth + 90)):
            ax = fig.add_axes((0.5 * index, 0.08, 0.48, 0.92), projection="3d")
            _draw_arm(ax, chain)
            _draw_targets(ax, details, targets)
            _frame(ax, np.vstack([targets, chain]))
            ax.view_init(elevation, turned)
        fig.legend(*ax.get_legend_handles_labels(), loc="lower center", ncols=4, fontsize=7)
        return svg(fig, "Workspace")


def _draw_arm(ax: Any, chain: Array) -> None:
    label = "the arm, one configuration"
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
        ax.scatter(*targets[outlying].T, **crosses, depthshade=False, label="outlier")


# -- residual vectors
# -----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Vectors:
    """Residual vectors of one model, drawn so many times as long."""

    title: str
    residual: Array
    factor: float
    is_last: bool


def choose_magnification(residual: Array, room: float) -> float:
    """Return a round factor (1, 2 or 5 times a power of ten) that draws the 95th percentile about a tenth of the
    workspace long."""
    typical = float(np.percentile(np.linalg.norm(residual, axis=1), 95))
    if typical <= 0:
        return 1.0
    wanted = 0.12 * room / typical
    power = 10.0 ** np.floor(np.log10(wanted))
    fitting = [factor for factor in (1, 2, 5) if factor * power <= wanted * (1 + 1e-9)]
    return float(power * max(fitting))


def draw_vectors(details: DetailsRecord, rungs: Sequence[tuple[int, str]]) -> bytes:
    """Draw the residual vectors (measured minus predicted) of some rungs, each at its own stated magnification; the
    last one again at that of the first."""
    sound = np.flatnonzero(~np.array(details.rows.outlying, bool))
    count = min(len(sound), MAX_VECTORS)
    rows = sound[np.unique(np.linspace(0, len(sound) - 1, count).astype(int))]
    targets = np.array(details.rows.measured_mm)[rows]
    panels = _vector_panels(details, rungs, rows, targets)
    lines = -(-len(panels) // 2)
    with use_style() as sheets:
        fig = sheets.figure(figsize=(WIDTH, 2.3 * lines))
        for index, panel in enumerate(panels):
            corner = (0.5 * (index % 2), 1 - (index // 2 + 1) / lines)
            _draw_vector_panel(fig, panel, targets, corner, 1 / lines)
        return svg(fig, "Residual vectors")


def _vector_panels(
    details: DetailsRecord, rungs: Sequence[tuple[int, str]], rows: Index, targets: Array
) -> list[_Vectors]:
    """Return what is drawn of every rung."""
    room = max(float(np.ptp(targets, axis=0).max()), 1.0)
    panels = []
    for number, (rung, name) in enumerate(rungs, 1):
        residual = np.array(details.rungs[rung].residual_mm)[rows]
        factor = choose_magnification(residual, room)
        panels.append(_Vectors(name, residual, factor, number == len(rungs)))
    if len(panels) > 1:
        last = panels[-1]
        title = f"{last.title}, drawn as the first"
        panels.append(_Vectors(title, last.residual, panels[0].factor, True))
    return panels


def _draw_vector_panel(
    fig: Any, panel: _Vectors, targets: Array, corner: tuple[float, float], height: float
) -> None:
    """Draw one picture, its title and its magnification above it."""
    from mpl_toolkits.mplot3d.art3d import Line3DCollection

    x, y = corner
    ax = fig.add_axes((x, y, 0.47, 0.93 * height), projection="3d")
    colour = AFTER if panel.is_last else "#555555"
    arrows = np.stack([targets, targets + panel.factor * panel.residual], 1)
    ax.add_collection3d(Line3DCollection(arrows, colors=colour, linewidths=0.8))
    ax.scatter(*targets.T, s=1.5, color=INK, linewidths=0, depthshade=False)
    _frame(ax, targets)
    title = shorten(panel.title, LONGEST_TITLE)
    fig.text(x + 0.02, y + 0.95 * height, title, fontsize=8, fontweight="bold")
    magnification = f"drawn {panel.factor:,.0f} times as long"
    fig.text(x + 0.02, y + 0.905 * height, magnification, fontsize=7, color=QUIET)
