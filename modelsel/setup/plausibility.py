"""Whether measurements can be of an arm at all: how far they are from where it should be."""

from __future__ import annotations

import numpy as np

from .._typing import Array
from ..exceptions import write_rounded

# of the arm's reach (median): measurements further from the arm are refused
MAX_DISTANCE_SHARE = 0.25


def describe_implausible_distance(
    residual: Array, reach_mm: float, expected: str = "nominal", explained: bool = False
) -> str | None:
    """Describe how far measured and `expected` positions are apart; None where they are near enough.

    `residual` (m, 3) [mm]. The median decides: few gross rows do not make a file implausible. It is no
    figure beside that of a reason, by which it is `explained`, with tracker and target found anew."""
    lengths = np.linalg.norm(residual, axis=1)
    distance = float(np.median(lengths))
    limit = MAX_DISTANCE_SHARE * reach_mm
    if not distance > limit:
        return None
    apart = " apart" if explained else ""
    far = "" if explained else f"{write_rounded(distance)} mm apart (median), "
    return (
        f"measured and {expected} positions are {far}more than a "
        f"quarter of the length of the arm's links and target in all ({reach_mm:,.0f} mm){apart}."
    )
