"""A fleet's names of what was found carry what the study holds back of them."""

from __future__ import annotations

from typing import Any

import pytest

from modelsel._records import parse_record
from modelsel.results.schemas.finding_schema import FindingRecord
from modelsel.results.sentences.study_sentences import describe_doubt
from modelsel.study.found_names import write_found_names

LEVELS = ("place", "drivers", "shape", "cause")


def make_finding(name: str, verdict: str, cause: float, doubtful: bool) -> dict[str, Any]:
    """A finding as result.json has it, whose cause is so probable."""
    screws = [{"frame": 2, "axis": "rz", "cause": "torque2"}]
    entry = {"mechanism": name, "probability": 1.0, "alike": True, "screws": screws}
    probabilities = (1.0, 0.99, 0.98, cause)
    gain = {"held_out_rms_before_mm": 1.0, "held_out_rms_after_mm": 0.5, "interval_mm": [0.4, 0.6]}
    return {
        "sentence": f"{name}.",
        "verdict": verdict,
        "p_value": 0.001,
        "credible_set": [entry],
        "more_entries": 0,
        "estimate": [],
        "gain": gain,
        "doubtful": doubtful,
        "levels": [
            {"level": level, "probability": probability, "text": level}
            for level, probability in zip(LEVELS, probabilities, strict=True)
        ],
    }


@pytest.mark.parametrize(
    ("verdict", "cause", "doubtful", "told"),
    [
        ("found", 0.97, False, "joint-compliance:2"),
        ("found", 0.42, False, "joint-compliance:2 (name not proven)"),
        ("cannot be told apart", 0.42, False, "joint-compliance:2 (name not proven)"),
        ("cannot be told apart", 0.42, True, "joint-compliance:2 (doubtful)"),
    ],
)
def test_what_is_not_proven_stands_beside_the_name(verdict, cause, doubtful, told) -> None:
    finding = make_finding("joint-compliance:2", verdict, cause, doubtful)
    names = ["joint-compliance:2", "zero-step:1"]
    assert write_found_names(names, [finding]) == f"{told} + zero-step:1"
    assert write_found_names([], [finding]) == ""


@pytest.mark.parametrize(
    ("verdict", "told"), [("found", ", but doubtful"), ("cannot be told apart", ", and doubtful")]
)
def test_a_doubt_is_no_contrast_to_an_open_name(verdict, told) -> None:
    doubtful = make_finding("backlash:2", verdict, 0.4, doubtful=True)
    assert describe_doubt(parse_record(doubtful, FindingRecord)) == told
    sure = make_finding("backlash:2", verdict, 0.97, doubtful=False)
    assert not describe_doubt(parse_record(sure, FindingRecord))
