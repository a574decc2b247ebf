"""benchmarks.naming: cases of several effects at once, how they are drawn and counted."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
if not (ROOT / "benchmarks").is_dir():
    pytest.skip("a source distribution has no benchmarks", allow_module_level=True)
sys.path.append(str(ROOT))

from benchmarks.cases import draw  # noqa: E402
from benchmarks.summary import of_fives, summary, text  # noqa: E402

pytestmark = pytest.mark.unit


def case(count: int, right: list[bool], power: float = 1.0, extra: int = 0) -> dict[str, Any]:
    """A case of some effects, as `score.run` keeps it."""
    each: dict[str, Any] = {
        "found": [True] * count,
        "right": right,
        "covered": [True] * count,
        "told": [True] * count,
        "set": [1] * count,
        "said": ["" if r else "encoder-scale:1" for r in right],
    }
    return {
        "seed": [7, 0],
        "m": 120,
        "kinds": ["backlash"] * count,
        "sizes": [1.0] * count,
        "power": [power] * count,
        "best": [1.0] * count,
        "limit": [0.99] * count,
        "twins": [1] * count,
        "oracle_error": 0.01,
        "noise": 0.06,
        "seconds": {"modelsel": 1.0, "BIC": 1.0},
        "methods": {"modelsel": {**each, "findings": count + extra, "extra": extra, "error": 0.01}},
    }


def test_a_case_has_the_configurations_and_effects_that_are_asked_for() -> None:
    five = draw([7, 30_000], 5, 120)
    assert five.state.m == 120
    assert len(five.effects) == 5
    assert len({effect.words for effect in five.effects}) == 5
    assert draw([7, 30_000], 1).state.m in (40, 80, 200)


def test_five_at_once_are_right_only_together_and_where_the_oracle_finds_each() -> None:
    whole, missed = case(5, [True] * 5), case(5, [True] * 4 + [False], extra=1)
    too_small = case(5, [False] * 5, power=0.5)
    figures = of_fives([whole, missed, too_small])
    together = figures["five at once, all named right"]
    assert (together["hits"], together["of"]) == (1, 2)
    each = figures["five at once, each where the oracle finds 99 %"]
    assert (each["hits"], each["of"]) == (9, 10)
    assert figures["five at once, cases with a surplus finding"]["hits"] == 1


def test_cases_of_five_stand_apart_from_the_other_figures() -> None:
    others = [case(3, [True] * 3), case(3, [True, True, False]), case(0, [])]
    alone = summary(others)
    both = summary([*others, case(5, [False] * 5)])
    for name, figure in alone["figures"].items():
        assert repr(both["figures"][name]) == repr(figure)
    assert both["fives"] == 1
    assert both["kinds"] == alone["kinds"]
    shown = text(both, 7)
    assert "Five at once: 1 cases of 120 configurations." in shown
    assert "five at once, all named right: 0.000 [0.000, 0.975] (0 of 1)" in shown
    assert "encoder-scale:1 5" in shown.rpartition("Of five at once")[2]
