"""Causes of a study's own, of columns of its measurements: [[covariate]] and [search.outcomes]."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import pytest
from builders import drawn
from hidden_arm import Effect, State, arm, measured
from hidden_effects import Values, at

from modelsel import Study, load_robot, run_study
from modelsel.config.study_file import parse_study
from modelsel.config.study_tables import ModelTable
from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.candidates.options import DiagnosisOptions
from modelsel.diagnosis.candidates.prior_weights import weigh_outcomes
from modelsel.diagnosis.candidates.session_steps import place_steps
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.exceptions import StudyError
from modelsel.fitting.design import Model
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.campaign_registry import set_targets
from modelsel.mechanisms.environment import step_after
from modelsel.mechanisms.registry import BUILTIN, build_mechanisms, every, mechanism
from modelsel.mechanisms.serialization import cause_from_record, cause_record
from modelsel.study.models.cause_search import choose_options
from modelsel.study.models.model_ladder import build_model
from modelsel.study.pipeline.result import Result
from modelsel.study.pipeline.runner import rehearse_study
from modelsel.study.preparation.own_causes import (
    build_own_candidates,
    build_own_mechanisms,
    note_constant_causes,
)
from modelsel.study.preparation.row_selection import drop_unknown_targets

ROBOT = load_robot("puma760")
TOOL = (40.0, -25.0, 100.0)
NOISE = 0.05
BESIDE = {"acc_x_g": (-1.0, 1.0), "acc_y_g": (-1.0, 1.0), "pressure_bar": (2.0, 8.0)}


def measure(values: Values | None, size: float, seed: int = 11, m: int = 80) -> pd.DataFrame:
    """A campaign of an arm with geometric errors and columns beside the readings; joint 3 turns by
    `size` times some values of them, through the benchmark's own exact chain."""
    rng = np.random.default_rng(seed)
    body = arm(ROBOT, rng, TOOL)
    q = body.draw(rng, m)
    columns = {name: rng.uniform(*ends, m) for name, ends in BESIDE.items()}
    state = State(body, q, columns)
    effects = []
    if values is not None:
        effects.append(Effect("own", "planted", (at(3, "rz", values),), np.array([size])))
    x = measured(body, state, effects) + rng.normal(0, NOISE, (m, 3))
    readings = {f"q{j + 1}_rad": q[:, j] for j in range(6)}
    places = dict(zip(("x_mm", "y_mm", "z_mm"), x.T, strict=True))
    return pd.DataFrame({**readings, **places, **columns})


def ask(frame: pd.DataFrame | str, *own: dict[str, Any], **tables: Any) -> Study:
    """A study of measurements with causes of its own."""
    robot = {"name": "puma760", "tool_mm": list(TOOL)}
    given = {"name": "own", "seed": 1, "robot": robot, "measurements": frame, "covariate": [*own]}
    return Study(**given | tables)


def list_labels(result: Result) -> list[str]:
    return [effect.candidate.label for effect in result.diagnosis.search.effects]


# -- the study file


