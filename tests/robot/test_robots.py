"""Robots against numbers from elsewhere: published poses, another way to write the same arm,
textbook Jacobians, torques."""

from __future__ import annotations

import re
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from builders import drawn
from dh_steps import screw_x, screw_z
from scipy.spatial.transform import Rotation

from modelsel.exceptions import StudyError
from modelsel.fitting.design import compute_design, residuals
from modelsel.mechanisms.geometry import geometric
from modelsel.robot.files import builtin_names, load_robot, read_robot, robot_from_table
from modelsel.robot.kinematics import Robot, forward, pose
from modelsel.robot.rigid import from_rotation_vector, rotation_matrix
from modelsel.robot.urdf import read_urdf_text
from modelsel.robot.urdf_writer import write_urdf

POSES = tomllib.loads(
    (Path(__file__).parents[1] / "support" / "poses.toml").read_text(encoding="utf-8")
)["pose"]


@pytest.mark.parametrize(
    "known", POSES, ids=lambda p: f"{p['robot']}-{p['q_deg']}".replace(" ", "")
)
def test_published_pose(known) -> None:
    at = pose(load_robot(known["robot"]), np.radians([known["q_deg"]]).astype(float), np.zeros(3))
    np.testing.assert_allclose(at.target[:, 0], known["flange_mm"], rtol=0, atol=0.01)
    if "rotation" in known:
        np.testing.assert_allclose(at.rotation[:, :, 0], known["rotation"], rtol=0, atol=1e-6)


def test_every_robot_has_a_pose_and_a_source() -> None:
    assert set(builtin_names()) == {p["robot"] for p in POSES}
    assert all(p["source"] for p in POSES)
    assert all(
        load_robot(name).source not in ("", "not stated") and load_robot(name).name == name
        for name in builtin_names()
    )


# -- the same arm written in other ways: own 4 x 4 products, not modelsel's
# -------------------------------------------


def chain(rows: np.ndarray, slides: list[bool], q: np.ndarray, modified: bool) -> list[np.ndarray]:
    """Joint frames after each joint's motion, and last the flange, from DH rows (theta, d, a,
    alpha) and one reading q."""
    T, frames = np.eye(4), []
    for (theta, d, a, alpha), slide, value in zip(rows, slides, q, strict=True):
        turned, slid = (0.0, value) if slide else (value, 0.0)
        if modified:
            T = T @ screw_x(alpha, a) @ screw_z(theta + turned, d + slid)
            frames.append(T)
        else:
            frames.append(
                T @ screw_z(theta + turned, slid)
            )  # turned and slid along z: the joint's own frame
            T = T @ screw_z(theta + turned, d + slid) @ screw_x(alpha, a)
    return [*frames, T]


def drawn_rows(rng: np.random.Generator, n: int) -> np.ndarray:
    return np.stack(
        [
            rng.uniform(-np.pi, np.pi, n),
            rng.uniform(-300, 300, n),
            rng.uniform(-300, 300, n),
            rng.choice([-90, -37, 0, 90, 180], n) * np.pi / 180,
        ],
        1,
    )


SLIDES = [False, True, False, False, True, False]


@pytest.mark.parametrize("modified", [False, True], ids=["standard", "modified"])
def test_dh_rows(modified, rng) -> None:
    rows, q = drawn_rows(rng, 6), rng.uniform(-2, 2, (5, 6)) * np.where(SLIDES, 100, 1)
    robot = robot_from_table(
        {
            "convention": "modified" if modified else "standard",
            "joint": [
                {
                    "kind": "prismatic" if s else "revolute",
                    "dh": {
                        "theta_deg": np.degrees(t),
                        "d_mm": d,
                        "a_mm": a,
                        "alpha_deg": np.degrees(al),
                    },
                }
                for s, (t, d, a, al) in zip(SLIDES, rows, strict=True)
            ],
        },
        "dh.toml",
    )
    at = pose(robot, q, np.zeros(3))
    for i in range(len(q)):
        frames = chain(rows, SLIDES, q[i], modified)
        np.testing.assert_allclose(at.target[:, i], frames[-1][:3, 3], atol=1e-9)
        np.testing.assert_allclose(at.rotation[:, :, i], frames[-1][:3, :3], atol=1e-12)
        for k, frame in enumerate(frames[:-1]):  # where the contract puts joint k's frame and axis
            np.testing.assert_allclose(at.axes[k, 2, :, i], frame[:3, 2], atol=1e-12)
            if not SLIDES[k]:
                np.testing.assert_allclose(at.origins[k, :, i], frame[:3, 3], atol=1e-9)


