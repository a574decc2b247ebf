"""The calibrated parameters: a drawing that gives the symbols their meaning, the table, and how
significant every mechanism is."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from ...results.schemas.model_schema import SignificanceRecord
from ...results.sentences.parameter_table import (
    PARAMETER_COLUMNS,
    ParameterRow,
    count_free,
    tabulate_calibrated,
)
from ...results.sentences.study_sentences import (
    NOMINAL_CAVEAT,
    format_mm,
    format_motion,
    format_p,
    format_share,
)
from ..document import Block, Source, make_heading, make_list, make_table
from ..figures.arm import draw_frames

MAX_SUMMARY_ROWS = 52
EXPECTED = "as expected"  # what the catalogue says of a mechanism that is not odd
SYMBOLS = (
    "The nominal arm at one measured configuration. a b c: shifts along x y z of the frame whose number follows; α β γ: "
    "turns about them, before the joint moves (dashed: its axis, z)."
)
TITLE = "Calibrated parameters"
TABLE = (
    "Nominal: the drawing's value, of a shift from the frame before along the frame's own axes{registered}; 0 where the "
    "number is a correction. U: expanded uncertainty, twice the standard uncertainty, which is the larger of least squares' and the "
    "bootstrap's standard error and stands behind ± in the findings, too. p: how probable so large a deviation is where "
    "there is none. Moves: the target, at most, over the measured configurations."
)
REGISTERED = "; of the target, where registration found it on the nominal robot"
TOGETHER = (
    " *: known only together with others (see What the data cannot tell); its usual size decides."
)
WIDTHS = [0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]


def write_parameters_page(source: Source, most: int | None = None) -> list[Block]:
    """Write drawing and table, of `most` rows at most; nothing where nothing was fitted."""
    rows = tabulate_calibrated(source.record, source.details)
    if not rows:
        return []
    heading = make_heading(TITLE, opens=True)
    drawing = write_frames_figure(source)
    table = _write_table(source, rows, most)
    return [heading, *drawing, table]


def write_parameters_summary(source: Source) -> list[Block]:
    """Write drawing and table on one page: of more parameters than it has room for, those that move the target
    most."""
    return write_parameters_page(source, MAX_SUMMARY_ROWS)


def write_significance_page(source: Source) -> list[Block]:
    """Write the significance of every mechanism; nothing where it was not computed."""
    mechanisms = source.record.significance
    return _write_mechanisms(mechanisms) if mechanisms else []


def write_frames_figure(source: Source) -> list[Block]:
    """Write the drawing of this arm; nothing where the files of an earlier version have none."""
    arm = source.details.arm
    if arm is None:
        return []
    joints = len(arm.slides)
    words = (
        f"Drawing of the arm with its {joints} joint frames and the target's, and the axes x, y and z of each frame as seen "
        "in the drawing."
    )
    return [source.add_figure("frames", partial(draw_frames, arm), SYMBOLS, words)]


def _write_table(source: Source, rows: Sequence[ParameterRow], most: int | None) -> Block:
    shown = _select_rows(rows, most)
    caption = caption_parameters(source, shown)
    if len(shown) < len(rows):
        caption += f" {len(rows) - len(shown)} more, which move the target less, are in report.pdf."
    cells = [row.cells for row in shown]
    return make_table(PARAMETER_COLUMNS, cells, caption, WIDTHS) | {"dense": True}


def caption_parameters(source: Source, rows: Sequence[ParameterRow]) -> str:
    """Describe what the columns of the table mean, and what it leaves out."""
    is_registered = source.record.registration is not None
    caption = TABLE.format(registered=REGISTERED if is_registered else "")
    if any(row.together for row in rows):
        caption += TOGETHER
    free = count_free(source.record, source.details)
    if free:
        caption += f" The {free} coefficients of free functions are in result.json: none says anything alone."
    return caption


def _select_rows(rows: Sequence[ParameterRow], most: int | None) -> Sequence[ParameterRow]:
    """Return the rows that move the target most, in their order; all without a limit."""
    if most is None or len(rows) <= most:
        return rows
    strongest = sorted(range(len(rows)), key=lambda k: -rows[k].max_mm)[:most]
    return [rows[k] for k in sorted(strongest)]


# -- by mechanism
# --------------------------------------------------------------------------------------------------


def _write_mechanisms(mechanisms: Sequence[SignificanceRecord]) -> list[Block]:
    """Write the table by mechanism, without columns that a long run leaves empty, and what the catalogue finds
    odd."""
    figures = _significance_columns(mechanisms)
    names = [one.label for one in mechanisms]
    columns = [("mechanism", "left"), *((name, "right") for name in figures)]
    rows = list(zip(names, *figures.values(), strict=True))
    caption = (
        "Mean and worst displacement of the target by each mechanism, over the measured configurations. Held-out: rms "
        "without it and with it."
    )
    if any("mrad" in figure for figure in figures["worst mm"]):
        caption += " Of what only turns the target, how far it turns it."
    if "stable" in figures:
        caption += " Stable: share of half-samples in which it stays significant."
    if {"nominal p", "stable"} & set(figures):
        caption += f" Nominal p and stable {NOMINAL_CAVEAT}"
    blocks = [
        make_heading("Significance by mechanism"),
        make_table(columns, rows, caption, [1.0, *[0.0] * len(figures)]),
    ]
    odd = [f"{one.label}: {one.catalogue}" for one in mechanisms if one.catalogue != EXPECTED]
    return [*blocks, make_list(odd)] if odd else blocks


def _significance_columns(mechanisms: Sequence[SignificanceRecord]) -> dict[str, list[str]]:
    """Return the figures of every mechanism by column, without columns of dashes alone."""
    held_out_rms = [
        f"{format_mm(one.held_out_rms_without_mm)} → {format_mm(one.held_out_rms_mm)}"
        for one in mechanisms
    ]
    columns = {
        "mean mm": [format_motion(one.mean_mm, one.mean_mrad) for one in mechanisms],
        "worst mm": [format_motion(one.max_mm, one.max_mrad) for one in mechanisms],
        "nominal p": [format_p(one.p) for one in mechanisms],
        "log10 evidence": [_signed(one.log10_evidence) for one in mechanisms],
        "held-out rms mm": held_out_rms,
        "stable": [format_share(one.stability) for one in mechanisms],
    }
    dashes_alone = {"–"}
    return {name: column for name, column in columns.items() if set(column) != dashes_alone}


def _signed(value: float | None) -> str:
    return "–" if value is None else f"{value:+.1f}".replace("-", "−")
