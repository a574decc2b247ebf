"""Broken Parquet files: other types, nulls, groups of rows, names and bytes."""

from __future__ import annotations

import csv
import decimal
import io
from collections.abc import Callable
from typing import Any

import numpy as np
from fuzz_tables import bytes_broken, csv_mutant, grid_of
from fuzz_words import ANY, NAMES, READINGS, REFUSED, SAME, Mutant

from modelsel.results.residual_table import ADDED

Columns = dict[str, Any]


def columns_of(text: str) -> Columns:
    """The table of a CSV, numbers as numbers."""
    header, *rows = grid_of(text)
    out: Columns = {}
    for name, cells in zip(header, zip(*rows, strict=True), strict=True):
        try:
            out[name] = np.array([float(cell) for cell in cells])
        except ValueError:
            out[name] = list(cells)
    return out


def parquet_of(columns: Columns, names: list[str] | None = None, **how: Any) -> bytes:
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pa.table(list(columns.values()), names=names or list(columns))
    out = io.BytesIO()
    pq.write_table(table, out, **how)
    return out.getvalue()


def _one(columns: Columns, rng: np.random.Generator) -> str:
    return str(rng.choice(READINGS[:6]))


def written(columns: Columns, rng: np.random.Generator) -> Mutant:
    how: list[dict[str, Any]] = [
        {"row_group_size": 7},
        {"compression": "zstd"},
        {"compression": "none"},
        {"use_dictionary": True},
        {"version": "1.0"},
        {"data_page_size": 64},
    ]
    return Mutant(
        "written another way", parquet_of(columns, **how[int(rng.integers(len(how)))]), SAME
    )


def holes(columns: Columns, rng: np.random.Generator) -> Mutant:
    import pyarrow as pa

    name = _one(columns, rng)
    values: list[Any] = list(columns[name])
    values[int(rng.integers(len(values)))] = [None, float("nan"), float("inf")][
        int(rng.integers(3))
    ]
    return Mutant(
        "null, nan or inf in a named column",
        parquet_of(columns | {name: pa.array(values, pa.float64())}),
        REFUSED,
        (3,),
    )


