"""The order of a report's sections: those with a large picture change places with the next ones where
a page would stay half empty."""

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
    sections: Sequence[Section], typeset: Callable[[Sequence[Section]], Set]
) -> tuple[list[Section], Set]:
    """Return the sections in an order that leaves no page half empty, if there is one, and the report set
    so. The first sections and the last stay where they are."""
    order = list(sections)
    chosen = typeset(order)
    for _ in range(MAX_MOVED):
        if max(chosen.white, default=0.0) <= MAX_WHITE:
            break
        best = order, chosen
        for other in _list_moves(order, chosen.white)[:MAX_TRIED]:
            tried = typeset(other)
            if _count_waste(tried) < _count_waste(best[1]):
                best = other, tried
            if max(tried.white) <= MAX_WHITE and tried.pages <= chosen.pages:
                break
        if best[1] is chosen:
            break
        order, chosen = best
    return order, chosen


def _opens_section(block: Block) -> bool:
    """Return whether a block is, or begins with, a heading of the first level."""
    first = block["blocks"][0] if block["kind"] == "together" else block
    return bool(first["kind"] == "heading" and first["level"] == 1)


def _list_moves(order: list[Section], white: Sequence[float]) -> list[list[Section]]:
    """Return the orders with one section with a large picture in another place: first the one behind the most
    white, then those next to it."""
    large = [k for k, section in enumerate(order) if _is_large(section)]
    worst = large[max(range(len(white)), key=lambda k: white[k])]
    moves = []
    for place in sorted(large, key=lambda k: abs(k - worst)):
        section, rest = order[place], order[:place] + order[place + 1 :]
        for new in (place + move for move in MOVES):
            moved = [*rest[:new], section, *rest[new:]]
            if large[0] <= new < len(order) - 1 and moved not in moves:
                moves.append(moved)
    return moves


def _is_large(section: Section) -> bool:
    """Return whether a section has a large picture."""
    return any(block["kind"] == "together" for block in section)


def _count_waste(report: Typeset) -> float:
    """Return the pages, and the largest white within them."""
    return report.pages + max(report.white, default=0.0)
