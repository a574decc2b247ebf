"""Sign-flip tests: what chance gives in the residual's own rows.

The null distribution of `evidence.draw_null` is exact for independent normal noise of one variance
only. Heavy tails, noise that grows with the reach or is larger in one direction (a camera's depth),
errors that targets or the repeats of a posture share, and errors that last from one configuration
to the next all resemble an effect, and no single test of the residual detects all of them. So the
residual's own rows are always tested too: signs are drawn for whole postures (for whole groups, or
lines along which the arm was measured, where their rows go together), so that whatever the rows of a
posture share is kept, and only what is systematic across postures is lost (Freedman & Lane 1983; Winkler et al. 2014; Cameron, Gelbach &
Miller 2008)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from ..._typing import Array, Index
from ...measurements.measurements import Measurements
from ...measurements.stretches import number_stretches
from ..columns.row_blocks import split_range
from .evidence import Chance
from .scan import Scan

# sign draws after which a clear answer may stop
CHUNK = 37
# rows whose units are given back what the fit took at a time
PIECE = 4096
# log evidence beyond every draw so far from which the answer is clear: as the odds of larger evidence
# fall about as it grows, three beyond the largest of 37 has a p-value of about 0.001
CLEAR_MARGIN = 3.0
# groups or lines from which signs of whole ones can be drawn
MIN_GROUPS = 8
# p-value up to which the rows of one group or line are taken to go together, and permutations that tell it
GROUP_LEVEL = 0.01
PERMUTATIONS = 999
# 1 - h, h a direction's leverage, below which one unit alone decides the direction: its residual is
# zero and is left so
MIN_RESIDUAL_SHARE = 1e-6


def partition_rows(
    data: Measurements, residual: Array, rng: np.random.Generator
) -> tuple[Index, ...]:
    """Partition the rows (m,) into units that change sign together, each partition to be beaten.

    Units are postures (equal readings, however often and with however many targets they were
    measured). Where residuals (m, 3) go together in groups or along lines, they are these; postures
    within one such unit each need no partition of their own then."""
    _, number = np.unique(data.block, return_inverse=True)
    posture = number.reshape(-1)
    together = find_together(data, residual, rng)
    if together is None:
        return (posture,)
    memberships = np.stack([posture, together])
    pairs = np.unique(memberships, axis=1)
    postures = posture.max() + 1
    if len(pairs[0]) > postures:
        return (together, posture)
    return (together,)


def find_together(data: Measurements, residual: Array, rng: np.random.Generator) -> Index | None:
    """Find the units (m,) in which residuals (m, 3) of different configurations go together, where there are
    enough: groups, or lines along which the arm was measured; None where they do in neither."""
    units = [data.group]
    stretch = number_stretches(data)
    if stretch is not None:
        units.append(stretch)
    for unit in units:
        p = compute_together_p(data, unit, residual, rng)
        if p <= GROUP_LEVEL:
            _, number = np.unique(unit, return_inverse=True)
            return number.reshape(-1)
    return None


def compute_together_p(
    data: Measurements, unit: Index, residual: Array, rng: np.random.Generator
) -> float:
    """Compute how often chance makes the residual sums of units (m,) as large as they are.

    Configurations are dealt to the units at random; the p-value is 1 with few units."""
    _, first, configuration = np.unique(data.configuration, return_index=True, return_inverse=True)
    count = len(first)
    sums = np.stack([np.bincount(configuration, residual[:, a], count) for a in range(3)], 1)
    numbers, own = np.unique(unit[first], return_inverse=True)
    units = len(numbers)
    if units < MIN_GROUPS or count < 2 * units:
        return 1.0
    member = np.zeros((units, count))
    member[own, np.arange(count)] = 1.0
    # a stream of its own, so that `rng` goes on as if nothing had been drawn
    stream = rng.spawn(1)[0]
    dealt = np.stack([sums, *(sums[stream.permutation(count)] for _ in range(PERMUTATIONS))])
    size = np.square(member @ dealt).sum((1, 2))
    as_large = size >= size[0] * (1 - 1e-12)
    return float(as_large.sum() / (PERMUTATIONS + 1))


def adjust_residual(Q: Array, residual: Array, unit: Index) -> Array:
    """Compute (N,) the residual with what the fit took from every unit given back.

    That is (I - H_uu)^(-1/2) e_u (Bell & McCaffrey 2002); unchanged where `unit` (N,) is -1.

    Units of one size are computed together."""
    adjusted = residual.copy()
    order = np.argsort(unit, kind="stable")
    numbers, start, count = np.unique(unit[order], return_index=True, return_counts=True)
    for size in np.unique(count[numbers >= 0]):
        of_size = (count == size) & (numbers >= 0)
        rows = order[start[of_size][:, None] + np.arange(size)]  # (units, size)
        for piece in split_range(len(rows), max(PIECE // int(size), 1)):
            some = rows[piece]
            adjusted[some] += _give_back(Q[some], residual[some])
    return adjusted


def _give_back(own: Array, residual: Array) -> Array:
    """Compute (u, n) what the fit took from the residual of units of one size; `own` (u, n, r): the
    rows of Q."""
    _, size, rank = own.shape
    if size < rank:
        leverage, U = np.linalg.eigh(np.matmul(own, own.swapaxes(1, 2)))
    else:
        U, s, _ = np.linalg.svd(own, full_matrices=False)
        leverage = np.square(s)
    share = 1 - leverage
    gain = 1 / np.sqrt(np.maximum(share, MIN_RESIDUAL_SHARE)) - 1
    gain[share < MIN_RESIDUAL_SHARE] = 0.0
    part = np.einsum("unr,un->ur", U, residual)
    given = np.einsum("unr,ur->un", U, gain * part)
    return np.asarray(given)


def draw_flips(
    seen: Scan, log_prior: Array, e: Array, unit: Index, draws: int, rng: np.random.Generator
) -> Iterator[Chance]:
    """Draw sign flips of an adjusted residual e (N,), CHUNK after CHUNK, in single precision: see
    `draw_null`.

    `unit` (N,): which rows go together, -1 where a row keeps its sign (a prior's). Where no
    candidate is left, nothing is drawn."""
    count = int(unit.max()) + 1
    row_unit = np.where(unit < 0, count, unit)
    for _ in range(draws // CHUNK):
        if not seen.by_size:
            nothing = np.zeros((seen.columns.screws.count, CHUNK), np.float32)
            yield Chance(seen, log_prior, nothing, np.ones(CHUNK, np.float32))
            continue
        sign = np.ones((count + 1, CHUNK))
        drawn_shape = count, CHUNK
        heads = rng.integers(0, 2, drawn_shape)
        sign[:count] = 2.0 * heads - 1.0
        flipped = sign[row_unit]
        flipped *= e[:, None]
        flipped -= seen.Q @ (seen.Q.T @ flipped)
        left = flipped.astype(np.float32)
        yield Chance(seen, log_prior, seen.columns.dot(left), np.square(left).sum(0))


def compute_flip_p(chunks: Iterable[Chance], observed: float, draws: int, level: float) -> float:
    """Compute (1 + #{flips whose evidence is at least `observed`}) / (draws + 1).

    Stops early where the answer is clear, or will be above the `level`."""
    above = 0
    done = 0
    most_above = level * (draws + 1) - 1
    for chunk in chunks:
        done += CHUNK
        if chunk.stays_below(observed - CLEAR_MARGIN):
            break
        above += int((chunk.below(observed) >= observed).sum())
        if above > most_above:
            break
    return (1 + above) / (done + 1)
