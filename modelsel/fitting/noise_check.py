"""Uncertainties that are stated or measured, held against what a model leaves: how far apart, and
the likeliest mistake."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..exceptions import write_rounded
from .noise import Floor

LEVEL = 1e-3  # share of studies whose chi-square lies outside its range by chance
# stated so many times too large: said before everything else
CLEARLY_TOO_LARGE = 1.5
# stated so many times too small: said before everything else
CLEARLY_TOO_SMALL = 5.0
# times too small from which no lack of the model explains it, and the figure is not used
REFUTED_TOO_SMALL = 100.0
NEAR_UNIT = 4.0  # a factor this near to a unit's is that unit
# factor of a unit mistaken for another, what is mistaken, and what to do with the figure
UNIT_MISTAKES = {
    "mm": (
        (1e3, "micrometres stand where millimetres are expected: divide {} by 1000"),
        (1e-3, "metres stand where millimetres are expected: multiply {} by 1000"),
    ),
    "rad": (
        (180 / np.pi, "degrees stand where radians are expected: multiply {} by 0.0174533"),
        (1e3, "milliradians stand where radians are expected: divide {} by 1000"),
    ),
}


@dataclass(frozen=True)
class Lack:
    """`factor` of what is left to what the floor would leave, per coordinate; `low` and `high`: the
    range that holds 99.9 % by chance, of the same factor."""

    factor: float
    low: float
    high: float

    @property
    def outside(self) -> bool:
        """Whether chance does not explain the difference."""
        return not self.low <= self.factor <= self.high

    @property
    def far(self) -> bool:
        """Whether the floor is so far off that it is said before everything else."""
        return self.outside and not 1 / CLEARLY_TOO_LARGE < self.factor < CLEARLY_TOO_SMALL

    @property
    def refuted(self) -> bool:
        """Whether the floor cannot be true."""
        return self.outside and not 1 / CLEARLY_TOO_LARGE < self.factor < REFUTED_TOO_SMALL


def lack(floor: Floor, factor: float, freedom: float) -> Lack:
    """Compare residuals with the floor, by an F test where the floor is itself measured, else by a
    chi-square test. `factor`: root mean square residual over the floor, `freedom` its degrees of
    freedom."""
    from scipy.special import chdtri, fdtri

    tail = LEVEL / 2
    tails = [tail, 1 - tail]
    if np.isfinite(floor.freedom):
        floor_freedom = max(floor.freedom, 1.0)
        low, high = fdtri(freedom, floor_freedom, tails)
    else:
        low, high = chdtri(freedom, tails[::-1]) / freedom
    least = float(np.sqrt(low))
    most = float(np.sqrt(high))
    return Lack(factor, least, most)


def name_likeliest_mistake(
    ratio: float, where: str, scale: str = "mm", *, parts_found: bool = False
) -> str:
    """Name the mistake that makes a stated uncertainty `ratio` times as large as what is left; `where` it is
    stated; `scale`: "mm" or "rad"; `parts_found`: what does not repeat was looked for, and is not in what is left."""
    near = []
    for unit, words in UNIT_MISTAKES[scale]:
        distance = abs(np.log(ratio / unit))
        if distance < np.log(NEAR_UNIT):
            near.append((distance, words))
    if near:
        return f"Most likely {min(near)[1].format(where)}."
    if ratio > NEAR_UNIT:
        return f"Most likely this is a tolerance, or in another unit: give one standard deviation in {scale}."
    if ratio > 1:
        return (
            "Most likely this is an expanded uncertainty (k = 2 or 3), or that of a whole length: give one standard "
            "deviation of one coordinate."
        )
    reason = "it leaves out how well the arm itself repeats, or an error remains"
    if parts_found:
        reason = "it is that of a mean of many readings, or an error remains"
    return (
        f"Most likely {reason} that no candidate explains: give the uncertainty of one coordinate as repeats "
        "show it."
    )


def describe_lack(
    what: str,
    floor: float,
    left: float,
    found: Lack,
    scale: str = "mm",
    model: str = "the model leaves",
) -> str:
    """Put the comparison in words: `what` is stated to be `floor`, and `left` is left [`scale`, of one
    coordinate]."""
    times = f"{write_rounded(found.factor)} times smaller than"
    if found.factor < 1:
        times = f"{write_rounded(1 / found.factor)} times as large as"
    stated = f"{floor:.6g} {scale}"
    remaining = f"{write_rounded(left)} {scale}"
    squares = [write_rounded(factor**2) for factor in (found.factor, found.low, found.high)]
    return (
        f"{what}: the standard uncertainty of one coordinate is stated as {stated}, {times} what {model} "
        f"({remaining}; chi-square over its degrees of freedom {squares[0]}, where {squares[1]} to "
        f"{squares[2]} would be chance in 99.9 % of cases)."
    )
