"""Commands through the correction land where they should: on the model, and on an arm in a
rigid-body engine."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from builders import drawn
from click.testing import CliRunner
from hidden_arm import arm
from hidden_engine import Engine
from wide_calibration import wide

from modelsel.calibration.arm_alone import leave_out_instrument
from modelsel.calibration.calibration_file import calibration_text
from modelsel.calibration.commands.command_notes import (
    describe_extrapolation,
    describe_order_dependence,
)
from modelsel.calibration.commands.commands_table import build_commands_table
from modelsel.calibration.commands.compensation import (
    MAX_CORRECTION,
    compensate_commands,
    correct,
    predict_nominal,
    replace_readings,
)
from modelsel.calibration.commands.large_changes import (
    MAX_LISTED,
    describe_skipped,
    find_skipped,
    find_weakest,
    leave_out_rows,
    refuse_large_changes,
)
from modelsel.calibration.prediction import compute_pose, predict
from modelsel.cli.main import run_command_line
from modelsel.config.study_file import parse_study
from modelsel.exceptions import DataError, write_rounded
from modelsel.fitting.design import Model
from modelsel.fitting.whitening import Whitening
from modelsel.measurements.campaign.state_names import is_state_name
from modelsel.measurements.measurements import Orientation, build_measurements
from modelsel.mechanisms.registry import mechanism
from modelsel.mechanisms.terms import Mechanism
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import forward
from modelsel.robot.rigid import from_quaternion, rotation_vector
from modelsel.study.pipeline.runner import run_study

NOISE = 0.06
STUDY = """name = "engine"
seed = 1
[robot]
name = "puma760"
tool_mm = [0, 0, 100]
[measurements]
file = "measurements.csv"
[split]
estimation = 100
"""


@pytest.fixture(scope="module")
def made():
    return wide(np.random.default_rng(3))


def plan(at, rows: slice, **more):
    """Planned commands, off the readings of a problem by nothing, their wanted positions given."""
    data = at.data
    return build_measurements(
        data.q[rows].copy(),
        more.pop("position", np.full((len(data.q[rows]), 3), np.nan)),
        target=[data.targets[k] for k in data.target[rows]],
        group=[data.groups[k] for k in data.group[rows]],
        covariates={k: v[rows].copy() for k, v in data.covariates.items()},
        approach=data.approach[rows].copy(),
        **more,
    )


def test_lands_on_the_model(made) -> None:
    c, at = made
    data = plan(at, slice(1, 90))
    found = compensate_commands(c, data)
    # what refracts the beam moves no arm
    real = leave_out_instrument(c)
    there = replace_readings(c.problem(data), found.q)
    assert found.reached.all()
    assert np.abs(predict(real, there) - predict_nominal(c.problem(data))).max() < 1e-3
    np.testing.assert_allclose(
        found.before_mm, np.linalg.norm(predict(real, c.problem(data)) - found.wanted, axis=1)
    )
    assert found.before_mm.mean() > 0.05
    assert (found.expected_mm > np.sqrt(3) * 0.02).all()


def test_least_change(made) -> None:
    """Of all commands that land there, the nearest: any other direction that keeps the position is
    longer."""
    c, at = made
    found = compensate_commands(c, plan(at, slice(1, 30)))
    J = (
        c.problem(plan(at, slice(1, 30)))
        .pose(slice(0, 29))
        .displacement()[:6, 5]
        .transpose(2, 1, 0)
    )
    still = np.linalg.svd(J)[2][:, 3:]  # (m, 3, 6) motions that move nothing
    along = np.abs(np.einsum("mkn,mn->mk", still, found.change)).max(1)
    assert np.median(along / np.linalg.norm(found.change, axis=1)) < 0.01


def test_orientation_is_kept_where_wanted(made, rng) -> None:
    c, at = made
    data = plan(
        at, slice(1, 40), orientation=Orientation(from_quaternion(rng.normal(size=(39, 4))))
    )
    free = compensate_commands(c, replace(data, rotation=None))
    wanted = c.problem(data).pose(slice(0, 39)).rotation.transpose(2, 0, 1)
    kept = compensate_commands(c, replace(data, rotation=wanted))
    assert kept.reached.mean() > 0.9

    def turned(found) -> np.ndarray:
        R = compute_pose(
            replace_readings(c.problem(data), found.q), c.terms, c.theta
        ).rotation.transpose(2, 0, 1)
        return np.arccos(np.clip((np.einsum("mij,mij->m", R, wanted) - 1) / 2, -1, 1))

    assert np.median(turned(kept)) < 1e-5 < np.median(turned(free))


def test_refuses_beyond_the_bound(made) -> None:
    c, at = made
    data = plan(at, slice(1, 9), position=predict(c, at)[1:9])
    data.position[4] += 30.0
    with pytest.raises(DataError, match=r"row 4: .* beyond the bound of 10 mrad and 20 mm"):
        refuse_large_changes(c, compensate_commands(c, data), data, MAX_CORRECTION, "t.csv")
    refuse_large_changes(c, compensate_commands(c, data), data, (10.0, 1e3), "t.csv")


def test_one_row_beyond_the_bound_is_left_out_with_its_own_message(made) -> None:
    """And where it is most rows, the file is refused as a whole."""
    c, at = made
    data = plan(at, slice(1, 9), position=predict(c, at)[1:9])
    data.position[4] += 30.0
    commands = compensate_commands(c, data)
    skipped = find_skipped(c, commands, data, MAX_CORRECTION, "t.csv")
    assert skipped.tolist() == [False] * 4 + [True] + [False] * 3
    (said,) = describe_skipped(c, commands, data, MAX_CORRECTION, skipped)
    assert said.startswith("row 4 is left out: ")
    assert "Check that the wanted position belongs to the command, or raise --bound." in said
    data.position[:] += 30.0
    with pytest.raises(DataError, match=r"such rows\)"):
        find_skipped(c, compensate_commands(c, data), data, MAX_CORRECTION, "t.csv")


@pytest.mark.parametrize(
    ("count", "rest"), [(1, "1 more row is left out"), (2, "2 more rows are left out")]
)
def test_of_many_rows_left_out_the_rest_is_counted(made, count, rest) -> None:
    c, at = made
    data = plan(at, slice(1, 30), position=predict(c, at)[1:30])
    skipped = np.arange(29) < MAX_LISTED + count
    data.position[skipped] += 30.0
    said = describe_skipped(c, compensate_commands(c, data), data, MAX_CORRECTION, skipped)
    assert said[MAX_LISTED:] == [f"{rest} for the same reason."]


def test_rows_left_out_change_the_motion_of_those_after_them(made, tmp_path) -> None:
    """The commands are those of a plan that never had the row."""
    c, at = made
    (tmp_path / "calibration.json").write_text(calibration_text(c))
    columns = {f"q{j + 1}_rad": at.data.q[1:30, j] for j in range(6)}
    columns |= dict(zip(("x_mm", "y_mm", "z_mm"), predict_nominal(at)[1:30].T, strict=True))
    columns |= {"target": np.array(at.data.targets)[at.data.target[1:30]]}
    columns |= {"group": np.array(at.data.groups)[at.data.group[1:30]]}
    columns |= {"temperature_C": at.data.covariates["temperature_C"][1:30]}
    table = pd.DataFrame(columns)
    turns = np.flatnonzero(np.diff(np.sign(np.diff(table["q3_rad"]))))
    spoilt = int(turns[3]) + 1  # where joint 3 turns back: the next row comes from the other side
    table.loc[spoilt, "x_mm"] += 40.0

    def corrected(plan: pd.DataFrame, status: int) -> tuple[pd.DataFrame, str]:
        plan.to_csv(tmp_path / "plan.csv", index=False)
        command = ["compensate", str(tmp_path), str(tmp_path / "plan.csv")]
        ran = CliRunner().invoke(run_command_line, [*command, "--out", str(tmp_path / "out.csv")])
        assert ran.exit_code == status, ran.output
        return pd.read_csv(tmp_path / "out.csv"), ran.output

    found, said = corrected(table, 5)
    wanted, _ = corrected(table.drop(index=spoilt), 0)
    pd.testing.assert_frame_equal(found, wanted)
    assert "Approach directions were taken without the omitted rows." in said


def test_directions_that_were_given_outlast_rows_left_out(made) -> None:
    _, at = made
    left_out = np.arange(8) == 3
    data = plan(at, slice(1, 9))
    some = leave_out_rows(data, left_out)
    np.testing.assert_array_equal(some.approach, data.approach[~left_out])
    steps = np.abs(np.diff(some.q[:, 2]))
    within = np.diff(some.group) == 0
    np.testing.assert_allclose(some.move[1:, 2][within], steps[within])


def test_a_change_that_the_posture_makes_large_names_the_singularity(made) -> None:
    """The arm stretched out: what lies along it takes a large turn."""
    c, at = made
    data = plan(at, slice(1, 9))
    nominal = predict_nominal(c.problem(data))
    data = replace(data, position=nominal)
    commands = compensate_commands(c, data)
    weak = replace(commands, weakest=np.full(8, 0.0153), change=np.full((8, 6), 0.0129))
    said = describe_skipped(c, weak, data, (10e-3, 1e3), np.arange(8) == 2)
    assert len(said) == 1
    assert "joint 1 would be changed by 12.9 mrad to move the target by" in said[0]
    assert "the arm is nearly singular in this posture" in said[0]
    assert "takes 15.3 mrad), beyond the bound of 10 mrad" in said[0]
    assert "Choose another posture for this point" in said[0]


def test_weakest_direction_is_told_where_it_makes_the_change() -> None:
    J = np.stack([np.diag([1000.0, 800.0, 50.0])] * 3 + [np.diag([1000.0, 800.0, 500.0])])
    missing = np.array([[0.1, 0.1, 1.0], [1.0, 1.0, 0.01], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(find_weakest(J, missing), [1 / 50, 0.0, 0.0, 0.0])


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_a_frame_of_targets_in_and_out(made) -> None:
    """Planned commands and wanted positions as a DataFrame; corrected ones come back, refused ones
    by their row."""
    c, at = made
    data = plan(at, slice(1, 9))
    data = replace(data, position=predict_nominal(c.problem(data)))
    frame = data.to_frame().drop(columns=["configuration", "order"])
    found, made_here = correct(c, frame), compensate_commands(c, data)
    np.testing.assert_allclose(found[[f"q{j}_rad" for j in range(1, 7)]], made_here.q, atol=1e-9)
    np.testing.assert_allclose(
        found["expected_error_mm"], made_here.expected_mm.round(6), rtol=1e-12
    )
    frame.iloc[4, frame.columns.get_loc("x_mm")] += 30.0
    with pytest.raises(
        DataError, match=r"DataFrame, row 4: .* beyond the bound .* raise the bound"
    ):
        correct(c, frame)
    with pytest.warns(UserWarning, match="1 of 1 rows lies beyond the"):
        correct(
            c,
            frame[:1].drop(columns=["x_mm", "y_mm", "z_mm"]).assign(q2_rad=4.0),
            bound=(10.0, 1e3),
        )


def test_outside_is_said(made) -> None:
    c, at = made
    joints = [replace(j, limits=(-3.2, 3.2)) for j in c.robot.joints]
    c, data = replace(c, robot=replace(c.robot, joints=tuple(joints))), plan(at, slice(1, 9))
    assert describe_extrapolation(c, data) == []
    data.q[3, 1] = 4.0
    data.covariates["temperature_C"][:2] = 80.0
    data.approach[0, 2] = 0
    said = " ".join(describe_extrapolation(c, data))
    assert "q2: 1 of 8" in said
    assert "temperature_C: 2 of 8" in said
    assert "joint 2: 1 of 8 rows lies beyond its limits" in said
    assert "joint 3: the direction of approach" in said
    assert "payload" not in said  # not needed: not said


def engine_error(landed: np.ndarray, wanted: np.ndarray) -> float:
    return float(np.sqrt(np.square(landed - wanted).mean()))


@pytest.mark.slow
def test_arm_in_an_engine_lands_within_the_noise(tmp_path) -> None:
    """Masses and springs in a rigid-body engine, play that the last motion decides, ripple of a
    gear, a warm link's zero."""
    rng = np.random.default_rng(20)
    robot = load_robot("puma760")
    real = arm(robot, rng)
    places = rng.uniform(-60, 60, (6, 3))
    places[1, 0] += 300
    places[3, 2] += 250
    engine = Engine(real, (4.0, 8.0, 5.0, 2.0, 1.0, 0.5), places)

    def measure(q: np.ndarray, before: np.ndarray, temperature: np.ndarray) -> np.ndarray:
        turned = q.copy()
        turned[:, 0] += 2e-4 * np.sin(12 * q[:, 0] + 0.4) + 2e-4 * np.sign(q[:, 0] - before[:, 0])
        turned[:, 1] += 3e-5 * (temperature - 22)
        return engine.measure(turned, drives={2: 9e4, 3: 4e4})

    q = real.draw(rng, 160)
    before = np.vstack([q[:1], q[:-1]])
    temperature = rng.uniform(18, 30, 160)
    x = measure(q, before, temperature) + rng.normal(0, NOISE, (160, 3))
    columns = {f"q{j + 1}_rad": q[:, j] for j in range(6)} | dict(
        zip(("x_mm", "y_mm", "z_mm"), x.T, strict=True)
    )
    pd.DataFrame(columns | {"temperature_C": temperature}).to_csv(
        tmp_path / "measurements.csv", index=False
    )
    c = run_study(parse_study(STUDY, "study.toml"), tmp_path, sampling=False).calibration

    plan_q = real.draw(rng, 60)
    last = np.vstack([plan_q[:1] - 1e-1, plan_q[:-1]])
    warm = rng.uniform(19, 29, 60)
    data = build_measurements(
        plan_q,
        np.full((60, 3), np.nan),
        approach=np.sign(plan_q - last),
        covariates={"temperature_C": warm},
    )
    found = compensate_commands(c, data)
    wanted = forward(robot, plan_q, np.array([0.0, 0, 100]))
    off = engine_error(measure(plan_q, last, warm), wanted)
    landed = engine_error(
        measure(found.q, np.vstack([found.q[:1] - 1e-1, found.q[:-1]]), warm), wanted
    )
    assert found.reached.all()
    assert off > 1.0
    assert landed < 1.5 * NOISE
    assert (
        0.3 < landed / np.sqrt(np.square(found.model_mm).mean() / 3) < 3
    )  # as uncertain as it says


