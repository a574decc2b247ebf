"""Names of the parts of the errors in a study file: which there are, and joints among them."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Sequence

from .exceptions import suggest

JOINT_PART = re.compile(r"joint ([1-9][0-9]{0,3})")
JOINTS = "joints"
SHARED_PARTS = ("configuration", "group", "lasting")
POSTURE = "posture"
# the instrument's errors in some directions beyond those in all: along an axis of the measurements'
# frame, along the line from the instrument, and across it in proportion to the distance
INSTRUMENT = "instrument"
ALONG_AXES = tuple(f"{INSTRUMENT} {axis}" for axis in "xyz")
ALONG_LINE, ACROSS_LINE = f"{INSTRUMENT} range", f"{INSTRUMENT} angle"
INSTRUMENT_PARTS = (*ALONG_AXES, ALONG_LINE, ACROSS_LINE)
# and its errors at one target, or in one group, beyond those at all, before the name of that
AT_TARGET, IN_GROUP = f"{INSTRUMENT} target ", f"{INSTRUMENT} group "


def check_part_names(parts: str | Sequence[str], fixed: Collection[str]) -> None:
    """Check the parts that a study looks for, and those that it fixes. Raises ValueError."""
    listed = [] if parts == "all" else list(parts)
    _check_known("parts", listed, (JOINTS, INSTRUMENT, *INSTRUMENT_PARTS, *SHARED_PARTS))
    for name in fixed:
        if is_of_rows(name):
            raise ValueError(
                f'"{name}" cannot be fixed; state what the instrument has in each row: sx_mm, sy_mm and '
                "sz_mm beside the measurements"
            )
        if name in (INSTRUMENT, *INSTRUMENT_PARTS):
            raise ValueError(
                f'"{name}" cannot be fixed; state what the instrument has in each direction: sx_mm, sy_mm '
                "and sz_mm beside the measurements, or range_mm and angle_urad"
            )
    _check_known("fixed", fixed, SHARED_PARTS)
    if "lasting" in fixed:
        raise ValueError(
            '"lasting" cannot be fixed, since its length is found together with its scale; leave it '
            "out of fixed"
        )
    for name in fixed:
        is_forbidden = parts != "all" and not is_named(name, parts)
        if is_forbidden:
            raise ValueError(
                f'"{name}" is fixed, and parts forbids it; name it in parts, too, or leave it out of '
                "fixed"
            )


def check_planted_names(parts: Iterable[str]) -> None:
    """Check the parts that are planted. Raises ValueError."""
    known = (*SHARED_PARTS, POSTURE, *ALONG_AXES)
    _check_known("parts", parts, known)


def is_of_instrument(name: str) -> bool:
    """Whether a part is one that the instrument has in some directions or rows beyond all others."""
    is_in_a_direction = name in INSTRUMENT_PARTS
    return is_in_a_direction or is_of_rows(name)


def is_of_rows(name: str) -> bool:
    """Whether a part is one that the instrument has at one target or in one group."""
    return name.startswith((AT_TARGET, IN_GROUP))


def name_rows(name: str) -> str:
    """Return the name of the target or group at which the instrument has a part."""
    kind = IN_GROUP
    if name.startswith(AT_TARGET):
        kind = AT_TARGET
    return name.removeprefix(kind)


def is_named(name: str, names: Sequence[str]) -> bool:
    """Whether names hold that of a part, or "joints" or "instrument", which are all of a kind."""
    if name in names:
        return True
    if is_of_instrument(name):
        return INSTRUMENT in names
    return JOINTS in names and JOINT_PART.fullmatch(name) is not None


def list_joints(names: Iterable[str]) -> dict[str, int]:
    """List the joints, from 1, among names of parts."""
    matches = {name: JOINT_PART.fullmatch(name) for name in names}
    return {name: int(match[1]) for name, match in matches.items() if match is not None}


def _check_known(key: str, names: Iterable[str], known: Sequence[str]) -> None:
    for name in names:
        if name in known or is_of_rows(name) or JOINT_PART.fullmatch(name) is not None:
            continue
        number = re.search(r"[1-9][0-9]*", name)
        joint = f"joint {number[0] if number else 1}"
        hint = suggest(name, (joint, *known)).removesuffix(".")
        hint = hint[0].lower() + hint[1:]
        raise ValueError(f'{key} names "{name}", which is not a part of the noise ({hint})')
