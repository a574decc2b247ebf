"""What every test shares: one seeded stream per test, its seed in the test's id, hypothesis
without chance, and the stage that a test belongs to."""

from __future__ import annotations

import gc
import os
import time

# before numpy is loaded: its threads would contend with the other processes of `-n`
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from zlib import crc32

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import settings

from modelsel._workers import COLLECT
from modelsel.cli.main import run_command_line

# A test's stage is that of its folder, else `unit`; what needs a whole study or a browser is
# `integration`; a mark on a test or a file takes the place of both. In order of what a test costs.
STAGES = ("unit", "integration", "docs", "slow", "long")
COSTLY_FIXTURES = {"drawn", "browser"}
TESTS = Path(__file__).parent
# seconds; a study takes thirty
LONGEST_WAIT = 300.0

pytest.register_assert_rewrite("laws", "builders")
settings.register_profile("modelsel", deadline=None, derandomize=True, database=None)
settings.load_profile("modelsel")


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("modelsel")
    group.addoption(
        "--share",
        action="append",
        default=[],
        metavar="STAGE=SHARE",
        help="run this share of a stage, such as slow=0.1, drawn by --draw",
    )
    group.addoption("--draw", type=int, default=0, metavar="N", help="seed of the draw")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Give every test its one stage, and keep a drawn share of the stages that are asked for in
    part."""
    for item in items:
        if not any(item.get_closest_marker(stage) for stage in STAGES):
            item.add_marker(default_stage(item))
    stages = [stage_of(item) for item in items]
    for node in {node for item in items for node in item.listchain()}:
        # `-m unit` would run what a file calls unit and the test itself slow
        node.own_markers[:] = [mark for mark in node.own_markers if mark.name not in STAGES]
    for item, stage in zip(items, stages, strict=True):
        item.add_marker(stage)
    shares, seed = shares_of(config), config.getoption("draw")
    dropped = [
        item for item in items if uniform(seed, item.nodeid) >= shares.get(stage_of(item), 1.0)
    ]
    config.hook.pytest_deselected(items=dropped)
    kept = set(items) - set(dropped)
    items[:] = costliest_first([item for item in items if item in kept])


def costliest_first(items: list[pytest.Item]) -> list[pytest.Item]:
    """Order files by their costliest stage, the costliest first: at the end no process of `-n` waits
    long for another."""
    costliest: dict[Path, int] = {}
    for item in items:
        cost = STAGES.index(stage_of(item))
        costliest[item.path] = max(cost, costliest.get(item.path, 0))
    return sorted(items, key=lambda item: -costliest[item.path])


def pytest_configure(config: pytest.Config) -> None:
    """Let `-n` begin files in that order, not by the number of their tests."""
    config.option.loadscopereorder = False


def pytest_collection_finish() -> None:
    """Leave what was collected out of the looks for lost objects, and look less often: both cost a
    tenth of the time of the tests."""
    gc.freeze()
    gc.set_threshold(COLLECT)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: object) -> object:
    """Keep the tests of a file, which share what it prepares, in one process of `-n 2`."""
    if config.getoption("dist") != "load":
        return None
    from xdist.scheduler import LoadFileScheduling

    return LoadFileScheduling(config, log)


def pytest_report_header(config: pytest.Config) -> str | None:
    shares = config.getoption("share")
    seed = config.getoption("draw")
    return f"stages in part: {', '.join(shares)}, --draw={seed}" if shares else None


def shares_of(config: pytest.Config) -> dict[str, float]:
    """The shares of the stages that are asked for in part."""
    shares = {}
    for asked in config.getoption("share"):
        stage, _, share = asked.partition("=")
        if stage not in STAGES:
            raise pytest.UsageError(f"--share {asked}: stages are {', '.join(STAGES)}")
        shares[stage] = float(share)
    return shares


def default_stage(item: pytest.Item) -> str:
    """The stage that a test's folder is named after, else `unit` unless a fixture is costly."""
    folder = item.path.relative_to(TESTS).parts[0]
    if folder in STAGES:
        return folder
    costly = COSTLY_FIXTURES.intersection(getattr(item, "fixturenames", ()))
    return "integration" if costly else "unit"


def stage_of(item: pytest.Item) -> str:
    """The stage of a test: the innermost mark counts, first that of its parameters."""
    callspec = getattr(item, "callspec", None)
    own = callspec.marks if callspec else ()
    return next(mark.name for mark in (*own, *item.iter_markers()) if mark.name in STAGES)


def uniform(seed: int, name: str) -> float:
    """A number in [0, 1) that follows from the seed and a test's name."""
    return crc32(f"{seed} {name}".encode()) / 2**32


@pytest.fixture(params=[1986], ids=lambda seed: f"seed{seed}")
def rng(request: pytest.FixtureRequest) -> np.random.Generator:
    """A stream of the test's own: its seed (more by `seeds(...)`) and its name, so that no test
    moves another's."""
    return np.random.default_rng([request.param, crc32(request.node.name.encode())])


@pytest.fixture(scope="session")
def drawn(tmp_path_factory) -> Path:
    """The PUMA study with its report, as `modelsel study` leaves it; one for all processes of `-n`.
    To be read only."""
    own = tmp_path_factory.getbasetemp()
    shared = own.parent if "PYTEST_XDIST_WORKER" in os.environ else own
    folder = shared / "puma760"
    with one_at_a_time(shared / "puma760.lock"):
        if not folder.exists():
            run_puma(own / "puma760").rename(folder)
    return folder


def run_puma(folder: Path) -> Path:
    study = TESTS.parent / "studies" / "puma760" / "study.toml"
    result = CliRunner().invoke(run_command_line, ["study", str(study), "--out", str(folder)])
    assert result.exit_code == 0, result.output
    return folder


@contextmanager
def one_at_a_time(lock: Path) -> Iterator[None]:
    """Wait until no other process holds a lock, a folder; a process that died holding it is not
    waited for without end."""
    until = time.monotonic() + LONGEST_WAIT
    is_ours = False
    while not is_ours and time.monotonic() < until:
        try:
            lock.mkdir()
            is_ours = True
        except FileExistsError:
            time.sleep(0.1)
    try:
        yield
    finally:
        if is_ours:
            lock.rmdir()
