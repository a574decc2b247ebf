"""The records that a study writes: `StudyRecord` is result.json, `DetailsRecord` details.json.

Strict models: what is read back has every key, each of its type, and only finite numbers. Undefined figures are
null; an optional key may be absent. Keys that a record does not know are left alone."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    model_validator,
)
from pydantic_core import PydanticCustomError

from .._json import BIGGEST
from .._names import unseen

LARGEST_WHOLE = 10**100
FAULT = "fault:"  # begins the name of a data fault


def _check_visible(text: str) -> str:
    if unseen(text) is not None:
        raise PydanticCustomError("unseen", "holds a character that nobody sees")
    return text


Number = Annotated[float, Field(ge=-BIGGEST, le=BIGGEST)]
Figure = Number | None
Whole = Annotated[int, Field(ge=-LARGEST_WHOLE, le=LARGEST_WHOLE)]
Text = Annotated[str, AfterValidator(_check_visible)]
Texts = list[Text]
Pair = Annotated[list[Number], Field(min_length=2, max_length=2)]
Vector = Annotated[list[Number], Field(min_length=3, max_length=3)]
Axis = Literal["tx", "ty", "tz", "rx", "ry", "rz"]


class StrictRecord(BaseModel):
    """A table of a file, read strictly."""

    model_config = ConfigDict(strict=True, frozen=True, extra="ignore", populate_by_name=True)

    @model_validator(mode="before")
    @classmethod
    def _check_keys(cls, value: Any) -> Any:
        hidden = [key for key in value if unseen(key)] if isinstance(value, dict) else []
        if hidden:
            raise PydanticCustomError("unseen_key", "{key}", {"key": hidden[0]})
        return value

    def to_dict(self) -> dict[str, Any]:
        """Return the table as plain values, without the optional keys that it does not have."""
        return self.model_dump(by_alias=True, exclude_unset=True)


# -- result.json: models
# --------------------------------------------------------------------------------------------------------


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


class NestedRecord(StrictRecord):
    """The whole procedure repeated in every fold."""

    folds: Whole
    geometric: ErrorsRecord
    chosen: ErrorsRecord
    named_in_folds: dict[Text, Whole]


# -- result.json: findings
# ------------------------------------------------------------------------------------------------------


class ScrewRecord(StrictRecord):
    """A place and a cause; with derived causes also the cause at every estimation row."""

    frame: Whole
    axis: Axis
    cause: Text
    values: list[Figure] | None = None

    @property
    def place(self) -> str:
        """The frame and the axis."""
        return f"frame {self.frame} {self.axis}"

    @property
    def is_free(self) -> bool:
        """Whether the cause is a free function of a joint."""
        return self.cause.startswith("free(")


class EntryRecord(StrictRecord):
    """One explanation of a credible set."""

    mechanism: Text | None
    probability: Number
    screws: list[ScrewRecord]
    alike: bool

    @property
    def is_fault(self) -> bool:
        """Whether the explanation is a fault of the data."""
        return self.mechanism is not None and self.mechanism.startswith(FAULT)

    @property
    def causes(self) -> list[str]:
        """The causes, each once, in the screws' order."""
        return list(dict.fromkeys(screw.cause for screw in self.screws))

    @property
    def name(self) -> str:
        """The registered name, or the cell: frame 6 ty · q4."""
        if self.mechanism:
            return self.mechanism
        if not self.screws:
            return "an unnamed effect"
        first = self.screws[0]
        return first.cause if first.is_free else f"{first.place} · {' & '.join(self.causes)}"

    @property
    def cells(self) -> str:
        """Places and causes: frame 5 rz · q4."""
        return "; ".join(f"{screw.place} · {screw.cause}" for screw in self.screws)


class EstimateRecord(StrictRecord):
    """One fitted number of a finding."""

    symbol: Text
    value: Figure
    standard_error: Figure
    unit: Text


class GainRecord(StrictRecord):
    """What a finding changes on held-out configurations [mm]; a positive interval is less error."""

    held_out_rms_before_mm: Figure
    held_out_rms_after_mm: Figure
    interval_mm: Pair | None