@pytest.mark.unit
@pytest.mark.parametrize(
    ("own", "said"),
    [
        (
            [{"causes": ["acc_x_g", " acc_x_g"], "as": "products"}],
            'covariate.1: causes lists "acc_x_g" twice; a product has two different causes.',
        ),
        (
            [{"causes": ["acc_x_g"], "as": "pairs"}],
            'covariate.1: as = "pairs" needs two causes or more.',
        ),
        (
            [{"causes": ["acc_x_g"], "frame": 3}],
            "covariate.1: frame and axis go together: give both, or neither for every place.",
        ),
        (
            [{"causes": ["acc_x_g"], "name": "hose"}],
            (
                'covariate.1: name = "hose" stands for one effect at one place: give frame and axis, and '
                "one cause, or two as pairs or products."
            ),
        ),
        (
            [{"causes": ["acc_x_g"], "prior": 1.5}],
            "covariate.1.prior: expected less than 1, found '1.5'.",
        ),
        (
            [{"causes": ["acc_x_g"], "prior": 0.0}],
            "covariate.1.prior: expected more than 0, found '0.0'.",
        ),
        (
            [{"causes": ["acc_x_g"], "prior": 0.7}, {"causes": ["acc_y_g"], "prior": 0.3}],
            "covariate: the priors sum to 1; all other explanations together need what is left of 1.",
        ),
        (
            [{"causes": ["acc_x_g"], "frame": 3, "axis": "rz", "name": "a:3"}],
            "covariate.1.name: expected a name of letters, digits and hyphens, 60 at most, found 'a:3'.",
        ),
        (
            [{"causes": ["a"], "frame": 3, "axis": "rz", "name": "hose"}] * 2,
            'covariate: the name "hose" is given twice.',
        ),
        ([{"cause": "acc_x_g"}], '[covariate.1]: unknown key "cause". Did you mean "causes"?'),
        (
            [{"causes": []}],
            ("covariate.1: causes lists nothing; columns of the file, or formulas, are expected."),
        ),
        (["acc_x_g"], 'covariate.1: expected a table: causes = ["acc_x_g"].'),
    ],
)
def test_a_table_that_cannot_be_is_refused_in_a_sentence(own: list[Any], said: str) -> None:
    with pytest.raises(StudyError) as error:
        ask("none.csv", *own)
    assert said in error.value.problems


@pytest.mark.unit
@pytest.mark.parametrize(
    ("own", "said"),
    [
        (
            {"causes": ["acc_z_g", "pressure_bar"], "as": "products"},
            (
                'covariate.1.causes: unknown name "acc_z_g" in "acc_z_g". Did you mean "acc_y_g"? The '
                "file's further columns of numbers: acc_x_g, acc_y_g, pressure_bar."
            ),
        ),
        (
            {"causes": ["sin(q2)"]},
            (
                "covariate.1.causes: sin(q2): no column of the file is in it. The file's further columns "
                "of numbers: acc_x_g, acc_y_g, pressure_bar."
            ),
        ),
        (
            {"causes": ["cos(q2)", "sin(q2)"], "as": "products"},
            (
                "covariate.1.causes: cos(q2) and sin(q2): no column of the file is in them. The file's "
                "further columns of numbers: acc_x_g, acc_y_g, pressure_bar."
            ),
        ),
        (
            {"causes": ["acc_x_g", "2*acc_x_g"], "as": "products"},
            (
                'covariate.1.causes: "acc_x_g" and "2*acc_x_g" are the same but for a factor; combine '
                "different causes."
            ),
        ),
        (
            {"causes": ["1/(acc_x_g-acc_x_g)"]},
            (
                'covariate.1.causes: "1/(acc_x_g-acc_x_g)" is not a finite number on row 0; write it so '
                "that it is one in every row."
            ),
        ),
        (
            {"causes": ["acc_x_g"], "frame": 9, "axis": "rz"},
            "covariate.1.frame: 9, but puma760 has frames 1 to 7.",
        ),
        (
            {"causes": ["acc_x_g"], "frame": 7, "axis": "rz"},
            (
                "covariate.1.axis: positions alone do not show that frame 7, the target, turns; use tx, "
                "ty or tz."
            ),
        ),
        (
            {"causes": ["acc_x_g"], "frame": 3, "axis": "rz", "name": "backlash"},
            'covariate.1.name: "backlash" is a registered mechanism; choose another name.',
        ),
    ],
)
def test_a_cause_that_the_data_do_not_have_is_refused(own: dict[str, Any], said: str) -> None:
    with pytest.raises(StudyError) as error:
        rehearse_study(ask(measure(None, 0.0, m=40), own))
    assert error.value.problems == (said,)


@pytest.mark.unit
def test_one_table_with_single_brackets_is_told() -> None:
    with pytest.raises(StudyError) as error:
        parse_study('name = "own"\n[covariate]\ncauses = ["acc_x_g"]\n', "study.toml")
    said = "study.toml: covariate: expected [[covariate]], with two brackets on each side."
    assert said in error.value.problems


