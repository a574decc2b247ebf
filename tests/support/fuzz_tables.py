"""Broken measurement files: a mutant of a good table, and what a reader owes it."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable

import numpy as np
from fuzz_words import ANY, NAMES, NO_NUMBERS, NUMBERS, READINGS, REFUSED, SAME, Grid, Mutant


def grid_of(text: str) -> Grid:
    return list(csv.reader(io.StringIO(text)))


def csv_of(grid: Grid, **how: object) -> bytes:
    out = io.StringIO()
    csv.writer(out, **({"lineterminator": "\n"} | how)).writerows(grid)  # type: ignore[arg-type]
    return out.getvalue().encode("utf-8", "surrogatepass")


def _pick(rng: np.random.Generator, values: object) -> str:
    return str(values[int(rng.integers(len(values)))])  # type: ignore[arg-type, index]


def _cell(grid: Grid, rng: np.random.Generator, column: str | None = None) -> tuple[int, int]:
    return int(rng.integers(1, len(grid))), int(
        rng.integers(len(grid[0]))
    ) if column is None else grid[0].index(column)


def no_number(grid: Grid, rng: np.random.Generator) -> Mutant:
    row, column = _cell(grid, rng, _pick(rng, READINGS))
    grid[row][column] = _pick(rng, NO_NUMBERS)
    return Mutant("no number in a named column", csv_of(grid), REFUSED, (3,))


def strange_number(grid: Grid, rng: np.random.Generator) -> Mutant:
    row, column = _cell(grid, rng)
    grid[row][column] = _pick(rng, NUMBERS)
    return Mutant("strange number in a cell", csv_of(grid))


def strange_column(grid: Grid, rng: np.random.Generator) -> Mutant:
    _, column = _cell(grid, rng)
    value = _pick(rng, (*NUMBERS, *NO_NUMBERS))
    for row in grid[1:]:
        row[column] = value
    return Mutant("one value in a whole column", csv_of(grid))


def strange_text(grid: Grid, rng: np.random.Generator) -> Mutant:
    row, column = _cell(grid, rng, _pick(rng, ("group", "operator", "payload_kg")))
    grid[row][column] = _pick(rng, (*NO_NUMBERS, *NUMBERS, *NAMES))
    return Mutant("strange text in a cell", csv_of(grid))


def rename(grid: Grid, rng: np.random.Generator) -> Mutant:
    grid[0][int(rng.integers(len(grid[0])))] = _pick(rng, NAMES)
    return Mutant("column renamed", csv_of(grid))


def other_unit(grid: Grid, rng: np.random.Generator) -> Mutant:
    """Metres called millimetres, or the other way; degrees called radians: the values say otherwise
    than the names."""
    what = int(rng.integers(3))
    for k, name in enumerate(list(grid[0])):
        if what == 0 and name in ("x_mm", "y_mm", "z_mm"):
            grid[0][k] = name.replace("mm", "m")
        elif (what == 1 and name in ("x_mm", "y_mm", "z_mm")) or (
            what == 2 and name.startswith("q")
        ):
            for row in grid[1:]:
                row[k] = repr(float(row[k]) * (1e-3 if what == 1 else 180 / np.pi))
    return Mutant("values in another unit than the name's", csv_of(grid), REFUSED, (3,))


def converted(grid: Grid, rng: np.random.Generator) -> Mutant:
    """Name and values both: the same measurements."""
    column = int(rng.integers(6))
    grid[0][column], factor = (
        (grid[0][column].replace("rad", "deg"), 180 / np.pi)
        if column < 3
        else (grid[0][column].replace("mm", "m"), 1e-3)
    )
    for row in grid[1:]:
        row[column] = repr(float(row[column]) * factor)
    return Mutant("unit converted, name and values", csv_of(grid), SAME)


def without_unit(grid: Grid, rng: np.random.Generator) -> Mutant:
    column = int(rng.integers(6))
    grid[0][column] = grid[0][column].partition("_")[0]
    return Mutant("unit left out of a name", csv_of(grid), REFUSED, (3,))


def columns_moved(grid: Grid, rng: np.random.Generator) -> Mutant:
    order = rng.permutation(len(grid[0]))
    return Mutant(
        "columns in another order", csv_of([[row[k] for k in order] for row in grid]), SAME
    )


def headers_swapped(grid: Grid, rng: np.random.Generator) -> Mutant:
    a, b = rng.choice(len(grid[0]), 2, replace=False)
    grid[0][a], grid[0][b] = grid[0][b], grid[0][a]
    return Mutant("two names exchanged", csv_of(grid))


def column_twice(grid: Grid, rng: np.random.Generator) -> Mutant:
    column = int(rng.integers(len(grid[0])))
    return Mutant("a column twice", csv_of([[*row, row[column]] for row in grid]), REFUSED, (3,))


def column_gone(grid: Grid, rng: np.random.Generator) -> Mutant:
    column = int(rng.integers(len(grid[0])))
    named = grid[0][column] in READINGS and grid[0][column] != "order"
    return Mutant(
        "a column gone",
        csv_of([row[:column] + row[column + 1 :] for row in grid]),
        REFUSED if named else ANY,
    )


def row_twice(grid: Grid, rng: np.random.Generator) -> Mutant:
    return Mutant("a row twice", csv_of([*grid, grid[int(rng.integers(1, len(grid)))]]), SAME)


def rows_few(grid: Grid, rng: np.random.Generator) -> Mutant:
    return Mutant("few rows left", csv_of(grid[: 1 + int(rng.integers(0, len(grid) - 1))]))


def rows_alike(grid: Grid, rng: np.random.Generator) -> Mutant:
    """Few distinct readings, many repeats of them."""
    few = int(rng.integers(1, 6))
    for k, row in enumerate(grid[1:]):
        row[:3] = grid[1 + k % few][:3]
    return Mutant("few distinct readings", csv_of(grid))


def rows_shuffled(grid: Grid, rng: np.random.Generator) -> Mutant:
    return Mutant(
        "rows in another order",
        csv_of([grid[0], *(grid[1 + int(k)] for k in rng.permutation(len(grid) - 1))]),
    )


def ragged(grid: Grid, rng: np.random.Generator) -> Mutant:
    row = grid[int(rng.integers(1, len(grid)))]
    if rng.random() < 0.5:
        row.append("1")
    else:
        row.pop()
    return Mutant("a row with a cell more or fewer", csv_of(grid), REFUSED, (3,))


def separators(grid: Grid, rng: np.random.Generator) -> Mutant:
    """As spreadsheets of other countries write it: the same numbers, only that is said."""
    mark = _pick(rng, (";", "\t", "|"))
    if rng.random() < 0.5:
        grid = [grid[0], *([cell.replace(".", ",") for cell in row] for row in grid[1:])]
    return Mutant("another separator", csv_of(grid, delimiter=mark))


def decimal_comma(grid: Grid, rng: np.random.Generator) -> Mutant:
    grid = [grid[0], *([cell.replace(".", ",") for cell in row] for row in grid[1:])]
    return Mutant("decimal commas", csv_of(grid))


def as_people_write(grid: Grid, rng: np.random.Generator) -> Mutant:
    """Byte-order mark, CRLF, quotes, blanks, an end without newline, blank lines at the end: the
    same file."""
    what = int(rng.integers(7))
    plain = csv_of(grid)
    content = [
        b"\xef\xbb\xbf" + plain,
        plain.replace(b"\n", b"\r\n"),
        csv_of(grid, quoting=csv.QUOTE_ALL),
        plain.rstrip(b"\n"),
        plain + b"\n\n\n",
        csv_of([[f" {cell} " for cell in row] for row in grid]),
        plain.replace(b"\n", b"\r"),
    ][what]
    return Mutant("written another way", content, SAME)


def encoded(grid: Grid, rng: np.random.Generator) -> Mutant:
    how = _pick(rng, ("utf-16", "utf-32", "utf-16-le", "cp500", "latin-1"))
    grid[1][grid[0].index("operator")] = "Zoë"
    content = csv_of(grid).decode().encode(how)
    if how == "cp500":
        return Mutant(f"encoded as {how}", content, REFUSED, (3,))
    return Mutant(f"encoded as {how}", content)


def bytes_broken(content: bytes, rng: np.random.Generator) -> Mutant:
    what = int(rng.integers(5))
    at = int(rng.integers(max(len(content), 1)))
    noise = rng.integers(0, 256, int(rng.integers(1, 9))).astype(np.uint8).tobytes()
    if what == 0:
        return Mutant("truncated", content[:at])
    if what == 1:
        return Mutant("bytes overwritten", content[:at] + noise + content[at + len(noise) :])
    if what == 2:
        return Mutant("bytes inserted", content[:at] + noise + content[at:])
    if what == 3:
        return Mutant("bytes left out", content[:at] + content[at + len(noise) :])
    return Mutant(
        "nothing but noise",
        rng.integers(0, 256, int(rng.integers(0, 4000))).astype(np.uint8).tobytes(),
        REFUSED,
    )


def extra_columns(grid: Grid, rng: np.random.Generator) -> Mutant:
    """Columns of the contract that are optional, with whatever in them; or very many."""
    sets = (
        ["sx_mm", "sy_mm", "sz_mm"],
        ["qw", "qx", "qy", "qz"],
        ["approach1", "approach2", "approach3"],
        ["target"],
        ["configuration"],
        ["srx_rad", "sry_rad", "srz_rad"],
        [f"extra{k}" for k in range(60)],
        ["q4_rad"],
        ["sx_mm"],
    )
    names = sets[int(rng.integers(len(sets)))]
    values = ("1", "-1", "0", "0.05", "1e-300", "1e300", "a", "", "nan", repr(rng.normal()))
    fill = [_pick(rng, values) for _ in names]
    alike = rng.random() < 0.6
    rows = [[*row, *(fill if alike else [_pick(rng, values) for _ in names])] for row in grid[1:]]
    return Mutant("more columns of the contract", csv_of([[*grid[0], *names], *rows]))


def scaled(grid: Grid, rng: np.random.Generator) -> Mutant:
    """Positions moved, scaled, mirrored, collapsed."""
    factor, offset = (
        float(rng.choice([0.0, -1.0, 1e-9, 1e-3, 1.02, 2.0, 1e12])),
        float(rng.choice([0.0, 1.0, 1e4, 1e15])),
    )
    for row in grid[1:]:
        row[3:6] = [repr(float(cell) * factor + offset) for cell in row[3:6]]
    return Mutant("positions moved or scaled", csv_of(grid))


TABLES: tuple[Callable[[Grid, np.random.Generator], Mutant], ...] = (
    no_number,
    no_number,
    strange_number,
    strange_number,
    strange_column,
    strange_text,
    rename,
    other_unit,
    converted,
    without_unit,
    columns_moved,
    headers_swapped,
    column_twice,
    column_gone,
    row_twice,
    rows_few,
    rows_alike,
    rows_shuffled,
    ragged,
    separators,
    decimal_comma,
    as_people_write,
    encoded,
    extra_columns,
    extra_columns,
    scaled,
)


def csv_mutant(text: str, rng: np.random.Generator) -> Mutant:
    """One mutation, or two in succession of a file that can still be read as a table."""
    if rng.random() < 0.15:
        return bytes_broken(text.encode(), rng)
    mutant = TABLES[int(rng.integers(len(TABLES)))](grid_of(text), rng)
    if rng.random() < 0.25:
        try:
            again = TABLES[int(rng.integers(len(TABLES)))](grid_of(mutant.content.decode()), rng)
        except (ValueError, IndexError, KeyError, csv.Error):
            return mutant
        return Mutant(f"{mutant.name} + {again.name}", again.content)
    return mutant
