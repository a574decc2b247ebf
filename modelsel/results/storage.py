"""A result in its folder: result.json, details.json, calibration.json and residuals.parquet,
written and read back."""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .._files import write_all
from .._json import misfit, strict
from .._json import read as text
from ..calibration.calibration import Calibration, calibrate
from ..calibration.loading import load_calibration
from ..calibration.refitting import refit_forms
from ..calibration.storage import CALIBRATION_FILE, calibration_text
from ..exceptions import StudyError
from ..measurements.table import damaged
from .details import details
from .details import dumps as compact
from .result import Result
from .schema import DETAILS, RESULT, disagreement
from .tables import Views

if TYPE_CHECKING:
    import pandas as pd

RESIDUALS = "residuals.parquet"
WRITES = (
    RESIDUALS,
    "details.json",
    CALIBRATION_FILE,
    "result.json",
)  # the last says that all are there
SAME_RUN = ("data_sha256", "study_sha256")


@dataclass(frozen=True, eq=False, repr=False)
class StoredResult(Views):
    """A result read back from its folder: what was written, to look at, to draw, to compensate
    with. The fits and draws behind it belong to the run: `run` the study again for these."""

    content: Mapping[str, Any]  # of result.json
    details: Mapping[str, Any]
    calibration: Calibration
    table: pd.DataFrame | None

    @property
    def record(self) -> Mapping[str, Any]:
        """result.json's content."""
        return self.content

    def residuals(self) -> pd.DataFrame:
        """As of the result that was saved. Raises StudyError where the folder has none."""
        if self.table is None:
            raise StudyError(
                f"there was no {RESIDUALS} in the folder: run the study again to write one."
            )
        return self.table


def calibration_of(result: Result | StoredResult) -> Calibration:
    """The chosen model as a calibration that can be stored, exported and compensated with."""
    if isinstance(result, StoredResult):
        return result.calibration
    fitted, data = result.chosen.fit, result.data
    made = calibrate(
        result.study.name,
        data,
        fitted,
        result.floor,
        result.chosen.held_out.rms_mm,
        bool(result.study.robot.register_),
        result.provenance,
    )
    return replace(made, refits=refit_forms(data, fitted, result.ladder))


def _details(result: Result | StoredResult) -> str:
    """details.json's text."""
    return compact(dict(result.details) if isinstance(result, StoredResult) else details(result))


def save(result: Result | StoredResult, folder: Path | str) -> list[Path]:
    """Write a result into a folder: result.json, details.json, calibration.json and
    residuals.parquet, all whole before the first takes its place; `load_result` reads them back.
    Files written. Raises StudyError."""
    made = {
        RESIDUALS: _parquet(result),
        "details.json": _details(result).encode(),
        CALIBRATION_FILE: calibration_text(calibration_of(result)).encode(),
        "result.json": result.to_json().encode(),
    }
    write_all(
        Path(folder), {name: content for name in WRITES if (content := made[name]) is not None}
    )
    return [Path(folder) / name for name in WRITES if made[name] is not None]


def load_result(folder: Path | str) -> StoredResult:
    """A result from the folder that `save` or `modelsel study` wrote it into (or the result.json
    there). Raises StudyError."""
    folder = Path(folder)
    folder = folder.parent if folder.name == "result.json" else folder
    source = read(folder)
    calibration = load_calibration(folder)
    _one_run(calibration.provenance, source.result, folder, CALIBRATION_FILE)
    table = None
    if (folder / RESIDUALS).exists():
        counts = source.result["configurations"]
        table, of = _read_parquet(folder / RESIDUALS, counts["estimation"] + counts["held_out"])
        _one_run(of, source.result, folder, RESIDUALS)
    return StoredResult(source.result, source.details, calibration, table)


def _one_run(there: Mapping[str, Any], result: Mapping[str, Any], folder: Path, name: str) -> None:
    if any(there.get(key) != result["provenance"].get(key) for key in SAME_RUN):
        raise StudyError(
            f"{folder}: {name} belongs to another run than result.json; modelsel study STUDY.toml --out DIR makes "
            "it anew."
        )