@pytest.mark.unit
def test_a_cause_with_one_value_is_told() -> None:
    frame = measure(None, 0.0, m=40).assign(pressure_bar=6.0)
    warned = rehearse_study(ask(frame, {"causes": ["pressure_bar", "acc_x_g"]}))["warnings"]
    (said,) = [note["sentence"] for note in warned if note["code"] == "cause-constant"]
    assert said == (
        'covariate.1: "pressure_bar" has one value, 6, in all rows: what it alone does cannot be told '
        "from the geometry."
    )


@pytest.mark.unit
def test_a_study_without_own_causes_keeps_its_hash() -> None:
    written = ask("none.csv").model_dump_json()
    assert "covariate" not in written
    assert "outcomes" not in written
    assert "covariate" in ask("none.csv", {"causes": ["a"]}).model_dump_json()


# -- targets that are only held out


def leave_out(rng: np.random.Generator, names: str) -> Problem:
    """Rows of targets of which the first, A, is only held out."""
    rows = 40
    target = [*"A" * 10, *(names * rows)[: rows - 10]]
    columns = {"load": rng.uniform(0, 1, rows)}
    data = build_measurements(
        ROBOT.draw(rng, rows), np.zeros((rows, 3)), target=target, covariates=columns
    )
    estimation = np.arange(rows) >= 10
    kept, _, (note,) = drop_unknown_targets(data, estimation)
    assert note.code == "target-unseen"
    return Problem(ROBOT, kept, np.zeros((len(kept.targets), 3)))


@pytest.mark.unit
@pytest.mark.parametrize(("names", "number", "target"), [("BC", 2, 0), ("BC", 3, 1), ("B", 2, 0)])
def test_targets_keep_the_numbers_of_the_file(
    rng: np.random.Generator, names: str, number: int, target: int
) -> None:
    """A cause of B was fitted to C, and that of C refused."""
    at = leave_out(rng, names)
    own = {"name": "mine", "frame": 7, "axis": "tx", "causes": [f"target_{number}*load"]}
    mine = build_own_mechanisms(ask("none.csv", own), at)["mine"]
    ((screw,),) = [term.screws for term in mine.terms]
    expected = at.data.covariates["load"] * (at.data.target == target)
    np.testing.assert_array_equal(screw.cause.of(at.state), expected)
    assert str(screw.cause) == f"target_{number}*load"
    record = cause_record(screw.cause)
    assert str(cause_from_record(record)) == str(screw.cause)


@pytest.mark.unit
def test_every_cause_of_a_target_has_the_number_of_the_file(rng: np.random.Generator) -> None:
    """Those of the set-up, of a step that is named, and of one whose moment the data tell."""
    at = leave_out(rng, "BC")
    base = ["geometric", "target-step:C:0.5"]
    study = ask("none.csv").model_copy(update={"model": ModelTable(base=base)})
    model = build_model(study, at, BUILTIN, base)
    printed = {str(screw.cause) for term in model.terms for screw in term.screws}
    step = step_after(0.5)
    assert printed == {"1", "target_2", "target_3", f"{step}*target_3"}
    assert {term.symbol[-3:] for term in model.terms if "(" in term.symbol} == {"(2)", "(3)"}
    registry = set_targets(BUILTIN, at.data.targets, at.data.listed_targets)
    scanned = build_mechanisms("target-step:C", at.robot, registry)
    every_row = np.ones(len(at), bool)
    told = place_steps(at, every_row, scanned)
    causes = {str(mechanism.terms[0].screws[0].cause) for mechanism in told}
    assert causes
    assert all(cause.endswith("*target_3") for cause in causes)


@pytest.mark.unit
def test_a_cause_of_a_target_that_is_left_out_is_told(rng: np.random.Generator) -> None:
    at = leave_out(rng, "BC")
    (note,) = note_constant_causes(ask("none.csv", {"causes": ["target_1*load", "load"]}), at)
    assert note.sentence == (
        'covariate.1: "target_1*load" cannot be tested: no estimation row measures target "A".'
    )


