"""The tables of a study file as pydantic models, each key with its description."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, model_serializer, model_validator
from pydantic import SerializerFunctionWrapHandler as Plain

from .._names import as_name, check_listed_once
from .._part_names import check_part_names, check_planted_names
from .._typing import LARGEST
from ..measurements.formats.table import describe_no_frame, hash_source
from ..robot.kinematics import Robot
from ..robot.plain_values import check_robot_name, robot_record
from ..robot.rigid import Axis
from .builtin_robots import check_builtin_name
from .directions import check_direction
from .frozen_table import FrozenTable
from .later_keys import PLAIN_FORM, drop_defaults
from .messages import SeveralProblems

Finite = Annotated[float, Field(ge=-LARGEST, le=LARGEST, allow_inf_nan=False)]
Vector = Annotated[list[Finite], Field(min_length=3, max_length=3)]
Positive = Annotated[float, Field(ge=1e-9, le=LARGEST, allow_inf_nan=False)]
Scale = Annotated[float, Field(gt=0, le=LARGEST, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, le=LARGEST, allow_inf_nan=False)]
Count = Annotated[int, Field(ge=1, le=10_000_000)]  # of configurations: what a computer holds
Name = Annotated[str, AfterValidator(as_name)]
FileName = Annotated[str, Field(min_length=1, max_length=4000, pattern=r"^[^\x00-\x1f\x7f]+$")]


class RobotTable(FrozenTable):
    """[robot]: the nominal robot, its target, and whether to find the tracker's frame. From
    Python, `nominal` may be the Robot itself."""

    nominal: Robot | None = Field(
        default=None, description="The nominal robot itself; from Python only."
    )
    name: Annotated[str, AfterValidator(check_builtin_name)] | None = Field(
        default=None, description="Name of a built-in robot."
    )
    file: FileName | None = Field(
        default=None, description="Robot file (TOML, URDF, DH table, YAML) next to the study file."
    )
    base: str | None = Field(default=None, description="For a URDF: link where the chain starts.")
    tip: str | None = Field(default=None, description="For a URDF: link where the chain ends.")
    tool_mm: Vector | None = Field(
        default=None,
        description="Nominal target in the flange frame [mm]; a first guess with register.",
    )
    tools_mm: dict[Name, Vector] | None = Field(
        default=None, description="Nominal targets by name, in the flange frame [mm]."
    )
    gravity: Annotated[Vector, AfterValidator(check_direction)] | None = Field(
        default=None, description="Direction of gravity in frame 0, instead of the robot file's."
    )
    payload_at_mm: Vector | None = Field(
        default=None,
        description="Where payloads hang in the flange frame [mm]; without it, at the target.",
    )
    register_: bool | Literal["per group"] = Field(
        default=False,
        alias="register",
        description="Whether to find the tracker frame and the target offsets from the estimation "
        'configurations; "per group": one placement of the tracker for each group.',
    )

    gear_ratios: list[Finite] | None = Field(
        default=None,
        description="Turns of the motor per turn of each joint, 0 if unknown: gear ripple is also looked "
        "for at once and twice this many waves per turn, however small; without it, 61 to 330 are only "
        "screened for.",
    )

    @model_validator(mode="before")
    @classmethod
    def _table(cls, given: Any) -> Any:
        if isinstance(given, (str, Robot)):
            which = "nominal = the Robot"
            if isinstance(given, str):
                which = f'name = "{given}"'
            raise ValueError(f"expected a table: {which} and tool_mm = [x, y, z]")
        return given

    @model_validator(mode="after")
    def _one_source(self) -> RobotTable:
        if self.nominal is not None:
            check_robot_name(self.nominal)
        problems = []
        if [self.nominal, self.name, self.file].count(None) != 2:
            problems.append('give either name = "…" (built in) or file = "robot.toml"')
        if self.file is None and (self.base or self.tip):
            problems.append('base and tip name links of a URDF: file = "robot.urdf" goes with them')
        if self.tool_mm is not None and self.tools_mm is not None:
            problems.append("give tool_mm, or [robot.tools_mm] with a line per target, not both")
        if not self.register_ and self.tool_mm is None and self.tools_mm is None:
            problems.append(
                "tool_mm is missing: the nominal target in the flange frame (or register = true to find it)"
            )
        if problems:
            raise SeveralProblems(problems)
        return self

    @property
    def per_group(self) -> bool:
        """Whether every group has its own tracker placement."""
        return self.register_ == "per group"

    @model_serializer(mode="wrap")
    def _without_none(self, plain: Plain) -> dict[str, Any]:
        """Write a robot given as an object by its numbers, which the study's hash takes in."""
        robot = self.nominal
        rest = {
            key: value
            for key, value in plain(self.model_copy(update={"nominal": None})).items()
            if key != "nominal" and (key != "gravity" or value is not None)
        }
        return rest if robot is None else rest | {"nominal": robot_record(robot)}


@dataclass(frozen=True)
class HeldFrame:
    """A DataFrame as it was when the study was described; two are equal where their cells are."""

    sha256: str
    frame: Any = field(compare=False, repr=False)


