"""The style of every picture: colours that colour-blind readers and grey printers tell apart, one
typeface, the same bytes twice."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from ..diagnosis.findings.sentences import choose_prefix

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Okabe & Ito 2008
BLUE = "#0072B2"
ORANGE = "#D55E00"
GREY = "#D9D9D9"
INK = "#222222"
QUIET = "#6B6B6B"
BEFORE = "#8C8C8C"
AFTER = BLUE
RING = ORANGE
# inch: the text width of the page
WIDTH = 6.5
# inch: that of a column, where there are two
HALF_WIDTH = 3.15
# share of a shortened text that ends between two words
MIN_KEPT = 0.7
STYLE: dict[Any, Any] = {
    "svg.hashsalt": "modelsel",
    "svg.fonttype": "none",
    "font.family": "DejaVu Sans",
    "font.size": 8,
    "text.color": INK,
    "axes.labelcolor": INK,
    "xtick.color": QUIET,
    "ytick.color": QUIET,
    "axes.edgecolor": "#9A9A9A",
    "axes.linewidth": 0.6,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "axes.titlesize": 8,
    "axes.titlelocation": "left",
    "axes.titleweight": "bold",
    "legend.frameon": False,
    "legend.fontsize": 7.5,
    "grid.color": "#EBEBEB",
    "grid.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "figure.dpi": 72,
    "mathtext.default": "regular",
    "text.parse_math": False,  # a $ in a name is a $
    "axes.unicode_minus": True,
    "path.simplify": True,
    "savefig.pad_inches": 0.02,
}


class Sheets:
    """What pyplot offers, without its state: a notebook's backend and open figures stay as they
    are."""

    def figure(self, **options: Any) -> Any:
        """A matplotlib Figure that no session knows."""
        from matplotlib.figure import Figure

        return Figure(**options)

    def subplots(
        self,
        rows: int = 1,
        columns: int = 1,
        *,
        figsize: tuple[float, float],
        layout: str,
        **axes: Any,
    ) -> Any:
        """(figure, axes) as of pyplot's subplots."""
        figure = self.figure(figsize=figsize, layout=layout)
        return figure, figure.subplots(rows, columns, **axes)


@contextmanager
def use_style() -> Iterator[Sheets]:
    """Draw figures in the reports' style, whatever the session's own."""
    import matplotlib as mpl

    defaults: dict[Any, Any] = {
        key: value for key, value in mpl.rcParamsDefault.items() if key != "backend"
    }
    with mpl.rc_context({**defaults, **STYLE}):
        yield Sheets()


def svg(figure: Figure, title: str) -> bytes:
    """Return the figure as SVG, text as text, no date."""
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    stream = io.BytesIO()
    metadata = {"Date": None, "Creator": None, "Title": title}
    # not savefig, which draws twice: once to lay out, though drawing lays out by itself
    canvas: Any = FigureCanvasSVG(figure)
    canvas.print_svg(stream, metadata=metadata)
    return stream.getvalue()


def choose_unit(unit: str, largest: float) -> tuple[float, str]:
    """Return (factor, shown unit) so that the largest value reads well: rad as in sentences, mm -> mm or µm."""
    if unit == "rad":
        divisor, shown = choose_prefix(largest, unit)
        return 1 / divisor, shown
    if unit == "mm" and largest < 0.5:
        return 1e3, "µm"
    return 1.0, unit


def shorten(text: str, longest: int) -> str:
    """Return a text cut to a length, with an ellipsis; between words where that leaves most of it."""
    if len(text) <= longest:
        return text
    kept = text[: longest - 1]
    words, _, _ = text[:longest].rpartition(" ")
    if len(words) > MIN_KEPT * longest:
        kept = words
    return kept.rstrip(" ·&,;:") + "…"


def shorten_clause(sentence: str, longest: int) -> str:
    """Return a sentence, or where it is longer than that the clause it begins with."""
    if len(sentence) <= longest:
        return sentence
    clause, _, _ = sentence.partition(": ")
    return shorten(clause, longest)
