"""The order of a report's sections: those with a large picture change places with the next ones where
a page would stay half empty, or the last one nearly so."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol, TypeVar

from .document import Block

MAX_WHITE = 0.2  # share of a page that may stay white before a section with a large picture
MOVES = (1, -1, 2, -2, 3, -3)  # places by which such a section moves, in the order they are tried
MAX_MOVED = 2  # sections
MAX_TRIED = 16  # orders tried to move one section

Section = list[Block]


class Typeset(Protocol):
    """What a set report tells of its pages: how many, and the white before each large picture."""

    @property
    def pages(self) -> int: ...

    @property
    def white(self) -> Sequence[float]: ...


Set = TypeVar("Set", bound=Typeset)


def split_sections(blocks: Sequence[Block]) -> list[Section]:
    """Return the sections, each from its heading on."""
    sections: list[Section] = []
    for block in blocks:
        if not sections or _opens_section(block):
            sections.append([])
        sections[-1].append(block)
    return sections


def arrange(
    sections: Sequence[Section],
    typeset: Callable[[Sequence[Section]], Set],
    most_pages: int | None = None,
) -> tuple[list[Section], Set]:
    """Return the sections in an order that leaves no page half empty and takes `most_pages`, if there is
    one, and the report set so. The first sections and the last stay where they are."""
    order = list(sections)
    chosen = typeset(order)
    for _ in range(MAX_MOVED):
        if _is_filled(chosen) and (most_pages is None or chosen.pages <= most_pages):
            break
        best = _move_one(order, chosen, typeset, most_pages)
        if best[1] is chosen:
            break
        order, chosen = best
    return order, chosen


def _move_one(
    order: list[Section],
    chosen: Set,
    typeset: Callable[[Sequence[Section]], Set],
    most_pages: int | None,
) -> tuple[list[Section], Set]:
    """Return the best order with one section in another place, or the order as it is."""
    best = order, chosen
    enough = chosen.pages if most_pages is None else most_pages
    moves = _list_moves(order, chosen.white)
    for other in moves[:MAX_TRIED]:
        tried = typeset(other)
        waste = _count_waste(tried)
        least = _count_waste(best[1])
        if waste < least:
            best = other, tried
        if _is_filled(tried) and tried.pages <= enough:
            break
    return best


def _opens_section(block: Block) -> bool:
    """Return whether a block is, or begins with, a heading of the first level."""
    first = block
    if block["kind"] == "together":
        first, *_ = block["blocks"]
    is_heading = first["kind"] == "heading"
    if not is_heading:
        return False
    level = first["level"]
    return bool(level == 1)


def _list_moves(order: list[Section], white: Sequence[float]) -> list[list[Section]]:
    """Return the orders with one section with a large picture in another place: first the one behind the most
    white, then those next to it."""
    large = []
    for place, section in enumerate(order):
        if _is_large(section):
            large.append(place)
    if not large:
        return []
    most = max(white)
    number = list(white).index(most)
    worst = large[number]
    last = len(order) - 1
    places = sorted(large, key=lambda place: abs(place - worst))
    moves = []
    for place in places:
        for move in MOVES:
            new = place + move
            if large[0] <= new < last:
                moved = list(order)
                section = moved.pop(place)
                moved.insert(new, section)
                moves.append(moved)
    return moves


def _is_large(section: Section) -> bool:
    """Return whether a section has a large picture."""
    kinds = []
    for block in section:
        kind = block["kind"]
        kinds.append(kind)
    return "together" in kinds


def _is_filled(report: Typeset) -> bool:
    """Return whether little stays white before each large picture."""
    return _find_white(report) <= MAX_WHITE


def _find_white(report: Typeset) -> float:
    """Return the most white before a large picture."""
    white = report.white
    return max(white, default=0.0)


def _count_waste(report: Typeset) -> float:
    """Return the pages, and the most white within them."""
    white = _find_white(report)
    return report.pages + white