def angles(R: np.ndarray) -> list[float]:
    """roll, pitch, yaw in degrees of a rotation: the textbook inverse of Rz(yaw) Ry(pitch)
    Rx(roll)."""
    return [
        float(v)
        for v in np.degrees(
            [np.arctan2(R[2, 1], R[2, 2]), -np.arcsin(R[2, 0]), np.arctan2(R[1, 0], R[0, 0])]
        )
    ]


def links(
    rows: np.ndarray, rng: np.random.Generator
) -> tuple[list[np.ndarray], list[np.ndarray], np.ndarray]:
    """(origin of every joint, its axis, what is left for the flange) of modified DH rows whose link
    frames are turned at will.

    With the link frame L_k = F_k C_k, the joint turns about C_k' z and the next origin is C_k^-1
    N_(k+1) C_(k+1)."""
    from scipy.spatial.transform import Rotation

    origins, axes, left = [], [], np.eye(4)
    special = [np.eye(3), np.diag([1.0, -1, -1])]  # axis z, axis -z
    for k, (theta, d, a, alpha) in enumerate(rows):
        C = np.eye(4)
        C[:3, :3] = special[k] if k < 2 else Rotation.from_quat(rng.normal(size=4)).as_matrix()
        origins.append(left @ screw_x(alpha, a) @ screw_z(theta, d) @ C)
        axes.append(C[2, :3])
        left = np.linalg.inv(C)
    return origins, axes, left


KINDS = ["prismatic" if slide else "revolute" for slide in SLIDES]
URDF_JOINT = """<joint name="{k}" type="{kind}"><parent link="l{k}"/><child link="l{next}"/>
 <origin xyz="{x} {y} {z}" rpy="{roll} {pitch} {yaw}"/><axis xyz="{u} {v} {w}"/></joint>"""


def as_urdf(origins: list[np.ndarray], axes: list[np.ndarray], left: np.ndarray) -> str:
    parts = []
    for k, (kind, T, axis) in enumerate(
        zip([*KINDS, "fixed"], [*origins, left], [*axes, (0, 0, 1)], strict=True)
    ):
        (x, y, z), (roll, pitch, yaw), (u, v, w) = (
            T[:3, 3] / 1e3,
            np.radians(angles(T[:3, :3])),
            axis,
        )
        parts.append(
            URDF_JOINT.format(
                k=k,
                next=k + 1,
                kind=kind,
                x=x,
                y=y,
                z=z,
                roll=roll,
                pitch=pitch,
                yaw=yaw,
                u=u,
                v=v,
                w=w,
            )
        )
    names = "".join(f'<link name="l{k}"/>' for k in range(len(parts) + 1))
    return f'<robot name="turned">{names}{"".join(reversed(parts))}</robot>'


def test_one_arm_in_every_form(rng, tmp_path) -> None:
    """The same arm as modified DH, as 3 x 4 transforms, with axes in any direction as xyz/rpy/axis,
    and as a URDF."""
    rows, q = drawn_rows(rng, 6), rng.uniform(-2, 2, (8, 6)) * np.where(SLIDES, 100, 1)
    N = [screw_x(alpha, a) @ screw_z(theta, d) for theta, d, a, alpha in rows]
    origins, axes, left = links(rows, rng)
    (tmp_path / "turned.urdf").write_text(as_urdf(origins, axes, left))
    robots = [
        robot_from_table(
            {
                "joint": [
                    {"kind": k, "transform_mm": T[:3].tolist()}
                    for k, T in zip(KINDS, N, strict=True)
                ]
            },
            "n",
        ),
        robot_from_table(
            {
                "joint": [
                    {
                        "kind": k,
                        "xyz_mm": T[:3, 3].tolist(),
                        "rpy_deg": angles(T[:3, :3]),
                        "axis": a.tolist(),
                    }
                    for k, T, a in zip(KINDS, origins, axes, strict=True)
                ],
                "last": {"transform_mm": left[:3].tolist()},
            },
            "u",
        ),
        read_robot(tmp_path / "turned.urdf"),
    ]
    want = np.array([chain(rows, SLIDES, x, True)[-1] for x in q])
    tool = np.array([10.0, -20.0, 30.0])
    for robot in robots:
        assert [j.prismatic for j in robot.joints] == SLIDES
        at = pose(robot, q, tool)
        np.testing.assert_allclose(at.target.T, want[:, :3, 3] + want[:, :3, :3] @ tool, atol=1e-8)
    for robot in robots[:2]:
        np.testing.assert_allclose(
            pose(robot, q, tool).rotation.transpose(2, 0, 1), want[:, :3, :3], atol=1e-11
        )


