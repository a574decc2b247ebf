"""Campaigns as large as people measure them: a study folder of each, simulated from a seed.

    python -m benchmarks.campaigns FOLDER [NAME ...]      # writes FOLDER/NAME/study.toml and its data
    python -m modelsel study FOLDER/NAME/study.toml --no-report --no-sampling

`drawn`: 100 configurations of six axes. `reflectors`: 1,000 configurations with three reflectors
each and 18 covariate columns. `torques`: 300 poses of a seven-axis arm with seven torque columns and
a payload. `ripple`: 12,000 poses of an arm with a gear's ripple. `million`: 1,000,000 rows, in
Parquet. Every arm has geometric errors of 0.3 mm and 1 mrad, an effect of
its own, and what real arms have: joints that yield under gravity, backlash, uneven gears and
encoders, a soft step and a flexing link that no registered mechanism describes."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from modelsel import Model, mechanism
from modelsel.fitting.design import residuals
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.causes import Applied, Cause, Named, cos, q, sin, torque
from modelsel.mechanisms.terms import Mechanism, Screw, Term
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import Robot, forward

NOISE = 0.05  # mm per coordinate
ONE = np.array([[0.0, 0.0, 100.0]])
THREE = np.array([[60.0, 0.0, 100.0], [-40.0, 70.0, 80.0], [-30.0, -60.0, 140.0]])
Array = np.ndarray
Effects = tuple[tuple[int, str, Cause, float], ...]
# what real arms have: frame, axis, cause, size [mm, rad per unit of the cause]
USUAL: Effects = (
    (2, "rz", torque(2), 3e-6),
    (3, "rz", torque(3), 4e-6),
    (3, "rz", Named("approach3"), 5e-5),
    (1, "rz", sin(2.0 * q(1)), 1e-4),
    (1, "rz", cos(q(1)), 2e-4),
    (4, "rz", cos(2.0 * q(4)), 3e-4),
    (5, "rz", sin(q(5)), 3e-4),
    (2, "rz", Applied("tanh", 8.0 * q(2)), 8e-5),
    (4, "rx", sin(q(2) + q(3)), 2e-4),
    (6, "rz", q(6), 2e-4),
)


@dataclass(frozen=True)
class Campaign:
    """What is measured: the arm, poses, targets on the flange, columns beside them and effects."""

    robot: str
    poses: int
    effects: Effects
    tools: Array = None  # type: ignore[assignment]
    columns: Callable[[np.random.Generator, Array], dict[str, Array]] = lambda rng, q: {}
    estimation: float = 0.7
    binary: bool = False


def _eighteen(rng: np.random.Generator, angles: Array) -> dict[str, Array]:
    """Temperatures that drift, motor currents and loads: 18 columns of one configuration each."""
    m = len(angles)
    clock = np.linspace(0, 1, m)
    columns = {
        f"temperature_{k}_C": 20 + 3 * k * (1 - np.exp(-3 * clock)) + rng.normal(0, 0.3, m)
        for k in range(1, 7)
    }
    columns |= {
        f"current{k}_A": rng.normal(0, 1, m) + np.sin(angles[:, k - 1]) for k in range(1, 7)
    }
    columns |= {f"speed{k}": rng.uniform(0, 1, m) for k in range(1, 6)}
    columns["payload_kg"] = rng.choice([0.0, 5.0, 10.0], m)
    return columns


def _torques(rng: np.random.Generator, angles: Array) -> dict[str, Array]:
    """Seven torques that follow the posture, and a payload."""
    m, n = angles.shape
    payload = rng.choice([0.0, 3.0, 6.0], m)
    lever = np.cumsum(np.sin(angles + np.arange(n)), axis=1)
    torque = (1 + 0.2 * payload)[:, None] * lever * 9 + rng.normal(0, 0.5, (m, n))
    return {**{f"torque{k + 1}_Nm": torque[:, k] for k in range(n)}, "payload_kg": payload}


CAMPAIGNS = {
    "drawn": Campaign("irb120", 100, ((3, "rz", sin(q(3)), 8e-4),)),
    "reflectors": Campaign(
        "ur10",
        1000,
        ((2, "rz", sin(q(2)), 5e-4), (1, "tz", Named("temperature_3_C"), 0.02)),
        THREE,
        _eighteen,
    ),
    "torques": Campaign(
        "iiwa14",
        300,
        ((2, "rz", Named("torque2_Nm"), 1.5e-5), (4, "rz", Named("torque4_Nm"), 2e-5)),
        ONE,
        _torques,
    ),
    "ripple": Campaign(
        "puma760", 12_000, ((2, "rz", sin(50.0 * q(2)), 2e-4), (3, "rz", cos(2.0 * q(3)), 3e-4))
    ),
    "million": Campaign("ur10", 1_000_000, ((3, "rz", sin(q(3)), 5e-4),), binary=True),
}


def write(name: str, folder: Path, seed: int = 1) -> Path:
    """Write one campaign's study folder; returns its study file."""
    what = CAMPAIGNS[name]
    rng = np.random.default_rng([seed, list(CAMPAIGNS).index(name)])
    robot = load_robot(what.robot)
    tools = ONE if what.tools is None else what.tools
    angles = robot.draw(rng, what.poses)
    beside = what.columns(rng, angles)
    target = np.tile(np.arange(len(tools)), what.poses)
    angles = np.repeat(angles, len(tools), 0)
    beside = {key: np.repeat(value, len(tools)) for key, value in beside.items()}
    position = _measure(robot, what, angles, tools, target, beside, rng)
    frame = pd.DataFrame(angles, columns=[f"q{k}_rad" for k in range(1, robot.n + 1)])
    for axis, values in zip("xyz", position.T, strict=True):
        frame[f"{axis}_mm"] = values
    if len(tools) > 1:
        frame["target"] = [f"r{t + 1}" for t in target]
    for key, values in beside.items():
        frame[key] = values
    folder.mkdir(parents=True, exist_ok=True)
    file = "measurements.parquet" if what.binary else "measurements.csv"
    if what.binary:
        frame.to_parquet(folder / file, index=False)
    else:
        frame.to_csv(folder / file, index=False, float_format="%.9g")
    study = folder / "study.toml"
    study.write_text(_describe(name, what, tools, file))
    return study


