"""The records of models: the ladder, the table of subsets, the repeated procedure, and how sure the chosen model's
parameters are."""

from __future__ import annotations

from ..._records import Number, StrictRecord, Text, Whole
from ...exceptions import write_numbered
from .record_types import Figure, Texts


class ErrorsRecord(StrictRecord):
    """Errors of one model on one side of the split [mm]: lengths of the residual vectors."""

    mean_mm: Figure
    rms_mm: Figure
    p95_mm: Figure
    max_mm: Figure
    rows: Whole
    left_out: Whole
    mean_all_mm: Figure


class RungRecord(StrictRecord):
    """One model of the ladder."""

    mechanisms: Texts
    parameters: Whole
    rank: Whole
    estimation: ErrorsRecord
    held_out: ErrorsRecord
    cv_rms_mm: Figure
    cv_mean_mm: Figure
    aicc: Figure
    bic: Figure
    aic: Figure
    gcv: Figure
    ebic: Figure
    log_predictive_density: Figure

    def side(self, name: str) -> ErrorsRecord:
        """Return the errors of a side of the split, "estimation" or "held_out"."""
        return self.held_out if name == "held_out" else self.estimation


class SubsetRecord(RungRecord):
    """One model of the table of subsets."""

    weight: Figure
    note: Text


class SearchRecord(StrictRecord):
    """Branch and bound over all subsets of the candidates."""

    mechanisms: Whole
    criterion: Text
    nodes: Whole
    proven: bool
    may_be_beaten_by: Figure
    best: Texts


class CandidatesRecord(StrictRecord):
    """The table of subsets."""

    compared: Whole
    choice: Texts | None
    considered: Texts
    set_aside: Texts
    search: SearchRecord | None = None
    best: list[SubsetRecord]


class WeighedModelRecord(StrictRecord):
    """A set of effects that the search weighed."""

    effects: Texts
    probability: Number
    chosen: bool


class NestedRecord(StrictRecord):
    """The whole procedure repeated in every fold; `geometric`: errors of the base."""

    folds: Whole
    geometric: ErrorsRecord
    chosen: ErrorsRecord
    named_in_folds: dict[Text, Whole]


# -- uncertainty
# ------------------------------------------------------------------------------------------------------------------


class QuantilesRecord(StrictRecord):
    """Quantiles of one sampled parameter, next to those of the closed form."""

    name: Text
    unit: Text
    low: Figure
    median: Figure
    high: Figure
    closed_form_low: Figure
    closed_form_median: Figure
    closed_form_high: Figure


class ImportanceRecord(StrictRecord):
    """How good the closed form of the posterior is: effective number of weighted draws."""

    draws: Whole
    effective: Figure
    sentence: Text


class TraceRecord(StrictRecord):
    """Draws of the most informative parameters."""

    names: Texts
    draws: list[list[Number]]


class SamplingRecord(StrictRecord):
    """Result of the sampler, and whether its chain converged."""

    effective_samples: Figure
    r_hat: Figure
    tau: Figure
    converged: bool
    acceptance: Figure = None
    steps: Whole
    walkers: Whole
    sampled: Texts | None = None
    sentence: Text
    quantiles: list[QuantilesRecord]
    importance: ImportanceRecord | None = None
    trace: TraceRecord


class ParameterRecord(StrictRecord):
    """One parameter of the chosen model."""

    symbol: Text
    mechanism: Text
    unit: Text
    estimate: Number
    standard_error: Figure
    bootstrap_error: Figure
    posterior_error: Figure
    low: Figure
    high: Figure
    mean_mm: Figure
    max_mm: Figure
    configurations: Figure
    differ: bool
    max_mrad: Figure = None


class CorrelatedRecord(StrictRecord):
    """Two strongly correlated parameters, which the data determine only together."""

    a: Text
    b: Text
    r: Number
    sentence: Text


class CorrelationRecord(StrictRecord):
    """Correlation of the estimates."""

    symbols: Texts
    matrix: list[list[Figure]]
    pairs: list[CorrelatedRecord]
    clusters: list[Texts]


class SignificanceRecord(StrictRecord):
    """Significance of one mechanism of the chosen model."""

    mechanism: Text
    parameters: Texts
    mean_mm: Figure
    max_mm: Figure
    f: Figure
    p: Figure
    log10_evidence: Figure
    cv_rms_mm: Figure
    cv_rms_without_mm: Figure
    held_out_rms_mm: Figure
    held_out_rms_without_mm: Figure
    catalogue: Text
    stability: Figure
    number: Whole | None = None
    mean_mrad: Figure = None
    max_mrad: Figure = None

    @property
    def label(self) -> str:
        """The mechanism's name, numbered where others of the model have it, too."""
        name = self.mechanism
        number = self.number
        return write_numbered(name, number)
