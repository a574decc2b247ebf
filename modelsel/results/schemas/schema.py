"""The records that a study writes: `StudyRecord` is result.json, `DetailsRecord` details.json.

Strict models: what is read back has every key, each of its type, and only finite numbers. Undefined figures are
null; an optional key may be absent. Keys that a record does not know are left alone."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from ..._part_names import INSTRUMENT
from ..._records import Number, StrictRecord, Text, Vector, Whole
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

Size = Annotated[Number, Field(ge=0)]


class ProvenanceRecord(StrictRecord):
    """Versions and hashes; no path, time or host."""

    modelsel: Text
    numpy: Text | None = None
    scipy: Text | None = None
    data_sha256: Text
    study_sha256: Text
    robot_sha256: Text | None = None

    @property
    def run(self) -> tuple[str, str]:
        """What files of one run have in common: the hashes of the data and of the study."""
        return self.data_sha256, self.study_sha256


class ConfigurationsRecord(StrictRecord):
    """The split of the configurations."""

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
    """The base of the robot as found by registration, in the tracker's frame."""

    group: Text
    position_mm: Vector
    rpy_deg: Vector


class TargetRecord(StrictRecord):
    """A target as found by registration, in the flange frame."""

    target: Text
    position_mm: Vector


class RegistrationRecord(StrictRecord):
    """Base and targets as found by registration."""

    base_in_tracker: list[BaseRecord]
    target_on_flange: list[TargetRecord]


class FeatureRecord(StrictRecord):
    """A feature that rows share, as the chosen model locates it, in the tracker's frame."""

    name: Text
    kind: Text
    position_mm: Vector
    normal: Vector | None
    length_mm: Figure
    fitted: Texts


class PredictableRecord(StrictRecord):
    """Whether a smooth function of the configuration could still predict what is left."""

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
    expected_mm: Number | None = None


class ErrorPartRecord(StrictRecord):
    """A part of what the chosen model leaves: its standard deviation with a 95 % interval, and its
    share of the mean square at the target."""

    part: Text = Field(
        description="`instrument`, `instrument z` (along an axis of the measurements' frame, beyond its "
        "errors in all directions), `instrument range` and `instrument angle` (along and across the "
        "line from it), `instrument target B` and `instrument group s2` (beyond those of other targets "
        "or groups), `joint 2`, `configuration`, `group` or `lasting`"
    )
    scale: Size = Field(
        description="standard deviation: for a joint, of its position; for `instrument angle`, of each "
        "angle; otherwise, of one coordinate"
    )
    unit: Literal["rad", "mm"] = Field(description="unit of `scale`, `low` and `high`")
    low: Size = Field(description="lower end of the 95 % interval of `scale`")
    high: Size = Field(description="upper end of that interval")
    share: Annotated[Number, Field(gt=0, le=1)] = Field(
        description="its share of the mean square left at the target; all shares add up to 1"
    )
    told_by: Text = Field(
        description="what identifies it: `repeats` of a posture, several `targets` of a configuration, "
        "`directions` alone, `sizes` of single rows' errors, `groups`, `order` of motion; for the instrument `what is left`; "
        "`given` if `[noise.fixed]` states it"
    )
    instead: list[Text] = Field(
        default=[], description="effects that could explain the data instead of a lasting part"
    )
    sentence: Text = Field(description="the same in words")


def _check_instrument(parts: list[ErrorPartRecord]) -> list[ErrorPartRecord]:
    if parts and INSTRUMENT not in [part.part for part in parts]:
        raise ValueError("the instrument's part is missing")
    return parts


ErrorParts = Annotated[list[ErrorPartRecord], AfterValidator(_check_instrument)]


class NothingElseRecord(StrictRecord):
    """How large a further effect would have to be to be found, and what is left unexplained."""

    sentence: Text
    detection_limit_mm: Figure
    detection_limit_mrad: Figure = None
    predictable: PredictableRecord | None
    lack_of_fit: LackOfFitRecord | None = None


