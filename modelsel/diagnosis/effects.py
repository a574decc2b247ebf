"""Effects: the named parts of an extended model."""

from __future__ import annotations

from dataclasses import dataclass, field

from .._typing import Array
from ..exceptions import write_numbered
from .after_selection import AfterSelection
from .candidates import Candidate
from .credible_sets import CredibleSet
from .signatures import LEVELS

# what a step of a search that drops an effect begins with
DROPPED = "- "


@dataclass(frozen=True)
class Claim:
    """How deep a finding is proven: the deepest level that holds, the probability (4,) of each.

    `moves_joint`: it acts along the motion of one joint alone."""

    level: str
    levels: tuple[float, ...]
    moves_joint: bool = False

    @property
    def probability(self) -> float:
        """The probability of the level that is claimed."""
        return self.levels[LEVELS.index(self.level)]


@dataclass(frozen=True, eq=False)
class Effect:
    """A named effect of the extended model, given all the others.

    `p`: its family-wise p-value; `estimate` and `standard_error` (k,) of its terms in the full
    model; `cancels`: (label of another effect that undoes most of it at the target, the share that
    is left of both); `claim`: how deep it is proven; `after_selection`: what its size is to be
    multiplied by, allowing for the search; `number`: which it is of several effects of one name."""

    candidate: Candidate
    named: CredibleSet
    p: float
    estimate: Array = field(repr=False)
    standard_error: Array = field(repr=False)
    cancels: tuple[str, float] | None = None
    claim: Claim | None = None
    after_selection: AfterSelection | None = None
    number: int | None = None

    @property
    def label(self) -> str:
        """Its short name, numbered where other effects have the name, too."""
        name = self.candidate.label
        number = self.number
        return write_numbered(name, number)
