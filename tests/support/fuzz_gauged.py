"""Broken measurement files whose rows are of several kinds: kinds, features, lengths,
uncertainties, cells that stay empty."""

from __future__ import annotations

import csv
from collections.abc import Callable

import fuzz_tables as tables
import numpy as np
from fuzz_tables import bytes_broken, csv_of, grid_of
from fuzz_words import ANY, NAMES, NO_NUMBERS, NUMBERS, REFUSED, SAME, Grid, Mutant

Make = Callable[[Grid, np.random.Generator], Mutant]
KINDS = ("point", "x", "y", "z", "wire", "ball-bar", "distance", "same-point", "plane")
NAMED = KINDS[4:]
NO_KINDS = (
    "points",
    "Point",
    "WIRE",
    "ball bar",
    "ball_bar",
    "xyz",
    "",
    " ",
    "1",
    "nan",
    "None",
    "🤖",
    "x y",
    "w" * 3000,
)
NO_LENGTHS = (
    "",
    " ",
    "abc",
    "nan",
    "inf",
    "-inf",
    "1e400",
    "0",
    "-3",
    "1,5",
    "1e300",
    "True",
    "1_0",
)
NO_SPREADS = ("", "0", "-1", "nan", "inf", "1e-300", "abc", "1e300")
ANYWHERE = (
    tables.strange_number,
    tables.strange_column,
    tables.strange_text,
    tables.rename,
    tables.without_unit,
    tables.columns_moved,
    tables.headers_swapped,
    tables.column_twice,
    tables.column_gone,
    tables.row_twice,
    tables.rows_few,
    tables.rows_shuffled,
    tables.ragged,
    tables.separators,
    tables.decimal_comma,
    tables.as_people_write,
    tables.encoded,
    tables.extra_columns,
)


def _pick(rng: np.random.Generator, values: tuple[str, ...]) -> str:
    return values[int(rng.integers(len(values)))]


def _row(grid: Grid, rng: np.random.Generator, *kinds: str) -> list[str]:
    """A row of one of some kinds."""
    at = grid[0].index("kind")
    rows = [row for row in grid[1:] if row[at] in kinds]
    return rows[int(rng.integers(len(rows)))]


def no_kind(grid: Grid, rng: np.random.Generator) -> Mutant:
    _row(grid, rng, *KINDS)[grid[0].index("kind")] = _pick(rng, NO_KINDS)
    return Mutant("a kind that is none", csv_of(grid), REFUSED, (3,))


def other_kind(grid: Grid, rng: np.random.Generator) -> Mutant:
    at, word = grid[0].index("kind"), _pick(rng, KINDS)
    rows = [_row(grid, rng, *KINDS)] if rng.random() < 0.6 else grid[1:]
    for row in rows:
        row[at] = word
    return Mutant("another kind", csv_of(grid))


def kinds_alone(grid: Grid, rng: np.random.Generator) -> Mutant:
    """Only rows of one kind, or all but these."""
    at, word, out = grid[0].index("kind"), _pick(rng, KINDS), rng.random() < 0.5
    return Mutant(
        "rows of some kinds gone",
        csv_of([grid[0], *(row for row in grid[1:] if (row[at] == word) != out)]),
    )


def without_kinds(grid: Grid, rng: np.random.Generator) -> Mutant:
    at = grid[0].index("kind")
    return Mutant(
        "the column of kinds gone",
        csv_of([row[:at] + row[at + 1 :] for row in grid]),
        REFUSED,
        (3,),
    )


def no_feature(grid: Grid, rng: np.random.Generator) -> Mutant:
    if rng.random() < 0.5:
        row, name = _row(grid, rng, *NAMED), _pick(rng, ("", " "))
    else:
        row, name = _row(grid, rng, "point", "x", "z"), _pick(rng, ("north", "new", "1"))
    row[grid[0].index("feature")] = name
    return Mutant("a feature too many or too few", csv_of(grid), REFUSED, (3,))


