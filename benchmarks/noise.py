"""Errors with a structure: what is named though nothing repeats it, which parts are found, and what
looking for them costs in power.

    python -m benchmarks.noise --studies 200 --seed 16 --workers 2 --out benchmarks/results/noise.txt

Six-axis arms whose geometry alone is wrong, measured under the errors of LINES, noise 0.05 mm a
coordinate. Every study goes through outliers, parts of the errors, naming and parameters as
`modelsel study` does. A joint that does not repeat is off by one uniform draw a visit, through the
exact kinematics, by twice the noise at the target (rms to rms). Two further lines plant a wave of a
joint under independent noise at a size that an oracle, who tests it alone at the scan's own critical
value, finds in 50 % and 90 % of studies: each is searched with and without parts looked for."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from zlib import crc32

import numpy as np
from hidden_arm import off
from hidden_oracle import critical_p, detection
from scipy.optimize import brentq

from modelsel import Model, mechanism
from modelsel._random import generator
from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.candidates.options import DEFAULT_OPTIONS, DiagnosisOptions
from modelsel.diagnosis.columns.candidate_columns import build_columns, stack_design
from modelsel.diagnosis.findings.outcome import Diagnosis
from modelsel.diagnosis.inference.scan import build_scan, compute_basis
from modelsel.diagnosis.procedure import diagnose_split
from modelsel.diagnosis.separation import Inquiry
from modelsel.fitting.design import residuals
from modelsel.fitting.error_structure import ErrorStructure
from modelsel.fitting.least_squares import fit
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.registry import every
from modelsel.mechanisms.terms import Mechanism
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import Robot, forward
from modelsel.selection.evaluation import Split
from modelsel.selection.splits import assign_folds
from modelsel.uncertainty.parameters import bootstrap_parameters, describe_parameters

from .runner import build_parser, count_most, interval, name_command, run_lines

Array = np.ndarray
Generator = np.random.Generator

ARMS = ("puma760", "ur5", "irb120", "ur10e")
SIGMA, LEVEL, SURE = 0.05, 0.05, 0.9
TOOLS = np.array([[60.0, 0.0, 100.0], [-40.0, 70.0, 80.0], [-30.0, -60.0, 140.0]])
# standard deviation of a joint that does not repeat, over the noise, at the target
UNREPEATED = 2.0
# draws of the oracle's critical value
DRAWS = 199


@dataclass(frozen=True)
class Layout:
    """Rows of a campaign: which visit each is of, which posture, and which target it measures."""

    visit: Array
    posture: Array
    target: Array

    @property
    def postures(self) -> int:
        """Number of postures."""
        return int(self.posture.max()) + 1


def lay_out(postures: int, targets: int = 1, times: int = 1) -> Layout:
    """Lay out postures visited `times` in all, in rounds, every target measured at each visit."""
    visits = postures * times
    visit = np.repeat(np.arange(visits), targets)
    return Layout(visit, visit % postures, np.tile(np.arange(targets), visits))


# -- errors (m, 3) over the noise, given (random stream, layout, reach (m,) of the target)


def independent(rng: Generator, rows: Layout, reach: Array) -> Array:
    return rng.standard_normal((len(reach), 3))


def heavy(rng: Generator, rows: Layout, reach: Array) -> Array:
    chi = rng.chisquare(3, (len(reach), 1)) / 3
    return independent(rng, rows, reach) / np.sqrt(chi)


def some_louder(rng: Generator, rows: Layout, reach: Array) -> Array:
    loud = rng.permutation(len(reach)) < len(reach) // 10
    return independent(rng, rows, reach) * np.where(loud, 3.0, 1.0)[:, None]


def by_reach(rng: Generator, rows: Layout, reach: Array) -> Array:
    return independent(rng, rows, reach) * (reach / np.sqrt(np.mean(reach**2)))[:, None]


def in_depth(rng: Generator, rows: Layout, reach: Array) -> Array:
    """Four times louder along z, as a camera is in depth."""
    return independent(rng, rows, reach) * (1.0, 1.0, 4.0)


def lasting(correlation: float) -> Callable[[Generator, Layout, Array], Array]:
    def draw(rng: Generator, rows: Layout, reach: Array) -> Array:
        errors = independent(rng, rows, reach)
        for k in range(1, len(errors)):
            errors[k] = correlation * errors[k - 1] + np.sqrt(1 - correlation**2) * errors[k]
        return errors

    return draw


def shared(share: float, owner: str) -> Callable[[Generator, Layout, Array], Array]:
    def draw(rng: Generator, rows: Layout, reach: Array) -> Array:
        level = getattr(rows, owner)
        own = rng.standard_normal((level.max() + 1, 3))[level]
        return np.sqrt(share) * own + np.sqrt(1 - share) * independent(rng, rows, reach)

    return draw


@dataclass(frozen=True)
class Line:
    """One line of the table: `errors` over the noise; `joint`: one that does not repeat; `truth`: the
    scales of the parts over the noise, where they are defined; `power`: the oracle's, of a wave."""

    words: str
    rows: Layout
    errors: Callable[[Generator, Layout, Array], Array] = independent
    joint: int | None = None
    truth: tuple[tuple[str, float], ...] = ()
    power: float | None = None

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of the parts that are there beyond the instrument."""
        names = tuple(name for name, _ in self.truth if name != "instrument")
        return names if self.joint is None else (f"joint {self.joint}",)


WHITE = (("instrument", 1.0),)


# what is along z beyond the noise in all directions
DEPTH = (("instrument", 1.0), ("instrument z", np.sqrt(15.0)))


def split_variance(share: float) -> tuple[tuple[str, float], ...]:
    return ("instrument", np.sqrt(1 - share)), ("configuration", np.sqrt(share))


LINES = {
    "independent": Line("independent normal, 40", lay_out(40), truth=WHITE),
    "independent-30": Line("independent normal, 30", lay_out(30), truth=WHITE),
    "t3": Line("Student t3, 40", lay_out(40), heavy),
    "loud": Line("one in ten three times louder, 40", lay_out(40), some_louder),
    "reach": Line("in proportion to reach, 40", lay_out(40), by_reach),
    "depth": Line("four times louder along z, 40", lay_out(40), in_depth, truth=DEPTH),
    "depth-80": Line("the same, 80", lay_out(80), in_depth, truth=DEPTH),
    "ar-0.5": Line("lasting, AR(1) 0.5, 40", lay_out(40), lasting(0.5), truth=(("lasting", 1.0),)),
    "ar-0.9": Line("lasting, AR(1) 0.9, 40", lay_out(40), lasting(0.9), truth=(("lasting", 1.0),)),
    "targets-20": Line(
        "3 reflectors, 20 % shared, 40",
        lay_out(40, targets=3),
        shared(0.2, "visit"),
        truth=split_variance(0.2),
    ),
    "targets-50": Line(
        "3 reflectors, 50 % shared, 40",
        lay_out(40, targets=3),
        shared(0.5, "visit"),
        truth=split_variance(0.5),
    ),
    "postures": Line(
        "25 postures 4 times, 30 % shared",
        lay_out(25, times=4),
        shared(0.3, "posture"),
        truth=split_variance(0.3),
    ),
    "joint": Line("joint 2 does not repeat, 40", lay_out(40), joint=2, truth=WHITE),
    "joint-80": Line("the same, 80", lay_out(80), joint=2, truth=WHITE),
    "joint-targets": Line("the same, 80, 2 targets", lay_out(80, targets=2), joint=2, truth=WHITE),
    "joint-repeats": Line(
        "the same, 40 postures twice", lay_out(40, times=2), joint=2, truth=WHITE
    ),
    "power-50": Line("wave, oracle 50 %, 40", lay_out(40), truth=WHITE, power=0.5),
    "power-90": Line("wave, oracle 90 %, 40", lay_out(40), truth=WHITE, power=0.9),
}


@dataclass(frozen=True)
class Study:
    """What one study said: names with their probability; the search's p, the map's smallest; parts
    found; of the components and of the parameters whose truth is known, how many intervals there
    are and how many hold it; names without parts looked for, where that was tried; seconds."""

    line: str
    number: int
    arm: str
    names: tuple[tuple[str, float], ...]
    left_p: float
    map_p: float
    parts: tuple[str, ...]
    components: tuple[tuple[str, bool], ...]
    parameters: int
    covered: int
    without: tuple[str, ...] | None
    seconds: float


def build_campaign(
    line: Line, robot: Robot, base: Model, rng: Generator
) -> tuple[Problem, Array, dict[str, float]]:
    """Build (a campaign, its geometric parameters, the scales of the parts of its errors)."""
    rows = line.rows
    angles = robot.draw(rng, rows.postures)[rows.posture]
    nominal = _problem(robot, angles, rows)
    truth = np.zeros(len(base.terms))
    kept = list(fit(nominal, base).found.kept)
    sizes = [0.3 if base.terms[k].unit == "mm" else 1e-3 for k in kept]
    truth[kept] = rng.standard_normal(len(kept)) * sizes
    scales = {name: SIGMA * size for name, size in line.truth}
    moved = np.zeros_like(angles)
    if line.joint is not None:
        column, scale = line.joint - 1, _unrepeated(nominal, line.joint)
        draws = rng.uniform(-1, 1, rows.visit.max() + 1)[rows.visit]
        moved[:, column] = np.sqrt(3) * scale * draws
        scales[f"joint {line.joint}"] = scale
    if line.power is not None:
        moved += _wave(nominal, base, line.power, rng)
    there = _problem(robot, angles + moved, rows)
    exact = there.data.position - residuals(there, base.terms, truth)
    reach = np.linalg.norm(exact, axis=1)
    measured = exact + SIGMA * line.errors(rng, rows, reach)
    return replace(nominal, data=replace(nominal.data, position=measured)), truth, scales


def _problem(robot: Robot, angles: Array, rows: Layout) -> Problem:
    """A campaign of the nominal robot, without errors."""
    position = np.empty((len(angles), 3))
    for t in np.unique(rows.target):
        own = rows.target == t
        position[own] = forward(robot, angles[own], TOOLS[t])
    data = build_measurements(angles, position, target=[f"r{t}" for t in rows.target])
    return Problem(robot, data, TOOLS[: rows.target.max() + 1])


def _slope(at: Problem, moved: Array, step: float = 1e-5) -> Array:
    """What a small motion (m, n) of the joints moves the targets (m, 3), over its size."""
    angles, target = at.data.q, at.data.target
    out = np.empty((len(angles), 3))
    for t in np.unique(target):
        own = target == t
        ends = [
            forward(at.robot, angles[own] + s * step * moved[own], at.tools[t]) for s in (1, -1)
        ]
        out[own] = (ends[0] - ends[1]) / (2 * step)
    return out


def _unrepeated(at: Problem, joint: int) -> float:
    """The standard deviation [rad] of a joint that moves the target by UNREPEATED of the noise."""
    moved = np.zeros_like(at.data.q)
    moved[:, joint - 1] = 1.0
    lever = np.sqrt(np.mean(np.square(_slope(at, moved))))
    return float(UNREPEATED * SIGMA / lever)


def _wave(at: Problem, base: Model, power: float, rng: Generator) -> Array:
    """A wave (m, n) of a drawn joint that an oracle finds with a power."""
    j = int(rng.integers(1, at.robot.n))
    moved = np.zeros_like(at.data.q)
    moved[:, j] = np.sin(2 * at.data.q[:, j])
    fitted = fit(at, base)
    columns = build_columns(at, build_candidates(at, base, every(at.robot)), fitted.at())
    kept = stack_design(at, base.terms, fitted.at())[0][:, list(fitted.found.kept)]
    seen = build_scan(columns, compute_basis(kept))
    left = float(np.linalg.norm(off(seen.Q, _slope(at, moved).T.ravel())))
    critical = critical_p(seen, rng, DRAWS)
    delta = brentq(lambda d: detection(d, 1, seen.freedom - 1, critical) - power, 0.1, 15.0)
    return np.asarray(moved * delta * SIGMA / left)


def run_one(job: tuple[str, int, int]) -> Study:
    """Run one study of a line, by its seed and number."""
    name, seed, number = job
    started = time.process_time()
    line, arm = LINES[name], ARMS[number % len(ARMS)]
    rng, robot = np.random.default_rng((seed, crc32(name.encode()), number)), load_robot(arm)
    base = Model((mechanism("geometric", robot),))
    at, truth, scales = build_campaign(line, robot, base, rng)
    split, diagnosis = diagnose_campaign(at, base, number)
    fitted = fit(split.training, base)
    bootstrap = bootstrap_parameters(split, fitted, generator(number, "bootstrap"))
    table = describe_parameters(split, fitted, bootstrap)
    size = dict(zip([t.symbol for t in fitted.terms], truth, strict=True))
    without = None
    if line.power is not None:
        plain = diagnose_campaign(at, base, number, DiagnosisOptions(parts=()))[1]
        without = tuple(own for own, _ in _named(plain))
    return Study(
        name,
        number,
        arm,
        _named(diagnosis),
        diagnosis.left_p,
        float(diagnosis.map_p.min()),
        diagnosis.errors.names,
        _hold(diagnosis.errors, scales),
        len(table),
        sum(1 for p in table if p.low <= size[p.symbol] <= p.high),
        without,
        time.process_time() - started,
    )


def diagnose_campaign(
    at: Problem,
    base: Model,
    seed: int,
    options: DiagnosisOptions = DEFAULT_OPTIONS,
    faults: Sequence[Mechanism] = (),
) -> tuple[Split, Diagnosis]:
    """Diagnose a campaign whose rows all estimate, as `modelsel study` does; `faults`: of the data,
    that may be named besides what is registered."""
    m = len(at)
    folds = assign_folds(at.data, 10, generator(seed, "folds"))
    split = Split(at, np.ones(m, bool), np.zeros(m, bool), folds, False)
    everything = (*faults, *every(at.robot))
    split, diagnosis, _ = diagnose_split(
        split, Inquiry(base, everything, seed, True, options=options)
    )
    return split, diagnosis


def _named(diagnosis: Diagnosis) -> tuple[tuple[str, float], ...]:
    tops = [effect.named.entries[0] for effect in diagnosis.effects]
    return tuple((top.candidate.mechanism.name, float(top.probability)) for top in tops)


def _hold(errors: ErrorStructure, scales: dict[str, float]) -> tuple[tuple[str, bool], ...]:
    """(part, whether its interval holds its true scale) of every part found whose scale is known."""
    found = [(part, scales[part.name]) for part in errors.parts if part.name in scales]
    return tuple((part.name, bool(part.low <= scale <= part.high)) for part, scale in found)


# -- tables


def tabulate_names(done: dict[str, list[Study]]) -> list[str]:
    """What is named, and what the map shows, in every line; the geometry's coverage; the names."""
    heads = ("something named", "of them sure", "a cell of the map", "parameters held")
    lines = [f"{'errors':<34}{'studies':>8}  " + "".join(f"{h:<23}" for h in heads) + "names"]
    for name, studies in done.items():
        n = len(studies)
        named = sum(bool(s.names) for s in studies)
        sure = sum(any(p > SURE for _, p in s.names) for s in studies)
        cells = sum(s.map_p <= LEVEL for s in studies)
        held = np.array([s.covered / s.parameters for s in studies])
        known = f"{held.mean():.3f} ± {held.std() / np.sqrt(n):.3f}"
        most = count_most(own for s in studies for own, _ in s.names)
        lines.append(
            f"{LINES[name].words:<34}{n:>8}  {interval(named, n):<23}{interval(sure, n):<23}"
            f"{interval(cells, n):<23}{known:<23}{most}"
        )
    return lines


