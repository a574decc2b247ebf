"""One share by which all slides of a gantry are too long."""

from __future__ import annotations

import laws
import numpy as np
import pytest
from builders import bind, seeds
from exact import flanges_of
from slid_arms import put_on_slides

from modelsel.fitting.design import compute_design
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.registry import build_mechanisms, mechanism

TOOL = np.array([60.0, -50.0, 80.0])
Rng = np.random.Generator


@pytest.mark.parametrize("count", [2, 3])
@seeds(1)
def test_every_slide_goes_further_by_one_share(count: int, rng: Rng) -> None:
    arm = put_on_slides(count)
    q = arm.draw(rng, 30)
    longer = q.copy()
    longer[:, :count] *= 1 + 1e-4
    moved = [flanges_of(arm, one) @ np.append(TOOL, 1.0) for one in (q, longer)]
    at = bind(arm, build_measurements(q, moved[0][:, :3]), TOOL)
    one = mechanism("slide-scales", arm)
    columns, *_ = compute_design(at, one.terms)
    np.testing.assert_allclose(
        columns.reshape(-1) * 1e-4, (moved[1] - moved[0])[:, :3].reshape(-1), atol=1e-9
    )
    laws.check_mechanism(one, arm, rng)
    listed = "1 and 2" if count == 2 else "1, 2 and 3"
    assert one.sentence.startswith(f"Slides {listed} move more than they read")
    assert one.contrary.startswith(f"Slides {listed} move less than they read")


@pytest.mark.parametrize("count", [0, 1])
def test_of_one_slide_there_is_nothing_in_common(count: int) -> None:
    assert not build_mechanisms("slide-scales", put_on_slides(count))
