"""A stored calibration: the nominal robot, the set-up and every fitted screw, so that the exact
chain comes back from a file.

    x = P · (N_1 H_1 T_1) … (N_n H_n T_n) · Last · Trans(tool) · H_{n+1}          (robot.py)

with H_k the sum of the stored terms at their estimates. Numbers are written in full: what is read
back predicts as the study did."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .._arguments import check_path, check_type
from .._typing import Array
from ..exceptions import DataError, write_rounded
from ..fitting.design import Model
from ..fitting.least_squares import Fit
from ..fitting.noise import Floor
from ..fitting.problem import Problem
from ..measurements.campaign.late_names import list_sources
from ..measurements.formats.file_form import FileForm
from ..measurements.measurements import Measurements
from ..mechanisms.causes import Member
from ..mechanisms.step_moments import list_step_moments
from ..mechanisms.terms import Term
from ..robot.kinematics import Robot
from ..selection.evaluation import Split
from .assumed_values import add_assumed
from .estimation_rows import EstimationRows
from .known_names import LABEL_NAMES, check_groups, check_targets, match_names, refuse_without
from .other_sides import OtherSide
from .refitting import Refits, part_of

if TYPE_CHECKING:
    import pandas as pd

    from ..measurements.formats.table import Source
    from .export.form import Exported

FACTOR_DIGITS = 10  # of the covariance factor; everything else is written in full


@dataclass(frozen=True, eq=False, repr=False)
class Calibration:
    """A calibrated robot: predicts positions, corrects commands, exports itself.

    Attributes, the arm:
        study: name of the study that it comes from.
        robot: the nominal robot.
        model: the fitted mechanisms.
        theta: (p,) estimates of the model's terms, in their units.
        factor: (p, r) with covariance of theta = factor factorᵀ.
        kept: places of the terms that were fitted; the others are fixed.
        refits: fits for the forms that cannot carry all terms; None in files of earlier versions.

    The set-up:
        targets: names of the targets.
        groups: names of the groups of measurements.
        tools: (T, 3) nominal targets in the flange frame [mm].
        tool_rotations: (T, 3, 3) their orientations, None without.
        placement: R (G, 3, 3) and t (G, 3) [mm] of frame 0 in the tracker's frame.
        registered: whether the placement was found from the data.
        tracker: position of the tracker in its own frame [mm].

    How good it is, and where:
        floor: noise of one measured coordinate.
        held_out_rms_mm: rms length of the held-out residuals, None without.
        held_out_model_mm: the model's own standard uncertainty in them (rms length), None where it is
            not known.
        ranges: least and largest value in estimation of every joint reading, covariate and value
            that the model's causes use.
        held_out_ranges: the same of all rows, where a held-out row lies beyond.
        provenance: versions and digests of what it was made from.
        form: how the study reads its measurements file.
        doubtful: names of the mechanisms with which the held-out error does not fall.
        estimation_rows: the measurements that it was estimated from, to know them again.
        other_sides: what of the arm may be the instrument's and the reverse, by mechanism.
    """

    study: str
    robot: Robot
    targets: tuple[str, ...]
    groups: tuple[str, ...]
    tools: Array  # (T, 3) mm
    tool_rotations: Array | None  # (T, 3, 3)
    placement: tuple[Array, Array]  # R (G, 3, 3), t (G, 3) mm: frame 0 in the tracker's frame
    registered: bool
    tracker: tuple[float, float, float]
    model: Model
    theta: Array
    factor: Array
    kept: tuple[int, ...]
    floor: Floor
    held_out_rms_mm: float | None
    ranges: Mapping[str, tuple[float, float]]
    provenance: Mapping[str, str]
    refits: Refits | None = None
    form: FileForm = field(default_factory=FileForm)
    doubtful: tuple[str, ...] = ()
    held_out_ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    estimation_rows: EstimationRows = field(default_factory=EstimationRows)
    held_out_model_mm: float | None = None
    other_sides: Mapping[str, OtherSide] = field(default_factory=dict)

    @property
    def terms(self) -> tuple[Term, ...]:
        """The fitted terms, in the order of theta."""
        return self.model.terms

    @property
    def standard_errors(self) -> Array:
        """Standard errors (p,) of theta; zero where a term is fixed."""
        squares = np.square(self.factor)
        variances = squares.sum(1)
        errors = np.sqrt(variances)
        return np.asarray(errors)

    def needs(self) -> frozenset[str]:
        """Return the names of the state that the model's causes use."""
        names = set[str]()
        for mechanism in self.model.mechanisms:
            names |= mechanism.names()
        return list_sources(names)

    def predict(self, measurements: Measurements | Source | Array | Sequence[Any]) -> Array:
        """Predict where the calibrated robot has the target at measured or planned configurations:
        measurements, a file or DataFrame of readings, or joint readings (m, n) [rad, mm] as an array
        or a list of lists.

        Returns positions (m, 3) [mm] in the tracker's frame. Raises DataError where a target, a
        group or a covariate is not known.
        """
        from .commands.compensation import read_planned
        from .prediction import predict

        if not isinstance(measurements, Measurements):
            measurements = read_planned(self, measurements)
        problem = self.problem(measurements)
        return predict(self, problem)

    def correct(
        self, targets: Source | Array | Sequence[Any], *, bound: tuple[float, float] | None = None
    ) -> pd.DataFrame:
        """Correct planned commands, so that the real target is where the nominal one should be.

        `targets` are joint readings (m, n) [rad, mm], or a file or DataFrame with columns q1_rad …,
        wanted positions x_mm y_mm z_mm where they are not the nominal ones, and what the model
        needs.

        Returns a row a command: the corrected readings in the columns and units of the targets'
        own, the wanted x_mm y_mm z_mm (with an orientation, where one is wanted) in the tracker's
        frame, the target, and what the model needs; then, in mm, `error_before_mm` of the nominal
        command, `error_left_mm` on the calibrated model, `model_uncertainty_mm` there, and
        `expected_error_mm` of all, with noise; of orientations `orientation_before_mrad`,
        `orientation_left_mrad` and `orientation_uncertainty_mrad`.

        `bound` (rad, mm) is the largest change of a joint that is not taken for a mistake, by default
        0.01 rad and 20 mm. What is noted is warned of, and stands in the table's attrs["notes"].
        Raises DataError beyond the bound and for what cannot be read, StudyError for a bound that is
        not two positive numbers.
        """
        from .commands.compensation import ARRAYS, MAX_CORRECTION, correct, tabulate_readings

        if isinstance(targets, ARRAYS):
            targets = tabulate_readings(self, targets)
        if bound is None:
            bound = MAX_CORRECTION
        return correct(self, targets, bound=bound)

    def export(self, form: str, *, urdf: Path | str | None = None) -> Exported:
        """Export to "urdf", "dh", "mdh", "hayati", "ur-calibration", "json", "csv", "python",
        "table" or "grid".

        As "urdf", the file that the robot was read from, or the one given, comes back with other
        origins; a robot without one gets a new file. The result holds the text, its largest error
        when read back, and what the form leaves out. Raises StudyError for another form, or where a
        name cannot be written.
        """
        from .export import attach_urdf, export

        calibration = self
        if urdf is not None:
            path = check_path(urdf, "the path of a URDF file")
            calibration = attach_urdf(self, path)
        return export(calibration, form)

    def save(self, folder: Path | str) -> Path:
        """Write calibration.json into a folder and return its path; `load_calibration` reads it.
        Raises StudyError where it cannot be written."""
        from .calibration_file import save_calibration

        return save_calibration(self, folder)

    def problem(self, data: Measurements, *, another_day: bool = True) -> Problem:
        """Bind measurements to the calibrated set-up.

        On `another_day` what stepped in the fitted campaign is taken as it stood at its end, and a
        drift at the middle of what followed the last step. A covariate that
        doubtful findings alone look at may be missing (`assumed_values`). Raises DataError where a
        target, a group or another covariate is not known.
        """
        check_type("data", data, Measurements, "Measurements, as read_measurements returns them")
        if data.gauges is not None:
            raise DataError(
                "some rows are not points, and a calibration is compared with points only.",
                remedy="Leave out the rows of other kinds, or make a study of the file.",
            )
        check_targets(data, self.targets)
        if self.groups_differ():
            check_groups(data, self.groups)
        bound_data = replace(
            data,
            target=match_names(data.target, data.targets, self.targets),
            targets=self.targets,
            group=match_names(data.group, data.groups, self.groups),
            groups=self.groups,
            progress=np.full(len(data), self.after_steps) if another_day else data.progress,
        )
        rotations = None if data.rotation is None else self._rotations()
        problem = Problem(
            self.robot, bound_data, self.tools, self.placement, rotations, tracker=self.tracker
        )
        missing = sorted(self.needs() - problem.names().keys())
        if not missing:
            return problem
        completed = add_assumed(self, bound_data, missing)
        if completed is bound_data:
            raise refuse_without(data, missing)
        return replace(problem, data=completed)

    @property
    def after_steps(self) -> float:
        """The middle of what follows the last step of the campaign, 0.5 where nothing stepped."""
        last = max(list_step_moments(self.terms), default=0.0)
        return (last + 1) / 2

    def groups_differ(self) -> bool:
        """Whether the calibration knows its groups apart: by placement, or by a term of one."""
        for term in self.terms:
            for screw in term.screws:
                cause = screw.cause
                if isinstance(cause, Member) and cause.kind == "group":
                    return True
        translations = self.placement[1]
        extents = np.ptp(translations, axis=0)
        largest = extents.max(initial=0.0)
        return bool(largest > 0)

    def _rotations(self) -> Array:
        """Return the targets' orientations (T, 3, 3), the flange's where they have none."""
        if self.tool_rotations is not None:
            return self.tool_rotations
        identity = np.eye(3)
        count = len(self.tools)
        return np.tile(identity, (count, 1, 1))

    def to_frame(self) -> pd.DataFrame:
        """Tabulate the terms: mechanism, symbol, screws, estimate, standard error, unit, and
        whether the data determine it."""
        import pandas as pd

        owner = {t.key: m.name for m in reversed(self.model.mechanisms) for t in m.terms}
        return pd.DataFrame(
            {
                "mechanism": [owner[t.key] for t in self.terms],
                "symbol": [t.symbol for t in self.terms],
                "screws": ["; ".join(map(str, t.screws)) for t in self.terms],
                "estimate": self.theta,
                "standard_error": self.standard_errors,
                "unit": [t.unit for t in self.terms],
                "estimable": [k in self.kept for k in range(len(self.terms))],
            }
        )

    def __repr__(self) -> str:
        return (
            f"Calibration of {self.study!r}: {self.robot.name}, {len(self.kept)} fitted terms, noise floor "
            f"{write_rounded(self.floor.coordinate_mm)} mm"
        )

    def _repr_html_(self) -> str:
        """A heading and the table of terms, for a notebook."""
        from html import escape

        return f"<p>{escape(repr(self))}</p>{self.to_frame().to_html(index=False, max_rows=60)}"


