"""Springs of a joint under its own weight, the payload and both are one model in several names."""

from __future__ import annotations

from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.candidates.nested_loads import find_nested_loads
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.mechanisms.compliance import DECLARED, UNKNOWN, WITH_PAYLOAD
from modelsel.mechanisms.registry import build_mechanisms, mechanism
from modelsel.robot.files import load_robot

ROBOT = load_robot("ur5e")
OTHER, OWN, EACH, WHOLE, PAYLOAD, THIRD, TWIST = range(7)


def list_springs() -> list[Candidate]:
    """Candidates of joint 2: of its declared weight, each mass, both loads, the payload; and others."""
    spring = build_mechanisms("joint-compliance:2", ROBOT)
    each = [
        mechanism("base-tilt", ROBOT),
        spring[DECLARED],
        spring[UNKNOWN],
        spring[WITH_PAYLOAD],
        mechanism("payload-deflection:2", ROBOT),
        build_mechanisms("joint-compliance:3", ROBOT)[WITH_PAYLOAD],
        mechanism("joint2-twist", ROBOT),
    ]
    return [Candidate(one, CandidateKind.MECHANISM, 0.1) for one in each]


def test_two_of_three_springs_are_told_by_the_weight_and_by_the_payload() -> None:
    loads = find_nested_loads(list_springs())
    for pair in ([WHOLE, PAYLOAD], [OWN, WHOLE], [OWN, PAYLOAD], [OWN, WHOLE, PAYLOAD]):
        assert loads.tell_apart([OTHER, *pair]) == (OTHER, OWN, PAYLOAD)
    for alone in (OWN, WHOLE, PAYLOAD, THIRD):
        assert loads.tell_apart([OTHER, alone]) == tuple(sorted((OTHER, alone)))
    assert loads.tell_apart([EACH, PAYLOAD]) == (EACH, PAYLOAD)


def test_beside_a_twist_by_the_weight_a_spring_under_both_is_one_under_the_payload() -> None:
    loads = find_nested_loads(list_springs())
    assert loads.tell_apart([TWIST, WHOLE]) == (PAYLOAD, TWIST)
    assert loads.tell_apart([TWIST, OWN]) == (OWN, TWIST)
    assert loads.tell_apart([TWIST, THIRD]) == (THIRD, TWIST)
    assert loads.list_other_names(PAYLOAD, [PAYLOAD, TWIST]).tolist() == [WHOLE]


def test_beside_one_spring_the_others_are_one() -> None:
    loads = find_nested_loads(list_springs())
    assert loads.list_other_names(OWN, [OWN, PAYLOAD]).tolist() == [WHOLE]
    assert loads.list_other_names(WHOLE, [OTHER, PAYLOAD, WHOLE]).tolist() == [OWN]
    assert loads.list_other_names(WHOLE, [OTHER, WHOLE]).tolist() == []
    assert loads.list_other_names(OTHER, [OTHER, WHOLE, PAYLOAD]).tolist() == []


def test_without_one_of_the_three_there_is_nothing_to_tell_apart() -> None:
    springs = list_springs()
    loads = find_nested_loads(springs[:PAYLOAD])
    assert loads.tell_apart([OWN, WHOLE]) == (OWN, WHOLE)
