"""Plan what to measure next, from a finished study and a pool of possible configurations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from ..._arguments import check_type, check_whole_number
from ..._choices import PLAN_PURPOSES
from ..._random import generator
from ..._typing import Array
from ..._workers import steady_arithmetic
from ...calibration.calibration import Calibration
from ...calibration.experiment_design import (
    INDEX_WORDS,
    Rivals,
    choose_for_parameters,
    choose_for_rivals,
    compute_indices,
    compute_naming_probability,
    merge_indistinct,
)
from ...calibration.plan_pool import Pool, build_pool
from ...exceptions import StudyError, count_words, write_rounded
from ...fitting.design import ROUNDING
from ...measurements.campaign.visits import count_distinct
from ...measurements.formats.file_form import FileForm
from ...measurements.formats.table import Source, load_table
from ...measurements.measurements import Measurements
from ...measurements.quantities.columns import UNITS
from ...measurements.reader import read_measurements
from ...mechanisms.terms import Term
from ...robot.kinematics import Robot, forward
from ..pipeline.result import Result
from .configuration_pool import (
    COLLISIONS,
    describe_approaches,
    describe_conditions,
    describe_ranges,
    draw_approaches,
    draw_pool,
    find_joint_ranges,
    keep_conditions,
    leave_out_approaches,
    repeat_for_targets,
)
from .learning_curve import estimate_learning, format_learning
from .plan_rivals import depends_on_approach, find_rivals, list_used_names
from .planned_repeats import RepeatPlan, add_rounds, format_repeats, plan_repeats
from .rival_sentences import describe_rivals, follows_gravity

if TYPE_CHECKING:
    import pandas as pd

RANDOM_CHOICES = 20  # random choices that a plan is compared with
# a smaller index of observability is written with its power of ten
MIN_PLAIN_INDEX = 1e-4


@dataclass(frozen=True, eq=False, repr=False)
class MeasurementPlan:
    """Configurations to measure next, what they are for, and what they are expected to bring.

    `table`: the configurations in the order to measure them, as columns of a measurements file in
    the units of the study's own; `rows`: the same by their numbers in the pool; `probabilities`
    that the right one of the `rivals` is told apart, before and after (`random_probability`: after
    four times as many random configurations); `twins`: sentences on rivals that no configuration of
    the pool tells apart; `indices`: name -> observability before and after; `learning`: sizes of
    effects [mm rms], and how many more configurations than the `configurations` that estimate, of
    `measured` in all, find one;
    `within`: the ranges in which the pool was drawn; `repeats`: which of the configurations to
    measure again, so that the study tells what does not repeat (None where it has no points), whose
    rounds the table holds where they were asked for; `by_gravity`: whether a rival follows gravity;
    `count`: how many configurations were asked for, which the pool may not have.
    """

    rows: tuple[int, ...]
    table: Mapping[str, Array] = field(repr=False)
    configurations: int
    purpose: str
    rivals: tuple[tuple[str, ...], ...]
    twins: tuple[str, ...]
    probabilities: tuple[float, ...]
    random_probability: float | None
    indices: dict[str, tuple[float, float]]
    learning: tuple[tuple[float, int], ...]
    within: str = ""
    repeats: RepeatPlan | None = None
    by_gravity: bool = False
    count: int = 0
    measured: int = 0

    def to_frame(self) -> pd.DataFrame:
        """Return the configurations in order, as a measurements file without positions."""
        import pandas as pd

        return pd.DataFrame(self.table)

    def __repr__(self) -> str:
        return " ".join(format_plan(self))

    def _repr_html_(self) -> str:
        """Return the plan in words and its configurations, for a notebook."""
        from html import escape

        lines = format_plan(self)
        items = "".join(f"<li>{escape(line)}</li>" for line in lines)
        table = self.to_frame().to_html(index=False, max_rows=20, float_format="%.4f")
        return f"<ul>{items}</ul>{table}"


def choose_configurations(
    result: Result,
    calibration: Calibration,
    possible: Measurements,
    count: int,
    purpose: str | None,
) -> MeasurementPlan:
    """Choose `count` configurations of a pool.

    `purpose` is "rivals", to tell the study's rival explanations apart (the default where there are
    any), or a criterion for the chosen model's terms, "d" (default), "a" or "o1" to "o5" (Sun &
    Hollerbach 2008). Raises DataError or StudyError.
    """
    _check_purpose(purpose)
    fitted = result.models.chosen.fit
    known = result.split.training
    rival_sets = find_rivals(result)
    rival_terms: list[Term] = []
    for rivals in rival_sets:
        for terms in rivals.terms:
            rival_terms += terms
    candidates = build_pool(
        known,
        calibration.problem(possible),
        [*fitted.terms, *rival_terms],
        fitted.at(),
        # measurements without noise determine no less than rounding
        max(result.run.floor.coordinate_mm, ROUNDING * known.reach_mm),
    )
    rival_sets, twins = _separate_twins(candidates, rival_sets)
    purpose = purpose or ("rivals" if rival_sets else "d")
    parameters = [fitted.terms[k] for k in fitted.representatives]
    random_probability = None
    probabilities: Sequence[float] = ()
    if purpose == "rivals":
        if not rival_sets:
            raise StudyError(
                "rivals: no finding of this study has rivals that the pool could tell apart. Plan for "
                "another purpose."
            )
        rows, probabilities = choose_for_rivals(candidates, rival_sets, count)
        random_probability = _measure_random_choice(
            candidates, rival_sets, count, result.study.seed
        )
    else:
        rows = choose_for_parameters(candidates, parameters, count, purpose)
        if rival_sets:
            probabilities = [
                compute_naming_probability(candidates, rival_sets, []),
                compute_naming_probability(candidates, rival_sets, rows),
            ]
    before = compute_indices(candidates, parameters, [])
    after = compute_indices(candidates, parameters, rows)
    return MeasurementPlan(
        rows=tuple(rows),
        table=tabulate_configurations(calibration, possible, rows, known.data.units),
        configurations=known.data.configurations,
        purpose=purpose,
        rivals=tuple(rivals.names for rivals in rival_sets),
        twins=twins,
        probabilities=tuple(probabilities),
        random_probability=random_probability,
        indices={name: (before[name], after[name]) for name in before},
        learning=estimate_learning(result.diagnosis.nothing_else.mm, known.data.configurations),
        by_gravity=any(follows_gravity(rivals) for rivals in rival_sets),
        count=count,
        measured=result.problem.data.configurations,
    )


def _separate_twins(
    candidates: Pool, rival_sets: Sequence[Rivals]
) -> tuple[list[Rivals], tuple[str, ...]]:
    """Return the rivals that the pool could tell apart, and sentences on those it could not."""
    separable: list[Rivals] = []
    twins: list[str] = []
    for rivals in rival_sets:
        distinct_rivals, alike = merge_indistinct(candidates, rivals)
        twins += alike
        if distinct_rivals is not None:
            separable.append(distinct_rivals)
    return separable, tuple(twins)


def _measure_random_choice(
    candidates: Pool, rival_sets: Sequence[Rivals], count: int, seed: int
) -> float:
    """Return the mean probability of telling rivals apart with four times as many random rows."""
    rng = generator(seed, "split")
    available = len(candidates.possible)
    size = min(4 * count, available)
    probabilities = []
    for _ in range(RANDOM_CHOICES):
        rows = rng.choice(available, size, replace=False).tolist()
        probability = compute_naming_probability(candidates, rival_sets, rows)
        probabilities.append(probability)
    mean = np.mean(probabilities)
    return float(mean)


def tabulate_configurations(
    calibration: Calibration, possible: Measurements, rows: Sequence[int], units: Sequence[str] = ()
) -> dict[str, Array]:
    """Return the chosen configurations as columns of a measurements file without positions.

    `units` of the joint readings: by default the robot's own.
    """
    robot = calibration.robot
    joints = range(robot.n)
    chosen = _take_configurations(possible, rows)
    q, approach = chosen.readings, chosen.approach
    if not units:
        units = [robot.unit(j + 1) for j in joints]
    columns: dict[str, Array] = {}
    for j, unit in enumerate(units):
        name = f"q{j + 1}_{unit}"
        factor = UNITS[unit]
        readings = q[:, j]
        columns[name] = readings / factor
    for j in joints:
        name = f"approach{j + 1}"
        directions = approach[:, j]
        columns[name] = directions.astype(int)
    columns |= chosen.covariates
    return columns


def _take_configurations(possible: Measurements, rows: Sequence[int]) -> Measurements:
    """Take the first row of each configuration, by their numbers in the pool."""
    _, first = np.unique(possible.configuration, return_index=True)
    return possible.take(first[list(rows)])


def _plan_repeats(
    result: Result, calibration: Calibration, chosen: Measurements, times: int | None
) -> RepeatPlan | None:
    """Plan which of the chosen configurations to measure again; None where no point is measured."""
    known = result.split.training
    if not known.only_points:
        return None
    problem = calibration.problem(chosen)
    places = forward(problem.robot, chosen.q, problem.tool)
    before = known.data.configurations - count_distinct(known.data.block)
    return plan_repeats(chosen.q, places, before, times)


def _check_purpose(purpose: str | None) -> None:
    """Refuse a purpose that a plan cannot have. Raises StudyError."""
    if purpose is None:
        return
    check_type("purpose", purpose, str, "the name of a purpose")
    if purpose in PLAN_PURPOSES:
        return
    known = ", ".join(PLAN_PURPOSES)
    raise StudyError(f"purpose: expected one of {known}, or None, found {purpose!r}.")


@steady_arithmetic()
def plan_next(
    result: Result,
    count: int = 10,
    *,
    pool: Source | None = None,
    purpose: str | None = None,
    limits: bool = False,
    joints: Mapping[str, tuple[float, float]] | None = None,
    repeats: int | None = None,
) -> MeasurementPlan:
    """Plan what to measure next: the `count` best configurations of a pool.

    Args:
        result: a study that this session has run; one that was read back from its folder lacks the fits, and is
            refused (a pickled result keeps them).
        count: how many configurations to choose.
        pool: a file or DataFrame of joint readings, of the contract's names or the study's; by default drawn within the ranges measured.
        purpose: "rivals", to tell the study's rival explanations apart (the default where it has any); or a
            criterion for the parameters of its model, "d" (the default without rivals), "a", or "o1" to "o5".
        limits: draw the pool within the robot file's joint limits.
        joints: draw joints within these ranges, such as {"q2_deg": (-90, 45)}.
        repeats: write some of the configurations so many times in all, in separate rounds.

    Raises:
        DataError or StudyError.
    """
    check_type("result", result, Result, "a Result, as run_study returns it")
    check_whole_number("count", count, 1)
    check_type("limits", limits, bool, "True or False")
    if repeats is not None:
        check_whole_number("repeats", repeats, 2)
    calibration = result.calibration
    robot = calibration.robot
    seed = result.study.seed
    within = ""
    if pool is not None:
        listed = read_pool(pool, robot, calibration.form)
        possible = draw_approaches(listed, seed)
    else:
        data = result.problem.data
        given = {} if joints is None else joints
        ranges = find_joint_ranges(robot, data, limits, given)
        possible = draw_pool(calibration, seed, data, ranges)
        within = describe_ranges(robot, limits, given)
        possible = keep_conditions(possible, list_used_names(result))
    targets = calibration.targets
    possible = repeat_for_targets(possible, targets)
    plan = choose_configurations(result, calibration, possible, count, purpose)
    chosen = _take_configurations(possible, plan.rows)
    again = _plan_repeats(result, calibration, chosen, repeats)
    table = plan.table
    if not depends_on_approach(result):
        table = leave_out_approaches(table)
    if repeats is not None and again is not None:
        table = add_rounds(table, again, generator(seed, "rounds"))
    return replace(plan, within=within, repeats=again, table=table)


def read_pool(pool: Source, robot: Robot, form: FileForm) -> Measurements:
    """Read the configurations that could be measured: columns have the contract's names, or those of
    the study's own file. Raises DataError."""
    listed = load_table(pool)
    mapping = form.map_columns(listed, {})
    return read_measurements(listed, robot, mapping, positions=False)


