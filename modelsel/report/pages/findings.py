"""Every finding: the sentence, what to do, who else it could be, what would tell them apart, and the
picture that convinces."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import partial

from ..._short_numbers import round_numbers
from ...diagnosis.findings.stated_probability import bound_chance, format_probability
from ...measurements.campaign.state_names import StateKind, state_kind
from ...measurements.formats.row_places import Where
from ...results.schemas.details_schema import FindingDetailsRecord
from ...results.schemas.finding_schema import BEYOND, BEYOND_WORDS, EntryRecord, FindingRecord
from ...results.schemas.schema import StudyRecord
from ...results.sentences.finding_advice import advise
from ...results.sentences.small_findings import split_findings, write_sum
from ...results.sentences.study_sentences import (
    count_rows,
    describe_probability,
    format_gain,
    format_mm,
    label_entries,
    weigh_listed_record,
    write_figures,
    write_levels,
)
from ...selection.gain import Change
from ..document import Block, Source, make_heading, make_table, make_text, put_beside, share_room
from ..figures.finding import draw_panels, name_axis

MAX_ROWS = 12  # numbers of the rows of a fault
MAX_RIVALS = 5  # entries compared with the first
MAX_ADVICE = 2  # ways to tell rivals apart
PICTURE_MM = 70.0
MAX_NAMES = 8  # explanations of a credible set
# shares of the room between names, words and probabilities
NAME_SHARE, WORDS_SHARE, PROBABILITY_SHARE = 0.55, 1.0, 0.45
HOW_TO_READ = (
    "Open squares: what the model without the effect leaves about its axis; blue: what the chosen model leaves; large "
    "marks: means; orange: the fitted effect. Where the squares follow the line and the blue lies flat, the effect is there, "
    "and the model removes it."
)
LEVELS = (
    "Levels: the probability of what moves (place), of what it depends on (drivers), of how (shape) and of why (cause). A "
    "finding claims the deepest level that reaches 0.9."
)
# covariates or kinds of state in a cause, how to measure again
REMEDIES: tuple[tuple[set[object], str], ...] = (
    (
        {StateKind.PROGRESS, StateKind.SINCE_REST, StateKind.LATE, "time_s", "temperature_C"},
        "measured again at another time of the campaign",
    ),
    (
        {StateKind.APPROACH, StateKind.MOVE, StateKind.DRAG, StateKind.RATE},
        "approached from both sides, by short and by long moves",
    ),
    ({"payload_kg"}, "measured with and without the payload"),
)


def write_findings_pages(source: Source) -> list[Block]:
    """Write the findings, each kept together; small ones in a table."""
    record, details = source.record, source.details
    if not record.findings:
        return [make_heading("Findings"), make_text(record.nothing_else.sentence)]
    told, grouped = split_findings(record.findings, record.small_findings)
    blocks = [make_heading("Findings"), make_text(LEVELS, "quiet", keep=True)]
    if any(details.findings[k].panels for k in told):
        blocks.append(make_text(HOW_TO_READ, "quiet", keep=True))
    for k in told:
        written = _write_finding(source, k + 1, record.findings[k], details.findings[k])
        blocks += written
    return blocks + _write_grouped(source, grouped)


def _write_grouped(source: Source, grouped: Sequence[int]) -> list[Block]:
    """Write the findings that hardly change what is left: their sum, and a line each."""
    record, details = source.record, source.details
    if not grouped or record.small_findings is None:
        return []
    one_turns = any(record.findings[k].told_turning is not None for k in grouped)
    write = _write_both_sizes if one_turns else _write_sizes
    rows = []
    for k in grouped:
        finding, detail = record.findings[k], details.findings[k]
        name, probability = name_finding(finding, detail), describe_probability(finding)
        rows.append([str(k + 1), name, detail.what, *write(finding), probability])
    heads = ["rms", "at most"] if one_turns else ["rms, mm", "at most, mm"]
    columns = [("", "right"), ("finding", "left"), ("what goes wrong", "left")]
    columns += [*((head, "right") for head in heads), ("probability", "left")]
    caption = (
        "rms: at the measured configurations, beyond the other findings that matter; at most: in the workspace. All that "
        "is known of them is in result.json and in report.html."
    )
    if one_turns:
        caption += " mrad: how far the target is turned, where that prevails; rms beyond the base."
    if any(BEYOND in size for row in rows for size in row[3:-1]):
        caption += f" {BEYOND_WORDS}."
    probabilities = [row[-1] for row in rows]
    last = share_room(probabilities, PROBABILITY_SHARE)
    widths = [0.0, NAME_SHARE, WORDS_SHARE, 0.0, 0.0, last]
    table = make_table(columns, rows, caption, widths)
    return [
        make_heading("Smaller findings", 2),
        make_text(write_sum(record.small_findings), keep=True),
        table | {"breaks": True},
    ]


def _write_sizes(finding: FindingRecord) -> list[str]:
    """Return the rms and the largest displacement of the target [mm]."""
    worst = finding.worst
    largest = "–" if worst is None else f"{format_mm(worst.mm)}{worst.mark}"
    return [format_mm(finding.rms_mm), largest]


def _write_both_sizes(finding: FindingRecord) -> list[str]:
    """Return the rms and the largest of what is told of a finding: displacement, turning, or both."""
    moved = [_add_unit(size) for size in _write_sizes(finding)]
    turning = finding.told_turning
    if turning is None:
        return moved
    largest = f"{format_mm(turning.mrad)} mrad{turning.mark}"
    turned = [f"{format_mm(turning.rms_mrad)} mrad", largest]
    if finding.only_turns:
        return turned
    return [f"{mm}, {mrad}" for mm, mrad in zip(moved, turned, strict=True)]


def _add_unit(size: str) -> str:
    """Add the unit to a length, before its mark."""
    length = size.rstrip(BEYOND)
    return size.replace(length, f"{length} mm")


def name_finding(finding: FindingRecord, detail: FindingDetailsRecord) -> str:
    """Return the name of a finding, and beside it that it is doubtful."""
    return f"{detail.label} (doubtful)" if finding.doubtful else detail.label


def _write_finding(
    source: Source, number: int, finding: FindingRecord, detail: FindingDetailsRecord
) -> list[Block]:
    lead = ""
    if finding.is_name_open:
        lead = "fitted as " if finding.likelier else "best described by "
    title = f"Finding {number}: {lead}{name_finding(finding, detail)}"
    words = [
        make_text(f"{finding.sentence} {write_figures(finding)}".strip()),
        make_text(describe_advice(source.record, finding)),
        *_write_levels(finding),
        make_text(_describe_verdict(finding, source.where), "quiet"),
    ]
    if len(finding.credible_set) > 1:
        words.append(make_text(_describe_credible_set(finding), "quiet"))
    heading = make_heading(title, 2)
    if not detail.panels:
        return [heading, *words]
    return [heading, put_beside(words, [_write_residuals(source, number, detail)], PICTURE_MM)]


def describe_advice(record: StudyRecord, finding: FindingRecord) -> str:
    """Return what to do, and what would tell it from its rivals."""
    advice = advise(record, finding)
    separation = advise_separation(finding.credible_set)
    return " ".join([f"What to do. {advice.sentence}", *separation])


def _describe_credible_set(finding: FindingRecord) -> str:
    """Return what the finding could be: those that move the target as the first does, then the others."""
    entries = finding.credible_set
    scale = weigh_listed_record(finding)
    alike: list[str] = []
    different: list[str] = []
    for name, entry in zip(label_entries(entries), entries, strict=True):
        side = alike if entry.alike else different
        side.append(f"{name} {format_probability(scale * entry.probability)}")
    shown = [*alike, *different][:MAX_NAMES]
    text = f"What it could be, with its probability: {'; '.join(shown[: len(alike)])}"
    if len(shown) > len(alike):
        text += f"; moving the target differently: {'; '.join(shown[len(alike) :])}"
    more = finding.more_entries + len(entries) - len(shown)
    return f"{text}; {more} more are less probable." if more else f"{text}."


def _write_residuals(source: Source, number: int, detail: FindingDetailsRecord) -> Block:
    """Write the residual against the cause, with the effect left in and taken out."""
    panels = detail.panels
    caption = ""
    if any("folded" in panel.against for panel in panels):
        caption = "All waves of a turn are laid over each other."
    if detail.more_panels:
        total = len(panels) + detail.more_panels
        caption += f" The {len(panels)} largest of {total} parts are drawn."
    axes = "; ".join(
        f"{name_axis(panel)} against {round_numbers(panel.against)}" for panel in panels
    )
    words = f"Residual {axes}, without and with {detail.label}."
    draw = partial(draw_panels, panels)
    return source.add_figure(f"finding-{number}", draw, caption.strip(), words)


def _write_levels(finding: FindingRecord) -> list[Block]:
    levels = write_levels(finding)
    return [make_text(levels, "quiet")] if levels else []


def describe_proof(finding: FindingRecord, where: Where) -> str:
    """Return the probability of every level, p-value, gain and rows."""
    return f"{write_levels(finding)} {_describe_verdict(finding, where)}".lstrip()


def _describe_verdict(finding: FindingRecord, where: Where) -> str:
    """Return p-value, gain and rows in one line."""
    least = bound_chance(finding.p_value)
    chance = f"{least} over the whole search"
    parts = [
        f"Verdict: {finding.told_verdict}; chance alone would do as well with probability {chance}"
    ]
    gain = finding.gain
    changes = [one for one in (gain.of_position, gain.of_orientation) if one is not None]
    if changes:
        told = ", of orientation ".join(map(_describe_change, changes))
        parts.append(f"Held-out error when it joins the ladder: {told}")
    if finding.rows:
        listed = where.listed(finding.rows, MAX_ROWS)
        count = count_rows(finding.rows)
        parts.append(f"It concerns {count} of the measurements ({listed})")
    return ". ".join(parts) + "."


def _describe_change(change: Change) -> str:
    """Return the held-out error before and after, and the interval of its fall in words."""
    before = format_mm(change.before)
    after = format_mm(change.after)
    unit = change.unit
    text = f"{before} to {after} {unit} rms"
    if change.interval is None:
        return text
    low, high = change.interval
    if low < 0 < high:
        return f"{text} (95 %: {format_gain(-low)} {unit} more to {format_gain(high)} {unit} less)"
    near, far = map(format_gain, sorted(map(abs, change.interval)))
    side = "less" if low >= 0 else "more"
    return f"{text} (95 %: {near} to {far} {unit} {side})"


# -- rivals
# -----------------------------------------------------------------------------------------------------------------------


def advise_separation(entries: Sequence[EntryRecord]) -> list[str]:
    """Advise which measurement would tell the first entry from its rivals, by what they differ in."""
    labels = label_entries(entries)
    advice = [
        _advise(labels[0], entries[0], label, rival)
        for label, rival in zip(labels[1:], entries[1 : MAX_RIVALS + 1], strict=False)
    ]
    return [sentence for sentence in dict.fromkeys(advice) if sentence][:MAX_ADVICE]


def _advise(label: str, first: EntryRecord, rival_label: str, rival: EntryRecord) -> str:
    """Return what would tell the first entry from a rival; empty where no measurement can."""
    if first.name == rival.name and _has_wave(first) and _has_wave(rival):
        return (
            f"{first.name} with another constant: more readings of that joint, spread evenly over its turn, sharpen the wave "
            "length."
        )
    if not first.screws or not rival.screws:
        return ""
    pair = f"{label} and {rival_label}"
    cells, rival_cells = _cells(first), _cells(rival)
    if cells == rival_cells:
        return f"{pair} are two names of one displacement: no measurement tells them apart, either corrects the error."
    if set(first.causes) == set(rival.causes):
        return (
            f"{pair} have the same cause at {cells[0][0]} and {rival_cells[0][0]}: a second target off the last axis, or "
            "measured orientations, may tell them apart; where no target can, either name corrects the same error."
        )
    return _advise_by_cause(pair, first, rival)


def _advise_by_cause(pair: str, first: EntryRecord, rival: EntryRecord) -> str:
    """Return what would tell two entries with different causes apart."""
    remedy = _remedy(set(first.causes) ^ set(rival.causes))
    if remedy is not None:
        return f"{pair} can be told apart when the same configurations are {remedy}."
    if rival.alike:
        return (
            f"{pair} move the target in the same way wherever it was measured: either corrects the error there. "
            "modelsel plan says whether other configurations would tell them apart."
        )
    causes = f"{_join_causes(first)} against {_join_causes(rival)}"
    return (
        f"{pair} have different causes ({causes}): configurations in which these change independently of each other tell "
        "them apart."
    )


def _join_causes(entry: EntryRecord) -> str:
    return " & ".join(map(round_numbers, entry.causes))


def _cells(entry: EntryRecord) -> list[tuple[str, str]]:
    """Return (place, cause) of an entry's screws, sorted."""
    return sorted({(screw.place, screw.cause) for screw in entry.screws})


def _has_wave(entry: EntryRecord) -> bool:
    """Return whether an entry is a wave of some angle."""
    return any("sin(" in cause for cause in entry.causes)


def _remedy(causes: set[str]) -> str | None:
    """Return how to measure again so that causes which differ part."""
    words = " ".join(causes)
    names = set(re.findall(r"\w+", words))
    found: set[object] = {*names, *map(state_kind, names)}
    for changing, remedy in REMEDIES:
        if changing & found:
            return remedy
    return None
