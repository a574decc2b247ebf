"""What keeps an answer from being taken for more: a list that was asked alone, sizes that are open,
geometry that does harm."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from builders import bind, measured, seeds, small_arm, study_of
from searches import search_independent

from modelsel.config.study_file import read_study
from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.findings.effect_sentences import list_cautions
from modelsel.diagnosis.findings.effects import Effect
from modelsel.diagnosis.procedure import diagnose_split
from modelsel.diagnosis.separation import Inquiry
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.fitting.design import Model
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.causes import Applied, Named, q, sin
from modelsel.mechanisms.registry import every, mechanism
from modelsel.mechanisms.terms import Mechanism, Screw, Term
from modelsel.results.conclusions.cautions import (
    advise_nominal,
    harmful_base_notes,
    restriction_notes,
)
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import forward
from modelsel.selection.gain import Gain
from modelsel.study.pipeline.runner import run_study

STUDY = Path(__file__).parents[2] / "studies" / "puma760"
ARM = load_robot("ur10")
BASE = Model((mechanism("geometric", ARM),))
TOOL = np.array([60.0, -40.0, 120.0])
OPEN = "the data do not determine the size of k: its standard error is larger than such an error usually is "


# -- a list that was asked alone
# ----------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("asked", [["gravity-twist"], ["joint-compliance:5", "backlash:3"]])
def test_a_study_of_few_candidates_says_that_no_other_was_considered(asked: list[str]) -> None:
    """The model may end up holding every candidate; nothing is left that chance could be drawn
    from."""
    study = read_study(STUDY / "study.toml")
    study = study.model_copy(
        update={"model": study.model.model_copy(update={"candidates": asked, "ladder": []})}
    )
    result = run_study(study, STUDY, sampling=False).record.to_dict()
    names = " and ".join(asked)
    assert result["verdict"][1].endswith(
        f"Only {names} could be named: no other cause was considered, "
        "and an error that has one may seem not to repeat."
    )
    warnings = {w["code"]: w["sentence"] for w in result["warnings"]}
    assert warnings["candidates-restricted"].startswith(
        f"This study considers {names} and no other cause"
    )
    assert {e["mechanism"] for f in result["findings"] for e in f["credible_set"]} <= {None, *asked}
    for found in result["findings"]:
        assert found["verdict"] != "found" or " among those considered" in found["sentence"]


@pytest.mark.parametrize("asked", ["all", []])
def test_a_study_of_all_candidates_says_nothing(asked: list[str] | str) -> None:
    assert restriction_notes(asked) == ()


# -- sizes
# --------------------------------------------------------------------------------------------------------------------


def effect(
    term: Term, value: float, error: float, cancels: tuple[str, float] | None = None
) -> Effect:
    candidate = Candidate(Mechanism("x", (term,), "Something."), CandidateKind.MECHANISM, 1.0)
    return Effect(
        candidate, SimpleNamespace(entries=()), 0.01, np.array([value]), np.array([error]), cancels
    )  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("size", "value", "error", "words"),
    [
        ((1e-6, 5e-3), 2e-3, 1e-4, []),
        ((1e-6, 5e-3), 8e-3, 1e-4, ["k is larger than usual (5.00 mrad)"]),
        ((1e-6, 5e-3), 8e-3, 6e-3, [f"{OPEN}(5.00 mrad)"]),
        (None, 0.156, 0.01, ["k is larger than usual (20.0 mrad)"]),
        (None, 0.030, 0.025, [f"{OPEN}(20.0 mrad)"]),
        (None, 0.015, 0.001, []),
    ],
)
def test_a_size_beyond_what_is_usual_is_said(size, value, error, words) -> None:
    term = Term("k", (Screw(2, "rz", sin(q(2))),), size)
    assert list_cautions(effect(term, value, error)) == words


def test_two_effects_that_undo_one_another_say_so() -> None:
    term = Term("k", (Screw(2, "rz", sin(q(2))),))
    (words,) = list_cautions(effect(term, 1e-3, 1e-4, ("tracker-step", 0.04)))
    assert words.startswith(
        "tracker-step cancels most of it; together they move the target by 4 % of what either does alone"
    )


@seeds(1, 2)
def test_effects_that_undo_one_another_are_recognised(rng: np.random.Generator) -> None:
    """Two waves that are nearly one, of opposite sign: what is left is a third of the smaller,
    computed from the positions."""
    readings = ARM.draw(rng, 120)
    one = Mechanism("one", (Term("a", (Screw(1, "rz", sin(4.0 * q(1))),)),), "One.")
    other = Mechanism("other", (Term("b", (Screw(1, "rz", sin(4.03 * q(1))),)),), "Other.")
    moved = readings.copy()
    moved[:, 0] += 2e-2 * np.sin(4 * readings[:, 0]) - 1.5e-2 * np.sin(4.03 * readings[:, 0])
    at = bind(ARM, build_measurements(readings, forward(ARM, moved, TOOL)), TOOL)
    at = measured(at, at.data.position + rng.normal(0, 0.003, (120, 3)))
    found = build_candidates(at, BASE, (one, other), cells=False)
    extension = search_independent(at, BASE, found, rng)
    assert {e.candidate.label for e in extension.effects} == {"one", "other"}
    share = np.linalg.norm(
        forward(ARM, moved, TOOL) - forward(ARM, readings, TOOL)
    ) / np.linalg.norm(
        forward(ARM, readings + 1.5e-2 * np.sin(4.03 * readings[:, :1]) * np.eye(6)[0], TOOL)
        - forward(ARM, readings, TOOL)
    )
    for e in extension.effects:
        assert e.cancels is not None
        assert e.cancels[0] == ({"one", "other"} - {e.candidate.label}).pop()
        assert e.cancels[1] == pytest.approx(share, rel=0.2)


@seeds(1, 2, 3)
def test_an_effect_whose_size_is_open_is_told_with_no_wild_number(rng: np.random.Generator) -> None:
    """A joint that warms up with a time constant far beyond the campaign's: a straight line but for
    a part in a thousand, so that a bend of a milliradian in it would be a decay by 182 radians (as
    it was told), which a joint zero as large would undo. The straight line is found; of the decay
    its usual size is all that is known."""
    arm = small_arm()
    readings = arm.draw(rng, 80)
    moved = readings.copy()
    moved[:, 1] += 1e-3 * np.linspace(0, 1, 80) ** 2
    at = bind(arm, build_measurements(readings, forward(arm, moved, TOOL)), TOOL)
    at = measured(at, at.data.position + rng.normal(0, 0.003, (80, 3)))
    slow = Mechanism(
        "slow",
        (
            Term("d", (Screw(2, "rz", Applied("exp", Named("progress") / -300.0)),)),
            Term("e", (Screw(2, "rz", Named("progress")),)),
        ),
        "Slow.",
    )
    base = Model((mechanism("geometric", arm),))
    found = build_candidates(at, base, (slow,), cells=False)
    extension = search_independent(at, base, found, rng)
    for e in extension.effects:
        assert np.abs(e.estimate).max() < 2e-3
        assert e.standard_error.max() < 2e-3
        assert e.estimate[1] == pytest.approx(1e-3, abs=1e-4)
    assert np.abs(extension.fit.theta).max() < 10 * max(
        t.usual or 1e-2 for t in extension.fit.terms
    )


@pytest.mark.slow
def test_nothing_that_is_named_is_larger_than_a_small_screw(rng: np.random.Generator) -> None:
    readings = ARM.draw(rng, 60)
    position = forward(ARM, readings, TOOL)
    position[45:] += rng.normal(0, 1.0, 3)
    at = bind(ARM, build_measurements(readings, position), TOOL)
    at = measured(at, at.data.position + rng.normal(0, 0.03, (60, 3)))
    for e in diagnose_split(study_of(at), Inquiry(BASE, every(ARM), 1, cells=True))[1].effects:
        for t, v, s in zip(e.candidate.mechanism.terms, e.estimate, e.standard_error, strict=True):
            if t.unit in ("mm", "rad"):
                assert max(abs(v), s) < {"mm": 200.0, "rad": 0.2}[t.unit]


# -- geometry
# -----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("gain", "words"),
    [
        (
            Gain(0.198, 0.31, (-0.2, -0.05)),
            "by 0.310 mm rms where the nominal arm errs by 0.198, worse by 0.0500 to 0.200 mm (95 %):",
        ),
        (
            Gain(0.198, 0.21, (-0.02, 0.01)),
            "by 0.210 mm rms where the nominal arm errs by 0.198, a difference that chance may make:",
        ),
        (Gain(0.198, 0.21, None), "errs by 0.210 mm rms where the nominal arm errs by 0.198:"),
    ],
)
def test_geometry_that_is_worse_than_nominal_is_said(gain: Gain, words: str) -> None:
    (note,) = harmful_base_notes(("geometric",), gain, gain)
    assert note.code == "base-worse-than-nominal"
    assert words in note.sentence


@pytest.mark.parametrize(
    "gain", [Gain(0.3, 0.2, (0.05, 0.15)), Gain(None, None, None), Gain(0.3, 0.3, None)]
)
def test_geometry_that_is_not_worse_is_not(gain: Gain) -> None:
    assert harmful_base_notes(("geometric",), gain, gain) == ()


def test_geometry_that_is_worse_is_no_matter_where_the_chosen_model_gains() -> None:
    """What the base leaves is what was found beyond it: nominal parameters are no better."""
    base = Gain(0.2961, 0.2963, (-0.01, 0.01))
    assert harmful_base_notes(("geometric",), base, Gain(0.2961, 0.0782, (0.2, 0.24))) == ()
    assert harmful_base_notes(("geometric",), base, Gain(0.2961, 0.2962, None))


@pytest.mark.parametrize(
    ("gain", "orientation", "words"),
    [
        (Gain(0.198, 0.31, (-0.2, -0.05)), None, "the fitted ones are worse."),
        (Gain(0.198, 0.21, (-0.02, 0.01)), None, "the fitted ones are no better."),
        (Gain(0.198, 0.21, None), (1e-3, 2e-3), "the fitted ones are no better."),
        (Gain(0.198, 0.21, None), (2e-3, 1e-3), ""),
        (Gain(0.3, 0.2, (0.05, 0.15)), None, ""),
        (Gain(None, None, None), None, ""),
    ],
)
def test_the_verdict_says_where_the_nominal_parameters_are_to_be_kept(
    gain: Gain, orientation: tuple[float, float] | None, words: str
) -> None:
    advice = advise_nominal(gain, orientation)
    assert advice.endswith(words)
    assert bool(advice) == bool(words)


@pytest.mark.slow
def test_a_study_whose_geometry_is_worse_says_so(tmp_path: Path, rng: np.random.Generator) -> None:
    """A perfect arm, fitted in one corner of its room and held out in another: the fit carries
    noise there."""
    robot = load_robot("puma760")
    near = robot.draw(rng, 1) + rng.uniform(-0.05, 0.05, (30, 6))
    readings = np.concatenate([near, robot.draw(rng, 60)])
    data = build_measurements(
        readings, forward(robot, readings, np.array([0, 0, 100.0])) + rng.normal(0, 0.1, (90, 3))
    )
    frame = data.to_frame().assign(role=["estimation"] * 30 + ["held-out"] * 60)
    frame.to_csv(tmp_path / "measurements.csv", index=False)
    study = (STUDY / "study.toml").read_text().partition("[split]")[0]
    (tmp_path / "study.toml").write_text(
        f'{study}[split]\ncolumn = "role"\n[model]\nbase = ["geometric"]\ncandidates = []\n'
    )
    record = run_study(tmp_path / "study.toml", sampling=False).record.to_dict()
    assert "Keep the nominal parameters" in record["verdict"][0]
    warnings = {w["code"]: w["sentence"] for w in record["warnings"]}
    assert "the fitted base model (geometric) errs by " in warnings["base-worse-than-nominal"]
