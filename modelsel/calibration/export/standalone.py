"""A calibrated robot arm: where its target really is, at joint readings q. Plain numpy; nothing
else is needed.

Lengths are mm, angles rad. `position(q)` is the calibrated model, `correction(q)` what it adds to
the nominal one, both in the tracker's frame; q is (m, joints), as the motors read. What else the
model looks at (payload_kg=..., approach2=...) is given by name, one number or m; DATA["needs"] has
the names, DATA["targets"] those of the targets, DATA["group"] the one whose tracker's frame it is,
where groups have frames of their own. Without progress=..., 0 to 1, it is as after the last step of
what was measured. Made by modelsel export --format python: the program is the same for every arm,
and all that it knows of this one stands in DATA, at the end. Edit nothing."""

from __future__ import annotations

from typing import Any

import numpy as np

Array = np.ndarray
Data = dict[str, Any]
G = 9.81
FUNCTIONS: dict[str, Any] = {
    "sin": np.sin,
    "cos": np.cos,
    "sign": np.sign,
    "abs": np.abs,
    "exp": np.exp,
    "tanh": np.tanh,
    "root": lambda value: np.sign(value) * np.sqrt(np.abs(value)),
    "saw": lambda angle: 2 * (angle / (2 * np.pi) % 1) - 1,
}
OPERATORS = {"+": np.add, "-": np.subtract, "*": np.multiply, "/": np.divide}


def rotation_about(axis: int, angle: Array) -> Array:
    """Return the rotations (m, 3, 3) about x, y or z."""
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    count = len(angle)
    cosine = np.cos(angle)
    sine = np.sin(angle)
    out = np.tile(np.eye(3), (count, 1, 1))
    out[:, i, i] = cosine
    out[:, j, j] = cosine
    out[:, j, i] = sine
    out[:, i, j] = -sine
    return out


def walk_chain(data: Data, q: Array, tool: Array, H: Array) -> tuple[Array, Array]:
    """Return origins (n+1, m, 3) and rotations (n+1, m, 3, 3) of every joint's frame before it
    turns, and of the target, in frame 0; H (n+1, 6, m): the small shifts and turns in every
    frame."""
    m, n = q.shape
    prismatic = data["prismatic"]
    links = [*data["before"][:n], data["last"]]
    o = np.zeros((m, 3))
    R = np.tile(np.eye(3), (m, 1, 1))
    origins = []
    rotations = []
    for k, link in enumerate(links):
        N = np.array(link)
        o = o + R @ N[:, 3]
        R = R @ N[:, :3]
        if k == n:
            o = o + R @ tool
        shift = H[k, :3]
        o = o + np.einsum("mij,jm->mi", R, shift)
        for a in range(3):
            angle = H[k, 3 + a]
            R = R @ rotation_about(a, angle)
        origins.append(o)
        rotations.append(R)
        if k == n:
            break
        reading = q[:, k]
        if prismatic[k]:
            o = o + R[:, :, 2] * reading[:, None]
        else:
            R = R @ rotation_about(2, reading)
    return np.array(origins), np.array(rotations)


def measure_reach(data: Data, x: Array) -> Array:
    """Return how far targets (m, 3) are from joint 1's axis."""
    first = np.array(data["before"][0])
    sideways, upward, _, origin = first.T
    line = x - origin
    reach = np.hypot(line @ sideways, line @ upward)
    return np.asarray(reach)


def name_axes(template: str, vectors: Array) -> dict[str, Array]:
    """Return the components of vectors (m, 3) by their names."""
    return {template.format(axis): values for axis, values in zip("xyz", vectors.T, strict=True)}


def derive_beam(data: Data, x: Array) -> dict[str, Array]:
    """Derive how far targets (m, 3) are from the tracker, its angles to them, and directions of frame 0
    along and across its beam."""
    P = np.array(data["placement"])
    tracker = np.array(data["tracker"])
    far = x @ P[:, :3].T + P[:, 3] - tracker
    length = np.linalg.norm(far, axis=1)
    beam = far @ P[:, :3] / length[:, None]
    level = np.hypot(far[:, 0], far[:, 1])
    azimuth = np.arctan2(far[:, 1], far[:, 0])
    sine, cosine = np.sin(azimuth), np.cos(azimuth)
    aside = np.column_stack([-sine, cosine, np.zeros(len(far))])
    slope = far[:, 2] / length
    rise = np.column_stack([-slope * cosine, -slope * sine, level / length])
    return {
        "range_mm": length,
        "beam_azimuth": azimuth,
        "beam_zenith": np.arctan2(level, far[:, 2]),
        **name_axes("beam_{}", beam),
        **name_axes("beam_aside_{}", aside @ P[:, :3]),
        **name_axes("beam_rise_{}", rise @ P[:, :3]),
    }


def place_bodies(
    data: Data, q: Array, o: Array, R: Array, loaded: Array
) -> list[tuple[float, Array]]:
    """Place the arm's masses [kg] at points (m, 3): as declared, else 1 kg at each later frame's
    origin and where a payload hangs."""
    n = q.shape[1]
    if not any(data["masses"]):
        return [(1.0, point) for point in (*o[1:n], loaded)]
    bodies = []
    for k in range(n):
        reading = q[:, k]
        moved, slide = R[k], 0.0
        if data["prismatic"][k]:
            slide = R[k][:, :, 2] * reading[:, None]
        else:
            moved = R[k] @ rotation_about(2, reading)
        com = np.array(data["coms"][k])
        centre = o[k] + slide + moved @ com
        bodies.append((data["masses"][k], centre))
    return bodies


