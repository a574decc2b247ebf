"""Contenders: explanations that are not among the candidates of a search, seen beyond one of its models.

Every effect has some of its own, which are weighed in its place. Their columns have much in common, so
those of all effects are built together, once."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..._typing import Array
from ...mechanisms.terms import Mechanism
from ..candidates.candidate import Candidate
from ..columns.candidate_columns import Columns, build_columns
from ..columns.screw_columns import CAUSES_SHARE
from ..inference.joint_curves import build_curve, see_rest
from ..inference.scan import Response, Scan, build_scan
from ..search.state import Search
from ..search.views import View


class _Seen(NamedTuple):
    """The columns of all contenders, these beyond the view, and its response."""

    columns: Columns
    scan: Scan
    response: Response


@dataclass(frozen=True, eq=False)
class Contenders:
    """Explanations of what a view of a search leaves without some of its effects.

    `every`: all of them by their mechanisms; their columns are built when some are first weighed."""

    search: Search
    view: View
    every: dict[Mechanism, Candidate]

    @cached_property
    def number(self) -> dict[Mechanism, int]:
        """The number of each among the columns."""
        return {mechanism: k for k, mechanism in enumerate(self.every)}

    def weigh(self, effects: Sequence[Candidate], contenders: Sequence[Candidate]) -> Array:
        """Compute (ratios, A) log Bayes factors of some of them, where effects are taken out."""
        wanted = [self.number[one.mechanism] for one in contenders]
        which, place = np.unique(np.array(wanted, dtype=np.intp), return_inverse=True)
        nothing = np.zeros(len(which))
        none_free = np.zeros(len(which), bool)
        columns, scan, response = self._seen
        some = build_curve(columns, which, nothing, none_free, ~none_free)
        released = self.view.release(*effects)
        rest = see_rest(some, scan, response, released)
        # as many as a scan beyond the smaller model has, beside which these are weighed
        freedom = rest.freedom + released.directions.shape[1]
        factors = replace(rest, freedom=freedom).factors
        return np.asarray(factors[:, place])

    @cached_property
    def _seen(self) -> _Seen:
        search, view = self.search, self.view
        every = tuple(self.every.values())
        # the search keeps its causes meanwhile, and both have one share of the memory
        taken_mb = search.causes.count_mb() / CAUSES_SHARE
        left_mb = max(search.memory_mb - taken_mb, 0.0)
        columns = build_columns(search.problem, every, view.fitted.at(), left_mb)
        scan = build_scan(columns, view.Q)
        return _Seen(columns, scan, scan.see(view.residual))


def gather_contenders(search: Search, view: View, contenders: Iterable[Candidate]) -> Contenders:
    """Gather contenders beside a view of a search."""
    return Contenders(search, view, {one.mechanism: one for one in contenders})
