"""What sets of effects have beside that of the findings, in words."""

from __future__ import annotations

from types import SimpleNamespace

from modelsel.mechanisms.causes import q, sin
from modelsel.mechanisms.terms import Mechanism, Screw, Term
from modelsel.results.record import _name_apart
from modelsel.results.schemas.model_schema import WeighedModelRecord
from modelsel.results.sentences.study_sentences import describe_sets


def tell(*sets: tuple[list[str], bool]) -> list[str]:
    models = [WeighedModelRecord(effects=own, probability=0.1, chosen=c) for own, c in sets]
    return describe_sets(models)


def test_sets_are_told_by_what_they_change_in_the_findings() -> None:
    told = tell(
        (["a", "c"], False),
        (["a", "b"], True),
        (["a", "b", "d"], False),
        (["b"], False),
        (["c", "d"], False),
    )
    assert told == [
        "c in place of b",
        "the findings",
        "the findings + d",
        "the findings without a",
        "c + d in place of a + b",
    ]


def test_an_effect_that_stands_twice_is_told_as_one_more() -> None:
    assert tell((["a"], True), (["a", "a"], False)) == ["the findings", "the findings + a"]


def test_two_waves_with_one_name_are_told_with_their_numbers() -> None:
    """They have one label; numbers of many digits are rounded where people read them."""
    slow, fast, other = (
        SimpleNamespace(label=label, screws={1}, mechanism=wave)
        for label, wave in (
            (
                "gear-ripple:1",
                Mechanism(
                    "slow", (Term("s", (Screw(1, "rz", sin(99.123456 * q(1))),)),), "", "", ""
                ),
            ),
            (
                "gear-ripple:1",
                Mechanism("fast", (Term("s", (Screw(1, "rz", sin(121 * q(1))),)),), "", "", ""),
            ),
            ("settle:1", Mechanism("settle", (Term("s", (Screw(1, "rz", q(1)),)),), "", "", "")),
        )
    )
    names = _name_apart([slow, slow, fast, other])
    assert names[other.mechanism] == "settle:1"
    first, second = names[slow.mechanism], names[fast.mechanism]
    assert first != second
    told = tell(([first], True), ([first, second], False), ([second], False))
    assert told == [
        "the findings",
        "the findings + gear-ripple:1, sin(121*q1)",
        "gear-ripple:1, sin(121*q1) in place of gear-ripple:1, sin(99.12*q1)",
    ]


def test_where_nothing_was_found_sets_are_told_by_their_names() -> None:
    assert tell(([], True), (["a", "b"], False)) == ["none", "a + b"]
