"""Campaigns as large as people measure them: a study folder of each, simulated from a seed.

    python -m benchmarks.campaigns FOLDER [NAME ...]     # writes FOLDER/NAME/study.toml and its data
    python -m modelsel study FOLDER/NAME/study.toml --no-report --no-sampling

`drawn`: 100 configurations of six axes. `reflectors`: 1,000 configurations with three reflectors
each and 18 covariate columns. `torques`: 300 poses of a seven-axis arm with seven torque columns and
a payload. `ripple`: 12,000 poses of an arm with a gear's ripple. `million`: 1,000,000 rows, in
Parquet; it is written only where it is named. Every arm has geometric errors of 0.3 mm and 1 mrad,
an effect of its own, and what real arms have: joints that yield under gravity, backlash, uneven
gears and encoders, a soft step and a flexing link that no registered mechanism describes.
`python -m benchmarks --only campaigns` measures their studies."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd

from modelsel import Model, mechanism
from modelsel._typing import Array, Index
from modelsel.fitting.design import residuals
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.causes import Applied, Cause, Named, cos, q, sin, torque
from modelsel.mechanisms.terms import Mechanism, Screw, Term
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import Robot, forward

NOISE = 0.05  # mm per coordinate
CHUNK = 50_000  # rows that are moved at a time
ONE = ((0.0, 0.0, 100.0),)
THREE = ((60.0, 0.0, 100.0), (-40.0, 70.0, 80.0), (-30.0, -60.0, 140.0))

# frame, axis, cause, size [mm, rad per unit of the cause]
Effect = tuple[int, str, Cause, float]
Columns = Callable[[np.random.Generator, Array], dict[str, Array]]

# what real arms have
USUAL: tuple[Effect, ...] = (
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


def _no_columns(rng: np.random.Generator, angles: Array) -> dict[str, Array]:
    return {}


def _eighteen_columns(rng: np.random.Generator, angles: Array) -> dict[str, Array]:
    """Temperatures that drift, motor currents, speeds and loads, (m,) of each configuration."""
    m = len(angles)
    warmth = 1 - np.exp(-3 * np.linspace(0, 1, m))
    columns: dict[str, Array] = {}
    for k in range(1, 7):
        columns[f"temperature_{k}_C"] = 20 + 3 * k * warmth + rng.normal(0, 0.3, m)
    for k in range(1, 7):
        columns[f"current{k}_A"] = rng.normal(0, 1, m) + np.sin(angles[:, k - 1])
    for k in range(1, 6):
        columns[f"speed{k}"] = rng.uniform(0, 1, m)
    columns["payload_kg"] = rng.choice([0.0, 5.0, 10.0], m)
    return columns


def _torque_columns(rng: np.random.Generator, angles: Array) -> dict[str, Array]:
    """Seven torques that follow the posture, and a payload, (m,) of each configuration."""
    m, n = angles.shape
    payload = rng.choice([0.0, 3.0, 6.0], m)
    lever = np.cumsum(np.sin(angles + np.arange(n)), axis=1)
    torques = (1 + 0.2 * payload)[:, None] * lever * 9 + rng.normal(0, 0.5, (m, n))
    columns = {f"torque{k + 1}_Nm": torques[:, k] for k in range(n)}
    return {**columns, "payload_kg": payload}


@dataclass(frozen=True)
class Campaign:
    """What is measured: the arm, the number of poses, its effects, targets on the flange [mm],
    columns beside the readings, the share that estimates; `binary`: in Parquet, not in a CSV."""

    robot: str
    poses: int
    effects: tuple[Effect, ...]
    tools: tuple[tuple[float, ...], ...] = ONE
    columns: Columns = field(default=_no_columns)
    estimation: float = 0.7
    binary: bool = False


CAMPAIGNS = {
    "drawn": Campaign("irb120", 100, ((3, "rz", sin(q(3)), 8e-4),)),
    "reflectors": Campaign(
        "ur10",
        1000,
        ((2, "rz", sin(q(2)), 5e-4), (1, "tz", Named("temperature_3_C"), 0.02)),
        THREE,
        _eighteen_columns,
    ),
    "torques": Campaign(
        "iiwa14",
        300,
        ((2, "rz", Named("torque2_Nm"), 1.5e-5), (4, "rz", Named("torque4_Nm"), 2e-5)),
        columns=_torque_columns,
    ),
    "ripple": Campaign(
        "puma760", 12_000, ((2, "rz", sin(50.0 * q(2)), 2e-4), (3, "rz", cos(2.0 * q(3)), 3e-4))
    ),
    "million": Campaign("ur10", 1_000_000, ((3, "rz", sin(q(3)), 5e-4),), binary=True),
}


def write(name: str, folder: Path, seed: int = 1) -> Path:
    """Write one campaign's study folder; returns its study file."""
    campaign = CAMPAIGNS[name]
    rng = np.random.default_rng([seed, list(CAMPAIGNS).index(name)])
    robot = load_robot(campaign.robot)
    targets = len(campaign.tools)
    configurations = robot.draw(rng, campaign.poses)
    of_configurations = campaign.columns(rng, configurations)
    target = np.tile(np.arange(targets), campaign.poses)
    angles = np.repeat(configurations, targets, 0)
    columns = {key: np.repeat(values, targets) for key, values in of_configurations.items()}
    position = _measure(robot, campaign, angles, target, columns, rng)
    frame = pd.DataFrame(angles, columns=[f"q{k}_rad" for k in range(1, robot.n + 1)])
    for axis, values in zip("xyz", position.T, strict=True):
        frame[f"{axis}_mm"] = values
    if targets > 1:
        frame["target"] = [f"r{t + 1}" for t in target]
    for key, values in columns.items():
        frame[key] = values
    folder.mkdir(parents=True, exist_ok=True)
    if campaign.binary:
        file = "measurements.parquet"
        frame.to_parquet(folder / file, index=False)
    else:
        file = "measurements.csv"
        frame.to_csv(folder / file, index=False, float_format="%.9g")
    study = folder / "study.toml"
    study.write_text(_describe(name, campaign, file))
    return study


