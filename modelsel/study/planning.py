"""From a finished study to a plan: its rivals, the pool of configurations that could be measured,
and the plan in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from .._random import generator
from .._typing import Array
from ..calibration.calibration import Calibration
from ..calibration.experiment_design import (
    MAX_RIVALS,
    Rivals,
    build_pool,
    choose_for_parameters,
    choose_for_rivals,
    compute_indices,
    compute_naming_probability,
    count_more_needed,
    merge_indistinct,
)
from ..diagnosis.stepwise import Effect
from ..exceptions import StudyError, suggest
from ..measurements.columns import READING_UNITS, UNITS
from ..measurements.measurements import Measurements, build_measurements
from ..measurements.reader import read_measurements
from ..measurements.table import Source
from ..mechanisms.terms import Term
from ..robot.kinematics import Robot
from .result import Result

if TYPE_CHECKING:
    import pandas as pd

DRAWN = 2000  # configurations of a pool that is drawn from the limits
COMPARED = 20  # random choices that a plan is held against
SIZES = (2.0, 1.0, 0.5, 0.25)  # of the detection limit, for the learning curve


@dataclass(frozen=True, eq=False, repr=False)
class Planned:
    """Configurations of the pool in the order to measure them, as columns of a measurements file in
    the units of the study's own; what they are for; figures before and after; `configurations`
    measured already; `within`: from where the pool was drawn."""

    rows: tuple[int, ...]
    table: Mapping[str, Array] = field(repr=False)
    configurations: int
    purpose: str
    rivals: tuple[tuple[str, ...], ...]
    twins: tuple[str, ...]
    told: tuple[float, ...]
    random: float | None
    indices: dict[str, tuple[float, float]]
    learning: tuple[tuple[float, int], ...]
    within: str = ""

    def to_frame(self) -> pd.DataFrame:
        """The configurations to measure, in order: a measurements file that lacks the measured
        positions."""
        import pandas as pd

        return pd.DataFrame(self.table)

    def __repr__(self) -> str:
        return " ".join(sentences(self))

    def _repr_html_(self) -> str:
        """The plan in words and its configurations, for a notebook."""
        from html import escape

        said = "".join(f"<li>{escape(sentence)}</li>" for sentence in sentences(self))
        return f"<ul>{said}</ul>{self.to_frame().to_html(index=False, max_rows=20, float_format='%.4f')}"


def rivals_of(result: Result) -> list[Rivals]:
    """Every finding whose credible set has rivals that do not move the target alike, with their
    estimates."""
    return [r for e in result.diagnosis.search.effects if (r := _rivals(result, e)) is not None]


def _rivals(result: Result, effect: Effect) -> Rivals | None:
    first, *others = effect.named.entries[:MAX_RIVALS]
    entries = [first, *(e for e in others if e.probability > 0)]
    if len(entries) < 2:
        return None
    mine = {t.key for t in effect.candidate.mechanism.terms}
    kept = result.models.chosen.fit.terms
    shared = {
        t.key
        for m in result.models.chosen.fit.model.mechanisms
        if m != effect.candidate.mechanism
        for t in m.terms
    }
    rest = tuple(t for t in kept if t.key not in mine or t.key in shared)
    estimates = [
        effect.estimate if e.candidate == effect.candidate else e.estimate for e in entries
    ]
    names = tuple(e.candidate.label for e in entries)
    weight = np.array([e.probability for e in entries])
    return Rivals(
        names,
        tuple(e.candidate.mechanism.terms for e in entries),
        tuple(estimates),
        weight / weight.sum(),
        rest,
    )


def ranges_of(
    robot: Robot, data: Measurements, limits: bool, joints: Mapping[str, tuple[float, float]]
) -> Array:
    """(n, 2) from where to where each joint is drawn, rad or mm: as it was measured; with `limits`
    as far as the robot file lets it (where it says so); `joints`, such as {"q2_deg": (-90, 45)}, go
    before both. Raises StudyError."""
    out = np.stack([data.q.min(0), data.q.max(0)], 1)
    for k, one in enumerate(robot.joints):
        if limits and one.limits is not None:
            out[k] = one.limits
    known = {
        f"q{k + 1}_{u}": (k, UNITS[u])
        for k, slides in enumerate(robot.prismatic)
        for u in READING_UNITS[slides]
    }
    for name, (low, high) in joints.items():
        if name not in known:
            raise StudyError(f'"{name}" is no joint of {robot.name}. {suggest(name, known)}')
        if not (np.isfinite([low, high]).all() and low <= high):
            raise StudyError(
                f"{name}: a joint's range goes from a lower to a higher number, found {low:g} to {high:g}."
            )
        joint, factor = known[name]
        out[joint] = low * factor, high * factor
    return out


def drawn_pool(c: Calibration, seed: int, data: Measurements, ranges: Array) -> Measurements:
    """Configurations drawn within the `ranges` (n, 2), each reached from a drawn side, at
    conditions as they were met."""
    rng = generator(seed, "simulate")
    low, high = ranges.T
    q = rng.uniform(low, high, (DRAWN, c.robot.n))
    met = rng.integers(len(data), size=DRAWN)
    return build_measurements(
        q,
        np.zeros((DRAWN, 3)),
        approach=rng.choice([-1.0, 1.0], q.shape),
        covariates={name: values[met] for name, values in data.covariates.items()},
        prismatic=c.robot.prismatic,
    )


def every_target(data: Measurements, targets: Sequence[str]) -> Measurements:
    """A pool without targets seen through every one of the study's."""
    if len(targets) == 1 or len(data.targets) > 1:
        return data
    rows = np.repeat(np.arange(len(data)), len(targets))
    return replace(
        data.take(rows), target=np.tile(np.arange(len(targets)), len(data)), targets=tuple(targets)
    )


