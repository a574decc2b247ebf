"""All errors of a study file are said at once, those in names among them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from modelsel.config.study_file import Study, read_study
from modelsel.exceptions import DataError, StudyError
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import forward
from modelsel.study.inputs.whole_study import read_whole_study
from modelsel.study.pipeline.runner import rehearse_study, run_study
from modelsel.study.simulation import simulate_study

PLAIN = """name = "s"
seed = 1
[robot]
name = "puma760"
tool_mm = [0, 0, 100]
[measurements]
file = "none.csv"
[model]
base = ["geometric"]
"""
MISNAMED = PLAIN.replace('"geometric"', '"geometrc"')
EFFECT = '[[simulate.effect]]\nframe = {}\naxis = "rz"\ncause = "{}"\nsize = 1e-3\n'


def problems_of(folder: Path, text: str) -> str:
    (folder / "study.toml").write_text(text)
    with pytest.raises(StudyError) as error:
        read_whole_study(folder)
    return str(error.value)


def test_a_table_says_all_that_is_wrong_with_it() -> None:
    with pytest.raises(StudyError) as error:
        Study(
            name="s",
            robot={"name": "ur5", "file": "r.toml", "base": "b"},
            measurements="m.csv",
            split={"estimation": 8, "column": "role", "nested_folds": 1},
        )
    assert error.value.problems == (
        'robot: give either name = "…" (built in) or file = "robot.toml".',
        "robot: tool_mm is missing: the nominal target in the flange frame (or register = true to find it).",
        'split: give estimation = N or column = "…", not both.',
        "split: nested_folds = 1 is not a fold; 0 (none) or 2 and more.",
    )


def test_names_are_said_beside_values(tmp_path: Path) -> None:
    ladder = 'ladder = [["geometric", "gometric:2"], 3]\ncandidates = ["backlsh:3", "mine"]\n'
    own = '[[covariate]]\ncauses = ["q1"]\nname = "mine"\nframe = 1\naxis = "rz"\n'
    wrong = PLAIN.replace("puma760", "puma76").replace("seed = 1", "sed = 1")
    said = problems_of(tmp_path, wrong.replace('"geometric"', '"geometrc"') + ladder + own)
    for words in (
        'study.toml: robot.name: unknown robot "puma76". Did you mean "puma760"',
        'unknown key "sed". Did you mean "seed"?',
        'study.toml: model.base: unknown mechanism "geometrc". Did you mean "geometric"?',
        'study.toml: model.candidates: unknown mechanism "backlsh:3". Did you mean "backlash"?',
        'study.toml: model.ladder: unknown mechanism "gometric:2". Did you mean "geometric"?',
    ):
        assert words in said
    assert '"mine"' not in said
    assert "?." not in said


@pytest.mark.parametrize(
    "text", ["[[[", "", "model = 3\n", "[model]\nbase = 3\nladder = 3\n", "covariate = [3]\n"]
)
def test_what_holds_no_names_is_wrong_all_the_same(tmp_path: Path, text: str) -> None:
    assert "study.toml: " in problems_of(tmp_path, text)


def test_effects_to_plant_are_checked_together(tmp_path: Path) -> None:
    effects = EFFECT.format(99, "nowhere") + EFFECT.format(1, "q1+")
    (tmp_path / "study.toml").write_text(PLAIN + effects)
    frame = "study.toml: simulate.effect.1: frame 99, but "
    name = 'study.toml: simulate.effect.1: unknown name "nowhere"'
    formula = 'study.toml: simulate.effect.2: "q1+" is not a cause'
    expected = {
        rehearse_study: (frame, formula, "none.csv: no such file"),
        simulate_study: (frame, name, formula),
    }
    for run, beginnings in expected.items():
        with pytest.raises(StudyError) as error:
            run(tmp_path)
        problems = error.value.problems
        assert len(problems) == len(beginnings)
        for problem, beginning in zip(problems, beginnings, strict=True):
            assert problem.startswith(beginning)


def test_values_robot_data_and_names_are_said_together(tmp_path: Path) -> None:
    text = PLAIN.replace('name = "puma760"', 'file = "arm.toml"').replace("[0, 0, 100]", "[0, 1]")
    wrong = (
        text.replace('"geometric"', '"geometrc"') + "[split]\nestimation = 3\nnested_folds = 1\n"
    )
    said = problems_of(tmp_path, wrong + EFFECT.format(1, "q1+") + "more = 1\n")
    beginnings = (
        "study.toml: robot.tool_mm: expected exactly 3 values",
        'study.toml: [simulate.effect.1]: unknown key "more"',
        "study.toml: split: nested_folds = 1 is not a fold",
        'study.toml: model.base: unknown mechanism "geometrc"',
        'study.toml: simulate.effect.1: "q1+" is not a cause',
        "arm.toml: there is no such robot file",
        "none.csv: no such file",
    )
    lines = said.splitlines()
    assert len(lines) == len(beginnings)
    for words in beginnings:
        assert any(words in line for line in lines)


def write_targets(folder: Path) -> None:
    """Write measurements of two targets, A and B, as none.csv."""
    rng = np.random.default_rng(1)
    robot = load_robot("puma760")
    q = robot.draw(rng, 20)
    rows = []
    for name in "AB":
        frame = pd.DataFrame(q, columns=[f"q{k}_rad" for k in range(1, 7)])
        frame[["x_mm", "y_mm", "z_mm"]] = forward(robot, q, np.array([0.0, 0.0, 100.0]))
        rows.append(frame.assign(target=name, configuration=range(20)))
    pd.concat(rows).to_csv(folder / "none.csv", index=False)


TARGETS = "[robot.tools_mm]\nA = [0, 0, 100]\nB = [0, 0, 100]\n"
OF_TWO = ("tool_mm = [0, 0, 100]\n", TARGETS)
OF_TARGETS = PLAIN.replace(*OF_TWO)
OF_C = OF_TARGETS.replace('"geometric"', '"geometric", "target-step:C"')
NO_C = 'model.base: "target-step:C": in the measurements the targets are A and B.'


def test_names_of_targets_are_said_beside_what_else_is_wrong(tmp_path: Path) -> None:
    write_targets(tmp_path)
    said = problems_of(tmp_path, OF_C + "[split]\nestimatio = 6\n")
    assert said.splitlines() == [
        'study.toml: [split]: unknown key "estimatio". Did you mean "estimation"?',
        f"study.toml: {NO_C}",
    ]


def test_names_of_targets_are_said_beside_a_split_that_cannot_be(tmp_path: Path) -> None:
    write_targets(tmp_path)
    (tmp_path / "study.toml").write_text(OF_C + "[split]\nestimation = 600\n")
    with pytest.raises(StudyError) as error:
        rehearse_study(tmp_path)
    name, split = error.value.problems
    assert NO_C in name
    assert "split.estimation = 600" in split


@pytest.mark.parametrize("value", ["true", "1.0", '"1"'])
def test_a_value_that_equals_its_stand_in_hides_nothing(tmp_path: Path, value: str) -> None:
    said = problems_of(tmp_path, MISNAMED + f"[split]\nestimation = {value}\n")
    estimation, name, _ = said.splitlines()
    assert "split.estimation: " in estimation
    assert 'unknown mechanism "geometrc"' in name


def test_wrong_values_hide_no_problem_of_their_table(tmp_path: Path) -> None:
    wrong = PLAIN.replace("[0, 0, 100]", '"no"\nfile = "arm.toml"')
    said = problems_of(tmp_path, wrong + '[split]\nestimation = -1\ncolumn = "role"\n')
    assert "robot.tool_mm: " in said
    assert "robot: give either name" in said
    assert 'split: give estimation = N or column = "…", not both' in said
    assert "frame in the flange" not in said


def test_effects_after_a_wrong_one_keep_their_numbers(tmp_path: Path) -> None:
    wrong = EFFECT.format(1, "q1").replace('"rz"', '"rq"') + EFFECT.format(9, "q1")
    said = problems_of(tmp_path, PLAIN + wrong)
    assert "simulate.effect.1.axis: expected 'tx'" in said
    assert "simulate.effect.2: frame 9, but puma760 has frames 1 to 7" in said
    assert "simulate.effect.1: frame" not in said


def test_a_cause_left_out_is_no_unknown_mechanism(tmp_path: Path) -> None:
    own = '[[covariate]]\ncauses = []\nname = "mine"\nframe = 1\naxis = "rz"\n'
    said = problems_of(tmp_path, PLAIN.replace('"geometric"', '"geometric", "mine"') + own)
    assert "covariate.1: causes lists nothing" in said
    assert "unknown mechanism" not in said


def test_a_study_to_simulate_needs_no_file(tmp_path: Path) -> None:
    (tmp_path / "study.toml").write_text(PLAIN.replace("seed = 1", "sed = 1"))
    with pytest.raises(StudyError) as error:
        simulate_study(tmp_path)
    assert error.value.problems == ('study.toml: unknown key "sed". Did you mean "seed"?',)


def test_names_are_compared_with_the_file(tmp_path: Path) -> None:
    """Unknown columns of the mapping and absent ones, unknown names of an effect, too many
    configurations: in one refusal."""
    rows = ["q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,x_mm,y_mm,z_mm,heat"]
    rows += [",".join(str(10 * k + j) for j in range(10)) for k in range(3)]
    (tmp_path / "none.csv").write_text("\n".join(rows))
    split = "[split]\nestimation = 30\n"
    effect = EFFECT.format(1, "q9+het")
    (tmp_path / "study.toml").write_text(PLAIN + split + effect)
    with pytest.raises(StudyError) as error:
        rehearse_study(tmp_path)
    assert [problem.partition(" in ")[0] for problem in error.value.problems] == [
        "study.toml: split.estimation = 30, but the file has 3 configurations: ask for fewer.",
        'study.toml: simulate.effect.1: unknown name "q9"',
        'study.toml: simulate.effect.1: unknown name "het"',
    ]
    *others, last = error.value.problems
    columns = "The file's further columns of numbers: heat."
    assert last.endswith(columns)
    assert not [problem for problem in others if columns in problem]
    with pytest.raises(StudyError) as error:
        simulate_study(tmp_path)
    assert last in error.value.problems
    columns = 'columns = { q1_dg = "J1", q2_deg = "J2" }\n'
    mapped = PLAIN.replace('"none.csv"\n', '"none.csv"\n' + columns)
    (tmp_path / "study.toml").write_text(mapped)
    with pytest.raises(StudyError) as error:
        rehearse_study(tmp_path)
    unknown, absent = error.value.problems
    assert unknown.startswith('study.toml: measurements.columns: unknown column "q1_dg"')
    assert '"J1", given for q1_dg; "J2", given for q2_deg.' in absent


def test_a_problem_is_said_with_the_file_whatever_finds_it(tmp_path: Path) -> None:
    """The same name is told by what reads the file, where a value is wrong, by what reads the
    measurements, and by what simulates them; a study made in Python has no file."""
    said = "simulate.effect.1: frame 9, but puma760 has frames 1 to 7."
    text = PLAIN + EFFECT.format(9, "q1")
    beside_values = problems_of(tmp_path, text.replace("seed = 1", "sed = 1"))
    assert f"study.toml: {said}" in beside_values.splitlines()
    write_targets(tmp_path)
    (tmp_path / "study.toml").write_text(text.replace(*OF_TWO))
    read = read_study(tmp_path)
    for run in (rehearse_study, run_study, simulate_study):
        with pytest.raises(StudyError) as error:
            run(read, tmp_path)
        assert error.value.problems == (f"study.toml: {said}",)
    made = Study(**dict(read))
    assert made == read
    with pytest.raises(StudyError) as error:
        rehearse_study(made, tmp_path)
    assert error.value.problems == (said,)


def test_what_is_found_last_is_said_with_the_file_too(tmp_path: Path) -> None:
    write_targets(tmp_path)
    by_group = '[comparison]\nby = "group"\n'
    (tmp_path / "study.toml").write_text(PLAIN.replace(*OF_TWO) + by_group)
    for run in (rehearse_study, run_study):
        with pytest.raises(StudyError) as error:
            run(tmp_path)
        assert error.value.problems[0].startswith('study.toml: comparison.by = "group": ')


def test_two_faults_of_the_data_are_one_refusal(tmp_path: Path) -> None:
    (tmp_path / "none.csv").write_text("a,b\n1,2\n")
    columns = 'columns = { q1_rad = "J1" }\n'
    mapped = PLAIN.replace('"none.csv"\n', '"none.csv"\n' + columns)
    (tmp_path / "study.toml").write_text(mapped + '[split]\ncolumn = "role"\n')
    with pytest.raises(DataError) as error:
        rehearse_study(tmp_path)
    first, second = str(error.value).splitlines()
    assert 'column "J1", given for q1_rad, is not in the file' in first
    assert 'split column "role" is missing' in second