def format_plan(plan: MeasurementPlan) -> list[str]:
    """Return a plan in words, one line per topic."""
    lines = []
    if plan.within:
        lines.append(f"Drawn within {plan.within}. {COLLISIONS}")
    listed = len(plan.rows)
    if listed < plan.count:
        held = count_words(listed, "configuration")
        lines.append(
            f"The pool has {held}, fewer than the {plan.count:,} asked for: all are chosen."
        )
    rivals = describe_rivals(
        plan.rivals, plan.probabilities, plan.random_probability, len(plan.rows), plan.by_gravity
    )
    lines.append(rivals)
    if plan.twins:
        twins = "; ".join(dict.fromkeys(plan.twins))
        lines.append(f"Alike in every configuration of the pool: {twins}.")
    columns = [describe_approaches(plan.table), describe_conditions(plan.table)]
    lines += [sentence for sentence in columns if sentence]
    lines.append(_format_indices(plan))
    if plan.measured > plan.configurations:
        lines.append(_describe_split(plan))
    if plan.learning:
        lines.append(format_learning(plan))
    if plan.repeats is not None:
        lines.append(format_repeats(plan.repeats))
    return lines


def _describe_split(plan: MeasurementPlan) -> str:
    """Say how the configurations of a plan come to estimate: a study's split draws anew among more rows."""
    raised = plan.configurations + len(plan.rows)
    return (
        "These figures hold where all of these configurations estimate. A split that is drawn is drawn anew with "
        f"more rows: set `estimation = {raised}` under [split], or say in a column which rows are held out "
        "(`split.column`)."
    )


def _format_indices(plan: MeasurementPlan) -> str:
    observability = []
    for name, (before, after) in plan.indices.items():
        if not name.startswith("o"):
            continue
        first = _write_index(before)
        second = _write_index(after)
        words = INDEX_WORDS[name]
        observability.append(f"{name.upper()} ({words}) {first} -> {second}")
    before, after = plan.indices["d"]
    return (
        "Observability of the model's parameters, before and after, larger is better: "
        f"{', '.join(observability)}; ln det of the information {before:.1f} -> {after:.1f}."
    )


def _write_index(value: float) -> str:
    """Write an index of observability, of which only the powers of ten count where it is small."""
    if 0 < value < MIN_PLAIN_INDEX:
        return f"{value:.1e}"
    return write_rounded(value)
