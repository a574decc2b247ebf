"""Figures of findings: how large each is beyond what else the model holds, whether it matters, its
worst in the workspace, how far it turns the target where that was measured, its usable numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from ..._random import generator
from ..._typing import Array
from ...diagnosis.candidates.signatures import SHAPELESS
from ...diagnosis.findings.effects import Effect
from ...diagnosis.findings.sentences import format_angle, format_length
from ...fitting.least_squares import Fit
from ...fitting.noise import RAD_PER_MM
from ...selection.evaluation import Evaluation, Split, measure_orientation
from ...selection.gain import Gain
from ..numbers.compliance_numbers import measure_springs_apart
from ..numbers.effect_sizes import measure_sizes
from ..numbers.quantities import MILLI, Usable, describe_ends, format_figure, say_beyond
from ..numbers.usable_numbers import PLAYS, list_usable
from ..numbers.workspace import Fitted, Range, Workspace, build_workspace
from ..runs.map_details import MIN_DISPLACEMENT
from ..runs.study_run import StudyRun
from ..sentences.small_findings import write_number
from .verdict import Named

# share of the mean square of what is left that an effect which matters has at least
MIN_SHARE = 0.1

# what a size in mm or in mrad is a change of, and how none is told
WHAT_CHANGES = {"mm": "at the target", "mrad": "of the target's orientation"}
NO_CHANGE = {
    "mm": "the target's position does not change",
    "mrad": "the target's orientation does not change",
}

# mrad, below which a turn is rounding
MIN_TURN = 1e-6

Values = dict[str, Any]


@dataclass(frozen=True)
class Worst:
    """Where an effect moves the target most [mm], or turns it most [mrad], and the joint readings
    there (degrees; mm of a slide); `by_side`: to either of two sides, whose step is twice as
    large."""

    moved: Range
    readings: tuple[float, ...]
    slides: tuple[bool, ...]
    beyond: tuple[int, ...]
    by_side: bool = False
    unit: str = "mm"

    def describe(self) -> Values:
        """Return result.json's value; `unmeasured_joints`: those beyond their measured range."""
        return {
            self.unit: self.moved.value,
            "low": self.moved.low,
            "high": self.moved.high,
            "joints_deg": list(self.readings),
            "unmeasured_joints": list(self.beyond),
            "text": self.text,
        }

    @property
    def text(self) -> str:
        """In words: how far, and where the joints stand."""
        if self.moved.value == 0:
            return NO_CHANGE[self.unit]
        places = ", ".join(
            f"{round(reading)} mm" if slides else f"{round(reading)}°"
            for reading, slides in zip(self.readings, self.slides, strict=True)
        )
        beyond = say_beyond(self.beyond)
        size = f"{format_figure(self.moved.value)} {self.unit}{describe_ends(self.moved)}"
        side = " to either side" if self.by_side else ""
        what = WHAT_CHANGES[self.unit]
        return f"at most {size} {what}{side}, where the joints stand at {places}{beyond}"


@dataclass(frozen=True)
class Turning:
    """How far a finding turns the target: its rms at the measured rows and its worst [mrad].

    `prevails`: it changes the orientation more than the position, each against what is left of
    it."""

    rms_mrad: float
    worst: Worst
    prevails: bool

    def describe(self) -> Values:
        """Return result.json's value."""
        return {"rms_mrad": self.rms_mrad, **self.worst.describe(), "prevails": self.prevails}


@dataclass(frozen=True)
class Figures:
    """Figures of one finding; `rms_mm`: what is moved at the measured rows beyond the base and the
    other findings that matter; `turning`: None where no orientation was measured."""

    rms_mm: float
    matters: bool
    worst: Worst
    usable: tuple[Usable, ...]
    turning: Turning | None = None

    @property
    def is_turning_told(self) -> bool:
        """Whether the turning is told beside the mm."""
        return self.turning is not None and self.turning.prevails


@dataclass(frozen=True)
class FindingFigures:
    """Figures of all findings; `small_rms_mm`, `small_rms_mrad`: of those that do not matter,
    together."""

    each: tuple[Figures, ...]
    small_rms_mm: float
    small_rms_mrad: float | None = None

    @property
    def told_small_mrad(self) -> float | None:
        """The rms of the turning [mrad] of those that do not matter, where that of one is told."""
        told = any(one.is_turning_told for one in self.each if not one.matters)
        return self.small_rms_mrad if told else None


