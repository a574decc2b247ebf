"""Words in pictures: whole, on no frame and on no other words; a name stands once in a header."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from builders import leave_to_slow
from report_studies import read_source

from modelsel.report.figures import parameter_plots
from modelsel.report.figures.arm import draw_frames, draw_marked
from modelsel.report.figures.arm_numbers import Drawn, find_room, needs_line
from modelsel.report.figures.ladder import _scale, choose_ticks, draw_ladder
from modelsel.report.figures.parameter_plots import draw_posterior
from modelsel.report.figures.space import draw_joints
from modelsel.report.pages.parameter_uncertainty import (
    _choose_unit,
    _format_quantiles,
    write_residuals_page,
)
from modelsel.report.pdf import fill_template
from modelsel.report.style import shorten, shorten_clause
from modelsel.results.numbers.quantities import format_figure
from modelsel.results.schemas.details_schema import ArmRecord
from modelsel.results.schemas.model_schema import QuantilesRecord, TraceRecord

LEFT = np.array([-1.0, 0.2])
NOTHING = np.zeros((0, 2))
ROOT = [[0, 0, 0], [0, 0, 0], [0, 0, 181], [-392, -38, 650], [-522, -50, 1207]]
UPRIGHT = {
    "origins_mm": [*ROOT, [-506, -223, 1207], [-538, -226, 1091], [-608, -430, 1146]],
    "axes": [np.eye(3).tolist()] * 8,
    "slides": [False] * 6,
}
WORDS = re.compile(r'<text [^>]*x="([-0-9.]+)" y="([-0-9.]+)"[^>]*>([^<]*)</text>')


def read_words(picture: bytes) -> list[tuple[str, float, float]]:
    """The words of a picture and where they stand, in points from its upper left corner."""
    found = WORDS.findall(picture.decode())
    return [(words, float(x), float(y)) for x, y, words in found]


@pytest.mark.parametrize("x", [0.15, 0.34, 2.0])
def test_target_at_the_edge_is_whole_and_on_no_frame(x) -> None:
    place = np.array([x, 1.0])
    points = np.array([place, place + np.array([0.25, 0.05]), place + np.array([-0.05, 0.2])])
    drawn = Drawn(points, NOTHING, NOTHING, 2.2)
    first = find_room("5, 6", points[1], LEFT, drawn, [])
    second = find_room("target", place, LEFT, drawn, [first])
    for box in (first, second):
        assert box.min() > 0
        inside = ((points > box[0]) & (points < box[1])).all(1)
        assert not inside.any()
    assert (first[1] <= second[0]).any() or (second[1] <= first[0]).any()


def test_words_cover_no_link_where_another_place_is_free() -> None:
    place = np.array([1.0, 1.0])
    points = place[None]
    free = find_room("5, 6", place, LEFT, Drawn(points, NOTHING, NOTHING, 2.2), [])
    height = free.mean(0)[1]
    link = np.stack([np.linspace(0.2, 1.8, 40), np.full(40, height)], 1)
    low, high = find_room("5, 6", place, LEFT, Drawn(points, link, NOTHING, 2.2), [])
    for corners, is_clear in ((free, False), ((low, high), True)):
        covered = ((link > corners[0]) & (link < corners[1])).all(1).any()
        assert covered != is_clear


@pytest.mark.parametrize("away", [[0.0, 1.0], [0.0, -1.0], [-1.0, 0.0], [0.6, -0.8]])
def test_a_number_stands_at_its_own_joint(away) -> None:
    """Of two joints close together, the number of each is nearer to it, or a line tells whose it is."""
    points = np.array([[1.0, 1.0], [1.0, 1.19]])
    steps = np.linspace(0.6, 2.0, 60)
    link = np.stack([np.ones(60), steps], 1)
    drawn = Drawn(points, link, NOTHING, 2.2)
    for own, other in (points, points[::-1]):
        box = find_room("2", own, np.array(away), drawn, [])
        gaps = [np.linalg.norm(np.clip(place, *box) - place) for place in (own, other)]
        assert gaps[0] < gaps[1] or needs_line(box, own, points)


def test_joints_of_one_spot_share_their_numbers_and_others_have_their_own() -> None:
    arm = ArmRecord.model_validate(UPRIGHT)
    words = {word: y for word, _, y in read_words(draw_frames(arm))}
    assert set("123456") <= set(words)
    assert words["1"] > words["2"] > words["3"]
    origins = [*ROOT, ROOT[-1], ROOT[-1], [-608, -430, 1146]]
    wrist = ArmRecord.model_validate(UPRIGHT | {"origins_mm": origins})
    assert "4, 5, 6" in [word for word, _, _ in read_words(draw_frames(wrist))]


def test_a_line_leads_from_a_number_that_stands_away() -> None:
    points = np.array([[1.0, 1.0]])
    near, far = (np.array([[x, 0.95], [x + 0.1, 1.05]]) for x in (1.1, 1.3))
    assert not needs_line(near, points[0], points)
    assert needs_line(far, points[0], points)


def test_names_of_axes_seen_in_one_direction_stand_apart() -> None:
    turned = [[1.0, 0.0, 0.0], [0.0, 1.0, 1.0], [0.0, 0.1, 0.12]]
    arm = ArmRecord.model_validate(UPRIGHT | {"axes": [turned] * 8})
    letters = [one for one in read_words(draw_frames(arm)) if one[0] in ("x", "y", "z")]
    places = np.array([(x, y) for _, x, y in letters])
    for k, place in enumerate(places):
        gaps = np.linalg.norm(np.delete(places, k, axis=0) - place, axis=1)
        assert gaps.min() > 5


@pytest.mark.parametrize("frames", leave_to_slow((4, 8, 9, 10, 13), 4, 8, 13))
def test_names_of_all_frames_are_whole_and_apart_from_axes(frames) -> None:
    along = np.arange(frames + 1.0)
    origins = np.stack([100 * along, 0 * along, 50 * np.sin(along)], 1)
    values = {"origins_mm": origins.tolist(), "axes": [np.eye(3).tolist()] * (frames + 1)}
    picture = draw_frames(ArmRecord.model_validate(values | {"slides": [False] * (frames - 1)}))
    height = float(re.search(rb'height="([0-9.]+)pt"', picture)[1])
    words = read_words(picture)
    names = [(x, y) for name, x, y in words if name.startswith("frame ")]
    letters = [(x, y) for name, x, y in words if name in ("x", "y", "z")]
    assert len(names) == frames - 1
    assert all(6 < y < height for _, y in names + letters)
    for x, y in names:
        assert all(abs(y - other) > 7 or abs(x - at) > 20 for at, other in letters)


def test_numbers_of_a_joint_that_slides_stand_apart(drawn) -> None:
    details = read_source(drawn).details
    slide = details.joints[0].model_copy(update={"unit": "mm", "limits": None})
    rows = details.rows.q
    moved = [[300.0 * k / len(rows), *row[1:]] for k, row in enumerate(rows)]
    joints = [slide, *details.joints[1:]]
    changed = {"joints": joints, "rows": details.rows.model_copy(update={"q": moved})}
    words = read_words(draw_joints(details.model_copy(update=changed)))
    places = sorted(x for name, x, _ in words if name.endswith(" mm"))
    assert len(places) >= 3
    assert min(np.diff(places)) > 30


def test_a_short_logarithmic_axis_has_several_numbers() -> None:
    assert choose_ticks(0.7, 9.0) == [1.0, 2.0, 5.0]
    assert choose_ticks(0.02, 11.0) == [0.1, 1.0, 10.0]


def test_ladder_s_figures_are_those_of_the_verdict(drawn) -> None:
    record = read_source(drawn).record
    words = [word for word, _, _ in read_words(draw_ladder(record))]
    chosen = format_figure(record.ladder[-1].held_out.rms_mm)
    assert chosen in words
    assert f"to {chosen} mm rms" in record.verdict[0]


def test_long_words_end_between_two_words_or_with_their_clause() -> None:
    sentence = "Joint 3 steps where its torque changes sign: play would yield to it"
    assert shorten_clause(sentence, 80) == sentence
    assert shorten_clause(sentence, 50) == "Joint 3 steps where its torque changes sign"
    assert shorten(sentence, 60) == "Joint 3 steps where its torque changes sign: play would…"
    assert shorten("encoder-eccentricity:4", 10) == "encoder-e…"


def test_zone_of_noise_has_room_for_its_words(drawn) -> None:
    record = read_source(drawn).record
    scale = _scale(record.ladder, record.noise_floor)
    assert scale.noise / scale.low >= 3


def test_legend_of_the_ladder_covers_no_figure(drawn) -> None:
    """It stands above all rungs."""
    record = read_source(drawn).record
    words = read_words(draw_ladder(record))
    (legend,) = [y for word, _, y in words if word == "held-out configurations"]
    errors = [format_figure(rung.held_out.rms_mm) for rung in record.ladder]
    figures = [y for word, _, y in words if word in errors]
    assert figures
    assert legend < min(figures) - 8


@pytest.mark.parametrize("high", [0.5, 5.0, 500.0])
def test_zone_of_noise_is_as_wide_as_its_words_on_any_axis(drawn, high) -> None:
    record = read_source(drawn).record
    worst = record.ladder[0].held_out.model_copy(update={"rms_mm": high})
    rungs = [record.ladder[0].model_copy(update={"held_out": worst}), *record.ladder[1:]]
    scale = _scale(rungs, record.noise_floor)
    share = np.log(scale.noise / scale.low) / np.log(scale.high / scale.low)
    assert share > 0.2


def test_numbers_of_frames_stand_clear_of_marks() -> None:
    origins = [[0, 0, 0], [0, 0, 0], [180, 2, 450], [634, 8, 872], [703, 8, 945], [1184, 14, 494]]
    origins += [[1184, 14, 494], [1420, 107, 535]]
    values = {"origins_mm": origins, "axes": [np.eye(3).tolist()] * 8, "slides": [False] * 6}
    marks = [("11", "one", [2]), ("12", "two", [5])]
    words = read_words(draw_marked(ArmRecord.model_validate(values), marks))
    numbers = [(x, y) for word, x, y in words if re.fullmatch("[1-6](, [1-6])*", word)]
    found = [(x, y) for word, x, y in words if word in ("11", "12")]
    assert len(numbers) == 5
    assert all(abs(x - a) > 16 or abs(y - b) > 9 for x, y in numbers for a, b in found)


def test_marks_stand_clear_of_each_other(rng: np.random.Generator) -> None:
    """One group of frames above another had its number over the other's."""
    origins = [[0, 0, 0], [0, 0, 128], [0, 0, 128], [0, 30, 741], [40, 0, 1312], [0, 174, 1312]]
    origins += [[120, 174, 1312], [120, 290, 1400]]
    for _ in range(20):
        moved = (np.array(origins) + rng.normal(0, 60, (8, 3))).tolist()
        values = {"origins_mm": moved, "axes": [np.eye(3).tolist()] * 8, "slides": [False] * 6}
        marks = [("11", "one", [3]), ("12", "two", [4])]
        words = read_words(draw_marked(ArmRecord.model_validate(values), marks))
        # beside the arm, not in the list
        placed = [np.array((x, y)) for word, x, y in words if word in ("11", "12") and x < 200]
        assert len(placed) == 2
        assert np.abs(placed[0] - placed[1]).max() >= 10