@pytest.mark.parametrize(
    "axis", [(0, 0, 1), (0, 0, -2), (0, 1, 0), (1, 2, -2), (-1e-9, 0, -1)], ids=str
)
def test_frame_of_an_axis_is_the_smallest_rotation(axis) -> None:
    """Contract: B_k is the smallest rotation taking z to the axis, half a turn about x for -z;
    screws stand in that frame."""
    from scipy.spatial.transform import Rotation

    robot = robot_from_table(
        {"joint": [{"xyz_mm": [1, 2, 3], "rpy_deg": [10, 20, 30], "axis": list(axis)}]}, "one.toml"
    )
    u = np.array(axis, float) / np.linalg.norm(axis)
    angle, about = np.arccos(u[2]), np.cross([0, 0, 1], u)
    B = (
        np.diag([1.0, -1, -1])
        if u[2] < -1 + 1e-9
        else (Rotation.from_rotvec(about / max(np.linalg.norm(about), 1e-12) * angle).as_matrix())
    )
    want = Rotation.from_euler("xyz", [10, 20, 30], degrees=True).as_matrix() @ B
    np.testing.assert_allclose(
        pose(robot, np.zeros((1, 1)), np.zeros(3)).axes[0, :3, :, 0].T, want, atol=1e-7
    )


# -- the screw field and the exact chain
# ------------------------------------------------------------------------------


def exact(robot: Robot, q: np.ndarray, tool: np.ndarray, H: np.ndarray) -> np.ndarray:
    """Contract's chain for one reading: 4 x 4 products, H (n+1, 6) the entries a b c alpha beta
    gamma of every frame."""

    def error(h: np.ndarray) -> np.ndarray:
        ry = np.array(
            [
                [np.cos(h[4]), 0, np.sin(h[4]), 0],
                [0, 1, 0, 0],
                [-np.sin(h[4]), 0, np.cos(h[4]), 0],
                [0, 0, 0, 1],
            ]
        )
        moved = np.eye(4)
        moved[:3, 3] = h[:3]
        return moved @ screw_x(h[3], 0) @ ry @ screw_z(h[5], 0)

    T = np.eye(4)
    for joint, value, h in zip(robot.joints, q, H[:-1], strict=True):
        T = (
            T
            @ joint.before
            @ error(h)
            @ (screw_z(0, value) if joint.prismatic else screw_z(value, 0))
        )
    moved = np.eye(4)
    moved[:3, 3] = tool
    return T @ robot.last @ moved @ error(H[-1])


@pytest.mark.parametrize("name", builtin_names())
def test_exact_chain_and_screw_field(name, rng) -> None:
    """Large errors on every frame against plain 4 x 4 products; the field against the products'
    differences and z x r."""
    at = drawn(name, rng, 6)
    robot, q, tool = at.robot, at.data.q, at.tools[0]
    terms = geometric(robot).terms
    theta = rng.normal(0, 1, len(terms)) * np.where([t.unit == "mm" for t in terms], 5, 0.1)
    H = np.zeros((robot.n + 1, 6))
    for value, term in zip(theta, terms, strict=True):
        (s,) = term.screws
        H[s.frame - 1, ["tx", "ty", "tz", "rx", "ry", "rz"].index(s.axis)] = value
    left = residuals(at, terms, theta)
    field = pose(robot, q, tool).displacement().transpose(3, 0, 1, 2)
    assert field.shape == (6, robot.n + 1, 6, 3)
    for i in range(len(q)):
        np.testing.assert_allclose(
            at.data.position[i] - left[i], exact(robot, q[i], tool, H)[:3, 3], atol=1e-9
        )
        for f, a in np.ndindex(robot.n + 1, 6):
            h = np.zeros_like(H)
            h[f, a] = 1e-5
            slope = (exact(robot, q[i], tool, h) - exact(robot, q[i], tool, -h))[:3, 3] / 2e-5
            np.testing.assert_allclose(
                field[i, f, a], slope, atol=1e-6 * max(1.0, np.abs(slope).max())
            )
        p = forward(robot, q[i], tool)[0]
        step = np.eye(robot.n) * 1e-5
        for k in range(robot.n):  # joint k's own motion is rz of its frame
            moved = (forward(robot, q[i] + step[k], tool) - forward(robot, q[i] - step[k], tool))[
                0
            ] / 2e-5
            np.testing.assert_allclose(field[i, k, 5], moved, atol=1e-5)
            z, o = (
                pose(robot, q[i : i + 1], tool).axes[k, 2, :, 0],
                pose(robot, q[i : i + 1], tool).origins[k, :, 0],
            )
            np.testing.assert_allclose(field[i, k, 5], np.cross(z, p - o), atol=1e-9)


