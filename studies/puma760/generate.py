"""Make measurements.csv: simulated measurements of a PUMA 760 with errors that are known, for
`modelsel study`.

The paper's measurements were never published, so this file makes a stand-in: single-joint rotation
tests, programmed lines and circles (programme.toml) moved by an arm whose errors are planted
(truth.toml). It has its own kinematics and imports nothing of modelsel: a mistake in modelsel
cannot hide by being made twice. Lengths in mm, angles in rad. Run it anywhere; it writes the same
bytes each time.

    python generate.py
"""

from __future__ import annotations

import csv
import tomllib
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
AXES = ("tx", "ty", "tz", "rx", "ry", "rz")
TARGET = np.array([0.0, 0.0, 100.0])  # nominal target in frame 6
GRAVITY = 9.81

# N_1 .. N_6, from the frame of joint k-1 (turned) to the frame of joint k
NOMINAL = [
    np.vstack([rows, [0, 0, 0, 1]]).astype(float)
    for rows in (
        [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]],
        [[1, 0, 0, 0], [0, 0, -1, 164], [0, 1, 0, 0]],
        [[1, 0, 0, 650], [0, 1, 0, 0], [0, 0, 1, 50]],
        [[0, 0, 1, 550], [0, 1, 0, 0], [-1, 0, 0, 0]],
        [[0, 0, -1, 0], [0, 1, 0, 0], [1, 0, 0, 50]],
        [[0, 0, 1, 125], [0, 1, 0, 0], [-1, 0, 0, 0]],
    )
]


# The arm
# ------------------------------------------------------------------------------------------------------------


def turn(axis: int, angle) -> np.ndarray:
    """(..., 4, 4) rotation by `angle` about x, y or z (0, 1, 2)."""
    c, s = np.cos(angle), np.sin(angle)
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    R = np.zeros((*np.shape(angle), 4, 4))
    R[..., range(4), range(4)] = 1.0
    R[..., i, i] = R[..., j, j] = c
    R[..., i, j], R[..., j, i] = -s, s
    return R


def arm(q: np.ndarray, errors: np.ndarray | None = None) -> list[np.ndarray]:
    """Frames 1..7 in frame 0, each (m, 4, 4); a joint's frame is given before the joint's own turn,
    frame 7 is at the target.

    x = (N1 H1 T1) ... (N6 H6 T6) (target + [a7 b7 c7]) with H = Trans(a, b, c) Rx Ry Rz, exact.
    `errors` is (m, 7, 6): a b c alpha beta gamma."""
    errors = np.zeros((len(q), 7, 6)) if errors is None else errors
    frames, T = [], np.tile(np.eye(4), (len(q), 1, 1))
    for k in range(6):
        H = turn(0, errors[:, k, 3]) @ turn(1, errors[:, k, 4]) @ turn(2, errors[:, k, 5])
        H[:, :3, 3] = errors[:, k, :3]
        frames.append(T @ NOMINAL[k] @ H)
        T = frames[-1] @ turn(2, q[:, k])
    tool = np.tile(np.eye(4), (len(q), 1, 1))
    tool[:, :3, 3] = TARGET + errors[:, 6, :3]
    return [*frames, T @ tool]


