"""Effects that one posture alone tells: a joint's step that a single posture is beyond.

Without that posture nothing is left of such an effect beside all the others, so that it fits whatever is wrong with
the posture's readings or its shots. No draw of signs tells one from the other, as the fit takes that
posture's residual whole."""

from __future__ import annotations

import numpy as np

from ..._typing import Array, Mask
from ..search.state import Search
from ..search.views import View

# share of what the data say of an effect (squared, beyond all the others) that goes with one posture, from which
# that alone tells it
MIN_LONE_SHARE = 0.8
# what is left of its probability: an error of that posture is as likely
LONE_FACTOR = 0.5
# postures in which an effect is largest that are left out, one at a time
POSTURES_TRIED = 5


def find_lone_posture(search: Search, view: View, g: int) -> int | None:
    """Find the posture (`Measurements.block`) that alone tells an effect of a model; None where others do, too, and
    of a fault of the data or an error around one reading, which say nothing else."""
    candidate = search.candidates[g]
    if candidate.fault is not None or candidate.bumped_joint:
        return None
    own = view.mask_terms(candidate)
    theta = view.fitted.theta[own]
    of_data = view.A.move(np.flatnonzero(own), theta)
    of_prior = view.A.root[:, own] @ theta
    directions = view.Q @ view.release(candidate).directions
    beyond = directions @ (directions.T @ np.concatenate([of_data, of_prior]))
    data = search.problem.data
    numbers, posture = np.unique(data.block, return_inverse=True)
    number = search.expand_unit(posture.reshape(-1), len(beyond))
    is_measured = number >= 0
    squares = np.square(beyond[is_measured])
    sums = np.bincount(number[is_measured], squares, len(numbers))
    largest = np.argsort(-sums)[:POSTURES_TRIED]
    for k in largest:
        rows = number == k
        lost = _measure_lost(view.Q, directions, beyond, rows)
        if lost >= MIN_LONE_SHARE:
            return int(numbers[k])
    return None


def _measure_lost(Q: Array, directions: Array, beyond: Array, rows: Mask) -> float:
    """Measure the share of the square of `beyond` (N,) that is lost where some rows are left out; Q (N, r): of all
    columns, `directions` (N, k): of the effect's own beyond the others."""
    every = Q[rows]
    own = directions[rows]
    here = beyond[rows]
    of_others = every @ every.T - own @ own.T
    left = np.eye(len(own)) - of_others
    inverse = np.linalg.pinv(left, rcond=1e-9, hermitian=True)
    lost = here @ inverse @ here
    whole = beyond @ beyond
    return float(lost / whole)
