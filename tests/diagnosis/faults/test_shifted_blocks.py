"""A block of rows whose positions and readings are shifted against each other is told as one, with the
rows at its ends."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import drawn, planted, small_arm

from modelsel._typing import Array
from modelsel.diagnosis.faults.data_faults import Fault, find_misplaced_rows
from modelsel.fitting.design import Model
from modelsel.fitting.least_squares import fit
from modelsel.mechanisms.registry import mechanism

ARM = small_arm()
MODEL = Model((mechanism("geometric", ARM),))
ROWS = 60


def find_faults(source: Array, rng: np.random.Generator) -> tuple[Fault, ...]:
    """Find the faults where row k has the position of the row source[k]."""
    at = drawn(ARM, rng, ROWS)
    at = planted(at, MODEL.terms, np.zeros(len(MODEL.terms)), rng, 0.05)
    fitted = fit(at, MODEL)
    position = at.data.position[source]
    mixed = replace(at, data=replace(at.data, position=position))
    outlying = source != np.arange(ROWS)
    return find_misplaced_rows(mixed, outlying, fitted, rng)


@pytest.mark.parametrize(
    ("by", "words"),
    [
        (1, "by one row ({}): each position fits the readings of the row after."),
        (-1, "by one row ({}): each position fits the readings of the row before."),
        (2, "by 2 rows ({}): each position fits the readings of the row 2 rows after."),
    ],
)
def test_a_block_that_is_shifted_is_one_fault(
    by: int, words: str, rng: np.random.Generator
) -> None:
    source = np.arange(ROWS)
    source[20:32] += by
    (fault,) = find_faults(source, rng)
    assert fault.name == "row-order"
    assert fault.rows.tolist() == list(range(20, 32))
    said = words.format("rows 20 to 31, counted from 0")
    assert fault.sentence == (
        f"A fault of the data: positions and joint readings are shifted against each other {said}"
    )


def test_rows_that_are_exchanged_are_told_beside_a_block(rng: np.random.Generator) -> None:
    source = np.arange(ROWS)
    source[20:32] += 1
    source[[5, 50]] = 50, 5
    (fault,) = find_faults(source, rng)
    assert fault.rows.tolist() == [5, *range(20, 32), 50]
    first, second = fault.sentence.split("; ")
    assert "shifted against each other by one row (rows 20 to 31, counted from 0)" in first
    assert second.startswith("these rows stand in the wrong order")
    assert second.endswith("(rows 5, 50, counted from 0).")


def test_three_rows_that_went_round_are_no_block(rng: np.random.Generator) -> None:
    source = np.arange(ROWS)
    source[[7, 8, 9]] = 8, 9, 7
    (fault,) = find_faults(source, rng)
    assert fault.rows.tolist() == [7, 8, 9]
    assert "these rows stand in the wrong order" in fault.sentence
