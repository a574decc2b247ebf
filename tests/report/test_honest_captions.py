"""Captions say what their figures are: the zone of noise, scales of noise, a joint's own motion."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from report_studies import read_source, source_of, written

from modelsel.report.figures.ladder import draw_ladder
from modelsel.report.pages.front import describe_own_motion, describe_zone, write_first_page
from modelsel.report.pages.parameter_uncertainty import _write_quantiles
from modelsel.results.schemas.model_schema import QuantilesRecord

SLIDE, TURN = SimpleNamespace(unit="mm"), SimpleNamespace(unit="rad")


@pytest.mark.parametrize(
    ("joints", "words"),
    [
        ([TURN] * 3, "rz of frames 1 to n is the joint's own rotation"),
        ([SLIDE] * 3, "tz of frames 1 to n is the joint's own shift"),
        (
            [SLIDE, TURN, TURN],
            "rz of frames 2 and 3 is the joint's own rotation, tz of frame 1 its own shift",
        ),
    ],
)
def test_a_slide_moves_along_its_axis(joints, words) -> None:
    assert describe_own_motion(SimpleNamespace(joints=joints)) == words


@pytest.mark.parametrize(
    ("source", "codes", "words"),
    [
        ("estimated", [], "nothing is left but what seems not to repeat, of the instrument and"),
        ("stated", ["stated-uncertainty"], "as it is stated. What is stated is doubted: see"),
        ("repeats", [], "what differs between repeats of one posture."),
    ],
)
def test_the_grey_zone_is_what_its_source_makes_it(source, codes, words) -> None:
    notes = [SimpleNamespace(code=code) for code in codes]
    record = SimpleNamespace(noise_floor=SimpleNamespace(source=source), warnings=notes)
    assert words in describe_zone(record)


@pytest.mark.parametrize(("parts", "words"), [(1, "standard deviation of one"), (3, "far below")])
def test_a_scale_of_noise_beside_other_parts_is_not_the_floor(parts, words) -> None:
    one = QuantilesRecord(
        name="noise scale",
        unit="mm",
        low=0.08,
        median=0.09,
        high=0.1,
        closed_form_low=None,
        closed_form_median=None,
        closed_form_high=None,
    )
    floor = SimpleNamespace(source="estimated")
    record = SimpleNamespace(repeatability=[None] * parts, noise_floor=floor)
    (table,) = _write_quantiles([one], record)
    assert words in table["caption"]
    (other,) = _write_quantiles([one.model_copy(update={"name": "r1"})], record)
    assert "Noise" not in other["caption"]


@pytest.mark.parametrize(
    ("source", "said", "words"),
    [
        ("repeats", "of the estimated", "of the noise floor"),
        ("target pairs", "of the estimated", "of the noise floor"),
        ("estimated", "of the estimated", "of the assumed noise"),
        ("stated", "of the stated", "of the stated noise"),
        ("instrument", "of the estimated", "of the stated noise"),
        ("estimated", "mm", "mm"),
    ],
)
def test_a_multiple_of_a_noise_says_of_which(source, said, words) -> None:
    values = {"low": 0.26, "median": 0.29, "high": 0.31}
    forms = dict.fromkeys(("closed_form_low", "closed_form_median", "closed_form_high"))
    one = QuantilesRecord(name="noise scale", unit=said, **values, **forms)
    floor = SimpleNamespace(source=source)
    record = SimpleNamespace(repeatability=[], noise_floor=floor)
    (table,) = _write_quantiles([one], record)
    assert table["rows"][0][-1] == words


@pytest.mark.slow
def test_the_ladder_s_caption_calls_no_base_a_finding(drawn) -> None:
    first = write_first_page(read_source(drawn))
    (caption,) = [block["caption"] for block in first if block.get("file") == "ladder.svg"]
    assert "A row that begins with + adds to the row above it; in the grey zone" in caption


@pytest.mark.slow
def test_the_ladder_names_its_zone_by_the_source_of_the_floor(drawn) -> None:
    result, details = written(drawn)
    pictures = []
    for source in ("estimated", "stated", "repeats"):
        result["noise_floor"]["source"] = source
        pictures.append(draw_ladder(source_of(result, details).record))
    assert len(set(pictures)) == 3
