"""What `modelsel check` says of a study is what the study does: its tool, its registration, its
refusals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from modelsel.config.study_file import Study
from modelsel.config.study_tables import ModelTable, SplitTable
from modelsel.exceptions import DataError, NotEstimable, StudyError
from modelsel.fitting.design import residuals
from modelsel.measurements.reader import read_measurements
from modelsel.mechanisms.registry import BUILTIN
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import forward
from modelsel.robot.rigid import rotation_matrix
from modelsel.study.inputs.inputs import read_inputs
from modelsel.study.inspection.inspection import inspect_measurements
from modelsel.study.inspection.inspection_text import format_inspection
from modelsel.study.inspection.study_inspection import inspect_study
from modelsel.study.pipeline.pipeline import list_unidentifiable
from modelsel.study.pipeline.runner import rehearse_study, run_study
from modelsel.study.preparation.preparation import prepare

ROBOT = load_robot("puma760")
TOOL = (40.0, -10.0, 120.0)
HEADER = "q1_rad,q2_rad,q3_rad,q4_rad,q5_rad,q6_rad,x_mm,y_mm,z_mm,group"


def write_data(folder: Path, rng: np.random.Generator, *, is_moved: bool) -> None:
    """Write 60 configurations in two groups, in the robot's base or before a tracker that stood at
    two places."""
    q = ROBOT.draw(rng, 60)
    position = forward(ROBOT, q, np.array(TOOL)) + rng.normal(0, 0.05, (60, 3))
    lines = [HEADER]
    for row in range(60):
        group = row // 30
        point = position[row]
        if is_moved:
            point = rotation_matrix(2, 0.4 + group) @ point + np.array([900.0, 200.0, 50.0 * group])
        numbers = ",".join(f"{value:.6f}" for value in (*q[row], *point))
        lines.append(f"{numbers},day {group}")
    (folder / "m.csv").write_text("\n".join(lines))


def make_study(**robot: object) -> Study:
    table = {"name": "puma760", **robot}
    return Study(name="s", seed=3, robot=table, measurements="m.csv", split={"estimation": 40})


@pytest.mark.parametrize(
    "robot",
    [
        {"tool_mm": (41.0, -10.0, 120.0)},
        {"register": True},
        pytest.param({"register": "per group"}, marks=pytest.mark.slow),
    ],
    ids=["tool", "registered", "per group"],
)
def test_check_has_the_robot_where_the_study_has_it(
    robot: dict[str, object], tmp_path: Path, rng: np.random.Generator
) -> None:
    write_data(tmp_path, rng, is_moved=robot.get("register") == "per group")
    study = make_study(**robot)
    found = inspect_study(study, tmp_path)
    described = found["study"]
    split, _, _ = prepare(study, *_read(study, tmp_path))
    distances = np.linalg.norm(residuals(split.problem)[:, :3], axis=1)
    assert described["refused"] is None
    assert described["median_mm"] == pytest.approx(np.median(distances), rel=1e-12)
    (target,) = described["target_on_flange"]
    np.testing.assert_allclose(target["position_mm"], split.problem.tools[0])
    assert described["registered"] == ("register" in robot)
    assert len(described["base_in_tracker"]) == (2 if "per group" in robot.values() else 1)
    said = "\n".join(format_inspection(found))
    assert ("Registered as the study does" in said) == ("register" in robot)
    assert ("as the study states them" in said) == ("tool_mm" in robot)
    assert ("Base of the nominal robot" in said) == ("register" in robot)
    if "tool_mm" in robot:
        np.testing.assert_allclose(described["median_mm"], 1.0, atol=0.1)


def _read(study: Study, folder: Path) -> tuple[object, ...]:
    robot, _, measured, labels = read_inputs(study, folder, BUILTIN)
    return robot, measured, labels


@pytest.mark.slow
@pytest.mark.parametrize(
    "robot", [{"tool_mm": TOOL}, {"register": True}], ids=["tool", "registered"]
)
def test_check_and_study_determine_the_same_parameters(
    robot: dict[str, object], tmp_path: Path, rng: np.random.Generator
) -> None:
    write_data(tmp_path, rng, is_moved=False)
    study = make_study(**robot)
    found = inspect_study(study, tmp_path)
    result = run_study(study, tmp_path, sampling=False)
    base = result.run.base
    assert found["geometry"]["parameters"] == len(base.fit.terms)
    told = [group["sentence"] for group in found["unidentifiable"]]
    of_study = list_unidentifiable(base.fit)
    assert [group.sentence for group in of_study[: len(told)]] == told
    # what the noise leaves to the prior, only the fit can tell
    hardly = [name for group in of_study[len(told) :] for name in group.parameters]
    assert found["geometry"]["rank"] == base.rank + len(hardly)


@pytest.mark.slow
def test_check_tells_what_the_study_refuses(tmp_path: Path, rng: np.random.Generator) -> None:
    write_data(tmp_path, rng, is_moved=True)
    study = make_study(tool_mm=TOOL)
    with pytest.raises(DataError) as error:
        prepare(study, *_read(study, tmp_path))
    found = inspect_study(study, tmp_path)
    assert found["study"] == {"refused": [str(error.value)], "exit": DataError.exit_code}
    lines = format_inspection(found)
    assert f"`modelsel study` refuses this study: {error.value}" in lines


def test_check_tells_every_name_that_the_study_refuses(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    write_data(tmp_path, rng, is_moved=False)
    study = make_study(tool_mm=TOOL)
    changes = {"model": {"base": ["geometrc"], "candidates": ["backlsh"]}}
    wrong = Study(**(study.model_dump(by_alias=True) | changes))
    with pytest.raises(StudyError) as error:
        _read(wrong, tmp_path)
    refused = inspect_study(wrong, tmp_path)["study"]["refused"]
    assert refused == list(error.value.problems)
    assert len(refused) == 2


def test_check_refuses_measurements_that_are_not_there(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no such file"):
        inspect_study(make_study(tool_mm=TOOL), tmp_path)


def test_check_tells_that_too_few_configurations_estimate(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    """What the study's first fit refuses is said by its rehearsals."""
    write_data(tmp_path, rng, is_moved=False)
    study = make_study(tool_mm=TOOL)
    few = study.model_copy(update={"split": SplitTable(estimation=2)})
    said = set()
    for run in (run_study, rehearse_study):
        with pytest.raises(NotEstimable, match="cannot determine") as error:
            run(few, tmp_path)
        said.add(str(error.value))
    assert len(said) == 1
    refused = {"refused": [*said], "exit": NotEstimable.exit_code}
    assert inspect_study(few, tmp_path)["study"] == refused