class FeatureTable(FrozenTable):
    """[measurements.features.NAME]: what is known about an anchor, a sphere, a point or a plane."""

    position_mm: Vector | None = Field(
        default=None,
        description="Position in the tracker's frame [mm]; for a plane, one of its points.",
    )
    normal: Vector | None = Field(
        default=None, description="Normal of a plane, in the tracker's frame."
    )
    length_mm: Positive | None = Field(default=None, description="Length of a ball-bar [mm].")
    estimate: bool = Field(
        default=False, description="Position and normal are only a first guess, and are fitted."
    )
    zero: Literal["known", "unknown"] = Field(
        default="known",
        description='"unknown": the reading of a wire leaves out an unknown length, which is fitted.',
    )


class MeasurementsTable(FrozenTable):
    """[measurements]: the file, the names of its columns, and what is known about features that
    several rows share. From Python, `frame` may be a DataFrame instead of the file; a path or a
    DataFrame can also replace the table."""

    file: FileName = Field(
        description="CSV, spreadsheet or Parquet file, next to the study file or under MODELSEL_DATA."
    )
    frame: HeldFrame | None = Field(  # its hash is that of the data
        default=None, exclude=True, description="A DataFrame instead of the file; from Python only."
    )
    columns: dict[str, str] = Field(default={}, description="modelsel's name = name in the file.")
    sheet: str | None = Field(
        default=None, description="Sheet of a spreadsheet, if several contain a table of numbers."
    )
    decimal: Literal[",", "."] | None = Field(
        default=None, description="Decimal mark, if the numbers in the file leave it open."
    )
    header: bool = Field(
        default=True,
        description='Whether the file has a header; without one, its columns are "column 1" and so on.',
    )
    joined: dict[str, str] = Field(
        default={}, description="modelsel's name = name in joined files."
    )
    features: dict[Name, FeatureTable] = Field(
        default={}, description="What is known about features that several rows share, by name."
    )

    @model_serializer(mode="wrap")
    def _since(self, plain: Plain) -> dict[str, Any]:
        """Write, and hash, a study without what earlier ones did not have as it was then."""
        return drop_defaults(plain(self), PLAIN_FORM)

    @model_validator(mode="before")
    @classmethod
    def _alone(cls, given: Any) -> Any:
        if isinstance(given, str):
            return {"file": given}
        table = given if isinstance(given, Mapping) else {"frame": given}
        if "frame" not in table:
            return table
        import pandas as pd

        if "file" in table:
            raise ValueError("give file or frame, not both")
        if not isinstance(table["frame"], pd.DataFrame):
            raise ValueError(describe_no_frame(table["frame"]))
        frame = table["frame"].copy()
        return {**table, "file": "DataFrame", "frame": HeldFrame(hash_source(frame), frame)}


class SplitTable(FrozenTable):
    """[split]: number of configurations used to fit and select, or the column that says which."""

    estimation: Annotated[int, Field(ge=1)] | None = Field(
        default=None, description="Configurations used to fit and select; the others are held out."
    )
    column: str | None = Field(
        default=None, description="Column that says which rows are held out."
    )
    held_out: str = Field(default="held-out", description="Value of that column in held-out rows.")
    nested_folds: int = Field(
        default=0,
        ge=0,
        le=1000,
        description="Number of folds in which the whole procedure is repeated; 0: it is not.",
    )

    @model_validator(mode="after")
    def _one_way(self) -> SplitTable:
        problems = []
        if self.estimation is not None and self.column is not None:
            problems.append('give estimation = N or column = "…", not both')
        if self.nested_folds == 1:
            problems.append("nested_folds = 1 is not a fold; 0 (none) or 2 and more")
        if problems:
            raise SeveralProblems(problems)
        return self


class ModelTable(FrozenTable):
    """[model]: the base, the mechanisms that may extend it, and the ladder to report."""

    base: Annotated[list[str], AfterValidator(check_listed_once)] = Field(
        default=["geometric"], description="Mechanisms that are always in the model."
    )
    candidates: Literal["all"] | list[str] = Field(
        default="all", description="Mechanisms that may extend the base; []: fit the base alone."
    )
    ladder: list[Annotated[list[str], AfterValidator(check_listed_once)]] = Field(
        default=[], description="Models to report in addition to the chosen one."
    )


class ComparisonTable(FrozenTable):
    """[comparison]: cross-validation folds, and the size of the table of subsets."""

    folds: int = Field(default=10, ge=2, description="Number of cross-validation folds.")
    by: Literal["configuration", "group"] = Field(
        default="configuration", description="What a fold keeps together."
    )
    mechanisms: Annotated[int, Field(ge=1, le=64)] | None = Field(
        default=None, description="Number of mechanisms in the table of subsets."
    )

    @model_serializer(mode="wrap")
    def _since(self, plain: Plain) -> dict[str, Any]:
        """Write a study without what earlier ones did not have: their hash stays."""
        written: dict[str, Any] = plain(self)
        if written.get("mechanisms") is None:
            written.pop("mechanisms", None)
        return written


