"""The shape of a free function's splines is that of another implementation."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import BSpline

from modelsel.mechanisms.causes import Bump


def test_a_bump_is_a_cubic_b_spline() -> None:
    """At its knots, between and beyond them, of any shape of values; scipy evaluates by de Boor."""
    bump = Bump("q1", 0.3, 0.05)
    values = np.concatenate([np.linspace(-1.0, 1.0, 2001), 0.3 + 0.05 * np.arange(-3, 4)])
    knots = 0.3 + 0.05 * np.arange(-2, 3)
    expected = np.nan_to_num(BSpline.basis_element(knots, extrapolate=False)(values))
    np.testing.assert_allclose(bump.shape(values), expected, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(
        bump.shape(values.reshape(-1, 8)), bump.shape(values).reshape(-1, 8)
    )
    assert (bump.shape(values)[np.abs(values - 0.3) > 0.1] == 0).all()
