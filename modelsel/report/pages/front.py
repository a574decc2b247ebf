"""The first pages: the verdict, the data and their split, the ladder and the table, the error
map."""

from __future__ import annotations

from functools import partial
from math import degrees

from ..._short_numbers import round_numbers
from ...diagnosis.findings.name_legend import PAIR, explain_names
from ...exceptions import sentence_list
from ...results.conclusions.placements import describe_placements
from ...results.repeatability.unsure_joints import describe_noise_floor
from ...results.schemas.details_schema import DetailsRecord
from ...results.schemas.schema import ErrorMapRecord, StudyRecord
from ...results.sentences.finding_advice import advise, list_frames
from ...results.sentences.small_findings import choose_shown, find_named, split_findings
from ...results.sentences.study_sentences import describe_probability, format_mm, opening_sentences
from ..document import (
    Block,
    Source,
    keep_together,
    make_heading,
    make_list,
    make_table,
    make_text,
    put_beside,
    share_room,
)
from ..figures import errormap, space
from ..figures.arm import draw_marked
from ..figures.ladder import draw_ladder, label_way, select_way
from ..style import shorten
from .findings import name_finding

MAX_NAMED = 9  # rows of the first page's table
LONGEST_NAME = 48  # letters
CAMPAIGN_LABELS = {
    "date": "Date",
    "instrument": "Instrument",
    "serial_number": "Serial number",
    "operator": "Operator",
    "ambient": "Ambient",
}
LONGEST_ADVICE = 160  # letters
WORTH = "Gain: by how much the held-out rms error falls when it joins the model, with its interval"
PROBABILITY = (
    "Probability: of the cause; where that is not proven, also of the deepest level that is: place (what moves), drivers "
    "(what it depends on) or shape"
)
NAMED_COLUMNS = (
    ("", "right"),
    ("finding", "left"),
    ("what to do", "left"),
    ("gain, rms", "left"),
    ("probability", "left"),
)
# shares of the room between names, advice and probabilities
NAME_SHARE, ADVICE_SHARE, PROBABILITY_SHARE = 0.6, 1.0, 0.4
# what bounds the grey zone of the ladder, by the source of the noise floor
ZONES = {
    "stated": "the noise as it is stated",
    "instrument": "the noise that the instrument's figures state",
    "repeats": "what differs between repeats of one posture",
    "target pairs": "the noise that pairs of targets show",
    "estimated": "what seems not to repeat, of the instrument and of the arm",
}
DOUBTED_NOISE = "stated-uncertainty"  # the code of the note
MAX_CELLS = 6  # cells that the map's text for those who cannot see names


def write_first_page(source: Source) -> list[Block]:
    """Write the page that stands alone."""
    record = source.record
    title = {
        "kind": "title",
        "title": record.study,
        "robot": record.robot,
        "estimation": f"{record.configurations.estimation:,}",
        "held_out": f"{record.configurations.held_out:,}",
        "campaign": list_campaign(source.details),
    }
    figure = source.add_figure(
        "ladder",
        partial(draw_ladder, record),
        "Rms position error of each model on the way from the nominal to the chosen one. A row that begins with + "
        f"adds to the row above it; {describe_zone(record)}{_note_registration(record)}",
        _ladder_words(record),
    )
    lead = [make_text(sentence, "lead") for sentence in opening_sentences(record)]
    return [title, *lead, figure, *_write_named(source)]


def describe_zone(record: StudyRecord) -> str:
    """Return what is left in the grey zone of the ladder: its bound is as good as the noise floor."""
    source = record.noise_floor.source
    left = ZONES.get(source, "noise")
    zone = f"in the grey zone nothing is left but {left}."
    codes = [note.code for note in record.warnings]
    if DOUBTED_NOISE in codes:
        zone += " What is stated is doubted: see the notes."
    return zone


def _note_registration(record: StudyRecord) -> str:
    if record.registration is None:
        return ""
    return " Nominal: with base and target registered to the measurements first."


def list_campaign(details: DetailsRecord) -> list[str]:
    """Return what the study file says of the campaign, each with its name."""
    if details.campaign is None:
        return []
    given = details.campaign.to_dict().items()
    return [f"{CAMPAIGN_LABELS[key]}: {text}" for key, text in given if text]