def sided(data: Measurements, seed: int) -> Measurements:
    """A pool whose file gives no directions of approach gets drawn ones: the plan says them."""
    if not any(note.code == "approach-from-order" for note in data.notes):
        return data
    each = generator(seed, "simulate").choice(
        [-1.0, 1.0], (int(data.configuration.max()) + 1, data.q.shape[1])
    )
    return replace(data, approach=each[data.configuration])


def plan(
    result: Result, c: Calibration, possible: Measurements, count: int, purpose: str | None
) -> Planned:
    """`count` configurations of a pool: to tell the study's rivals apart ("rivals", the default
    where it has any), or by one of the criteria of `_choices.PLAN_CRITERIA` for the chosen model's terms
    ("d" is the default elsewhere). Raises DataError or StudyError."""
    fitted = result.models.chosen.fit
    sets = rivals_of(result)
    known = result.split.training()
    terms: list[Term] = [*fitted.terms, *(t for r in sets for some in r.terms for t in some)]
    sigma = result.run.floor.coordinate_mm
    p = build_pool(known, c.problem(possible), terms, fitted.at(), sigma)
    looked = [merge_indistinct(p, r) for r in sets]
    sets, twins = (
        [r for r, _ in looked if r is not None],
        tuple(t for _, some in looked for t in some),
    )
    purpose = purpose or ("rivals" if sets else "d")
    kept = [fitted.terms[k] for k in fitted.representatives]
    random: float | None = None
    if purpose == "rivals":
        if not sets:
            raise StudyError(
                "--for rivals: no finding of this study has rivals that the pool could tell apart."
            )
        rows, told = choose_for_rivals(p, sets, count)
        rng = generator(result.study.seed, "split")
        draws = [
            rng.choice(len(p.possible), min(4 * count, len(p.possible)), replace=False).tolist()
            for _ in range(COMPARED)
        ]
        random = float(np.mean([compute_naming_probability(p, sets, some) for some in draws]))
    else:
        rows = choose_for_parameters(p, kept, count, purpose)
        told = (
            [compute_naming_probability(p, sets, rows[:k]) for k in (0, len(rows))] if sets else []
        )
    before, after = compute_indices(p, kept, []), compute_indices(p, kept, rows)
    limit, n = result.diagnosis.nothing_else[1], known.data.configurations
    learning = (
        ()
        if limit is None
        else tuple((s * limit, count_more_needed(limit, n, s * limit)) for s in SIZES)
    )
    return Planned(
        tuple(rows),
        table_of(c, possible, rows, known.data.units),
        n,
        purpose,
        tuple(r.names for r in sets),
        twins,
        tuple(told),
        random,
        {k: (before[k], after[k]) for k in before},
        learning,
    )


