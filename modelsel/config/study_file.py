"""A study: frozen values, from TOML or from Python; every problem is said at once, each with its
place."""

from __future__ import annotations

import os
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    Field,
    PrivateAttr,
    ValidationError,
    model_serializer,
)
from pydantic import SerializerFunctionWrapHandler as Plain

from .._arguments import check_path
from .._files import STUDY_FILE
from .._text import parse_toml, read_text
from ..exceptions import StudyError, suggest
from ..measurements.formats.table import DataFile, Source
from .campaign_table import CampaignTable
from .covariate_table import CovariateTable, check_covariates, expect_tables
from .frozen_table import FrozenTable
from .messages import (
    describe_value_problem,
    format_place,
    join_alternatives,
    list_single_problems,
    to_toml_values,
)
from .study_tables import (
    ComparisonTable,
    EffectTable,
    FeatureTable,
    MeasurementsTable,
    ModelTable,
    Name,
    NoiseTable,
    OutcomeTable,
    RobotTable,
    SamplingTable,
    SearchTable,
    SimulateTable,
    SplitTable,
)

# endings of tables, which no study file has
TABLE_SUFFIXES = (".csv", ".tsv", ".xlsx", ".xlsm", ".xlsb", ".xls", ".ods", ".parquet", ".pq")


class Study(FrozenTable):
    """A study's settings, validated on creation. From Python, pass the tables of the study file as
    keyword arguments: `Study(name="…", robot={…}, …)`. Raises StudyError with every problem."""

    def __repr__(self) -> str:
        table = self.robot
        robot = table.name or table.file or table.nominal
        file = self.measurements.file
        base = ", ".join(self.model.base)
        name = self.name
        return f"Study {name!r}: {robot}, {file}, base {base}"

    name: Name = Field(description="Name of the study.")
    seed: int = Field(default=0, ge=0, description="Seed from which every random choice derives.")
    robot: RobotTable = Field(description="Nominal robot and its target.")
    measurements: MeasurementsTable = Field(description="Measurements.")
    split: SplitTable = Field(
        default=SplitTable(), description="Estimation and held-out configurations."
    )
    model: ModelTable = Field(default=ModelTable(), description="Base model and candidates.")
    comparison: ComparisonTable = Field(default=ComparisonTable(), description="Cross-validation.")
    noise: NoiseTable = Field(default=NoiseTable(), description="Noise floor, or the instrument.")
    search: SearchTable = Field(
        default=SearchTable(), description="Memory and rows of the search for causes."
    )
    covariate: Annotated[
        list[CovariateTable], BeforeValidator(expect_tables), AfterValidator(check_covariates)
    ] = Field(
        default=[],
        description="Causes of your own: columns of the measurements file, or formulas that contain one.",
    )
    sampling: SamplingTable = Field(default=SamplingTable(), description="Posterior sampling.")
    simulate: SimulateTable = Field(
        default=SimulateTable(), description="Settings of `modelsel simulate`."
    )
    campaign: CampaignTable = Field(
        default=CampaignTable(),
        description="Date, instrument and so on, for the head of the report.",
    )
    _file_name: str = PrivateAttr(default="")

    def __init__(self, /, **tables: Any) -> None:
        try:
            super().__init__(**to_toml_values(tables))
        except ValidationError as error:
            problems = _drop_alternatives(list_single_problems(error.errors()))
            sentences = [_describe_problem(problem) for problem in problems]
            places = [_locate(problem) for problem in problems]
            raise StudyError(*join_alternatives(sentences), places=places) from None

    @model_serializer(mode="wrap")
    def _since(self, plain: Plain) -> dict[str, Any]:
        """Write a study without a table that earlier ones did not have: their hash stays."""
        written: dict[str, Any] = plain(self)
        if self.search == SearchTable():
            written.pop("search", None)
        if not self.covariate:
            written.pop("covariate", None)
        if self.campaign == CampaignTable():
            written.pop("campaign", None)
        return written

    @property
    def file_name(self) -> str:
        """Name of the file that the study was read from; empty for one that was made in Python."""
        return self._file_name

    def __eq__(self, other: object) -> bool:
        """Whether two studies have the same values, whatever file they were read from."""
        return isinstance(other, Study) and dict(self) == dict(other)

    __hash__ = None  # type: ignore[assignment] # its lists have none

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
        if table is SearchTable and part == "outcomes":
            return list(OutcomeTable.model_fields)
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
    if annotation == list[CovariateTable]:
        return CovariateTable
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return None


