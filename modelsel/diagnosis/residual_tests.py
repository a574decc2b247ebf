"""What chance gives in the residual's own rows: the same residual with the signs of whole postures
changed.

The null of `evidence.null` is exact for independent, equal normal noise only. Heavy tails, noise
that grows with the reach or is larger in one direction (a camera's depth), errors that the targets
or the repeats of a posture share, and errors that last from one configuration to the next all look
like an effect to it, and no test of the residual alone sees every one of them. So the residual's
own rows are always asked too: with signs drawn for whole postures (for whole groups where their
rows go together), whatever rows of a posture share stays, and only what is systematic across
postures is lost (Freedman & Lane 1983; Winkler et al. 2014; Cameron, Gelbach & Miller 2008)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from .._typing import Array, Index
from ..measurements.measurements import Measurements
from .evidence import by_size, compute_null_evidence, compute_smallest_p, normalise_strength
from .scan import Scan

DRAWS = (999, 185)  # of a small study and of a large one
CHUNK = 37  # draws after which a clear answer stops
CLEAR_MARGIN = 10.0  # log evidence beyond every draw so far: clear
MIN_GROUPS = 8  # of which signs can be drawn
GROUP_LEVEL = 0.01  # p below which rows of one group are said to go together
PERMUTATIONS = 999
LEAST = 1e-6  # of a direction that a unit alone decides: its residual is nought and stays so


def partition_rows(
    data: Measurements, residual: Array, rng: np.random.Generator
) -> tuple[Index, ...]:
    """Partitions (m,) of the rows into those that change sign together, each of which must be
    beaten: by posture (equal readings, however often and through however many targets they were
    measured); by group where residuals (m, 3) of different configurations of a group go together (p
    at most LASTING) and there are enough groups. Postures that lie within one group each need no
    partition of their own then."""
    posture = np.unique(data.block, return_inverse=True)[1].reshape(-1)
    if compute_group_p(data, residual, rng) > GROUP_LEVEL:
        return (posture,)
    group = np.unique(data.group, return_inverse=True)[1].reshape(-1)
    torn = len(np.unique(np.stack([posture, group]), axis=1)[0]) > posture.max() + 1
    return (group, posture) if torn else (group,)


def compute_group_p(data: Measurements, residual: Array, rng: np.random.Generator) -> float:
    """How often configurations dealt to the groups at random have residual sums as large as theirs;
    1 with few groups."""
    configuration = np.unique(data.configuration, return_inverse=True)[1]
    count = int(configuration.max(initial=-1)) + 1
    sums = np.stack([np.bincount(configuration, residual[:, a], count) for a in range(3)], 1)
    first = np.unique(configuration, return_index=True)[1]
    group = np.unique(data.group[first], return_inverse=True)[1]
    groups = int(group.max(initial=-1)) + 1
    if groups < MIN_GROUPS or count < 2 * groups:
        return 1.0
    member = np.zeros((groups, count))
    member[group, np.arange(count)] = 1.0
    own = rng.spawn(1)[0]  # whoever goes on with `rng` draws what it would have drawn
    dealt = np.stack([sums, *(sums[own.permutation(count)] for _ in range(PERMUTATIONS))])
    size = np.square(member @ dealt).sum((1, 2))
    return float((size >= size[0] * (1 - 1e-12)).sum() / (PERMUTATIONS + 1))


def adjust_residual(Q: Array, residual: Array, unit: Index) -> Array:
    """(N,) the residual with what the fit took from every unit given back, (I - H_uu)^(-1/2) e_u
    (Bell & McCaffrey 2002); as it is where `unit` is -1. Units of one size go together."""
    out = residual.copy()
    order = np.argsort(unit, kind="stable")
    numbers, start, count = np.unique(unit[order], return_index=True, return_counts=True)
    for size in np.unique(count[numbers >= 0]):
        index = order[
            start[(count == size) & (numbers >= 0)][:, None] + np.arange(size)
        ]  # (units, size)
        U, s, _ = np.linalg.svd(Q[index], full_matrices=False)
        more = 1 / np.sqrt(np.maximum(1 - np.square(s), LEAST)) - 1
        more[1 - np.square(s) < LEAST] = 0.0
        part = np.einsum("unr,un->ur", U, residual[index])
        out[index] += np.einsum("unr,ur->un", U, more * part)
    return out


def draw_flips(
    seen: Scan, log_prior: Array, e: Array, unit: Index, draws: int, rng: np.random.Generator
) -> Iterator[tuple[Array, Array]]:
    """CHUNK after CHUNK of `draws` flips of an adjusted residual e (N,): their evidences (CHUNK,),
    and the smallest p (CHUNK,) of their single candidates; `unit` (N,) which rows go together, -1
    where a row keeps its sign (a prior's). No candidate left has no evidence."""
    count = int(unit.max()) + 1
    at = np.where(unit < 0, count, unit)
    alike = by_size(seen)
    for _ in range(draws // CHUNK):
        if not alike:
            yield np.full(CHUNK, -np.inf), np.ones(CHUNK)
            continue
        sign = np.ones((count + 1, CHUNK))
        sign[:count] = 2.0 * rng.integers(0, 2, (count, CHUNK)) - 1.0
        u = sign[at] * e[:, None]
        u -= seen.Q @ (seen.Q.T @ u)
        share = normalise_strength(seen.strength(u), np.square(u).sum(0))
        top = {k: share.whole[which].max(0) for k, which in alike.items()}
        yield (
            compute_null_evidence(seen, log_prior, share, top),
            compute_smallest_p(top, seen.freedom),
        )


def compute_flip_p(
    chunks: Iterable[tuple[Array, Array]], observed: float, draws: int, level: float
) -> float:
    """(1 + #{flips whose evidence is at least `observed`}) / (draws + 1); a clear answer stops
    early, and so does one that will be above the `level`."""
    above = done = 0
    for some, _ in chunks:
        above, done = above + int((some >= observed).sum()), done + CHUNK
        if above > level * (draws + 1) - 1 or observed > some.max() + CLEAR_MARGIN:
            break
    return (1 + above) / (done + 1)
