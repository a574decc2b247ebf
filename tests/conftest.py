"""What every test shares: one seeded stream per test, its seed in the test's id, and hypothesis without chance."""
from __future__ import annotations

from zlib import crc32

import numpy as np
import pytest
from hypothesis import settings

pytest.register_assert_rewrite("laws", "builders")
settings.register_profile("modelsel", deadline=None, derandomize=True, database=None)
settings.load_profile("modelsel")


@pytest.fixture(params=[1986], ids=lambda seed: f"seed{seed}")
def rng(request: pytest.FixtureRequest) -> np.random.Generator:
    """A stream of the test's own: its seed (more by `seeds(...)`) and its name, so that no test moves another's."""
    return np.random.default_rng([request.param, crc32(request.node.name.encode())])
