"""All errors of a study file are said at once, those in names among them."""

from __future__ import annotations

from pathlib import Path

import pytest

from modelsel.config.study_file import Study
from modelsel.exceptions import StudyError
from modelsel.study.named_things import read_whole_study
from modelsel.study.runner import rehearse_study
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
    for run, count in ((rehearse_study, 2), (simulate_study, 3)):
        with pytest.raises(StudyError) as error:
            run(tmp_path)
        problems = error.value.problems
        assert len(problems) == count
        assert problems[0].startswith("simulate.effect 1: frame 99, but ")
        assert problems[-1].startswith('simulate.effect 2: "q1+" is not a cause')
