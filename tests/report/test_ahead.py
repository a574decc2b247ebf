"""Pictures drawn by a second process while this one samples: those that this one would draw."""

from __future__ import annotations

import pytest
from report_studies import read_source

from modelsel._second_process import second_process
from modelsel.report.drawing import (
    PAGES,
    SAMPLED_PAGES,
    UNSAMPLED_PAGES,
    DrawnAhead,
    draw_pictures,
    draw_records,
)


@pytest.mark.slow
def test_sampling_changes_no_picture_of_the_pages_drawn_before_it(drawn) -> None:
    source = read_source(drawn)
    assert source.record.sampling is not None
    unchanged = {"posterior_error": None, "differ": False}
    before = source.record.model_copy(
        update={
            "sampling": None,
            "parameters": [p.model_copy(update=unchanged) for p in source.record.parameters],
        }
    )
    pictures = draw_pictures(before, source.details, UNSAMPLED_PAGES)
    assert pictures == draw_pictures(source.record, source.details, UNSAMPLED_PAGES)
    sampled = draw_pictures(source.record, source.details, SAMPLED_PAGES)
    assert set(sampled) == {"correlation.svg", "posterior.svg"}
    assert {*SAMPLED_PAGES, *UNSAMPLED_PAGES} == set(PAGES)


@pytest.mark.slow
@pytest.mark.parametrize("cores", [1, 2])
def test_the_same_bytes_whoever_draws(drawn, tmp_path, cores) -> None:
    source = read_source(drawn)
    with second_process(cores) as second:
        ahead = DrawnAhead.draw(second, source.record, source.details, UNSAMPLED_PAGES)
        files = draw_records(source.record, source.details, tmp_path, ahead=ahead)
    for file in files:
        assert file.read_bytes() == (drawn / file.name).read_bytes()
