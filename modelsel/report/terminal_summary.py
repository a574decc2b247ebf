"""The summary of a study on one screen of a terminal: what was named and how much it moves, the
models' errors, and where the rest is told."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from ..diagnosis.candidates.signatures import PROVEN
from ..diagnosis.findings.stated_probability import format_probability
from ..exceptions import choice_list, sentence_list
from ..measurements.formats.row_places import where_from_record
from ..notices import ALARMS
from ..results.numbers.quantities import format_figure
from ..results.repeatability.repeatability import summarise_repeatability
from ..results.schemas.details_schema import DetailsRecord, FindingDetailsRecord
from ..results.schemas.finding_schema import BEYOND, BEYOND_WORDS, FindingRecord
from ..results.schemas.schema import StudyRecord
from ..results.sentences.small_findings import find_named, split_findings, write_sum
from ..results.sentences.study_sentences import (
    describe_name_probability,
    describe_outliers,
    describe_predictable,
    describe_probability,
    has_predictable_rest,
    opening_sentences,
    weigh_listed_record,
)
from .text_tables import fold_text

# lines of the whole summary, the title, the verdict and what the command adds among them
MAX_LINES = 39
# the title, the blank lines, what sampling says, the notes, the files that were written
OTHER_LINES = 12
# columns of a finding's size, and of what stands below it
SIZE_WIDTH = 6
HANGING = " " * (SIZE_WIDTH + 2)
SHOWN_RIVALS = 3
# rows left out that are listed
MAX_OUTLIERS = 3
# the code of the note on chains that have not converged
UNCONVERGED = "unconverged"


def summarise_study(record: StudyRecord, details: DetailsRecord, width: int) -> list[str]:
    """Write what follows the verdict: the findings in their order, the models' errors,
    and what does not repeat. Of more findings than a screen holds, the last are told in short."""
    verdict = sum(len(fold_text(sentence, width)) for sentence in opening_sentences(record))
    room = MAX_LINES - OTHER_LINES - verdict
    rest = [line for one in _list_remarks(record, details) for line in fold_text(one, width)]
    lines = _write_findings(record, details, width, room - len(rest))
    lines += ["", *rest] if lines else rest
    for sentence in summarise_repeatability(record.repeatability):
        repeated = fold_text(sentence, width)
        lines += repeated if len(lines) + len(repeated) <= room else []
    return lines


def write_closing(record: StudyRecord, width: int) -> list[str]:
    """Write whether the sampled posterior can be trusted, and what the summary leaves out."""
    sentences = []
    if record.sampling is not None:
        sentences.append(_describe_sampling(record))
    sentences.append(f"With --verbose: {_list_left_out(record)}.")
    return [line for sentence in sentences for line in fold_text(sentence, width)]


def _write_findings(
    record: StudyRecord, details: DetailsRecord, width: int, room: int
) -> list[str]:
    """Write the findings that are told one by one: the last ones in short where a screen has no room
    for all, and the last of those that the verdict does not name not at all."""
    told, grouped = split_findings(record.findings, record.small_findings)
    if not told:
        return []
    head = fold_text("Findings, and the most that each moves the target [mm]:", width)
    last = []
    if any(_is_beyond(record.findings[k]) for k in told):
        last += fold_text(BEYOND_WORDS, width, HANGING)
    if grouped and record.small_findings is not None:
        last += fold_text(write_sum(record.small_findings), width)
    labels = [drawn.label for drawn in details.findings]
    named = find_named(record.verdict, labels)
    written = {}
    for k in told:
        finding, drawn = record.findings[k], details.findings[k]
        whole = _write_finding(finding, drawn, width)
        short = _write_short(finding, drawn, width)
        written[k] = _Written(whole, min(short, whole, key=len))
    lines = _fit_findings(written, named, room - len(head) - len(last))
    return [*head, *lines, *last]


class _Written(NamedTuple):
    """The lines of a finding: all, and the fewest that name it."""

    whole: list[str]
    short: list[str]


def _fit_findings(written: Mapping[int, _Written], named: set[int], room: int) -> list[str]:
    """Return the lines of findings: in short from the last one on until they fit, then without the
    last ones that are not named, of which the first stays."""
    lines = {k: one.whole for k, one in written.items()}
    first, *others = written
    backwards = [*reversed(others), first]
    for k in backwards:
        if _count_lines(lines) <= room:
            break
        lines[k] = written[k].short
    dropped = 0
    for k in backwards:
        # the line that counts those left out needs room, too
        if _count_lines(lines) + bool(dropped) <= room:
            break
        if k not in named and k != first:
            del lines[k]
            dropped += 1
    listed = [line for one in lines.values() for line in one]
    if dropped:
        listed.append(f"{'…':>{SIZE_WIDTH}}  {dropped} more, which --verbose shows")
    return listed


def _count_lines(lines: Mapping[int, list[str]]) -> int:
    return sum(map(len, lines.values()))


def _is_beyond(finding: FindingRecord) -> bool:
    """Return whether a figure of a finding is told with a mark."""
    return BEYOND in _write_size(finding) + _write_turning(finding)


def _write_size(finding: FindingRecord) -> str:
    """Write how far a finding moves the target, with its mark; a dash where it does not."""
    worst = finding.worst
    if worst is None or finding.only_turns:
        return f"{'–':>{SIZE_WIDTH}} "
    return f"{format_figure(worst.mm):>{SIZE_WIDTH}}{worst.mark or ' '}"


def _write_turning(finding: FindingRecord) -> str:
    """Write how far a finding turns the target, where that is told."""
    turning = finding.told_turning
    if turning is None:
        return ""
    return f"turns the target by at most {format_figure(turning.mrad)} mrad{turning.mark}; "


def _write_finding(finding: FindingRecord, drawn: FindingDetailsRecord, width: int) -> list[str]:
    """Write a finding: how much it moves, what it says as far as it is proven, and its standing."""
    size = _write_size(finding)
    if finding.first.is_fault and finding.worst is None:
        return fold_text(f"{size} {finding.sentence}", width, hanging=HANGING)
    lines = fold_text(f"{size} {drawn.what}", width, hanging=HANGING)
    standing = _describe_standing(finding, drawn.label)
    return lines + fold_text(_write_turning(finding) + standing, width, HANGING)


def _write_short(finding: FindingRecord, drawn: FindingDetailsRecord, width: int) -> list[str]:
    """Write a finding in short: how much it moves, its name and how probable that is."""
    turning = _write_turning(finding)
    probability = describe_probability(finding)
    words = f"{drawn.label}, {turning}probability {probability}"
    words += "" if finding.is_found else ", with rivals"
    words += ", doubtful" if finding.doubtful else ""
    return fold_text(f"{_write_size(finding)} {words}", width, hanging=HANGING)


def _describe_standing(finding: FindingRecord, label: str) -> str:
    """Describe how probable a finding is and its name, or its rivals."""
    doubt = ", doubtful: the held-out error does not fall with it" if finding.doubtful else ""
    claim = finding.claim
    if claim is not None and claim.probability < PROVEN:
        # what it could be stands above, with the probabilities
        return f"{_begin_naming(finding)} {label}{doubt}"
    if not finding.is_found:
        if finding.is_constant_open:
            return f"{label}, the constant is open (--verbose lists its values){doubt}"
        rivals = _weigh_names(finding)
        more = len(rivals) - SHOWN_RIVALS + finding.more_entries
        others = [f"{more} more"] if more > 0 else []
        return f"not told apart: {choice_list([*rivals[:SHOWN_RIVALS], *others])}{doubt}"
    if claim is None or claim.level == "cause":
        return f"{label}, probability {describe_probability(finding)}{doubt}"
    named = f"{label} ({describe_name_probability(finding)})"
    likelier = _weigh_names(finding)[: len(finding.likelier)]
    if likelier:
        verb = "is" if len(likelier) == 1 else "are"
        named += f"; {sentence_list(likelier)} {verb} likelier"
    proven = format_probability(claim.probability)
    return f"probability {proven}{doubt}; {_begin_naming(finding)} {named}"


def _begin_naming(finding: FindingRecord) -> str:
    """Begin to tell the name that figures and model have: it is not always the likeliest one."""
    return "fitted as" if finding.likelier else "best described by"


def _weigh_names(finding: FindingRecord) -> list[str]:
    """Name what a finding could be, the likeliest first, each name with the probability of all its
    constants."""
    scale = weigh_listed_record(finding)
    weights = finding.sum_by_name()
    names = []
    for name in sorted(weights, key=lambda name: -weights[name]):
        probability = format_probability(scale * weights[name])
        named = f"{name} ({probability})"
        names.append(named)
    return names


def _list_remarks(record: StudyRecord, details: DetailsRecord) -> list[str]:
    """Return the models' errors, and what else a reader of the verdict has to know."""
    remarks = [_describe_ladder(record, details)]
    if has_predictable_rest(record):
        remarks.append(describe_predictable(record))
    if record.outliers:
        places = details.places
        where = where_from_record(None if places is None else places.to_dict())
        sentence = describe_outliers(record, where, MAX_OUTLIERS)
        remarks.append(sentence)
    return remarks


