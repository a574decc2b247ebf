"""Effects: the named parts of an extended model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from ..._typing import Array
from ...exceptions import write_numbered
from ..candidates.candidate import Candidate
from ..candidates.signatures import LEVELS, PROVEN
from ..inference.after_selection import AfterSelection
from ..inference.credible_sets import CredibleSet
from .springs_apart import SpringsApart


@dataclass(frozen=True)
class Claim:
    """How deep a finding is proven: the deepest level that holds, the probability (4,) of each.

    `moves_joints`: it acts along the motion of joints alone; `acts`: the places (frame, axis) where
    it does, each with the names that it depends on there, but for what hardly moves the target;
    `alike`: of one place the others that move every target as it does; `drivers`: where the place is
    proven, but not all that it depends on, the names that are, with their probabilities; `waves`: of a
    wave other numbers a turn that do the same at all readings; `bend`: of a joint that yields to its
    torque, not in proportion, whether it "stiffens" or "softens" with it; `lone_posture`: the posture that
    alone tells it, if one does."""

    level: str
    levels: tuple[float, ...]
    moves_joints: bool = False
    acts: tuple[tuple[tuple[int, str], frozenset[str]], ...] = ()
    alike: tuple[tuple[int, str], ...] = ()
    drivers: tuple[tuple[str, float], ...] = ()
    waves: tuple[int, ...] = ()
    bend: str = ""
    lone_posture: int | None = None

    @property
    def probability(self) -> float:
        """The probability of the level that is claimed."""
        return self.levels[LEVELS.index(self.level)]

    @property
    def needs_drivers(self) -> bool:
        """Whether its place is proven, but not all that it depends on."""
        place, drivers, *_ = self.levels
        return drivers < PROVEN <= place

    def share(self, share: float) -> Claim:
        """Return the claim that holds only a share of the probability."""
        levels = tuple(share * p for p in self.levels)
        drivers = tuple((name, share * p) for name, p in self.drivers)
        return replace(self, level=find_level(levels), levels=levels, drivers=drivers)


def find_level(levels: Sequence[float]) -> str:
    """Find the deepest level that holds; the place where none does."""
    held = [level for level, p in zip(LEVELS, levels, strict=True) if p >= PROVEN]
    return held[-1] if held else LEVELS[0]


@dataclass(frozen=True, eq=False)
class Effect:
    """A named effect of the extended model, given all the others.

    `p`: its family-wise p-value; `estimate` and `standard_error` (k,) of its terms in the full
    model; `cancels`: (label of another effect that undoes most of it at the target, the share that
    is left of both); `claim`: how deep it is proven; `after_selection`: what its size is to be
    multiplied by, allowing for the search; `number`: which it is of several effects of one name;
    `lasting`: how probable errors that last are in its place, where that is worth telling; `mixed_joint`:
    the joint whose wave once a turn and wind-up under its weight are told by it as one; `apart`: of a
    spring under the arm's weight and the payload what it is under each."""

    candidate: Candidate
    named: CredibleSet
    p: float
    estimate: Array = field(repr=False)
    standard_error: Array = field(repr=False)
    cancels: tuple[str, float] | None = None
    claim: Claim | None = None
    after_selection: AfterSelection | None = None
    number: int | None = None
    lasting: float = 0.0
    mixed_joint: int | None = None
    apart: SpringsApart | None = None

    @property
    def label(self) -> str:
        """Its short name, numbered where other effects have the name, too."""
        name = self.candidate.label
        number = self.number
        return write_numbered(name, number)
