"""What the study file says of the campaign: read, cleaned, printed, and no part of any result."""

from __future__ import annotations

import json

import pytest
from report_studies import source_of, written

from modelsel.config.study_file import Study, parse_study
from modelsel.exceptions import StudyError
from modelsel.report import drawing
from modelsel.report.document import collect_blocks
from modelsel.report.pdf import compile_pdf, fill_template

STUDY = (
    'name = "s"\n[robot]\nname = "puma760"\ntool_mm = [0, 0, 100]\n[measurements]\nfile = "m.csv"\n'
)


def campaign(text: str) -> dict[str, str]:
    return parse_study(f"{STUDY}[campaign]\n{text}", "study.toml").campaign.given


def test_texts_dates_and_numbers_are_taken() -> None:
    given = campaign('date = 2026-11-22\nserial_number = 4711\noperator = "  A. Ärlig "\n')
    assert given == {"date": "2026-11-22", "serial_number": "4711", "operator": "A. Ärlig"}
    assert campaign("") == {}


def test_marks_of_direction_are_stripped() -> None:
    assert campaign('operator = "a\\u202eb\\u200fc"\n') == {"operator": "abc"}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('operator = "two\\nlines"', "U+000A"),
        ('ambient = "bell\\u0007"', "U+0007"),
        ('instrument = "\\u202e"', "no letter"),
        (f'ambient = "{"x" * 201}"', "201 characters"),
        ("ambient = 21.5", "campaign.ambient"),
        ("date = true", "campaign.date"),
        ('operater = "x"', 'Did you mean "operator"?'),
    ],
)
def test_refused_with_the_place(text, said) -> None:
    with pytest.raises(StudyError) as refused:
        campaign(text)
    (problem,) = refused.value.problems
    assert said in problem
    assert "campaign" in problem


def test_a_study_without_it_keeps_its_hash() -> None:
    assert "campaign" not in parse_study(STUDY, "study.toml").model_dump()
    whole = parse_study(f'{STUDY}[campaign]\noperator = "x"\n', "study.toml")
    again = Study(**whole.model_dump(by_alias=True))
    assert again.campaign == whole.campaign


def test_printed_at_the_head_and_nothing_without(drawn) -> None:
    from test_report import plain, texts

    result, details = written(drawn)
    assert details["campaign"] is None
    name = '#panic("x") *A. B.*'
    details["campaign"] = {"date": "2026-11-22", "operator": name}
    source = source_of(result, details)
    blocks = collect_blocks(source, drawing.PAGES, ("first",))
    pdf, warnings = compile_pdf(fill_template(source, blocks), source.pictures)
    assert not warnings
    (first,) = texts(pdf)
    head, _, _ = plain(first).partition("Onheld-out")
    assert f"Date:2026-11-22·Operator:{plain(name)}" in head
    assert "campaign" not in json.dumps(result)
