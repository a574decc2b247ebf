"""Targets, groups and covariates of new data among those that a calibration knows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .._typing import Index
from ..exceptions import DataError, sentence_list, suggest
from ..measurements.measurements import Measurements

Names = tuple[str, ...]
# names in a cause that say which of several a row belongs to: no values with a range, and fixed
# where a robot description is written
LABEL_NAMES = frozenset(("target", "group", "feature"))


def match_names(index: Index, names: Names, known: Names) -> Index:
    """Return rows' indices among the `known` names; unknown names count as the first."""
    place = {name: k for k, name in enumerate(known)}
    places = [place.get(name, 0) for name in names]
    known_places = np.array(places, dtype=np.intp)
    return known_places[index]


def list_unknown_targets(data: Measurements, calibrated: Names) -> Names:
    """List the targets of the rows that were not calibrated; one target alone may have any name
    where one was calibrated."""
    seen = _list_seen(data.target, data.targets)
    if len(seen) == 1 and len(calibrated) == 1:
        return ()
    return tuple(name for name in seen if name not in calibrated)


def check_targets(data: Measurements, calibrated: Names) -> None:
    """Raise DataError where rows have targets that were not calibrated."""
    unknown = list_unknown_targets(data, calibrated)
    if not unknown:
        return
    if len(calibrated) > 1:
        _refuse("target", unknown, calibrated)
    seen = _list_seen(data.target, data.targets)
    named = sentence_list([f'"{name}"' for name in seen])
    raise DataError(
        f'the file names {len(seen)} targets, {named}; the calibration has one, "{calibrated[0]}".',
        remedy="Keep the rows of that one, or run `modelsel validate --register`, which finds the place of each.",
    )


def check_groups(data: Measurements, calibrated: Names) -> None:
    """Raise DataError where rows have groups that were not calibrated."""
    seen = _list_seen(data.group, data.groups)
    unknown = [name for name in seen if name not in calibrated]
    if unknown:
        _refuse("group", unknown, calibrated)


def refuse_without(data: Measurements, missing: Sequence[str], other_way: str = "") -> DataError:
    """Return the error to raise of data without columns that a calibrated model needs; `other_way`:
    what does as well as to add them."""
    names = sentence_list(missing)
    what = f"the calibrated model needs {names}, for which there is no column."
    each = "one" if len(missing) == 1 else "a column for each"
    remedy = f"Add {each}{other_way}."
    if data.where.is_file:
        return data.where.refuse(what, remedy=remedy)
    return DataError(what, remedy=remedy)


def _list_seen(index: Index, names: Names) -> Names:
    """List the names that rows have."""
    seen = np.unique(index).tolist()
    return tuple(names[k] for k in seen)


def _refuse(kind: str, unknown: Sequence[str], calibrated: Names) -> None:
    """Raise DataError for names of a kind ("target", "group") that are unknown."""
    first = unknown[0]
    advice = suggest(first, calibrated)
    raise DataError(
        f'{kind} "{first}" was not calibrated. {advice}',
        remedy="Use a calibrated one, or run `modelsel validate --register` where the set-up is new.",
    )