def test_command(made, tmp_path) -> None:
    c, at = made
    (tmp_path / "calibration.json").write_text(calibration_text(c))
    rows = slice(1, 30)
    columns = {f"q{j + 1}_deg": np.degrees(at.data.q[rows, j]) for j in range(6)}
    columns |= {f"approach{j + 1}": at.data.approach[rows, j].astype(int) for j in range(6)}
    columns |= {
        "target": np.array(at.data.targets)[at.data.target[rows]],
        "group": "tue",
        "temperature_C": at.data.covariates["temperature_C"][rows],
    }
    pd.DataFrame(columns).to_csv(tmp_path / "plan.csv", index=False)
    out = tmp_path / "out.csv"
    ran = CliRunner().invoke(
        run_command_line,
        ["compensate", str(tmp_path), str(tmp_path / "plan.csv"), "--out", str(out)],
    )
    assert ran.exit_code == 0, ran.output
    assert "expected" in ran.output
    wrote = pd.read_csv(out)
    assert (wrote["error_left_mm"] < 1e-3).all()
    back = CliRunner().invoke(
        run_command_line,
        ["compensate", str(tmp_path), str(tmp_path / "plan.csv"), "--out", str(out), "--forward"],
    )
    assert back.exit_code == 0
    assert (
        np.abs(
            pd.read_csv(out)[["x_mm", "y_mm", "z_mm"]].to_numpy()
            - wrote[["x_mm", "y_mm", "z_mm"]].to_numpy()
        ).max()
        > 0.05
    )
    out.unlink()
    ran = CliRunner().invoke(
        run_command_line,
        [
            "compensate",
            str(tmp_path),
            str(tmp_path / "plan.csv"),
            "--out",
            str(out),
            "--bound",
            "0.01",
            "20",
        ],
    )
    assert ran.exit_code == 3
    assert not out.exists()


