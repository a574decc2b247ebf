"""What does not repeat: the parts of what the chosen model leaves, in words, a picture and a table."""

from __future__ import annotations

from functools import partial

from ...results.repeatability.repeatability import (
    compute_target_rms,
    describe_share,
    format_scale,
    label_part,
    round_digits,
)
from ...results.schemas.schema import ErrorPartRecord
from ..document import Block, Source, make_heading, make_list, make_table, make_text
from ..figures.error_parts import draw_error_parts

TITLE = "What does not repeat"
EXPLANATION = (
    "What the chosen model leaves, split into independent parts by which rows share them. None of them is a finding: no "
    "calibration removes what does not repeat."
)
COLUMNS = ("part", "standard deviation", "95 % interval", "at the target", "share")
SHARES = (
    "Standard deviations are those of a joint's position, or of one coordinate; at the target: rms length there. "
    "Shares are of the mean square, and add up."
)


def write_repeatability_page(source: Source) -> list[Block]:
    """Write the parts of what is left; one sentence where the instrument stands alone, nothing where
    none was looked for."""
    parts = source.record.repeatability
    if not parts:
        return []
    heading = make_heading(TITLE)
    if len(parts) == 1:
        return [heading, make_text(parts[0].sentence)]
    words = "; ".join(f"{label_part(part)} {describe_share(part.share)}" for part in parts)
    caption = (
        "Left: the share of every part in the mean square that is left at the target. Right: its rms length there, with the "
        "95 % interval of its standard deviation."
    )
    draw = partial(draw_error_parts, parts)
    return [
        heading,
        make_text(EXPLANATION),
        make_list([part.sentence for part in parts]),
        source.add_figure("repeatability", draw, caption, f"Shares of what is left: {words}."),
        _write_parts(parts),
    ]


def _write_parts(parts: list[ErrorPartRecord]) -> Block:
    columns = [(name, "left" if name == "part" else "right") for name in COLUMNS]
    return make_table(columns, tabulate_parts(parts), SHARES)


def tabulate_parts(parts: list[ErrorPartRecord]) -> list[list[str]]:
    """Return a row of text for every part, as COLUMNS name them."""
    rows = []
    for part, rms in zip(parts, compute_target_rms(parts), strict=True):
        scale, interval = format_scale(part)
        moved = f"{round_digits(float(rms))} mm"
        rows.append([label_part(part), scale, interval, moved, describe_share(part.share)])
    return rows
