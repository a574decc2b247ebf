"""Two studies of one robot on one self-contained page: both verdicts, their errors, the findings beside
each other, and the parameters that changed; every word of the data is escaped."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape
from importlib.resources import files
from string import Template
from typing import NamedTuple

from ..calibration.comparison.campaigns import Change, Comparison, Explanation
from ..calibration.comparison.change_sentences import describe_change, write_p
from ..calibration.comparison.comparison_sentences import COVERAGE, MIN_MOVE_MM, describe_comparison
from ..calibration.comparison.target_changes import TargetChange
from ..exceptions import count_words
from ..results.numbers.quantities import format_figure
from ..results.schemas.details_schema import DetailsRecord
from ..results.schemas.schema import StudyRecord
from ..results.sentences.study_sentences import (
    describe_probability,
    describe_split,
    opening_sentences,
)
from .html_parts import write_html_table, write_paragraph
from .style import choose_unit

SIDES = ("first", "second")
ABSENT = "–"


@dataclass(frozen=True, eq=False)
class Campaign:
    """One of the two studies, from its folder's files, with the name that it goes by on the page."""

    name: str
    record: StudyRecord
    details: DetailsRecord


Pair = tuple[Campaign, Campaign]
Match = tuple[int | None, int | None]


def write_comparison_page(campaigns: Pair, comparison: Comparison) -> bytes:
    """Write the page; `comparison` is of the campaigns' calibrations."""
    folder = files(__package__) / "templates"
    template = Template((folder / "compare.html").read_text(encoding="utf-8"))
    names = [campaign.name for campaign in campaigns]
    page = template.substitute(
        title=escape(f"Comparison: {names[0]} and {names[1]}"),
        first=escape(names[0]),
        second=escape(names[1]),
        robot=escape(campaigns[0].record.robot),
        changed=_list_sentences(describe_comparison(comparison)),
        verdicts="\n".join(map(_write_verdict, SIDES, campaigns)),
        errors=_write_errors(campaigns),
        findings=_write_findings(campaigns, comparison),
        parameters=_write_parameters(comparison),
        style=(folder / "page.css").read_text(encoding="utf-8"),
    )
    return page.encode()


def _list_sentences(sentences: Sequence[str]) -> str:
    return "\n".join(write_paragraph(sentence, "verdict") for sentence in sentences)


def _write_verdict(side: str, campaign: Campaign) -> str:
    """Write the verdict of one study."""
    record = campaign.record
    sentences = "\n".join(write_paragraph(sentence) for sentence in opening_sentences(record))
    about = write_paragraph(describe_split(record), "quiet")
    title = f'<h3><span class="kicker">{side}</span> {escape(campaign.name)}</h3>'
    return f'<div class="side">\n{title}\n{about}\n{sentences}\n</div>'


def _align(heads: Sequence[str], numbers: int) -> list[tuple[str, str]]:
    """Return the columns of a table, of which the last `numbers` hold figures."""
    first = len(heads) - numbers
    return [(name, "right" if k >= first else "left") for k, name in enumerate(heads)]


# -- errors
# --------------------------------------------------------------------------------------------------


def _write_errors(campaigns: Pair) -> str:
    """Write the errors of the nominal, the base and the chosen model of both studies."""
    rows = []
    for name in ("nominal", "base", "chosen"):
        errors = [_find_error(campaign, name) for campaign in campaigns]
        rows.append([f"{name} model", *(_format(error) for error in errors)])
    floors = [campaign.record.noise_floor.coordinate_mm for campaign in campaigns]
    rows.append(["noise of one coordinate", *(_format(floor) for floor in floors)])
    heads = ["rms, mm", *(_name_side(side, c) for side, c in zip(SIDES, campaigns, strict=True))]
    return write_html_table(_align(heads, 2), rows, "errors")


def _name_side(side: str, campaign: Campaign) -> str:
    record = campaign.record
    counts = record.configurations
    count = counts.held_out or counts.estimation
    return f"{side}: {count:,} {record.side.replace('_', '-')} configurations"


def _find_error(campaign: Campaign, model: str) -> float | None:
    ladder = campaign.record.ladder
    rungs = {"nominal": 0, "base": campaign.details.base, "chosen": len(ladder) - 1}
    return ladder[rungs[model]].side(campaign.record.side).rms_mm


def _format(value: float | None) -> str:
    return ABSENT if value is None else format_figure(value)


# -- findings
# --------------------------------------------------------------------------------------------------


