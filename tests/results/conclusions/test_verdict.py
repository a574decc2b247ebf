"""The verdict in three sentences, by hand."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from error_parts import part

from modelsel.diagnosis.findings import claim_sentences
from modelsel.fitting.error_structure import ErrorStructure
from modelsel.fitting.noise import Floor
from modelsel.results.conclusions.verdict import (
    Named,
    NamedErrors,
    Noise,
    complete_verdict,
    write_verdict,
)
from modelsel.results.repeatability.repeatability import measure_unrepeated
from modelsel.selection.gain import Gain

FLOOR = Floor(0.03, "repeats", 100)
GAIN = Gain(2.0, 1.0, (0.9, 1.1))
NONE = "The study adds none of them to the model."
LEFT = "Nothing else was found; an effect above 0.02 mm rms would have been found with 90 %. The strongest left is weak."


def rung(rms: float | None) -> SimpleNamespace:
    return SimpleNamespace(estimation=SimpleNamespace(rms_mm=rms))


def said(
    named: list[tuple],
    gain: Gain = GAIN,
    asked: list[str] | str = "all",
    small: tuple[float, float | None] = (0.0213, None),
) -> tuple[str, str, str]:
    errors = NamedErrors([Named(*one) for one in named], *small)
    return write_verdict(rung(3.0), rung(0.5), gain, Noise(FLOOR), errors, asked, LEFT)


def test_three_sentences() -> None:
    first, second, third = said([("gravity-twist", True)])
    assert first == (
        "On held-out configurations the position error falls from 2.00 to 1.00 mm rms, a gain of 0.900 to 1.10 mm (95 %); "
        "noise of 0.0300 mm per coordinate (repeats) would leave 0.0520 mm."
    )
    assert second == "One error beyond the base model was named: gravity-twist."
    assert (
        third
        == "Nothing else was found; an effect above 0.02 mm rms would have been found with 90 %."
    )


def test_a_fault_of_the_data_is_no_error_of_the_arm() -> None:
    fault = ("fault:row-order", True)
    found = "One fault of the data was found: fault:row-order."
    assert said([fault])[1] == f"{found} No error beyond the base model was named."
    assert said([fault, ("backlash:3", True)], asked=[])[1] == (
        f"{found} One error beyond the base model was named: backlash:3. The study does not add it to the model."
    )


def test_what_else_is_not_explained_is_left_too() -> None:
    """Rows of one posture share an error that its repeats do not show; a joint's part they do."""
    shared = part("configuration", 0.04, 0.03, 0.05, told_by="repeats", at_target=0.06)
    loose = part("joint 2", 2e-4, 1e-4, 3e-4, told_by="repeats", at_target=0.09)
    errors = ErrorStructure((part("instrument", 0.03, 0.02, 0.04), shared, loose))
    assert measure_unrepeated(errors, FLOOR) == pytest.approx(0.06)
    assert measure_unrepeated(errors, Floor(0.03, "stated")) == pytest.approx(np.hypot(0.06, 0.09))
    assert measure_unrepeated(errors, Floor(0.03, "estimated", 100)) == 0
    depth = part("instrument z", 0.07, 0.06, 0.08, told_by="directions", at_target=0.07)
    deeper = ErrorStructure((*errors.parts, depth))
    # a floor holds what every row has by itself
    for one in (Floor(0.03, "target pairs", 40), Floor(0.03, "stated"), Floor(0.03, "instrument")):
        assert measure_unrepeated(deeper, one) == pytest.approx(np.hypot(0.06, 0.09))
    for noise, words in (
        (
            Noise(FLOOR, 0.06),
            "would leave 0.0520 mm, and with what else is not explained 0.0794 mm.",
        ),
        (Noise(FLOOR, 0.01), "would leave 0.0520 mm."),
        (Noise(FLOOR, 0.01, 0.02), "would leave 0.0520 mm."),
        (
            Noise(FLOOR, 0.0, 0.06),
            "would leave 0.0520 mm, and with the uncertainty of the model 0.0794 mm.",
        ),
        (
            Noise(FLOOR, 0.06, 0.06),
            "would leave 0.0520 mm, and with what else is not explained and the uncertainty of the model 0.0995 mm.",
        ),
    ):
        none = NamedErrors([])
        first = write_verdict(rung(3.0), rung(0.5), GAIN, noise, none, "all", LEFT)[0]
        assert first.endswith(words)


