"""This arm, drawn: its frames numbered with the axes that symbols speak of, and the places that
findings name."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..._typing import Array
from ...results.details_schema import ArmRecord
from ..style import BLUE, INK, ORANGE, QUIET, WIDTH, shorten, svg, use_style

ELEVATION = 24.0  # degrees
AZIMUTHS = np.arange(-160.0, 180.0, 10.0)
LONGEST_MARK = 46  # letters
# share of the arm's size below which frames stand at one point of the picture
SAME_POINT = 0.07
AXIS_LENGTH = 0.13  # of the arm's size
TRIAD_COLUMNS = 4
NUMBER_OFFSET = 13.0  # points
AXIS_COLOURS = (ORANGE, QUIET, BLUE)
HIDDEN = 0.2  # length of an axis below which it points at the reader


def draw_frames(arm: ArmRecord) -> bytes:
    """Draw the arm with its frames numbered, and beside it the axes of every frame in the same view."""
    view = choose_view(arm)
    joints = len(arm.slides)
    lines = -(-(joints + 1) // TRIAD_COLUMNS)
    with use_style() as sheets:
        fig = sheets.figure(figsize=(WIDTH, 2.35))
        ax = fig.add_axes((0.0, 0.0, 0.46, 1.0))
        _draw_arm(ax, arm, view)
        for frame in range(1, joints + 2):
            row, column = divmod(frame - 1, TRIAD_COLUMNS)
            width, height = 0.54 / TRIAD_COLUMNS, 1.0 / lines
            place = (0.46 + column * width, 1 - (row + 1) * height, width, height)
            name = "target" if frame > joints else f"frame {frame}"
            _draw_triad(fig.add_axes(place), np.array(arm.axes[frame]), view, name)
        return svg(fig, "The arm with its frames")


def draw_marked(arm: ArmRecord, marks: Sequence[tuple[str, Sequence[int]]]) -> bytes:
    """Draw the arm, and a label with lines to the frames that each finding names."""
    origins = np.array(arm.origins_mm)
    view = choose_view(arm)
    points = (origins @ view.T)[:, :2]
    with use_style() as sheets:
        fig = sheets.figure(figsize=(WIDTH, 2.35))
        ax = fig.add_axes((0.0, 0.0, 1.0, 1.0))
        _draw_arm(ax, arm, view)
        low, high = points.min(0), points.max(0)
        _write_marks(ax, marks, points)
        size = float((high - low).max())
        ax.set_xlim(low[0] - 0.6 * size, low[0] - 0.6 * size + WIDTH / 2.35 * 1.3 * size)
        return svg(fig, "The arm with what was found")


def choose_view(arm: ArmRecord) -> Array:
    """Choose from where the arm is seen: rows of (3, 3) are right, up and towards the reader. The azimuth
    shows most of the links and of the axes."""
    origins, axes = np.array(arm.origins_mm), np.array(arm.axes)
    views = [_view(azimuth) for azimuth in AZIMUTHS]
    shares = [_measure_seen(origins, axes, view) for view in views]
    return views[int(np.argmax(shares))]


def _view(azimuth: float) -> Array:
    turn, tilt = np.radians(azimuth), np.radians(ELEVATION)
    right = np.array([-np.sin(turn), np.cos(turn), 0.0])
    towards = np.array([np.cos(tilt) * np.cos(turn), np.cos(tilt) * np.sin(turn), np.sin(tilt)])
    up = np.cross(towards, right)
    return np.stack([right, up, towards])


def _measure_seen(origins: Array, axes: Array, view: Array) -> float:
    """Return how much of the links' lengths is seen, times how much of each frame's shortest axis."""
    steps = np.diff(origins, axis=0)
    lengths = np.linalg.norm(steps, axis=1).sum()
    seen = np.linalg.norm(steps @ view[:2].T, axis=1).sum()
    shown = np.linalg.norm(view[:2] @ axes, axis=1).min(1)
    return float(seen / max(lengths, 1e-9) * (0.3 + shown.mean()))


def _group_frames(points: Array, size: float) -> list[list[int]]:
    """Group the frames 1 to n + 1 that stand at one point of the picture, in their order."""
    groups: list[list[int]] = []
    for frame in range(1, len(points)):
        for group in groups:
            if np.linalg.norm(points[group[0]] - points[frame]) < SAME_POINT * size:
                group.append(frame)
                break
        else:
            groups.append([frame])
    return groups


def _draw_arm(ax: Any, arm: ArmRecord, view: Array) -> None:
    """Draw links, joint axes and numbers."""
    origins, axes = np.array(arm.origins_mm), np.array(arm.axes)
    points = (origins @ view.T)[:, :2]
    size = float(np.ptp(points, axis=0).max()) or 1.0
    ax.plot(
        *points.T, color="#C9CED3", lw=7, solid_capstyle="round", solid_joinstyle="round", zorder=1
    )
    base = points[0] + np.outer([-0.09, 0.09], [1.0, 0.0]) * size
    ax.plot(*base.T, color=QUIET, lw=2, zorder=1)
    last = len(points) - 1
    for frame in range(1, last):
        along = AXIS_LENGTH * size * (view @ axes[frame][:, 2])[:2]
        ends = np.stack([points[frame] - along, points[frame] + along])
        ax.plot(*ends.T, color=BLUE, lw=0.9, ls=(0, (5, 2)), zorder=2)
        mark = "s" if arm.slides[frame - 1] else "o"
        ax.plot(*points[frame], mark, ms=5, mfc="white", mec=INK, mew=1.1, zorder=3)
    ax.plot(*points[last], "o", ms=4.5, color=INK, zorder=3)
    _write_numbers(ax, points, size)
    ax.set_aspect("equal", adjustable="datalim")
    ax.margins(0.12)
    ax.set_axis_off()


def _write_numbers(ax: Any, points: Array, size: float) -> None:
    """Write the numbers of the frames beside them, away from the arm's middle."""
    last = len(points) - 1
    middle = points.mean(0)
    for group in _group_frames(points, size):
        names = ["target" if frame == last else str(frame) for frame in group]
        place = points[group].mean(0)
        away = place - middle
        x, y = NUMBER_OFFSET * away / max(float(np.linalg.norm(away)), 1e-9)
        side = "left" if x > 0 else "right"
        ax.annotate(
            " ".join(names),
            place,
            (x, y),
            textcoords="offset points",
            ha=side,
            va="center",
            fontsize=8,
            fontweight="bold",
            color=INK,
            zorder=4,
        )


