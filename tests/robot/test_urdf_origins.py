"""A URDF with other origins: nothing else in its text changes."""

from __future__ import annotations

import re
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from own_urdf import OWN, without_origins

from modelsel.exceptions import StudyError
from modelsel.robot.kinematics import forward
from modelsel.robot.rigid import from_rpy, transform
from modelsel.robot.urdf import read_urdf, read_urdf_text
from modelsel.robot.urdf_origins import replace_origins

CHAIN = {"shoulder", "upper arm", "forearm", "wrist1", "wrist2", "hand"}


def moved(rng, some=range(6)):
    """The chain of the URDF, some of its joints off by a mm and a mrad."""
    arm = read_urdf_text(OWN, "own.urdf", tip="flange")
    return arm, [
        joint.before @ transform(from_rpy(*rng.normal(0, 1e-3, 3)), rng.normal(0, 1, 3))
        if k in some
        else joint.before
        for k, joint in enumerate(arm.joints)
    ]


def stripped(text: str) -> bytes:
    """The tree without the origins of the chain's joints."""
    root = ET.fromstring(text)
    for joint in root.findall("joint"):
        if joint.find("child").get("link") in CHAIN and joint.find("origin") is not None:
            joint.remove(joint.find("origin"))
    return ET.tostring(root)


def test_only_origins_change(rng) -> None:
    arm, before = moved(rng)
    text = replace_origins(arm.urdf, before)
    assert text != OWN
    assert without_origins(text) == without_origins(OWN)
    back = read_urdf_text(text, "back", tip="flange")
    for joint, wanted in zip(back.joints, before, strict=True):
        np.testing.assert_allclose(joint.before, wanted, atol=1e-11)

    root, own = ET.fromstring(text), ET.fromstring(OWN)
    changed = [
        new.get("name")
        for new, old in zip(root.iter("joint"), own.iter("joint"), strict=True)
        if ET.tostring(new) != ET.tostring(old)
    ]
    assert changed == [f"joint_a{k}" for k in range(1, 7)]
    assert [ET.tostring(e) for e in root.iter("link")] == [ET.tostring(e) for e in own.iter("link")]


def test_what_does_not_move_keeps_its_text(rng) -> None:
    arm, before = moved(rng, some=[2])
    text = replace_origins(arm.urdf, before)
    lines = [(a, b) for a, b in zip(OWN.splitlines(), text.splitlines(), strict=True) if a != b]
    assert [a for a, _ in lines] == ['    <origin xyz="0 -0.1197 0.425"></origin>']
    assert replace_origins(arm.urdf, [joint.before for joint in arm.joints]) == OWN


def test_line_ends_stay(rng, tmp_path) -> None:
    path = tmp_path / "own.urdf"
    path.write_bytes(OWN.replace("\n", "\r\n").encode())
    arm = read_urdf(path, tip="flange")
    _, before = moved(rng)
    text = replace_origins(arm.urdf, before)
    assert text.count("\r\n") == OWN.count("\n")
    assert text.replace("\r\n", "\n") == replace_origins(moved(rng)[0].urdf, before)


@pytest.mark.parametrize(
    ("tag", "says"),
    [
        ("<origin/>", r'<origin xyz="[^"]*" rpy="[^"]*"/>'),
        ("<origin rpy='0 0 0'\t/>", r"<origin rpy='[^']*' xyz=\"[^\"]*\"\t/>"),
        ('<origin note=" xyz=\'1\'" xyz="0 0 0"/>', r'<origin note=" xyz=\'1\'" xyz="1\.0 [^"]*"'),
        ("", r'<joint name="j&gt;" type="revolute"><origin xyz="[^"]*" rpy="[^"]*"/><parent'),
    ],
)
def test_every_way_to_write_an_origin(tag, says) -> None:
    text = (
        '<robot name="r"><link name="a"/><link name="b"/><joint name="j&gt;" type="revolute">'
        f'<parent link="a"/>{tag}<child link="b"/><axis xyz="0 0 1"/></joint></robot>'
    )
    arm = read_urdf_text(text, "r.urdf")
    wanted = transform(from_rpy(0.1, 0.2, 0.3), (1000.0, 2, 3))
    new = replace_origins(arm.urdf, [wanted])
    assert re.search(says, new), new
    back = read_urdf_text(new, "back")
    np.testing.assert_allclose(back.joints[0].before, wanted, atol=1e-12)
    point = np.array([1.0, 2, 3])
    np.testing.assert_allclose(
        forward(back, np.zeros((1, 1)), point)[0], wanted[:3, :3] @ point + wanted[:3, 3]
    )


@pytest.mark.parametrize(
    ("name", "says"),
    [("fl\u200bange", "U\\+200B"), (" ", "no letter"), ("x" * 300, "200 are the most")],
)
def test_names_of_links_can_be_told(name, says) -> None:
    """They stand in notes and in calibration.json."""
    text = OWN.replace('"flange"', f'"{name}"')
    with pytest.raises(StudyError, match=f"own.urdf: the name of link .* is not valid: .*{says}"):
        read_urdf_text(text, "own.urdf", tip=name)