class FindingRecord(StrictRecord):
    """One decision of the search."""

    sentence: Text = Field(description="for people")
    verdict: Text = Field(
        description="`found`, `cannot be told apart`, `below detection limit`",
    )
    p_value: Number = Field(description="family-wise over the whole scan; found at 0.05 or less")
    rows: list[Whole] | None = Field(
        None,
        description='of a data fault only (`"mechanism": "fault:<name>"`): the rows it concerns',
    )
    credible_set: Annotated[list[EntryRecord], Field(min_length=1)] = Field(
        description="most probable first, to 0.95 or 20 entries: `mechanism` (null for a cell of the map), "
        "`probability`, `alike` (moves the target as the first does), `screws` (`frame axis cause`, and `values` at "
        "every estimation row where the cause uses a derived name)",
    )
    more_entries: Whole = Field(description="how many are not listed")
    estimate: list[EstimateRecord] = Field(description="`symbol value standard_error unit`")
    gain: GainRecord = Field(
        description="`held_out_rms_before_mm held_out_rms_after_mm interval_mm`",
    )

    @property
    def first(self) -> EntryRecord:
        """The most probable explanation."""
        return self.credible_set[0]

    @property
    def is_found(self) -> bool:
        """Whether the data single out one name."""
        return self.verdict == "found"

    @property
    def alike(self) -> float:
        """How probable those explanations are, together, that move the target as the first does."""
        together = sum(entry.probability for entry in self.credible_set if entry.alike)
        return min(together, 1.0)


# -- result.json: uncertainty
# ---------------------------------------------------------------------------------------------------


class QuantilesRecord(StrictRecord):
    """Quantiles of one sampled parameter, beside those of the closed form."""

    name: Text
    unit: Text
    low: Figure
    median: Figure
    high: Figure
    closed_form_low: Figure
    closed_form_median: Figure
    closed_form_high: Figure


class ImportanceRecord(StrictRecord):
    """How good the closed form of the posterior is."""

    draws: Whole
    effective: Figure
    sentence: Text


class TraceRecord(StrictRecord):
    """Draws of the informative few parameters."""

    names: Texts
    draws: list[list[Number]]


class SamplingRecord(StrictRecord):
    """What the sampler drew, and whether its chain converged."""

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


class CorrelatedRecord(StrictRecord):
    """Two parameters that the data know only together."""

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
    """How much one mechanism of the chosen model matters."""

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


# -- result.json: the file
# ------------------------------------------------------------------------------------------------------


class ProvenanceRecord(StrictRecord):
    """Versions and hashes; no path, time or host."""

    modelsel: Text
    numpy: Text | None = None
    scipy: Text | None = None
    data_sha256: Text
    study_sha256: Text

    @property
    def run(self) -> tuple[str, str]:
        """What files of one run have in common: the hashes of the data and of the study."""
        return self.data_sha256, self.study_sha256


class ConfigurationsRecord(StrictRecord):
    """How the configurations are split."""

    estimation: Whole
    held_out: Whole
    estimation_rows: list[Whole]


class NoiseFloorRecord(StrictRecord):
    """Standard uncertainty of one coordinate [mm]."""

    coordinate_mm: Number
    source: Text
    mean_mm: Figure = None


class BaseRecord(StrictRecord):
    """Where registration found the robot's base, in the tracker's frame."""

    group: Text
    position_mm: Vector
    rpy_deg: Vector


class TargetRecord(StrictRecord):
    """Where registration found a target, in the flange frame."""

    target: Text
    position_mm: Vector


class RegistrationRecord(StrictRecord):
    """Where registration found the base and the targets."""

    base_in_tracker: list[BaseRecord]
    target_on_flange: list[TargetRecord]


class FeatureRecord(StrictRecord):
    """Where the chosen model has a feature that rows share, in the tracker's frame."""

    name: Text
    kind: Text
    position_mm: Vector
    normal: Vector | None
    length_mm: Figure
    fitted: Texts


class PredictableRecord(StrictRecord):
    """Whether a smooth function of the configuration could predict what is left."""

    share: Number
    p: Number


class LackOfFitRecord(StrictRecord):
    """The chosen model compared with a noise floor that is known without it."""

    f: Number
    p: Number
    floor_mm: Number
    unexplained_mm: Number
    low_mm: Number
    high_mm: Number


class NothingElseRecord(StrictRecord):
    """What a further effect would have had to be."""

    sentence: Text
    detection_limit_mm: Figure
    predictable: PredictableRecord | None
    lack_of_fit: LackOfFitRecord | None = None


class ChosenRecord(StrictRecord):
    """What the chosen model holds."""

    mechanisms: Texts
    cells: list[ScrewRecord]


class ErrorMapRecord(StrictRecord):
    """F and family-wise p of every place and cause alone, beyond the base."""

    places: Texts
    causes: Texts
    f: list[list[Figure]]
    p_family_wise: list[list[Figure]]


class UnidentifiableRecord(StrictRecord):
    """Parameters that the data determine only together."""

    sentence: Text
    parameters: Texts


class WarningRecord(StrictRecord):
    """Something the user should know."""

    code: Text
    sentence: Text