def _write_named(source: Source) -> list[Block]:
    """Write what was named: marked on the arm, and a table of what to do; nothing where nothing was."""
    findings, small = source.record.findings, source.record.small_findings
    if not findings:
        return []
    told, grouped = split_findings(findings, small)
    labels = [drawn.label for drawn in source.details.findings]
    named = find_named(source.record.verdict, labels)
    shown = choose_shown(told, named, MAX_NAMED)
    rows = [_named_row(source, k) for k in shown]
    caption = f"{WORTH}. {PROBABILITY}"
    has_rivals = any(not finding.is_found for finding in findings)
    caption += "; rivals: others that the data cannot tell from it." if has_rivals else "."
    if len(told) > len(shown):
        caption += f" And {len(told) - len(shown)} more: see Findings."
    if grouped and small is not None:
        caption += f" {len(grouped)} smaller ones stand together in Findings."
    probabilities = [row[-1] for row in rows]
    last = share_room(probabilities, PROBABILITY_SHARE)
    widths = [0.0, NAME_SHARE, ADVICE_SHARE, 0.0, last]
    table = make_table(NAMED_COLUMNS, rows, caption, widths)
    legend = write_legend(source.details)
    told_names = [make_text(f"Names: {legend}", "quiet")] if legend else []
    return [*_write_marks(source, shown), table, *told_names]


def write_legend(details: DetailsRecord) -> str:
    """Write what the findings' names mean that no registry lists; nothing where there are none."""
    labels = [drawn.label for drawn in details.findings]
    lines = explain_names(labels, len(details.joints))
    return f"{'; '.join(lines)}." if lines else ""


def _named_row(source: Source, k: int) -> list[str]:
    finding, detail = source.record.findings[k], source.details.findings[k]
    probability = describe_probability(finding)
    advice = advise(source.record, finding)
    return [
        str(k + 1),
        shorten(name_finding(finding, detail), LONGEST_NAME),
        shorten(advice.sentence, LONGEST_ADVICE),
        advice.worth,
        probability if finding.is_found else f"{probability}, rivals",
    ]


def _write_marks(source: Source, shown: list[int]) -> list[Block]:
    """Write the drawing of the arm with what is wrong marked on it; nothing where an earlier version left no arm."""
    arm = source.details.arm
    if arm is None:
        return []
    frames = range(len(arm.origins_mm))
    marks = []
    for k in shown:
        places = [frame for frame in list_frames(source.record.findings[k]) if frame in frames]
        marks.append((str(k + 1), source.details.findings[k].what, places))
    caption = (
        "What moves: the frames of each finding, on the nominal arm at one measured configuration. Which part is to blame, "
        "the data do not tell."
    )
    words = "; ".join(f"{number}, {what} (frame {_join(places)})" for number, what, places in marks)
    draw = partial(draw_marked, arm, marks)
    return [
        source.add_figure("marked", draw, caption, f"The arm with its findings marked: {words}.")
    ]


def _join(frames: list[int]) -> str:
    return " and ".join(map(str, frames))


def _ladder_words(record: StudyRecord) -> str:
    """Return the ladder's picture for those who cannot see it."""
    way = select_way(record)
    side = record.side.replace("_", "-")
    steps = [
        f"{label} {format_mm(record.ladder[rung].side(record.side).rms_mm)} mm"
        for rung, label in zip(way, label_way(record, way), strict=True)
    ]
    return (
        f"Ladder of models, rms error on {side} configurations: {'; '.join(steps)}. "
        f"Noise floor {record.noise_floor.coordinate_mm:.3g} mm per coordinate."
    )


# -- data
# -----------------------------------------------------------------------------------------------------------------------


def write_data_page(source: Source) -> list[Block]:
    """Write what was measured and how it was split."""
    record, details = source.record, source.details
    counts = record.configurations
    explanation = (
        f"{counts.estimation:,} configurations fit and choose the models, {counts.held_out:,} are held out: no step, "
        f"not even the naming, has seen them. Noise floor: {describe_noise_floor(record)}."
    )
    coverage = source.add_figure(
        "joints",
        partial(space.draw_joints, details),
        "Joint coverage. A stroke is one reading: upper, orange: estimation; lower, blue: held-out; grey: the joint's "
        "range where the robot file gives it. What a joint did not visit, the model does not know."
        + _thinning_sentence(details),
        _coverage_words(details),
    )
    workspace = source.add_figure(
        "workspace",
        partial(space.draw_workspace, details),
        "Measured targets in the instrument's frame, with the nominal arm at one of its configurations.",
        "Three-dimensional scatter of the measured targets, estimation and held-out; they span "
        f"{_span(details)}.",
    )
    heading = make_heading("Data and split")
    pictures = put_beside([coverage], [workspace])
    whole = keep_together([heading, make_text(explanation), pictures])
    return [whole, *_write_placements(record)]


