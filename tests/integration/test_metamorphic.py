"""What must not matter does not: rows, columns, units, names, the tracker's place, the robot file's
form, a joint's zero, copies.

One small campaign with two effects in it, told in many ways: every telling has the same findings,
the same chosen model and the same predictions, to 1e-9 of the arm's reach."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from builders import planted
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from modelsel.config.study_file import parse_study
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.causes import Named, q, sin
from modelsel.mechanisms.terms import Screw, Term
from modelsel.robot.files import robot_from_table
from modelsel.robot.kinematics import Robot, forward
from modelsel.study.pipeline.result import Result
from modelsel.study.pipeline.runner import run_study

DH = (
    (10.0, 300.0, 50.0, -90.0),
    (-20.0, 20.0, 400.0, 15.0),
    (30.0, 40.0, 80.0, 80.0),
)  # deg, mm, mm, deg
TOOL = (250.0, -60.0, 90.0)
ROWS, ESTIMATION, SIGMA, REACH = 84, 54, 0.03, 1000.0
AXES = ((0.0, 1.0, 0.0), (0.0, 0.0, -1.0), (0.48, -0.6, 0.64))  # of the joints in the xyz-rpy form
# a study or two each: a drawn share of them in CI
pytestmark = pytest.mark.long
few = settings(max_examples=4, suppress_health_check=list(HealthCheck))


def turn(
    axis: str, degrees: float, along: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> np.ndarray:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = Rotation.from_euler(axis, degrees, degrees=True).as_matrix(), along
    return out


def drawing() -> tuple[list[np.ndarray], np.ndarray]:
    """(N_1..N_n, what goes before `last`) of the standard DH rows, by the contract's words."""
    before, left = [], np.eye(4)
    for theta, d, a, alpha in DH:
        before.append(left @ turn("z", theta))
        left = turn("x", alpha, (a, 0.0, d))
    return before, left


def dh_form() -> dict[str, Any]:
    return {
        "convention": "standard",
        "joint": [
            {"dh": dict(zip(("theta_deg", "d_mm", "a_mm", "alpha_deg"), row, strict=True))}
            for row in DH
        ],
    }


def matrix_form(zeros: np.ndarray | None = None) -> dict[str, Any]:
    """As 3 x 4 transforms; `zeros` (n,) rad: what is to be added to the readings."""
    before, left = drawing()
    if zeros is not None:
        before = [N @ turn("z", -np.degrees(d)) for N, d in zip(before, zeros, strict=True)]
    return {
        "joint": [{"transform_mm": N[:3].tolist()} for N in before],
        "last": {"transform_mm": left[:3].tolist()},
    }


def origins() -> tuple[list[np.ndarray], np.ndarray]:
    """(origin of every joint, of the flange) for joints that turn about AXES: T_k = B_(k-1) N_k
    B_k^-1."""
    before, left = drawing()
    B = [np.eye(4)]
    for axis in AXES:
        T = np.eye(4)
        v = np.cross([0, 0, 1], axis)
        T[:3, :3] = (
            np.diag([1.0, -1, -1])
            if axis[2] == -1
            else Rotation.from_rotvec(v / np.linalg.norm(v) * np.arccos(axis[2])).as_matrix()
        )
        B.append(T)
    return [B[k] @ N @ np.linalg.inv(B[k + 1]) for k, N in enumerate(before)], B[-1] @ left


def rpy(T: np.ndarray) -> np.ndarray:
    return Rotation.from_matrix(T[:3, :3]).as_euler("xyz")


def axis_form() -> dict[str, Any]:
    joints, flange = origins()
    return {
        "joint": [
            {
                "xyz_mm": T[:3, 3].tolist(),
                "rpy_deg": np.degrees(rpy(T)).tolist(),
                "axis": list(axis),
            }
            for T, axis in zip(joints, AXES, strict=True)
        ],
        "last": {"transform_mm": flange[:3].tolist()},
    }