@pytest.mark.parametrize(
    ("gain", "words"),
    [
        (
            Gain(1.0, 1.2, None),
            "the position error does not fall: it goes from 1.00 to 1.20 mm rms; noise",
        ),
        (
            Gain(None, None, None),
            "Nothing is held out: on the configurations that made the model its position error goes from 3.00 to",
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
            [("a", False, True, False, ("b", "c"))],
            "all",
            "One error beyond the base model was found, but its cause is not proven: it is best described by a, b or c.",
        ),
        (
            [("a", False, True, False, ("b", "c"), ("c",))],
            "all",
            "One error beyond the base model was found, but its cause is not proven: it is best described by c, a or b.",
        ),
        (
            [("a", True)],
            [],
            "One error beyond the base model was named: a. The study does not add it to the model.",
        ),
        (
            [("a", True), ("b", False)],
            [],
            "One error beyond the base model was named: a. One more was found, but its cause is not proven: it is best described by b. "
            + NONE,
        ),
        (
            [("a", True), ("b", False, True, True, ("c",)), ("c", False, True, False, ("d",))],
            "all",
            "One error beyond the base model was named: a. Two more were found, but their causes are not proven: they are best described by b or c (doubtful); c or d.",
        ),
        (
            [("a", True), ("b does c", True, True, False, (), (), False)],
            "all",
            "One error beyond the base model was named: a. One more was found whose cause is not known to any registered mechanism: b does c.",
        ),
        (
            [("a", True, True, False, (), (), False), ("b", True, True, True, (), (), False)],
            "all",
            "Two errors beyond the base model were found whose causes are not known to any registered mechanism: a; b (doubtful).",
        ),
        (
            [("a", False, True, True, ("b",))],
            "all",
            "One error beyond the base model may be there, but its cause is not proven: it is best described by a or b (doubtful).",
        ),
        (
            [("a", True), ("b", True, True, True, (), (), False)],
            "all",
            "One error beyond the base model was named: a. One more may be there whose cause is not known to any registered mechanism: b (doubtful).",
        ),
        (
            [("a", True)],
            ["a", "b"],
            "One error beyond the base model was named: a. Only a and b could be named: no other cause was considered, and an error that has one may seem not to repeat.",
        ),
        (
            [],
            ["a"],
            "No error beyond the base model was named. Only a could be named: no other cause was considered, and an error that has one may seem not to repeat.",
        ),
        (
            [(name, True) for name in "abcdefgaa"],
            "all",
            "Nine errors beyond the base model were named: a, b, c, d, e, f and g.",
        ),
        (
            [(name, True) for name in "abcdefghgh"],
            "all",
            "Ten errors beyond the base model were named: a, b, c, d, e, f and 4 more.",
        ),
    ],
)
def test_what_was_named(named, asked, sentence) -> None:
    """Only settled names count as named; names that come twice are written once; those written and the
    rest add up."""
    assert said(named, asked=asked)[1] == sentence


def test_what_nominal_means_is_said_where_anything_was_registered() -> None:
    three = said([("gravity-twist", True)])
    assert complete_verdict(three, None, None) == three
    gained, *_ = complete_verdict(three, (2e-3, 1e-3), None, "its base and the target")
    assert gained == (
        f"{three[0]} The nominal robot's error is what is left after its base and the target were registered. "
        "The orientation error falls from 2.00 mrad to 1.00 mrad rms."
    )


@pytest.mark.parametrize(
    ("small", "words"),
    [
        ((0.02, 0.4), "move the target by 0.0200 mm rms and turn it by 0.400 mrad rms."),
        ((0.0, 0.4), "turn the target by 0.400 mrad rms."),
    ],
)
def test_small_findings_that_turn_the_target_say_how_far(small, words) -> None:
    named = [(name, True, False) for name in "bcd"]
    assert (
        said(named, small=small)[1] == f"Three small errors beyond the base model together {words}"
    )


@pytest.mark.parametrize(
    ("named", "words"),
    [
        (["free(q1)", "free(q2)"], "Here free(q1) is a free function of q1"),
        (["a", "frame 3 rz · free(q2, q3)"], "Here free(q2, q3) is a free function of q2 and q3"),
    ],
)
def test_the_first_free_function_is_explained(named: list[str], words: str) -> None:
    second = said([(name, True) for name in named])[1]
    assert second.endswith(f"{named[-1]}. {words}: its shape is fitted to the data.")


def test_small_findings_are_told_by_their_sum() -> None:
    """Three or more; fewer are named."""
    big = ("a", True, True, False)
    small = [(name, True, False, name == "d") for name in "bcd"]
    sums = "together move the target by 0.0213 mm rms."
    assert said([big, *small])[1] == (
        f"One error beyond the base model was named: a. Three smaller ones {sums}"
    )
    assert said(small)[1] == f"Three small errors beyond the base model {sums}"
    assert said([big, *small[1:]])[1] == (
        "Three errors beyond the base model were named: a, c and d (doubtful)."
    )


@pytest.mark.parametrize(
    ("faults", "errors", "words"),
    [
        (1, 3, "Four smaller ones, a fault among them, together move"),
        (2, 1, "Three smaller ones, two faults among them, together move"),
        (0, 3, "Three smaller ones together move"),
    ],
)
def test_small_faults_count_where_they_are_in_the_sum(faults, errors, words) -> None:
    """The sum has them, and so has the number; those that matter stand by themselves."""
    names = [f"fault:{k}" for k in range(faults)] + [f"e{k}" for k in range(errors)]
    small = [(name, True, False) for name in names]
    second = said([("fault:big", True), ("a", True), *small])[1]
    assert second.endswith(f"{words} the target by 0.0213 mm rms.")
    assert all(name in second for name in names[:faults])


@pytest.mark.parametrize(
    ("verdict", "levels", "registered", "settled"),
    [
        ("found", (1.0, 1.0, 1.0, 0.97), True, True),
        ("found", (0.54, 0.53, 0.53, 0.53), True, False),
        ("found", (0.99, 0.99, 0.89, 0.89), True, False),
        ("cannot be told apart", (1.0, 1.0, 1.0, 0.97), True, False),
        ("found", (1.0, 1.0, 0.99, 0.0), False, True),
        ("found", (1.0, 1.0, 0.5, 0.0), False, False),
        ("found", None, True, True),
    ],
)
def test_settled_is_what_holds_together_and_is_proven(
    monkeypatch, verdict, levels, registered, settled
) -> None:
    monkeypatch.setattr(claim_sentences, "has_contrary_signs", lambda *_: False)
    claim = None if levels is None else SimpleNamespace(levels=levels)
    candidate = SimpleNamespace(registered=registered, mechanism=None)
    named = SimpleNamespace(verdict=verdict)
    effect = SimpleNamespace(named=named, claim=claim, candidate=candidate, estimate=None)
    assert claim_sentences.is_settled(effect) is settled
