"""What every test shares: one seeded stream per test, its seed in the test's id, and hypothesis
without chance."""

from __future__ import annotations

from pathlib import Path
from zlib import crc32

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import settings

from modelsel.cli.main import run_command_line

pytest.register_assert_rewrite("laws", "builders")
settings.register_profile("modelsel", deadline=None, derandomize=True, database=None)
settings.load_profile("modelsel")


@pytest.fixture(params=[1986], ids=lambda seed: f"seed{seed}")
def rng(request: pytest.FixtureRequest) -> np.random.Generator:
    """A stream of the test's own: its seed (more by `seeds(...)`) and its name, so that no test
    moves another's."""
    return np.random.default_rng([request.param, crc32(request.node.name.encode())])


@pytest.fixture(scope="session")
def drawn(tmp_path_factory) -> Path:
    """The PUMA study with its report, as `modelsel study` leaves it. To be read only."""
    folder = tmp_path_factory.mktemp("puma760")
    study = Path(__file__).parents[1] / "studies" / "puma760" / "study.toml"
    result = CliRunner().invoke(run_command_line, ["study", str(study), "--out", str(folder)])
    assert result.exit_code == 0, result.output
    return folder