def calibrate(
    study: str,
    split: Split,
    fitted: Fit,
    floor: Floor,
    held_out_rms_mm: float | None,
    registered: bool,
    provenance: Mapping[str, str],
) -> Calibration:
    """Return the calibration of a model fitted to a study's rows, without refits: features of the
    set-up are no part of it."""
    problem = split.problem
    of_arm = [k for k, term in enumerate(fitted.terms) if not term.fixture]
    ranges = _find_ranges(split.training, fitted.model)
    all_ranges = _find_ranges(problem, fitted.model)
    kept = tuple(place for place, k in enumerate(of_arm) if k in fitted.found.kept)
    factor = _round_factor(fitted)
    if len(of_arm) < len(fitted.terms):
        factor = _triangularise(factor[of_arm], kept)
    return Calibration(
        study=study,
        robot=problem.robot,
        targets=problem.data.targets,
        groups=problem.data.groups,
        tools=problem.tools,
        tool_rotations=problem.tool_rotations,
        placement=problem.placement,
        registered=registered,
        tracker=problem.tracker,
        model=_remove_fixtures(fitted.model),
        theta=fitted.theta[of_arm],
        factor=factor,
        kept=kept,
        floor=floor,
        held_out_rms_mm=held_out_rms_mm,
        ranges=ranges,
        provenance=dict(provenance),
        held_out_ranges={k: both for k, both in all_ranges.items() if both != ranges[k]},
        estimation_rows=EstimationRows.of(split.training.data.position),
    )


