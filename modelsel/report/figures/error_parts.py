"""What does not repeat: the share of every part in what is left, and how large it is at the target."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..._typing import Array
from ...results.repeatability.repeatability import compute_target_rms, describe_share, label_part
from ...results.schemas.schema import ErrorPartRecord
from ..style import BLUE, INK, QUIET, WIDTH, choose_unit, svg, use_style

# times the largest part up to which an interval is drawn
MAX_REACH = 3.0
BAR = 0.62


def draw_error_parts(parts: Sequence[ErrorPartRecord]) -> bytes:
    """Draw shares as bars, and beside them every part's rms at the target with its 95 % interval."""
    rows = np.arange(len(parts))
    size = (WIDTH, 0.25 * len(rows) + 0.65)
    with use_style() as sheets:
        fig, (left, right) = sheets.subplots(1, 2, figsize=size, layout="constrained", sharey=True)
        _draw_shares(left, parts)
        _draw_intervals_at_target(right, parts)
        left.set_yticks(rows, [label_part(part) for part in parts], color=INK)
        left.set_ylim(len(rows) - 0.4, -0.6)
        for ax in (left, right):
            ax.tick_params(axis="y", length=0)
            ax.spines["left"].set_visible(False)
        return svg(fig, "What does not repeat")


def _draw_shares(ax: Any, parts: Sequence[ErrorPartRecord]) -> None:
    for row, part in enumerate(parts):
        ax.barh(row, part.share, height=BAR, color=BLUE)
        words = describe_share(part.share)
        place = (part.share, row)
        ax.annotate(words, place, (4, 0), textcoords="offset points", va="center", fontsize=7.5)
    ax.set_xlim(0, 1.15)
    ax.set_xticks([0, 0.5, 1], ["0", "50%", "100%"])
    ax.set_xlabel("share of what is left")


def _draw_intervals_at_target(ax: Any, parts: Sequence[ErrorPartRecord]) -> None:
    rms, low, high = scale_intervals(parts)
    factor, unit = choose_unit("mm", float(rms.max()))
    rows = np.arange(len(parts))
    end = measure_axis(rms, high)
    shown = np.minimum(high, end)
    ax.hlines(rows, factor * low, factor * shown, color=QUIET, lw=1)
    ax.plot(factor * rms, rows, "o", ms=3.5, color=BLUE)
    is_cut = high > end
    ax.plot(factor * shown[is_cut], rows[is_cut], ">", ms=3.5, color=QUIET)
    ax.set_xlim(0, factor * 1.05 * end)
    ax.set_xlabel(f"at the target, with 95 % interval [{unit}]")


def scale_intervals(parts: Sequence[ErrorPartRecord]) -> tuple[Array, Array, Array]:
    """Return (rms at the target, low, high), (k,) each [mm]."""
    rms = compute_target_rms(parts)
    scale, low, high = np.array([(part.scale, part.low, part.high) for part in parts]).T
    return rms, rms * low / scale, rms * high / scale


def measure_axis(rms: Array, high: Array) -> float:
    """Return the length [mm] up to which intervals are drawn: hardly known ones are cut."""
    return float(min(high.max(), MAX_REACH * rms.max()))
