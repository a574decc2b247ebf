"""Find which effects of the arm may as well be the instrument's, and the reverse."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..._typing import Array
from ...calibration.other_sides import OtherSide, is_misreading
from ...diagnosis.findings.effects import Effect
from ...diagnosis.inference.credible_sets import Entry
from ...fitting.design import assemble
from ...fitting.problem import Problem
from ...mechanisms.terms import Mechanism

# rows by which an error's size is measured
MAX_ROWS = 2000
# probability of the other side from which it is told
WORTH_TELLING = 0.05


def find_other_sides(effects: Sequence[Effect], problem: Problem) -> dict[str, OtherSide]:
    """Find the effects that may as well be on the other side of arm and instrument, by the names of
    their mechanisms. `problem`: the rows that they are fitted to."""
    found = {}
    for effect in effects:
        others = _list_other_side(effect)
        if not others:
            continue
        share = _sum_probabilities(others) / _sum_probabilities(_list_alike(effect))
        if share >= WORTH_TELLING:
            likeliest = others[0]
            instrument, estimate = _find_instrument(effect, likeliest)
            size = _measure(instrument, estimate, problem)
            name = effect.candidate.mechanism.name
            label = likeliest.candidate.label
            numbers = tuple(estimate.tolist())
            found[name] = OtherSide(label, share, size, instrument, numbers)
    return found


def _list_alike(effect: Effect) -> list[Entry]:
    """List what moves the target as an effect does."""
    return [entry for entry in effect.named.entries if entry.alike]


def _list_other_side(effect: Effect) -> list[Entry]:
    """List what moves the target alike on the other side, the most probable first."""
    own = is_misreading(effect.candidate.mechanism)
    alike = _list_alike(effect)
    return [entry for entry in alike if is_misreading(entry.candidate.mechanism) != own]


def _sum_probabilities(entries: Sequence[Entry]) -> float:
    return sum(entry.probability for entry in entries)


def _find_instrument(effect: Effect, other: Entry) -> tuple[Mechanism, Array]:
    """Find the error of the instrument, which is the effect or the other one, with its numbers.

    What both models predict of the measurements is the same, so that the arms without the
    instrument differ by just that, lengths of links that have taken up a scale among it."""
    own = effect.candidate.mechanism
    if is_misreading(own):
        return own, effect.estimate
    return other.candidate.mechanism, other.estimate


def _measure(mechanism: Mechanism, estimate: Array, problem: Problem) -> float:
    """Measure the rms [mm] by which a mechanism moves what is measured."""
    step = -(-len(problem) // MAX_ROWS)
    sample = problem.take(slice(None, None, step))
    columns = assemble(sample, mechanism.terms)[:-1, :3]
    moved = np.tensordot(estimate, columns, 1)
    square = np.square(moved).sum() / len(sample)
    return float(np.sqrt(square))
