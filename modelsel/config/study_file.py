"""A study: frozen values, from TOML or from Python; every problem is said at once, each with its
place."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    model_serializer,
    model_validator,
)
from pydantic import SerializerFunctionWrapHandler as Plain

from .._names import as_name
from .._text import parse_toml, read_text
from .._typing import LARGEST
from ..exceptions import StudyError, suggest
from ..measurements.table import Source, hash_source
from ..robot.kinematics import Robot
from ..robot.plain_values import check_robot_name, robot_record
from ..robot.rigid import Axis
from .messages import describe_error, format_place, to_toml_values

Finite = Annotated[float, Field(ge=-LARGEST, le=LARGEST, allow_inf_nan=False)]
Vector = Annotated[list[Finite], Field(min_length=3, max_length=3)]
Positive = Annotated[float, Field(ge=1e-9, le=LARGEST, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, le=LARGEST, allow_inf_nan=False)]
Count = Annotated[int, Field(ge=1, le=10_000_000)]  # of configurations: what a computer holds
Name = Annotated[str, AfterValidator(as_name)]
FileName = Annotated[str, Field(min_length=1, max_length=4000, pattern=r"^[^\x00-\x1f\x7f]+$")]


class _Table(BaseModel):
    model_config = ConfigDict(
        extra="forbid", frozen=True, strict=True, arbitrary_types_allowed=True
    )


class RobotTable(_Table):
    """[robot]: which nominal robot, where its target is, whether the tracker's frame is to be
    found. From Python `nominal` may be the Robot itself."""

    nominal: Robot | None = Field(
        default=None, description="The nominal robot itself; from Python only."
    )
    name: str | None = Field(default=None, description="Name of a built-in robot.")
    file: FileName | None = Field(
        default=None, description="Robot file: TOML or URDF, beside the study."
    )
    base: str | None = Field(default=None, description="Link of a URDF where the chain begins.")
    tip: str | None = Field(default=None, description="Link of a URDF where the chain ends.")
    tool_mm: Vector | None = Field(
        default=None,
        description="Nominal target in the flange frame [mm]; the first guess with register.",
    )
    tools_mm: dict[Name, Vector] | None = Field(
        default=None, description="Nominal target per target's name, in the flange frame [mm]."
    )
    register_: bool | Literal["per group"] = Field(
        default=False,
        alias="register",
        description="Find tracker frame and target offsets from the estimation configurations; "
        '"per group": one tracker placement per group.',
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
        if [self.nominal, self.name, self.file].count(None) != 2:
            raise ValueError('give either name = "…" (built in) or file = "robot.toml"')
        if self.file is None and (self.base or self.tip):
            raise ValueError(
                'base and tip name links of a URDF: file = "robot.urdf" goes with them'
            )
        if self.tool_mm is not None and self.tools_mm is not None:
            raise ValueError("give tool_mm, or [robot.tools_mm] with a line per target, not both")
        if not self.register_ and self.tool_mm is None and self.tools_mm is None:
            raise ValueError(
                "tool_mm is missing: the nominal target in the flange frame (or register = true to find it)"
            )
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
            if key != "nominal"
        }
        return rest if robot is None else rest | {"nominal": robot_record(robot)}


@dataclass(frozen=True)
class HeldFrame:
    """A DataFrame as it was when the study was described; two are equal where their cells are."""

    sha256: str
    frame: Any = field(compare=False, repr=False)


class FeatureTable(_Table):
    """[measurements.features.NAME]: what is known of an anchor, a sphere, a point or a plane;
    `estimate`: a first guess only."""

    position_mm: Vector | None = Field(
        default=None,
        description="Where it is, in the tracker's frame [mm]; of a plane any of its points.",
    )
    normal: Vector | None = Field(
        default=None, description="Normal of a plane, in the tracker's frame."
    )
    length_mm: Positive | None = Field(default=None, description="Length of a ball-bar [mm].")
    estimate: bool = Field(
        default=False, description="Whether the numbers given are a first guess only."
    )
    zero: Literal["known", "unknown"] = Field(
        default="known",
        description='"unknown": the wire\'s reading leaves out a length that is fitted.',
    )


class MeasurementsTable(_Table):
    """[measurements]: the file, names that differ from the contract's, what is known of features
    that rows share. From Python `frame` may be a DataFrame in the file's place; a path or a
    DataFrame alone stands for the table."""

    file: FileName = Field(description="CSV or Parquet file, beside the study or in MODELSEL_DATA.")
    frame: HeldFrame | None = Field(  # its hash is that of the data
        default=None, exclude=True, description="A DataFrame in the file's place; from Python only."
    )
    columns: dict[str, str] = Field(default={}, description="Contract name = name in the file.")
    features: dict[Name, FeatureTable] = Field(
        default={}, description="What is known of the features that rows share, by name."
    )

    @model_serializer(mode="wrap")
    def _since(self, plain: Plain) -> dict[str, Any]:
        """Write, and hash, a study without features as it was before there were any."""
        written: dict[str, Any] = plain(self)
        if not written.get("features"):
            written.pop("features", None)
        return written

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
            raise ValueError(
                f"expected a file or a pandas DataFrame, found {type(table['frame']).__name__}"
            )
        frame = table["frame"].copy()
        return {**table, "file": "DataFrame", "frame": HeldFrame(hash_source(frame), frame)}


class SplitTable(_Table):
    """[split]: how many configurations estimate, or the column that says which."""

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
        description="Folds over which the whole procedure is repeated; 0: none.",
    )

    @model_validator(mode="after")
    def _one_way(self) -> SplitTable:
        if self.estimation is not None and self.column is not None:
            raise ValueError('give estimation = N or column = "…", not both')
        if self.nested_folds == 1:
            raise ValueError("nested_folds = 1 is no fold; 0 (none) or 2 and more")
        return self


class ModelTable(_Table):
    """[model]: what is always in, what may extend it, which ladder to report."""

    base: list[str] = Field(
        default=["geometric"], description="Mechanisms that are always in the model."
    )
    candidates: Literal["all"] | list[str] = Field(
        default="all", description="Mechanisms that may extend it; [] = fit the base alone."
    )
    ladder: list[list[str]] = Field(
        default=[], description="Models to report, besides the chosen one."
    )


class ComparisonTable(_Table):
    """[comparison]: folds of the cross-validation, what they keep whole, how many mechanisms the
    table of subsets is made of."""

    folds: int = Field(default=10, ge=2, description="Folds of the cross-validation.")
    by: Literal["configuration", "group"] = Field(
        default="configuration", description="What a fold keeps whole."
    )
    mechanisms: Annotated[int, Field(ge=1, le=64)] | None = Field(
        default=None, description="Number of mechanisms that the table of subsets is made of."
    )

    @model_serializer(mode="wrap")
    def _since(self, plain: Plain) -> dict[str, Any]:
        """Write a study without what earlier ones did not have: their hash stays."""
        written: dict[str, Any] = plain(self)
        if written.get("mechanisms") is None:
            written.pop("mechanisms", None)
        return written


class NoiseTable(_Table):
    """[noise]: a known floor, or the instrument."""

    floor_mm: Positive | None = Field(
        default=None, description="Known standard uncertainty of one coordinate [mm]."
    )
    range_mm: NonNegative = Field(
        default=0.0, description="Uncertainty of the tracker's range [mm]."
    )
    range_ppm: NonNegative = Field(
        default=0.0, description="The same, in proportion to the range [ppm]."
    )
    angle_urad: NonNegative = Field(default=0.0, description="Uncertainty of its angles [µrad].")
    tracker_mm: Vector = Field(
        default=[0.0, 0.0, 0.0], description="Where the tracker stands [mm]."
    )

    @property
    def instrument(self) -> bool:
        """Whether an instrument is described."""
        numbers = (self.range_mm, self.range_ppm, self.angle_urad)
        return any(numbers)


class SamplingTable(_Table):
    """[sampling]: what emcee samples."""

    over: Literal["default", "all"] = Field(
        default="default",
        description='Parameters that are sampled; "all": every parameter of the model.',
    )


class EffectTable(_Table):
    """[[simulate.effect]]: one planted screw."""

    frame: int = Field(ge=1, description="Frame: 1..n for the joints, n+1 for the target.")
    axis: Axis = Field(description="Axis of that frame.")
    cause: str = Field(description="What scales the effect: a formula of causes.")
    size: Finite = Field(description="Size, in mm or rad per unit of the cause.")


class SimulateTable(_Table):
    """[simulate]: what `modelsel simulate` makes; without a measurements file the configurations
    are drawn."""

    configurations: Count = Field(
        default=200, description="Number of configurations that are drawn."
    )
    noise_mm: NonNegative = Field(default=0.06, description="Noise of one coordinate [mm].")
    effect: list[EffectTable] = Field(default=[], description="Effects to plant.")


class Study(_Table):
    """A study, checked. From Python its tables are those of the file, as keyword arguments:
    `Study(name="…", robot={…}, …)`. Raises StudyError with every problem."""

    name: Name = Field(description="Name of the study.")
    seed: int = Field(
        default=0, ge=0, description="The one seed; every random choice derives from it."
    )
    robot: RobotTable = Field(description="The nominal robot and its target.")
    measurements: MeasurementsTable = Field(description="What was measured.")
    split: SplitTable = Field(
        default=SplitTable(), description="Estimation and held-out configurations."
    )
    model: ModelTable = Field(default=ModelTable(), description="Base model and candidates.")
    comparison: ComparisonTable = Field(default=ComparisonTable(), description="Cross-validation.")
    noise: NoiseTable = Field(default=NoiseTable(), description="Noise floor, or the instrument.")
    sampling: SamplingTable = Field(default=SamplingTable(), description="Posterior sampling.")
    simulate: SimulateTable = Field(default=SimulateTable(), description="What `simulate` makes.")

    def __init__(self, /, **tables: Any) -> None:
        try:
            super().__init__(**to_toml_values(tables))
        except ValidationError as error:
            sentences = [_describe_problem(problem) for problem in error.errors()]
            raise StudyError(*dict.fromkeys(sentences)) from None

    def with_measurements(self, measurements: Any) -> Study:
        """Return the same study of other measurements: a path, a DataFrame or a table. Raises
        StudyError."""
        return Study(
            **{name: getattr(self, name) for name in Study.model_fields}
            | {"measurements": measurements}
        )


def _list_known_keys(location: Sequence[Any]) -> list[str]:
    """List the keys that a table of the study file may have."""
    table: type[BaseModel] = Study
    for part in location:
        if isinstance(part, int):
            continue
        if table is MeasurementsTable and part == "features":
            return list(FeatureTable.model_fields)
        inner = _find_inner_table(table, part)
        if inner is None:
            return []
        table = inner
    return [field.alias or name for name, field in table.model_fields.items()]


def _find_inner_table(table: type[BaseModel], key: str) -> type[BaseModel] | None:
    """Find the model of a table's key; None where its value is no table."""
    field = table.model_fields.get(key)
    annotation: Any = None if field is None else field.annotation
    if annotation == list[EffectTable]:
        return EffectTable
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return None