class StudyRecord(StrictRecord):
    """result.json."""

    version: Literal[1] = Field(alias="schema", description="1")
    study: Text = Field(description="the study's name")
    robot: Text = Field(description="the robot's name")
    seed: Whole = Field(description="every random choice derives from it")
    provenance: ProvenanceRecord = Field(
        description="`modelsel numpy scipy` versions, `data_sha256`, `study_sha256`",
    )
    verdict: Texts = Field(description="the sentences of the first page")
    configurations: ConfigurationsRecord = Field(
        description="`estimation`, `held_out`, `estimation_rows` (0-based rows of the file)",
    )
    noise_floor: NoiseFloorRecord = Field(
        description="`coordinate_mm`, `source`: stated, instrument, repeats, target pairs, estimated; with rows of "
        "other kinds than points also `mean_mm`, the mean length of a row's noise",
    )
    registration: RegistrationRecord | None = Field(
        None,
        description='with `register` alone: `base_in_tracker`, by group or once (`group` "all"): the nominal robot\'s '
        "frame 0 in the tracker's frame, `position_mm`, `rpy_deg` with "
        r"$R = R_z(\mathrm{yaw})\,R_y(\mathrm{pitch})\,R_x(\mathrm{roll})$; `target_on_flange`: `target`, "
        "`position_mm` in the flange frame",
    )
    features: list[FeatureRecord] | None = Field(
        None,
        description="with rows of other kinds than points alone: of each feature that has a place "
        "`name kind position_mm normal length_mm fitted`, in the tracker's frame",
    )
    ladder: Annotated[list[RungRecord], Field(min_length=1)] = Field(
        description="a list from the nominal to the chosen model: `mechanisms`, `parameters`, `rank`, `estimation` and "
        "`held_out` (each `mean_mm rms_mm p95_mm max_mm rows left_out mean_all_mm`), `cv_rms_mm cv_mean_mm aicc bic "
        "aic gcv ebic log_predictive_density`; with a stated noise floor AIC, AICc, BIC and EBIC are those of a known "
        "σ, in every row; EBIC (table of subsets) counts all groups that were scanned",
    )
    candidates: CandidatesRecord = Field(
        description="the table of subsets: `compared`, `choice` (one standard error), `considered`, `set_aside`, "
        "`best` (as the ladder, with `weight` and `note`); above sixteen mechanisms also `search` (`mechanisms "
        "criterion nodes proven may_be_beaten_by best`)",
    )
    findings: list[FindingRecord] = Field(description="a list, below")
    nothing_else: NothingElseRecord = Field(
        description="`sentence`, `detection_limit_mm` (rms displacement per row beyond the base), `predictable` "
        "(`share`, `p`: could a smooth function predict the rest); `lack_of_fit` (`f p floor_mm unexplained_mm low_mm "
        "high_mm`: the chosen model against a noise floor that is known without it; null where there is none)",
    )
    nested_cv: NestedRecord | None = Field(
        description="`folds`, `geometric`, `chosen` (errors), `named_in_folds` (name: folds); null where not asked",
    )
    chosen: ChosenRecord = Field(
        description="`mechanisms`, `cells` (screws without a registered name)"
    )
    path: Texts = Field(description="what the search did, step by step")
    error_map: ErrorMapRecord = Field(
        description="`places`, `causes`, `f` and `p_family_wise` of each cell beyond the base",
    )
    outliers: list[Whole] = Field(description="rows set aside, 0-based")
    unidentifiable: list[UnidentifiableRecord] = Field(description="`sentence`, `parameters`")
    warnings: list[WarningRecord] = Field(description="`code`, `sentence`")
    sampling: SamplingRecord | None = Field(
        description="`effective_samples r_hat tau converged acceptance steps walkers sampled sentence quantiles "
        "importance trace`; null where left out",
    )
    parameters: list[ParameterRecord] = Field(
        description="of each: `symbol mechanism unit estimate standard_error bootstrap_error posterior_error low high "
        "mean_mm max_mm configurations differ`; `low` and `high` bound its "
        "[95 % interval](statistics.md#how-sure-it-is)",
    )
    correlation: CorrelationRecord = Field(
        description="`symbols`, `matrix`, `pairs` (`a b r sentence`), `clusters`",
    )
    significance: list[SignificanceRecord] = Field(
        description="of each mechanism: `mechanism parameters mean_mm max_mm f p log10_evidence cv_rms_mm "
        "cv_rms_without_mm held_out_rms_mm held_out_rms_without_mm catalogue stability`; `p` is nominal and "
        "`stability` takes the names as given; null for free functions, which are shrunk",
    )

    @property
    def side(self) -> str:
        """The side of the split whose errors count: the held-out one, where there is any."""
        return "held_out" if self.configurations.held_out else "estimation"