def test_a_value_of_all_rows_needs_no_column(made, tmp_path) -> None:
    """--at gives what the file has no column of; a name that the model does not look at, or that the
    file has already, is refused."""
    c, at = made
    (tmp_path / "calibration.json").write_text(calibration_text(c))
    (needed,) = [name for name in c.needs() if not is_state_name(name)]
    columns = {f"q{j + 1}_deg": np.degrees(at.data.q[1:9, j]) for j in range(6)}
    columns |= {f"approach{j + 1}": at.data.approach[1:9, j].astype(int) for j in range(6)}
    columns |= {"target": np.array(at.data.targets)[at.data.target[1:9]], "group": "tue"}
    bare, full = tmp_path / "bare.csv", tmp_path / "full.csv"
    pd.DataFrame(columns).to_csv(bare, index=False)
    pd.DataFrame({**columns, needed: 24.5}).to_csv(full, index=False)

    def ran(plan, *words: str):
        command = ["compensate", str(tmp_path), str(plan), "--out", str(tmp_path / "o.csv"), *words]
        return CliRunner().invoke(run_command_line, command)

    refused = ran(bare)
    assert refused.exit_code == 3
    lacks = f"modelsel: bare.csv, line 1: the calibrated model needs {needed}, for which there is no column. Add one"
    either = f"{lacks}, or give one value for all rows: --at {needed}=NUMBER.\n"
    assert refused.stderr == either
    measured = tmp_path / "measured.csv"
    points = dict(zip(("x_mm", "y_mm", "z_mm"), at.data.position[1:9].T, strict=True))
    pd.DataFrame(columns | points).to_csv(measured, index=False)
    # no option of another command
    validated = CliRunner().invoke(run_command_line, ["validate", str(tmp_path), str(measured)])
    assert validated.exit_code == 3
    assert validated.stderr == lacks.replace("bare", "measured") + ".\n"
    assert ran(bare, "--at", f"{needed}=24.5").exit_code == 0
    held = pd.read_csv(tmp_path / "o.csv")
    assert ran(full).exit_code == 0
    pd.testing.assert_frame_equal(held, pd.read_csv(tmp_path / "o.csv"))
    for words, said in (
        (["--at", "humidity=3"], f"looks at: {needed}."),
        (["--at", f"{needed}=warm"], "expected NAME=NUMBER"),
        (
            ["--at", f"{needed}=333"],
            f"--at {needed}=333: expected a number between -273.15 and 200",
        ),
        (["--at", f"{needed}=1", "--at", f"{needed}=2"], "given twice"),
    ):
        answer = ran(bare, *words)
        assert (answer.exit_code in (2, 3), said in answer.stderr) == (True, True), answer.stderr
    assert "the file has it, too" in ran(full, "--at", f"{needed}=24.5").stderr


