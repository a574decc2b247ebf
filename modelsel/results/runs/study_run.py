"""Everything that a run of a study computes and only a run has: the problem, the fits, the draws."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...config.study_file import Study
from ...diagnosis.error_map import ErrorMap
from ...diagnosis.faults.data_faults import Fault
from ...diagnosis.findings.outcome import Diagnosis
from ...diagnosis.procedure import Nested
from ...diagnosis.unexplained import DetectionLimit, Predictable
from ...exceptions import count_words
from ...fitting.noise import Floor
from ...fitting.problem import Problem
from ...fitting.undetermined import Unidentifiable
from ...notices import Note
from ...robot.kinematics import Robot
from ...selection.comparison import SubsetComparison
from ...selection.evaluation import Evaluation, Split
from ...selection.gain import Gain
from ...uncertainty.summary import Confidence
from .finding_records import Finding

PARTS = ("x_mm", "y_mm", "z_mm", "rx_rad", "ry_rad", "rz_rad")


@dataclass(frozen=True, eq=False)
class ModelSearch:
    """The models that were compared: the ladder from the nominal to the chosen one, the table of subsets (None: no
    candidates), the gain of the chosen over the nominal model on held-out rows, the procedure repeated in folds
    (None: not asked), and what the data do not determine of the chosen model."""

    ladder: tuple[Evaluation, ...]
    comparison: SubsetComparison | None
    chosen: Evaluation
    gain: Gain
    nested: Nested | None
    unidentifiable: tuple[Unidentifiable, ...]

    def __repr__(self) -> str:
        count = len(self.ladder)
        models = count_words(count, "model")
        chosen = repr(self.chosen)
        return f"Ladder of {models}. Chosen: {chosen}"


@dataclass(frozen=True, eq=False)
class Explanation:
    """What is wrong with the arm: findings, faults of the data, the stepwise `search` that named them, the map of
    all cells, what else could have been found, whether anything smooth predicts what is left, which
    `candidates` of the study could be tested ("all": every one), and the `mistake` of the set-up for which no cause
    was sought (None: causes were)."""

    findings: tuple[Finding, ...]
    faults: tuple[Fault, ...]
    search: Diagnosis
    error_map: ErrorMap
    nothing_else: DetectionLimit
    predictable: Predictable | None
    candidates: Sequence[str] | str = "all"
    mistake: Note | None = None

    def __repr__(self) -> str:
        found = len(self.findings)
        faulty = len(self.faults)
        findings = count_words(found, "finding")
        faults = count_words(faulty, "fault")
        return f"Explanation: {findings}, {faults} of the data"


@dataclass(frozen=True, eq=False)
class StudyRun:
    """A finished run of a study."""

    study: Study
    robot: Robot
    split: Split
    floor: Floor
    models: ModelSearch
    diagnosis: Explanation
    uncertainty: Confidence
    warnings: tuple[Note, ...]
    provenance: Mapping[str, str]

    def __repr__(self) -> str:
        found = self.diagnosis.findings
        count = len(found)
        findings = count_words(count, "finding")
        study = self.study.name
        quoted = repr(study)
        robot = self.robot.name
        return f"Run of {quoted}: {robot}, {findings}"

    @property
    def problem(self) -> Problem:
        """The robot with its measurements, registered and weighed."""
        return self.split.problem

    @property
    def base(self) -> Evaluation:
        """The base model, one rung of the ladder."""
        names = tuple(self.study.model.base)
        return next(rung for rung in self.models.ladder if rung.names == names)

    @property
    def extends(self) -> bool:
        """Whether findings may join the model: `candidates = []` says them and extends nothing."""
        return self.study.model.candidates != []

    def residual_columns(self) -> dict[str, NDArray[np.generic]]:
        """Return measured minus predicted, (m,) columns by name: mm (and rad, where orientations were measured) in
        the tracker's frame, of the nominal, the base and the chosen model; the row of the file, whether it
        estimates, and whether the errors leave it out, as an outlier (`outlier`) or as on an unknown side of a
        step (`side_open`)."""
        split = self.split
        columns: dict[str, NDArray[np.generic]] = {
            "row": self.problem.data.row,
            "estimation": split.estimation,
            "outlier": split.outliers,
            "side_open": split.outlying & ~split.outliers,
        }
        models = {"nominal": self.models.ladder[0], "base": self.base, "chosen": self.models.chosen}
        for name, model in models.items():
            parts = PARTS[: model.residual.shape[1]]
            columns |= {f"{name}_{part}": model.residual[:, k] for k, part in enumerate(parts)}
        return columns
