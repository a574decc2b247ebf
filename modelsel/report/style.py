"""One look for every picture: colours that colour-blind readers and grey printers tell apart, one
type, the same bytes twice."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BLUE, ORANGE, GREY, INK, QUIET = (
    "#0072B2",
    "#D55E00",
    "#D9D9D9",
    "#222222",
    "#6B6B6B",
)  # Okabe & Ito 2008
BEFORE, AFTER, RING = "#8C8C8C", BLUE, ORANGE
WIDTH = 6.5  # inch: the text width of the page
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
def styled() -> Iterator[Sheets]:
    """Figures under the house's style, whatever the session's own."""
    import matplotlib as mpl

    plain: dict[Any, Any] = {
        key: value for key, value in mpl.rcParamsDefault.items() if key != "backend"
    }
    with mpl.rc_context({**plain, **STYLE}):
        yield Sheets()


def svg(figure: Figure, title: str) -> bytes:
    """The figure as SVG, text as text, no date."""
    stream = io.BytesIO()
    figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": None, "Title": title})
    return stream.getvalue()


def scaled(unit: str, biggest: float) -> tuple[float, str]:
    """(factor, shown unit) so that the largest value reads well: rad -> mrad or µrad, mm -> mm or
    µm."""
    if unit == "rad":
        return (
            (1e6, "µrad") if biggest < 1.5e-3 else (1e3, "mrad") if biggest < 1.5 else (1.0, "rad")
        )
    return (1e3, "µm") if unit == "mm" and biggest < 0.5 else (1.0, unit)


def shortened(text: str, most: int) -> str:
    """A name cut to a length, with an ellipsis."""
    return text if len(text) <= most else text[: most - 1].rstrip(" ·&") + "…"
