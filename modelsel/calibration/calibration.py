"""A stored calibration: the nominal robot, the set-up and every fitted screw, so that the exact
chain comes back from a file.

    x = P · (N_1 H_1 T_1) … (N_n H_n T_n) · Last · Trans(tool) · H_{n+1}          (robot.py)

with H_k the sum of the stored terms at their estimates. Numbers are written in full: what is read
back predicts as the study did."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from .._typing import Array, Index
from ..exceptions import DataError, suggest
from ..fitting.design import Model, compute_columns, field_of, twist_of
from ..fitting.least_squares import Fit
from ..fitting.noise import Floor
from ..fitting.problem import Problem
from ..measurements.measurements import Measurements
from ..mechanisms.causes import Member
from ..mechanisms.terms import Term
from ..robot.kinematics import Pose, Robot
from ..selection.evaluation import Split
from .refitting import Refits, part_of

if TYPE_CHECKING:
    import pandas as pd
DIGITS = 10  # of the covariance factor; everything else is written in full
MIDDLE = 0.5  # of the campaign: where a drift is taken on data of another day


@dataclass(frozen=True, eq=False, repr=False)
class Calibration:
    """A calibrated robot. theta (p,) in the terms' units; covariance = factor factorᵀ, factor (p,
    r); `kept` the fitted terms; `ranges` of every joint reading, covariate and value that the
    model's causes looked at in estimation; `refits` for the forms that carry less than all (None
    where there are none, as in files of earlier versions)."""

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

    @property
    def terms(self) -> tuple[Term, ...]:
        """The fitted terms, in the order of theta."""
        return self.model.terms

    @property
    def standard_errors(self) -> Array:
        """(p,) zero where a term is fixed."""
        return np.asarray(np.sqrt(np.square(self.factor).sum(1)))

    def needs(self) -> frozenset[str]:
        """Names that the model's causes look at."""
        return frozenset[str]().union(*(m.names() for m in self.model.mechanisms))

    def problem(self, data: Measurements, *, another_day: bool = True) -> Problem:
        """These data bound to the calibrated set-up. On `another_day` drift stands at the middle of
        the campaign that was fitted. Raises DataError where a target, a group or a covariate is not
        known."""
        if data.gauges is not None:
            raise DataError(
                "the file has rows that are no points, and a calibration is held against points alone.",
                remedy="Leave out the rows of other kinds, or make a study of the file.",
            )
        target = _matched(data.target, data.targets, self.targets, "target", len(self.targets) > 1)
        many = any(
            isinstance(s.cause, Member) and s.cause.kind == "group"
            for t in self.terms
            for s in t.screws
        )
        group = _matched(
            data.group,
            data.groups,
            self.groups,
            "group",
            many or float(np.ptp(self.placement[1], axis=0).max(initial=0.0)) > 0,
        )
        progress = np.full(len(data), MIDDLE) if another_day else data.progress
        here = replace(
            data,
            target=target,
            targets=self.targets,
            group=group,
            groups=self.groups,
            progress=progress,
        )
        bound = Problem(
            self.robot,
            here,
            self.tools,
            self.placement,
            None if data.rotation is None else self._rotations(),
            tracker=self.tracker,
        )
        missing = sorted(self.needs() - bound.names().keys())
        if missing:
            raise DataError(
                f"the calibrated model needs {', '.join(missing)}, which the file does not have.",
                remedy="Add a column for each.",
            )
        return bound

    def _rotations(self) -> Array:
        return (
            np.tile(np.eye(3), (len(self.tools), 1, 1))
            if self.tool_rotations is None
            else self.tool_rotations
        )

    def to_frame(self) -> pd.DataFrame:
        """A row a term: mechanism, symbol, where and why, estimate, standard error, unit, whether
        the data determine it."""
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
            f"{self.floor.coordinate_mm:.3g} mm"
        )

    def _repr_html_(self) -> str:
        """A heading and the table of terms, for a notebook."""
        from html import escape

        return f"<p>{escape(repr(self))}</p>{self.to_frame().to_html(index=False, max_rows=60)}"


