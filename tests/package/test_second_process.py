"""The second process: it does what it is told, and nothing of it is left."""

from __future__ import annotations

import operator
import time
from functools import partial

import pytest

from modelsel._second_process import SecondProcess, second_process
from modelsel._workers import count_cores

WORK = partial(operator.mul, "drawn ", 2)
LARGE = partial(operator.mul, b"x", 3_000_000)  # more than a pipe holds


def test_results_come_in_order_however_large() -> None:
    with second_process(2) as second:
        results = [second.ask(LARGE), second.ask(WORK), second.ask(partial(sum, (1, 2)))]
        assert [collect() for collect in results] == [LARGE(), WORK(), 3]


@pytest.mark.slow
def test_who_asks_never_waits() -> None:
    """Neither while the other is busy nor because a pipe holds less than what is sent."""
    with second_process(2) as second:
        second.ask(partial(time.sleep, 5))
        start = time.monotonic()
        length = second.ask(partial(len, b"x" * 3_000_000))
        assert time.monotonic() - start < 2.5
        assert length() == 3_000_000


def test_with_one_core_nothing_is_started() -> None:
    with second_process(1) as second:
        assert second.ask(WORK)() is None
        assert second.process is None
    assert count_cores() >= 1


def test_failed_work_has_no_result() -> None:
    with second_process(2) as second:
        failed = second.ask(partial(operator.truediv, 1, 0))
        assert failed() is None
        assert second.ask(WORK)() is None


def test_a_process_that_cannot_be_started(monkeypatch) -> None:
    monkeypatch.setattr("sys.executable", "/nowhere/python")
    with second_process(2) as second:
        assert second.ask(WORK)() is None


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError])
def test_it_ends_with_the_work_of_the_first(error) -> None:
    def interrupted(second: SecondProcess) -> None:
        second.ask(partial(time.sleep, 60))
        raise error

    start = time.monotonic()
    with pytest.raises(error), second_process(2) as second:
        interrupted(second)
    assert second.process is not None
    assert second.process.returncode is not None
    assert time.monotonic() - start < 30