@pytest.mark.unit
def test_a_number_that_no_target_of_the_file_has_is_refused(rng: np.random.Generator) -> None:
    at = leave_out(rng, "BC")
    with pytest.raises(StudyError, match="The targets are target_1 to target_3"):
        build_own_candidates(ask("none.csv", {"causes": ["target_4*load"]}), at)


# -- candidates and their priors


def offer(at: Problem, study: Study, cells: bool = True, **more: Any) -> tuple[Candidate, ...]:
    base = Model((mechanism("geometric", at.robot),))
    options = DiagnosisOptions(own=build_own_candidates(study, at), **more)
    return build_candidates(at, base, every(at.robot) if cells else (), cells, options)


@pytest.fixture(scope="module")
def problem() -> Problem:
    rng = np.random.default_rng(1986)
    columns = {name: rng.uniform(*ends, 25) for name, ends in BESIDE.items()}
    return drawn("puma760", rng, 25, covariates=columns)


@pytest.fixture(scope="module")
def plain(problem: Problem) -> tuple[Candidate, ...]:
    """The candidates of a study without causes of its own."""
    return offer(problem, ask("none.csv"))


@pytest.mark.integration
def test_own_causes_are_at_every_place_with_the_prior_that_they_are_given(
    problem: Problem, plain: tuple[Candidate, ...]
) -> None:
    own = {"causes": ["acc_x_g", "acc_y_g", "pressure_bar"], "as": "products", "prior": 0.3}
    found = offer(problem, ask("none.csv", own))
    labels = {c.label for c in plain}
    new = {c.label: c for c in found if c.label not in labels}
    # of 6 * 6 + 3 places seven move every target as another one does
    places = 6 * 6 + 3 - 7
    assert len(new) == 3 * places
    assert "frame 1 tz · acc_x_g*pressure_bar" in new
    assert "frame 2 ty · acc_x_g*pressure_bar" not in new
    assert "frame 7 tx · acc_x_g*pressure_bar" in new
    assert sum(c.prior for c in new.values()) == pytest.approx(0.3)
    assert len({c.prior for c in new.values()}) == 1
    assert sum(c.prior for c in found) == pytest.approx(1.0)
    others = [c for c in found if c.label in labels]
    assert [c.mechanism for c in others] == [c.mechanism for c in plain]
    assert [c.prior for c in others] == pytest.approx([0.7 * c.prior for c in plain])


@pytest.mark.unit
def test_without_a_prior_an_own_cause_is_as_likely_as_a_cell(problem: Problem) -> None:
    pair = {"causes": ["acc_x_g", "acc_y_g"], "as": "pairs", "frame": 1, "axis": "rx"}
    found = offer(problem, ask("none.csv", pair))
    (own,) = [c for c in found if c.label == "frame 1 rx · acc_x_g & acc_y_g"]
    (cell,) = [c for c in found if c.label == "frame 1 rx · acc_x_g"]
    assert own.kind is CandidateKind.CELL
    assert own.prior == cell.prior
    assert len(own.mechanism.terms) == 2
    assert sum(c.prior for c in found) == pytest.approx(1.0)


@pytest.mark.unit
def test_combinations_without_a_column_are_left_out(problem: Problem) -> None:
    own = {"causes": ["cos(q2)", "acc_x_g", "sin(q2)"], "as": "products", "frame": 3, "axis": "rz"}
    (group,) = build_own_candidates(ask("none.csv", own), problem)
    causes = [str(m.terms[0].screws[0].cause) for m in group.mechanisms]
    assert causes == ["cos(q2)*acc_x_g", "acc_x_g*sin(q2)"]


@pytest.mark.unit
def test_a_column_given_a_prior_of_its_own_is_no_second_candidate(problem: Problem) -> None:
    found = offer(problem, ask("none.csv", {"causes": ["acc_x_g"], "prior": 0.2}))
    cells = [c for c in found if c.mechanism.names() == {"acc_x_g"}]
    assert len(cells) == len({c.label for c in cells})
    assert sum(c.prior for c in cells) == pytest.approx(0.2)


