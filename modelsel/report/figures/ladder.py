"""The ladder of models against the noise floor, and what each rung leaves on held-out
configurations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..._typing import Array, Index
from ...results.numbers.quantities import format_figure
from ...results.schemas.details_schema import DetailsRecord
from ...results.schemas.model_schema import RungRecord
from ...results.schemas.schema import NoiseFloorRecord, StudyRecord
from ...results.sentences.tables import label_models
from ..style import (
    AFTER,
    BLUE,
    GREY,
    HALF_WIDTH,
    INK,
    ORANGE,
    QUIET,
    WIDTH,
    shorten,
    svg,
    use_style,
)

MAX_RUNGS = 18  # that the ladder's picture can hold
MAX_CURVES = 6  # that the picture of the errors can hold
LONGEST_NAME = 44  # letters
LONGEST_LEGEND = 26  # letters
# rungs up to which the noise's name stands upright beside the first of them
FEW_RUNGS = 4
# of the axis that the zone of noise has at least, as wide as its name
NOISE_SHARE = 0.22
# mm: a smaller error is drawn there, a logarithm has no zero
SMALLEST_ERROR = 1e-4
# what the zone of noise is called, by the source of the noise floor; noise alone by any other
ZONE_NAMES = {
    "stated": "stated noise",
    "instrument": "stated noise",
    "estimated": "what seems\nnot to repeat",
}
LINE_STYLES = ("-", "--", "-.", ":", (0, (5, 1)), "-")


def select_way(record: StudyRecord) -> list[int]:
    """Return the indices of the nominal model and of the rungs whose mechanisms the chosen model begins with."""
    chosen = record.ladder[-1].mechanisms
    last = len(record.ladder) - 1
    return [
        index
        for index, rung in enumerate(record.ladder)
        if index == last or _leads_to(rung.mechanisms, chosen)
    ]


def _leads_to(names: list[str], chosen: list[str]) -> bool:
    return names == ["nominal"] or names == chosen[: len(names)]


def label_way(record: StudyRecord, rungs: Sequence[int]) -> list[str]:
    """Return what each of some rungs adds to the one before it, or all of it."""
    return label_models([record.ladder[rung].mechanisms for rung in rungs])


# -- the ladder
# -------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Scale:
    """The ladder's errors [mm] by row: on estimation configurations, and those that count; what noise alone would
    leave, and its name; the ends of the axis."""

    estimation: Array
    shown: Array
    is_held_out: bool
    noise: float
    zone: str
    low: float
    high: float

    @property
    def rows(self) -> Index:
        """One row per rung."""
        return np.arange(len(self.shown))


def choose_ticks(low: float, high: float) -> list[float]:
    """Choose the ticks of a logarithmic axis: powers of ten, and 2 and 5 times these where it is short."""
    decades = np.log10(high / low)
    factors = (1, 2, 5) if decades < 2 else (1,)
    powers = 10.0 ** np.arange(-6, 5)
    ticks = np.outer(powers, factors)
    return [float(tick) for tick in ticks.ravel() if low <= tick <= high]


def draw_ladder(record: StudyRecord) -> bytes:
    """Draw the rms length of the residual vectors, estimation and held-out, a row per rung; grey: what noise alone
    would leave."""
    way = select_way(record)
    if len(way) > MAX_RUNGS:
        # the nominal model and the base stay
        way = [*way[:2], *way[2 - MAX_RUNGS :]]
    scale = _scale([record.ladder[rung] for rung in way], record.noise_floor)
    height = min(0.19 * len(way) + 0.86, 2.94)
    with use_style() as sheets:
        fig, ax = sheets.subplots(figsize=(WIDTH, height), layout="constrained")
        ax.set_xscale("log")
        ax.set_xlim(scale.low, scale.high)
        _draw_noise(ax, scale)
        _draw_rungs(ax, scale)
        _label_ladder(ax, scale, label_way(record, way))
        # above the rungs, where it covers none of their figures
        fig.legend(loc="outside upper right", ncols=2, fontsize=7)
        return svg(fig, f"Ladder of models: {record.study}")


def _scale(rungs: Sequence[RungRecord], floor: NoiseFloorRecord) -> _Scale:
    estimation = np.array([rung.estimation.rms_mm for rung in rungs], dtype=float)
    held_out = np.array([rung.held_out.rms_mm for rung in rungs], dtype=float)
    is_held_out = bool(np.isfinite(held_out).any())
    noise = _rms_noise(floor)
    errors = np.concatenate([estimation, held_out, [noise]])
    high = np.nanmax(errors) * 2.2
    # the zone of noise has room for its words
    zone = (high / noise) ** (NOISE_SHARE / (1 - NOISE_SHARE)) if noise > 0 else 1.0
    lowest = min(np.nanmin(errors) / 1.7, noise / max(zone, 3.2))
    low = max(lowest, 1e-9)
    shown = held_out if is_held_out else estimation
    name = ZONE_NAMES.get(floor.source, "noise alone")
    return _Scale(estimation, shown, is_held_out, noise, name, float(low), float(high))


def _rms_noise(floor: NoiseFloorRecord) -> float:
    """Return the rms length [mm] of a row's noise: of three coordinates, unless the file says what its rows have."""
    if floor.rms_mm is not None:
        return floor.rms_mm
    return floor.coordinate_mm * float(np.sqrt(3))