def other_feature(grid: Grid, rng: np.random.Generator) -> Mutant:
    name = _pick(
        rng,
        (
            "north",
            "south",
            "bar",
            "gauge 0",
            "cone",
            "plate",
            *NAMES[:6],
            "x" * 3000,
            "a\nb",
            "🤖",
            "=1+1",
        ),
    )
    _row(grid, rng, *NAMED)[grid[0].index("feature")] = name
    return Mutant("another feature", csv_of(grid))


def no_length(grid: Grid, rng: np.random.Generator) -> Mutant:
    _row(grid, rng, "wire")[grid[0].index("length_mm")] = _pick(rng, NO_LENGTHS)
    return Mutant("a length that is none", csv_of(grid), REFUSED, (3,))


def odd_length(grid: Grid, rng: np.random.Generator) -> Mutant:
    _row(grid, rng, "distance", "ball-bar", "wire")[grid[0].index("length_mm")] = _pick(
        rng, (*NO_LENGTHS, *NUMBERS)
    )
    return Mutant("another length", csv_of(grid))


def filled(grid: Grid, rng: np.random.Generator) -> Mutant:
    """A number in a cell that the row's kind does not use."""
    kind, name = _pick(
        rng, ("wire y_mm", "same-point x_mm", "plane length_mm", "x y_mm", "point length_mm")
    ).split()
    _row(grid, rng, kind)[grid[0].index(name)] = _pick(rng, ("1.5", "abc", "nan?", "0", "-1"))
    return Mutant("a cell filled that measures nothing", csv_of(grid), REFUSED, (3,))


def no_spread(grid: Grid, rng: np.random.Generator) -> Mutant:
    _row(grid, rng, "point", "wire", "plane")[grid[0].index("s_mm")] = _pick(rng, NO_SPREADS)
    return Mutant("an uncertainty that is none", csv_of(grid), REFUSED, (3,))


def spreads(grid: Grid, rng: np.random.Generator) -> Mutant:
    """The uncertainties of all rows: gone, empty, or very small or large."""
    at, value = grid[0].index("s_mm"), _pick(rng, ("", "1e-9", "1e-3", "1e6", "1e9"))
    if rng.random() < 0.3:
        return Mutant("uncertainties gone", csv_of([row[:at] + row[at + 1 :] for row in grid]))
    for row in grid[1:]:
        row[at] = value
    return Mutant("one uncertainty for all", csv_of(grid))


def no_coordinate(grid: Grid, rng: np.random.Generator) -> Mutant:
    kind = _pick(rng, ("point", "x", "z"))
    name = f"{kind}_mm" if kind != "point" else _pick(rng, ("x_mm", "y_mm", "z_mm"))
    _row(grid, rng, kind)[grid[0].index(name)] = _pick(rng, NO_NUMBERS)
    return Mutant("no number in a measured coordinate", csv_of(grid), REFUSED, (3,))


def widened(grid: Grid, rng: np.random.Generator) -> Mutant:
    """Blanks about the words: the same."""
    for row in grid[1:]:
        for name in ("kind", "feature"):
            row[grid[0].index(name)] = f" {row[grid[0].index(name)]} "
    return Mutant("blanks about kinds and features", csv_of(grid), SAME)


OWN: tuple[Make, ...] = (
    no_kind,
    other_kind,
    other_kind,
    kinds_alone,
    without_kinds,
    no_feature,
    other_feature,
    no_length,
    odd_length,
    filled,
    no_spread,
    spreads,
    no_coordinate,
    widened,
)


def gauged_mutant(text: str, rng: np.random.Generator) -> Mutant:
    """One mutation, or two in succession, of what only such files have or of what all tables
    have."""
    if rng.random() < 0.08:
        return bytes_broken(text.encode(), rng)
    some = OWN if rng.random() < 0.7 else ANYWHERE
    mutant = some[int(rng.integers(len(some)))](grid_of(text), rng)
    if rng.random() < 0.2:
        try:
            again = OWN[int(rng.integers(len(OWN)))](grid_of(mutant.content.decode()), rng)
        except (ValueError, IndexError, csv.Error):
            return mutant
        return Mutant(f"{mutant.name} + {again.name}", again.content, ANY)
    return mutant