def _describe_ladder(record: StudyRecord, details: DetailsRecord) -> str:
    """Return the rms error of the nominal, the base and the chosen model."""
    side = record.side
    rungs = {"nominal": 0, "base": details.base, "chosen": len(record.ladder) - 1}
    errors = []
    for name, number in rungs.items():
        rung = record.ladder[number]
        error = rung.side(side).rms_mm
        errors.append(f"{name} {'–' if error is None else format_figure(error)}")
    return f"Position error, {side.replace('_', '-')} configurations [mm rms]: {', '.join(errors)}."


def _describe_sampling(record: StudyRecord) -> str:
    """Return how many samples the posterior has, or that its chains have not converged."""
    sampling = record.sampling
    assert sampling is not None
    if not sampling.converged:
        notes = (note.sentence for note in record.warnings if note.code == UNCONVERGED)
        general_note = "The chains that sample the posterior have not converged."
        return next(notes, general_note)
    count = f"{sampling.effective_samples:,.0f}"
    mixing = f"R-hat {sampling.r_hat:.3f}"
    return f"The posterior was sampled: {count} effective samples, {mixing}."


def _list_left_out(record: StudyRecord) -> str:
    """Return what a summary leaves out, in words."""
    parts = ["the tables", "every finding in full"]
    if record.unidentifiable:
        parts.append("what the data cannot determine")
    notes = [warning for warning in record.warnings if warning.code not in ALARMS]
    count = len(notes)
    if count:
        counted = "1 note" if count == 1 else f"{count} notes"
        parts.append(counted)
    return sentence_list(parts)
