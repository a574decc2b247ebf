"""Where not all that an effect depends on is proven, what most explanations share is told."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from builders import seeds
from hidden_arm import State
from test_claims import ROBOTS, effect_of, plant, single

from modelsel._typing import Array
from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.candidates.signatures import read_signatures
from modelsel.diagnosis.findings.claim_sentences import describe_claim, describe_proven
from modelsel.diagnosis.findings.effects import Claim, Effect
from modelsel.diagnosis.findings.sure_drivers import find_sure, sum_by_driver
from modelsel.diagnosis.procedure import diagnose
from modelsel.diagnosis.rivals.unlisted_shapes import Rival
from modelsel.diagnosis.search.weighed_models import VisitedModels
from modelsel.mechanisms.causes import Named, q, sin

JOINT, ELSEWHERE = (4, "rz"), (3, "rz")
FOUND: list[Candidate] = [
    single(JOINT, Named("approach4")),
    single(JOINT, Named("move4", "rad")),
    single(JOINT, Named("approach4") * sin(q(2))),
    single(JOINT, sin(q(2))),
    single(ELSEWHERE, Named("approach4")),
]


def search_of(found: list[Candidate]) -> SimpleNamespace:
    traits = SimpleNamespace(acting_parts=tuple(found), signatures=read_signatures(found))
    return SimpleNamespace(traits=traits)


def test_what_explanations_of_one_place_share_is_as_probable_as_they_are_together() -> None:
    search = search_of(FOUND)
    rivals = [
        Rival(single(JOINT, Named("approach4") * q(1)), "place"),
        Rival(single(JOINT, q(5)), "place"),
        Rival(single(ELSEWHERE, Named("approach4")), ""),
    ]
    probability = np.array([0.3, 0.2, 0.15, 0.05, 0.04, 0.16, 0.06, 0.04])
    # a last move says its side, too; what acts elsewhere does not count
    own = sum_by_driver(search, 0, probability, rivals)  # type: ignore[arg-type]
    assert own == pytest.approx({"approach4": 0.3 + 0.2 + 0.15 + 0.16})
    both = sum_by_driver(search, 2, probability, rivals)  # type: ignore[arg-type]
    assert both == pytest.approx({"approach4": 0.81, "q2": 0.2})


def test_an_effect_of_several_places_has_no_drivers_of_one() -> None:
    own = single(JOINT, q(2))
    other = single(ELSEWHERE, q(2))
    mechanism = replace(own.mechanism, terms=own.mechanism.terms + other.mechanism.terms)
    search = search_of([replace(own, mechanism=mechanism)])
    assert sum_by_driver(search, 0, np.ones(1), []) == {}  # type: ignore[arg-type]


@pytest.mark.parametrize(("share", "is_sure"), [(0.08, True), (0.12, False)])
def test_a_driver_is_sure_where_the_sets_that_were_weighed_have_it_too(
    share: float, is_sure: bool
) -> None:
    search = search_of(FOUND)
    odds = np.array([0.5, 0.5 - share, share])
    models = VisitedModels(((0,), (2,), (3,)), np.log(odds))
    weights = {"approach4": 0.95}
    sure = find_sure(search, 0, [0], weights, models)  # type: ignore[arg-type]
    assert sure == (pytest.approx({"approach4": 1 - share}) if is_sure else {})
    assert find_sure(search, 0, [0], {"approach4": 0.85}, models) == {}  # type: ignore[arg-type]


def claiming(candidate: Candidate, *levels: float, **drivers: float) -> Effect:
    effect = effect_of(candidate, *levels)
    assert effect.claim is not None
    claim = replace(effect.claim, moves_joints=True, drivers=tuple(drivers.items()))
    return replace(effect, claim=claim)


def test_a_driver_that_is_sure_is_told_though_others_may_join_it() -> None:
    effect = claiming(FOUND[0], 1.0, 0.4, 0.4, 0.0, approach4=0.97)
    claimed = describe_claim(effect)
    assert claimed is not None
    assert claimed.level == "place"
    assert claimed.text == (
        "Joint 4 is off its reading, depending on the side that joint 4 came from (0.97); whether "
        "it depends on anything else is not proven"
    )
    assert describe_proven(effect).startswith(claimed.text)
    # the joint's own reading is called so
    own = describe_claim(claiming(single(JOINT, q(4)), 1.0, 0.4, 0.4, 0.0, q4=0.95))
    assert own is not None
    assert "depending on its own reading (0.95)" in own.text


def test_errors_that_last_take_their_share_of_what_is_sure() -> None:
    claim = Claim("place", (0.99, 0.5, 0.1, 0.1), drivers=(("q2", 0.95),))
    assert claim.needs_drivers
    assert dict(claim.share(0.93).drivers) == pytest.approx({"q2": 0.93 * 0.95})
    effect = replace(effect_of(FOUND[3], 0.99, 0.5, 0.1, 0.1), claim=claim.share(0.93))
    assert "depending on" not in describe_proven(effect)
    assert not Claim("drivers", (0.99, 0.95, 0.1, 0.1)).needs_drivers
    assert not Claim("place", (0.7, 0.5, 0.1, 0.1)).needs_drivers


@pytest.mark.slow
@seeds(6)
def test_what_is_sure_of_a_joint_with_two_drivers_is_planted(rng: np.random.Generator) -> None:
    """A joint that turns with its reading, and a little with the side that another one came from."""
    robot = ROBOTS[int(rng.integers(len(ROBOTS)))]
    sure: list[Claim] = []
    for times in rng.uniform(3.0, 5.0, 3).tolist():
        own, other = (int(joint) for joint in rng.permutation([1, 3, 4, 5])[:2])
        problem = plant(robot, rng, (own, turn(own, other)), times=times)
        claims = [effect.claim for effect in diagnose(problem, seed=1).effects]
        told = [claim for claim in claims if claim is not None and claim.drivers]
        allowed = {f"q{own}", f"approach{other}", f"move{other}"}
        for claim in told:
            assert [place for place, _ in claim.acts] == [(own, "rz")]
            assert {name for name, _ in claim.drivers} <= allowed
        sure += told
    assert sure


def turn(own: int, other: int) -> Callable[[State], Array]:
    return lambda s: s.q[:, own - 1] + 0.3 * np.sign(s.move[:, other - 1])
