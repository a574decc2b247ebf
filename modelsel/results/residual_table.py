"""residuals.parquet: the residuals of the nominal, the base and the chosen model, with the hashes of their run."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..exceptions import StudyError
from ..measurements.formats.table import parquet_errors

RESIDUALS = "residuals.parquet"
HASHES = ("data_sha256", "study_sha256")
# numpy's kinds; every other column: floats
KINDS = {"row": "i", "estimation": "b", "outlier": "b", "side_open": "b"}
# columns of KINDS that files of version 0.1.0 do not have
ADDED = ("side_open",)
MODELS = ("nominal", "base", "chosen")

ResidualColumns = Mapping[str, NDArray[Any]]


def pack_residuals(columns: ResidualColumns, run: tuple[str, str]) -> bytes:
    """Return the file's bytes."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    arrays = [_arrow_array(values) for values in columns.values()]
    table = pa.Table.from_arrays(arrays, names=list(columns))
    table = table.replace_schema_metadata(dict(zip(HASHES, run, strict=True)))
    buffer = io.BytesIO()
    pq.write_table(table, buffer, compression="zstd")
    return buffer.getvalue()


def _arrow_array(values: NDArray[Any]) -> Any:
    """Return truths, whole numbers or floats as an Arrow array.

    pa.array would import pandas, a tenth of a study's time."""
    import pyarrow as pa

    if values.dtype.kind == "b":
        bits = np.packbits(values, bitorder="little").tobytes()
        return pa.Array.from_buffers(pa.bool_(), len(values), [None, pa.py_buffer(bits)])
    whole = values.dtype.kind == "i"
    exact = np.ascontiguousarray(values, np.int64 if whole else np.float64)
    kind = pa.int64() if whole else pa.float64()
    return pa.Array.from_buffers(kind, len(exact), [None, pa.py_buffer(exact.tobytes())])


def read_residuals(path: Path, rows: int) -> tuple[dict[str, NDArray[Any]], tuple[object, object]]:
    """Read the columns, of so many rows at least, and the hashes of their run. Raises StudyError."""
    import pyarrow.parquet as pq

    try:
        table = pq.read_table(path, use_threads=False, partitioning=None)
        columns = {name: table.column(name).to_numpy() for name in table.column_names}
        metadata = table.schema.metadata or {}
        hashes = {key.decode(): value.decode() for key, value in metadata.items()}
        _check_columns(columns, rows)
    except parquet_errors() as error:
        is_described = isinstance(error, _DamagedTableError)
        reason = str(error) if is_described else "it is not a Parquet file, or it is damaged"
        raise StudyError(f"{path}: cannot be read: {reason}. Run the study again.") from None
    return columns, (hashes.get(HASHES[0]), hashes.get(HASHES[1]))


class _DamagedTableError(ValueError):
    """What is missing or wrong in residuals.parquet, in words."""


def _check_columns(columns: ResidualColumns, rows: int) -> None:
    """Raise _DamagedTableError unless every column is there, of its type, its numbers finite, the rows distinct."""
    lengths = [f"{model}_{axis}_mm" for model in MODELS for axis in "xyz"]
    expected = [name for name in KINDS if name not in ADDED]
    for name in (*expected, *lengths):
        if name not in columns:
            raise _DamagedTableError(f"column {name} is missing")
    for name, values in columns.items():
        _check_column(name, values)
    count, distinct = len(columns["row"]), len(set(columns["row"].tolist()))
    if count < rows or distinct < count:
        raise _DamagedTableError(f"it has {count} rows, where {rows} different ones are expected")


def _check_column(name: str, values: NDArray[Any]) -> None:
    kind = KINDS.get(name, "f")
    is_sound = values.dtype.kind == kind
    if is_sound and kind != "b":
        is_sound = bool(np.isfinite(values).all())
    if not is_sound:
        expected = "truths" if kind == "b" else "finite numbers"
        raise _DamagedTableError(f"column {name} holds something else than {expected}")