def test_directions_that_nobody_gave_are_not_written(made) -> None:
    c, at = made
    data = plan(at, slice(1, 9))
    bare = build_measurements(data.q, data.position, covariates=data.covariates)
    assert "approach3" in build_commands_table(c, bare, bare.q, bare.position, {})
    geometry = Mechanism("geometry", c.model.mechanisms[1].terms)
    plain = replace(c, model=Model((geometry,)), theta=c.theta[:6])
    assert "approach1" not in build_commands_table(plain, bare, bare.q, bare.position, {})
    assert "approach1" in build_commands_table(plain, data, data.q, data.position, {})


def test_a_slide_is_compensated(rng) -> None:
    """A joint that slides takes part."""
    from modelsel.calibration.calibration import calibrate
    from modelsel.fitting.least_squares import fit
    from modelsel.fitting.noise import Floor
    from modelsel.selection.evaluation import Split

    puma = load_robot("puma760")
    joints = [
        replace(j, prismatic=k == 2, limits=(0.0, 300.0) if k == 2 else j.limits)
        for k, j in enumerate(puma.joints)
    ]
    robot = replace(puma, joints=tuple(joints))
    at = replace(drawn(robot, rng, 80), whitening=Whitening(50.0))
    at = replace(at, data=replace(at.data, position=at.data.position + np.array([2.0, 1.0, -1.0])))
    model = Model((mechanism("geometric", robot),))
    every_row = np.ones(80, bool)
    c = calibrate(
        "slide",
        Split(at, every_row, ~every_row, np.zeros(80, np.intp), True),
        fit(at, model),
        Floor(0.02, "stated"),
        None,
        False,
        {},
    )
    found = compensate_commands(c, plan(at, slice(1, 40)))
    assert found.reached.all()
    assert np.abs(found.change[:, 2]).max() > 0.1  # mm