def _write_placements(record: StudyRecord) -> list[Block]:
    """Write where registration found the base and the targets; nothing where the study gives them."""
    if record.registration is None:
        return []
    sentences = describe_placements(record.registration)
    return [make_heading("Where the instrument and the target stand", 2), make_list(sentences)]


def _thinning_sentence(details: DetailsRecord) -> str:
    drawn, measured = len(details.rows.row), details.rows.of
    if drawn >= measured:
        return ""
    return f" {drawn:,} of {measured:,} rows are drawn."


def _coverage_words(details: DetailsRecord) -> str:
    """Return the ranges of the joint readings."""
    spans = []
    for number, joint in enumerate(details.joints, 1):
        readings = [row[number - 1] for row in details.rows.q]
        ends = [min(readings), max(readings)]
        if joint.unit == "rad":
            ends = [degrees(end) for end in ends]
        unit = "degrees" if joint.unit == "rad" else "mm"
        spans.append(f"joint {number} from {ends[0]:.0f} to {ends[1]:.0f} {unit}")
    return f"Readings of each joint: {'; '.join(spans)}."


def _span(details: DetailsRecord) -> str:
    """Return the size of the measured workspace."""
    coordinates = zip(*details.rows.measured_mm, strict=True)
    sides = [max(values) - min(values) for values in coordinates]
    return " by ".join(f"{side:.0f}" for side in sides) + " mm"


# -- error map
# --------------------------------------------------------------------------------------------------------------------


def write_error_map_page(source: Source) -> list[Block]:
    """Write the map of places and causes."""
    record = source.record
    columns = errormap.select_causes(record)
    if not columns:
        words = "No candidate of this study can extend the base: nothing was scanned."
        return [make_heading("Error map"), make_text(words)]
    whole = record.error_map
    draw = partial(errormap.draw_error_map, record)
    cells = sum(value is not None for row in whole.f for value in row)
    explanation = (
        f"{cells:,} cells were scanned, one by one, beyond the base. Of {len(whole.causes)} causes {len(columns)} are "
        "shown: those of findings and the strongest that act at several places. All others are in report.html."
    )
    caption = (
        "Why (rows) and where (columns) the base model errs. Darker: this cell alone would explain more. Orange dot: more "
        "than chance anywhere in the map; orange ring: and among the strongest of its row; black square: the cell of a "
        "finding. One effect darkens every cell that moves the target like it, so most dark cells are echoes."
    )
    legend = (
        f"tx ty tz shift along, rx ry rz turn about the axes of a frame; {describe_own_motion(source.details)}. "
        f"{PAIR}."
    )
    figure = source.add_figure("error-map", draw, caption, _map_words(whole, columns))
    told = [make_text(explanation), make_text(legend, "quiet")]
    return [keep_together([make_heading("Error map"), *told, figure])]


def describe_own_motion(details: DetailsRecord) -> str:
    """Return at which axis of its frame a joint moves by itself: sliding ones along z."""
    frames: dict[str, list[str]] = {"rad": [], "mm": []}
    for number, joint in enumerate(details.joints, 1):
        same = frames[joint.unit]
        name = str(number)
        same.append(name)
    turning = frames["rad"]
    sliding = frames["mm"]
    if not sliding:
        return "rz of frames 1 to n is the joint's own rotation"
    if not turning:
        return "tz of frames 1 to n is the joint's own shift"
    turned = _count_frames(turning)
    shifted = _count_frames(sliding)
    return f"rz of {turned} is the joint's own rotation, tz of {shifted} its own shift"


def _count_frames(numbers: list[str]) -> str:
    listed = sentence_list(numbers)
    word = "frames"
    if len(numbers) == 1:
        word = "frame"
    return f"{word} {listed}"


def _map_words(whole: ErrorMapRecord, columns: list[int]) -> str:
    """Return the map's picture for those who cannot see it."""
    outstanding = [
        f"frame {place} · {round_numbers(whole.causes[column])}"
        for row, place in enumerate(whole.places)
        for column in columns
        if errormap.stands_out(whole, row, column)
    ]
    return (
        f"Error map of {len(columns)} causes by {len(whole.places)} places. {len(outstanding)} cells stand out beyond "
        f"chance, among them {'; '.join(outstanding[:MAX_CELLS]) or 'none'}."
    )
