"""What names in a report mean that no registry lists."""

from __future__ import annotations

import pytest

from modelsel.diagnosis.findings.name_legend import explain_names


def test_registered_names_need_no_legend() -> None:
    assert explain_names(["gravity-twist", "backlash:3 with the opposite sign"], 6) == []


def test_every_kind_of_name_is_explained_once() -> None:
    names = [
        "frame 7 ry · torque5_6",
        "frame 3 tx · waves of q1 times waves of q2",
        "frame 3 rx · 1.5 waves along the campaign",
        "frame 1 tx · free(beam_aside_z)",
        "frame 1 rz · sin(2*q2) & cos(2*q2)",
        "frame 2 tz · approach1",
        "frame 2 tz · approach2",
        "fault:tracker-bumped (2)",
    ]
    assert explain_names(names, 6) == [
        "frame 7 ry · cause: frame 7 turns about its y axis with the cause",
        "frame 7: the target",
        "free(beam_aside_z): a function of beam_aside_z of any shape, fitted to the data",
        "waves of q1 times waves of q2: any product of a wave once a turn of the one and of the other",
        "1.5 waves along the campaign: a wave in time, 1.5 periods from the first row to the last",
        "a & b: two numbers fitted together, as a sine and a cosine of unknown phase",
        "torque5_6: torque of 1 kg at a frame about a joint's axis, joint 5, frame 6",
        "beam_aside_z: level direction across the beam, z component",
        "approach1: the side that joint 1 came from",
        "(2) after a name: one of several effects of that name",
    ]


def test_the_name_of_a_target_is_no_cause() -> None:
    """*target: the target* was said of every step of one. Targets that move alike are no pair of
    numbers."""
    names = ["target-step", "target-step:torque2", "target-step:B (2)", "target-step:A & C"]
    assert explain_names(names, 6) == ["(2) after a name: one of several effects of that name"]


def test_causes_of_one_target_or_group_are_explained() -> None:
    assert explain_names(["frame 7 tx · payload_kg*target_2", "frame 1 tx · group_3"], 6)[2:] == [
        "target_2: 1 in the rows of target 2 of the measurements, 0 in the others",
        "group_3: 1 in the rows of group 3 of the measurements, 0 in the others",
    ]


@pytest.mark.parametrize(("joints", "said"), [(6, False), (2, True), (None, False)])
def test_the_frame_of_the_target_is_said_where_it_is_named(joints, said) -> None:
    lines = explain_names(["frame 3 rx · q1"], joints)
    assert ("frame 3: the target" in lines) == said