def _find_ranges(at: Problem, model: Model) -> dict[str, tuple[float, float]]:
    """Return the least and largest value of every joint reading, covariate and name in a cause."""
    names = set[str]()
    for mechanism in model.mechanisms:
        names |= mechanism.names()
    names -= LABEL_NAMES
    names.update(at.data.covariates)
    for joint in range(1, at.robot.n + 1):
        names.add(f"q{joint}")
    ranges = {}
    for name in sorted(names):
        values = at.value(name)
        least = float(values.min())
        largest = float(values.max())
        ranges[name] = (least, largest)
    return ranges


def _round_factor(fitted: Fit) -> Array:
    """Return the factor of the covariance to FACTOR_DIGITS digits."""
    scale = 1.0
    if np.isfinite(fitted.sigma):
        scale = fitted.sigma
    factor = fitted.factor * scale
    rounded = np.empty_like(factor)
    for place, entry in np.ndenumerate(factor):
        digits = f"{entry:.{FACTOR_DIGITS}g}"
        rounded[place] = float(digits)
    return rounded


def _remove_fixtures(model: Model) -> Model:
    """Return a model without the terms that move features of the set-up."""
    fixtures = [term for term in model.terms if term.fixture]
    if not fixtures:
        return model

    def is_of_arm(term: Term) -> bool:
        return not term.fixture

    return part_of(model, is_of_arm)


def _triangularise(factor: Array, kept: tuple[int, ...]) -> Array:
    """Return a factor (p, len(kept)) of the same covariance whose kept rows are zero before their
    own column, as the file has it."""
    estimable = list(kept)
    rows = factor[estimable]
    upper = np.linalg.qr(rows[::-1].T)[1]
    lower = upper.T
    triangular = np.zeros((len(factor), len(kept)))
    triangular[estimable] = lower[::-1, ::-1]
    return triangular
