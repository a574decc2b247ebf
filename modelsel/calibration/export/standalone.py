"""A calibrated robot arm: where its target really is, at joint readings q. Plain numpy; nothing
else is needed.

Lengths are mm, angles rad. `position(q)` is the calibrated model, `correction(q)` what it adds to
the nominal one, both in the tracker's frame; q is (m, joints). What else the model looks at
(payload_kg=..., approach2=...) is given by name, one number or m; DATA["needs"] has the names,
DATA["targets"] those of the targets. Made by modelsel export --format python: the program is the
same for every arm, and all that it knows of this one stands in DATA, at the end. Edit nothing."""

from __future__ import annotations

from typing import Any

import numpy as np

Array = np.ndarray
Data = dict[str, Any]
G = 9.81
FUNCTIONS = {
    "sin": np.sin,
    "cos": np.cos,
    "sign": np.sign,
    "abs": np.abs,
    "exp": np.exp,
    "tanh": np.tanh,
}
OPERATORS = {"+": np.add, "-": np.subtract, "*": np.multiply, "/": np.divide}


def rotation_about(axis: int, angle: Array) -> Array:
    """(m, 3, 3) rotations about x, y or z."""
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    out = np.tile(np.eye(3), (len(angle), 1, 1))
    out[:, i, i] = out[:, j, j] = np.cos(angle)
    out[:, j, i] = np.sin(angle)
    out[:, i, j] = -out[:, j, i]
    return out


def walk_chain(data: Data, q: Array, tool: Array, H: Array) -> tuple[Array, Array]:
    """(origins (n+1, m, 3), rotations (n+1, m, 3, 3)) of every joint's frame before it turns, and
    of the target, in frame 0; H (n+1, 6, m): the small shifts and turns in every frame."""
    m, n = q.shape
    o, R = np.zeros((m, 3)), np.tile(np.eye(3), (m, 1, 1))
    origins, rotations = [], []
    for k in range(n + 1):
        N = np.array(data["before"][k] if k < n else data["last"])
        o, R = o + R @ N[:, 3], R @ N[:, :3]
        o = o if k < n else o + R @ tool
        o = o + np.einsum("mij,jm->mi", R, H[k, :3])
        for a in range(3):
            R = R @ rotation_about(a, H[k, 3 + a])
        origins.append(o)
        rotations.append(R)
        if k < n and data["prismatic"][k]:
            o = o + R[:, :, 2] * q[:, k, None]
        elif k < n:
            R = R @ rotation_about(2, q[:, k])
    return np.array(origins), np.array(rotations)


def derive_state(data: Data, q: Array, tool: Array) -> dict[str, Array]:
    """What follows from the readings on the nominal arm: torques and moments [N m] of gravity,
    where the target is [mm]."""
    m, n = q.shape
    o, R = walk_chain(data, q, tool, np.zeros((n + 1, 6, m)))
    x = o[n]
    far = (
        x @ np.array(data["placement"])[:, :3].T
        + np.array(data["placement"])[:, 3]
        - np.array(data["tracker"])
    )
    out = {f"q{j + 1}": q[:, j] for j in range(n)} | dict(
        zip(("x_mm", "y_mm", "z_mm"), x.T, strict=True)
    )
    out["range_mm"] = np.linalg.norm(far, axis=1)
    if data["gravity"] is None:
        return out
    g = np.array(data["gravity"])
    if any(data["masses"]):
        bodies = []
        for k in range(n):
            moved = R[k] if data["prismatic"][k] else R[k] @ rotation_about(2, q[:, k])
            slide = R[k][:, :, 2] * q[:, k, None] if data["prismatic"][k] else 0.0
            bodies.append((data["masses"][k], o[k] + slide + moved @ np.array(data["coms"][k])))
    else:
        bodies = [(1.0, p) for p in (*o[1:n], x)]
    out |= dict(zip(("down_x", "down_y", "down_z"), (R[n].transpose(0, 2, 1) @ g).T, strict=True))
    whole = sum((np.cross(p / 1e3, mass * G * g) for mass, p in bodies), np.zeros((m, 3)))
    out |= dict(zip(("moment_x", "moment_y", "moment_z"), whole.T, strict=True))
    ends = [*o[:n], x]
    for j in range(n):

        def about(p: Array, mass: float, j: int = j) -> Array:
            here = np.einsum("mij,mi->mj", R[j], np.cross((p - o[j]) / 1e3, mass * G * g))
            if data["prismatic"][j]:
                here[:, 2] = mass * G * R[j][:, :, 2] @ g
            return np.asarray(here)

        for name, row in zip(
            (f"moment{j + 1}_x", f"moment{j + 1}_y", f"torque{j + 1}"),
            sum((about(p, mass) for mass, p in bodies[j:]), np.zeros((m, 3))).T,
            strict=True,
        ):
            out[name] = row
        for k in range(j + 1, n + 1):
            for name, row in zip(
                ("moment{}_x_{}", "moment{}_y_{}", "torque{}_{}"),
                about(ends[k], 1.0).T,
                strict=True,
            ):
                out[name.format(j + 1, k + 1)] = row
    return out


def evaluate_cause(tree: Any, values: dict[str, Array]) -> Any:
    """The value of a cause: a number, ["name", "q4"], ["sin", cause], ["+", cause, cause],
    ["spline", cause, centre, width]."""
    if isinstance(tree, float):
        return tree
    head, *parts = tree
    if head == "name":
        if parts[0] not in values:
            raise KeyError(f"the calibrated model needs {parts[0]}: give it by name")
        return values[parts[0]]
    if head == "spline":
        u = np.abs(evaluate_cause(parts[0], values) - parts[1]) / parts[2]
        return np.where(u < 1, (4 - 6 * u**2 + 3 * u**3) / 6, np.maximum(2 - u, 0) ** 3 / 6)
    if head in OPERATORS:
        return OPERATORS[head](evaluate_cause(parts[0], values), evaluate_cause(parts[1], values))
    return FUNCTIONS[head](evaluate_cause(parts[0], values))


def predict_both(
    data: Data, q: Any, target: str | None, given: dict[str, Any]
) -> tuple[Array, Array]:
    """(nominal, calibrated) positions (m, 3) in the tracker's frame."""
    q = np.atleast_2d(np.asarray(q, float))
    m, n = q.shape
    name = data["targets"][0] if target is None else target
    tool, H = np.array(data["tools"][name]), np.zeros((n + 1, 6, m))
    nominal = walk_chain(data, q, tool, H)[0][n]
    values = derive_state(data, q, tool) | {
        key: np.broadcast_to(np.asarray(v, float), (m,)) for key, v in given.items()
    }
    H += np.array(data["constants"][name])[:, :, None]
    for frame, axis, size, tree in data["terms"][name]:
        H[frame - 1, axis] += size * evaluate_cause(tree, values)
    real = walk_chain(data, q, tool, H)[0][n]
    P = np.array(data["placement"])
    return np.asarray(nominal @ P[:, :3].T + P[:, 3]), np.asarray(real @ P[:, :3].T + P[:, 3])


def position(q: Any, /, target: str | None = None, **given: Any) -> Array:
    """(m, 3) mm: where the calibrated arm has the target."""
    return predict_both(DATA, q, target, given)[1]


def correction(q: Any, /, target: str | None = None, **given: Any) -> Array:
    """(m, 3) mm: calibrated minus nominal position."""
    nominal, real = predict_both(DATA, q, target, given)
    return np.asarray(real - nominal)


DATA: Data = {}
