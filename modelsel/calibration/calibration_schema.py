"""The record of calibration.json: `CalibrationRecord`, strict; its JSON schema is
`CalibrationRecord.model_json_schema()`."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from .._records import Number, Pair, StrictRecord, Text, Vector, Whole
from .._text import MAX_FILE_BYTES
from ..mechanisms.serialization import MechanismRecord

SCHEMA_VERSION = 1

Rotation = Annotated[list[Vector], Field(min_length=3, max_length=3)]
Row = Annotated[list[Number], Field(min_length=4, max_length=4)]
Transform = Annotated[list[Row], Field(min_length=3, max_length=3)]
Length = Annotated[Number, Field(ge=0)]  # mm


class JointRecord(StrictRecord):
    """A nominal joint: the fixed transform before it [mm], its limits [rad or mm], and mass and
    centre of mass of the link it moves."""

    before_mm: Transform
    prismatic: bool
    limits: Pair | None
    mass_kg: Number | None
    com_mm: Vector


class RobotRecord(StrictRecord):
    """The nominal robot. `usual`: usual size of the errors of such an arm (mm, rad); `coupling`:
    matrix from motor readings to joint angles; `passive`: motors that do not exist but stand
    for a linkage; `payload_at_mm`: where payloads hang in the flange's frame, null for at the target."""

    name: Text
    source: Text
    gravity: Vector | None
    usual: Pair = Field(default=[1.0, 1e-3])
    joints: Annotated[list[JointRecord], Field(min_length=1)]
    last_mm: Transform
    coupling: list[list[Number]] | None = None
    passive: list[Whole] | None = None
    payload_at_mm: Vector | None = None


class UrdfRecord(StrictRecord):
    """The URDF from which the robot was read, and the links where its chain starts and ends."""

    text: Annotated[str, Field(max_length=MAX_FILE_BYTES)]
    base: Text
    tip: Text


class FileFormRecord(StrictRecord):
    """How the study reads its measurements file: in `columns` and `joined`, modelsel's name = name
    in the file."""

    columns: dict[Text, Text]
    sheet: Text | None
    decimal: Literal[",", "."] | None
    header: bool = True
    joined: dict[Text, Text] = Field(default={})


class TargetRecord(StrictRecord):
    """A target on the flange."""

    name: Text
    tool_mm: Vector
    rotation: Rotation | None


class GroupRecord(StrictRecord):
    """A group of measurements, with its placement: frame 0 in the tracker's frame."""

    name: Text
    rotation: Rotation
    translation_mm: Vector


class EstimateRecord(StrictRecord):
    """A parameter; one that is not `estimable` is fixed at its value."""

    symbol: Text
    value: Number
    standard_error: Number
    unit: Text
    estimable: bool


class FactorRecord(StrictRecord):
    """Rows of the triangular factor F of the covariance, each from its diagonal on."""

    says: Text = ""
    rows: list[list[Number]]


class NoiseFloorRecord(StrictRecord):
    """Standard deviation of one measured coordinate; `freedom`: its degrees of freedom, null if it
    was stated."""

    coordinate_mm: Length
    source: Text
    freedom: Annotated[Number, Field(gt=0)] | None


class RefitErrorsRecord(StrictRecord):
    """Rms length of what a model leaves [mm]; null if there are no such rows."""

    estimation_rms_mm: Length | None
    held_out_rms_mm: Length | None


class RefitEstimateRecord(StrictRecord):
    """A parameter of a refit; `term`: place of its term among those of the calibration, counted
    from 0."""

    term: Whole
    symbol: Text
    value: Number


class RefitRecord(RefitErrorsRecord):
    """Some terms of the calibration, fitted without the others."""

    estimates: list[RefitEstimateRecord]


class RefitsRecord(StrictRecord):
    """Refits for export forms that cannot carry the whole model; `corrected`: errors of the instrument
    were taken off the measurements first."""

    says: Text = ""
    whole: RefitErrorsRecord
    mean_celsius: Number | None = Field(alias="temperature_C")
    corrected: bool = False
    alone: dict[Text, RefitRecord]


class EstimationRowsRecord(StrictRecord):
    """The rows that models were fitted to: how many, and hashes of their positions, 8 bytes each, in
    base64."""

    count: Annotated[Whole, Field(ge=1)]
    codes: Annotated[str, Field(max_length=MAX_FILE_BYTES)]


class OtherSideRecord(StrictRecord):
    """What may be true in the place of a mechanism: of the instrument for the arm's, or the reverse."""

    label: Text
    share: Annotated[Number, Field(ge=0, le=1)]
    rms_mm: Length
    instrument: MechanismRecord
    estimate: list[Number]

    @model_validator(mode="after")
    def _check_estimate(self) -> OtherSideRecord:
        if len(self.estimate) != len(self.instrument.terms):
            raise ValueError(
                "its estimate has not one number for each term of the instrument's error"
            )
        return self


class CalibrationRecord(StrictRecord):
    """calibration.json: the nominal robot, its set-up and all fitted screws."""

    schema_: Literal[1] = Field(alias="schema")
    kind: Literal["calibration"]
    study: Text
    robot: RobotRecord
    targets: Annotated[list[TargetRecord], Field(min_length=1)]
    groups: Annotated[list[GroupRecord], Field(min_length=1)]
    registered: bool
    tracker_mm: Vector
    mechanisms: list[MechanismRecord]
    estimates: list[EstimateRecord]
    covariance_factor: FactorRecord
    noise_floor: NoiseFloorRecord
    held_out_rms_mm: Length | None
    ranges: dict[Text, Pair]
    provenance: dict[Text, Text]
    refits: RefitsRecord | None = None
    urdf: UrdfRecord | None = None
    file_form: FileFormRecord | None = None
    doubtful: list[Text] = Field(default_factory=list)
    held_out_ranges: dict[Text, Pair] = Field(default_factory=dict)
    estimation_rows: EstimationRowsRecord | None = None
    held_out_model_mm: Length | None = None
    other_sides: dict[Text, OtherSideRecord] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _check_names(self) -> CalibrationRecord:
        targets = [target.name for target in self.targets]
        groups = [group.name for group in self.groups]
        for place, names in (("targets", targets), ("groups", groups)):
            if len(set(names)) < len(names):
                raise ValueError(f"two {place} have one name")
        without = [target.rotation is None for target in self.targets]
        if any(without) and not all(without):
            raise ValueError("some of its targets have an orientation and some have none")
        return self

    @model_validator(mode="after")
    def _check_ranges(self) -> CalibrationRecord:
        pairs = [*self.ranges.items(), *self.held_out_ranges.items()]
        for name, (low, high) in pairs:
            if low > high:
                raise ValueError(f"ranges.{name}: expected the lower bound first")
        joints = set()
        for number, _ in enumerate(self.robot.joints, 1):
            joints.add(f"q{number}")
        missing = sorted(joints - self.ranges.keys())
        if missing:
            names = ", ".join(missing)
            raise ValueError(f"its ranges lack {names}")
        return self

    @model_validator(mode="after")
    def _check_factor(self) -> CalibrationRecord:
        estimable = 0
        for estimate in self.estimates:
            estimable += estimate.estimable
        rows = self.covariance_factor.rows
        lengths = [len(row) for row in rows]
        expected = list(range(estimable, 0, -1))
        if lengths != expected:
            raise ValueError("its covariance_factor has other rows than its estimable terms")
        return self