def limited(c, joint: int, low: float, high: float):
    """The calibration with limits of one joint alone."""
    joints = [
        replace(j, limits=(low, high) if k == joint - 1 else None)
        for k, j in enumerate(c.robot.joints)
    ]
    return replace(c, robot=replace(c.robot, joints=tuple(joints)))


def test_a_corrected_command_beyond_a_limit_is_said(made, tmp_path) -> None:
    """The planned ones are all within: what the correction adds goes beyond."""
    c, at = made
    data = plan(at, slice(1, 30))
    change = compensate_commands(c, data).change[:, 1]
    k = int(np.argmax(change))
    c = limited(c, 2, -4.0, float(data.q[:, 1].max()))
    data.q[k, 1] = data.q[:, 1].max()
    found = compensate_commands(c, data)
    stuck = found.q[:, 1] > c.robot.joints[1].limits[1] + 1e-9
    assert stuck.any()
    np.testing.assert_array_equal(found.beyond[:, 1], stuck)
    assert not found.beyond[:, [0, 2, 3, 4, 5]].any()
    assert describe_extrapolation(c, data) == []
    assert stuck.sum() == 1
    (tmp_path / "calibration.json").write_text(calibration_text(c))
    data.to_frame().drop(columns=["configuration", "order"]).to_csv(
        tmp_path / "plan.csv", index=False
    )
    words = [
        "compensate",
        str(tmp_path),
        str(tmp_path / "plan.csv"),
        "--out",
        str(tmp_path / "out.csv"),
    ]
    ran = CliRunner().invoke(run_command_line, words)
    assert ran.exit_code == 5
    assert "joint 2: 1 of 29 corrected commands lies beyond its limits" in ran.output
    assert f"line {', '.join(str(row + 2) for row in np.flatnonzero(stuck))})" in ran.output
    assert (tmp_path / "out.csv").exists()
    assert CliRunner().invoke(run_command_line, [*words, "--forward"]).exit_code == 0
    with (
        pytest.warns(UserWarning, match="refraction is an error of the instrument"),
        pytest.warns(UserWarning, match="corrected commands lies beyond its limits"),
    ):
        correct(c, data.to_frame().drop(columns=["configuration", "order"]))


