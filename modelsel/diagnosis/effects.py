"""Effects: the named parts of an extended model."""

from __future__ import annotations

from dataclasses import dataclass, field

from .._typing import Array
from .candidates import Candidate
from .credible_sets import CredibleSet


@dataclass(frozen=True, eq=False)
class Effect:
    """A named effect of the extended model, given all the others.

    `p`: its family-wise p-value; `estimate` and `standard_error` (k,) of its terms in the full
    model; `cancels`: (label of another effect that undoes most of it at the target, the share that
    is left of both)."""

    candidate: Candidate
    named: CredibleSet
    p: float
    estimate: Array = field(repr=False)
    standard_error: Array = field(repr=False)
    cancels: tuple[str, float] | None = None