class Name(NamedTuple):
    """What a finding is called, and what else would move the target as it does."""

    label: str
    alike: frozenset[str]

    def is_same(self, other: Name) -> bool:
        """Return whether two findings have one name."""
        return self.label == other.label

    def could_be(self, other: Name) -> bool:
        """Return whether each of two findings may be called as the other."""
        return self.label in other.alike and other.label in self.alike


def list_names(campaign: Campaign) -> list[Name]:
    """Return what the findings of a study are called."""
    names = []
    for finding, drawn in zip(campaign.record.findings, campaign.details.findings, strict=True):
        rivals = zip(finding.credible_set, drawn.rivals, strict=False)
        alike = frozenset(rival for entry, rival in rivals if entry.alike)
        names.append(Name(drawn.label, alike | {drawn.label}))
    return names


def match_findings(first: Sequence[Name], second: Sequence[Name]) -> list[Match]:
    """Match the findings of two studies: those of one name, then those that could be each other's;
    those of one study alone last."""
    pairs: dict[int, int] = {}
    for fits in (Name.is_same, Name.could_be):
        for k, name in enumerate(first):
            free = (n for n in range(len(second)) if n not in pairs.values())
            found = next((n for n in free if fits(name, second[n])), None)
            if k not in pairs and found is not None:
                pairs[k] = found
    both: list[Match] = [(k, pairs[k]) for k in sorted(pairs)]
    gone: list[Match] = [(k, None) for k in range(len(first)) if k not in pairs]
    new: list[Match] = [(None, n) for n in range(len(second)) if n not in pairs.values()]
    return [*both, *gone, *new]


def _write_findings(campaigns: Pair, comparison: Comparison) -> str:
    matches = match_findings(*map(list_names, campaigns))
    if not matches:
        return write_paragraph("Neither study named an error.")
    said = {}
    for change in comparison.mechanisms:
        words = describe_change(change)
        said.update(dict.fromkeys(change.labels, words))
    rows = [list(_write_match(campaigns, match, said)) for match in matches]
    heads = ["found in", "first", "second", "change"]
    aligned_heads = _align(heads, 0)
    return write_html_table(aligned_heads, rows, "findings")


def _write_match(campaigns: Pair, match: Match, said: dict[str, str]) -> Iterator[str]:
    """Write where a finding was made, what each study says of it, and how it changed."""
    named = [side for side, k in zip(SIDES, match, strict=True) if k is not None]
    yield "both" if len(named) == 2 else f"the {named[0]} only"
    names = []
    for campaign, k in zip(campaigns, match, strict=True):
        if k is None:
            yield ABSENT
            continue
        names.append(campaign.details.findings[k].label)
        yield _write_finding(campaign, k)
    changes = dict.fromkeys(said[name] for name in names if name in said)
    yield "".join(write_paragraph(change) for change in changes) or ABSENT


def _write_finding(campaign: Campaign, k: int) -> str:
    finding, drawn = campaign.record.findings[k], campaign.details.findings[k]
    parts = [f"<b>{escape(drawn.label)}</b>", write_paragraph(drawn.what)]
    figures = []
    if finding.worst is not None and not finding.only_turns:
        beyond = ", beyond the measured joint readings" if finding.worst.mark else ""
        figures.append(f"at most {_format(finding.worst.mm)} mm{beyond}")
    if finding.told_turning is not None:
        figures.append(
            f"at most {_format(finding.told_turning.mrad)} mrad of the target's orientation"
        )
    figures.append(f"{finding.told_verdict}, probability {describe_probability(finding)}")
    if finding.doubtful:
        figures.append("doubtful")
    return "".join([*parts, write_paragraph("; ".join(figures), "quiet")])


# -- parameters
# --------------------------------------------------------------------------------------------------


def _write_parameters(comparison: Comparison) -> str:
    """Write the fewest parameters that explain the difference, as the text lists them, and all that were tested
    behind a click."""
    explained, tested = comparison.explained_by, comparison.changes
    parts = [_tabulate_explained(explained)] if explained else []
    if not explained and not comparison.target_motions:
        parts.append(write_paragraph("No small set of parameters explains a change beyond chance."))
    if tested:
        parameters = count_words(len(tested), "parameter")
        words = f"{parameters} tested one by one, {len(comparison.moved)} beyond chance"
        parts.append(f"<details><summary>{words}</summary>\n{_tabulate(tested)}</details>")
    if comparison.targets:
        parts.append(_tabulate_targets(comparison.targets))
    return "\n".join(parts)


