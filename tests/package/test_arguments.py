"""What users of the Python API pass by mistake is refused in one sentence that says what was
expected."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from builders import OFF_AXIS, drawn, planted, small_arm, small_campaign

import modelsel as ms
from modelsel._arguments import check_rows, check_whole_number, collect_names, describe_value
from modelsel._choices import EXPORT_FORMS
from modelsel.calibration.commands.commands_table import FIGURE_COLUMNS
from modelsel.exceptions import ArgumentError
from modelsel.mechanisms.causes import q
from modelsel.mechanisms.registry import BUILTIN, PerJoint
from modelsel.mechanisms.terms import Mechanism, Screw, Term
from modelsel.report.drawing import PAGES
from modelsel.results.sentences.tables import TABLES
from modelsel.testing import LawBroken, check_mechanism

ARM = small_arm()
TOOL = np.array([[10.0, 20.0, 100.0]])


@pytest.fixture
def problem(rng):
    """Forty configurations of an arm with errors of its geometry."""
    at = drawn(ARM, rng, 40)
    terms = ms.mechanism("geometric", ARM).terms
    return planted(at, terms, rng.normal(0, 1e-3, len(terms)), rng, 0.02)


def refusal(act: Callable[[], object]) -> str:
    """The one sentence with which a call is refused."""
    with pytest.raises(ms.ModelselError) as refused:
        act()
    said = str(refused.value)
    assert "\n" not in said
    return said


# -- the checks
# ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("number", [0, 11, 2.0, "3", None, True, np.nan])
def test_a_number_of_another_kind_is_refused(number) -> None:
    with pytest.raises(ArgumentError, match="count: expected a whole number from 1 to 10, found"):
        check_whole_number("count", number, 1, 10)


def test_whole_numbers_of_numpy_are_whole() -> None:
    assert check_whole_number("count", np.int64(3), 1) == 3


@pytest.mark.parametrize("given", [[True, False, True], np.array([1, 0, 1]), (1.0, 0.0, 1.0)])
def test_a_mask_may_be_of_any_kind(given) -> None:
    assert check_rows("estimation", given, 3).tolist() == [True, False, True]


@pytest.mark.parametrize("given", [[0, 1], [2, 1, 0], [[True], [True], [False]], 5, "abc"])
def test_what_is_no_mask_is_refused(given) -> None:
    with pytest.raises(ValueError, match=r"estimation.* expected"):
        check_rows("estimation", given, 3)


def test_a_mask_chooses_a_row() -> None:
    with pytest.raises(ValueError, match="none of the 3 rows is chosen"):
        check_rows("estimation", [False, False, False], 3)


def test_one_name_is_a_list_of_one() -> None:
    assert collect_names("base", "geometric") == ("geometric",)
    assert collect_names("base", ["geometric", "backlash"]) == ("geometric", "backlash")


def test_values_are_described_shortly() -> None:
    assert describe_value(None) == "None"
    assert describe_value("x" * 100) == "str"
    assert describe_value(np.zeros(1000)) == "ndarray"


# -- a problem
# ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("robot", "tools", "words"),
    [
        (ARM, [[0, 0, np.nan]], "tools: a coordinate is not a finite number"),
        (ARM, [["a", "b", "c"]], "tools: expected numbers"),
        (ARM, np.zeros((2, 3)), r"tools has shape \(2, 3\), expected \(1, 3\)"),
        ("puma760", TOOL, r"robot: expected a Robot, as load_robot.* found 'puma760'"),
        (ms.load_robot("puma760"), TOOL, "puma760 has 6 joints, and the measurements have 3"),
    ],
)
def test_a_problem_of_parts_that_do_not_fit_is_refused(problem, robot, tools, words) -> None:
    with pytest.raises(ValueError, match=words):
        ms.Problem(robot, problem.data, tools)


def test_the_measurements_of_a_problem_are_read_ones(problem) -> None:
    said = refusal(lambda: ms.Problem(ARM, problem.data.q, TOOL))
    assert "data: expected Measurements, as read_measurements returns them, found ndarray" in said


def test_a_problem_keeps_its_tools(problem) -> None:
    """An array that its owner changes later is not the problem's."""
    tools = TOOL.copy()
    bound = ms.Problem(ARM, problem.data, tools)
    tools[:] = 0.0
    assert np.array_equal(bound.tools, TOOL)
    assert replace(bound, tracker=(1.0, 0.0, 0.0)).tools is bound.tools