def derive_state(data: Data, q: Array, tool: Array) -> dict[str, Array]:
    """Derive what follows from the readings on the nominal arm: torques and moments [N m] of
    gravity, where the target is [mm]."""
    m, n = q.shape
    prismatic = data["prismatic"]
    o, R = walk_chain(data, q, tool, np.zeros((n + 1, 6, m)))
    x = o[n]
    out = {f"q{j + 1}": q[:, j] for j in range(n)}
    beam = derive_beam(data, x)
    out |= name_axes("{}_mm", x) | beam
    out |= name_axes("on_flange_{}_mm", np.broadcast_to(tool, (m, 3)))
    along = np.column_stack([beam[f"beam_{axis}"] for axis in "xyz"])
    out |= name_axes("beam_face_{}", np.einsum("mij,mi->mj", R[n], along))
    out["reach_mm"] = measure_reach(data, x)
    if data["gravity"] is None:
        return out
    g = np.array(data["gravity"])
    # the same place, whichever target is measured
    place = np.array(data["load_place"])
    loaded = x + R[n] @ (place - tool)
    out |= name_axes("load_{}_mm", loaded)
    out |= name_axes("load_on_flange_{}_mm", np.broadcast_to(place, (m, 3)))
    bodies = place_bodies(data, q, o, R, loaded)
    down = R[n].transpose(0, 2, 1) @ g
    out |= name_axes("down_{}", down)
    whole = sum((np.cross(p / 1e3, mass * G * g) for mass, p in bodies), np.zeros((m, 3)))
    out |= name_axes("moment_{}", whole)
    ends = [*o[:n], loaded]
    for j in range(n):

        def about(p: Array, mass: float, j: int = j) -> Array:
            lever = (p - o[j]) / 1e3
            weight = mass * G * g
            moment = np.cross(lever, weight)
            here = np.einsum("mij,mi->mj", R[j], moment)
            if prismatic[j]:
                axis = R[j][:, :, 2]
                here[:, 2] = mass * G * axis @ g
            return np.asarray(here)

        out |= name_axes(f"down{j + 1}_{{}}", R[j].transpose(0, 2, 1) @ g)
        names = (f"moment{j + 1}_x", f"moment{j + 1}_y", f"torque{j + 1}")
        carried = sum((about(p, mass) for mass, p in bodies[j:]), np.zeros((m, 3)))
        out |= dict(zip(names, carried.T, strict=True))
        for k in range(j + 1, n + 1):
            load = about(ends[k], 1.0)
            for name, row in zip(
                ("moment{}_x_{}", "moment{}_y_{}", "torque{}_{}"), load.T, strict=True
            ):
                out[name.format(j + 1, k + 1)] = row
    return out


def evaluate_cause(tree: Any, values: dict[str, Array]) -> Any:
    """Evaluate a cause: a number, ["name", "q4"], ["sin", cause], ["+", cause, cause],
    ["spline", cause, centre, width]."""
    if isinstance(tree, float):
        return tree
    head, *parts = tree
    if head == "name":
        name = parts[0]
        if name not in values:
            raise KeyError(f"the calibrated model needs {name}: give it by name")
        return values[name]
    if head == "spline":
        argument, centre, width = parts
        value = evaluate_cause(argument, values)
        u = np.abs(value - centre) / width
        inner = (4 - 6 * u**2 + 3 * u**3) / 6
        outer = np.maximum(2 - u, 0) ** 3 / 6
        return np.where(u < 1, inner, outer)
    if head in OPERATORS:
        operate = OPERATORS[head]
        left = evaluate_cause(parts[0], values)
        right = evaluate_cause(parts[1], values)
        return operate(left, right)
    function = FUNCTIONS[head]
    argument = parts[0]
    value = evaluate_cause(argument, values)
    return function(value)


def predict_both(
    data: Data, q: Any, target: str | None, given: dict[str, Any]
) -> tuple[Array, Array]:
    """Predict nominal and calibrated positions (m, 3) in the tracker's frame."""
    readings = np.atleast_2d(np.asarray(q, float))
    q = readings @ np.array(data["coupling"]).T
    m, n = q.shape
    name = target
    if target is None:
        name = data["targets"][0]
    tool = np.array(data["tools"][name])
    constants = np.array(data["constants"][name])
    P = np.array(data["placement"])
    R = P[:, :3]
    t = P[:, 3]
    H = np.zeros((n + 1, 6, m))
    origins, _ = walk_chain(data, q, tool, H)
    nominal = origins[n]
    values = derive_state(data, q, tool)
    values["progress"] = np.full(m, data["after_steps"])
    for key, value in given.items():
        number = np.asarray(value, float)
        values[key] = np.broadcast_to(number, (m,))
    H += constants[:, :, None]
    for frame, axis, size, tree in data["terms"][name]:
        cause = evaluate_cause(tree, values)
        H[frame - 1, axis] += size * cause
    origins, _ = walk_chain(data, q, tool, H)
    real = origins[n]
    tracked_nominal = np.asarray(nominal @ R.T + t)
    tracked_real = np.asarray(real @ R.T + t)
    return tracked_nominal, tracked_real


def position(q: Any, /, target: str | None = None, **given: Any) -> Array:
    """Return where the calibrated arm has the target, (m, 3) mm."""
    _, calibrated = predict_both(DATA, q, target, given)
    return calibrated


def correction(q: Any, /, target: str | None = None, **given: Any) -> Array:
    """Return the calibrated minus the nominal position, (m, 3) mm."""
    nominal, calibrated = predict_both(DATA, q, target, given)
    return np.asarray(calibrated - nominal)


DATA: Data = {}
