"""Figures of findings: how large each is beyond what else the model holds, whether it matters, its
worst in the workspace, and its usable numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from .._linalg import TINY, orthonormal_basis, project_out
from .._random import generator
from .._typing import Array
from ..diagnosis.effects import Effect
from ..diagnosis.sentences import format_length
from ..exceptions import sentence_list
from ..fitting.least_squares import Fit
from .quantities import Usable, describe_ends, format_figure
from .small_findings import write_number
from .study_run import StudyRun
from .usable_numbers import PLAYS, list_usable
from .verdict import Named
from .workspace import Fitted, Range, Workspace, build_workspace

# share of the mean square of what is left that an effect which matters has at least
MIN_SHARE = 0.1
# of the squares of unit columns, that keeps their Gram matrix invertible
RIDGE = 1e-11

Values = dict[str, Any]


@dataclass(frozen=True)
class Worst:
    """Where an effect moves the target most [mm], and the joint readings there (degrees; mm of a
    slide); `by_side`: to either of two sides, whose step is twice as large."""

    moved: Range
    readings: tuple[float, ...]
    slides: tuple[bool, ...]
    beyond: tuple[int, ...]
    by_side: bool = False

    def describe(self) -> Values:
        """Return result.json's value; `unmeasured_joints`: those beyond their measured range."""
        return {
            "mm": self.moved.value,
            "low": self.moved.low,
            "high": self.moved.high,
            "joints_deg": list(self.readings),
            "unmeasured_joints": list(self.beyond),
            "text": self.text,
        }

    @property
    def text(self) -> str:
        """In words: how far, and where the joints stand."""
        places = ", ".join(
            f"{round(reading)} mm" if slides else f"{round(reading)}°"
            for reading, slides in zip(self.readings, self.slides, strict=True)
        )
        beyond = ""
        if self.beyond:
            numbers = sentence_list([str(joint) for joint in self.beyond])
            joints = "joint" if len(self.beyond) == 1 else "joints"
            beyond = f", beyond the measured range of {joints} {numbers}"
        size = f"{format_figure(self.moved.value)} mm{describe_ends(self.moved)}"
        side = " to either side" if self.by_side else ""
        return f"at most {size} at the target{side}, where the joints stand at {places}{beyond}"


@dataclass(frozen=True)
class Figures:
    """Figures of one finding; `rms_mm`: what is moved at the measured rows beyond the base and the
    other findings that matter."""

    rms_mm: float
    matters: bool
    worst: Worst
    usable: tuple[Usable, ...]


@dataclass(frozen=True)
class FindingFigures:
    """Figures of all findings; `small_rms_mm`: of those that do not matter, together."""

    each: tuple[Figures, ...]
    small_rms_mm: float


def order_findings(run: StudyRun) -> StudyRun:
    """Return a run with its findings in the order of how far each moves the target at most, the
    largest first: the order in which all outputs tell them."""
    fitted = bind_findings(run) if run.diagnosis.findings else []
    sizes = np.array([find_worst(one).moved.value for one in fitted])
    order = np.argsort(-sizes, kind="stable")
    findings = tuple(run.diagnosis.findings[k] for k in order)
    return replace(run, diagnosis=replace(run.diagnosis, findings=findings))


def measure_effects(run: StudyRun) -> FindingFigures:
    """Measure what every finding of a run does to the target."""
    findings = run.diagnosis.findings
    if not findings:
        return FindingFigures((), 0.0)
    fitted = bind_findings(run)
    workspace = fitted[0].workspace
    base = [term for term in run.diagnosis.search.base.terms if not term.fixture]
    sizes = measure_sizes(fitted, workspace.displace(base), _find_threshold(run))
    each = []
    for k, (finding, one) in enumerate(zip(findings, fitted, strict=True)):
        mechanism = finding.effect.candidate.mechanism
        usable = list_usable(mechanism, one)
        worst = find_worst(one)
        by_side = mechanism.stem in PLAYS
        figures = Figures(
            rms_mm=float(sizes.rms[k]),
            matters=bool(sizes.matters[k]),
            worst=replace(worst, by_side=by_side),
            usable=tuple(usable),
        )
        each.append(figures)
    return FindingFigures(tuple(each), sizes.small_rms)