def types(columns: Columns, rng: np.random.Generator) -> Mutant:
    """Numbers of a type that holds none, or of a coarser one."""
    import pyarrow as pa

    name, m = str(rng.choice(list(columns))), len(next(iter(columns.values())))
    values: list[Callable[[], Any]] = [
        lambda: pa.array([[1.0, 2.0]] * m),
        lambda: pa.array([{"a": 1.0}] * m),
        lambda: pa.array([b"\xff\x00"] * m),
        lambda: pa.nulls(m),
        lambda: pa.array([True, False] * (m // 2)),
        lambda: pa.array(range(m), pa.timestamp("us")),
        lambda: pa.array([decimal.Decimal("1.5")] * m),
        lambda: pa.array([2**63 - 1] * m),
        lambda: pa.array([2**64 - 1] * m, pa.uint64()),
        lambda: pa.array(np.linspace(0, 1, m).astype(np.float16)),
        lambda: pa.array(["a", "b"] * (m // 2)).dictionary_encode(),
        lambda: pa.array(["x" * 70_000] * m),
        lambda: pa.array(range(m), pa.duration("s")),
        lambda: pa.array([1e308] * m),
        lambda: pa.array([-0.0] * m),
        lambda: pa.array(range(m), pa.date32()),
    ]
    return Mutant(
        "a column of another type",
        parquet_of(columns | {name: values[int(rng.integers(len(values)))]()}),
    )


def single(columns: Columns, rng: np.random.Generator) -> Mutant:
    name = _one(columns, rng)
    return Mutant(
        "a column in single precision", parquet_of(columns | {name: np.float32(columns[name])})
    )


def as_text(columns: Columns, rng: np.random.Generator) -> Mutant:
    name = _one(columns, rng)
    return Mutant(
        "numbers as text",
        parquet_of(columns | {name: [repr(float(v)) for v in columns[name]]}),
        SAME,
    )


def named(columns: Columns, rng: np.random.Generator) -> Mutant:
    names = list(columns)
    names[int(rng.integers(len(names)))] = NAMES[int(rng.integers(len(NAMES)))]
    return Mutant("column renamed", parquet_of(columns, names))


def twice(columns: Columns, rng: np.random.Generator) -> Mutant:
    names = list(columns)
    names[names.index("operator")] = "x_mm"
    return Mutant("a column twice", parquet_of(columns, names), REFUSED, (3,))


def no_rows(columns: Columns, rng: np.random.Generator) -> Mutant:
    return Mutant(
        "no rows", parquet_of({name: values[:0] for name, values in columns.items()}), REFUSED, (3,)
    )


def no_columns(columns: Columns, rng: np.random.Generator) -> Mutant:
    return Mutant("no columns", parquet_of({}), REFUSED, (3,))


TABLES = (
    written,
    holes,
    types,
    types,
    types,
    single,
    as_text,
    named,
    named,
    twice,
    no_rows,
    no_columns,
)


def parquet_mutant(text: str, rng: np.random.Generator) -> Mutant:
    what = rng.random()
    if what < 0.25:
        return bytes_broken(parquet_of(columns_of(text)), rng)
    if what < 0.3:
        return Mutant("a CSV called Parquet", text.encode(), REFUSED, (3,))
    if what < 0.4:  # what was done to a CSV, in a Parquet file
        mutant = csv_mutant(text, rng)
        try:
            return Mutant(
                f"table: {mutant.name}",
                parquet_of(columns_of(mutant.content.decode("utf-8-sig"))),
                ANY,
            )
        except (ValueError, OSError, TypeError, IndexError, csv.Error):
            return Mutant("nothing", b"", REFUSED, (3,))
    return TABLES[int(rng.integers(len(TABLES)))](columns_of(text), rng)


def residuals_mutant(content: bytes, rng: np.random.Generator) -> Mutant:
    """A study's residuals.parquet: other bytes, columns, rows, numbers, another run's."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pq.read_table(io.BytesIO(content))
    k, m = int(rng.integers(table.num_columns)), table.num_rows
    name, numbers = table.column_names[k], table.column(k).to_pylist()

    def with_column(values: Any) -> Any:
        return table.set_column(k, name, pa.array(values))

    # files of version 0.1.0 are read without what was added later
    without = SAME if name in ADDED else REFUSED
    other = {b"data_sha256": b"0" * 64, b"study_sha256": b"\xff\xfe"}
    ways: list[tuple[str, Callable[[], Any], str]] = [
        ("written another way", lambda: table, SAME),
        ("a column gone", lambda: table.drop_columns([name]), without),
        (
            "column renamed",
            lambda: table.rename_columns([c if c != name else f"{c}x" for c in table.column_names]),
            REFUSED,
        ),
        ("numbers as text", lambda: with_column([str(v) for v in numbers]), REFUSED),
        ("lists", lambda: with_column([[v] for v in numbers]), REFUSED),
        ("a null", lambda: with_column([None, *numbers[1:]]), REFUSED),
        ("nothing", lambda: with_column(pa.nulls(m)), REFUSED),
        ("no number", lambda: with_column([float("nan"), *map(float, numbers[1:])]), REFUSED),
        ("infinite", lambda: with_column([float("inf"), *map(float, numbers[1:])]), REFUSED),
        ("no rows", lambda: table.slice(0, 0), REFUSED),
        ("rows gone", lambda: table.slice(0, m // 2), REFUSED),
        ("of no run", lambda: table.replace_schema_metadata({}), REFUSED),
        ("of another run", lambda: table.replace_schema_metadata(other), REFUSED),
        ("no columns", lambda: pa.table({}), REFUSED),
    ]
    if rng.random() < 0.4:
        broken = bytes_broken(content, rng)
        return Mutant(
            broken.name,
            broken.content,
            REFUSED if broken.name == "truncated" else broken.expect,
            (2,),
        )
    what, make, expect = ways[int(rng.integers(len(ways)))]
    out = io.BytesIO()
    pq.write_table(make(), out, compression="none")
    return Mutant(what, out.getvalue(), expect, (2,))
