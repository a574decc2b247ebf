"""What a study asks of the search for causes; nothing, where a mistake of the set-up comes first.

Where a mistake was recognised before anything was fitted, and the base does not make up for it,
every effect would only make up for the mistake: none is sought."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from ..._progress import keep_silent
from ..._typing import Say
from ...config.study_file import Study
from ...diagnosis.base_fits import keep_base
from ...diagnosis.candidates.candidate import Candidate
from ...diagnosis.candidates.options import DiagnosisOptions
from ...diagnosis.candidates.prior_weights import weigh_outcomes
from ...diagnosis.findings.outcome import Diagnosis
from ...diagnosis.separation import Inquiry
from ...fitting.design import Model
from ...fitting.noise import Floor
from ...fitting.problem import Problem
from ...mechanisms.registry import Registry
from ...mechanisms.terms import Mechanism
from ...notices import ROWS_LATE, Note
from ...selection.evaluation import Split, evaluate
from ..preparation.checks import is_hopeless
from ..preparation.own_causes import build_own_candidates
from ..preparation.preparation import FAR_CODES
from ..preparation.stated_noise import check_stated_noise, choose_noise_floor
from .first_look import FirstLook
from .held_out_outliers import exclude_held_out_outliers
from .model_ladder import remeasure, searches_cells
from .orientation_weights import diagnose_weighed

# why nothing was searched
MISTAKE_FIRST = "what the warnings say about the set-up has to be corrected first."


class Sought(NamedTuple):
    """What was asked of the search, and its outcome: the `mistake` for which nothing was (None: causes
    were sought), the split with its outliers marked and its rows weighed, the diagnosis, and the
    candidates."""

    mistake: Note | None
    asked: Inquiry
    split: Split
    diagnosis: Diagnosis
    candidates: tuple[Candidate, ...]


def build_inquiry(
    study: Study, split: Split, base: Model, mechanisms: tuple[Mechanism, ...], say: Say
) -> Inquiry:
    """Build what a study asks of the search: the base, and the `mechanisms`, cells and causes of its
    own that may extend it."""
    cells = searches_cells(study)
    problem = split.problem
    options = choose_options(study, problem)
    seed = study.seed
    return Inquiry(base, mechanisms, seed, cells, say, options)


def seek_nothing(asked: Inquiry) -> Inquiry:
    """Ask for nothing beyond the base: outliers alone are looked for."""
    options = replace(asked.options, own=())
    nothing = asked._replace(everything=(), cells=False, options=options)
    return nothing._replace(say=keep_silent, tell_base=keep_base)


def seek_causes(
    study: Study,
    registry: Registry,
    split: Split,
    asked: Inquiry,
    floor: Floor | None,
    notes: Sequence[Note],
) -> Sought:
    """Seek the causes that are asked for; none where a mistake of the set-up comes first."""
    mistake = find_open_mistake(study, registry, split, asked, floor, notes)
    if mistake is not None:
        asked = seek_nothing(asked)
    elif asked.say is not keep_silent:
        look = FirstLook(study, registry, split, asked.say)
        asked = asked._replace(tell_base=look.tell)
    named = diagnose_weighed(study, registry, split, asked)
    return Sought(mistake, asked, *named)


def find_open_mistake(
    study: Study,
    registry: Registry,
    split: Split,
    asked: Inquiry,
    floor: Floor | None,
    notes: Sequence[Note],
) -> Note | None:
    """Find the mistake of the set-up, of the `notes` of the preparation, that the base leaves open: its
    fit is hopeless without its outliers, too. None where there is none, or where the base makes up
    for it."""
    for note in notes:
        if note.code == ROWS_LATE:
            return note
    mistakes = [note for note in notes if note.code in FAR_CODES]
    if not mistakes:
        return None
    nothing = seek_nothing(asked)
    split, diagnosis, _ = diagnose_weighed(study, registry, split, nothing)
    fitted = diagnosis.fit
    split, floor, _ = check_stated_noise(split, floor, fitted)
    names = study.model.base
    base = evaluate(split, asked.base, names, fitted)
    split = exclude_held_out_outliers(split, [base, base], diagnosis.errors)
    base = remeasure(base, split)
    noise = choose_noise_floor(split, floor, base)
    if not is_hopeless(split, base, noise):
        return None
    return mistakes[0]


def choose_options(study: Study, problem: Problem) -> DiagnosisOptions:
    """Return the options of the search for causes that the study sets, with its own candidates."""
    search, noise = study.search, study.noise
    return DiagnosisOptions(
        memory_mb=search.memory_mb,
        max_rows=search.max_rows,
        parts=None if noise.parts == "all" else tuple(noise.parts),
        fixed_parts=tuple(noise.fixed.items()),
        weights=tuple(
            (name, weigh_outcomes(told.confirmed, told.contradicted))
            for name, told in search.outcomes.items()
        ),
        own=build_own_candidates(study, problem),
    )
