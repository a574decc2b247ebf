"""The study file: TOML -> frozen values; every problem of a file is said at once, each with its place."""
from __future__ import annotations

import os
import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    SerializerFunctionWrapHandler,
    ValidationError,
    model_serializer,
    model_validator,
)

from ..words.errors import StudyError, suggest

Vector = Annotated[list[Annotated[float, Field(allow_inf_nan=False)]], Field(min_length=3, max_length=3)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class RobotTable(_Table):
    """[robot]: which nominal robot, where its target is, whether the tracker's frame is to be found."""

    name: str | None = None
    file: str | None = None
    base: str | None = None
    tip: str | None = None
    tool_mm: Vector | None = None
    tools_mm: dict[str, Vector] | None = None
    register_: bool | Literal["per group"] = Field(False, alias="register")

    @model_validator(mode="after")
    def _one_source(self) -> RobotTable:
        if (self.name is None) == (self.file is None):
            raise ValueError('give either name = "…" (built in) or file = "robot.toml"')
        if self.file is None and (self.base or self.tip):
            raise ValueError('base and tip name links of a URDF: file = "robot.urdf" goes with them')
        if self.tool_mm is not None and self.tools_mm is not None:
            raise ValueError("give tool_mm, or [robot.tools_mm] with a line per target, not both")
        if not self.register_ and self.tool_mm is None and self.tools_mm is None:
            raise ValueError("tool_mm is missing: the nominal target in the flange frame (or register = true to find it)")
        return self


class FeatureTable(_Table):
    """[measurements.features.NAME]: what is known of an anchor, a sphere, a point or a plane; `estimate`: a first guess only."""

    position_mm: Vector | None = None
    normal: Vector | None = None
    length_mm: Positive | None = None
    estimate: bool = False
    zero: Literal["known", "unknown"] = "known"


class MeasurementsTable(_Table):
    """[measurements]: the file, names that differ from the contract's, what is known of features that rows share."""

    file: str
    columns: dict[str, str] = {}
    features: dict[str, FeatureTable] = {}

    @model_serializer(mode="wrap")
    def _plain(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """A study without features is written, and hashed, as it was before there were any."""
        out: dict[str, Any] = handler(self)
        if not self.features:
            out.pop("features", None)
        return out


class SplitTable(_Table):
    """[split]: how many configurations estimate, or the column that says which."""

    estimation: Annotated[int, Field(ge=1)] | None = None
    column: str | None = None
    held_out: str = "held-out"
    nested_folds: Annotated[int, Field(ge=0)] = 0

    @model_validator(mode="after")
    def _one_way(self) -> SplitTable:
        if self.estimation is not None and self.column is not None:
            raise ValueError("give estimation = N or column = \"…\", not both")
        if self.nested_folds == 1:
            raise ValueError("nested_folds = 1 is no fold; 0 (none) or 2 and more")
        return self


class ModelTable(_Table):
    """[model]: what is always in, what may extend it, which ladder to report."""

    base: list[str] = ["geometric"]
    candidates: Literal["all"] | list[str] = "all"
    ladder: list[list[str]] = []


class ComparisonTable(_Table):
    """[comparison]: folds of the cross-validation, and what they keep whole."""

    folds: Annotated[int, Field(ge=2)] = 10
    by: Literal["configuration", "group"] = "configuration"


class NoiseTable(_Table):
    """[noise]: a known floor, or the instrument."""

    floor_mm: Positive | None = None
    range_mm: Annotated[float, Field(ge=0)] = 0.0
    range_ppm: Annotated[float, Field(ge=0)] = 0.0
    angle_urad: Annotated[float, Field(ge=0)] = 0.0
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
    size: Annotated[float, Field(allow_inf_nan=False)]


class SimulateTable(_Table):
    """[simulate]: what `modelsel simulate` makes; without a measurements file the configurations are drawn."""

    configurations: Annotated[int, Field(ge=1)] = 200
    noise_mm: Annotated[float, Field(ge=0)] = 0.06
    effect: list[EffectTable] = []


class Study(_Table):
    """A study file, checked."""

    name: str
    seed: Annotated[int, Field(ge=0)] = 0
    robot: RobotTable
    measurements: MeasurementsTable
    split: SplitTable = SplitTable()
    model: ModelTable = ModelTable()
    comparison: ComparisonTable = ComparisonTable()
    noise: NoiseTable = NoiseTable()
    sampling: SamplingTable = SamplingTable()
    simulate: SimulateTable = SimulateTable()


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
        if inner == dict[str, FeatureTable]:
            return list(FeatureTable.model_fields)
        if not (isinstance(inner, type) and issubclass(inner, BaseModel)):
            return []
        table = inner
    return [field.alias or name for name, field in table.model_fields.items()]


def _sentence(error: Any) -> str:
    place = ".".join(str(part + 1) if isinstance(part, int) else str(part).removesuffix("_") for part in error["loc"])
    if error["type"] == "extra_forbidden":
        where = f"[{place.rpartition('.')[0]}]" if "." in place else "the study file"
        return f'{where}: unknown key "{error["loc"][-1]}". {suggest(str(error["loc"][-1]), _known(error["loc"][:-1]))}'
    if error["type"] == "missing":
        return f"{place} is missing."
    what = error["msg"].removeprefix("Value error, ")
    found = "" if error["type"] == "value_error" else f", found {str(error['input'])[:60]!r}"
    return f"{place}: {what}{found}."


def parse_study(text: str, where: str) -> Study:
    """A study from TOML text. Raises StudyError with every problem and its place in `where`."""
    try:
        table = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise StudyError(f"{where}: not valid TOML: {error}") from None
    try:
        return Study.model_validate(_floats(table))
    except (ValidationError, RecursionError) as error:
        if isinstance(error, RecursionError):
            raise StudyError(f"{where}: nested too deeply") from None
        sentences: dict[str, None] = {}
        for problem in error.errors():
            loc = tuple(p for p in problem["loc"] if not (isinstance(p, str) and (p.startswith(("literal", "list[")) or p in (
                "bool", "str", "float", "int"))))
            sentences[f"{where}: {_sentence({**problem, 'loc': loc})}"] = None
        raise StudyError(*sentences) from None


def _floats(value: Any) -> Any:
    """Whole numbers inside arrays count as numbers (TOML tells 100 from 100.0; a tool's offset need not)."""
    if isinstance(value, dict):
        return {k: float(v) if isinstance(v, int) and not isinstance(v, bool) and k.endswith(("_mm", "_ppm", "_urad", "size"))
                else _floats(v) for k, v in value.items()}
    if isinstance(value, list) and value and all(isinstance(v, (int, float)) and not isinstance(v, bool) for v in value):
        return [float(v) for v in value]
    return [_floats(v) for v in value] if isinstance(value, list) else value


def read_study(path: Path | str) -> Study:
    """A study file; a folder stands for its study.toml. Raises StudyError."""
    path = Path(path)
    path = path / "study.toml" if path.is_dir() else path
    try:
        return parse_study(path.read_text(encoding="utf-8"), path.name)
    except FileNotFoundError:
        raise StudyError(f"{path}: no such study file") from None
    except (OSError, UnicodeDecodeError) as error:
        raise StudyError(f"{path.name}: cannot be read: {getattr(error, 'strerror', None) or 'it is not UTF-8 text'}") from None


def find_data(name: str, beside: Path) -> Path:
    """The measurements file: beside the study, else under MODELSEL_DATA; the path beside the study where neither has it."""
    for folder in (beside, *([Path(root)] if (root := os.environ.get("MODELSEL_DATA")) else []), *_shared(beside)):
        if (folder / name).is_file():
            return folder / name
    return beside / name


def _shared(beside: Path) -> list[Path]:
    """The public data of a checkout, shared/data, which stands beside the project."""
    return [parent / "shared" / "data" for parent in beside.resolve().parents]