def urdf() -> str:
    joints, flange = origins()
    parts = [
        f'<joint name="j{k}" type="{kind}"><parent link="l{k}"/><child link="l{k + 1}"/><origin xyz="{x} {y} {z}" '
        f'rpy="{a} {b} {c}"/><axis xyz="{u} {v} {w}"/></joint>'
        for k, (kind, T, (u, v, w)) in enumerate(
            zip(["continuous"] * 3 + ["fixed"], [*joints, flange], [*AXES, AXES[0]], strict=True)
        )
        for (x, y, z), (a, b, c) in [(T[:3, 3] / 1e3, rpy(T))]
    ]
    return f'<robot name="small">{"".join(f"""<link name="l{k}"/>""" for k in range(5))}{"".join(parts)}</robot>'


def toml(robot: Mapping[str, Any]) -> str:
    """A robot file: TOML's arrays and inline tables are JSON's but for the colon."""

    def value(v: Any) -> str:
        return (
            "{ " + ", ".join(f"{k} = {value(x)}" for k, x in v.items()) + " }"
            if isinstance(v, dict)
            else json.dumps(v)
        )

    top = [f"{k} = {value(v)}" for k, v in robot.items() if k not in ("joint", "last")]
    joints = [
        "[[joint]]\n" + "\n".join(f"{k} = {value(v)}" for k, v in joint.items())
        for joint in robot["joint"]
    ]
    last = (
        ["[last]\n" + "\n".join(f"{k} = {value(v)}" for k, v in robot["last"].items())]
        if "last" in robot
        else []
    )
    return "\n".join(
        ['name = "small"', 'source = "made up"', "gravity = [0, 0, -1]", *top, *joints, *last]
    )


def campaign() -> pd.DataFrame:
    """84 configurations in order of motion: geometry, an oval encoder, overshoot and a zero that
    wanders with temperature."""
    rng = np.random.default_rng(1983)
    robot: Robot = robot_from_table(
        {"name": "small", "source": "made up", "gravity": [0, 0, -1], **matrix_form()}, "small.toml"
    )
    angles = rng.uniform([-2.6, -2.0, -2.2], [2.6, 1.0, 2.2], (ROWS, 3))
    covariates = {
        "temperature_C": rng.uniform(18, 30, ROWS).round(2),
        "time_s": 40.0 * np.arange(ROWS),
    }
    at = Problem(
        robot,
        build_measurements(angles, forward(robot, angles, np.array(TOOL)), covariates=covariates),
        np.array([TOOL]),
    )
    terms = (
        Term("a", (Screw(1, "tx"),)),
        Term("b", (Screw(2, "ry"),)),
        Term("c", (Screw(3, "rz"),)),
        Term("e", (Screw(2, "rz", sin(2.0 * q(2))),)),
        Term("p", (Screw(3, "rz", Named("approach3")),)),
        Term("t", (Screw(1, "rz", Named("temperature_C", "°C") - 20.0),)),
    )
    at = planted(at, terms, np.array([0.6, 1.2e-3, -4e-3, 0.6e-3, 0.4e-3, 0.05e-3]), rng, SIGMA)
    role = np.where(rng.permutation(ROWS) < ESTIMATION, "estimation", "held-out")
    columns = {f"q{j + 1}_rad": angles[:, j] for j in range(3)}
    columns |= dict(zip(("x_mm", "y_mm", "z_mm"), at.data.position.T, strict=True))
    columns |= {f"approach{j + 1}": at.data.approach[:, j] for j in range(3)}
    return pd.DataFrame(
        {
            **columns,
            "order": np.arange(ROWS),
            **covariates,
            "role": role,
            "id": 31 * np.arange(ROWS) % ROWS,
        }
    )


STUDY = """
name = "told"
seed = {seed}
[robot]
file = "{robot}"
{tool}
[measurements]
file = "{file}"
[split]
{split}
[model]
candidates = {candidates}
"""
# of any zero
TURNING = '["encoder-eccentricity", "gear-eccentricity", "approach-backlash", "overshoot", "thermal-zero"]'