def _drop_alternatives(problems: Sequence[Any]) -> list[Any]:
    """Leave out what another type of a value would have been, where a part of the value is wrong: a
    list with a number in it is no "all", and was not meant as one."""
    places = [_locate(problem) for problem in problems]
    kept = []
    for problem, place in zip(problems, places, strict=True):
        depth = len(place)
        is_alternative = any(map(_is_union_tag, problem["loc"][-1:]))
        has_deeper = any(len(other) > depth and other[:depth] == place for other in places)
        if not (is_alternative and has_deeper):
            kept.append(problem)
    return kept


def _locate(problem: Any) -> tuple[Any, ...]:
    """Return the keys of a problem's place, without alternatives of a type."""
    return tuple(part for part in problem["loc"] if not _is_union_tag(part))


def _is_union_tag(part: Any) -> bool:
    """Whether a part of pydantic's location names an alternative of a type, not a key."""
    if not isinstance(part, str):
        return False
    plain_types = ("bool", "str", "float", "int")
    is_generic = part.startswith(("literal", "list["))
    return part in plain_types or is_generic


def _describe_problem(error: Any) -> str:
    """Describe a problem of pydantic's by its place in the study file."""
    location = _locate(error)
    place = format_place(location)
    problem = describe_value_problem(error, place)
    if problem is not None:
        return problem
    *table_location, key = location
    known_keys = _list_known_keys(table_location)
    hint = suggest(str(key), known_keys)
    table_place, _, _ = place.rpartition(".")
    table = f"[{table_place}]: " if table_place else ""
    return f'{table}unknown key "{key}". {hint}'


def parse_study(text: str, where: str) -> Study:
    """Read a study from TOML text. Raises StudyError with every problem and its place in
    `where`."""
    table = parse_toml(text, where)
    try:
        study = Study(**table)
        # a table refuses that its values are set, and this is none of them
        BaseModel.__setattr__(study, "_file_name", where)
        return study
    except StudyError as error:
        if not error.places:
            raise
        placed = [f"{where}: {problem}" for problem in error.problems]
        raise StudyError(*placed, places=error.places) from None
    except RecursionError:
        raise StudyError(
            f"{where}: nested too deeply. Tables of a few levels are expected."
        ) from None


def read_study(path: Path | str) -> Study:
    """Read a study file; a folder stands for its study.toml. Raises StudyError."""
    path = check_path(path, "the path of a study file or of its folder")
    if path.is_dir():
        path = path / STUDY_FILE
    refuse_measurements(path, "a study file")
    text = read_text(path, "the study file")
    return parse_study(text, path.name)


def refuse_measurements(path: Path, expected: str) -> None:
    """Refuse a table of measurements in the place of another file, and say how to make a study of it.
    Raises StudyError."""
    is_table = path.suffix.lower() in TABLE_SUFFIXES
    if is_table and path.is_file():
        raise StudyError(
            f"{path.name}: this is a table of measurements, not {expected}. modelsel init "
            f"{shlex.quote(str(path))} --robot NAME writes a study of it."
        )


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
    path = find_data(measurements.file, folder)
    if measurements.sheet is None and measurements.decimal is None and measurements.header:
        return path
    headerless = not measurements.header
    return DataFile(path, measurements.sheet, measurements.decimal, headerless)


def _list_shared_folders(beside: Path) -> list[Path]:
    """List where the public data of a checkout may be, shared/data, which stands beside the
    project."""
    folder = beside.resolve()
    shared_folders = []
    for parent in folder.parents:
        shared = parent / "shared"
        shared_folders.append(shared / "data")
    return shared_folders
