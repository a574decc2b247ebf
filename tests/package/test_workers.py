"""Products of matrices use one thread in what a program calls, and as many as before afterwards."""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator

import numpy as np
import pytest
import scipy.linalg  # noqa: F401  loads the second library that multiplies matrices
from threadpoolctl import threadpool_info, threadpool_limits

import modelsel as ms
from modelsel._workers import COLLECT, steady_arithmetic

MANY = 3
CALLS: dict[str, Callable[[], object]] = {
    "run_study": lambda: ms.run_study(Spy()),
    "diagnose": lambda: ms.diagnose(SpyProblem()),
    "compare": lambda: ms.compare(SpyProblem(), {"nominal": ms.Model(())}),
    "plan_next": lambda: ms.plan_next(SpyResult()),
}


class Looked(Exception):
    """The work was reached."""


class Spy:
    """In the place of a study, a problem or a result: says with how many threads it is used."""

    def __len__(self) -> int:
        return self.look()

    @property
    def calibration(self) -> int:
        return self.look()

    def __fspath__(self) -> str:
        self.look()
        return ""

    def look(self) -> int:
        raise Looked(count_threads())


class SpyProblem(Spy, ms.Problem):
    """A spy that is a problem."""

    def __init__(self) -> None:
        pass


class SpyResult(Spy, ms.Result):
    """A spy that is a result."""

    def __init__(self) -> None:
        pass


def count_threads() -> set[int]:
    """The numbers of threads of the libraries that multiply matrices."""
    return {one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"}


@pytest.fixture
def _many_threads() -> Iterator[None]:
    """A program that leaves the threads as they are on a machine of three cores."""
    with threadpool_limits(MANY, "blas"):
        assert count_threads() == {MANY}
        yield


@pytest.mark.usefixtures("_many_threads")
@pytest.mark.parametrize("name", CALLS)
def test_what_a_program_calls_uses_one_thread(name) -> None:
    with pytest.raises(Looked, match=r"^\{1\}$"):
        CALLS[name]()
    assert count_threads() == {MANY}


def test_what_is_too_small_for_a_number_is_zero() -> None:
    with np.errstate(all="raise"), steady_arithmetic():
        assert np.exp(-1000.0) == 0


@pytest.mark.usefixtures("_many_threads")
def test_the_last_that_ends_lifts_the_limit() -> None:
    with steady_arithmetic():
        with steady_arithmetic():
            assert count_threads() == {1}
        assert count_threads() == {1}
    assert count_threads() == {MANY}


@pytest.fixture
def _own_rate() -> Iterator[None]:
    before = gc.get_threshold()
    yield
    gc.set_threshold(*before)


@pytest.mark.usefixtures("_own_rate")
@pytest.mark.parametrize("own", [0, 700, 10 * COLLECT])
def test_lost_objects_are_not_looked_for_more_often_meanwhile(own) -> None:
    """A program that never looks for them goes on so."""
    gc.set_threshold(own, 9, 8)
    with steady_arithmetic():
        with steady_arithmetic():
            assert gc.get_threshold() == (own and max(own, COLLECT), 9, 8)
        assert gc.get_threshold() == (own and max(own, COLLECT), 9, 8)
    assert gc.get_threshold() == (own, 9, 8)
