"""How parameters hang together, and the posterior of the informative few."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..._typing import Array
from ...results.schemas.model_schema import CorrelationRecord, TraceRecord
from ...results.sentences.parameter_table import number_owners
from ..style import AFTER, BLUE, GREY, HALF_WIDTH, ORANGE, shorten, svg, use_style

MAX_DRAWN = 5  # parameters of the posterior's picture
MAX_MATRIX = 32  # parameters of the correlation's picture
HEIGHT = 2.75  # inch
LONGEST_TITLE = 14  # letters
LETTER_SHARE = 0.09  # of a panel's width, that a letter of a tick's label needs
LONGEST_LABEL = 10  # letters beside the matrix
LABEL_COLUMN = 140.0  # points that the labels of a matrix share
# |r| up to which no mark is drawn
MIN_CORRELATION = 0.1


# -- correlation
# ----------------------------------------------------------------------------------------------------------------


def draw_correlation(correlation: CorrelationRecord) -> bytes:
    """Draw the correlation matrix of the estimates, clusters first; size and shade grow with |r|, hollow where it is
    negative."""
    symbols = order_symbols(correlation)
    matrix = _select_matrix(correlation, symbols)
    row, column = np.tril_indices(len(symbols), -1)
    r = np.nan_to_num(matrix[row, column])
    area = (112.0 / max(len(symbols), 6)) ** 2
    with use_style() as sheets:
        fig, ax = sheets.subplots(figsize=(HALF_WIDTH, HEIGHT), layout="constrained")
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


def order_symbols(correlation: CorrelationRecord) -> list[str]:
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
    numbered, _ = number_owners(symbols)
    labels = [shorten(label, LONGEST_LABEL) for label in numbered]
    size = min(5.2, LABEL_COLUMN / count)
    ax.set_xticks(range(count), labels, rotation=90, fontsize=size)
    ax.set_yticks(range(count), labels, fontsize=size)
    ax.set_xlim(-0.8, count - 0.2)
    ax.set_ylim(count - 0.2, -0.8)
    ax.tick_params(length=0)
    ax.spines[:].set_color(GREY)


# -- posterior
# ------------------------------------------------------------------------------------------------------------------


def draw_posterior(trace: TraceRecord, units: Mapping[str, tuple[float, str]]) -> bytes:
    """Draw the informative few parameters pair by pair, with their distributions on the diagonal; `units`:
    by name, what the values are divided by, and the unit then."""
    draws = np.array(trace.draws, dtype=float)[:, :MAX_DRAWN]
    names = trace.names[:MAX_DRAWN]
    labels, _ = number_owners(names)
    scaled = []
    for index, (name, label) in enumerate(zip(names, labels, strict=True)):
        factor, unit = units.get(name, (1.0, ""))
        scaled.append((_title_draws(label, unit), draws[:, index] / factor))
    count = len(names)
    with use_style() as sheets:
        fig = sheets.figure(figsize=(HALF_WIDTH, HEIGHT), layout="constrained")
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


def _title_draws(name: str, unit: str) -> str:
    """Return a parameter's title with its unit below it."""
    title = shorten(name, LONGEST_TITLE)
    return f"{title}\n[{unit}]" if unit else title


def choose_few_ticks(low: float, high: float) -> tuple[list[float], list[str]]:
    """Choose one or two round ticks within an axis, and their labels: two only where both have room."""
    from matplotlib.ticker import MaxNLocator

    ticks = [float(tick) for tick in MaxNLocator(2).tick_values(low, high) if low <= tick <= high]
    step = ticks[1] - ticks[0] if len(ticks) > 1 else high - low
    decimals = max(0, -int(np.floor(np.log10(step) + 1e-9))) if step > 0 else 0
    labels = [f"{tick:.{decimals}f}".replace("-", "−") for tick in ticks]
    if len(ticks) > 1 and max(map(len, labels)) * LETTER_SHARE > step / (high - low):
        middle = len(ticks) // 2
        return [ticks[middle]], [labels[middle]]
    return ticks, labels


def _draw_histogram(ax: Any, title: str, draws: Array) -> None:
    ax.hist(draws, bins=20, color=GREY, edgecolor=AFTER, linewidth=0.6)
    ax.set_title(title, fontsize=5.5, loc="center")
    ax.set_yticks([])


def _draw_pair(ax: Any, x: Array, y: Array) -> None:
    ax.plot(x, y, ".", ms=1.6, color=AFTER, alpha=0.6, mew=0)


def _trim_axes(ax: Any, *, is_bottom: bool, is_left: bool) -> None:
    """Leave labels at the bottom and the left of the picture alone."""
    ax.tick_params(labelsize=4.5, length=1.5, pad=1)
    ticks, labels = choose_few_ticks(*ax.get_xlim())
    ax.set_xticks(ticks, labels if is_bottom else [""] * len(ticks))
    if is_left:
        ax.set_yticks(*choose_few_ticks(*ax.get_ylim()))
    else:
        ax.set_yticks([])