@pytest.mark.unit
def test_a_named_one_is_as_likely_as_a_registered_name(problem: Problem) -> None:
    own = {"causes": ["acc_x_g"], "frame": 3, "axis": "rz", "name": "hose"}
    found = offer(problem, ask("none.csv", own))
    (hose,) = [c for c in found if c.registered_name == "hose"]
    tilts = [c for c in found if c.registered_name == "base-tilt"]
    assert hose.prior == pytest.approx(sum(tilt.prior for tilt in tilts))
    assert not [c for c in found if c.label == "frame 3 rz · acc_x_g"]


@pytest.mark.unit
def test_what_a_study_adds_is_asked_beside_listed_candidates(problem: Problem) -> None:
    anywhere = {"causes": ["acc_x_g"], "prior": 0.1, "frame": 3, "axis": "rz"}
    hose = {"causes": ["acc_y_g"], "prior": 0.3, "frame": 3, "axis": "rz", "name": "hose"}
    left_out = ask("none.csv", anywhere, hose, model={"candidates": ["backlash"]})
    (alone,) = offer(problem, left_out, cells=False)
    assert (alone.label, alone.prior, alone.asked) == ("frame 3 rz · acc_x_g", 1.0, True)
    both = offer(problem, ask("none.csv", anywhere, hose, model={"candidates": ["hose"]}), False)
    assert [c.prior for c in both] == pytest.approx([0.25, 0.75])


@pytest.mark.unit
def test_what_the_base_has_is_no_candidate(problem: Problem) -> None:
    study = ask(
        "none.csv",
        {"causes": ["acc_x_g"], "frame": 3, "axis": "rz", "name": "hose"},
        model={"base": ["geometric", "hose"]},
    )
    hose = build_own_mechanisms(study, problem)["hose"]
    base = Model((mechanism("geometric", problem.robot), hose))
    options = DiagnosisOptions(own=build_own_candidates(study, problem))
    found = build_candidates(problem, base, every(problem.robot), True, options)
    assert not [c for c in found if c.screws == {term.key for term in hose.terms}]


# -- what became of findings


@pytest.mark.unit
def test_outcomes_weigh_a_name_by_the_odds_that_its_findings_are_right() -> None:
    assert weigh_outcomes(0, 0) == 1.0
    assert weigh_outcomes(9, 0) == pytest.approx(2.0)
    assert weigh_outcomes(0, 3) == pytest.approx(0.25)
    assert weigh_outcomes(90, 10) == pytest.approx(1.0)
    with pytest.raises(ValueError, match="not negative"):
        weigh_outcomes(-1, 0)


@pytest.mark.unit
def test_a_contradicted_name_leaves_its_prior_to_the_other_names(
    problem: Problem, plain: tuple[Candidate, ...]
) -> None:
    found = offer(problem, ask("none.csv"), weights=(("backlash", 0.25), ("backlash:3", 0.5)))
    assert sum(c.prior for c in found) == pytest.approx(1.0)
    ratio = {c.label: c.prior / p.prior for c, p in zip(found, plain, strict=True)}
    other = ratio["base-tilt"]
    assert other > 1
    assert ratio["backlash:2"] == pytest.approx(0.25 * other)
    assert ratio["backlash:3"] == pytest.approx(0.5 * other)
    assert ratio["frame 1 tx · q1"] == pytest.approx(1.0)


@pytest.mark.unit
def test_outcomes_reach_the_search_from_the_study_file(problem: Problem) -> None:
    text = """
name = "a year on"
robot = { name = "puma760", tool_mm = [40, -25, 100] }
measurements = { file = "none.csv" }
[search.outcomes.tool-droop]
contradicted = 3
[search.outcomes."backlash:3"]
confirmed = 9
"""
    study = parse_study(text, "study.toml")
    weights = dict(choose_options(study, problem).weights)
    assert weights == {"tool-droop": pytest.approx(0.25), "backlash:3": pytest.approx(2.0)}


