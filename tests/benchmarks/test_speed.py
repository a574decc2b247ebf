"""benchmarks.speed: every family of figures is measured, at small sizes; how fast is not tested."""

from __future__ import annotations

import math
import sys
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
if not (ROOT / "benchmarks").is_dir():
    pytest.skip("a source distribution has no benchmarks", allow_module_level=True)
sys.path.append(str(ROOT))

from benchmarks.__main__ import GOALS  # noqa: E402

pytestmark = pytest.mark.integration
# of every family: what its peer needs, the sizes that are made small, and the arguments of `run`
SMALL = {
    "assembly": ("pinocchio", {"M": 200, "PEER": 20}, ()),
    "stream": ("sklearn", {}, (300,)),
    "subsets": ("sklearn", {"SAMPLE": 2}, ()),
    "scan": ("statsmodels", {"GROUPS": 40, "SAMPLE": 2, "DRAWN": 1, "DRAWS": 20}, ()),
    "posterior": ("emcee", {"STEPS": 20}, ()),
}


@pytest.mark.parametrize("family", SMALL)
def test_a_family_of_figures_is_measured(family: str, monkeypatch: pytest.MonkeyPatch) -> None:
    peer, sizes, arguments = SMALL[family]
    pytest.importorskip(peer, reason="the peers are in the group `referees`")
    module = import_module(f"benchmarks.speed.{family}")
    for name, value in sizes.items():
        monkeypatch.setattr(module, name, value)
    figures = module.run(*arguments)
    of_family = {name for name in GOALS if name.startswith(f"{family}_")}
    assert of_family
    assert of_family <= figures.keys()
    assert all(math.isfinite(value) and value > 0 for value in figures.values())