def _draw_noise(ax: Any, scale: _Scale) -> None:
    """Draw the zone where nothing is left but noise, or what does not repeat."""
    rungs = len(scale.rows)
    is_tall = rungs > FEW_RUNGS
    ax.axvspan(scale.low, scale.noise, color="#EFEFEF", lw=0)
    ax.axvline(scale.noise, color="#9A9A9A", lw=0.8)
    ax.text(
        np.sqrt(scale.low * scale.noise),
        # above the last rung, whose marks may stand in the zone
        rungs / 2 - 0.5 if is_tall else max(rungs / 2 - 1, 0.0),
        f"{scale.zone}\n{format_figure(scale.noise)} mm",
        rotation=90 if is_tall else 0,
        ha="center",
        va="center",
        fontsize=7,
        color=QUIET,
    )


def _draw_rungs(ax: Any, scale: _Scale) -> None:
    """Draw the errors of every rung."""
    rows = scale.rows
    ax.hlines(rows, scale.noise, scale.shown, color=GREY, lw=1, zorder=1)
    label = "estimation configurations"
    ax.plot(scale.estimation, rows, "s", ms=5.5, mfc="none", mec=ORANGE, mew=1.2, label=label)
    if scale.is_held_out:
        ax.plot(scale.shown, rows, "o", ms=4.5, color=AFTER, label="held-out configurations")
    for row, shown in enumerate(scale.shown):
        figure = format_figure(shown) if np.isfinite(shown) else "–"
        ax.annotate(
            figure,
            (np.nanmax([scale.estimation[row], shown]), row),
            (6, 0),
            textcoords="offset points",
            va="center",
            fontsize=7.5,
            color=BLUE,
            fontweight="bold" if row == len(rows) - 1 else "normal",
        )


def _label_ladder(ax: Any, scale: _Scale, labels: Sequence[str]) -> None:
    rungs = len(labels)
    ax.set_yticks(scale.rows, [shorten(label, LONGEST_NAME) for label in labels], color=INK)
    ax.set_ylim(rungs - 0.5, -0.6)
    ax.set_xticks(choose_ticks(scale.low, scale.high))
    ax.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    ax.xaxis.set_minor_formatter(lambda value, _: "")
    ax.set_xlabel("rms position error [mm], logarithmic")
    ax.tick_params(axis="y", length=0)
    ax.spines["left"].set_visible(False)


# -- the distribution of the errors
# -----------------------------------------------------------------------------------------------


def draw_error_distribution(record: StudyRecord, details: DetailsRecord) -> bytes:
    """Draw the share of configurations whose error stays below a length, a curve per rung of the way."""
    rows = select_rows(details)
    way = select_way(record)
    labels = dict(zip(way, label_way(record, way), strict=True))
    drawn = _thin_way(way)
    with use_style() as sheets:
        fig, ax = sheets.subplots(figsize=(HALF_WIDTH, 2.1), layout="constrained")
        for number, rung in enumerate(drawn):
            residual = np.array(details.rungs[rung].residual_mm)[rows]
            _draw_distribution(ax, residual, labels[rung], number, rung == drawn[-1])
        ax.set_xscale("log")
        low, high = ax.get_xlim()
        ax.set_xticks(choose_ticks(low, high))
        ax.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
        ax.xaxis.set_minor_formatter(lambda value, _: "")
        ax.set_ylim(0, 1.01)
        ax.yaxis.set_major_formatter(lambda value, _: f"{value:.0%}")
        ax.set_xlabel("position error [mm], logarithmic")
        ax.set_ylabel("share below it")
        ax.grid(True)
        fig.legend(loc="outside lower center", ncols=2, fontsize=6.5)
        return svg(fig, "Distribution of held-out errors")


def select_rows(details: DetailsRecord) -> Array:
    """Return which drawn rows count: held-out ones, where there are any, without outliers."""
    estimation = np.array(details.rows.estimation, bool)
    sound = ~np.array(details.rows.outlying, bool)
    held_out = ~estimation & sound
    return held_out if held_out.any() else sound


def _thin_way(way: list[int]) -> list[int]:
    """Return at most MAX_CURVES rungs, evenly spread, the first and the last among them."""
    if len(way) <= MAX_CURVES:
        return way
    return [way[round(place)] for place in np.linspace(0, len(way) - 1, MAX_CURVES)]


def _draw_distribution(ax: Any, residual: Array, label: str, number: int, is_last: bool) -> None:
    import matplotlib as mpl

    size = np.sort(np.linalg.norm(residual, axis=1))
    share = np.arange(1, len(size) + 1) / len(size)
    grey = mpl.colormaps["Greys"](0.45 + 0.08 * number)
    ax.step(
        np.maximum(size, SMALLEST_ERROR),
        share,
        where="post",
        lw=1.8 if is_last else 1.1,
        ls=LINE_STYLES[number],
        color=BLUE if is_last else grey,
        label=shorten(label, LONGEST_LEGEND),
    )
