"""Choose the rows that estimate, and leave out the held-out rows that nothing can be said about."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..._random import generator
from ..._typing import Array, Index
from ...config.study_file import Study
from ...config.study_tables import SplitTable
from ...exceptions import StudyError, count_words, sentence_list
from ...measurements.campaign.features import KINDS
from ...measurements.campaign.visits import number_equal
from ...measurements.measurements import Measurements
from ...notices import Note
from ...selection.splits import split_configurations
from ...setup.feature_positions import find_unmeasured_features

Mask = NDArray[np.bool_]

SMALL_FILE = 30  # configurations, below which all of them estimate by default
MIN_ESTIMATION = 20  # configurations that estimate by default in a larger file
ESTIMATION_SHARE = 0.4  # of the configurations, where that is more


def choose_estimation_rows(
    study: Study,
    data: Measurements,
    labels: NDArray[np.object_] | None,
    prismatic: tuple[bool, ...],
) -> Mask:
    """Return the mask (m,) of the estimation rows: by the column's labels, else D-optimal.

    Raises StudyError where the split cannot be made.
    """
    if study.split.column is not None and labels is not None:
        return _split_by_labels(study.split, data, labels)
    check_split(study.split, data, labels)
    configurations = data.configurations
    wanted = study.split.estimation
    if wanted is None and configurations < SMALL_FILE:
        wanted = configurations
    elif wanted is None:
        wanted = max(MIN_ESTIMATION, round(ESTIMATION_SHARE * configurations))
    return split_configurations(data, wanted, prismatic, generator(study.seed, "split"))


def check_split(
    table: SplitTable, data: Measurements, labels: NDArray[np.object_] | None = None
) -> None:
    """Check that measurements can be split as a study wants it: by the column's labels (m,), where
    it has such a column, else by a number. Raises StudyError."""
    if table.column is not None and labels is not None:
        _split_by_labels(table, data, labels)
        return
    configurations = data.configurations
    wanted = table.estimation
    if wanted is not None and wanted > configurations:
        raise StudyError(
            f"split.estimation = {wanted}, but the file has {count_words(configurations, 'configuration')}: "
            "ask for fewer."
        )


def _split_by_labels(table: SplitTable, data: Measurements, labels: NDArray[np.object_]) -> Mask:
    held_out = labels == table.held_out
    if table.held_out == "held-out":
        _check_labels(table, labels[~held_out])
    if held_out.all():
        raise StudyError(
            f'split.column: every row of column {table.column} is "{table.held_out}": '
            "nothing is left for estimation."
        )
    together = data.block
    if data.gauges is None:
        # readings that differ a little are noted, not refused: the column may mean it
        together = number_equal(data.q, data.configuration)
    torn = np.intersect1d(together[held_out], together[~held_out])
    if len(torn):
        first = np.flatnonzero(together == torn[0])[0]
        place = data.where.name_row(int(data.row[first]))
        raise StudyError(
            "split.column: equal joint readings are on both sides of the split "
            f"({place}, for example): held-out configurations must not have been seen."
        )
    return np.asarray(~held_out)


def _check_labels(table: SplitTable, labels: NDArray[np.object_]) -> None:
    """Check that labels other than "held-out" are "estimation". Raises StudyError."""
    unknown = sorted({str(label) for label in labels} - {"estimation"})
    if unknown:
        raise StudyError(
            f'split.column: column {table.column} holds "{unknown[0]}"; expected "estimation" or '
            f'"held-out" (or name the held-out value: held_out = "{unknown[0]}").'
        )


def center_unknown_times(data: Measurements, estimation: Mask) -> tuple[Measurements, list[Note]]:
    """Place groups without an estimation row at the middle of the estimated campaign.

    A drift must not be extrapolated to them. The progress of the other rows runs from 0 to 1 over
    the estimation rows. Unchanged where every group has an estimation row.
    """
    estimated_groups = data.group[estimation]
    unknown = ~np.isin(data.group, estimated_groups)
    if not unknown.any():
        return data, []
    estimated = data.progress[estimation]
    gauges = data.gauges
    if gauges is not None and gauges.origin is not None:
        origin = gauges.origin
        origin_unknown = ~np.isin(origin.group, estimated_groups)
        origin = _rescale(origin, estimated, origin_unknown)
        gauges = replace(gauges, origin=origin)
    unknown_groups = np.unique(data.group[unknown])
    names = ", ".join(data.groups[g] for g in unknown_groups)
    count = len(unknown_groups)
    groups = "group" if count == 1 else "groups"
    note = Note(
        "other-session",
        f"No estimation configuration belongs to the {groups} {names}: the model does not know when "
        "in the campaign that was measured, and assumes the drift of the campaign's middle there.",
    )
    rescaled = _rescale(data, estimated, unknown)
    centered = replace(rescaled, gauges=gauges)
    return centered, [note]


def _rescale(data: Measurements, estimated: Array, unknown: Mask) -> Measurements:
    """Scale progress to 0 … 1 over the `estimated` values; set it to the middle where unknown."""
    start = estimated.min()
    estimated_span = np.ptp(estimated)
    span = max(float(estimated_span), 1e-12)
    elapsed = data.progress - start
    progress = elapsed / span
    progress[unknown] = 0.5
    return replace(data, progress=progress)


def drop_unknown_targets(
    data: Measurements, estimation: Mask
) -> tuple[Measurements, Mask, list[Note]]:
    """Leave out held-out rows of targets that no estimation row measures.

    Needed where the targets' positions are found by registration from the estimation rows.
    """
    origin = None if data.gauges is None else data.gauges.origin
    measured = data.target[estimation]
    if origin is not None:
        measured_origin = origin.target[estimation]
        measured = np.concatenate([measured, measured_origin])
    known = np.unique(measured)
    is_kept = np.isin(data.target, known)
    if is_kept.all():
        return data, estimation, []
    dropped = data.target[~is_kept]
    numbers = np.unique(dropped)
    names = [f'"{data.targets[k]}"' for k in numbers]
    listed = sentence_list(names)
    note = Note(
        "target-unseen",
        f"{_describe_left_out(len(dropped))}: no estimation row measures target "
        f"{listed}, and its position is found from estimation rows. Let some of its "
        "configurations fit the models, or give [robot.tools_mm] without register.",
    )
    kept = data.take(is_kept)
    kept = _renumber_targets(kept, known)
    if origin is not None and kept.gauges is not None:
        kept_origin = origin.take(is_kept)
        kept_origin = _renumber_targets(kept_origin, known)
        gauges = replace(kept.gauges, origin=kept_origin)
        kept = replace(kept, gauges=gauges)
    return kept, estimation[is_kept], [note]


def _describe_left_out(count: int) -> str:
    rows = count_words(count, "held-out row")
    verb = "is" if count == 1 else "are"
    return f"{rows} {verb} left out"


def _renumber_targets(data: Measurements, known: Index) -> Measurements:
    """Number targets by their place among the `known` ones."""
    listed = data.targets
    names = []
    for number in known:
        name = listed[number]
        names.append(name)
    target = np.searchsorted(known, data.target)
    return replace(data, target=target, targets=tuple(names), listed_targets=listed)


def drop_unknown_features(
    data: Measurements, estimation: Mask
) -> tuple[Measurements, Mask, list[Note]]:
    """Leave out held-out rows of features that neither the study nor an estimation row gives."""
    gauges = data.gauges
    if gauges is None:
        return data, estimation, []
    unknown = find_unmeasured_features(data, estimation)
    dropped = np.isin(gauges.feature, unknown)
    if not dropped.any():
        return data, estimation, []
    names = ", ".join(gauges.features[k].name for k in unknown)
    note = Note(
        "feature-unseen",
        f"{_describe_left_out(int(dropped.sum()))}: no estimation row measures {names}, and "
        "its position has to be found from estimation rows.",
    )
    return data.take(~dropped), estimation[~dropped], [note]


def check_features_in_one_group(data: Measurements) -> None:
    """Check that no feature is measured by trackers of several groups. Raises StudyError."""
    gauges = data.gauges
    if gauges is None:
        return
    for k, feature in enumerate(gauges.features):
        rows = gauges.feature == k
        groups = data.group[rows]
        if gauges.origin is not None:
            groups = np.concatenate([groups, gauges.origin.group[rows]])
        if len(np.unique(groups)) > 1:
            raise StudyError(
                f'robot.register = "per group": feature "{feature.name}" is in several groups, '
                "whose instruments are at different places; give it a name in each."
            )


def warn_of_equal_weights(data: Measurements) -> list[Note]:
    """Return a note where rows of several kinds are weighted equally."""
    if data.gauges is None or data.sigma is not None:
        return []
    kinds = [KINDS[k] for k in np.unique(data.gauges.kind)]
    if len(kinds) < 2 or {"x", "y", "z"} >= set(kinds):
        return []
    return [
        Note(
            "kinds-alike",
            f"Rows of different kinds ({', '.join(kinds)}) have the same weight: a column s_mm "
            "would give the standard uncertainty of each.",
        )
    ]