@pytest.mark.unit
@pytest.mark.parametrize(
    ("outcomes", "said"),
    [
        (
            {"tool-drop": {"contradicted": 1}},
            'search.outcomes: unknown mechanism "tool-drop". Did you mean "tool-droop"?',
        ),
        (
            {"tool-droop": {"contradicted": -1}},
            ("search.outcomes.tool-droop.contradicted: expected 0 or more, found '-1'."),
        ),
        (
            {"tool-droop": {"contradict": 1}},
            '[search.outcomes.tool-droop]: unknown key "contradict". Did you mean "contradicted"?',
        ),
    ],
)
def test_outcomes_that_cannot_be_are_refused(outcomes: dict[str, Any], said: str) -> None:
    with pytest.raises(StudyError) as error:
        rehearse_study(ask(measure(None, 0.0, m=40), search={"outcomes": outcomes}))
    assert error.value.problems == (said,)


# -- whole studies, effects planted by exact kinematics


def product(s: State) -> np.ndarray:
    return s.covariates["acc_x_g"] * s.covariates["pressure_bar"]


@pytest.mark.slow
def test_a_hidden_product_of_two_columns_is_named() -> None:
    own = {"causes": list(BESIDE), "as": "products", "prior": 0.1}
    result = run_study(ask(measure(product, 1.2e-4), own))
    assert list_labels(result) == ["frame 3 rz · acc_x_g*pressure_bar"]
    (finding,) = result.findings
    assert finding.claim.level == "shape"
    assert finding.claim.probability > 0.95
    assert finding.claim.text == "Joint 3 is off its reading with acc_x_g*pressure_bar"
    (estimate,) = finding.estimate
    assert abs(estimate.value - 1.2e-4) < 4 * estimate.standard_error
    without = run_study(ask(measure(product, 1.2e-4)))
    assert "frame 3 rz · acc_x_g*pressure_bar" not in list_labels(without)


@pytest.mark.slow
def test_a_hidden_pair_of_columns_is_one_finding() -> None:
    def tilt(s: State) -> np.ndarray:
        return s.covariates["acc_x_g"] + 2 * s.covariates["acc_y_g"]

    own = {"causes": list(BESIDE), "as": "pairs"}
    result = run_study(ask(measure(tilt, 2e-4), own))
    assert list_labels(result) == ["frame 3 rz · acc_x_g & acc_y_g"]
    estimate = result.diagnosis.search.effects[0].estimate
    assert estimate == pytest.approx([2e-4, 4e-4], rel=0.25)


@pytest.mark.slow
def test_a_named_product_in_the_base_leaves_the_noise_and_predicts() -> None:
    hose = {
        "causes": ["acc_x_g", "pressure_bar"],
        "as": "products",
        "frame": 3,
        "axis": "rz",
        "name": "hose",
    }
    frame = measure(product, 8e-4)
    study = ask(frame, hose, model={"base": ["geometric", "hose"]}, split={"estimation": 60})
    result = run_study(study)
    assert result.findings == []
    assert result.record.chosen.mechanisms == ["geometric", "hose"]
    geometric = run_study(ask(frame, model={"candidates": []}, split={"estimation": 60}))
    left = result.models.chosen.held_out.rms_mm
    assert left < 2.5 * NOISE * np.sqrt(3)
    assert geometric.models.chosen.held_out.rms_mm > 4 * left


@pytest.mark.slow
def test_a_product_with_a_function_of_a_joint_is_named() -> None:
    def swing(s: State) -> np.ndarray:
        return s.covariates["pressure_bar"] * np.cos(s.q[:, 1])

    own = {"causes": ["pressure_bar", "cos(q2)"], "as": "products", "prior": 0.05}
    result = run_study(ask(measure(swing, 4e-4), own))
    assert "frame 3 rz · pressure_bar*cos(q2)" in list_labels(result)