def test_of_one_row_there_is_no_average(made) -> None:
    from modelsel.cli.compensate import _sentence

    c, at = made
    slides = np.array(c.robot.prismatic)
    one = _sentence(compensate_commands(c, plan(at, slice(1, 2))), slides)
    assert "on average" not in one
    assert "mm at most" not in one
    more = _sentence(compensate_commands(c, plan(at, slice(1, 4))), slides)
    assert "mm on average and " in more


def test_a_program_states_an_rms_error_and_no_bound(made, tmp_path) -> None:
    c, at = made
    data = plan(at, slice(1, 30))
    expected = compensate_commands(c, data).expected_mm.max()
    (tmp_path / "calibration.json").write_text(calibration_text(c))
    planned = data.to_frame().drop(columns=["configuration", "order"])
    planned.to_csv(tmp_path / "plan.csv", index=False)
    program = tmp_path / "go.src"
    words = ["compensate", str(tmp_path), str(tmp_path / "plan.csv"), "--format", "krl"]
    CliRunner().invoke(run_command_line, [*words, "--out", str(program)])
    written = " ".join(program.read_text().replace("; ", "").split())
    assert f"Expected error of the target: {write_rounded(expected)} mm rms at the" in written
    assert "single errors exceed it." in written
    assert "mm at most" not in written


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_what_is_left_is_in_what_is_expected(made) -> None:
    """Out of reach by a known length: the expected error cannot be less."""
    c, at = made
    data = plan(at, slice(1, 9))
    data = replace(data, position=predict_nominal(c.problem(data)))
    data.position[3] *= 1.5 * c.robot.reach / np.linalg.norm(data.position[3])
    found = compensate_commands(c, data)
    assert found.left_mm[3] > 10
    assert (found.expected_mm > found.left_mm).all()
    np.testing.assert_allclose(
        found.expected_mm**2, found.left_mm**2 + found.model_mm**2 + 3 * 0.02**2
    )
    assert not found.reached[3]


