"""JSON texts of long lists of numbers: the same bytes as of each number by itself."""

from __future__ import annotations

import json

import numpy as np

from modelsel._json import LONG_LIST, plain_text, to_plain


def numbers(rng: np.random.Generator) -> np.ndarray:
    """Numbers of all sizes, and zeros of either sign."""
    values = rng.normal(size=2 * LONG_LIST) * 10.0 ** rng.integers(-300, 300, 2 * LONG_LIST)
    values[:4] = 0.0, -0.0, 1.0, 1e16
    return values


def test_arrays_are_rounded_as_their_numbers_are(rng) -> None:
    values = numbers(rng)
    alone = [to_plain(value) for value in values.tolist()]
    assert list(map(repr, to_plain(values))) == list(map(repr, alone))
    values[7] = np.nan
    assert to_plain(values)[6:8] == [alone[6], None]
    assert to_plain(np.zeros(0)) == []


def test_whole_numbers_and_flags_stay_what_they_are() -> None:
    rows = np.arange(3)
    assert list(map(repr, to_plain(rows))) == ["0", "1", "2"]
    assert list(map(repr, to_plain([True, np.int64(2), 3]))) == ["True", "2", "3"]


def test_long_lists_stand_as_json_has_them(rng) -> None:
    values = to_plain(numbers(rng))
    mixed = [*values, None, 3]
    content = {
        "screws": [{"values": values, "frame": 3}, {"values": values[:LONG_LIST], "cause": "é"}],
        "short": values[:3],
        "mixed": mixed,
        "whole": list(range(LONG_LIST)),
        "both": [*values, 3],
        "flags": [True, False] * LONG_LIST,
        "mark": "0",
        "like a mark": "\\u00000",
        "none": {},
    }
    text = json.dumps(content, ensure_ascii=False, indent=1, allow_nan=False)
    assert plain_text(content) == text + "\n"