def test_ticks_of_a_small_panel_are_few_and_short() -> None:
    for low, high in ((41.1, 42.3), (-0.2004, -0.1993), (0.0, 1.0), (-3e-7, 6e-7), (9.2, 10.3)):
        ticks, labels = parameter_plots.choose_few_ticks(low, high)
        assert 1 <= len(ticks) == len(labels) <= 3
        assert all(low <= tick <= high for tick in ticks)
        shares = [parameter_plots.LETTER_SHARE * len(label) for label in labels]
        apart = np.diff(ticks) / (high - low)
        assert all(room >= max(shares) for room in apart)


def test_draws_are_in_the_units_of_the_table() -> None:
    values = {"low": 4.1e-5, "median": 4.15e-5, "high": 4.2e-5}
    closed = {"closed_form_low": 4.1e-5, "closed_form_high": 4.2e-5, "closed_form_median": 4.1e-5}
    one = QuantilesRecord.model_validate({"name": "c2", "unit": "rad kg/(N m)", **values, **closed})
    factor, unit = _choose_unit(one)
    assert _format_quantiles(one)[-1] == unit == "µrad kg/(N m)"
    draws = np.linspace(4.1e-5, 4.2e-5, 50)[:, None].tolist()
    trace = TraceRecord.model_construct(names=["c2"], draws=draws)
    picture = draw_posterior(trace, {"c2": (factor, unit)}).decode()
    assert "[µrad kg/(N m)]" in picture
    assert ">0.0000" not in picture


def test_residuals_have_a_heading_of_their_own(drawn) -> None:
    blocks = write_residuals_page(read_source(drawn))
    heading, words, panels = blocks[-1]["blocks"]
    assert heading["kind"] == "heading"
    assert heading["text"] == "Residuals against what may drive them"
    assert words["kind"] == "text"
    assert panels["kind"] == "figure"


def test_header_has_one_name_once(drawn) -> None:
    source = read_source(drawn)
    assert fill_template(source, [])["robot"] == source.record.robot
    record = source.record.model_copy(update={"robot": source.record.study})
    assert fill_template(replace(source, record=record), [])["robot"] == ""


def test_labels_of_a_matrix_do_not_overlap() -> None:
    """In points: the matrix is as high as its picture less the longest label below it."""
    most = parameter_plots.MAX_MATRIX
    size = min(5.2, parameter_plots.LABEL_COLUMN / most)
    room = 72 * parameter_plots.HEIGHT - parameter_plots.LONGEST_LABEL * size
    assert 1.1 * size * most < room
