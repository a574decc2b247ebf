"""Words in pictures: whole, on no frame and on no other words; a name stands once in a header."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from modelsel.report.drawing import read_source
from modelsel.report.figures import parameter_plots
from modelsel.report.figures.arm import find_room
from modelsel.report.figures.ladder import _scale
from modelsel.report.pages.parameter_uncertainty import write_residuals_page
from modelsel.report.pdf import fill_template

LEFT = np.array([-1.0, 0.2])


@pytest.mark.parametrize("x", [0.15, 0.34, 2.0])
def test_target_at_the_edge_is_whole_and_on_no_frame(x) -> None:
    place = np.array([x, 1.0])
    points = np.array([place, place + np.array([0.25, 0.05]), place + np.array([-0.05, 0.2])])
    first = find_room("5 6", points[1], LEFT, points, [])
    second = find_room("target", place, LEFT, points, [first])
    for box in (first, second):
        assert box.min() > 0
        inside = ((points > box[0]) & (points < box[1])).all(1)
        assert not inside.any()
    assert (first[1] <= second[0]).any() or (second[1] <= first[0]).any()


def test_zone_of_noise_has_room_for_its_words(drawn) -> None:
    record = read_source(drawn).record
    scale = _scale(record.ladder, record.noise_floor)
    assert scale.noise / scale.low >= 3


def test_residuals_have_a_heading_of_their_own(drawn) -> None:
    blocks = write_residuals_page(read_source(drawn))
    *_, heading, words, panels = blocks
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
