"""benchmarks.priors: the priors that it compares."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from builders import drawn

ROOT = Path(__file__).parents[2]
if not (ROOT / "benchmarks").is_dir():
    pytest.skip("a source distribution has no benchmarks", allow_module_level=True)
sys.path.append(str(ROOT))

from benchmarks import priors  # noqa: E402
from modelsel import Model, mechanism  # noqa: E402
from modelsel.diagnosis.candidates.candidate_list import build_candidates  # noqa: E402
from modelsel.mechanisms.registry import every  # noqa: E402

pytestmark = pytest.mark.unit


@pytest.mark.slow
@pytest.mark.parametrize("words", list(priors.PRIORS))
def test_every_prior_has_the_same_candidates_and_sums_to_one(
    words: str, rng: np.random.Generator
) -> None:
    at = drawn("puma760", rng, 30)
    base = Model((mechanism("geometric", at.robot),))
    found = build_candidates(at, base, every(at.robot))
    changed = priors.PRIORS[words](at, base, found, ["backlash", "sine at a cell"])
    assert [c.mechanism for c in changed] == [c.mechanism for c in found]
    assert sum(c.prior for c in changed) == pytest.approx(1.0)
    share = sum(c.prior for c in changed if c.registered)
    ratio = {c.label: c.prior / old.prior for c, old in zip(changed, found, strict=True)}
    if "doubled" in words:
        assert share == pytest.approx(0.75)
    elif "halved" in words:
        assert share == pytest.approx(0.3 / 0.7)
    elif "every" in words:
        assert len({c.prior for c in changed}) == 1
    elif "contradicted" in words:
        count = 50 if "50" in words else 5
        assert ratio["backlash:3"] / ratio["base-tilt"] == pytest.approx(1 / (1 + count))
        assert share == pytest.approx(0.6)
    else:
        assert set(ratio.values()) == {1.0}


def test_a_line_counts_effects_that_can_be_found() -> None:
    one = ((True, True), (True, False), ("a", "b"), 0, 1)
    other = ((True, True), (False, False), ("c", "b"), 1, 0)
    outcomes = (one, other, *[one] * (len(priors.PRIORS) - 2))
    case = priors.Study(
        "planted", 0, "ur10", ("x", "y"), (True, True), (True, False), outcomes, 1.0
    )
    empty = ((), (), (), 1, 0)
    none = priors.Study("nothing", 0, "ur10", (), (), (), (empty,) * len(priors.PRIORS), 1.0)
    first, second = list(priors.PRIORS)[:2]
    line = priors.tabulate_prior(0, first, [case], [none])
    assert "(1 of 2)" in line
    assert "(1 of 1)" in line
    assert line.split()[-6:-3] == ["0", "0", "1"]
    assert line.endswith("1.000 [0.025, 1.000]")
    line = priors.tabulate_prior(1, second, [case], [none])
    assert line.split()[-6:-3] == ["1", "1", "0"]