# -- fit, compare, diagnose, split
# ------------------------------------------------------------------------------------------------


def test_a_fit_takes_a_model(problem) -> None:
    said = refusal(lambda: ms.fit(problem, "geometric"))
    assert said.startswith("model: expected a Model, such as Model((mechanism(")


def test_models_are_compared_by_name(problem) -> None:
    model = ms.Model((ms.mechanism("geometric", ARM),))
    said = refusal(lambda: ms.compare(problem, [model, model]))
    assert said == "models: expected models by name, as {name: model}, found list."
    said = refusal(lambda: ms.compare(problem, {"one": "geometric"}))
    assert said.startswith("models['one']: expected a Model")
    nothing = np.zeros(40, bool)
    with pytest.raises(ValueError, match="none of the 40 rows is chosen"):
        ms.compare(problem, {"one": model}, estimation=nothing)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"estimation": [0, 1, 2]}, "estimation has shape (3,); expected (40,)"),
        ({"estimation": np.arange(40)}, "estimation: expected one truth value per row"),
        ({"seed": -1}, "seed: expected a whole number from 0 on, found -1."),
        ({"base": ms.Model(())}, "base: expected a name or a list of names, found Model."),
        ({"candidates": [1]}, "candidates: expected a name or a list of names, found int."),
    ],
)
def test_a_diagnosis_refuses_wrong_arguments(problem, given, words) -> None:
    assert refusal(lambda: ms.diagnose(problem, **given)).startswith(words)


def test_a_diagnosis_takes_one_name_as_base(problem) -> None:
    one, listed = (
        ms.diagnose(problem, base=base, candidates=[]) for base in ("geometric", ["geometric"])
    )
    assert one.base == listed.base
    assert one.base.names == ("geometric",)


@pytest.mark.parametrize("count", [0, -3, 41, 500, 0.4, 20.0, "20"])
def test_a_split_is_of_as_many_as_there_are(problem, count) -> None:
    said = refusal(lambda: ms.split_configurations(problem.data, count, ARM.prismatic, 0))
    assert said.startswith("count: expected a whole number from 1 to 40, found")


def test_a_split_takes_a_seed(problem) -> None:
    rng = np.random.default_rng(7)
    drawn_by_rng = ms.split_configurations(problem.data, 20, ARM.prismatic, rng)
    assert np.array_equal(drawn_by_rng, ms.split_configurations(problem.data, 20, ARM.prismatic, 7))
    said = refusal(lambda: ms.split_configurations(problem.data, 20, ARM.prismatic, -1))
    assert said == "rng: expected a whole number from 0 on, found -1."


# -- mechanisms of one's own
# ------------------------------------------------------------------------------------------------


def lever(frame: int = 2) -> Mechanism:
    """A mechanism of one screw at a frame."""
    term = Term("k", (Screw(frame, "rz", q(3)),), (1e-5, 1e-3))
    return Mechanism("lever", (term,), "A lever bends.", "k q3", "made up")


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        (lambda robot: lever(9), "k drives no screw, or one on a frame that small does not have"),
        (
            lambda robot: [lever()],
            "a Mechanism was expected (None where it does not apply), and list",
        ),
        (
            lever(),
            "a function robot -> Mechanism, PerJoint or Scanned was expected, found Mechanism.",
        ),
        (None, "a function robot -> Mechanism, PerJoint or Scanned was expected, found NoneType."),
        (PerJoint(lambda robot, joint: joint, lambda robot: (1,)), "a Mechanism was expected"),
        (
            PerJoint(lambda robot, joint: lever(), ("q1",)),
            "joints: their numbers, as (1, 2, 3), or a function robot -> numbers was expected",
        ),
    ],
)
def test_an_entry_that_builds_no_mechanism_is_refused_by_its_name(problem, entry, words) -> None:
    registry = {**BUILTIN, "lever": entry}
    said = refusal(lambda: ms.mechanism("lever", ARM, registry))
    assert said.startswith('the registry\'s "lever": ')
    assert words in said
    assert said == refusal(lambda: ms.diagnose(problem, registry=registry))


