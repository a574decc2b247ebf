"""The records that a study writes: `StudyRecord` is result.json, `DetailsRecord` details.json.

Strict models: what is read back has every key, each of its type, and only finite numbers. Undefined figures are
null; an optional key may be absent. Keys that a record does not know are left alone."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from .._records import Number, StrictRecord, Text, Vector, Whole
from .finding_schema import FindingRecord, ScrewRecord, SmallFindingsRecord
from .model_schema import (
    CandidatesRecord,
    CorrelationRecord,
    NestedRecord,
    ParameterRecord,
    RungRecord,
    SamplingRecord,
    SignificanceRecord,
    WeighedModelRecord,
)
from .record_types import Figure, Texts

# the part that every list of parts has
INSTRUMENT = "instrument"
Size = Annotated[Number, Field(ge=0)]


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
    rms_mm: Figure = None


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


class ErrorPartRecord(StrictRecord):
    """One part of what the chosen model leaves: its standard deviation with a 95 % interval, and its
    share of the mean square at the target."""

    part: Text = Field(description="`instrument`, `joint 2`, `configuration`, `group` or `lasting`")
    scale: Size = Field(
        description="standard deviation, of a joint's position, else of one coordinate"
    )
    unit: Literal["rad", "mm"] = Field(description="of `scale`, `low` and `high`")
    low: Size = Field(description="begins the 95 % interval of `scale`")
    high: Size = Field(description="ends it")
    share: Annotated[Number, Field(gt=0, le=1)] = Field(
        description="of the mean square that is left at the target; all add up to 1"
    )
    told_by: Text = Field(
        description="what tells it from other parts: `repeats` of a posture, `targets` of a configuration, `directions` "
        "alone, `groups`, `order` of motion; of the instrument `what is left`; `given` in `[noise.fixed]`"
    )
    instead: list[Text] = Field(
        default=[], description="effects that the data could hold instead of a part that lasts"
    )
    sentence: Text = Field(description="for people")


def _check_instrument(parts: list[ErrorPartRecord]) -> list[ErrorPartRecord]:
    if parts and INSTRUMENT not in [part.part for part in parts]:
        raise ValueError("the instrument's part is missing")
    return parts


ErrorParts = Annotated[list[ErrorPartRecord], AfterValidator(_check_instrument)]


class NothingElseRecord(StrictRecord):
    """What a further effect would have had to be."""

    sentence: Text
    detection_limit_mm: Figure
    detection_limit_mrad: Figure = None
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
        description="`modelsel numpy scipy` versions, `data_sha256`, `study_sha256`"
    )
    verdict: Texts = Field(description="the sentences of the first page")
    configurations: ConfigurationsRecord = Field(
        description="`estimation`, `held_out`, `estimation_rows` (0-based rows of the file)"
    )
    noise_floor: NoiseFloorRecord = Field(
        description="`coordinate_mm`, `source`: stated, instrument, repeats, target pairs, estimated; with rows of "
        "other kinds than points also `mean_mm` and `rms_mm`, the mean and the rms length of a row's noise"
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
        "σ, in every row; EBIC (table of subsets) counts all groups that were scanned"
    )
    candidates: CandidatesRecord = Field(
        description="the table of subsets: `compared`, `choice` (one standard error), `considered`, `set_aside`, "
        "`best` (as the ladder, with `weight` and `note`); above sixteen mechanisms also `search` (`mechanisms "
        "criterion nodes proven may_be_beaten_by best`)"
    )
    weighed_models: list[WeighedModelRecord] = Field(
        [],
        description="the most probable sets of effects of all that the search has weighed, the most probable first: "
        "`effects` (names of mechanisms, or place and cause; with the cause where several have one name), `probability` among them, `chosen`: whether the findings are this set",
    )
    findings: list[FindingRecord] = Field(description="a list, below")
    small_findings: SmallFindingsRecord | None = Field(
        None,
        description="the findings that do not matter, together: `count`, `rms_mm` (of their sum, beyond the others), `rms_mrad` "
        "(of their turning, beyond the base; only where orientations were measured), `sentence`; null where every finding matters",
    )
    repeatability: ErrorParts = Field(
        [],
        description="[what does not repeat](../how-to/repeatability.md), the largest share first, below; never a finding. "
        "The instrument alone where no other part was told; empty where none could be: fewer than 20 configurations, rows "
        "of other kinds than points, no candidate to name",
    )
    nothing_else: NothingElseRecord = Field(
        description="`sentence`, `detection_limit_mm` (rms displacement per row beyond the base), `detection_limit_mrad` (of an "
        "effect that only turns the target; only where orientations were measured), `predictable` "
        "(`share`, `p`: could a smooth function predict the rest); `lack_of_fit` (`f p floor_mm unexplained_mm low_mm "
        "high_mm`: the chosen model against a noise floor that is known without it; null where there is none)"
    )
    nested_cv: NestedRecord | None = Field(
        description="`folds`, `geometric`, `chosen` (errors), `named_in_folds` (name: folds); null where not asked"
    )
    chosen: ChosenRecord = Field(
        description="`mechanisms`, `cells` (screws without a registered name)"
    )
    path: Texts = Field(description="what the search did, step by step")
    error_map: ErrorMapRecord = Field(
        description="`places`, `causes`, `f` and `p_family_wise` of each cell beyond the base"
    )
    outliers: list[Whole] = Field(description="rows set aside, 0-based")
    unidentifiable: list[UnidentifiableRecord] = Field(description="`sentence`, `parameters`")
    warnings: list[WarningRecord] = Field(description="`code`, `sentence`")
    sampling: SamplingRecord | None = Field(
        description="`effective_samples r_hat tau converged acceptance steps walkers sampled sentence quantiles "
        "importance trace`; null where left out"
    )
    parameters: list[ParameterRecord] = Field(
        description="of each: `symbol mechanism unit estimate standard_error bootstrap_error posterior_error low high "
        "mean_mm max_mm configurations differ`; `low` and `high` bound its "
        "[95 % interval](../explanation/statistics.md#how-sure-it-is)"
    )
    correlation: CorrelationRecord = Field(
        description="`symbols`, `matrix`, `pairs` (`a b r sentence`), `clusters`"
    )
    significance: list[SignificanceRecord] = Field(
        description="of each mechanism: `mechanism parameters mean_mm max_mm f p log10_evidence cv_rms_mm "
        "cv_rms_without_mm held_out_rms_mm held_out_rms_without_mm catalogue stability number`; `p` is nominal and "
        "`stability` takes the names as given; null for free functions, which are shrunk; `number` tells mechanisms "
        "of one name apart, as the ladder does, else null"
    )

    @property
    def side(self) -> str:
        """The side of the split whose errors count: the held-out one, where there is any."""
        return "held_out" if self.configurations.held_out else "estimation"
