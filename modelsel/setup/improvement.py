"""When a mistake is looked for in what the nominal arm leaves, and when its correction does so much
better that it is believed."""

from __future__ import annotations

# residual, as a share of the reach, from which mistakes are looked for
BAD_SHARE = 3e-3
# a mistake explains what is left where its correction reduces that by this factor
MIN_IMPROVEMENT = 4.0
# factor within which mistakes fit as well as the best and are named with it
EQUAL_FACTOR = 1.5
# improvement beyond which no figure is given
FAR_BETTER = 1e4


def describe_improvement(before: float, after: float) -> str:
    """Describe how much better something fits."""
    is_near = before < FAR_BETTER * after
    if is_near:
        factor = before / after
        return f"{factor:,.0f} times better"
    return "far better"
