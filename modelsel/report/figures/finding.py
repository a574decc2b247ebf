"""One finding: the residual about its axis against its cause, before and after; who else it could
be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..._short_numbers import round_numbers
from ..._typing import Array, Index
from ...results.schemas.details_schema import PanelRecord
from ..style import (
    AFTER,
    BEFORE,
    BLUE,
    HALF_WIDTH,
    INK,
    ORANGE,
    choose_unit,
    shorten,
    svg,
    use_style,
)

MAX_TICKS = 5  # intervals between the numbers below a panel
MAX_BINS = 12
BIN_POINTS = 6  # of a bin, at least
ONE_HEIGHT, EACH_HEIGHT = 1.7, 1.25  # inch
LONGEST_AXIS = 40  # letters
# distinct values of a cause up to which they are drawn apart
FEW_VALUES = 6
# spreads points that share a value, evenly and without chance
GOLDEN_RATIO = 0.6180339887
# heights of the points up to which a panel shows the fitted effect whole
MAX_CURVE = 3.0
# of a panel's height, for residuals that are all zero
SMALLEST_HEIGHT = 1e-12


@dataclass(frozen=True, eq=False)
class _Panel:
    """A panel's numbers: x, the residual before and after with weights, the fitted curve; shown times `factor`, in
    `unit`."""

    record: PanelRecord
    x: Array
    before: Array
    after: Array
    weight: Array
    curve_x: Array
    curve: Array
    unit: str


def name_axis(panel: PanelRecord) -> str:
    """Return what turns or shifts, in words."""
    if not panel.frames:
        return "displacement along the effect"
    frames = " and ".join(str(frame) for frame in panel.frames[:3])
    motion = "turn about" if panel.axis[0] == "r" else "shift along"
    return f"{motion} {panel.axis[1]} of frame {frames}"


def draw_panels(panels: Sequence[PanelRecord]) -> bytes:
    """Draw up to three panels, one above the other: grey, what the model without the effect leaves; blue, with
    it; orange, the fitted effect."""
    count = len(panels)
    height = ONE_HEIGHT if count == 1 else count * EACH_HEIGHT
    with use_style() as sheets:
        fig, axes = sheets.subplots(
            count, 1, figsize=(HALF_WIDTH, height), layout="constrained", squeeze=False
        )
        for ax, record in zip(axes[:, 0], panels, strict=True):
            panel = _scale_panel(record)
            _draw_points(ax, panel)
            _draw_curve(ax, panel)
            _draw_means(ax, panel)
            _label_panel(ax, panel)
        return svg(fig, "Residual against cause")


def _scale_panel(record: PanelRecord) -> _Panel:
    """Return a panel's numbers in the unit that reads well."""
    before, after = np.array(record.before), np.array(record.after)
    largest = float(np.percentile(np.abs(np.concatenate([before, after])), 99))
    factor, unit = choose_unit(record.unit, largest)
    curve_x, curve = (np.array(values) for values in record.curve)
    return _Panel(
        record,
        np.array(record.x),
        factor * before,
        factor * after,
        np.array(record.weight),
        curve_x,
        factor * curve,
        unit,
    )


def _has_few_values(x: Array) -> bool:
    return len(np.unique(x)) <= FEW_VALUES


def _draw_points(ax: Any, panel: _Panel) -> None:
    """Draw the residuals, larger where their lever is; points that share a value beside each other."""
    x = panel.x
    if _has_few_values(x):
        offset = np.arange(len(x)) * GOLDEN_RATIO % 1 - 0.5
        x = x + 0.05 * np.ptp(x) * offset
    ax.axhline(0, color="#BBBBBB", lw=0.7)
    ax.scatter(
        x,
        panel.before,
        s=3 + 8 * panel.weight,
        marker="s",
        facecolors="none",
        edgecolors=BEFORE,
        linewidths=0.5,
        alpha=0.7,
    )
    ax.scatter(
        x, panel.after, s=2 + 6 * panel.weight, marker="o", color=AFTER, linewidths=0, alpha=0.45
    )


def _draw_curve(ax: Any, panel: _Panel) -> None:
    """Draw the fitted effect; of a step each side alone."""
    if panel.record.kind != "step":
        ax.plot(panel.curve_x, panel.curve, color=ORANGE, lw=1.6)
        return
    for side in (-1, 1):
        part = np.sign(panel.curve_x) == side
        ax.plot(panel.curve_x[part], panel.curve[part], color=ORANGE, lw=1.6)


def _draw_means(ax: Any, panel: _Panel) -> None:
    """Draw what the eye should follow."""
    average = average_sides if panel.record.kind == "step" else average_bins
    for residual, colour, mark in ((panel.before, INK, "s"), (panel.after, BLUE, "o")):
        x, mean = average(panel.x, residual, panel.weight)
        ax.plot(x, mean, mark, ms=4.5, mfc="white", mec=colour, mew=1.1, zorder=4)


def average_bins(
    x: Array, y: Array, weight: Array, most: int = MAX_BINS, least_points: int = BIN_POINTS
) -> tuple[Array, Array]:
    """Return weighted means in at most so many bins of equally many points, each of `least_points` at least, or at
    each value where there are few."""
    values = np.unique(x)
    if len(values) <= FEW_VALUES:
        least = min(least_points, len(x))
        parts = [np.flatnonzero(x == value) for value in values]
        parts = [part for part in parts if len(part) >= least]
    else:
        bins = min(most, max(len(x) // least_points, 1))
        parts = np.array_split(np.argsort(x, kind="stable"), bins)
        parts = [part for part in parts if len(part)]
    return _weighted_means(x, parts, weight), _weighted_means(y, parts, weight)


def _weighted_means(values: Array, parts: Sequence[Index], weight: Array) -> Array:
    return np.array([float(np.average(values[part], weights=weight[part])) for part in parts])


def average_sides(x: Array, y: Array, weight: Array) -> tuple[Array, Array]:
    """Return means on either side of zero, drawn where the points lie."""
    sides = [np.flatnonzero(side) for side in (x < 0, x > 0)]
    sides = [side for side in sides if len(side)]
    places = np.array([x[side].mean() for side in sides])
    return places, _weighted_means(y, sides, weight)


def panel_height(points: Array, curve: Array, most: float = MAX_CURVE) -> float:
    """Return up to where a panel is drawn: nearly all points, and the fitted effect whole unless it is `most` times
    as high."""
    nearly_all = np.percentile(np.abs(points), 98)
    usual = 1.15 * float(nearly_all)
    largest = np.abs(curve).max(initial=0.0)
    whole = 1.05 * float(largest)
    return max(usual, min(whole, most * usual), SMALLEST_HEIGHT)


def _label_panel(ax: Any, panel: _Panel) -> None:
    record = panel.record
    # where a cause has few values, or a curve jumps, few points may stand beyond
    is_whole = _has_few_values(panel.x) or record.kind == "curve"
    most = np.inf if is_whole else MAX_CURVE
    top = panel_height(np.concatenate([panel.before, panel.after]), panel.curve, most)
    ax.set_ylim(-top, top)
    unit = "°" if record.against_unit == "deg" else record.against_unit
    bracket = "" if unit == "1" else f" [{unit}]"
    ax.set_xlabel(f"{shorten(round_numbers(record.against), LONGEST_AXIS)}{bracket}")
    ax.locator_params(axis="x", nbins=MAX_TICKS)
    title = f"{name_axis(record)} [{panel.unit}]"
    ax.set_title(title, fontsize=7, fontweight="normal", color=INK)