def _matched(
    index: Index, names: tuple[str, ...], known: tuple[str, ...], what: str, told: bool
) -> Index:
    """Rows' indices among the `known` names; where all of these are alike (not `told` apart),
    unknown names are the first."""
    place = {name: k for k, name in enumerate(known)}
    for name in names:
        if name not in place and told:
            raise DataError(
                f'{what} "{name}" was not calibrated. {suggest(name, known)}',
                remedy="Use a calibrated one, or validate with --register where the set-up is new.",
            )
    return np.array([place.get(name, 0) for name in names], dtype=np.intp)[index]


def calibrate(
    study: str,
    split: Split,
    fitted: Fit,
    floor: Floor,
    held_out_rms_mm: float | None,
    registered: bool,
    provenance: Mapping[str, str],
) -> Calibration:
    """The calibration of a model fitted to the rows of a study that fit; its refits are another's
    to add."""
    problem, some = split.problem, split.training()
    names = {f"q{j}" for j in range(1, problem.robot.n + 1)} | set(problem.data.covariates)
    names |= {n for m in fitted.model.mechanisms for n in m.names()} - {
        "target",
        "group",
    }
    ranges = {
        name: (float(some.value(name).min()), float(some.value(name).max()))
        for name in sorted(names)
    }
    whole = fitted.factor * (fitted.sigma if np.isfinite(fitted.sigma) else 1.0)
    factor = np.array([float(f"{v:.{DIGITS}g}") for v in whole.ravel()]).reshape(whole.shape)
    of_arm = [
        k for k, t in enumerate(fitted.terms) if not t.fixture
    ]  # anchors and planes are no part of it
    kept = tuple(i for i, k in enumerate(of_arm) if k in fitted.found.kept)
    if len(of_arm) < len(fitted.terms):
        factor = _triangle(factor[of_arm], kept)
    return Calibration(
        study,
        problem.robot,
        problem.data.targets,
        problem.data.groups,
        problem.tools,
        problem.tool_rotations,
        problem.placement,
        registered,
        problem.tracker,
        _arm(fitted.model),
        fitted.theta[of_arm],
        factor,
        kept,
        floor,
        held_out_rms_mm,
        ranges,
        dict(provenance),
    )


def _arm(model: Model) -> Model:
    """Without the terms that move features of the set-up."""
    return (
        model
        if not any(t.fixture for t in model.terms)
        else part_of(model, lambda t: not t.fixture)
    )


def _triangle(factor: Array, kept: tuple[int, ...]) -> Array:
    """(p, len(kept)) factor of the same covariance, a row of the kept ones nought before its own
    column, as the file has it."""
    out = np.zeros((len(factor), len(kept)))
    some = factor[list(kept)]
    out[list(kept)] = np.linalg.qr(some[::-1].T)[1].T[::-1, ::-1]
    return out


def pose_of(problem: Problem, terms: tuple[Term, ...], theta: Array) -> Pose:
    """The exact chain of all rows at parameters theta, in frame 0."""
    rows = slice(0, len(problem))
    return problem.pose(rows, twist_of(problem, terms, theta, rows))


def in_tracker(problem: Problem, points: Array) -> Array:
    """Points (m, 3) of frame 0 in the tracker's frame."""
    R, t = problem.placement[0][problem.data.group], problem.placement[1][problem.data.group]
    return np.asarray(np.einsum("mij,mj->mi", R, points) + t)


def predict(calibration: Calibration, problem: Problem) -> Array:
    """(m, 3) mm: where the calibrated robot has the target, in the tracker's frame."""
    return in_tracker(problem, pose_of(problem, calibration.terms, calibration.theta).target.T)


def uncertainty(calibration: Calibration, problem: Problem) -> Array:
    """(m, 3, r) mm: columns whose products summed are the covariance of the predicted positions,
    noise left out."""
    out = np.empty((len(problem), 3, calibration.factor.shape[1]))
    for rows in problem.blocks(512):
        at = problem.pose(rows, twist_of(problem, calibration.terms, calibration.theta, rows))
        columns = compute_columns(problem, field_of(problem, at, rows), calibration.terms, rows)[
            :, :3
        ]
        out[rows] = np.einsum("pcm,pr->mcr", columns, calibration.factor)
    return out