class NoiseTable(FrozenTable):
    """[noise]: a noise floor or the instrument, and the other parts that the errors may have."""

    floor_mm: Positive | None = Field(
        default=None, description="Known standard uncertainty of one coordinate [mm]."
    )
    range_mm: NonNegative = Field(
        default=0.0, description="Uncertainty of the instrument along the beam [mm]."
    )
    range_ppm: NonNegative = Field(
        default=0.0, description="Uncertainty along the beam, in proportion to the distance [ppm]."
    )
    angle_urad: NonNegative = Field(default=0.0, description="Uncertainty across the beam [µrad].")
    tracker_mm: Vector = Field(
        default=[0.0, 0.0, 0.0], description="Instrument's position in the tracker's frame [mm]."
    )
    parts: Literal["all"] | list[str] = Field(
        default="all",
        description='Parts of the errors that may be looked for: "joint 2", "joints" (every joint), '
        '"instrument z" (more noise along z), "instrument range" and "instrument angle" (along and '
        'across the line of sight), "instrument target B" and "instrument group s2" (more noise there), '
        '"instrument" (each of these), "configuration", "group", "lasting"; '
        "[]: none.",
    )
    fixed: dict[str, Scale] = Field(
        default={}, description="Parts with a known standard deviation [rad or mm], by name."
    )

    @model_validator(mode="after")
    def _parts_exist(self) -> NoiseTable:
        check_part_names(self.parts, self.fixed)
        return self

    @model_serializer(mode="wrap")
    def _since(self, plain: Plain) -> dict[str, Any]:
        """Write a study without what earlier ones did not have: their hash stays."""
        return drop_defaults(plain(self), {"parts": "all", "fixed": {}})

    @property
    def instrument(self) -> bool:
        """Whether an instrument is described."""
        numbers = (self.range_mm, self.range_ppm, self.angle_urad)
        return any(numbers)


class SamplingTable(FrozenTable):
    """[sampling]: what emcee samples."""

    over: Literal["default", "all"] = Field(
        default="default",
        description='Coefficients that are sampled; "all": every one, with normal noise.',
    )


class OutcomeTable(FrozenTable):
    """[search.outcomes.NAME]: what became of earlier findings of a registered name."""

    confirmed: Annotated[int, Field(ge=0, le=1_000_000)] = Field(
        default=0, description="Number of findings of that name that were confirmed."
    )
    contradicted: Annotated[int, Field(ge=0, le=1_000_000)] = Field(
        default=0, description="Number of findings of that name that were not."
    )


class SearchTable(FrozenTable):
    """[search]: memory and rows of the search for causes, and the outcomes of earlier findings."""

    memory_mb: float = Field(
        default=500.0,
        ge=50,
        le=1e6,
        description="Memory for the values of the causes [MB]. Values are kept for as many rows as fit "
        "into 85 % of it and are recomputed for the others; the results are the same.",
    )
    max_rows: int = Field(
        default=12_000,
        ge=100,
        description="Maximum number of rows searched; beyond it, configurations are drawn.",
    )
    outcomes: dict[str, OutcomeTable] = Field(
        default={}, description="Outcomes of findings of a registered name; its prior follows."
    )

    @model_serializer(mode="wrap")
    def _since(self, plain: Plain) -> dict[str, Any]:
        """Write a study without what earlier ones did not have: their hash stays."""
        return drop_defaults(plain(self), {"outcomes": {}})


class EffectTable(FrozenTable):
    """[[simulate.effect]]: one planted screw."""

    frame: int = Field(ge=1, description="Frame: 1 to n for the joints, n+1 for the target.")
    axis: Axis = Field(description="Axis of that frame.")
    cause: str = Field(description="Formula by which the effect is scaled, such as sin(q4).")
    size: Finite = Field(description="Size of the effect, in mm or rad per unit of the cause.")


class SimulateTable(FrozenTable):
    """[simulate]: what `modelsel simulate` makes. Without a measurements file, configurations are
    drawn and measured in `repeats` rounds and `groups` groups."""

    configurations: Count = Field(
        default=200, description="Number of configurations drawn, if there is no file yet."
    )
    noise_mm: NonNegative = Field(
        default=0.06, description="Standard deviation per coordinate [mm]."
    )
    effect: list[EffectTable] = Field(default=[], description="Effects to plant.")
    repeats: Count = Field(
        default=1, description="Number of rounds in which all drawn configurations are measured."
    )
    groups: Count = Field(
        default=1, description="Number of groups, one after another, in which visits are measured."
    )
    parts: dict[str, Scale] = Field(
        default={},
        description="Standard deviations [rad or mm] of the parts of the noise, by name.",
    )
    lasting_visits: Scale = Field(
        default=6.0, description='Number of visits over which the part "lasting" decays to 1/e.'
    )

    @model_validator(mode="after")
    def _parts_exist(self) -> SimulateTable:
        check_planted_names(self.parts)
        return self

    @model_serializer(mode="wrap")
    def _since(self, plain: Plain) -> dict[str, Any]:
        """Write a study without what earlier ones did not have: their hash stays."""
        later = {"repeats": 1, "groups": 1, "parts": {}, "lasting_visits": 6.0}
        return drop_defaults(plain(self), later)