def _tabulate_targets(targets: Sequence[TargetChange]) -> str:
    """Write a table of how far each of several targets moved on the flange."""
    heads = ["target on the flange", "x, mm", "± (k = 2)", "y, mm", "± (k = 2)", "z, mm"]
    heads += ["± (k = 2)", "p"]
    rows = []
    for one in targets:
        name = escape(one.target)
        row = [f"<b>{name}</b>"]
        for moved, error in zip(one.moved_mm, one.standard_errors, strict=True):
            move = _write_figure(moved, 4)
            uncertainty = _write_figure(COVERAGE * error, 2)
            row += [move, uncertainty]
        p = _write_short_p(one.p)
        rows.append([*row, p])
    return write_html_table(_align(heads, 7), rows, "parameters")


def _write_short_p(p: float) -> str:
    """Write a p-value under a heading that says p."""
    written = write_p(p)
    without_name = written.removeprefix("p")
    return without_name.removeprefix(" = ")


def _tabulate_explained(explained: Sequence[Explanation]) -> str:
    """Write a table of the terms that explain the difference, those that move the target most first."""
    largest = max(one.moves_mm for one in explained)
    turns = _list_turn_heads(explained)
    heads = ["parameter", "moves the target", "mm rms", *turns, "change", "± (k = 2)"]
    rows = []
    for one in explained:
        factor, shown = _choose_scale(one.unit, abs(one.by))
        rows.append(
            [
                _name_parameter(one.symbol, shown, one.mechanism),
                _draw_bar(one.moves_mm, largest),
                *_write_effects(one),
                _write_figure(factor * one.by, 4),
                _write_figure(factor * COVERAGE * one.standard_error, 2),
            ]
        )
    return write_html_table(_align(heads, 3 + len(turns)), rows, "parameters")


def _list_turn_heads(changes: Sequence[Change | Explanation]) -> list[str]:
    """List the heading of the column of turns, where orientations are compared."""
    is_turned = any(change.turns_mrad is not None for change in changes)
    return ["mrad rms"] if is_turned else []


def _write_effects(change: Change | Explanation) -> Iterator[str]:
    """Write how far a change moves the target and, where orientations are compared, turns it."""
    yield _write_effect(change.moves_mm)
    if change.turns_mrad is not None:
        yield _write_effect(change.turns_mrad)


def _write_effect(size: float) -> str:
    return "0" if size < MIN_MOVE_MM else f"{size:.3g}"


def _name_parameter(symbol: str, unit: str, mechanism: str) -> str:
    return f"<b>{escape(symbol)}</b> [{escape(unit)}] {escape(mechanism)}"


def _draw_bar(moves_mm: float, largest: float) -> str:
    width = 100 * moves_mm / largest if largest > 0 else 0.0
    return f'<div class="bar" style="width: {width:.0f}%"></div>'


def _write_figure(value: float, digits: int) -> str:
    """Write a number with so many digits, no power of ten where it is large, and a true minus sign."""
    rounded = float(f"{value:.{digits}g}")
    return f"{rounded:.6g}".replace("-", "−")


def _choose_scale(unit: str, largest: float) -> tuple[float, str]:
    """Choose the factor and the unit that a number reads well in."""
    base = re.match(r"rad|mm|", unit)
    assert base is not None
    factor, shown = choose_unit(base[0], largest)
    return factor, shown + unit[base.end() :]


def _tabulate(changes: Sequence[Change]) -> str:
    """Write a table of changes, those that move the target most first."""
    largest = max(change.moves_mm for change in changes)
    ordered = sorted(changes, key=lambda change: -change.moves_mm)
    turns = _list_turn_heads(changes)
    heads = [
        "parameter",
        "moves the target",
        "mm rms",
        *turns,
        "first",
        "second",
        "change",
        "± (k = 2)",
        "p",
    ]
    rows = [_write_change(change, largest) for change in ordered]
    return write_html_table(_align(heads, 6 + len(turns)), rows, "parameters")


def _write_change(change: Change, largest: float) -> list[str]:
    values = (change.before, change.after, change.after - change.before)
    factor, shown = _choose_scale(change.unit, max(map(abs, values)))
    return [
        _name_parameter(change.symbol, shown, change.mechanism),
        _draw_bar(change.moves_mm, largest),
        *_write_effects(change),
        *(_write_figure(factor * value, 4) for value in values),
        _write_figure(factor * COVERAGE * change.standard_error, 2),
        _write_short_p(change.p),
    ]