class Telling:
    """Tells the campaign in some way and keeps what is said of it."""

    def __init__(self, folder: Path):
        self.folder, self.frame = folder, campaign()
        self.count = 0
        self.plain = self()
        self.by_seed = self(split=f"estimation = {ESTIMATION}")
        self.registered = self(register=True)
        self.turning = self(candidates=TURNING)

    def __call__(
        self,
        change: Callable[[pd.DataFrame], pd.DataFrame] = lambda f: f,
        *,
        robot: str | None = None,
        seed: int = 7,
        split: str = 'column = "role"',
        register: bool = False,
        parquet: bool = False,
        candidates: str = '"all"',
    ) -> Result:
        self.count += 1
        here = self.folder / str(self.count)
        here.mkdir()
        robot = robot or toml(matrix_form())
        name = "robot.urdf" if robot.startswith("<") else "robot.toml"
        (here / name).write_text(robot)
        file = "measurements.parquet" if parquet else "measurements.csv"
        frame = change(self.frame.copy())
        frame.to_parquet(here / file) if parquet else frame.to_csv(here / file, index=False)
        tool = "register = true" if register else f"tool_mm = {list(TOOL)}"
        if register:
            tool += f"\ntool_mm = {list(TOOL)}"
        return run_study(
            parse_study(
                STUDY.format(
                    seed=seed, robot=name, tool=tool, file=file, split=split, candidates=candidates
                ),
                "study.toml",
            ),
            here,
            sampling=False,
        )


@pytest.fixture(scope="module")
def telling(tmp_path_factory: pytest.TempPathFactory) -> Telling:
    return Telling(tmp_path_factory.mktemp("tellings"))


def positions(result: Result) -> np.ndarray:
    """(84, 3) predictions of the chosen model, by the measurement's own number."""
    data = result.split.problem.data
    out = np.full((ROWS, 3), np.nan)
    out[data.covariates["id"].astype(int)] = data.position - result.models.chosen.residual[:, :3]
    return out


def named(result: Result) -> list[tuple[str, str]]:
    """Name and verdict of every finding."""
    return [(f.first.name, f.verdict) for f in result.findings]


def same(
    told: Result,
    before: Result,
    rotation: np.ndarray | None = None,
    shift: np.ndarray | float = 0.0,
) -> None:
    """The same findings by name and verdict, the same chosen model, the same predictions (moved as
    the tracker was)."""
    assert named(told) == named(before)
    assert told.models.chosen.names == before.models.chosen.names
    wanted = positions(before) @ (np.eye(3) if rotation is None else rotation).T + shift
    np.testing.assert_allclose(positions(told), wanted, rtol=0, atol=1e-9 * REACH)


def test_the_campaign_says_something(telling: Telling) -> None:
    """Else nothing below could fail."""
    for result in (telling.plain, telling.by_seed, telling.registered, telling.turning):
        assert {name for name, _ in named(result)} == {
            "encoder-eccentricity:2",
            "overshoot:3",
            "thermal-zero:1",
        }
        assert result.models.chosen.held_out.rms_mm == pytest.approx(SIGMA * np.sqrt(3), rel=0.3)


@few
@given(seed=st.integers(0, 2**32 - 1))
@pytest.mark.parametrize("split", ["column", "seed"])
def test_order_of_rows(telling: Telling, split: str, seed: int) -> None:
    """With order, approach and time given, the file may be shuffled: the same configurations
    estimate, whoever chooses them."""

    def shuffled(frame: pd.DataFrame) -> pd.DataFrame:
        return frame.iloc[np.random.default_rng(seed).permutation(ROWS)]

    if split == "column":
        same(telling(shuffled), telling.plain)
    else:
        told = telling(shuffled, split=f"estimation = {ESTIMATION}")
        same(told, telling.by_seed)
        chosen = [
            set(r.problem.data.covariates["id"][r.split.estimation])
            for r in (told, telling.by_seed)
        ]
        assert chosen[0] == chosen[1]


def test_units_and_columns(telling: Telling) -> None:
    """Metres and degrees, columns in another order, CSV or Parquet."""

    def other(frame: pd.DataFrame) -> pd.DataFrame:
        for j in (1, 2, 3):
            frame[f"q{j}_deg"] = np.degrees(frame.pop(f"q{j}_rad"))
        for axis in "xyz":
            frame[f"{axis}_m"] = frame.pop(f"{axis}_mm") / 1e3
        return frame[frame.columns[::-1]]

    same(telling(other, parquet=True), telling.plain)


