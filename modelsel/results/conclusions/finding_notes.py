"""Warnings about findings: noise that is uneven, held-out rows that speak against them, a map that is not whole."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..._typing import Array, Mask
from ...diagnosis.candidates.candidate_list import exceeds_cell_limit
from ...diagnosis.candidates.signatures import LEVELS, PROVEN
from ...diagnosis.findings.outcome import Diagnosis
from ...diagnosis.findings.payload_places import find_places
from ...diagnosis.findings.sentences import format_length
from ...diagnosis.findings.stated_probability import format_chance
from ...diagnosis.rivals.confounded_covariates import find_confounded
from ...exceptions import sentence_list, write_percent
from ...fitting.problem import Problem
from ...measurements.campaign.late_names import list_sources
from ...measurements.campaign.state_names import FROM_INSTRUMENT
from ...measurements.measurements import Measurements
from ...notices import OUTLIERS_MANY, Note
from ...selection.evaluation import Evaluation, Split
from ...selection.held_out_comparison import compare_held_out, find_far_held_out
from ..runs.finding_records import Finding

# how many times more held-out rows err than promised, to be said
MIN_SURPRISE = 1.25
# how rarely so by chance, to be said
MAX_SURPRISE_P = 1e-3
# share of the rows, and rows, from which outliers are more than bad shots usually are
MANY_SHARE = 0.05
MANY_ROWS = 6


def uneven_noise_notes(diagnosis: Diagnosis) -> tuple[Note, ...]:
    """Return the warning about what independent normal noise would have named and the residual's own signs do
    not."""
    if diagnosis.held_back is None or diagnosis.left is None:
        return ()
    first = diagnosis.left.entries[0].candidate.label
    sentence = (
        f"{first} is not named: if the noise were normal, independent and alike everywhere, chance would explain it "
        f"with probability {diagnosis.held_back:.2g}, but the actual residuals, with the signs of whole postures (or "
        f"groups) changed at random, do as well with probability {format_chance(diagnosis.left_p)}. Rows of one posture may share an "
        "error, a few rows may be loud, the noise may be larger in one direction, or errors may last from one "
        "configuration to the next."
    )
    return (Note("uneven-noise", sentence),)


def opposed_finding_notes(findings: Sequence[Finding]) -> tuple[Note, ...]:
    """Return a warning for every finding that makes the held-out error larger, by the whole interval of its gain."""
    return tuple(
        Note(
            "held-out-against",
            f"{finding.effect.label} was named, but held-out configurations speak against it: "
            f"{finding.against}. Do not compensate for it before further measurements confirm it.",
        )
        for finding in findings
        if finding.against
    )


def many_outlier_notes(split: Split, chosen: Evaluation) -> tuple[Note, ...]:
    """Return the warning about so many outliers that what acts at these rows alone may hide among them."""
    outliers = split.outliers
    count = int(outliers.sum())
    share = count / len(outliers)
    if count < MANY_ROWS or share < MANY_SHARE:
        return ()
    data = split.problem.data
    rows = data.row[outliers]
    residual = chosen.residual[:, :3]
    lengths = np.linalg.norm(residual, axis=1)
    others = lengths[~split.outlying]
    without = format_length(root_mean_square(others))
    middle = np.median(lengths[outliers])
    far = format_length(float(middle))
    sentence = (
        f"{count:,} of {len(outliers):,} positions ({write_percent(share)}) are left out as outliers: "
        f"{data.where.spans(rows)}. Half of them are {far} or more off the model, which errs by {without} rms at the "
        "others. Bad shots are rarely so many: something may act in these configurations alone, such as a play that "
        "gives way to the other side. The errors that are given leave it out, and no finding explains it. Measure "
        "some of these configurations again."
    )
    return (Note(OUTLIERS_MANY, sentence, tuple(rows.tolist())),)


def surprise_notes(split: Split, chosen: Evaluation) -> tuple[Note, ...]:
    """Return the warning about held-out configurations that err clearly more than cross-validation within the
    estimation rows promises."""
    if chosen.crossed is None:
        return ()
    held = ~split.estimation & ~split.outlying
    block = split.problem.data.block
    positions = chosen.residual[held][:, :3]
    errors = np.linalg.norm(positions, axis=1)
    times, p = compare_held_out(chosen.crossed, block[split.used], errors, block[held])
    if times < MIN_SURPRISE or p > MAX_SURPRISE_P:
        crossed_block = block[split.used]
        far, p = find_far_held_out(chosen.crossed, crossed_block, errors, block[held])
        data = split.problem.data.take(held)
        return _describe_far(data, errors, far, chosen.crossed) if p < MAX_SURPRISE_P else ()
    found = format_length(root_mean_square(errors))
    promised = format_length(root_mean_square(chosen.crossed))
    sentence = (
        f"The held-out configurations err by {found} rms where cross-validation within the "
        f"estimation configurations promises {promised} (by chance with probability "
        f"{format_chance(p)}): something acts there that the estimation configurations do not show. The findings say nothing "
        "about it: let some such configurations fit the models, too."
    )
    return (Note("held-out-surprise", sentence),)


def _describe_far(data: Measurements, errors: Array, far: Mask, crossed: Array) -> tuple[Note, ...]:
    """Return the warning about the few held-out rows that err by far more than any did in
    cross-validation, where most err as it promises."""
    places = data.where.spans(data.row[far])
    found = format_length(float(errors[far].max()))
    promised = format_length(float(crossed.max()))
    sentence = (
        f"Of {len(errors):,} held-out positions {far.sum():,} err by up to {found}, where the largest error of "
        f"cross-validation within the estimation configurations is {promised}: {places}. "
        "They are bad shots, or the robot errs there in a way that the estimation configurations do not show. "
        "Measure there again, and let some such configurations fit the models, too."
    )
    return (Note("held-out-far", sentence),)


def root_mean_square(values: Array) -> float:
    """Return the root mean square of values."""
    return float(np.sqrt(np.square(values).mean()))


def payload_place_notes(diagnosis: Diagnosis) -> tuple[Note, ...]:
    """Return the warning about findings that have the payload hang in two places."""
    effects = diagnosis.effects
    places = find_places([effect.candidate.mechanism for effect in effects])
    if not places.contradict:
        return ()
    anywhere = sentence_list([effects[k].label for k in places.anywhere])
    at_target = sentence_list([effects[k].label for k in places.at_target])
    sentence = (
        f"{anywhere} is fitted for a payload that may hang anywhere on the flange, {at_target} for one that hangs at "
        "the target: both cannot hold, so that none of them is claimed as a cause. Another part of the arm may yield "
        "under a payload that hangs elsewhere. Say where it hangs (payload_at_mm in [robot]), or measure again with "
        "its centre of mass at the target."
    )
    return (Note("payload-places", sentence),)


def partial_map_notes(problem: Problem) -> tuple[Note, ...]:
    """Return the warning about an arm with so many joints that the error map is not whole."""
    if not exceeds_cell_limit(problem):
        return ()
    sentence = (
        f"With {problem.robot.n} joints the whole error map is too large: causes nobody registered were looked for "
        "only at the places of the joints they look at, and next to these."
    )
    return (Note("map-of-neighbours", sentence),)


def instrument_notes(problem: Problem, diagnosis: Diagnosis) -> tuple[Note, ...]:
    """Say where the instrument is taken to stand, where a finding depends on that and it is within the
    arm's own reach."""
    named = []
    for effect in diagnosis.effects:
        candidate = effect.candidate
        drivers = candidate.mechanism.names()
        if FROM_INSTRUMENT & drivers:
            named.append(candidate.label)
    _, places = problem.placement
    distance = float(np.linalg.norm(places - np.array(problem.tracker), axis=1).min())
    if not named or distance > problem.robot.reach:
        return ()
    sentence = (
        f"by {sentence_list(named)} the positions err as seen from the instrument, which "
        f"is taken to stand {format_length(distance)} from the robot's base, within the arm's "
        "reach. If it stands elsewhere, because the positions are in the robot's own frame, say so "
        "by tracker_mm under [noise]."
    )
    return (Note("instrument-place", sentence),)


