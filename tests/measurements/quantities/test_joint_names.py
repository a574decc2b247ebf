"""Columns that are called as a URDF's joints are, in any order, become the joints' readings."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from modelsel.exceptions import DataError
from modelsel.measurements.formats.table import load_table
from modelsel.measurements.reader import read_measurements
from modelsel.measurements.recognition.column_guesses import guess_columns
from modelsel.robot.urdf import read_joint_names, read_urdf_text

JOINTS = ("base_yaw_joint", "shoulder_pitch_joint", "elbow_pitch_joint")
PRISMATIC = (False, False, False)


def urdf(prefix: str = "") -> str:
    links = "".join(f'<link name="l{k}"/>' for k in range(5))
    joints = "".join(
        f'<joint name="{prefix}{name}" type="revolute"><parent link="l{k}"/><child link="l{k + 1}"/>'
        f'<origin xyz="0.1 0 0.3"/><axis xyz="0 {k % 2} {1 - k % 2}"/></joint>'
        for k, name in enumerate(JOINTS)
    )
    tip = '<joint name="tip" type="fixed"><parent link="l3"/><child link="l4"/></joint>'
    return f'<robot name="arm">{links}{joints}{tip}</robot>'


def table(names: list[str], largest: float = 2.8) -> pd.DataFrame:
    rng = np.random.default_rng(2)
    frame = pd.DataFrame(rng.uniform(-largest, largest, (9, len(names))), columns=names)
    frame.iloc[0] = largest
    return frame.assign(X=rng.uniform(-900, 900, 9), Y=0.0, Z=np.arange(9.0))


def find(names: list[str], joints: tuple[str, ...] = JOINTS, **options) -> list[dict[str, str]]:
    choice, _ = guess_columns(load_table(table(names, **options)), PRISMATIC, joints)
    return [dict(reading.columns) for reading in choice.readings]


def test_the_chain_of_a_urdf_has_its_names() -> None:
    robot = read_urdf_text(urdf(), "arm.urdf")
    assert read_joint_names(robot) == JOINTS


@pytest.mark.parametrize(
    "form", ["{}", "/joint_states/{}/position", "{}.actual", "{} [rad]", "{}_rad", "left_{}"]
)
def test_names_of_joints_in_the_order_of_the_alphabet(form) -> None:
    joints = tuple(f"left_{name}" for name in JOINTS) if form == "left_{}" else JOINTS
    own = {name: form.format(name) for name in JOINTS}
    names = [own[name] for name in sorted(JOINTS)]
    expected = {f"q{k}_rad": own[name] for k, name in enumerate(JOINTS, 1)}
    assert find(names, joints) == [expected]


def test_a_prefix_of_the_urdf_that_the_file_lacks() -> None:
    joints = tuple(f"arm2_{name}" for name in JOINTS)
    assert find(sorted(JOINTS), joints)[0]["q2_rad"] == "shoulder_pitch_joint"


@pytest.mark.parametrize(("largest", "units"), [(120.0, ["deg"]), (2.8, ["rad"])])
def test_the_unit_of_joints_by_name_is_told_by_range(largest, units) -> None:
    found = find(list(JOINTS), largest=largest)
    assert [reading.popitem()[0].split("_")[1] for reading in found] == units


def test_speeds_are_no_readings_and_measured_goes_before_commanded() -> None:
    names = [f"{name}{end}" for end in ("_vel", "_cmd", "_actual") for name in JOINTS]
    (found,) = find(names)
    assert set(found.values()) == {f"{name}_actual" for name in JOINTS}


def test_a_joint_without_a_column_is_none_of_them() -> None:
    assert find([*JOINTS[:2], "elbow"]) == []


def test_a_study_without_a_mapping_is_told_one() -> None:
    robot = read_urdf_text(urdf(), "arm.urdf")
    with pytest.raises(DataError, match='"q1_rad": "base_yaw_joint", "q2_rad": "shoulder_pitch'):
        read_measurements(table(sorted(JOINTS)), robot)
