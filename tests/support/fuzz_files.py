"""Broken study, robot and fleet files (TOML): keys, values, structure, bytes."""

from __future__ import annotations

import copy
import json
import math
import tomllib
from collections.abc import Iterator
from typing import Any

import numpy as np
from fuzz_tables import bytes_broken
from fuzz_words import ANY, REFUSED, SAME, Mutant

Table = dict[str, Any]
VALUES: tuple[Any, ...] = (
    -1,
    0,
    1,
    2,
    10**9,
    10**18,
    10**30,
    10**400,
    -(10**30),
    2**63,
    0.5,
    -0.0,
    1e308,
    -1e308,
    5e-324,
    math.nan,
    math.inf,
    -math.inf,
    True,
    False,
    "",
    " ",
    "a",
    "1",
    "all",
    "\0",
    "a\0b",
    "\n",
    "🤖",
    "../..",
    "../measurements.csv",
    "/etc/passwd",
    "/dev/zero",
    "/dev/stdin",
    "/dev/full",
    "/proc/self/mem",
    ".",
    "/",
    "~",
    "http://localhost/x",
    "file:///etc/passwd",
    "\\\\host\\share",
    "C:\\x",
    "measurements.csv/x",
    "a" * 300,
    "a" * 5000,
    "__import__('os').system('touch pwned')",
    "geometric",
    "backlash:3",
    "backlash:99",
    "backlash:-1",
    "backlash:",
    "joint2-twist",
    "[not/a]glob**",
    "**",
    "a:b:c",
    "per group",
    "group",
    "nan",
    [],
    {},
    [[]],
    [{}],
    [1, 2],
    [1, 2, 3],
    [1, 2, 3, 4],
    [0, 0, 0],
    [1e308, 1e308, 1e308],
    [math.nan, 0, 0],
    ["a", "b", "c"],
    ["geometric"],
    ["backlash:3"],
    ["geometric", "geometric"],
    [["geometric"]],
    [True, 1, 2],
    {"a": 1},
    {"a": {"b": {"c": [1]}}},
    {"q1_rad": "x_mm"},
    {"q9_rad": "q1_rad"},
    {"x": "x_mm"},
    {"Q1_rad": "q1_rad"},
)


def toml_of(value: Any) -> str:
    """A table as TOML, its inner tables inline: any nesting, one way."""
    return "".join(f"{json.dumps(k)} = {_inline(v)}\n" for k, v in value.items())


def _inline(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(k)} = {_inline(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_inline, value)) + "]"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=True)
    if isinstance(value, int) and abs(value) > 10**300:
        return ("-" if value < 0 else "") + "9" * 4000  # as Python lets it be written
    return repr(value)


def places(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Where something could be put: every key and every place in a list."""
    for key, inner in (
        value.items()
        if isinstance(value, dict)
        else enumerate(value)
        if isinstance(value, list)
        else ()
    ):
        yield (*path, key)
        yield from places(inner, (*path, key))


def inside(table: Table, path: tuple[Any, ...]) -> Any:
    for key in path:
        table = table[key]
    return table


def toml_mutant(text: str, rng: np.random.Generator) -> Mutant:
    """One or two changes of a table, or of the file's text."""
    if rng.random() < 0.35:
        return _text(text, rng)
    table = copy.deepcopy(tomllib.loads(text))
    done = [change(table, rng) for _ in range(1 + int(rng.random() < 0.3))]
    if len(done) == 1 and done[0][0] == "unknown key":
        return Mutant(done[0][0], toml_of(table).encode(), REFUSED, (2,))
    return Mutant(" + ".join(name for name, _ in done), toml_of(table).encode(), ANY)


def change(table: Table, rng: np.random.Generator) -> tuple[str, str]:
    """One change in place: (what was done, where)."""
    every = list(places(table))
    if not every:
        return "empty", ""
    path = every[int(rng.integers(len(every)))]
    holder, key, what = inside(table, path[:-1]), path[-1], rng.random()
    free = {"columns", "tools_mm"} & set(path[:-1])  # any key is one there
    number = isinstance(holder[key], (int, float)) and not isinstance(holder[key], bool)
    if what < 0.15:
        del holder[key]
        done = "something left out"
    elif what < 0.3 and isinstance(holder, dict) and not free:
        at = int(rng.integers(len(key) + 1))
        holder[key[:at] + ("x", "_", "é", " ", "\0", "S")[int(rng.integers(6))] + key[at:]] = (
            holder.pop(key)
        )
        done = "unknown key"
    elif what < 0.38:
        holder[key] = [holder[key]] if rng.random() < 0.5 else {"a": holder[key]}
        done = "value wrapped"
    elif what < 0.45 and isinstance(holder, list):
        holder.append(copy.deepcopy(holder[key]))
        done = "list longer"
    elif number and what < 0.7:
        v = min(holder[key], 10**300)  # a whole number may be beyond what a real one holds
        holder[key] = [v * 1.01, -v, v * 1e3, v * 1e9, v + 0.5][int(rng.integers(5))]
        done = "number changed"
    else:
        holder[key] = copy.deepcopy(VALUES[int(rng.integers(len(VALUES)))])
        done = "value of another kind"
    return done, str(path)


def _same(text: str, rng: np.random.Generator) -> Mutant:
    ways = (
        text.replace("\n", "\r\n").encode(),
        toml_of(tomllib.loads(text)).encode(),
        b"\xef\xbb\xbf" + text.encode(),
        ("# comment\n" + text + "\n# end").encode(),
        text.rstrip().encode(),
    )
    return Mutant("written another way", ways[int(rng.integers(len(ways)))], SAME)


def _deep(text: str, rng: np.random.Generator) -> Mutant:
    deep = (50, 900, 5000, 100_000)[int(rng.integers(4))]
    key = (
        f"zzz = {'[' * deep}{']' * deep}" if rng.random() < 0.5 else f"{'.'.join(['z'] * deep)} = 1"
    )
    return Mutant("nested deeply", f"{key}\n{text}".encode(), REFUSED, (2,))


def _lines(text: str, rng: np.random.Generator) -> Mutant:
    lines = text.splitlines()
    at, what = int(rng.integers(len(lines))), int(rng.integers(3))
    if what == 0 and "=" in lines[at]:
        return Mutant(
            "key twice", "\n".join([*lines[:at], lines[at], *lines[at:]]).encode(), REFUSED, (2,)
        )
    if what == 1:
        return Mutant("line twice, elsewhere", "\n".join([*lines, lines[at]]).encode())
    return Mutant("line gone", "\n".join(lines[:at] + lines[at + 1 :]).encode())


def _mark(text: str, rng: np.random.Generator) -> Mutant:
    marks, at = "[]{}\"'=#,.\n", int(rng.integers(len(text)))
    return Mutant(
        "a mark put in", (text[:at] + marks[int(rng.integers(len(marks)))] + text[at:]).encode()
    )


def _text(text: str, rng: np.random.Generator) -> Mutant:
    what = int(rng.integers(9))
    make = (_same, _deep, _mark, _lines, _lines, _lines)
    return make[what](text, rng) if what < len(make) else bytes_broken(text.encode(), rng)
