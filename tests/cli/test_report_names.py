"""`modelsel mechanisms` explains names that stand in reports and are in no registry."""

from __future__ import annotations

import pytest
from click.testing import CliRunner

from modelsel.cli.main import run_command_line


def explained(name: str) -> str:
    ran = CliRunner().invoke(run_command_line, ["mechanisms", name])
    assert ran.exit_code == 0, ran.output
    return ran.output


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("fault:tracker-bumped (2)", "stand differently relative to each other"),
        ("fault:read-too-early", "equation"),
        ("fault:time-offset", "equation  θ = q + delay · speed"),
        ("fault:row-order", "wrong order"),
        ("fault:swapped-reflectors", "swapped"),
        ("torque5_6", "torque of 1 kg at a frame about a joint's axis, joint 5, frame 6 [N m/kg]"),
        ("approach2", "the side that joint 2 came from"),
        ("frame 3 rx · free(q1, q2)", "free(q1, q2): a function of q1, q2 of any shape"),
        ("backlash:3 with the opposite sign", "equation"),
    ],
)
def test_a_name_of_a_report_is_explained(name: str, words: str) -> None:
    assert words in explained(name)


def test_an_unknown_name_is_refused_with_the_nearest() -> None:
    ran = CliRunner().invoke(run_command_line, ["mechanisms", "torque99_2"])
    assert ran.exit_code == 2


@pytest.mark.parametrize("name", ["target-step:B", "target-step:B:0.5", "target-step:another"])
def test_a_step_of_one_target_is_explained_by_the_name_of_the_target(name: str) -> None:
    """Its moment was part of the name, and one name had two targets."""
    _, target, *moment = name.split(":")
    said = " ".join(explained(name).split())
    assert f"target-step:{target}: Target {target} stands elsewhere on the flange after" in said
    assert f"Here target_1 is {target}; in results" in said
    assert ("after 50.0 %" in said) == bool(moment)
    assert ("one of 199 scanned constants" in said) != bool(moment)


def test_a_step_of_targets_that_move_alike_is_explained_by_their_names() -> None:
    said = " ".join(explained("target-step:B & C:0.5").split())
    assert (
        "target-step:B & C: Targets B and C stand elsewhere on the flange, shifted alike," in said
    )
    assert "Here target_1 is B and target_2 is C; in results they have their numbers" in said


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("target-step:", "the name of a target is missing after the colon"),
        ("target-step:A & ", 'the name of a target is missing beside "&"'),
        ("target-step:A & A", "a target stands twice"),
        ("target-step:0.512", "0.512 is not among the constants of target-step"),
        ("target-step:B:0.512", "0.512 is not among the constants of target-step"),
    ],
)
def test_a_step_that_cannot_be_is_refused(name: str, said: str) -> None:
    ran = CliRunner().invoke(run_command_line, ["mechanisms", name])
    assert ran.exit_code == 2
    assert said in " ".join(ran.output.split())