def test_the_target_is_renamed(telling: Telling) -> None:
    same(
        telling(lambda frame: frame.assign(target="SMR 3/8”, top", group="Tuesday")), telling.plain
    )


@few
@given(
    turned=st.tuples(*[st.floats(-np.pi, np.pi)] * 3), moved=st.tuples(*[st.floats(-5e3, 5e3)] * 3)
)
def test_the_trackers_frame(
    telling: Telling, turned: tuple[float, ...], moved: tuple[float, ...]
) -> None:
    """Any rigid motion of the tracker, found again by registration."""
    R, t = Rotation.from_rotvec(turned).as_matrix(), np.array(moved)

    def elsewhere(frame: pd.DataFrame) -> pd.DataFrame:
        frame[["x_mm", "y_mm", "z_mm"]] = frame[["x_mm", "y_mm", "z_mm"]] @ R.T + t
        return frame

    same(telling(elsewhere, register=True), telling.registered, R, t)


@few
@given(zeros=st.tuples(*[st.floats(-3.0, 3.0)] * 3))
def test_a_joints_zero(telling: Telling, zeros: tuple[float, ...]) -> None:
    """Readings counted from elsewhere, and a drawing that says so: every error is the same motion
    of the same joints."""

    def counted(frame: pd.DataFrame) -> pd.DataFrame:
        for j in range(3):
            frame[f"q{j + 1}_rad"] += zeros[j]
        return frame

    same(
        telling(counted, robot=toml(matrix_form(np.array(zeros))), candidates=TURNING),
        telling.turning,
    )


@pytest.mark.parametrize(
    "robot", [toml(dh_form()), toml(axis_form()), urdf()], ids=["dh", "xyz-rpy-axis", "urdf"]
)
def test_the_robot_files_form(telling: Telling, robot: str) -> None:
    same(telling(robot=robot), telling.plain)


def test_another_seed(telling: Telling) -> None:
    """Chance decides only folds, Monte-Carlo p-values and bootstraps where the split is given:
    names, models, fits stay."""
    told = telling(seed=8)
    same(told, telling.plain)
    assert [
        f.effect.named.entries[0].probability for f in told.diagnosis.findings
    ] == pytest.approx(
        [f.effect.named.entries[0].probability for f in telling.plain.diagnosis.findings], rel=1e-9
    )
    assert not np.array_equal(told.split.folds, telling.plain.split.folds)


# -- copies
# ---------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["cell for cell", "renumbered"])
def test_copied_rows_count_once(telling: Telling, kind: str) -> None:
    """A block of rows pasted in again, as it is or under new numbers and times: said, and counted
    once."""

    def pasted(frame: pd.DataFrame) -> pd.DataFrame:
        again = frame.iloc[20:33].copy()
        if kind == "renumbered":
            again["order"] += 1000
            again["time_s"] += 1e5
            again["role"] = "estimation"
        return pd.concat([frame, again])

    told = telling(pasted)
    same(told, telling.plain)
    said = {note.code: note.sentence for note in told.warnings}
    sentence = said["copied-rows" if kind == "renumbered" else "duplicate-rows"]
    assert sentence.startswith("13 rows")
    assert len(said.keys() & {"copied-rows", "duplicate-rows"}) == 1
    assert kind == "cell for cell" or "line 86 is line 22 again" in sentence


def test_repeats_are_no_copies(telling: Telling) -> None:
    """A configuration measured again has another position: both count. Coarsely written positions
    agree by chance: both count."""

    def repeated(frame: pd.DataFrame) -> pd.DataFrame:
        again = frame.iloc[20:33].copy()
        again[["x_mm", "y_mm", "z_mm"]] += np.random.default_rng(5).normal(0, SIGMA, (13, 3))
        return pd.concat([frame, again])

    def coarse(frame: pd.DataFrame) -> pd.DataFrame:
        frame = repeated(frame)
        frame["order"] = frame["time_s"] = np.arange(len(frame))
        return frame.assign(**{axis: frame[axis].round(1) for axis in ("x_mm", "y_mm", "z_mm")})

    for change in (repeated, coarse):
        told = telling(change)
        assert len(told.split.problem.data) == ROWS + 13
        assert not {note.code for note in told.warnings} & {"copied-rows", "duplicate-rows"}
