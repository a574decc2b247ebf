"""Every fitted parameter with its interval, how parameters hang together, the posterior of the
informative few."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..._typing import Array
from ...results.model_schema import CorrelationRecord, ParameterRecord, TraceRecord
from ..style import (
    AFTER,
    BLUE,
    GREY,
    INK,
    ORANGE,
    QUIET,
    WIDTH,
    choose_unit,
    shorten,
    svg,
    use_style,
)

MAX_FOREST = 64  # parameters of the forest plot
MAX_DRAWN = 6  # parameters of the posterior's picture
MAX_MATRIX = 48  # parameters of the correlation's picture
LONGEST_SYMBOL = 24  # letters
LONGEST_TITLE = 14  # letters
# half the width of a 95 % interval in standard errors
NORMAL_QUANTILE = 1.96
# |r| up to which no mark is drawn
MIN_CORRELATION = 0.1


# -- forest
# ---------------------------------------------------------------------------------------------------------------------


def draw_forest(parameters: Sequence[ParameterRecord]) -> bytes:
    """Draw estimates in units of their own standard error (a 95 % interval is 3.92 of them), strongest first: what
    lies inside the grey band may be zero."""
    scores = np.array([_standard_errors(parameter) for parameter in parameters])
    order = np.argsort(-np.abs(scores), kind="stable")[:MAX_FOREST]
    half = (len(order) + 1) // 2
    reach = float(abs(scores[order[0]])) * 1.6
    columns = [part for part in (order[:half], order[half:]) if len(part)]
    with use_style() as sheets:
        fig, axes = sheets.subplots(
            1,
            len(columns),
            figsize=(WIDTH, 0.135 * half + 0.6),
            layout="constrained",
            squeeze=False,
            sharex=True,
        )
        for ax, part in zip(axes[0], columns, strict=True):
            symbols = [parameters[index].symbol for index in part]
            ax.set_xscale("symlog", linthresh=4)
            _draw_intervals(ax, scores[part])
            _label_forest(ax, symbols, half, reach)
        return svg(fig, "Parameter significance")


def _standard_errors(parameter: ParameterRecord) -> float:
    """Return an estimate in units of its standard error, taken from its interval."""
    assert parameter.low is not None
    assert parameter.high is not None
    return 2 * NORMAL_QUANTILE * parameter.estimate / (parameter.high - parameter.low)


def _draw_intervals(ax: Any, scores: Array) -> None:
    rows = np.arange(len(scores))
    ax.axvspan(-NORMAL_QUANTILE, NORMAL_QUANTILE, color="#EFEFEF", lw=0)
    ax.axvline(0, color="#BBBBBB", lw=0.7)
    ax.hlines(rows, scores - NORMAL_QUANTILE, scores + NORMAL_QUANTILE, color=QUIET, lw=1)
    is_sure = np.abs(scores) > NORMAL_QUANTILE
    ax.plot(scores[is_sure], rows[is_sure], "o", ms=3.5, color=BLUE)
    ax.plot(scores[~is_sure], rows[~is_sure], "o", ms=3.5, mfc="white", mec=BLUE)


def _label_forest(ax: Any, symbols: Sequence[str], rows: int, reach: float) -> None:
    names = [shorten(symbol, LONGEST_SYMBOL) for symbol in symbols]
    ax.set_yticks(range(len(names)), names, fontsize=6.5, color=INK)
    ax.set_ylim(rows - 0.4, -0.6)
    ax.set_xlim(-reach, reach)
    ticks = [tick for tick in (1000, 100, 10) if tick < reach]
    ax.set_xticks([*(-tick for tick in ticks), 0, *reversed(ticks)])
    ax.xaxis.set_major_formatter(lambda value, _: f"{value:g}".replace("-", "−"))
    ax.xaxis.set_minor_formatter(lambda value, _: "")
    ax.tick_params(axis="y", length=0)
    ax.set_xlabel("estimate in standard errors")


# -- correlation
# ----------------------------------------------------------------------------------------------------------------


def draw_correlation(correlation: CorrelationRecord) -> bytes:
    """Draw the correlation matrix of the estimates, clusters first; size and shade grow with |r|, hollow where it is
    negative."""
    symbols = _order_symbols(correlation)
    matrix = _select_matrix(correlation, symbols)
    row, column = np.tril_indices(len(symbols), -1)
    r = np.nan_to_num(matrix[row, column])
    area = (230.0 / max(len(symbols), 6)) ** 2
    with use_style() as sheets:
        fig, ax = sheets.subplots(figsize=(WIDTH * 0.8, WIDTH * 0.75), layout="constrained")
        positive, negative = r > MIN_CORRELATION, r < -MIN_CORRELATION
        ax.scatter(
            column[positive],
            row[positive],
            s=area * r[positive],
            c=BLUE,
            linewidths=0,
            alpha=0.25 + 0.75 * r[positive],
        )
        ax.scatter(
            column[negative],
            row[negative],
            s=area * -r[negative],
            facecolors="none",
            edgecolors=ORANGE,
            linewidths=0.5 - r[negative],
        )
        _label_matrix(ax, symbols)
        return svg(fig, "Correlation of the estimates")


def _order_symbols(correlation: CorrelationRecord) -> list[str]:
    """Return the symbols to draw, those of clusters first."""
    clustered = [symbol for cluster in correlation.clusters for symbol in cluster]
    symbols = dict.fromkeys([*clustered, *correlation.symbols])
    return list(symbols)[:MAX_MATRIX]


def _select_matrix(correlation: CorrelationRecord, symbols: Sequence[str]) -> Array:
    """Return the correlations of some symbols, undefined ones as NaN."""
    place = {symbol: index for index, symbol in enumerate(correlation.symbols)}
    indices = [place[symbol] for symbol in symbols]
    matrix = np.array(correlation.matrix, dtype=float)
    return matrix[np.ix_(indices, indices)]


def _label_matrix(ax: Any, symbols: Sequence[str]) -> None:
    count = len(symbols)
    ax.set_xticks(range(count), symbols, rotation=90, fontsize=5.5)
    ax.set_yticks(range(count), symbols, fontsize=5.5)
    ax.set_xlim(-0.8, count - 0.2)
    ax.set_ylim(count - 0.2, -0.8)
    ax.tick_params(length=0)
    ax.spines[:].set_color(GREY)


# -- posterior
# ------------------------------------------------------------------------------------------------------------------


def draw_posterior(trace: TraceRecord, units: Mapping[str, str]) -> bytes:
    """Draw the informative few parameters pair by pair, with their distributions on the diagonal; `units` by name."""
    draws = np.array(trace.draws, dtype=float)[:, :MAX_DRAWN]
    names = trace.names[:MAX_DRAWN]
    scaled = [
        _scale_draws(name, units.get(name, "1"), draws[:, index])
        for index, name in enumerate(names)
    ]
    count = len(names)
    with use_style() as sheets:
        fig = sheets.figure(figsize=(WIDTH, WIDTH * 0.86), layout="constrained")
        grid = fig.add_gridspec(count, count)
        for row in range(count):
            for column in range(row + 1):
                ax = fig.add_subplot(grid[row, column])
                if column == row:
                    _draw_histogram(ax, *scaled[row])
                else:
                    _draw_pair(ax, scaled[column][1], scaled[row][1])
                _trim_axes(ax, is_bottom=row == count - 1, is_left=column == 0 and row > 0)
        return svg(fig, "Posterior")


def _scale_draws(name: str, unit: str, draws: Array) -> tuple[str, Array]:
    """Return a parameter's title with its unit, and its draws in that unit."""
    stem, slash, divisor = unit.partition("/")
    factor, shown = choose_unit(stem, float(np.abs(draws).max(initial=0)))
    whole = f"{shown}{slash}{divisor}"
    title = shorten(name, LONGEST_TITLE)
    return title if whole == "1" else f"{title}\n[{whole}]", factor * draws


def _draw_histogram(ax: Any, title: str, draws: Array) -> None:
    ax.hist(draws, bins=20, color=GREY, edgecolor=AFTER, linewidth=0.6)
    ax.set_title(title, fontsize=7, loc="center")
    ax.set_yticks([])


def _draw_pair(ax: Any, x: Array, y: Array) -> None:
    ax.plot(x, y, ".", ms=1.6, color=AFTER, alpha=0.6, mew=0)


def _trim_axes(ax: Any, *, is_bottom: bool, is_left: bool) -> None:
    """Leave labels at the bottom and the left of the picture alone."""
    ax.tick_params(labelsize=5, length=1.5, pad=1)
    ax.locator_params(nbins=3)
    ax.ticklabel_format(axis="both", style="plain", useOffset=False)
    if not is_bottom:
        ax.set_xticklabels([])
    if not is_left:
        ax.set_yticklabels([])
