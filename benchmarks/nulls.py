"""What every error control promises, where nothing is wrong: false alarms and coverage under normal
noise, and under what breaks it.

    python -m benchmarks.nulls --studies 300 --seed 29 --out benchmarks/results/nulls.txt
    python -m benchmarks.nulls --studies 300 --seed 29 --equal --out benchmarks/results/nulls-equal.txt

A three-joint arm, 48 configurations in 8 groups of 6, geometry alone is wrong. Every study goes
through outliers, naming and confidence as `modelsel study` does. Conditions: normal noise;
Student-t with 3 degrees of freedom, a draw a configuration; noise that grows with the square of the
reach; an autoregression (0.9) along smooth trajectories, a group each."""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.special import stdtrit
from scipy.stats import kstest

import modelsel.diagnosis.search.state
import modelsel.diagnosis.unexplained
import modelsel.uncertainty.bootstrap
import modelsel.uncertainty.parameters
from modelsel import Model, mechanism
from modelsel._random import generator
from modelsel.diagnosis.faults.data_faults import find_misplaced_rows
from modelsel.diagnosis.unexplained import estimate_predictability
from modelsel.fitting.design import residuals
from modelsel.fitting.least_squares import fit
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.robot.kinematics import forward
from modelsel.uncertainty.parameters import bootstrap_parameters, describe_parameters
from modelsel.uncertainty.significance import compare_nested

from .calibration import ARM, TOOL
from .noise import diagnose_campaign
from .runner import interval