def test_a_study_with_a_wrong_mechanism_is_refused_before_it_runs() -> None:
    study = ms.Study(
        name="wrong",
        robot={"name": "puma760", "tool_mm": [0, 0, 100]},
        measurements="studies/puma760/measurements.csv",
    )
    registry = {**BUILTIN, "lever": lambda robot: lever(9)}
    said = refusal(lambda: ms.rehearse_study(study, registry=registry))
    assert "puma760 does not have: its frames are 1 to 7" in said


def test_a_wrong_place_is_all_that_the_laws_say(rng) -> None:
    with pytest.raises(LawBroken) as broken:
        check_mechanism(lever(9), ARM, rng)
    assert str(broken.value).startswith("L5: k drives no screw, or one on a frame that small")
    assert ";" not in str(broken.value)


def test_a_mechanism_is_built_for_a_robot_by_its_name() -> None:
    named = ms.mechanism("geometric", "PUMA 760")
    assert named == ms.mechanism("geometric", ms.load_robot("puma760"))
    said = refusal(lambda: ms.mechanism("geometric", 3))
    assert said.startswith(
        "expected a built-in robot's name or the path of a robot file, found int."
    )


# -- studies, files and results
# ------------------------------------------------------------------------------------------------


class OtherFrame:
    """A table of another program's, such as polars'."""

    __module__ = "polars.dataframe"

    def to_pandas(self) -> pd.DataFrame:
        """Return the table as a DataFrame of pandas."""
        return pd.DataFrame()


@pytest.fixture(scope="module")
def result() -> ms.Result:
    """A study of forty configurations with the geometric model alone."""
    _, _, study = small_campaign()
    return ms.run_study(study, sampling=False)


@pytest.mark.parametrize(
    ("tables", "says"),
    [
        ({"measurements": OtherFrame()}, "found polars.OtherFrame; give its .to_pandas()."),
        ({"measurements": np.zeros((3, 9))}, "found a list or an array; pd.DataFrame(values,"),
        ({"model": {"candidates": [1]}}, "model.candidates.1: expected text, found"),
        ({"model": {"candidates": 3}}, "model.candidates: expected 'all' or a list, found '3'."),
    ],
)
def test_a_wrong_value_of_a_study_is_told_once(tables, says) -> None:
    given = {"name": "x", "robot": {"name": "ur5", "tool_mm": OFF_AXIS}, "measurements": "m.csv"}
    assert says in refusal(lambda: ms.Study(**given | tables))


def test_a_study_keeps_its_values(result) -> None:
    for table in (result.study, result.study.robot):
        said = refusal(lambda table=table: setattr(table, "name", "another"))
        assert said.startswith("name: a study keeps its values. Make another one: Study(**{")
    assert ms.Study(**{**dict(result.study), "name": "another"}).name == "another"


def test_measurements_of_another_kind_are_told() -> None:
    for given, says in ((OtherFrame(), "give its .to_pandas()"), (np.zeros((3, 9)), "an array")):
        said = refusal(lambda given=given: ms.read_measurements(given, ARM))
        assert said.startswith("measurements: expected a file or a pandas DataFrame, found ")
        assert says in said


@pytest.mark.parametrize("columns", [["x_mm"], {"x_mm": 0}])
def test_columns_are_named_by_name(result, columns) -> None:
    said = refusal(lambda: ms.read_measurements(result.study.measurements.frame, ARM, columns))
    assert said.startswith("measurements.columns")
    assert "expected" in said


@pytest.mark.parametrize(
    "read",
    [ms.load_result, ms.load_robot, ms.load_calibration, ms.read_study, ms.run_study],
    ids=lambda read: read.__name__,
)
@pytest.mark.parametrize("given", [None, 3, b"x", pd.DataFrame()], ids=["None", "3", "b", "frame"])
def test_what_is_no_path_is_refused(read, given) -> None:
    said = refusal(lambda: read(given))
    assert said.startswith(("expected a", "expected the"))
    assert said.endswith(f"{type(given).__name__}.")


