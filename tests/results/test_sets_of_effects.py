"""What sets of effects have beside that of the findings, in words."""

from __future__ import annotations

from modelsel.results.model_schema import WeighedModelRecord
from modelsel.results.study_sentences import describe_sets


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


def test_where_nothing_was_found_sets_are_told_by_their_names() -> None:
    assert tell(([], True), (["a", "b"], False)) == ["none", "a + b"]
