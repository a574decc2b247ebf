"""What the chosen model leaves, against everything that it could still depend on: small multiples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..._typing import Array
from ...results.schemas.details_schema import DetailsRecord
from ..style import BLUE, INK, ORANGE, QUIET, WIDTH, choose_unit, svg, use_style
from .finding import average_bins

COLUMNS = 3
PANEL_HEIGHT = 1.2  # inch
COLOURS = (ORANGE, INK, BLUE)
MARKS = ("o", "s", "^")
# standard errors of a mean within which it is noise
BAND = 2.0
# rows of a mean
BIN_ROWS = 10
MAX_BINS = 10
# a variable that changes by less than this share of its size is a constant
SMALLEST_SPAN = 1e-9
LARGEST_MOVE = "last move, the largest of a joint"


@dataclass(frozen=True, eq=False)
class Driver:
    """What residuals are drawn against: its name with its unit, and its values at the drawn rows."""

    name: str
    values: Array


def list_drivers(details: DetailsRecord) -> list[Driver]:
    """List every joint, the order of motion, the last move and the temperature, as far as they are known and
    change."""
    rows = details.rows
    q = np.array(rows.q)
    drivers = []
    for index, joint in enumerate(details.joints):
        is_angle = joint.unit == "rad"
        values = np.degrees(q[:, index]) if is_angle else q[:, index]
        drivers.append(Driver(f"joint {index + 1} [{'°' if is_angle else 'mm'}]", values))
    is_angle = any(joint.unit == "rad" for joint in details.joints)
    if rows.progress is not None:
        drivers.append(Driver("order of motion [% of the campaign]", 100 * np.array(rows.progress)))
    if rows.move is not None:
        move = np.array(rows.move)
        shown = np.degrees(move) if is_angle else move
        drivers.append(Driver(f"{LARGEST_MOVE} [{'°' if is_angle else 'mm'}]", shown))
    if rows.temperature_C is not None:
        drivers.append(Driver("temperature [°C]", np.array(rows.temperature_C)))
    return [driver for driver in drivers if _changes(driver.values)]


def _changes(values: Array) -> bool:
    return bool(np.ptp(values) > SMALLEST_SPAN * max(np.abs(values).max(), 1.0))


def draw_residuals(details: DetailsRecord, drivers: Sequence[Driver]) -> bytes:
    """Draw the chosen model's residual components in the tracker's frame against every driver, with their
    means, and the band in which means of noise lie."""
    sound = ~np.array(details.rows.outlying, bool)
    residual = np.array(details.rungs[-1].residual_mm)[sound]
    spread = float(residual.std())
    factor, unit = choose_unit("mm", 3 * spread)
    lines = -(-len(drivers) // COLUMNS)
    with use_style() as sheets:
        fig, axes = sheets.subplots(
            lines,
            COLUMNS,
            figsize=(WIDTH, PANEL_HEIGHT * lines + 0.3),
            layout="constrained",
            squeeze=False,
            sharey=True,
        )
        for ax in axes.ravel()[len(drivers) :]:
            ax.set_axis_off()
        for ax, driver in zip(axes.ravel(), drivers, strict=False):
            _draw_panel(ax, driver.values[sound], factor * residual, factor * spread)
            ax.set_xlabel(driver.name, fontsize=7)
        for row in axes:
            row[0].set_ylabel(f"[{unit}]", fontsize=7)
        half = max(3.2 * spread, 1e-9) * factor
        axes[0, 0].set_ylim(-half, half)
        fig.legend(handles=_legend(), loc="outside lower center", ncols=4, fontsize=7)
        return svg(fig, "Residuals of the chosen model")


def _draw_panel(ax: Any, x: Array, residual: Array, spread: float) -> None:
    rows = min(max(len(x) // MAX_BINS, BIN_ROWS), len(x))
    half = BAND * spread / np.sqrt(rows)
    ax.axhspan(-half, half, color="#E9E9E9", lw=0, zorder=0)
    for component, (colour, mark) in enumerate(zip(COLOURS, MARKS, strict=True)):
        y = residual[:, component]
        ax.plot(x, y, ".", ms=1.6, color=QUIET, alpha=0.35, mew=0)
        at, mean = average_bins(x, y, np.ones(len(x)), MAX_BINS, BIN_ROWS)
        ax.plot(at, mean, mark, ms=2.6, color=colour, lw=0.8, ls="-", mew=0)
    ax.tick_params(labelsize=6.5, pad=1)


def _legend() -> list[Any]:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    lines = [
        Line2D([], [], color=colour, marker=mark, ms=3, lw=0.8, label=f"mean along {name}")
        for name, colour, mark in zip("xyz", COLOURS, MARKS, strict=True)
    ]
    return [*lines, Patch(color="#E9E9E9", label="where means of noise lie (95 %)")]