GROUPS, EACH, SIGMA, LEVEL = 8, 6, 0.05, 0.05
BASE = Model((mechanism("geometric", ARM),))
TESTED = mechanism("joint-compliance:2", ARM)
SLANT = np.array([[0.6, 0.8, 0.0], [-0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
Array = np.ndarray


def normal(rng: np.random.Generator, q: Array) -> Array:
    return rng.standard_normal((len(q), 3))


def heavy(rng: np.random.Generator, q: Array) -> Array:
    return rng.standard_normal((len(q), 3)) / np.sqrt(rng.chisquare(3, (len(q), 1)) / 3)


def unequal(rng: np.random.Generator, q: Array) -> Array:
    reach = np.linalg.norm(forward(ARM, q, TOOL), axis=1)
    return (
        rng.standard_normal((len(q), 3))
        * np.clip((reach / np.median(reach)) ** 2, 0.25, 4.0)[:, None]
    )


def slanted(rng: np.random.Generator, q: Array) -> Array:
    return rng.standard_normal((len(q), 3)) @ (np.diag([2.5, 1.0, 1.0]) @ SLANT)


def correlated(rng: np.random.Generator, q: Array) -> Array:
    out = rng.standard_normal((len(q), 3))
    for k in range(len(q)):
        if k % EACH:
            out[k] = 0.9 * out[k - 1] + np.sqrt(1 - 0.81) * out[k]
    return out


CONDITIONS: dict[str, Callable[[np.random.Generator, Array], Array]] = {
    "normal": normal,
    "Student t3": heavy,
    "unequal variances": unequal,
    "larger one way": slanted,
    "correlated trajectories": correlated,
}


def configurations(condition: str, rng: np.random.Generator) -> Array:
    """(48, 3): drawn one by one, or on a straight line in joint space a group."""
    if condition != "correlated trajectories":
        return ARM.draw(rng, GROUPS * EACH)
    start, stop = ARM.draw(rng, GROUPS), ARM.draw(rng, GROUPS)
    along = np.linspace(0, 1, EACH)[:, None]
    return np.concatenate([a + 0.6 * (b - a) * along for a, b in zip(start, stop)])


def campaign(condition: str, rng: np.random.Generator) -> tuple[Problem, Array]:
    """(a study in which geometry alone is wrong, its parameters)."""
    q = configurations(condition, rng)
    at = Problem(
        ARM,
        build_measurements(q, forward(ARM, q, TOOL), group=np.repeat(np.arange(GROUPS), EACH)),
        TOOL[None],
    )
    truth = np.zeros(len(BASE.terms))
    kept = list(fit(at, BASE).found.kept)
    truth[kept] = rng.normal(0, 1, len(kept)) * [
        0.3 if t.unit == "mm" else 1e-3 for t in np.array(BASE.terms, object)[kept]
    ]
    noise = SIGMA * CONDITIONS[condition](rng, q)
    return replace(
        at,
        data=replace(at.data, position=at.data.position - residuals(at, BASE.terms, truth) + noise),
    ), truth


@dataclass(frozen=True)
class Study:
    """What one study said of nothing: names found, the search's and the map's p, of the predictor
    and one single test; outliers, faults; of the true parameters, how many the interval of least
    squares and the reported one cover."""

    names: tuple[str, ...]
    left_p: float
    map_p: float
    predictor_p: float
    single_p: float
    outliers: int
    faults: int
    parameters: int
    covered: int
    covered_reported: int


def take_equal_noise_for_granted() -> None:
    """The program as it would be without the signs of whole postures and groups."""
    modelsel.diagnosis.search.state.Search.expand_partitions = lambda self, view: []
    modelsel.diagnosis.search.state.Search.compute_sign_p = lambda *_: 0.0
    modelsel.diagnosis.unexplained.find_together = lambda *_: None
    modelsel.uncertainty.bootstrap.Bootstrap.p_value = lambda *_: 0.0
    own = modelsel.uncertainty.parameters.run_bootstrap

    def nothing(*given: object) -> modelsel.uncertainty.bootstrap.Bootstrap:
        """Errors of nought on the degrees of freedom of least squares, whose errors are the larger
        then."""
        found = own(*given)
        return replace(
            found,
            errors=np.zeros_like(found.errors),
            units=np.full_like(found.units, given[1].freedom + 1),
        )

    modelsel.uncertainty.parameters.run_bootstrap = nothing


def study(condition: str, seed: Sequence[int]) -> Study:
    rng = np.random.default_rng(seed)
    at, truth = campaign(condition, rng)
    data, extension = diagnose_campaign(at, BASE, seed[-1])
    base_fit = fit(data.training, BASE)
    both = fit(data.training, Model((*BASE.mechanisms, TESTED)))
    own = [
        k for k, t in enumerate(both.terms) if t.key == TESTED.terms[0].key and k in both.found.kept
    ]
    left = extension.fit.residuals(at)[data.used]
    told = estimate_predictability(
        at.data.take(data.used), left, (False,) * 3, generator(seed[-1], "flips")
    )
    wrong = find_misplaced_rows(at, data.outlying, extension.fit, generator(seed[-1], "null"))
    single = (
        compare_nested(both, own, bootstrap_parameters(data, both, generator(seed[-1], "halves")))[
            1
        ]
        if own
        else None
    )
    table = describe_parameters(
        data, base_fit, bootstrap_parameters(data, base_fit, generator(seed[-1], "bootstrap"))
    )
    size = {t.symbol: v for t, v in zip(base_fit.terms, truth)}
    off = np.array([abs(p.estimate - size[p.symbol]) for p in table])
    half = np.array([(p.high - p.low) / 2 for p in table])
    plain = stdtrit(base_fit.freedom, 0.975) * np.array([p.standard_error for p in table])
    return Study(
        tuple(e.candidate.mechanism.name for e in extension.effects),
        extension.left_p,
        float(extension.map_p.min()),
        told.p if told else 1.0,
        1.0 if single is None else single,
        int(data.outlying.sum()),
        len(wrong),
        len(table),
        int((off < plain).sum()),
        int((off < half).sum()),
    )


def table(done: dict[str, list[Study]]) -> list[str]:
    lines = [
        f"{'condition':<24}{'studies':>8}  "
        + "".join(
            f"{w:<23}"
            for w in (
                "something found",
                "a cell of the map",
                "predictor",
                "single F test",
                "rows set aside",
            )
        )
        + "faults"
    ]
    for name, all_ in done.items():
        n = len(all_)
        cells = [
            sum(bool(s.names) for s in all_),
            sum(s.map_p <= LEVEL for s in all_),
            sum(s.predictor_p <= LEVEL for s in all_),
            sum(s.single_p <= LEVEL for s in all_),
            sum(s.outliers > 0 for s in all_),
            sum(s.faults > 0 for s in all_),
        ]
        lines.append(
            (f"{name:<24}{n:>8}  " + "".join(f"{interval(c, n):<23}" for c in cells)).rstrip()
        )
    lines += [
        "",
        (
            "95 % intervals of the geometric parameters: share that covers, least squares' and as reported; single "
            "F test's p against uniform (Kolmogorov-Smirnov); the names found most"
        ),
    ]
    for name, all_ in done.items():
        counts = {k: sum(k in s.names for s in all_) for k in {x for s in all_ for x in s.names}}
        most = ", ".join(f"{k} {v}" for k, v in sorted(counts.items(), key=lambda kv: -kv[1])[:5])
        shares = []
        for which in ("covered", "covered_reported"):
            each = np.array([getattr(s, which) / s.parameters for s in all_])
            shares.append(f"{each.mean():.3f} ± {each.std() / np.sqrt(len(each)):.3f}")
        p = kstest([s.single_p for s in all_], "uniform").pvalue
        lines.append(f"{name:<24}{shares[0]:>16}{shares[1]:>16}   p {p:.2g}   {most}".rstrip())
    return lines


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--studies", type=int, default=300)
    parser.add_argument("--seed", type=int, default=11)
    parser.add_argument("--conditions", nargs="*", default=list(CONDITIONS))
    parser.add_argument("--equal", action="store_true", help="take equal normal noise for granted")
    parser.add_argument("--out", type=Path)
    asked = parser.parse_args()
    if asked.equal:
        take_equal_noise_for_granted()
    done: dict[str, list[Study]] = {name: [] for name in asked.conditions}
    started = time.monotonic()
    for k in range(asked.studies):  # in turn, so that a run cut short has some of each
        for c, name in enumerate(CONDITIONS):
            if name in done:
                done[name].append(study(name, (asked.seed, c, k)))
                print(json.dumps([name, done[name][-1].__dict__]), flush=True)
        if k % 20 == 19:
            print(
                f"{k + 1} studies each, {time.monotonic() - started:.0f} s\n"
                + "\n".join(table(done)),
                flush=True,
            )
    how = ", equal normal noise taken for granted" if asked.equal else ""
    said = "\n".join(
        (
            f"Nothing planted, seed {asked.seed}{how}: rates with 95 % intervals (Clopper-Pearson), level 5 %.",
            "",
            *table(done),
        )
    )
    print(said)
    if asked.out:
        asked.out.write_text(said + "\n")


if __name__ == "__main__":
    main()
