"""Collect the warnings of a finished analysis, in the order in which they are reported."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...config.study_file import Study
from ...diagnosis.findings.outcome import Diagnosis
from ...diagnosis.unexplained import count_rows_seen, is_subsampled
from ...exceptions import write_rounded
from ...fitting.noise import Floor
from ...notices import Note
from ...results.conclusions.cautions import restriction_notes
from ...results.conclusions.finding_notes import (
    confounded_notes,
    instrument_notes,
    lone_posture_notes,
    many_outlier_notes,
    opposed_finding_notes,
    partial_map_notes,
    payload_place_notes,
    surprise_notes,
    uneven_noise_notes,
)
from ...results.conclusions.goodness_of_fit import lack_of_fit_notes, measure_lack_of_fit
from ...results.runs.finding_records import Finding
from ...selection.comparison import SubsetComparison
from ...selection.evaluation import Evaluation, Split
from ..models.model_ladder import searches_cells
from ..preparation.stated_noise import check_stated_orientation_noise


def collect_diagnosis_notes(
    study: Study,
    split: Split,
    diagnosis: Diagnosis,
    noise_notes: Sequence[Note],
    smallest_mm: float | None,
) -> list[Note]:
    """Return the warnings on what was searched, and on the noise that the search assumed.

    `noise_notes` are those of `check_stated_noise`; `smallest_mm`: the effect that the search would
    have found.
    """
    notes: list[Note] = []
    if is_subsampled(diagnosis, split):
        note = _note_sample(diagnosis, split, smallest_mm)
        notes.append(note)
    notes += restriction_notes(study.model.candidates)
    notes += noise_notes
    notes += check_stated_orientation_noise(split, diagnosis.fit)
    notes += uneven_noise_notes(diagnosis)
    notes += instrument_notes(split.problem, diagnosis)
    notes += payload_place_notes(diagnosis)
    notes += confounded_notes(split.problem, diagnosis)
    notes += lone_posture_notes(split.problem, diagnosis)
    if searches_cells(study):
        notes += partial_map_notes(split.problem)
    return notes


def _note_sample(diagnosis: Diagnosis, split: Split, smallest_mm: float | None) -> Note:
    """Say how many rows were searched, and that what the others could add is small."""
    sentence = (
        f"The search for causes used {count_rows_seen(diagnosis, split)} of the "
        f"{int(split.used.sum())} estimation rows, drawn by the seed; all fits, errors and gains "
        "use all rows."
    )
    if smallest_mm is not None:
        sentence += (
            f" Those rows show an effect of {write_rounded(smallest_mm)} mm rms with 90 %; more rows, by "
            "max_rows under [search], would only add smaller ones."
        )
    return Note("scan-of-some", sentence)


def collect_comparison_notes(comparison: SubsetComparison | None, chosen: Evaluation) -> list[Note]:
    """Return whether the table of subsets chooses another model, and whether its best is proven."""
    if comparison is None:
        return []
    notes: list[Note] = []
    if set(comparison.choice) != set(chosen.names):
        notes.append(
            Note(
                "table-differs",
                "The one-standard-error choice of the table of subsets is "
                f"{' + '.join(comparison.choice)}; the chosen model follows what was named.",
            )
        )
    certified = comparison.certified
    if certified is not None and not certified.proven:
        notes.append(
            Note(
                "search-unproven",
                f"The best of 2^{len(comparison.considered)} subsets of the candidates by BIC is "
                f"not proven: another may have a BIC up to {write_rounded(certified.gap)} lower.",
            )
        )
    return notes


def collect_held_out_notes(
    split: Split, chosen: Evaluation, findings: Sequence[Finding]
) -> list[Note]:
    """Return the warnings on findings and on a model that held-out rows speak against, and on more
    outliers than bad shots usually are."""
    notes = list(opposed_finding_notes(findings))
    notes += surprise_notes(split, chosen)
    notes += many_outlier_notes(split, chosen)
    return notes


def collect_fit_notes(
    split: Split, ladder: Sequence[Evaluation], known_floor: Floor | None, floor_doubted: bool
) -> list[Note]:
    """Return the warnings on lack of fit, and on models that could not be cross-validated or whose
    fit has not settled.

    `known_floor`: None where it is estimated; `floor_doubted`: whether another warning says already
    how far the floor is from what is left.
    """
    notes: list[Note] = []
    if not floor_doubted:
        stated = known_floor is not None and bool(np.isinf(known_floor.freedom))
        notes += lack_of_fit_notes(measure_lack_of_fit(ladder[-1], known_floor, split), stated)
    unvalidated = [
        " + ".join(evaluation.names)
        for evaluation in ladder
        if evaluation.cv_rms_mm is None or not np.isfinite(evaluation.cv_rms_mm)
    ]
    if unvalidated:
        notes.append(
            Note(
                "cv-not-estimable",
                f"No cross-validation of {', '.join(unvalidated)}: with one of the folds left out, "
                "the data no longer determine it, and its cv_rms_mm is null. More folds or "
                "configurations are needed.",
            )
        )
    unsettled = [" + ".join(model.names) for model in ladder if not model.fit.settled]
    if unsettled:
        notes.append(
            Note(
                "fit-unsettled",
                f"The fit of {', '.join(unsettled)} ended before its minimum: without a cause that "
                "is there, the parameters drift far from the nominal arm along combinations that "
                "hardly move the target. The error that is given is where no step lowered it any "
                "more; at the minimum it may be a little smaller.",
            )
        )
    return notes