def table_of(
    c: Calibration, possible: Measurements, rows: Sequence[int], units: Sequence[str] = ()
) -> dict[str, Array]:
    """The chosen configurations as columns of a measurements file that lacks the measured
    positions, readings in these units."""
    first = np.unique(possible.configuration, return_index=True)[1][list(rows)]
    units = units or [c.robot.unit(j + 1) for j in range(c.robot.n)]
    out: dict[str, Array] = {
        f"q{j}_{u}": q / UNITS[u]
        for j, (u, q) in enumerate(zip(units, possible.q[first].T, strict=True), 1)
    }
    out |= {f"approach{j + 1}": possible.approach[first, j].astype(int) for j in range(c.robot.n)}
    return out | {name: values[first] for name, values in possible.covariates.items()}


def plan_next(
    result: Result,
    count: int = 10,
    *,
    pool: Source | None = None,
    purpose: str | None = None,
    limits: bool = False,
    joints: Mapping[str, tuple[float, float]] | None = None,
) -> Planned:
    """What to measure next: `count` configurations of a pool (a file or DataFrame of joint
    readings; without one, drawn within the joint ranges that were measured, with `limits` the robot
    file's, with `joints` such as {"q2_deg": (-90, 45)} one's own), chosen as `plan` says. Raises
    DataError or StudyError."""
    c, seed, data = result.calibration, result.study.seed, result.problem.data
    if pool is not None:
        possible, within = (
            sided(read_measurements(pool, c.robot.prismatic, positions=False), seed),
            "",
        )
    else:
        ranges = ranges_of(c.robot, data, limits, joints or {})
        given = [one.limits is not None for one in c.robot.joints]
        possible, within = drawn_pool(c, seed, data, ranges), "the joint ranges measured"
        if limits:
            within = (
                "the robot file's limits" + ("" if all(given) else " where it gives any")
                if any(given)
                else (f"{within}, since the robot file gives no limits")
            )
        within += f", {', '.join(joints)} as given" if joints else ""
    return replace(
        plan(result, c, every_target(possible, c.targets), count, purpose), within=within
    )


def sentences(found: Planned) -> list[str]:
    """The plan in words."""
    out = [f"Drawn within {found.within}."] if found.within else []
    if found.told:
        groups = "; ".join(" or ".join(names) for names in found.rivals)
        out.append(
            f"Rivals: {groups}. The right one is told from its nearest rival with probability {found.told[0]:.2f} now, "
            f"with {found.told[-1]:.2f} after these {len(found.rows)} configurations"
            + (
                "."
                if found.random is None
                else f" ({4 * len(found.rows)} drawn at random: {found.random:.2f})."
            )
        )
    else:
        out.append(
            "No finding of this study has rivals that these configurations could tell apart."
        )
    if found.twins:
        out.append(
            f"Alike in every configuration of the pool: {'; '.join(dict.fromkeys(found.twins))}."
        )
    pairs = {k: v for k, v in found.indices.items() if k.startswith("o")}
    out.append(
        "Observability of the model's parameters, before and after: "
        + ", ".join(f"{k.upper()} {a:.3g} -> {b:.3g}" for k, (a, b) in pairs.items())
        + f"; ln det of the information {found.indices['d'][0]:.1f} -> {found.indices['d'][1]:.1f}."
    )
    if found.learning:
        out.append(
            f"Learning: with the {found.configurations} configurations measured, an effect is found with 90 % from "
            + ", ".join(
                f"{size:.3g} mm rms on with {more} more" for size, more in found.learning if more
            )
            + "."
        )
    return out
