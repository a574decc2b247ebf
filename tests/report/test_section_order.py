"""Sections with a large picture change places where a page would stay half empty."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil

from modelsel.report.document import keep_together, make_heading, make_text
from modelsel.report.section_order import MAX_WHITE, arrange, split_sections

HEIGHTS = {"first": 0.5, "map": 0.7, "list": 0.4, "data": 0.3, "last": 0.2}  # pages
LARGE = ("map", "data")


@dataclass(frozen=True)
class Set:
    pages: int
    white: tuple[float, ...]


def make_sections():
    blocks = []
    for name in HEIGHTS:
        heading, words = make_heading(name), make_text("words")
        blocks += [keep_together([heading, words])] if name in LARGE else [heading, words]
    return split_sections(blocks)


def name_section(section):
    first = section[0]
    return (first["blocks"][0] if first["kind"] == "together" else first)["text"]


def typeset(sections, heights=HEIGHTS):
    """Fill pages as a typesetter does: what is large stands on one page."""
    filled, white = 0.0, []
    for name in map(name_section, sections):
        rest = ceil(filled + 1e-9) - filled
        moves = name in LARGE and heights[name] > rest
        white += [rest if moves else 0.0] if name in LARGE else []
        filled += heights[name] + (rest if moves else 0.0)
    return Set(ceil(filled), tuple(white))


def test_sections_begin_with_their_headings() -> None:
    assert [name_section(section) for section in make_sections()] == list(HEIGHTS)


def test_another_section_fills_the_page_before_a_large_picture() -> None:
    sections = make_sections()
    before = typeset(sections)
    assert max(before.white) > MAX_WHITE
    order, after = arrange(sections, typeset)
    names = [name_section(section) for section in order]
    assert max(after.white) <= MAX_WHITE
    assert after.pages <= before.pages
    assert (names[0], names[-1]) == ("first", "last")
    assert sorted(names) == sorted(HEIGHTS)


def test_the_last_page_is_spared_where_that_is_wanted() -> None:
    """Nothing moves for white of less than a fifth of a page, until the last page is to be spared."""
    heights = {"first": 0.85, "map": 0.6, "list": 0.1, "data": 0.15, "last": 0.2}

    def fill(sections):
        return typeset(sections, heights)

    sections = make_sections()
    order, before = arrange(sections, fill)
    assert order == sections
    assert before.pages == 3
    assert max(before.white) <= MAX_WHITE
    order, after = arrange(sections, fill, before.pages - 1)
    assert after.pages == 2
    names = [name_section(section) for section in order]
    assert (names[0], names[-1]) == ("first", "last")
    assert sorted(names) == sorted(HEIGHTS)


def test_nothing_moves_where_no_page_is_half_empty() -> None:
    first, *_, last = make_sections()
    tried = []
    order, _ = arrange([first, last], lambda one: tried.append(one) or typeset(one))
    assert order == [first, last]
    assert len(tried) == 1
