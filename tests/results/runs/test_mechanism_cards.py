"""Cards of mechanisms: one of each that a finding is fitted as, also where two share a name."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from report_studies import read_source, source_of, written

from modelsel.mechanisms.environment import tracker_bumped
from modelsel.mechanisms.registry import build_mechanisms, mechanism
from modelsel.mechanisms.terms import Mechanism
from modelsel.report.html import _page_data
from modelsel.results.runs.mechanism_cards import (
    describe_cards,
    find_card,
    key_cards,
    list_finding_cards,
)
from modelsel.robot.files import load_robot

ARM = load_robot("ur5")


def candidate(one: Mechanism) -> SimpleNamespace:
    return SimpleNamespace(mechanism=one, registered=True)


def finding(fitted: Mechanism, *others: Mechanism) -> SimpleNamespace:
    entries = [SimpleNamespace(candidate=candidate(one)) for one in (fitted, *others)]
    named = SimpleNamespace(entries=entries)
    return SimpleNamespace(effect=SimpleNamespace(candidate=candidate(fitted), named=named))


def test_each_of_two_steps_has_its_own_card() -> None:
    late, early, other = (tracker_bumped(ARM, at) for at in (0.985, 0.395, 0.365))
    scale = mechanism("encoder-scale:1", ARM)
    findings = [finding(late), finding(early, other), finding(scale), finding(early)]
    error_map = SimpleNamespace(named={(0, 0): mechanism("encoder-scale:2", ARM), (1, 0): early})
    diagnosis = SimpleNamespace(faults=[None], findings=findings, error_map=error_map)
    run = SimpleNamespace(diagnosis=diagnosis)
    keys = key_cards(run)
    cards = describe_cards(keys)
    of_findings = list_finding_cards(run, keys)
    assert of_findings[0] == {}
    sentences = [cards[one["card"]]["sentence"] for one in of_findings[1:]]
    assert sentences == [late.sentence, early.sentence, scale.sentence, early.sentence]
    assert "98.5 %" in sentences[0]
    assert "39.5 %" in sentences[1]
    assert set(cards) == {"encoder-scale:1", "encoder-scale:2", late.name, f"{late.name} #2"}


def test_each_cell_has_the_card_of_its_own_constant() -> None:
    """A click on five waves a turn showed the sentence of three."""
    ripples = build_mechanisms("gear-ripple:1", ARM)[:4]
    cells = {(0, column): one for column, one in enumerate(ripples)}
    error_map = SimpleNamespace(named=cells)
    diagnosis = SimpleNamespace(faults=[], findings=[finding(ripples[2])], error_map=error_map)
    keys = key_cards(SimpleNamespace(diagnosis=diagnosis))
    cards = describe_cards(keys)
    for one in ripples:
        told = cards[find_card(keys, one)]
        assert told["sentence"] == one.sentence
        assert told["equation"] == one.equation
    assert keys[ripples[2]] == "gear-ripple:1"


@pytest.mark.slow
def test_the_page_tells_constants_of_one_name_apart(drawn) -> None:
    result, details = written(drawn)
    first, *rest = result["findings"][1]["credible_set"]
    screws = [
        {"frame": 1, "axis": "tx", "cause": f"(sign(progress-{at})+1)/2"} for at in (0.4, 0.3)
    ]
    steps = [first | {"mechanism": "tracker-step", "screws": [one]} for one in screws]
    result["findings"][1]["credible_set"] = [*steps, *rest]
    named = _page_data(source_of(result, details))["entries"][1][:2]
    assert named == [f"tracker-step, {one['cause']}" for one in screws]


@pytest.mark.slow
def test_the_card_of_a_finding_is_that_of_its_mechanism(drawn) -> None:
    source = read_source(drawn)
    assert source.record.findings
    for one, told in zip(source.record.findings, source.details.findings, strict=True):
        name = one.fitted_entry.mechanism
        if told.card is not None:
            assert source.details.cards[told.card].name == name
    assert any(told.card for told in source.details.findings)
