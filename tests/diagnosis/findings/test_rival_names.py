"""Names of what else an effect could be: twins are no rivals, and a constant may be all that is open."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from modelsel.diagnosis.candidates.candidate import collect_screws
from modelsel.diagnosis.findings.claim_sentences import tell_rest
from modelsel.diagnosis.findings.rival_names import describe_open_names, list_twin_labels
from modelsel.mechanisms.environment import tracker_bumped, tracker_step
from modelsel.mechanisms.registry import build_mechanisms, mechanism
from modelsel.mechanisms.terms import Mechanism
from modelsel.results.record import _list_rivals
from modelsel.robot.files import load_robot

ARM = load_robot("ur5")
BUMPS = [tracker_bumped(ARM, at) for at in (0.395, 0.365)]
STEPS = [tracker_step(ARM, at) for at in (0.395, 0.365)]
SCALE = mechanism("encoder-scale:1", ARM)
SAME = "tracker-step is another name of the same displacement"


def candidate(one: Mechanism, registered: bool = True) -> SimpleNamespace:
    return SimpleNamespace(
        label=one.name, mechanism=one, screws=collect_screws(one), registered=registered
    )


def effect(
    *listed: tuple[Mechanism, float], place: float = 1.0, registered: bool = True
) -> SimpleNamespace:
    entries = []
    weights: dict[str, float] = {}
    for one, probability in listed:
        each = candidate(one, registered)
        entries.append(SimpleNamespace(candidate=each, probability=probability, alike=True))
        weights[one.name] = weights.get(one.name, 0.0) + probability
    named = SimpleNamespace(entries=entries, sum_by_label=lambda: weights)
    claim = SimpleNamespace(levels=(place, place, place, place))
    return SimpleNamespace(candidate=entries[0].candidate, named=named, claim=claim)


@pytest.mark.parametrize(
    ("listed", "words"),
    [
        ([*BUMPS, *STEPS], f"the data do not settle the moment; {SAME}"),
        ([*BUMPS, STEPS[0], SCALE], f"cannot tell this apart from encoder-scale:1; {SAME}"),
        ([SCALE, *BUMPS], "the data cannot tell this apart from fault:tracker-bumped"),
        ([SCALE], "the data cannot tell this apart from others"),
        (
            [build_mechanisms(f"gear-ripple:3:{count}", ARM)[0] for count in (17, 18)],
            "the data do not settle its constant",
        ),
    ],
)
def test_another_name_of_one_displacement_is_no_rival(listed, words) -> None:
    share = 0.95 / len(listed)
    assert describe_open_names(effect(*((one, share) for one in listed))).endswith(words)


def test_twins_have_the_same_screws_with_the_same_constant() -> None:
    assert list_twin_labels(effect((BUMPS[0], 0.5), (STEPS[0], 0.4))) == ["tracker-step"]
    assert list_twin_labels(effect((BUMPS[0], 0.5), (STEPS[1], 0.4))) == []


def test_the_verdict_lists_no_twin_and_other_places_where_the_place_is_open() -> None:
    assert _list_rivals(effect((BUMPS[0], 0.5), (STEPS[0], 0.45))) == ()
    scales = [(mechanism(f"encoder-scale:{joint}", ARM), 0.3) for joint in (1, 2, 3)]
    others = tuple(one.name for one, _ in scales[1:])
    assert _list_rivals(effect(*scales, place=0.4, registered=False)) == others
    assert _list_rivals(effect(*scales, place=0.95, registered=False)) == ()


def test_what_is_not_listed_stands_in_place_of_what_is_less_probable() -> None:
    joints = [mechanism(f"encoder-scale:{joint}", ARM) for joint in (1, 2, 3)]
    labels = [one.name for one in joints[1:]]
    listed = list(zip(joints, (0.31, 0.01, 0.01), strict=True))
    assert tell_rest(effect(*listed, place=0.31), labels) == ["something else"]
    listed = list(zip(joints, (0.4, 0.3, 0.2), strict=True))
    assert tell_rest(effect(*listed, place=0.4), labels) == labels


def test_the_verdict_lists_nothing_that_is_hardly_possible() -> None:
    scales = [mechanism(f"encoder-scale:{joint}", ARM) for joint in (1, 2, 3)]
    listed = zip(scales, (0.6, 0.33, 0.02), strict=True)
    assert _list_rivals(effect(*listed)) == ("encoder-scale:2",)