def test_residual_in_the_trackers_frame(rng) -> None:
    """residual = measured - predicted, and columns turn with the tracker's frame."""
    from dataclasses import replace

    at = drawn("ur5", rng, 5)
    R, t = rotation_matrix(2, 0.7) @ rotation_matrix(0, -1.1), np.array([3000.0, -2000, 500])
    far = replace(
        at,
        placement=(R[None], t[None]),
        data=replace(at.data, position=at.data.position @ R.T + t + [1.0, 2.0, 3.0]),
    )
    np.testing.assert_allclose(residuals(far), np.tile([1.0, 2, 3], (5, 1)), atol=1e-9)
    terms = geometric(at.robot).terms
    np.testing.assert_allclose(
        compute_design(far, terms)[0],
        np.einsum("ij,mjp->mip", R, compute_design(at, terms)[0]),
        atol=1e-9,
    )


# -- refusals
# ---------------------------------------------------------------------------------------------------------

WRONG = {
    "name": "wrong",
    "convention": "modifed",
    "gravty": [0, 0, -1],
    "gravity": [0, 0, 0],
    "payload_at_mm": [0, 100],
    "joint": [
        {"transform_mm": [[1, 0, 0, 0], [0, 1, 0, 0]]},
        {"transform_mm": [[2, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]},
        {"xyz_mm": [0, 0, "a"], "axis": [0, 0, 0], "limits_deg": [10, -10]},
        {"dh": {"theta": 0, "d_mm": float("nan")}},
        {"kind": "revolut", "xyz_mm": [0, 0, 0], "dh": {}, "mass": 3, "com_mm": [0, 0, 1]},
        {},
    ],
    "last": 3,
}
PLACES = [
    'unknown key "gravty". Did you mean "gravity"?',
    'convention: expected "standard" or "modified", found "modifed"',
    "joint 1.transform_mm: expected 3 x 4",
    "joint 2.transform_mm: its first three columns are not a rotation",
    "joint 3.xyz_mm: expected 3 finite",
    "joint 3.axis: the axis has no length",
    "joint 3.limits_deg: the lower limit",
    'joint 4.dh: unknown key "theta". Did you mean "theta_deg"?',
    "joint 4.dh.d_mm: expected one finite number",
    'joint 5: unknown key "mass". Did you mean "mass_kg"?',
    "joint 5: give exactly one of",
    'joint 5.kind: expected "revolute"',
    "joint 5.com_mm: a centre of mass needs the link's mass_kg beside it",
    "joint 6: give exactly one of",
    "last: expected a table",
    "gravity: the direction has no length",
    "payload_at_mm: expected 3 finite numbers",
]


PAIR = (
    '<robot name="pair"><link name="a"/><link name="b"/><joint name="ab" type="{kind}">'
    '<parent link="a"/><child link="b"/></joint></robot>'
)
BACK = '<joint name="ba" type="fixed"><parent link="b"/><child link="a"/></joint></robot>'
TWINS = PAIR.format(kind="revolute").replace(
    "</robot>",
    '<link name="c"/><joint name="ab" type="revolute"><parent link="b"/><child link="c"/></joint></robot>',
)
RING = PAIR.format(kind="revolute").replace("</robot>", BACK)


def test_all_problems_of_a_robot_file_at_once() -> None:
    with pytest.raises(StudyError) as caught:
        robot_from_table(WRONG, "wrong.toml")
    problems = caught.value.problems
    assert all(p.startswith("wrong.toml: ") for p in problems)
    for place in PLACES:
        assert sum(place in p for p in problems) == 1, f"{place!r} not said once in {problems}"
    assert caught.value.exit_code == 2


@pytest.mark.parametrize(
    ("file", "text", "message"),
    [
        ("a.toml", "name = ", "a.toml: not valid TOML"),
        ("a.toml", 'name = "a"\nname = "b"', "a key stands twice (at end of document)"),
        ("a.toml", "[n]\n[n]\n", "a table stands twice (at line 2"),
        ("a.toml", "n = {b = {}}\nn.c = 1\n", "a key stands twice (at line 2"),
        ("b.toml", 'name = "b"', "b.toml: no [[joint]] found"),
        ("c.urdf", "<robot", "c.urdf: not valid XML"),
        ("c.urdf", "<robot", "unclosed token: line 1, column 0. Correct this place."),
        ("i.urdf", "", "column 0. A URDF is expected, which begins with <robot>."),
        ("i.urdf", "q1_deg,q2_deg", "A URDF is expected, which begins with <robot>."),
        ("d.urdf", '<!DOCTYPE x [<!ENTITY e "e">]><robot/>', "refused"),
        ("e.urdf", '<robot name="e"><link name="a"/></robot>', "root link"),
        ("f.urdf", PAIR.format(kind="rotary"), 'Joint "ab" has type "rotary"; revolute, cont'),
        ("h.urdf", TWINS, 'joint "ab": another joint has this name, too. Rename one of them.'),
        ("g.urdf", RING, "the links form a loop"),
    ],
)
def test_unreadable_robot_files(file, text, message, tmp_path) -> None:
    (tmp_path / file).write_text(text)
    with pytest.raises(StudyError, match=re.escape(message)):
        read_robot(tmp_path / file)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("arms", "this is a folder. Give the name of a built-in robot or a robot file"),
        ("result.json", "this is a result of a study. Give the name of a built-in robot"),
        ("arm.docx", "this is a file, but not a robot file. Give the name of a built-in robot"),
        ("nowhere/arm", 'unknown robot "nowhere/arm"'),
    ],
)
def test_a_path_that_is_no_robot_file_is_called_what_it_is(
    name: str, said: str, tmp_path, monkeypatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for folder in ("arms", "puma760"):
        Path(folder).mkdir()
    for file in ("result.json", "arm.docx"):
        Path(file).write_text("{}")
    with pytest.raises(StudyError, match=re.escape(said)):
        load_robot(name)
    assert load_robot("puma760").n == 6  # whatever else has its name


def test_lengths_in_the_wrong_unit_are_refused() -> None:
    """A URDF in millimetres is an arm of half a kilometre; a slide without bounds is none, nor are
    parallel axes whose lengths cancel."""
    arm = load_robot("ur5")
    rows = [{"transform_mm": joint.before[:3].tolist()} for joint in arm.joints]
    large = np.array([[1, 1, 1, 1e3]] * 3 + [[1] * 4])
    joints = tuple(replace(joint, before=joint.before * large) for joint in arm.joints)
    text = write_urdf(replace(arm, joints=joints), {}, {})
    with pytest.raises(
        StudyError, match=r"arm\.urdf: its flange would reach .* expected in m; these look"
    ):
        read_urdf_text(text, "arm.urdf")
    rows[2]["transform_mm"][0][3] = 2e5
    with pytest.raises(
        StudyError, match=r"arm\.toml: its flange would reach .* expected in mm; some"
    ):
        robot_from_table({"name": "arm", "joint": rows}, "arm.toml")
    rows[2] = rows[1] | {"kind": "prismatic", "limits_mm": [-1e9, 1e9]}
    assert robot_from_table({"name": "arm", "joint": rows}, "arm.toml").n == 6
    parallel = [{"dh": {"a_mm": 400, "d_mm": d}} for d in (1e6, -1e6, 100)]
    assert robot_from_table({"name": "arm", "joint": parallel}, "arm.toml").n == 3


def test_unknown_robot_is_suggested() -> None:
    with pytest.raises(StudyError, match=r'unknown robot "puma76"\. Did you mean "puma760"'):
        load_robot("puma76")
    with pytest.raises(StudyError, match=r"missing\.toml"):
        read_robot(Path("missing.toml"))


def test_a_message_keeps_its_end_where_a_value_is_endless() -> None:
    with pytest.raises(StudyError) as caught:
        robot_from_table(
            {"name": "long", "convention": 10**900, "joint": [{"xyz_mm": [0, 0, 1]}]}, "arm.toml"
        )
    assert (
        caught.value.problems[0]
        == f'arm.toml: convention: expected "standard" or "modified", found "1{78 * "0"}…".'
    )


def test_turns_as_scipy_has_them(rng) -> None:
    """To the last bit: no turn at all, one so small that its square vanishes, half a turn and more."""
    direction = rng.standard_normal((500, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    for angle in (0.0, 1e-9, 9e-4, 1.1e-3, 0.3, np.pi, 7.0):
        vectors = angle * direction
        expected = Rotation.from_rotvec(vectors).as_matrix()
        np.testing.assert_array_equal(from_rotation_vector(vectors), expected)
    np.testing.assert_array_equal(from_rotation_vector(vectors[2]), expected[2])