def axes_and_levers(frames: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Joint axes (m, 6, 3) and the vectors from each joint to the target (m, 6, 3)."""
    z = np.stack([F[:, :3, 2] for F in frames[:6]], axis=1)
    return z, np.stack([frames[6][:, :3, 3] - F[:, :3, 3] for F in frames[:6]], axis=1)


# The programme of motions
# ----------------------------------------------------------------------------------------------


def rotation_vector(R: np.ndarray) -> np.ndarray:
    w = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2
    s, c = np.linalg.norm(w), (np.trace(R) - 1) / 2
    return w * (np.arctan2(s, c) / s if s > 1e-12 else 1.0)


def rotation(w: np.ndarray) -> np.ndarray:
    angle = np.linalg.norm(w)
    if angle < 1e-12:
        return np.eye(3)
    x, y, z = w / angle
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


def reach(position: np.ndarray, attitude: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Joint angles (6,) of the nominal arm with the target at a pose, by Newton's method from
    `q`."""
    for _ in range(50):
        frames = arm(q[None])
        z, lever = (v[0] for v in axes_and_levers(frames))
        here = frames[6][0]
        miss = np.concatenate([position - here[:3, 3], rotation_vector(attitude @ here[:3, :3].T)])
        step = np.linalg.solve(np.vstack([np.cross(z, lever).T, z.T]), miss)
        q = q + step
        if np.abs(step).max() < 1e-13:
            return q
    raise ValueError("this motion leaves the arm's reach or meets a singularity")


def pose(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    T = arm(q[None])[6][0]
    return T[:3, 3], T[:3, :3]


def follow(path, q: np.ndarray, points: int) -> np.ndarray:
    """Configurations (points, 6) along path(s) -> position, attitude with s from 0 to 1, in 8 steps
    between points."""
    out = [q]
    for s in np.linspace(0, 1, 8 * (points - 1) + 1)[1:]:
        q = reach(*path(s), q)
        out.append(q)
    return np.array(out)[::8]


def sweep(joint, from_deg, to_deg, points, posture_deg):
    """One joint turned alone, the others at rest."""
    q = np.tile(np.radians(posture_deg), (points, 1))
    q[:, joint - 1] = np.radians(np.linspace(from_deg, to_deg, points))
    return q


def line(start_deg, end_deg, points):
    """The target on a straight line between the poses of two taught postures, turning evenly on the
    way."""
    start = np.radians(start_deg)
    (a, A), (b, B) = pose(start), pose(np.radians(end_deg))
    w = rotation_vector(B @ A.T)
    return follow(lambda s: (a + s * (b - a), rotation(s * w) @ A), start, points)


def circle(start_deg, normal, centre_mm, swing_deg, points):
    """The target round a circle about start + centre_mm, its attitude swinging about the circle's
    normal."""
    start, n, centre = np.radians(start_deg), np.array(normal, float), np.array(centre_mm, float)
    a, A = pose(start)
    n = n / np.linalg.norm(n)

    def path(s):
        swing = np.radians(swing_deg) * np.sin(2 * np.pi * s)
        return a + centre - rotation(2 * np.pi * s * n) @ centre, rotation(swing * n) @ A

    return follow(path, start, points + 1)[:points]


MOTIONS = {"sweep": sweep, "line": line, "circle": circle}


def programme(tests: list[dict]) -> tuple[np.ndarray, list[str], list[int]]:
    """All configurations (m, 6), the test each belongs to, and its place in the test's order of
    motion."""
    runs = [
        (
            t["name"],
            MOTIONS[t["motion"]](**{k: v for k, v in t.items() if k not in ("name", "motion")}),
        )
        for t in tests
    ]
    q = np.vstack([r for _, r in runs])
    return (
        np.round(q, 9),
        [n for n, r in runs for _ in r],
        [i for _, r in runs for i in range(len(r))],
    )


# The truth
# -----------------------------------------------------------------------------------------------------------


def torque(q: np.ndarray, joint: int) -> np.ndarray:
    """Gravity torque about a joint, N m (m,): 1 kg at the origin of each later frame and at the
    target of the nominal arm."""
    frames = arm(q)
    axis, origin = frames[joint - 1][:, :3, 2], frames[joint - 1][:, :3, 3]
    levers = sum(F[:, :3, 3] - origin for F in frames[joint:]) / 1e3
    return np.einsum("mi,mi->m", axis, np.cross(levers, [0, 0, -GRAVITY]))


CAUSES = {
    "cos(q2)": lambda q: np.cos(q[:, 1]),
    "cos(q2+q3)": lambda q: np.cos(q[:, 1] + q[:, 2]),
    "sign(cos(q2+q3))": lambda q: np.sign(np.cos(q[:, 1] + q[:, 2])),
    "sin(2*q1)": lambda q: np.sin(2 * q[:, 0]),
    "cos(2*q1)": lambda q: np.cos(2 * q[:, 0]),
    "sin(2*q4)": lambda q: np.sin(2 * q[:, 3]),
    "cos(2*q4)": lambda q: np.cos(2 * q[:, 3]),
    "q4": lambda q: q[:, 3],
    "torque5": lambda q: torque(q, 5),
}


def planted(q: np.ndarray, truth: dict) -> np.ndarray:
    """Errors (m, 7, 6) of every configuration: the geometric constants plus every screw times its
    cause."""
    errors = np.zeros((len(q), 7, 6))
    for i, letter in enumerate(("a_mm", "b_mm", "c_mm", "alpha_mrad", "beta_mrad", "gamma_mrad")):
        values = np.array(truth["geometry"][letter])
        errors[:, : len(values), i] = values * (1e-3 if letter.endswith("mrad") else 1.0)
    for effect in truth["effect"]:
        for s in effect["screws"]:
            errors[:, s["frame"] - 1, AXES.index(s["axis"])] += s["size"] * CAUSES[s["cause"]](q)
    return errors


def main() -> None:
    truth = tomllib.loads((HERE / "truth.toml").read_text())
    q, group, order = programme(tomllib.loads((HERE / "programme.toml").read_text())["test"])
    x = arm(q, planted(q, truth))[6][:, :3, 3]
    x = x + np.random.default_rng(truth["noise"]["seed"]).normal(
        0, truth["noise"]["coordinate_mm"], x.shape
    )
    with open(HERE / "measurements.csv", "w", newline="") as file:
        out = csv.writer(file, lineterminator="\n")
        out.writerow(
            [f"q{k}_rad" for k in range(1, 7)] + ["x_mm", "y_mm", "z_mm", "group", "order"]
        )
        for qi, xi, g, i in zip(q, x, group, order):
            out.writerow([f"{v:.9f}" for v in qi] + [f"{v:.4f}" for v in xi] + [g, i])


if __name__ == "__main__":
    main()