def bind_findings(run: StudyRun) -> list[Fitted]:
    """Bind every finding's effect to one workspace of the run, the same whenever it is asked for."""
    workspace = build_workspace(
        run.problem.take(run.split.used), generator(run.study.seed, "workspace")
    )
    fit = run.diagnosis.search.fit
    return [bind_effect(finding.effect, fit, workspace) for finding in run.diagnosis.findings]


def _find_threshold(run: StudyRun) -> float:
    """Find the rms [mm] from which an effect matters: its mean square is above a tenth of that of
    what is left, or it is above the noise."""
    named_last = run.diagnosis.search.effects[-1].candidate
    gains = [one.gain for one in run.diagnosis.findings if one.effect.candidate == named_last]
    last = gains[-1].held_out_rms_after_mm
    left = last if last is not None else run.models.chosen.estimation.rms_mm or 0.0
    noise = run.floor.coordinate_mm * float(np.sqrt(run.floor.coordinates))
    return min(left * float(np.sqrt(MIN_SHARE)), noise)


def bind_effect(effect: Effect, fit: Fit, workspace: Workspace) -> Fitted:
    """Bind an effect to the workspace, with the effect's standard errors and the correlation of the
    fit that it belongs to."""
    terms = effect.candidate.mechanism.terms
    place = {term.key: k for k, term in enumerate(fit.terms)}
    keys = [term.key for term in terms]
    covariance = np.diag(np.square(effect.standard_error))
    if all(key in place for key in keys):
        own = [place[key] for key in keys]
        covariance = scale_covariance(fit.covariance[np.ix_(own, own)], effect.standard_error)
    return Fitted(terms, effect.estimate, covariance, workspace)


def scale_covariance(covariance: Array, errors: Array) -> Array:
    """Scale a covariance matrix to other standard errors, with the same correlation."""
    own = np.sqrt(np.diag(covariance))
    ratio = np.divide(errors, own, out=np.ones_like(own), where=own > 0)
    return np.asarray(covariance * np.outer(ratio, ratio))


def find_worst(fitted: Fitted) -> Worst:
    """Find where in the workspace an effect moves the target most."""
    workspace = fitted.workspace
    row = fitted.find_worst()
    readings = workspace.q[row]
    low, high = workspace.seen
    is_beyond = (readings < low) | (readings > high)
    beyond = np.flatnonzero(is_beyond) + 1
    prismatic = workspace.problem.robot.prismatic
    shown = []
    for reading, slides in zip(readings, prismatic, strict=True):
        value = reading if slides else np.degrees(reading)
        shown.append(float(value) + 0.0)
    moved = fitted.moved_at(row)
    return Worst(moved, tuple(shown), prismatic, tuple(beyond.tolist()))


# -- sizes
# --------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Sizes:
    """The rms [mm] of every effect beyond the base and those that matter (k,), which matter (k,),
    and the rms of the others together."""

    rms: Array
    matters: Array
    small_rms: float


def measure_sizes(fitted: Sequence[Fitted], base: Array, threshold: float) -> Sizes:
    """Measure the effects' sizes at the measured rows; `base` (p, 3, m): the base's displacements.

    Effects are set aside, the smallest first, as long as what one does alone, beyond the base and
    those that are left, is below the threshold: of two that can stand for each other, one stays."""
    rows = fitted[0].workspace.measured
    basis = orthonormal_basis(_flatten(base, rows))
    columns, owner = [], []
    for k, one in enumerate(fitted):
        scaled = _flatten(one.columns, rows) * one.estimate
        columns.append(project_out(scaled, basis))
        owner += [k] * len(one.terms)
    beyond = np.concatenate(columns, axis=1) / np.sqrt(rows)
    gram = beyond.T @ beyond
    return _set_aside(gram, np.array(owner), threshold)


