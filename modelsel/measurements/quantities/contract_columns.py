"""Names of the columns that the contract of measurements files knows."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from ..._arguments import check_type
from ...exceptions import StudyError, suggest
from .columns import POSITION_UNITS, READING_UNITS
from .observation_columns import KIND_COLUMNS
from .orientation_columns import ORIENTATION_COLUMNS, QUATERNION_COLUMNS

JOINT_COLUMN = re.compile(r"q([0-9]{1,9})_(?:rad|deg|mm|m)")
# covariates with a meaning that mechanisms know
KNOWN_COVARIATES = ("payload_kg", "temperature_C", "time_s")
LABEL_COLUMNS = ("target", "configuration", "group")
UNCERTAINTY_COLUMNS = ("sx_mm", "sy_mm", "sz_mm")
ROTATION_UNCERTAINTY_COLUMNS = ("srx_rad", "sry_rad", "srz_rad")


def list_contract_names(prismatic: Sequence[bool]) -> set[str]:
    """List the column names of the contract, for a robot whose joints are `prismatic` or not."""
    names = {
        *LABEL_COLUMNS,
        "order",
        *UNCERTAINTY_COLUMNS,
        *QUATERNION_COLUMNS,
        *ORIENTATION_COLUMNS,
        *ROTATION_UNCERTAINTY_COLUMNS,
        *KNOWN_COVARIATES,
        *KIND_COLUMNS,
    }
    names |= {f"{axis}_{unit}" for axis in "xyz" for unit in POSITION_UNITS}
    for j, slides in enumerate(prismatic, 1):
        names.add(f"approach{j}")
        names |= {f"q{j}_{unit}" for unit in READING_UNITS[slides]}
    return names


def check_mapping(mapping: Mapping[str, str], prismatic: Sequence[bool]) -> None:
    """Refuse a mapping of a name that the contract does not have, and two of one column. Raises
    StudyError."""
    expected = 'names of columns, as {"x_mm": "name in the file"}'
    check_type("measurements.columns", mapping, Mapping, expected)
    for name, given in mapping.items():
        check_type(f"measurements.columns.{name}", given, str, "the name of a column")
    known = list_contract_names(prismatic)
    problems = [
        f'measurements.columns: unknown column "{name}". {suggest(name, known)}'
        for name in mapping
        if name not in known
    ]
    names = list(mapping.values())
    problems += [
        f'measurements.columns: "{name}" is mapped to twice. Name another column.'
        for name in sorted(set(names))
        if names.count(name) > 1
    ]
    if problems:
        raise StudyError(*problems)
