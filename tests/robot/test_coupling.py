"""What a coupling matrix says of the joints."""

from __future__ import annotations

import numpy as np

from modelsel.robot.coupling import Coupling


def test_joints_that_count_the_other_way_are_told_from_coupled_ones() -> None:
    assert Coupling(np.diag([1.0, -1.0, -1.0])).reversed == (2, 3)
    assert Coupling(np.eye(3)).reversed == ()
    assert Coupling(np.diag([1.0, 0.5])).reversed is None
    assert Coupling(np.array([[1.0, 0.0], [1.0, -1.0]])).reversed is None