def _flatten(displacement: Array, rows: int) -> Array:
    """Return displacements (p, 3, m) of the first rows as columns (3 rows, p)."""
    measured = displacement[:, :, :rows]
    columns = measured.reshape(len(measured), 3 * rows)
    return np.asarray(columns.T)


def _set_aside(gram: Array, owner: Array, threshold: float) -> Sizes:
    """Set effects aside; `gram` (c, c): products of all terms' displacements beyond the base, each
    times its estimate, so that an effect is the sum of its columns."""
    count = int(owner.max()) + 1
    matters = np.ones(count, bool)
    while matters.any():
        kept = matters[owner]
        alone = _measure_each(gram[np.ix_(kept, kept)], owner[kept])
        smallest = min(alone, key=lambda k: alone[k])
        if alone[smallest] >= threshold:
            break
        matters[smallest] = False
    kept = matters[owner]
    rms = np.array([_measure_beyond(gram, owner == k, kept & (owner != k)) for k in range(count)])
    return Sizes(rms, matters, _measure_beyond(gram, ~kept, kept))


def _measure_each(gram: Array, owner: Array) -> dict[int, float]:
    """Measure the rms of every effect beyond all others, from one inverse (Schur's complement)."""
    scale, inner = _normalise(gram)
    inverse = np.linalg.inv(inner)
    alone = {}
    for k in np.unique(owner).tolist():
        own = owner == k
        square = scale[own] @ np.linalg.solve(inverse[np.ix_(own, own)], scale[own])
        alone[k] = float(np.sqrt(max(square, 0.0)))
    return alone


def _measure_beyond(gram: Array, own: Array, others: Array) -> float:
    """Measure the rms of the sum of some columns beyond the span of others."""
    square = gram[np.ix_(own, own)].sum()
    if others.any():
        scale, inner = _normalise(gram[np.ix_(others, others)])
        shared = gram[np.ix_(others, own)].sum(1) / scale
        square -= shared @ np.linalg.solve(inner, shared)
    return float(np.sqrt(max(square, 0.0)))


def _normalise(gram: Array) -> tuple[Array, Array]:
    """Return the lengths of columns, and the products of columns of unit length, made invertible."""
    scale = np.sqrt(np.maximum(np.diag(gram), TINY))
    return scale, gram / np.outer(scale, scale) + RIDGE * np.eye(len(gram))


# -- from figures to records
# --------------------------------------------------------------------------------------------------


def describe_figures(figures: Figures) -> Values:
    """Return what result.json has of one finding's figures."""
    return {
        "matters": figures.matters,
        "rms_mm": figures.rms_mm,
        "worst": figures.worst.describe(),
        "usable": [asdict(one) for one in figures.usable],
    }


def describe_small(named: Sequence[Named], figures: FindingFigures) -> Values | None:
    """Return result.json's `small_findings`; None where every finding matters. `named`: faults of the
    data first, then the findings."""
    effects = named[len(named) - len(figures.each) :]
    sizes = [
        (one, of.rms_mm) for one, of in zip(effects, figures.each, strict=True) if not of.matters
    ]
    if not sizes:
        return None
    sentence = _write_sizes(sizes, figures.small_rms_mm)
    return {"count": len(sizes), "rms_mm": figures.small_rms_mm, "sentence": sentence}


def _write_sizes(sizes: Sequence[tuple[Named, float]], rms_mm: float) -> str:
    """Write the line of small findings with their rms [mm], and what they are together."""
    parts = []
    for one, size in sizes:
        doubt = ""
        if one.doubtful:
            doubt = " (doubtful)"
        parts.append(f"{one.name} {format_length(size)}{doubt}")
    listed = ", ".join(parts)
    if len(sizes) == 1:
        return f"One smaller error: {listed} rms."
    number = write_number(len(sizes))
    return f"{number} smaller errors, {format_length(rms_mm)} rms together: {listed}."