def test_orientation_errors_are_said(made, tmp_path) -> None:
    """Against angles of the test's own; without wanted orientations no word of them."""
    c, at = made
    data = plan(at, slice(1, 40))
    pose_at = c.problem(replace(data, rotation=np.tile(np.eye(3), (39, 1, 1)))).pose(slice(0, 39))
    wanted = pose_at.rotation.transpose(2, 0, 1)
    found, free = (
        compensate_commands(c, replace(data, rotation=wanted)),
        compensate_commands(c, data),
    )

    def off(q: np.ndarray) -> np.ndarray:
        R = compute_pose(
            replace_readings(c.problem(replace(data, rotation=wanted)), q), c.terms, c.theta
        ).rotation.transpose(2, 0, 1)
        return 2 * np.arcsin(np.clip(np.linalg.norm(R - wanted, axis=(1, 2)) / np.sqrt(8), 0, 1))

    np.testing.assert_allclose(found.before_rad, off(data.q), atol=1e-9)
    np.testing.assert_allclose(found.left_rad, off(found.q), atol=1e-9)
    assert (found.left_rad[found.reached] <= 1e-5).all()
    assert free.left_rad is None
    assert "orientation_left_mrad" in found.figures()
    assert "orientation_left_mrad" not in free.figures()
    (tmp_path / "calibration.json").write_text(calibration_text(c))
    frame = replace(data, rotation=wanted, position=predict_nominal(c.problem(data))).to_frame()
    frame.drop(columns=["configuration", "order"]).to_csv(tmp_path / "plan.csv", index=False)
    ran = CliRunner().invoke(
        run_command_line,
        [
            "compensate",
            str(tmp_path),
            str(tmp_path / "plan.csv"),
            "--out",
            str(tmp_path / "out.csv"),
            "--bound",
            "1000",
            "1000",
        ],
    )
    assert (
        f"Orientations are off by {1e3 * found.before_rad.mean():.3g} mrad on average" in ran.output
    )
    np.testing.assert_allclose(
        pd.read_csv(tmp_path / "out.csv")["orientation_before_mrad"],
        1e3 * found.before_rad,
        rtol=1e-5,
    )


