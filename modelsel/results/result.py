"""A finished study, as values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from .._json import to_plain
from ..config.study_file import Study
from ..diagnosis.data_faults import Fault
from ..diagnosis.error_map import ErrorMap
from ..diagnosis.outcome import Diagnosis
from ..diagnosis.procedure import Nested
from ..diagnosis.unexplained import Predictable
from ..fitting.noise import Floor
from ..fitting.undetermined import Unidentifiable
from ..notices import HOPELESS_FIT, Note
from ..robot.kinematics import Robot
from ..selection.comparison import SubsetComparison
from ..selection.evaluation import Evaluation, Gain, Split, measure_orientation
from ..uncertainty.summary import Confidence
from .finding_records import Finding, fault_dict, finding_dict, screws_of
from .goodness_of_fit import Placed, features, lack_of_fit, noise_dict
from .placements import standing
from .record import candidates_dict, rung_dict
from .tables import Views
from .verdict import in_full, verdict

if TYPE_CHECKING:
    import pandas as pd

PARTS = ("x_mm", "y_mm", "z_mm", "rx_rad", "ry_rad", "rz_rad")


@dataclass(frozen=True, eq=False, repr=False)
class Result(Views):
    """A finished study: values for programs, `to_json` for the contract's file, `to_frame` for
    tables; in a notebook it shows itself."""

    study: Study
    robot: Robot
    data: Split
    floor: Floor
    ladder: tuple[Evaluation, ...]
    comparison: SubsetComparison | None
    chosen: Evaluation
    gain: Gain
    findings: tuple[Finding, ...]
    faults: tuple[Fault, ...]
    extension: Diagnosis = field(repr=False)
    error_map: ErrorMap = field(repr=False)
    nothing_else: tuple[str, float | None]
    predictable: Predictable | None
    nested: Nested | None
    unidentifiable: tuple[Unidentifiable, ...]
    warnings: tuple[Note, ...]
    confidence: Confidence
    provenance: Mapping[str, str] = field(repr=False)

    @property
    def features(self) -> tuple[Placed, ...]:
        """Where the chosen model has the features that rows share."""
        return features(self.data.problem, self.chosen.fit)

    @property
    def standing(self) -> dict[str, Any] | None:
        """Where registration found the base and the targets (`standing`); None where the study
        gives them."""
        return (
            standing(self.data.problem, self.study.robot.register_ == "per group")
            if self.study.robot.register_
            else None
        )

    @property
    def named(self) -> list[tuple[str, str]]:
        """(name, verdict) of every finding, faults of single rows first, as result.json lists
        them."""
        return [
            *((f.kind.label, "found") for f in self.faults),
            *((f.effect.candidate.label, f.effect.named.verdict) for f in self.findings),
        ]

    def to_dict(self) -> dict[str, Any]:
        """The contract's result."""
        data = self.data.problem.data
        estimation = self.data.estimation
        lack = lack_of_fit(self.chosen, self.floor, self.data)
        extending = (
            []
            if self.study.model.candidates == []
            else [e.candidate for e in self.extension.effects]
        )
        return {
            "schema": 1,
            "study": self.study.name,
            "robot": self.robot.name,
            "seed": self.study.seed,
            "provenance": dict(self.provenance),
            "verdict": list(
                in_full(
                    verdict(
                        self.ladder[0],
                        self.chosen,
                        self.gain,
                        self.floor,
                        self.named,
                        self.study.model.candidates,
                        self.nothing_else[0],
                    ),
                    measure_orientation(self.data, self.ladder[0], self.chosen),
                    next((w.sentence for w in self.warnings if w.code == HOPELESS_FIT), None),
                )
            ),
            "configurations": {
                "estimation": data.take(estimation).configurations,
                "held_out": data.take(~estimation).configurations,
                "estimation_rows": data.row[estimation],
            },
            "noise_floor": noise_dict(self.floor, data),
            **({} if self.standing is None else {"registration": self.standing}),
            **({} if data.gauges is None else {"features": [asdict(f) for f in self.features]}),
            "ladder": [rung_dict(r) for r in self.ladder],
            "candidates": candidates_dict(self.comparison),
            "findings": [
                *(fault_dict(f) for f in self.faults),
                *(finding_dict(f, self.data.problem.take(estimation)) for f in self.findings),
            ],
            "nothing_else": {
                "sentence": self.nothing_else[0],
                "detection_limit_mm": self.nothing_else[1],
                "predictable": None if self.predictable is None else asdict(self.predictable),
                "lack_of_fit": None if lack is None else asdict(lack),
            },
            "nested_cv": None
            if self.nested is None
            else {
                "folds": self.nested.folds,
                "geometric": asdict(self.nested.base),
                "chosen": asdict(self.nested.chosen),
                "named_in_folds": self.nested.named,
            },
            "chosen": {
                "mechanisms": [
                    *self.study.model.base,
                    *(c.mechanism.name for c in extending if c.registered),
                ],
                "cells": [
                    s
                    for c in extending
                    if not c.registered
                    for s in screws_of(c, self.data.problem.take(estimation))
                ],
            },
            "path": list(self.extension.path),
            "error_map": {
                "places": list(self.error_map.places),
                "causes": list(self.error_map.causes),
                "f": self.error_map.f,
                "p_family_wise": self.error_map.p,
            },
            "outliers": data.row[self.data.outlying],
            "unidentifiable": [
                {"sentence": u.sentence, "parameters": list(u.parameters)}
                for u in self.unidentifiable
            ],
            "warnings": [
                {"code": w.code, "sentence": w.sentence}
                for w in (*self.warnings, *self.confidence.notes)
            ],
            **self.confidence.to_dict(),
        }

    @cached_property
    def record(self) -> dict[str, Any]:
        """result.json's content."""
        out: dict[str, Any] = to_plain(self.to_dict())
        return out

    def residuals(self) -> pd.DataFrame:
        """Measured minus predicted, mm (and rad, where orientations were measured) in the tracker's
        frame, of the nominal, the base and the chosen model, indexed by the row of the file;
        whether a row estimates, and whether it is an outlier."""
        import pandas as pd

        columns = self.residual_columns()
        return pd.DataFrame(columns, index=pd.Index(columns.pop("row"), name="row"))

    def residual_columns(self) -> dict[str, NDArray[Any]]:
        """The same as arrays (m,) by name, the row of the file among them: pandas is not needed to
        write them."""
        data = self.data
        base = next(r for r in self.ladder if r.names == tuple(self.study.model.base))
        columns: dict[str, NDArray[Any]] = {
            "row": data.problem.data.row,
            "estimation": data.estimation,
            "outlier": data.outlying,
        }
        for name, rung in (("nominal", self.ladder[0]), ("base", base), ("chosen", self.chosen)):
            columns |= {
                f"{name}_{part}": rung.residual[:, k]
                for k, part in enumerate(PARTS[: rung.residual.shape[1]])
            }
        return columns
