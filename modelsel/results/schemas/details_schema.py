"""The records of details.json: what the pictures need beyond result.json."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from ..._records import Number, Pair, StrictRecord, Text, Vector, Whole
from .record_types import Axis, Figure, Texts


class DrawnRowsRecord(StrictRecord):
    """The rows that are drawn; `of`: number of all measured rows."""

    of: Whole
    row: list[Whole]
    estimation: list[Whole]
    outlying: list[Whole]
    q: list[Annotated[list[Number], Field(min_length=1)]]
    measured_mm: list[Vector]
    progress: list[Number] | None = None
    move: list[Number] | None = None
    temperature_C: list[Number] | None = None  # noqa: N815


class PlacesRecord(StrictRecord):
    """How the user refers to the rows of the measurements."""

    word: Literal["line", "row", "sheet row"]
    first: Whole
    at: dict[Text, Whole] | None
    labels: dict[Text, Text] | None = None


class JointRecord(StrictRecord):
    """Unit and range of a joint."""

    unit: Literal["mm", "rad"]
    limits: Pair | None


class ArmRecord(StrictRecord):
    """Frames of the nominal arm at one configuration, with gravity pointing down: frame 0, those
    of the joints, and that of the target."""

    origins_mm: Annotated[list[Vector], Field(min_length=2)]
    axes: list[Annotated[list[Vector], Field(min_length=3, max_length=3)]]
    slides: list[bool]


class MeaningRecord(StrictRecord):
    """Meaning of a fitted parameter of the chosen model, and its nominal value [mm or rad]."""

    symbol: Text
    frame: Whole | None
    meaning: Text
    nominal: Figure
    free: bool


class CampaignRecord(StrictRecord):
    """The campaign as described in the study file."""

    date: Text | None = None
    instrument: Text | None = None
    serial_number: Text | None = None
    operator: Text | None = None
    ambient: Text | None = None


class RungResidualsRecord(StrictRecord):
    """Residuals of one model of the ladder at the drawn rows, in the tracker's frame."""

    residual_mm: list[Vector]
    rotation_rad: list[Vector] | None


class MapPlaceRecord(StrictRecord):
    """A row of the error map: the target's displacement per unit screw at the drawn rows."""

    frame: Whole
    axis: Axis
    turns_only: bool
    d: list[Vector]


class MapColumnRecord(StrictRecord):
    """A column of the error map: a wave, by its angle and number per turn, or otherwise the values
    of its causes."""

    wave: Figure
    angle: Text | None
    joint: Whole | None
    values: list[list[Number]] | None
    unit: Text | None = None


class MapRecord(StrictRecord):
    """The cells of the error map, for a page that computes with them."""

    places: list[MapPlaceRecord]
    columns: list[MapColumnRecord]
    slopes: list[list[list[Number] | None]]
    named: list[Annotated[tuple[Whole, Whole, Text], Field(strict=False)]]


class CardTermRecord(StrictRecord):
    """A term of a mechanism, in words."""

    symbol: Text
    unit: Text
    screws: Texts
    size: Pair | None
    sign: Whole
    expected: Text


class CardRecord(StrictRecord):
    """A mechanism, in words."""

    name: Text
    sentence: Text
    equation: Text
    source: Text
    usual_causes: Texts = Field(default_factory=list)
    terms: list[CardTermRecord]


class ActingPlaceRecord(StrictRecord):
    """A frame that a finding moves, along or about one of its axes."""

    frame: Whole
    axis: Axis
    direction: Vector


class PanelRecord(StrictRecord):
    """A figure of a finding: residual against cause, `before` without and `after` with the effect."""

    frames: list[Whole]
    axis: Literal["", "tx", "ty", "tz", "rx", "ry", "rz"]
    against: Text
    against_unit: Text
    unit: Literal["mm", "rad"]
    kind: Text
    x: list[Number]
    before: list[Number]
    after: list[Number]
    weight: list[Number]
    curve: Annotated[list[list[Number]], Field(min_length=2, max_length=2)]


class PostureRecord(StrictRecord):
    """The nominal arm, upright, at the configuration where a finding moves the target most:
    origins of frame 0, of the joints and of the target, the displacement of the target, and
    what the finding moves. For a finding that only turns the target, the configuration where it
    does so most, and by how much (`turned_mrad`)."""

    origins_mm: Annotated[list[Vector], Field(min_length=2)]
    moved_mm: Vector
    turned_mrad: Figure = None
    places: list[ActingPlaceRecord]


class FindingDetailsRecord(StrictRecord):
    """What is drawn of a finding; `card`: the key of its mechanism's card among `cards`."""

    label: Text
    what: Text
    panels: list[PanelRecord]
    more_panels: Whole
    rivals: Texts
    posture: PostureRecord | None = None
    card: Text | None = None


class DetailsRecord(StrictRecord):
    """details.json."""

    version: Literal[1] = Field(alias="schema")
    data_sha256: Text
    study_sha256: Text
    campaign: CampaignRecord | None = None
    rows: DrawnRowsRecord
    places: PlacesRecord | None = None
    joints: list[JointRecord]
    arm_mm: list[Vector]
    arm: ArmRecord | None = None
    parameters: list[MeaningRecord] = Field(default_factory=list)
    base: Whole
    rungs: list[RungResidualsRecord]
    map: MapRecord
    cards: dict[Text, CardRecord]
    findings: list[FindingDetailsRecord]

    @property
    def run(self) -> tuple[str, str]:
        """What files of one run have in common: the hashes of the data and of the study."""
        return self.data_sha256, self.study_sha256