def lone_posture_notes(problem: Problem, diagnosis: Diagnosis) -> tuple[Note, ...]:
    """Return a warning for every finding that one posture alone tells."""
    notes = []
    for effect in diagnosis.effects:
        if effect.claim is None or effect.claim.lone_posture is None:
            continue
        data = problem.data
        rows = data.row[data.block == effect.claim.lone_posture]
        sentence = (
            f"{effect.label} is told by one posture alone ({data.where.spans(rows)}): an error of its readings or "
            "shots would look the same, and is taken to be as likely. Measure that posture again, and others like it."
        )
        notes.append(Note("lone-posture", sentence))
    return tuple(notes)


def confounded_notes(problem: Problem, diagnosis: Diagnosis) -> tuple[Note, ...]:
    """Say of a finding that depends on a covariate which went with the sessions, or with time, that the
    covariate is not proven, and what would tell."""
    level = LEVELS.index("drivers")
    columns = dict.fromkeys(
        column
        for effect in diagnosis.effects
        if effect.claim is None or effect.claim.levels[level] < PROVEN
        if (column := find_confounded(problem, effect.candidate.mechanism)) is not None
    )
    if len(problem.data.groups) > 1:
        words = (
            "went with the groups: whatever else changed between them, such as a joint that was set anew, would look "
            "the same. To tell them apart, measure at other values within a group."
        )
    else:
        words = (
            "went with the course of the campaign: whatever else changed in time, such as a joint that creeps, would "
            "look the same. To tell them apart, measure at an earlier value again."
        )
    measured = sorted(list_sources(columns))
    return tuple(Note("confounded", f"{column} {words}") for column in measured)
