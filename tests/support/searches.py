"""Searches for effects in one problem: as a study makes them, and where rows are taken for
independent."""

from __future__ import annotations

import numpy as np

from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.candidates.options import DEFAULT_OPTIONS
from modelsel.diagnosis.candidates.signatures import LEVELS, PROVEN
from modelsel.diagnosis.conclusion import conclude, prove
from modelsel.diagnosis.findings.effects import Effect
from modelsel.diagnosis.findings.outcome import Diagnosis
from modelsel.diagnosis.procedure import diagnose_split
from modelsel.diagnosis.search.state import Search
from modelsel.diagnosis.search.stepwise import explore
from modelsel.diagnosis.separation import Inquiry, separate
from modelsel.fitting.design import Model
from modelsel.fitting.least_squares import fit
from modelsel.fitting.possible_parts import list_parts
from modelsel.fitting.problem import Problem
from modelsel.mechanisms.registry import every, mechanism
from modelsel.selection.evaluation import Split


def ignore(_: str) -> None:
    """Say nothing of the progress."""


def search_separated(
    at: Problem, base: Model, found: tuple[Candidate, ...], seed: int = 0
) -> Diagnosis:
    """Name effects apart from errors that rows share, in all rows, none of them an outlier."""
    rows = np.ones(len(at), bool)
    split = Split(at, rows, ~rows, np.zeros(len(at), np.intp), known_sigma=False)
    inquiry = Inquiry(base, (), seed, True, ignore, DEFAULT_OPTIONS)
    _, diagnosis = separate(split, inquiry, found, list_parts(at, rows), fit(at, base))
    return diagnosis


def find_cause(diagnosis: Diagnosis, label: str) -> Effect:
    """Find the effect of a label, and no other, proven down to its cause."""
    assert [effect.candidate.label for effect in diagnosis.effects] == [label]
    (effect,) = diagnosis.effects
    assert effect.claim is not None
    assert effect.claim.levels[LEVELS.index("cause")] >= PROVEN
    return effect


def diagnose_rows(at: Problem) -> tuple[Split, Diagnosis]:
    """Name effects beside an arm's geometry in all rows, outliers among them found, as a study does."""
    rows = np.ones(len(at), bool)
    split = Split(at, rows, ~rows, np.zeros(len(at), np.intp), known_sigma=False)
    base = Model((mechanism("geometric", at.robot),))
    split, diagnosis, _ = diagnose_split(split, Inquiry(base, every(at.robot), 1, cells=True))
    return split, diagnosis


def search_independent(
    at: Problem, base: Model, found: tuple[Candidate, ...], rng: np.random.Generator
) -> Diagnosis:
    """Name effects where the rows' errors are taken for independent."""
    search = Search(at, base, found, rng, fit(at, base))
    return prove(conclude(explore(search, (), ignore)))
