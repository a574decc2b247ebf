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
