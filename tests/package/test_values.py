"""Values that remember their hash: the same as worked out anew, and never another process's. And
numbers in words."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from dataclasses import replace

import pytest

from modelsel._hashing import HASH_ATTRIBUTE
from modelsel.exceptions import count_words, number_repeated, write_numbered, write_rounded
from modelsel.mechanisms.causes import Bump, Cause, Named, cos, q, sin
from modelsel.mechanisms.terms import Screw

THERE = """
import pickle, sys
from modelsel.mechanisms.causes import Named, sin
from modelsel.mechanisms.terms import Screw
read, made = pickle.load(sys.stdin.buffer), Screw(4, "rz", sin(2.0 * Named("q4", "rad")))
assert read == made and hash(read) == hash(made), (hash(read), hash(made))
assert {made: 1}[read] == 1
"""


@pytest.mark.parametrize(
    "cause",
    [sin(2.0 * q(4)), cos(q(2) + q(3)) * Named("payload_kg", "kg"), Bump("q1", 0.1, 0.2)],
    ids=str,
)
def test_a_hash_is_worked_out_once_and_is_the_same(cause: Cause) -> None:
    fresh = replace(cause)
    assert HASH_ATTRIBUTE not in vars(fresh)
    assert hash(fresh) == hash(cause) == hash(replace(cause))
    assert vars(fresh)[HASH_ATTRIBUTE] == hash(cause)
    assert fresh == cause == replace(cause)
    assert repr(fresh) == repr(cause)
    assert len({Screw(1, "rz", cause), Screw(1, "rz", fresh), Screw(2, "rz", fresh)}) == 2


def test_another_process_hashes_anew() -> None:
    screw = Screw(4, "rz", sin(2.0 * q(4)))
    assert hash(screw) == vars(screw)[HASH_ATTRIBUTE]
    subprocess.run(
        [sys.executable, "-c", THERE],
        input=pickle.dumps(screw),
        check=True,
        env=os.environ | {"PYTHONHASHSEED": "7"},
    )


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (0.012, "0.0120"),
        (12.34, "12.3"),
        (999.7, "1,000"),
        (-1234.0, "-1,230"),
        (5e5, "500,000"),
        (0.0, "0"),
        (0.0400, "0.0400"),
        (2.38e-7, "0.000000238"),
    ],
)
def test_large_numbers_have_no_exponent(value: float, words: str) -> None:
    assert write_rounded(value) == words


def test_one_is_no_plural() -> None:
    assert [count_words(count, "row") for count in (1, 2, 1200)] == [
        "1 row",
        "2 rows",
        "1,200 rows",
    ]
    assert [count_words(count, "study") for count in (1, 2)] == ["1 study", "2 studies"]
    assert count_words(2, "day") == "2 days"


def test_names_that_stand_several_times_are_numbered() -> None:
    names = ["play", "wave", "play"]
    numbers = number_repeated(names)
    assert numbers == [1, None, 2]
    assert list(map(write_numbered, names, numbers)) == ["play (1)", "wave", "play (2)"]