class ChosenRecord(StrictRecord):
    """The contents of the chosen model."""

    mechanisms: Texts
    cells: list[ScrewRecord]


class ErrorMapRecord(StrictRecord):
    """F and family-wise p of each place and cause alone, beyond the base."""

    places: Texts
    causes: Texts
    f: list[list[Figure]]
    p_family_wise: list[list[Figure]]


class UnidentifiableRecord(StrictRecord):
    """Parameters that the data determine only together."""

    sentence: Text
    parameters: Texts
    combinations: Whole | None = None
    at_zero: Texts = Field(default=[])


class WarningRecord(StrictRecord):
    """Something the user should know."""

    code: Text
    sentence: Text


class StudyRecord(StrictRecord):
    """result.json."""

    version: Literal[1] = Field(alias="schema", description="1")
    study: Text = Field(description="name of the study")
    robot: Text = Field(description="name of the robot")
    seed: Whole = Field(description="every random choice derives from it")
    provenance: ProvenanceRecord = Field(
        description="versions (`modelsel numpy scipy`) and hashes (`data_sha256 study_sha256 robot_sha256`: "
        "of the measurements' file, the study and the nominal robot)"
    )
    verdict: Texts = Field(description="the sentences of the report's first page")
    configurations: ConfigurationsRecord = Field(
        description="`estimation` and `held_out`: number of configurations on each side of the split; "
        "`estimation_rows`: rows of the file, counted from 0"
    )
    noise_floor: NoiseFloorRecord = Field(
        description="`coordinate_mm`: standard uncertainty of one coordinate; `source`: stated, "
        "instrument, repeats, target pairs or estimated. With rows of other kinds than points "
        "also `mean_mm` and `rms_mm`: mean and rms length of a row's noise"
    )
    registration: RegistrationRecord | None = Field(
        None,
        description="only with `register`. `base_in_tracker`: frame 0 of the nominal robot in the "
        'tracker\'s frame, for each group, or once for all of them (`group` "all"), as '
        "`position_mm` and `rpy_deg`, where $R = "
        r"R_z(\mathrm{yaw})\,R_y(\mathrm{pitch})\,R_x(\mathrm{roll})$. `target_on_flange`: for "
        "each `target` its `position_mm` in the flange frame",
    )
    features: list[FeatureRecord] | None = Field(
        None,
        description="only with rows of other kinds than points: each feature that has a position, `name "
        "kind position_mm normal length_mm fitted`, in the tracker's frame; `fitted` lists "
        "the symbols of what was fitted",
    )
    ladder: Annotated[list[RungRecord], Field(min_length=1)] = Field(
        description="list of models, from the nominal to the chosen one: `mechanisms`, `parameters`, "
        "`rank`, `estimation` and `held_out` (each `mean_mm rms_mm p95_mm max_mm rows "
        "left_out mean_all_mm`), `cv_rms_mm cv_mean_mm aicc bic aic gcv ebic "
        "log_predictive_density`. If the noise floor is stated, AIC, AICc, BIC and EBIC use "
        "that σ for every model. EBIC is given only in the table of subsets, and counts all "
        "candidates that were scanned"
    )
    candidates: CandidatesRecord = Field(
        description="the table of subsets: `compared` (number of subsets), `choice` (by the "
        "one-standard-error rule), `considered` and `set_aside` (mechanisms that entered the "
        "comparison, and that did not), `best` (models as in the ladder, with `weight` and "
        "`note`). With more than sixteen mechanisms also `search`, the result of branch and "
        "bound: `mechanisms criterion nodes proven may_be_beaten_by best`"
    )
    weighed_models: list[WeighedModelRecord] = Field(
        [],
        description="the most probable of all sets of effects that the search weighed, in descending "
        "order, always with the chosen one: `effects` (names of mechanisms, or place and "
        "cause; if several share a name, with the cause), `probability` among all weighed "
        "sets, `chosen` (whether the findings are this set)",
    )
    findings: list[FindingRecord] = Field(description="list of findings, see below")
    small_findings: SmallFindingsRecord | None = Field(
        None,
        description="the findings that do not matter, taken together: `count`, `rms_mm` (of their sum, "
        "beyond the base and the findings that matter), `rms_mrad` (how far they turn the "
        "target, beyond the base; only if orientations were measured), `sentence`; null if "
        "there are none",
    )
    repeatability: ErrorParts = Field(
        [],
        description="[what does not repeat](../how-to/repeatability.md), the largest share first, see "
        "below; its parts are never findings. If nothing else was found, it lists the "
        "instrument alone. It is empty if no part could be identified: fewer than 20 "
        "estimation configurations, rows of other kinds than points, no candidates, or "
        "`noise.parts = []`",
    )
    nothing_else: NothingElseRecord = Field(
        description="what could have been missed: `sentence`; `detection_limit_mm`: rms displacement per "
        "row, beyond the base, from which an effect would have been found with 90 % "
        "probability; `detection_limit_mrad`: the same for an effect that only turns the "
        "target (only if orientations were measured); `predictable` (`share`, `p`): whether a "
        "smooth function of the configuration could still predict what is left; `lack_of_fit` "
        "(`f p floor_mm unexplained_mm low_mm high_mm expected_mm`): the chosen model compared with a "
        "noise floor that is known without it (`expected_mm`: a coordinate's standard deviation by the floor "
        "and what else does not repeat); null if there is none"
    )
    nested_cv: NestedRecord | None = Field(
        description="the whole procedure repeated in every fold: `folds`, `geometric` and `chosen` "
        "(errors of the base and of the chosen model), `named_in_folds` (in how many folds "
        "each name was found); null if not requested"
    )
    chosen: ChosenRecord = Field(
        description="the chosen model: `mechanisms`, and `cells` (screws without a registered name)"
    )
    path: Texts = Field(description="the steps of the search")
    error_map: ErrorMapRecord = Field(
        description="`places`, `causes`, and for each cell alone, beyond the base, `f` and "
        "`p_family_wise`"
    )
    outliers: list[Whole] = Field(description="rows left out as outliers, counted from 0")
    unidentifiable: list[UnidentifiableRecord] = Field(
        description="parameters that the data determine only together: `sentence`, `parameters`, "
        "`combinations` (how many combinations of entangled ones are determined, else null), "
        "`at_zero` (those of them that are kept at zero)"
    )
    warnings: list[WarningRecord] = Field(description="`code`, `sentence`")
    sampling: SamplingRecord | None = Field(
        description="the sampled posterior: `effective_samples r_hat tau converged acceptance steps "
        "walkers sampled sentence quantiles importance trace`; null if nothing was sampled"
    )
    parameters: list[ParameterRecord] = Field(
        description="for each estimable parameter: `symbol mechanism unit estimate standard_error "
        "bootstrap_error posterior_error low high mean_mm max_mm configurations differ`, with measured orientations also `max_mrad` (how far "
        "it turns the target); "
        "`low` and `high` are the ends of its [95 % "
        "interval](../explanation/statistics.md#how-sure-it-is)"
    )
    correlation: CorrelationRecord = Field(
        description="of the estimable parameters, without those of free functions: `symbols`, `matrix`, "
        "`pairs` (`a b r sentence`, the strong correlations), `clusters`"
    )
    significance: list[SignificanceRecord] = Field(
        description="for each mechanism: `mechanism parameters mean_mm max_mm f p log10_evidence "
        "cv_rms_mm cv_rms_without_mm held_out_rms_mm held_out_rms_without_mm catalogue "
        "stability number`, with measured orientations also `mean_mrad max_mrad`. `p` is nominal: it and `stability` take the names as given. `f` "
        "and `p` are null for free functions, which are shrunk. `number` distinguishes "
        "mechanisms of the same name, as in the ladder; otherwise it is null"
    )

    @property
    def side(self) -> str:
        """The side of the split whose errors count: the held-out one, where there is any."""
        return "held_out" if self.configurations.held_out else "estimation"