def _is_union_tag(part: Any) -> bool:
    """Whether a part of pydantic's location names an alternative of a type, not a key."""
    if not isinstance(part, str):
        return False
    plain_types = ("bool", "str", "float", "int")
    is_generic = part.startswith(("literal", "list["))
    return part in plain_types or is_generic


def _describe_problem(error: Any) -> str:
    """Describe a problem of pydantic's by its place in the study file."""
    kind = error["type"]
    location = [part for part in error["loc"] if not _is_union_tag(part)]
    place = format_place(location)
    if kind == "missing":
        return f"{place} is missing."
    if kind != "extra_forbidden":
        description = describe_error(error)
        return f"{place}: {description}."
    *table_location, key = location
    known_keys = _list_known_keys(table_location)
    hint = suggest(str(key), known_keys)
    table = "the study file"
    table_place, _, _ = place.rpartition(".")
    if table_place:
        table = f"[{table_place}]"
    return f'{table}: unknown key "{key}". {hint}'


def parse_study(text: str, where: str) -> Study:
    """Read a study from TOML text. Raises StudyError with every problem and its place in
    `where`."""
    table = parse_toml(text, where)
    try:
        return Study(**table)
    except StudyError as error:
        raise StudyError(*(f"{where}: {problem}" for problem in error.problems)) from None
    except RecursionError:
        raise StudyError(
            f"{where}: nested too deeply. Tables of a few levels are expected."
        ) from None


def read_study(path: Path | str) -> Study:
    """Read a study file; a folder stands for its study.toml. Raises StudyError."""
    path = Path(path)
    if path.is_dir():
        path = path / "study.toml"
    text = read_text(path, "the study file")
    return parse_study(text, path.name)


def find_data(name: str, beside: Path) -> Path:
    """Find the measurements file: beside the study, else under MODELSEL_DATA; the path beside the
    study where neither has it."""
    folders = [beside]
    data_folder = os.environ.get("MODELSEL_DATA")
    if data_folder:
        folders.append(Path(data_folder))
    folders += _list_shared_folders(beside)
    for folder in folders:
        path = folder / name
        if path.is_file():
            return path
    return beside / name


def find_source(study: Study, folder: Path) -> Source:
    """Find a study's measurements: the DataFrame it holds, else the file."""
    measurements = study.measurements
    held = measurements.frame
    if held is not None:
        return held.frame
    return find_data(measurements.file, folder)


def _list_shared_folders(beside: Path) -> list[Path]:
    """List where the public data of a checkout may be, shared/data, which stands beside the
    project."""
    folder = beside.resolve()
    shared_folders = []
    for parent in folder.parents:
        shared = parent / "shared"
        shared_folders.append(shared / "data")
    return shared_folders