def tabulate_parts(done: dict[str, list[Study]]) -> list[str]:
    """Which parts are found in every line, and how often the intervals of components hold."""
    heads = ("the part found", "another part", "intervals hold")
    lines = [f"{'errors':<34}" + "".join(f"{h:<23}" for h in heads) + "parts found"]
    for name, studies in done.items():
        there, n = LINES[name].parts, len(studies)
        right = sum(all(part in s.parts for part in there) for s in studies)
        other = sum(any(part not in there for part in s.parts) for s in studies)
        held = [(part, ok) for s in studies for part, ok in s.components]
        cells = [interval(right, n) if there else "-", interval(other, n)]
        cells.append(interval(sum(ok for _, ok in held), len(held)) if held else "-")
        most = count_most((part for s in studies for part in s.parts), 6)
        lines.append(f"{LINES[name].words:<34}" + "".join(f"{c:<23}" for c in cells) + most)
        for part in dict.fromkeys(part for part, _ in held):
            own = [ok for one, ok in held if one == part]
            lines.append(f"    {part:<76}{interval(sum(own), len(own))}")
    return lines


def tabulate_power(done: dict[str, list[Study]]) -> list[str]:
    """What is found with and without parts looked for, in the same studies."""
    lines = []
    for name, studies in done.items():
        if LINES[name].power is not None:
            n = len(studies)
            found = np.array([bool(s.names) for s in studies])
            plain = np.array([bool(s.without) for s in studies])
            lines.append(
                f"{LINES[name].words:<34}found {interval(int(found.sum()), n)}, without parts looked "
                f"for {interval(int(plain.sum()), n)}; only with {int((found & ~plain).sum())}, only "
                f"without {int((plain & ~found).sum())} of {n}"
            )
    return lines


def tabulate(studies: Sequence[Study], command: str) -> str:
    """All tables, the command first."""
    done = {name: [s for s in studies if s.line == name] for name in LINES}
    done = {name: own for name, own in done.items() if own}
    seconds = sum(s.seconds for s in studies) / max(len(studies), 1)
    arms = ", ".join(ARMS)
    how = f"Rates with 95 % intervals (Clopper-Pearson), arms {arms}; {seconds:.1f} s a study."
    return "\n".join(
        (
            command,
            how,
            "",
            *tabulate_names(done),
            "",
            *tabulate_parts(done),
            "",
            *tabulate_power(done),
        )
    ).rstrip()


def main() -> None:
    asked = build_parser(__doc__.splitlines()[0], list(LINES), studies=200, seed=16).parse_args()
    studies = run_lines(asked, list(LINES), Study, run_one)
    said = tabulate(studies, name_command("noise", asked, list(LINES)))
    print(said)
    if asked.out:
        asked.out.write_text(said + "\n")


if __name__ == "__main__":
    main()