def _measure(
    robot: Robot,
    campaign: Campaign,
    angles: Array,
    target: Index,
    columns: dict[str, Array],
    rng: np.random.Generator,
) -> Array:
    """Measure (m, 3) positions [mm] of the arm with its errors, by the exact chain, with noise."""
    tools = np.array(campaign.tools)
    nominal = np.empty((len(angles), 3))
    for t, tool in enumerate(tools):
        nominal[target == t] = forward(robot, angles[target == t], tool)
    configuration = np.repeat(np.arange(campaign.poses), len(tools)).tolist()
    data = build_measurements(
        angles,
        nominal,
        target=[f"r{t + 1}" for t in target],
        covariates=columns,
        configuration=configuration,
    )
    at = Problem(robot, data, tools)
    planted = (*campaign.effects, *USUAL)
    extra = []
    for k, (frame, axis, cause, _) in enumerate(planted):
        extra.append(Mechanism(f"planted{k}", (Term(f"w{k}", (Screw(frame, axis, cause),)),)))
    model = Model((mechanism("geometric", robot), *extra))
    size = [0.3 if term.unit == "mm" else 1e-3 for term in model.terms]
    truth = rng.normal(0, 1, len(size)) * size
    truth[-len(planted) :] = [effect[-1] for effect in planted]
    moved = [residuals(at.take(part), model.terms, truth) for part in _parts(len(angles))]
    noise = rng.normal(0, NOISE, nominal.shape)
    return np.asarray(nominal - np.concatenate(moved) + noise)


def _parts(rows: int) -> Iterator[slice]:
    return (slice(start, min(start + CHUNK, rows)) for start in range(0, rows, CHUNK))


def _describe(name: str, campaign: Campaign, file: str) -> str:
    """Write the study file's text."""
    robot = [f'name = "{campaign.robot}"']
    if len(campaign.tools) == 1:
        robot.append("tool_mm = [0, 0, 100]")
    else:
        robot.append("[robot.tools_mm]")
        robot += [f"r{k} = {list(tool)}" for k, tool in enumerate(campaign.tools, 1)]
    lines = [
        f'name = "{name}"',
        "seed = 1",
        "",
        "[robot]",
        *robot,
        "",
        "[measurements]",
        f'file = "{file}"',
        "",
        "[split]",
        f"estimation = {int(campaign.estimation * campaign.poses)}",
    ]
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    usual = [name for name in CAMPAIGNS if name != "million"]
    parser.add_argument("folder", type=Path)
    parser.add_argument("names", nargs="*", default=usual, metavar="NAME")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    for name in given.names:
        print(write(name, given.folder / name, given.seed))


if __name__ == "__main__":
    main()