@pytest.mark.parametrize(
    ("act", "says"),
    [
        (lambda result: result.to_frame(3), "table: expected the name of a table, found 3."),
        (lambda result: result.calibration.export(None), "form: expected one of urdf, dh,"),
        (lambda result: result.report("out", pages=(1,)), "pages: expected a name or a list of"),
        (lambda result: result.report("out", pages="overview"), 'pages: no page "overview".'),
        (lambda result: ms.plan_next("folder"), "result: expected a Result, as run_study"),
        (
            lambda result: ms.plan_next(result, 3, joints={"q2_deg": 5}),
            "q2_deg: expected the two ends of a range, as (-90, 45), found 5.",
        ),
        (
            lambda result: ms.plan_next(result, 3, joints=["q2_deg"]),
            'joints: expected ranges by name, as {"q2_deg": (-90, 45)}, found list.',
        ),
        (
            lambda result: result.calibration.predict([["a", "b", "c"]]),
            "joint readings: expected numbers, 3 in every row.",
        ),
        (
            lambda result: result.calibration.predict([[1.0, 2.0], [3.0]]),
            "joint readings: expected numbers, 3 in every row.",
        ),
    ],
)
def test_slips_with_a_result_are_told(result, act, says) -> None:
    assert refusal(lambda: act(result)).startswith(says)


def test_one_page_may_be_given_by_its_name(result, tmp_path) -> None:
    assert [path.name for path in result.report(tmp_path, pages="first")] == ["report-pages.pdf"]


def test_readings_may_be_lists(result) -> None:
    q = ARM.draw(np.random.default_rng(1), 3)
    calibration = result.calibration
    assert np.array_equal(calibration.predict(q.tolist()), calibration.predict(q))
    wide = (0.5, 500.0)
    corrected = calibration.correct(q, bound=wide)
    assert calibration.correct(q.tolist(), bound=wide).equals(corrected)


# -- what a user is shown and told
# ------------------------------------------------------------------------------------------------


def test_what_a_user_looks_at_is_a_few_lines(problem) -> None:
    model = ms.Model((ms.mechanism("geometric", ARM),))
    comparison = ms.compare(problem, {"geometric": model, "nominal": ms.Model(())})
    shown = [repr(one) for one in (problem, model, ms.fit(problem, model), comparison)]
    assert shown[0].startswith(
        "Problem of small. Measurements: 40 rows, 40 configurations, 1 target"
    )
    assert 'nominal target "target": 40, -25, 100 mm in the flange frame' in shown[0]
    assert shown[1] == "Model of geometric: 21 parameters"
    assert shown[2].startswith("Fit of geometric: 21 parameters, rank ")
    assert "120 coordinates, residual standard deviation 0.0" in shown[2]
    assert "geometric: 0.0" in shown[3]
    assert "lowest cross-validated error" in shown[3]
    assert all(len(text.splitlines()) <= 4 for text in shown)
    assert "<table" in comparison._repr_html_()


def test_a_docstring_lists_every_choice() -> None:
    """What a parameter may be stands where Python shows it."""
    listed = (
        (ms.Result.to_frame, (*TABLES, "residuals")),
        (ms.Result.report, PAGES),
        (ms.Calibration.export, EXPORT_FORMS),
        (ms.Calibration.correct, FIGURE_COLUMNS),
        (ms.plan_next, ("rivals", "d", "a", "o1", "o5")),
    )
    for function, choices in listed:
        said = function.__doc__ or ""
        missing = [c for c in choices if f'"{c}"' not in said and f"`{c}`" not in said]
        assert not missing, function


def test_no_option_of_a_command_is_asked_of_python(result, tmp_path) -> None:
    """What is said of a folder, a page, a form or a value holds for both."""
    (tmp_path / "file").write_text("")
    acts = (
        lambda: result.save(tmp_path / "file"),
        lambda: result.report(tmp_path, pages=("overview",)),
        lambda: result.calibration.export("ur-calibration"),
        lambda: ms.plan_next(result, 3, purpose="rivals"),
    )
    for act in acts:
        assert "--" not in refusal(act)
