"""Cards of mechanisms, and the key that each has in details.json.

Mechanisms of several constants share a name, as steps at other moments do: those that a finding is
fitted as, or that a cell of the map stands for, have a card each."""

from __future__ import annotations

from typing import Any

from ...mechanisms.serialization import describe_mechanism
from ...mechanisms.terms import Mechanism
from .study_run import StudyRun

Values = dict[str, Any]


def key_cards(run: StudyRun) -> dict[Mechanism, str]:
    """Return the key of every mechanism that has a card: its name, or where another one has that, its
    name and a number.

    Those that findings are fitted as come first, then those that cells of the map stand for, then one
    of every other name that a credible set has."""
    keys: dict[Mechanism, str] = {}
    count: dict[str, int] = {}
    cells = run.diagnosis.error_map.named
    for mechanism in (*_list_fitted(run), *cells.values()):
        if mechanism not in keys:
            _add_key(keys, count, mechanism)
    for mechanism in _list_considered(run):
        if mechanism.name not in count:
            _add_key(keys, count, mechanism)
    return keys


def _add_key(keys: dict[Mechanism, str], count: dict[str, int], mechanism: Mechanism) -> None:
    """Add the key of a mechanism, of which so many of its name, `count`, have one already."""
    name = mechanism.name
    before = count.get(name, 0)
    keys[mechanism] = f"{name} #{before + 1}" if before else name
    count[name] = before + 1


def find_card(keys: dict[Mechanism, str], mechanism: Mechanism) -> str:
    """Return the key of a mechanism's card; of one that has none, its name."""
    name = mechanism.name
    key = keys.get(mechanism)
    if key is None:
        return name
    return key


def describe_cards(keys: dict[Mechanism, str]) -> Values:
    """Return the cards by their keys, sorted."""
    cards: Values = {}
    for mechanism, key in keys.items():
        card = _describe_card(mechanism)
        cards[key] = card
    order = sorted(cards)
    return {key: cards[key] for key in order}


def list_finding_cards(run: StudyRun, keys: dict[Mechanism, str]) -> list[Values]:
    """Return of every finding of result.json the key of its card, where it has one."""
    diagnosis = run.diagnosis
    cards: list[Values] = [{} for _ in diagnosis.faults]
    for finding in diagnosis.findings:
        mechanism = finding.effect.candidate.mechanism
        key = keys.get(mechanism)
        card: Values = {}
        if key is not None:
            card["card"] = key
        cards.append(card)
    return cards


def _list_fitted(run: StudyRun) -> list[Mechanism]:
    """List the registered mechanisms that findings are fitted as."""
    fitted = []
    for finding in run.diagnosis.findings:
        candidate = finding.effect.candidate
        mechanism = candidate.mechanism
        if candidate.registered:
            fitted.append(mechanism)
    return fitted


def _list_considered(run: StudyRun) -> list[Mechanism]:
    """List the registered mechanisms that a credible set names."""
    considered = []
    for finding in run.diagnosis.findings:
        named = finding.effect.named
        for entry in named.entries:
            candidate = entry.candidate
            mechanism = candidate.mechanism
            if candidate.registered:
                considered.append(mechanism)
    return considered


def _describe_card(mechanism: Mechanism) -> Values:
    """Return a mechanism's card, its pairs as lists."""
    card: Values = describe_mechanism(mechanism)
    for term in card["terms"]:
        if term["size"] is not None:
            term["size"] = list(term["size"])
    return card