def _draw_triad(ax: Any, axes: Array, view: Array, name: str) -> None:
    """Draw the axes of one frame as the reader sees them."""
    for index, (letter, colour) in enumerate(zip("xyz", AXIS_COLOURS, strict=True)):
        x, y, depth = view @ axes[:, index]
        if np.hypot(x, y) < HIDDEN:
            mark = "." if depth > 0 else "x"
            ax.plot(0, 0, "o", ms=8, mfc="white", mec=colour, mew=1, zorder=3)
            ax.plot(0, 0, mark, ms=4, color=colour, zorder=4)
            ax.text(0.16, -0.26, letter, color=colour, fontsize=8, ha="center", va="center")
            continue
        ax.annotate(
            "",
            (0.8 * x, 0.8 * y),
            (0, 0),
            arrowprops={
                "arrowstyle": "-|>",
                "color": colour,
                "lw": 1.6,
                "shrinkA": 0,
                "shrinkB": 0,
                "mutation_scale": 7,
            },
        )
        length = np.hypot(x, y)
        ax.text(
            x * (0.8 + 0.22 / length),
            y * (0.8 + 0.22 / length),
            letter,
            color=colour,
            fontsize=8,
            ha="center",
            va="center",
        )
    ax.text(0, -1.42, name, ha="center", va="center", fontsize=7.5, color=INK)
    ax.set_xlim(-1.6, 1.6)
    ax.set_ylim(-1.6, 1.3)
    ax.set_aspect("equal")
    ax.set_axis_off()


def _write_marks(ax: Any, marks: Sequence[tuple[str, Sequence[int]]], points: Array) -> None:
    """Write the findings in a column, those of high places first, each with lines to its frames."""
    low, high = points.min(0), points.max(0)
    size = float((high - low).max())
    order = sorted(marks, key=lambda mark: -float(points[list(mark[1])][:, 1].mean()))
    x = high[0] + 0.3 * size
    heights = np.linspace(high[1] + 0.05 * size, low[1] - 0.05 * size, max(len(order), 2))
    for (label, frames), y in zip(order, heights, strict=False):
        for frame in frames:
            line = np.array([points[frame], (x - 0.02 * size, y)])
            ax.plot(*line.T, color=ORANGE, lw=0.8, zorder=5)
            ax.plot(*points[frame], "o", ms=10, mfc="none", mec=ORANGE, mew=1.4, zorder=5)
        ax.text(x, y, shorten(label, LONGEST_MARK), fontsize=7.5, va="center", color=INK)