def _parquet(result: Result | StoredResult) -> bytes | None:
    """residuals.parquet, with the hashes of its run; None where a stored result has none."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    if not isinstance(result, StoredResult):
        columns = result.residual_columns()
    elif result.table is None:
        return None
    else:
        columns = {"row": result.table.index.to_numpy()} | {
            n: result.table[n].to_numpy() for n in result.table.columns
        }
    run = {key: result.record["provenance"][key] for key in SAME_RUN}
    out = io.BytesIO()
    table = pa.Table.from_arrays(
        [_arrow(values) for values in columns.values()], names=list(columns)
    )
    pq.write_table(table.replace_schema_metadata(run), out, compression="zstd")
    return out.getvalue()


def _arrow(values: NDArray[Any]) -> Any:
    """Truths, whole numbers or floats as an Arrow array; pa.array would import pandas, a tenth of a
    study's time."""
    import pyarrow as pa

    if values.dtype.kind == "b":
        bits = np.packbits(values, bitorder="little").tobytes()
        return pa.Array.from_buffers(pa.bool_(), len(values), [None, pa.py_buffer(bits)])
    kind = pa.int64() if values.dtype.kind == "i" else pa.float64()
    exact = np.ascontiguousarray(values, np.int64 if values.dtype.kind == "i" else np.float64)
    return pa.Array.from_buffers(kind, len(exact), [None, pa.py_buffer(exact.tobytes())])


def _read_parquet(path: Path, rows: int) -> tuple[pd.DataFrame, dict[str, str]]:
    """The table, of so many rows at least, and the hashes of its run. Raises StudyError."""
    import pandas as pd
    import pyarrow.parquet as pq

    try:
        table = pq.read_table(path, use_threads=False, partitioning=None)
        columns = {name: table.column(name).to_numpy() for name in table.column_names}
        of = {k.decode(): v.decode() for k, v in (table.schema.metadata or {}).items()}
        _whole(columns, rows)
        index = pd.Index(columns.pop("row"), name="row")
    except damaged() as error:
        why = (
            str(error) if isinstance(error, _Damaged) else "it is no Parquet file, or a damaged one"
        )
        raise StudyError(f"{path}: cannot be read: {why}. Run the study again.") from None
    return pd.DataFrame(columns, index=index), of


class _Damaged(ValueError):
    """Says what is not there."""


def _whole(columns: Mapping[str, NDArray[Any]], rows: int) -> None:
    """Whether every column of residuals.parquet is there, of its type, its numbers finite. Raises
    _Damaged."""
    truths, whole = ("estimation", "outlier"), {"row": "i", "estimation": "b", "outlier": "b"}
    names = [
        *whole,
        *(f"{rung}_{axis}_mm" for rung in ("nominal", "base", "chosen") for axis in "xyz"),
    ]
    if missing := [name for name in names if name not in columns]:
        raise _Damaged(f"column {missing[0]} is missing")
    for name, values in columns.items():
        if (
            values.dtype.kind != whole.get(name, "f")
            or name not in truths
            and not np.isfinite(values).all()
        ):
            raise _Damaged(
                f"column {name} holds something else than {'truths' if name in truths else 'finite numbers'}"
            )
    if len(columns["row"]) < rows or len(set(columns["row"].tolist())) < len(columns["row"]):
        raise _Damaged(
            f"it has {len(columns['row'])} rows, where {rows} different ones are expected"
        )


@dataclass(frozen=True, eq=False)
class Source:
    """What a page is made of: result.json and details.json as read, and `draw`, which keeps a
    picture by name."""

    result: dict[str, Any]
    details: dict[str, Any]
    pictures: dict[str, bytes] = field(default_factory=dict)

    def figure(self, name: str, picture: bytes, caption: str, alt: str) -> dict[str, Any]:
        """A picture with a caption that says what to see and a text for those who cannot."""
        self.pictures[f"{name}.svg"] = picture
        return {"kind": "figure", "file": f"{name}.svg", "caption": caption, "alt": alt}


SCHEMA = 1


def read(folder: Path) -> Source:
    """result.json and details.json of a folder, whole and of one run. Raises StudyError with how to
    make them."""
    again = "modelsel study STUDY.toml --out DIR makes it"
    found = list[dict[str, Any]]()
    for name, shape in (("result.json", RESULT), ("details.json", DETAILS)):
        try:
            table = strict(text(folder / name))
            if (
                not isinstance(table, dict)
                or table.get("schema") != SCHEMA
                or table.get("schema") is True
            ):
                version = table.get("schema") if isinstance(table, dict) else None
                raise StudyError(
                    f"{folder / name}: schema {str(version)[:40]}, this modelsel draws schema {SCHEMA}; {again} "
                    "anew."
                )
            if found and any(
                found[0]["provenance"][key] != table.get(key)
                for key in ("data_sha256", "study_sha256")
            ):
                raise StudyError(
                    f"{folder}: details.json belongs to another run than result.json; {again} anew."
                )
            if (why := misfit(table, shape)) is not None:
                raise ValueError(f"damaged: {why}")
        except FileNotFoundError:
            raise StudyError(f"{folder}: there is no {name}; {again}.") from None
        except ValueError as error:
            raise StudyError(f"{folder / name}: cannot be read: {error}; {again} anew.") from None
        found.append(table)
    result, more = found
    if (why := disagreement(result, more)) is not None:
        raise StudyError(f"{folder}: {why}; {again} anew.")
    return Source(result, more)