def test_check_tells_names_of_the_study_with_its_gear_ratios(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    """A base that only the study's gear ratios make is no reason to refuse it."""
    write_data(tmp_path, rng, is_moved=False)
    study = make_study(tool_mm=TOOL, gear_ratios=[0, 121, 0, 0, 0, 0])
    base = ModelTable(base=["geometric", "gear-ripple:2:121"])
    of_gear = study.model_copy(update={"model": base})
    rehearse_study(of_gear, tmp_path)
    assert inspect_study(of_gear, tmp_path)["study"]["refused"] is None


@pytest.mark.parametrize("robot", [{"tool_mm": TOOL}, {"register": True}])
def test_the_keys_of_a_file_are_those_of_a_study(
    robot: dict[str, object], tmp_path: Path, rng: np.random.Generator
) -> None:
    """A study's own registration takes the place of the file's; without one, the file's stays."""
    write_data(tmp_path, rng, is_moved=False)
    of_file = inspect_measurements(ROBOT, read_measurements(tmp_path / "m.csv", ROBOT))
    found = inspect_study(make_study(**robot), tmp_path)
    assert found.keys() == of_file.keys() | {"study"}
    assert found["geometry"].keys() == of_file["geometry"].keys()
    assert found["geometry"]["tool_mm"] is None
    assert found["registered"].keys() == of_file["registered"].keys()
    if "register" not in robot:
        assert found["registered"] == of_file["registered"]
        return
    for key, value in found["registered"].items():
        assert value == found["study"][key]


def test_no_places_beyond_the_limits_are_none(tmp_path: Path, rng: np.random.Generator) -> None:
    write_data(tmp_path, rng, is_moved=False)
    found = inspect_study(make_study(tool_mm=TOOL), tmp_path)
    for joint in found["joints"]:
        assert joint["rows_beyond_limits"] == 0
        assert joint["places_beyond_limits"] is None