def _measure(
    robot: Robot,
    what: Campaign,
    angles: Array,
    tools: Array,
    target: Array,
    beside: dict[str, Array],
    rng: np.random.Generator,
) -> Array:
    """Measure (m, 3) positions of the arm with its errors, by the exact chain, with noise."""
    nominal: Array = np.empty((len(angles), 3))
    for t, tool in enumerate(tools):
        nominal[target == t] = forward(robot, angles[target == t], tool)
    data = build_measurements(
        angles,
        nominal,
        target=[f"r{t + 1}" for t in target],
        covariates=beside,
        configuration=np.repeat(np.arange(what.poses), len(tools)),
    )
    at = Problem(robot, data, tools)
    extra = tuple(
        Mechanism(f"planted{k}", (Term(f"w{k}", (Screw(frame, axis, cause),)),), "", "", "")
        for k, (frame, axis, cause, _) in enumerate((*what.effects, *USUAL))
    )
    model = Model((mechanism("geometric", robot), *extra))
    truth = rng.normal(0, 1, len(model.terms)) * [
        0.3 if term.unit == "mm" else 1e-3 for term in model.terms
    ]
    truth[len(truth) - len(extra) :] = [size for *_, size in (*what.effects, *USUAL)]
    moved = np.concatenate(
        [residuals(at.take(part), model.terms, truth) for part in _parts(len(angles))]
    )
    return nominal - moved + rng.normal(0, NOISE, nominal.shape)


def _parts(rows: int, size: int = 50_000) -> list[slice]:
    return [slice(start, min(start + size, rows)) for start in range(0, rows, size)]


def _describe(name: str, what: Campaign, tools: Array, file: str) -> str:
    return f"""name = "{name}"
seed = 1

[robot]
name = "{what.robot}"
{"tool_mm = [0, 0, 100]" if len(tools) == 1 else "[robot.tools_mm]"}
{"" if len(tools) == 1 else chr(10).join(f"r{k + 1} = {t.tolist()}" for k, t in enumerate(tools))}

[measurements]
file = "{file}"

[split]
estimation = {int(what.estimation * what.poses)}
"""


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("names", nargs="*", default=[n for n in CAMPAIGNS if n != "million"])
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    for name in given.names:
        print(write(name, given.folder / name, given.seed))


if __name__ == "__main__":
    main()
