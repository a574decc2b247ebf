"""Names of the columns that the contract of measurements files knows."""

from __future__ import annotations

import re
from collections.abc import Sequence

from .columns import POSITION_UNITS, READING_UNITS
from .observation_columns import KIND_COLUMNS
from .orientation_columns import ORIENTATION_COLUMNS, QUATERNION_COLUMNS

JOINT_COLUMN = re.compile(r"q([0-9]{1,9})_(?:rad|deg|mm|m)")
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


# covariates with a meaning that mechanisms know
KNOWN_COVARIATES = ("payload_kg", "temperature_C", "time_s")
