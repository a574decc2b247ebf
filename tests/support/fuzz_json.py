"""Broken JSON files, such as a study leaves: numbers that are none, keys, structure, bytes."""

from __future__ import annotations

import copy
import json
import math
from typing import Any

import numpy as np
from fuzz_files import change, inside, places
from fuzz_tables import bytes_broken
from fuzz_words import ANY, REFUSED, SAME, Mutant

NO_NUMBER: tuple[Any, ...] = (
    math.nan,
    math.inf,
    -math.inf,
    "NaN",
    "1.5",
    "",
    True,
    [],
    [1.0],
    {},
    {"a": 1.0},
    10**400,
)


def json_mutant(text: str, rng: np.random.Generator) -> Mutant:
    """One or two changes of a value, or of the file's text; what is refused is refused as no file
    of modelsel's own."""
    if rng.random() < 0.35:
        return _text(text, rng)
    value = json.loads(text)
    if rng.random() < 0.35:
        return _no_number(value, rng)
    done = [change(value, rng)[0] for _ in range(1 + int(rng.random() < 0.3))]
    return Mutant(
        " + ".join(done), _written(value), ANY, (2, 3)
    )  # 3: of another calibration the targets are out of reach


def _written(value: Any) -> bytes:
    return (json.dumps(value, ensure_ascii=False, indent=1) + "\n").encode("utf-8", "surrogatepass")


def _no_number(value: Any, rng: np.random.Generator) -> Mutant:
    value = copy.deepcopy(value)
    paths = [
        p
        for p in places(value)
        if isinstance(v := inside(value, p), (int, float)) and not isinstance(v, bool)
    ]
    path = paths[int(rng.integers(len(paths)))]
    inside(value, path[:-1])[path[-1]] = NO_NUMBER[int(rng.integers(len(NO_NUMBER)))]
    return Mutant("no number where one belongs", _written(value), REFUSED, (2,))


def _same(text: str, rng: np.random.Generator) -> Mutant:
    value = json.loads(text)
    ways = (
        text.replace("\n", "\r\n").encode(),
        json.dumps(value).encode(),
        json.dumps(value, indent=4, ensure_ascii=False).encode(),
        b"\xef\xbb\xbf" + text.encode(),
        b"\n\n" + text.rstrip().encode(),
    )
    return Mutant("written another way", ways[int(rng.integers(len(ways)))], SAME, (2,))


def _deep(text: str, rng: np.random.Generator) -> Mutant:
    deep = int(rng.choice([50, 900, 5000, 100_000]))
    inner = "[" * deep + "]" * deep if rng.random() < 0.5 else '{"a":' * deep + "1" + "}" * deep
    return Mutant(
        "nested deeply",
        text.replace("{", f'{{"zzz": {inner},', 1).encode(),
        REFUSED if deep > 1000 else ANY,
        (2,),
    )


def _twice(text: str, rng: np.random.Generator) -> Mutant:
    """A key that stands twice, with two values: which of them counts?"""
    lines = text.splitlines()
    at = [k for k, line in enumerate(lines) if line.endswith(",") and '": ' in line]
    if not at:  # a file of one line
        return Mutant("a key twice", text.replace("{", '{"schema":1,', 1).encode(), REFUSED, (2,))
    k = at[int(rng.integers(len(at)))]
    return Mutant(
        "a key twice", "\n".join([*lines[:k], lines[k], *lines[k:]]).encode(), REFUSED, (2,)
    )


def _cut(text: str, rng: np.random.Generator) -> Mutant:
    return Mutant(
        "truncated", text.encode()[: int(rng.integers(len(text.encode().rstrip())))], REFUSED, (2,)
    )


def _digit(text: str, rng: np.random.Generator) -> Mutant:
    """One digit is another: a file that may say something else, as a bad disk leaves it."""
    at = [k for k, c in enumerate(text) if c.isdigit()]
    k = at[int(rng.integers(len(at)))]
    return Mutant(
        "another digit", (text[:k] + str(rng.integers(10)) + text[k + 1 :]).encode(), ANY, (2, 3)
    )


def _text(text: str, rng: np.random.Generator) -> Mutant:
    make = (_same, _same, _deep, _twice, _cut, _cut, _digit)
    what = int(rng.integers(len(make) + 2))
    if what < len(make):
        return make[what](text, rng)
    mutant = bytes_broken(text.encode(), rng)
    return Mutant(mutant.name, mutant.content, mutant.expect, (2,))
