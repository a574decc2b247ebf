"""What a plan says of rivals, by hand."""

from __future__ import annotations

from modelsel.study.planning.rival_sentences import describe_rivals


def test_rivals_of_one_name_are_counted() -> None:
    """A set of one name would be no set of rivals: they differ in their constants."""
    said = describe_rivals([("a", "a", "a"), ("b", "c", "b")], (0.4, 0.8), None, 5, False)
    assert said.startswith("Rivals: a with 3 constants; b or c. ")