def order_findings(run: StudyRun) -> StudyRun:
    """Return a run with its findings in the order of how far each moves the target at most, or
    turns it, the largest first: the order in which all outputs tell them."""
    if not run.diagnosis.findings:
        return run
    mm_per_rad = find_mm_per_rad(run.split, run.models.chosen, _find_last_gain(run))
    sizes = []
    for one in bind_findings(run):
        moved, turned = find_worst(one).moved.value, find_worst_turn(one).moved.value
        sizes.append(max(moved, turned / MILLI * mm_per_rad))
    order = np.argsort(-np.array(sizes), kind="stable")
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
    mm_per_rad = find_mm_per_rad(run.split, run.models.chosen, _find_last_gain(run))
    sizes = measure_sizes(fitted, base, _find_threshold(run), mm_per_rad)
    each = []
    for k, (finding, one) in enumerate(zip(findings, fitted, strict=True)):
        effect = finding.effect
        mechanism = effect.candidate.mechanism
        by_side = mechanism.stem in PLAYS
        worst = replace(find_worst(one), by_side=by_side)
        turning = None
        if workspace.oriented:
            turned = replace(find_worst_turn(one), by_side=by_side)
            prevails = finding.orientation_gain is not None
            turning = Turning(MILLI * float(sizes.rms_rad[k]), turned, prevails)
        figures = Figures(
            rms_mm=float(sizes.rms[k]),
            matters=bool(sizes.matters[k]),
            worst=worst,
            usable=tuple(_list_usable(effect, one)),
            turning=turning,
        )
        each.append(figures)
    small_rms_mrad = MILLI * sizes.small_rms_rad if workspace.oriented else None
    return FindingFigures(tuple(each), sizes.small_rms, small_rms_mrad)


def _list_usable(effect: Effect, fitted: Fitted) -> list[Usable]:
    """List the usable numbers of an effect, with what a payload alone tells of its stiffness."""
    usable = list_usable(effect.candidate.mechanism, fitted)
    if effect.apart is not None:
        usable.append(measure_springs_apart(effect.apart))
    return usable


def bind_findings(run: StudyRun) -> list[Fitted]:
    """Bind every finding's effect to one workspace of the run, the same whenever it is asked for."""
    effects = [finding.effect for finding in run.diagnosis.findings]
    fit = run.diagnosis.search.fit
    return bind_effects(effects, fit, run.split, run.study.seed)


def bind_effects(effects: Sequence[Effect], fit: Fit, split: Split, seed: int) -> list[Fitted]:
    """Bind effects to the workspace of a split, the same for the same seed."""
    used = split.problem.take(split.used)
    rng = generator(seed, "workspace")
    workspace = build_workspace(used, rng)
    return [bind_effect(effect, fit, workspace) for effect in effects]


def _find_threshold(run: StudyRun) -> float:
    """Find the rms [mm] from which an effect matters: its mean square is above a tenth of that of
    what is left, or it is above the noise."""
    noise = run.floor.coordinate_mm * float(np.sqrt(run.floor.coordinates))
    left = _find_left(run.models.chosen, _find_last_gain(run))
    return min(left * float(np.sqrt(MIN_SHARE)), noise)


def _find_last_gain(run: StudyRun) -> Gain:
    """Find the gain of what was named last."""
    named_last = run.diagnosis.search.effects[-1].candidate
    gains = [one.gain for one in run.diagnosis.findings if one.effect.candidate == named_last]
    return gains[-1]


def _find_left(chosen: Evaluation, last: Gain) -> float:
    """Find the rms of the position error that is left [mm]."""
    left = last.held_out_rms_after_mm
    return left if left is not None else chosen.estimation.rms_mm or 0.0


