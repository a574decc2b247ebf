"""Rows of a table by the names that stand in them, for a person."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any

from ..._typing import Index
from .columns import find_blank_cells

MAX_LISTED = 12
UNNAMED = "a row without a name"
LETTER = re.compile(r"[^\W\d_]")


def label_rows(columns: Iterable[Any], rows: Index) -> str:
    """List the names of rows by the columns of names that are not the same all through, the others
    in brackets after the first; a name that stands in several rows once. Empty where there are
    none."""
    telling = []
    for cells in columns:
        is_blank = find_blank_cells(cells)
        texts = [str(cell).strip() for cell in cells]
        texts = [UNNAMED if blank else text for text, blank in zip(texts, is_blank, strict=True)]
        has_letters = all(map(LETTER.search, texts))
        if has_letters and len(set(texts)) > 1:
            telling.append(texts)
    if not telling:
        return ""
    labels = Counter(_label_row(telling, row) for row in rows.tolist())
    listed = [f"{name} ({count} times)" if count > 1 else name for name, count in labels.items()]
    ellipsis = " …" if len(listed) > MAX_LISTED else ""
    return ", ".join(listed[:MAX_LISTED]) + ellipsis


def _label_row(telling: Sequence[Sequence[str]], row: int) -> str:
    """Label a row by columns of names, the one with most different names first: P007 (robot)."""
    ordered = sorted(telling, key=_count_different, reverse=True)
    own = [texts[row] for texts in ordered]
    first, *others = own
    if not others:
        return first
    listed = ", ".join(others)
    return f"{first} ({listed})"


def _count_different(texts: Sequence[str]) -> int:
    different = set(texts)
    return len(different)