def test_the_model_tells_how_well_it_knows_orientations(made) -> None:
    """By the exact chain at parameters that are off by each column of their covariance's factor."""
    c, at = made
    rotation = np.tile(np.eye(3), (8, 1, 1))
    data = replace(plan(at, slice(1, 9)), rotation=rotation)
    assert compensate_commands(c, data).model_rad is None
    known = replace(c, tool_rotations=np.tile(np.eye(3), (2, 1, 1)))
    found = compensate_commands(known, data)
    there = replace_readings(known.problem(data), found.q)
    turned = []
    for column in 0.1 * c.factor.T:
        ends = [
            compute_pose(there, c.terms, c.theta + sign * column).rotation.transpose(2, 0, 1)
            for sign in (-1, 1)
        ]
        turned.append(rotation_vector(ends[1] @ ends[0].transpose(0, 2, 1)) / 0.2)
    expected = np.sqrt(np.square(turned).sum((0, 2)))
    np.testing.assert_allclose(found.model_rad, expected, rtol=1e-4)
    figures = found.figures()
    np.testing.assert_allclose(figures["orientation_uncertainty_mrad"], 1e3 * expected, rtol=1e-4)


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_degrees_in_degrees_out(made) -> None:
    c, at = made
    data = plan(at, slice(1, 9))
    frame = data.to_frame().drop(columns=["configuration", "order"])
    degrees = frame.assign(q1_deg=np.degrees(frame["q1_rad"]), q4_deg=np.degrees(frame["q4_rad"]))
    degrees = degrees.drop(columns=["q1_rad", "q4_rad"])
    found, plain = correct(c, degrees), correct(c, frame)
    assert not {"q1_rad", "q4_rad"} & set(found.columns)
    for j in (1, 4):
        np.testing.assert_allclose(
            np.radians(found[f"q{j}_deg"]), plain[f"q{j}_rad"], rtol=0, atol=1e-12
        )
    np.testing.assert_allclose(found["q2_rad"], plain["q2_rad"], rtol=0, atol=1e-12)


def test_directions_taken_from_the_order_are_said(made) -> None:
    c, at = made
    data = plan(at, slice(1, 9))
    assert describe_order_dependence(c, data) == []
    bare = build_measurements(data.q, data.position, covariates=data.covariates)
    (said,) = describe_order_dependence(c, bare)
    assert "joint 3: the directions of approach are taken from the order of the targets" in said
    geometry = Mechanism("geometry", c.model.mechanisms[1].terms)
    assert (
        describe_order_dependence(replace(c, model=Model((geometry,)), theta=c.theta[:6]), bare)
        == []
    )
    lagging = mechanism("settle:2", c.robot)
    (said,) = describe_order_dependence(
        replace(c, model=Model((lagging,)), theta=np.zeros(len(lagging.terms))), data
    )
    assert "joint 2: the sizes of the moves are taken from the order" in said


def test_half_the_play_is_expected_where_the_approach_is_unknown(made) -> None:
    c, at = made
    data = plan(at, slice(1, 30))
    known = compensate_commands(c, data)
    approach = data.approach.copy()
    approach[:5] = 0
    found = compensate_commands(c, replace(data, approach=approach))
    ends = []
    for direction in (-1.0, 1.0):
        approach[:5] = direction
        side = replace(data, q=found.q, approach=approach)
        ends.append(c.predict(side)[:5])
    half = np.linalg.norm(ends[0] - ends[1], axis=1) / 2
    assert (half > 0).all()
    added = np.sqrt(found.expected_mm[:5] ** 2 - known.expected_mm[:5] ** 2)
    np.testing.assert_allclose(added, half, rtol=0.05)
    np.testing.assert_allclose(found.expected_mm[5:], known.expected_mm[5:])
