"""Errors that rows share: false names and intervals with nothing planted, and what finding
something costs in power.

    python -m benchmarks.shared --studies 200 --seed 71 --conditions reflectors postures
    python -m benchmarks.shared --studies 38 --seed 71 --conditions independent planted        # both in benchmarks/results/shared.txt

Geometry alone is wrong but for the last condition. Three reflectors on one flange, half of their
noise's variance shared by a configuration; postures measured four times in all, in four rounds, 30
% of the variance the posture's own; independent normal noise; the same with an effect near the
detection limit. Every study goes through outliers, naming and parameters as `modelsel study` does.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from modelsel import Model, mechanism
from modelsel._random import generator
from modelsel.diagnosis.procedure import diagnose_split
from modelsel.fitting.design import Model as Terms
from modelsel.fitting.design import compute_design, residuals
from modelsel.fitting.least_squares import fit
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.causes import q, sin
from modelsel.mechanisms.registry import every
from modelsel.mechanisms.terms import Mechanism, Screw, Term
from modelsel.robot.files import load
from modelsel.robot.kinematics import Robot, forward
from modelsel.selection.evaluation import Split
from modelsel.selection.splits import assign_folds
from modelsel.uncertainty.parameters import bootstrap_parameters, describe_parameters

from .calibration import ARM
from .nulls import interval

SIGMA, LEVEL = 0.05, 0.05
TOOLS = np.array([[60.0, 0.0, 100.0], [-40.0, 70.0, 80.0], [-30.0, -60.0, 140.0]])
# rms of the planted effect beyond geometry over the noise, of 90 coordinates; smaller where more
# are measured
PLANTED = 0.45
CONDITIONS = ("reflectors", "postures", "independent", "planted")
Array = np.ndarray


def arms(name: str) -> Robot:
    return ARM if name == "small" else load(name)


def campaign(
    condition: str, robot: Robot, base: Model, rng: np.random.Generator
) -> tuple[Problem, Array]:
    """(a study, the parameters of its geometry)."""
    count = {"reflectors": 40 if robot.n > 3 else 24, "postures": 25}.get(condition, 48)
    posture = robot.draw(rng, count)
    times = 4 if condition == "postures" else 1
    angles = np.tile(posture, (times, 1))
    tools, target = TOOLS[:1], np.zeros(len(angles), dtype=np.intp)
    if condition == "reflectors":
        angles, target, tools = np.repeat(angles, 3, 0), np.tile(np.arange(3), count), TOOLS
    shares = {"reflectors": 0.5, "postures": 0.3}.get(condition, 0.0)
    owner = (
        np.repeat(np.arange(count), 3)
        if condition == "reflectors"
        else np.tile(np.arange(count), times)
    )
    noise = np.sqrt(shares) * rng.standard_normal((count, 3))[owner] + np.sqrt(
        1 - shares
    ) * rng.standard_normal((len(angles), 3))
    position = np.stack(
        [forward(robot, a[None], tools[t])[0] for a, t in zip(angles, target, strict=True)]
    )
    data = build_measurements(
        angles,
        position,
        target=[f"r{t}" for t in target],
        group=np.repeat(np.arange(times), len(angles) // times) if times > 1 else None,
    )
    at = Problem(robot, data, tools)
    truth = np.zeros(len(base.terms))
    kept = list(fit(at, base).found.kept)
    truth[kept] = rng.normal(0, 1, len(kept)) * [
        0.3 if t.unit == "mm" else 1e-3 for t in np.array(base.terms, object)[kept]
    ]
    noise = SIGMA * noise
    if condition == "planted":
        noise = noise + planted(at, base, rng)
    return replace(
        at,
        data=replace(at.data, position=at.data.position - residuals(at, base.terms, truth) + noise),
    ), truth


def planted(at: Problem, base: Model, rng: np.random.Generator) -> Array:
    """(m, 3) what a wave of a drawn joint moves, PLANTED beyond geometry."""
    j = int(rng.integers(2, at.robot.n + 1))
    wave = Terms(
        (Mechanism("planted", (Term("w", (Screw(j, "rz", sin(2.0 * q(j))),)),), "", "", ""),)
    )
    moved = compute_design(at, wave.terms)[0][:, :, 0]
    fitted = fit(at, base)
    X = compute_design(at, base.terms)[0][:, :, list(fitted.found.kept)].reshape(moved.size, -1)
    left = moved.ravel() - X @ np.linalg.lstsq(X, moved.ravel(), rcond=None)[0]
    size = PLANTED * np.sqrt(90 / moved.size)
    return np.asarray(moved * SIGMA * size * np.sqrt(moved.size) / np.linalg.norm(left))


@dataclass(frozen=True)
class Study:
    """Names found, the search's p, the map's smallest p; of the true parameters, how many the
    reported intervals hold; seconds."""

    names: tuple[str, ...]
    left_p: float
    map_p: float
    parameters: int
    covered: int
    seconds: float


def study(condition: str, arm: str, seed: Sequence[int]) -> Study:
    started = time.process_time()
    rng, robot = np.random.default_rng(seed), arms(arm)
    base = Model((mechanism("geometric", robot),))
    at, truth = campaign(condition, robot, base, rng)
    m = len(at)
    data = Split(
        at,
        np.ones(m, bool),
        np.zeros(m, bool),
        assign_folds(at.data, 10, generator(seed[-1], "folds")),
        False,
    )
    data, extension, _ = diagnose_split(data, base, every(robot), seed[-1], True)
    fitted = fit(data.training(), base)
    table = describe_parameters(
        data, fitted, bootstrap_parameters(data, fitted, generator(seed[-1], "bootstrap"))
    )
    size = dict(zip([t.symbol for t in fitted.terms], truth, strict=True))
    alone = sum(1 for p in table if p.low <= size[p.symbol] <= p.high)
    return Study(
        tuple(e.candidate.mechanism.name for e in extension.effects),
        extension.left_p,
        float(extension.map_p.min()),
        len(table),
        alone,
        time.process_time() - started,
    )


def table(done: dict[str, list[Study]]) -> list[str]:
    lines = [
        f"{'condition':<14}{'studies':>8}  {'something named':<23}{'a cell of the map':<23}95 % intervals hold"
    ]
    for name, all_ in done.items():
        n = len(all_)
        if n:
            share = np.array([s.covered / s.parameters for s in all_])
            lines.append(
                f"{name:<14}{n:>8}  {interval(sum(bool(s.names) for s in all_), n):<23}"
                f"{interval(sum(s.map_p <= LEVEL for s in all_), n):<23}"
                f"{share.mean():.3f} ± {share.std() / np.sqrt(n):.3f}"
            )
    return lines


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--studies", type=int, default=200)
    parser.add_argument("--seed", type=int, default=71)
    parser.add_argument("--arm", default="small")
    parser.add_argument("--conditions", nargs="*", default=list(CONDITIONS))
    parser.add_argument("--out", type=Path)
    asked = parser.parse_args()
    done: dict[str, list[Study]] = {name: [] for name in asked.conditions}
    for k in range(asked.studies):
        for c, name in enumerate(CONDITIONS):
            if name in done:
                done[name].append(study(name, asked.arm, (asked.seed, c, k)))
                print(json.dumps([name, done[name][-1].__dict__]), flush=True)
    said = "\n".join(
        (
            f"Arm {asked.arm}, seed {asked.seed}: rates with 95 % intervals (Clopper-Pearson).",
            "",
            *table(done),
        )
    )
    print(said)
    if asked.out:
        asked.out.write_text(said + "\n")


if __name__ == "__main__":
    main()
