"""Covariates of a measurements file: columns that causes may use, and those that are ignored."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from ..._names import is_plain_word
from ..._typing import Array
from ...notices import Note
from ..campaign.state_names import is_state_name
from ..formats.table import Table
from ..quantities.columns import convert_to_numbers, describe_cell, read_numbers
from ..quantities.contract_columns import JOINT_COLUMN, KNOWN_COVARIATES, list_contract_names
from ..quantities.epoch_times import convert_epoch
from ..quantities.observation_columns import KIND_COLUMNS
from ..quantities.point_times import find_date_column, read_clock
from .uncausal_columns import NO_NAME, describe_uncausal, find_uncausal_columns, quote_column

# numbers of a covariate that the contract names, and of any other
MAX_KNOWN_COVARIATE = 1e12
MAX_COVARIATE = 1e30
# from absolute zero to what no robot stands: a hotter one is in kelvin; what no robot carries
COVARIATE_LIMITS = {"temperature_C": (-273.15, 200.0), "payload_kg": (0.0, 5e3)}
FUNCTIONS = {"sin", "cos", "sign", "abs", "exp", "tanh", "root", "saw", "free"}


def read_covariates(
    table: Table, prismatic: Sequence[bool], has_kinds: bool, used: Collection[str] = ()
) -> tuple[dict[str, Array], list[Note]]:
    """Read every other numeric column, and say which columns are ignored, without those `used`,
    which may be causes whatever they look like."""
    table, converted = convert_epoch(table)
    taken = list_contract_names(prismatic) - {*KNOWN_COVARIATES}
    if not has_kinds:
        taken -= set(KIND_COLUMNS)
    covariates, textual, unusable = dict[str, Array](), list[str](), list[str]()
    joints = {name for name in table.columns if JOINT_COLUMN.fullmatch(name)}
    apart = taken | joints
    uncausal = find_uncausal_columns(table, {*apart, *KNOWN_COVARIATES, *used})
    apart = apart.union(*uncausal.values())
    for name in table.columns:
        if name in apart:
            continue
        clock = read_clock(table, name) if name == "time_s" else None
        if clock is not None:
            values = clock
        elif name in KNOWN_COVARIATES:
            usual = -MAX_KNOWN_COVARIATE, MAX_KNOWN_COVARIATE
            least, most = COVARIATE_LIMITS.get(name, usual)
            values = read_numbers(table, name, least, most)
        else:
            values = convert_to_numbers(table.columns[name])
        if not np.isfinite(values).any():
            textual.append(name)
        elif (np.abs(values) <= MAX_COVARIATE).all() and _can_be_cause(name):
            covariates[name] = values
        else:
            unusable.append(name)
    date = find_date_column(table, "time_s") if "time_s" in table else None
    silent = {*used, date}
    ignored = [[name for name in names if name not in silent] for names in (textual, unusable)]
    notes = [*converted, *describe_uncausal(uncausal), *_describe_ignored(table, *ignored)]
    return covariates, notes


def _can_be_cause(name: str) -> bool:
    """Whether a formula can hold a column's name."""
    taken = name in FUNCTIONS or is_state_name(name)
    return is_plain_word(name) and not taken


def _describe_ignored(table: Table, textual: Sequence[str], unusable: Sequence[str]) -> list[Note]:
    """Say which columns are ignored; characters of their names that cannot be seen are escaped."""
    notes = []
    if textual:
        names = ", ".join(map(quote_column, textual))
        sentence = f"Columns that hold no numbers are ignored: {names}."
        notes.append(Note("columns-ignored", sentence))
    if unusable:
        listed = ", ".join(_say_why_unusable(table, name) for name in unusable)
        sentence = f"Columns that cannot serve as causes are ignored: {listed}."
        notes.append(Note("covariates-ignored", sentence))
    return notes


def _say_why_unusable(table: Table, name: str) -> str:
    """Name a numeric column, and why it is no cause."""
    shown = quote_column(name)
    if shown == NO_NAME:
        return shown
    if name in FUNCTIONS or is_state_name(name):
        return f"{shown} (a name that modelsel gives to values of its own)"
    if not is_plain_word(name):
        return f"{shown} (not a plain word)"
    values = convert_to_numbers(table.columns[name])
    with np.errstate(invalid="ignore"):
        is_wrong = ~(np.abs(values) <= MAX_COVARIATE)
    wrong = np.flatnonzero(is_wrong)
    row = int(wrong[0])
    content = describe_cell(table, name, row)
    return f"{shown} ({content}; every row needs a number, {MAX_COVARIATE:g} at most)"
