"""The verdict in three sentences, by hand."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from modelsel.fitting.noise import Floor
from modelsel.results.verdict import Named, NamedErrors, write_verdict
from modelsel.selection.gain import Gain

FLOOR = Floor(0.03, "repeats", 100)
GAIN = Gain(2.0, 1.0, (0.9, 1.1))
NONE = "the study adds none of them to the model."
LEFT = "Nothing else was found; an effect above 0.02 mm rms would have been found with 90 %. The strongest left is weak."


def rung(rms: float | None) -> SimpleNamespace:
    return SimpleNamespace(estimation=SimpleNamespace(rms_mm=rms))


def said(
    named: list[tuple], gain: Gain = GAIN, asked: list[str] | str = "all"
) -> tuple[str, str, str]:
    errors = NamedErrors([Named(*one) for one in named], 0.0213)
    return write_verdict(rung(3.0), rung(0.5), gain, FLOOR, errors, asked, LEFT)


def test_three_sentences() -> None:
    first, second, third = said([("gravity-twist", "found")])
    assert first == (
        "On held-out configurations the position error falls from 2 to 1 mm rms, a gain of 0.9 to 1.1 mm (95 %); "
        "noise of 0.03 mm per coordinate (repeats) would leave 0.052 mm."
    )
    assert second == "One error was named beyond the base: gravity-twist."
    assert (
        third
        == "Nothing else was found; an effect above 0.02 mm rms would have been found with 90 %."
    )


@pytest.mark.parametrize(
    ("gain", "words"),
    [
        (
            Gain(1.0, 1.2, None),
            "the position error does not fall: it goes from 1 to 1.2 mm rms; noise",
        ),
        (
            Gain(None, None, None),
            "Nothing is held out: on the configurations that made the model its position error goes from 3 to",
        ),
    ],
)
def test_bad_news_is_said(gain, words) -> None:
    assert words in said([], gain)[0]


@pytest.mark.parametrize(
    ("named", "asked", "sentence"),
    [
        ([], "all", "No error beyond the base model was named."),
        (
            [("a", "cannot be told apart")],
            "all",
            "One error was named beyond the base: a; it has rivals that the data cannot tell from it.",
        ),
        (
            [("a", "found"), ("b", "cannot be told apart")],
            [],
            "Two errors were named beyond the base: a and b; 1 of them has rivals that the data cannot tell apart; "
            + NONE,
        ),
        (
            [("a", "found")],
            ["a", "b"],
            "One error was named beyond the base: a. Only a and b could be named: no other cause was considered.",
        ),
        (
            [],
            ["a"],
            "No error beyond the base model was named. Only a could be named: no other cause was considered.",
        ),
        (
            [(name, "found") for name in "abcdefgaa"],
            "all",
            "Nine errors were named beyond the base: a, b, c, d, e, f and g.",
        ),
        (
            [(name, "found") for name in "abcdefghgh"],
            "all",
            "Ten errors were named beyond the base: a, b, c, d, e, f and 4 more.",
        ),
    ],
)
def test_what_was_named(named, asked, sentence) -> None:
    """Names that come twice are written once; those written and the rest add up."""
    assert said(named, asked=asked)[1] == sentence


def test_small_findings_are_told_by_their_sum() -> None:
    """Three or more; fewer are named."""
    big = ("a", "found", True, False)
    small = [(name, "found", False, name == "d") for name in "bcd"]
    assert said([big, *small])[1] == (
        "Four errors were named beyond the base: a, and 3 smaller ones, 0.0213 mm rms together."
    )
    assert said(small)[1] == (
        "Three errors were named beyond the base: 3 smaller ones, 0.0213 mm rms together."
    )
    assert said([big, *small[1:]])[1] == (
        "Three errors were named beyond the base: a, c and d (doubtful)."
    )