def find_mm_per_rad(split: Split, chosen: Evaluation, last: Gain) -> float:
    """Find the mm of position that count as a rad of orientation: what is left of the one against
    what is left of the other; 0 where no orientation was measured.

    `last`: the gain of what was named last."""
    angles = measure_orientation(split, chosen, chosen)
    if angles is None:
        return 0.0
    _, angle = angles
    if angle > 0:
        left_mm = _find_left(chosen, last)
        return left_mm / angle
    return 1 / RAD_PER_MM


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
    reaches = effect.candidate.kind not in SHAPELESS
    return Fitted(terms, effect.estimate, covariance, workspace, reaches)


def scale_covariance(covariance: Array, errors: Array) -> Array:
    """Scale a covariance matrix to other standard errors, with the same correlation."""
    own = np.sqrt(np.diag(covariance))
    ratio = np.divide(errors, own, out=np.ones_like(own), where=own > 0)
    return np.asarray(covariance * np.outer(ratio, ratio))


def find_worst(fitted: Fitted) -> Worst:
    """Find where in the workspace an effect moves the target most."""
    row = fitted.find_worst()
    moved = fitted.moved_at(row)
    if moved.value < MIN_DISPLACEMENT:
        moved = Range(0.0, 0.0, 0.0)
    return _describe_row(fitted.workspace, row, moved, "mm")


def find_worst_turn(fitted: Fitted) -> Worst:
    """Find where in the workspace an effect turns the target most."""
    row = fitted.find_worst_turn()
    turned = fitted.turned_at(row).scale(MILLI)
    if turned.value < MIN_TURN:
        turned = Range(0.0, 0.0, 0.0)
    return _describe_row(fitted.workspace, row, turned, "mrad")


def _describe_row(workspace: Workspace, row: int, moved: Range, unit: str) -> Worst:
    readings = workspace.q[row]
    beyond = workspace.find_unmeasured(row)
    prismatic = workspace.problem.robot.prismatic
    shown = []
    for reading, slides in zip(readings, prismatic, strict=True):
        value = reading if slides else np.degrees(reading)
        shown.append(float(value) + 0.0)
    return Worst(moved, tuple(shown), prismatic, beyond, unit=unit)


# -- from figures to records
# --------------------------------------------------------------------------------------------------


def describe_figures(figures: Figures) -> Values:
    """Return what result.json has of one finding's figures; `turning` where orientations were
    measured."""
    values = {
        "matters": figures.matters,
        "rms_mm": figures.rms_mm,
        "worst": figures.worst.describe(),
        "usable": [asdict(one) for one in figures.usable],
    }
    if figures.turning is not None:
        values["turning"] = figures.turning.describe()
    return values


def describe_small(named: Sequence[Named], figures: FindingFigures) -> Values | None:
    """Return result.json's `small_findings`; None where every finding matters. `named`: faults of the
    data first, then the findings."""
    effects = named[len(named) - len(figures.each) :]
    sizes = [(one, of) for one, of in zip(effects, figures.each, strict=True) if not of.matters]
    if not sizes:
        return None
    values = {"count": len(sizes), "rms_mm": figures.small_rms_mm}
    if figures.small_rms_mrad is not None:
        values["rms_mrad"] = figures.small_rms_mrad
    return {**values, "sentence": _write_sizes(sizes, figures)}


def _write_sizes(sizes: Sequence[tuple[Named, Figures]], figures: FindingFigures) -> str:
    """Write the line of small findings with their rms, and what they are together."""
    together = figures.told_small_mrad
    parts = []
    for one, of in sizes:
        doubt = ""
        if one.doubtful:
            doubt = " (doubtful)"
        turned = None if together is None or of.turning is None else of.turning.rms_mrad
        parts.append(f"{one.name} {_write_size(of.rms_mm, turned)}{doubt}")
    listed = ", ".join(parts)
    if len(sizes) == 1:
        return f"One smaller error: {listed} rms."
    number = write_number(len(sizes))
    size = _write_size(figures.small_rms_mm, together)
    if together is not None:
        size += " of orientation"
    return f"{number} smaller errors, {size} rms together: {listed}."


def _write_size(mm: float, mrad: float | None) -> str:
    """Write how far the target is moved, and how far its orientation is turned where that is told."""
    if mrad is None or mrad < MIN_TURN:
        return format_length(mm)
    turned = format_angle(mrad * 1e-3)
    return turned if mm < MIN_DISPLACEMENT else f"{format_length(mm)} and {turned}"
