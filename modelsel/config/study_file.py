"""A study: frozen values, from TOML or from Python; every problem is said at once, each with its
place."""

from __future__ import annotations

import os
from collections.abc import Mapping
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
from .._text import read_text, toml
from .._typing import LARGEST
from ..exceptions import StudyError, suggest
from ..measurements.table import Source, digest
from ..robot.files import named, robot_record
from ..robot.kinematics import Robot
from .messages import plain_values, wording

Finite = Annotated[float, Field(ge=-LARGEST, le=LARGEST, allow_inf_nan=False)]
Vector = Annotated[list[Finite], Field(min_length=3, max_length=3)]
Positive = Annotated[float, Field(ge=1e-9, le=LARGEST, allow_inf_nan=False)]
Nought = Annotated[float, Field(ge=0, le=LARGEST, allow_inf_nan=False)]
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

    nominal: Robot | None = None
    name: str | None = None
    file: FileName | None = None
    base: str | None = None
    tip: str | None = None
    tool_mm: Vector | None = None
    tools_mm: dict[Name, Vector] | None = None
    register_: bool | Literal["per group"] = Field(False, alias="register")

    @model_validator(mode="before")
    @classmethod
    def _table(cls, given: Any) -> Any:
        if isinstance(given, (str, Robot)):
            which = f'name = "{given}"' if isinstance(given, str) else "nominal = the Robot"
            raise ValueError(f"expected a table: {which} and tool_mm = [x, y, z]")
        return given

    @model_validator(mode="after")
    def _one_source(self) -> RobotTable:
        if self.nominal is not None:
            named(self.nominal)
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
        """A study's hash takes in a robot given as an object by its numbers."""
        robot = self.nominal
        rest = {
            key: value
            for key, value in plain(self.model_copy(update={"nominal": None})).items()
            if key != "nominal"
        }
        return rest if robot is None else rest | {"nominal": robot_record(robot)}


@dataclass(frozen=True)
class Held:
    """A DataFrame as it was when the study was described; two are equal where their cells are."""

    sha256: str
    frame: Any = field(compare=False, repr=False)


class FeatureTable(_Table):
    """[measurements.features.NAME]: what is known of an anchor, a sphere, a point or a plane;
    `estimate`: a first guess only."""

    position_mm: Vector | None = None
    normal: Vector | None = None
    length_mm: Positive | None = None
    estimate: bool = False
    zero: Literal["known", "unknown"] = "known"


class MeasurementsTable(_Table):
    """[measurements]: the file, names that differ from the contract's, what is known of features
    that rows share. From Python `frame` may be a DataFrame in the file's place; a path or a
    DataFrame alone stands for the table."""

    file: FileName
    frame: Held | None = Field(None, exclude=True)  # its hash is that of the data
    columns: dict[str, str] = {}
    features: dict[Name, FeatureTable] = {}

    @model_serializer(mode="wrap")
    def _since(self, plain: Plain) -> dict[str, Any]:
        """A study without features is written, and hashed, as it was before there were any."""
        return {k: v for k, v in plain(self).items() if k != "features" or v}

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
        return {**table, "file": "DataFrame", "frame": Held(digest(frame), frame)}


class SplitTable(_Table):
    """[split]: how many configurations estimate, or the column that says which."""

    estimation: Annotated[int, Field(ge=1)] | None = None
    column: str | None = None
    held_out: str = "held-out"
    nested_folds: Annotated[int, Field(ge=0, le=1000)] = 0

    @model_validator(mode="after")
    def _one_way(self) -> SplitTable:
        if self.estimation is not None and self.column is not None:
            raise ValueError('give estimation = N or column = "…", not both')
        if self.nested_folds == 1:
            raise ValueError("nested_folds = 1 is no fold; 0 (none) or 2 and more")
        return self


class ModelTable(_Table):
    """[model]: what is always in, what may extend it, which ladder to report."""

    base: list[str] = ["geometric"]
    candidates: Literal["all"] | list[str] = "all"
    ladder: list[list[str]] = []


class ComparisonTable(_Table):
    """[comparison]: folds of the cross-validation, what they keep whole, how many mechanisms the
    table of subsets is made of."""

    folds: Annotated[int, Field(ge=2)] = 10
    by: Literal["configuration", "group"] = "configuration"
    mechanisms: Annotated[int, Field(ge=1, le=64)] | None = None

    @model_serializer(mode="wrap")
    def _since(self, plain: Plain) -> dict[str, Any]:
        """Without what studies before it did not have: their hash stays."""
        return {k: v for k, v in plain(self).items() if k != "mechanisms" or v is not None}


class NoiseTable(_Table):
    """[noise]: a known floor, or the instrument."""

    floor_mm: Positive | None = None
    range_mm: Nought = 0.0
    range_ppm: Nought = 0.0
    angle_urad: Nought = 0.0
    tracker_mm: Vector = [0.0, 0.0, 0.0]

    @property
    def instrument(self) -> bool:
        """Whether an instrument is described."""
        return bool(self.range_mm or self.range_ppm or self.angle_urad)


class SamplingTable(_Table):
    """[sampling]: what emcee samples."""

    over: Literal["default", "all"] = "default"


class EffectTable(_Table):
    """[[simulate.effect]]: one planted screw."""

    frame: Annotated[int, Field(ge=1)]
    axis: Literal["tx", "ty", "tz", "rx", "ry", "rz"]
    cause: str
    size: Finite


class SimulateTable(_Table):
    """[simulate]: what `modelsel simulate` makes; without a measurements file the configurations
    are drawn."""

    configurations: Count = 200
    noise_mm: Nought = 0.06
    effect: list[EffectTable] = []


class Study(_Table):
    """A study, checked. From Python its tables are those of the file, as keyword arguments:
    `Study(name="…", robot={…}, …)`. Raises StudyError with every problem."""

    name: Name
    seed: Annotated[int, Field(ge=0)] = 0
    robot: RobotTable
    measurements: MeasurementsTable
    split: SplitTable = SplitTable()
    model: ModelTable = ModelTable()
    comparison: ComparisonTable = ComparisonTable()
    noise: NoiseTable = NoiseTable()
    sampling: SamplingTable = SamplingTable()
    simulate: SimulateTable = SimulateTable()

    def __init__(self, /, **tables: Any) -> None:
        try:
            super().__init__(**plain_values(tables))
        except ValidationError as error:
            sentences: dict[str, None] = {}
            for problem in error.errors():
                loc = tuple(
                    p
                    for p in problem["loc"]
                    if not (
                        isinstance(p, str)
                        and (
                            p.startswith(("literal", "list["))
                            or p in ("bool", "str", "float", "int")
                        )
                    )
                )
                sentences[_sentence({**problem, "loc": loc})] = None
            raise StudyError(*sentences) from None

    def with_measurements(self, measurements: Any) -> Study:
        """The same study of other measurements: a path, a DataFrame or a table. Raises
        StudyError."""
        return Study(
            **{name: getattr(self, name) for name in Study.model_fields}
            | {"measurements": measurements}
        )


def _known(location: tuple[Any, ...]) -> list[str]:
    """Keys that a table of the study file may have."""
    table: Any = Study
    for part in location:
        if isinstance(part, int):
            continue
        field = table.model_fields.get(part)
        inner = None if field is None else field.annotation
        if inner == list[EffectTable]:
            inner = EffectTable
        if inner == dict[Name, FeatureTable]:
            return list(FeatureTable.model_fields)
        if not (isinstance(inner, type) and issubclass(inner, BaseModel)):
            return []
        table = inner
    return [field.alias or name for name, field in table.model_fields.items()]


def _sentence(error: Any) -> str:
    place = ".".join(
        str(part + 1) if isinstance(part, int) else str(part).removesuffix("_")
        for part in error["loc"]
    )
    if error["type"] == "extra_forbidden":
        where = f"[{place.rpartition('.')[0]}]" if "." in place else "the study file"
        return f'{where}: unknown key "{error["loc"][-1]}". {suggest(str(error["loc"][-1]), _known(error["loc"][:-1]))}'
    if error["type"] == "missing":
        return f"{place} is missing."
    return f"{place}: {wording(error)}."


def parse_study(text: str, where: str) -> Study:
    """A study from TOML text. Raises StudyError with every problem and its place in `where`."""
    table = toml(text, where)
    try:
        return Study(**table)
    except StudyError as error:
        raise StudyError(*(f"{where}: {problem}" for problem in error.problems)) from None
    except RecursionError:
        raise StudyError(
            f"{where}: nested too deeply. Tables of a few levels are expected."
        ) from None


def read_study(path: Path | str) -> Study:
    """A study file; a folder stands for its study.toml. Raises StudyError."""
    path = Path(path)
    path = path / "study.toml" if path.is_dir() else path
    return parse_study(read_text(path, "the study file"), path.name)


def find_data(name: str, beside: Path) -> Path:
    """The measurements file: beside the study, else under MODELSEL_DATA; the path beside the study
    where neither has it."""
    for folder in (
        beside,
        *([Path(root)] if (root := os.environ.get("MODELSEL_DATA")) else []),
        *_shared(beside),
    ):
        if (folder / name).is_file():
            return folder / name
    return beside / name


def data_of(study: Study, folder: Path) -> Source:
    """A study's measurements: the DataFrame it holds, else the file."""
    held = study.measurements.frame
    return find_data(study.measurements.file, folder) if held is None else held.frame


def _shared(beside: Path) -> list[Path]:
    """The public data of a checkout, shared/data, which stands beside the project."""
    return [parent / "shared" / "data" for parent in beside.resolve().parents]
