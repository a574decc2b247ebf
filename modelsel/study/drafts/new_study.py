"""A study from a file as people have it: how its columns are read, checked on the nominal arm."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain, product

import numpy as np

from ...exceptions import ModelselError, choice_list, count_words, write_rounded
from ...measurements.formats.gear_ratios import GearRatios, find_gear_ratios
from ...measurements.formats.table import DataFile, Table, load_table, rename_columns
from ...measurements.measurements import Measurements
from ...measurements.quantities.contract_columns import list_contract_names
from ...measurements.quantities.missed_rows import split_missed, take_rows
from ...measurements.quantities.orientation_columns import ORIENTATION_COLUMNS
from ...measurements.quantities.other_units import convert_mapped, convert_units
from ...measurements.reader import read_measurements
from ...measurements.recognition.column_guesses import (
    Choice,
    Reading,
    guess_columns,
    merge_columns,
    name_originals,
)
from ...measurements.recognition.grad_columns import (
    JOINTS,
    Meaning,
    keep_meaning,
    name_meanings,
    offer_meanings,
)
from ...measurements.recognition.headerless_columns import is_headerless, list_orders
from ...measurements.recognition.optional_columns import guess_optional_columns
from ...measurements.recognition.orientation_guesses import guess_orientation
from ...measurements.recognition.uncausal_columns import SENTENCES as UNCAUSAL
from ...measurements.recognition.uncausal_columns import find_uncausal_columns
from ...robot.kinematics import Robot
from ...robot.urdf import read_joint_names
from ...setup.other_robots import MAX_REACH_SHARE
from .missing_columns import refuse_missing
from .nominal_misfit import CLEAR_FACTOR, describe_misfit, measure_misfit
from .orientation_reading import settle_orientation
from .other_columns import (
    describe_optional,
    describe_other_columns,
    describe_quaternions,
    offer_uncertainties,
)
from .position_choice import (
    describe_several_targets,
    drop_computed,
    drop_unreachable,
    is_only_position,
)
from .target_column import add_target

# readings of the columns that are tried on the arm
MAX_TRIED = 16
# share of the reach from which a study refuses positions
REFUSED_SHARE = 0.25
# configurations from which a part of them is held out, and how many at most
MIN_SPLIT = 30
HELD_OUT_SHARE = 0.4
MAX_HELD_OUT = 40
# what reading does to rows, units and columns; commanded ones are listed here
TOLD_NOTES = {
    "missed-rows",
    "duplicate-rows",
    "copied-rows",
    "coordinates-equal",
    "units-converted",
    *UNCAUSAL,
} - {"commanded-ignored"}


@dataclass(frozen=True)
class StudyDraft:
    """What a file is read as: the choices that are open or settled, optional columns, and the
    measurements once nothing is open; `originals`: the names in the file of columns of `table` that
    are converted; `meanings`: columns of it whose unit "Grad" may mean several."""

    robot: Robot
    source: DataFile | Table
    table: Table
    given: Mapping[str, str]
    choices: tuple[Choice, ...]
    optional: tuple[Reading, ...] = ()
    remarks: tuple[str, ...] = ()
    originals: Mapping[str, str] = field(default_factory=dict)
    meanings: Mapping[str, Meaning] = field(default_factory=dict)
    gears: GearRatios | None = None

    @property
    def columns(self) -> dict[str, str]:
        """Contract name -> name in the file, by the first reading of every choice."""
        first = [choice.readings[0] for choice in self.choices]
        optional = self.optional
        readings = [*first, *optional]
        guessed = merge_columns(readings)
        given = self.given
        originals = self.originals
        return {**given, **{name: originals.get(own, own) for name, own in guessed.items()}}

    @property
    def measured(self) -> Table:
        """The rows of `table` with a position."""
        first = [choice.readings[0] for choice in self.choices]
        table = self.table
        split = split_missed(rename_columns(table, {**self.given, **merge_columns(first)}))
        return table if split.missed is None else take_rows(table, split.rows)

    def choose(self, what: str, reading: Reading) -> StudyDraft:
        """Return the draft with one choice settled."""
        choices = tuple(
            replace(choice, readings=(reading,)) if choice.what == what else choice
            for choice in self.choices
        )
        draft = replace(self, choices=choices)
        if what != JOINTS or not self.meanings:
            return draft
        table = keep_meaning(self.table, self.meanings, reading)
        as_it_is = set(reading.columns.values()) <= set(load_table(self.source).columns)
        if as_it_is:
            return replace(draft, table=table, meanings={})
        return replace(draft, table=table, source=table, meanings={}, originals={})

    def choose_first(self) -> StudyDraft:
        """Return the draft with the likeliest reading of every open choice, and a remark on the
        others."""
        draft = self
        for choice in self.choices:
            if not choice.is_doubtful:
                continue
            first, *others = choice.readings
            listed = choice_list([other.words for other in others])
            draft = draft.choose(choice.what, first)
            draft = draft.remark(
                f"Not sure: {choice.what} may also be {listed}. To take these: "
                f"{others[0].write_options()}."
            )
        return draft

    def remark(self, sentence: str) -> StudyDraft:
        """Return the draft with one sentence more to say."""
        before = self.remarks
        remarks = (*before, sentence)
        return replace(self, remarks=remarks)

    def list_uncausal(self) -> list[str]:
        """List the columns that reading says to be no causes."""
        split = split_missed(self.contract_table())
        table = split.kept
        robot = self.robot
        known = list_contract_names(robot.prismatic)
        found = find_uncausal_columns(table, known)
        told = [names for code, names in found.items() if code in TOLD_NOTES]
        return list(chain.from_iterable(told))

    def contract_table(self) -> Table:
        """Return all rows under the contract's names and in its units."""
        table = load_table(self.source)
        converted, _ = convert_mapped(table, self.columns, self.robot.prismatic)
        return rename_columns(converted, self.columns)

    def read(self) -> Measurements:
        """Read the measurements. Raises DataError with file, line and column."""
        columns = self.columns
        robot = self.robot
        return read_measurements(self.source, robot, columns)


def draft_study(source: DataFile | Table, robot: Robot, given: Mapping[str, str]) -> StudyDraft:
    """Read a file's columns as well as its names, its values and the nominal arm tell; `given`:
    what the user says. Raises DataError where nothing looks like a required column."""
    gears = None
    if isinstance(source, DataFile):
        gears = find_gear_ratios(source.path, robot.n)
        source = replace(source, headerless=True)
    table = load_table(source)
    if is_headerless(table):
        return _draft_headerless(source, table, robot, given)
    if isinstance(source, DataFile):
        source = replace(source, headerless=False)
    table.require_rows("measured point")
    as_given = table
    prismatic = robot.prismatic
    converted = convert_units(table, prismatic, set(given.values()))
    table, meanings = offer_meanings(converted.table, prismatic, given.values())
    renamed = rename_columns(table, given)
    joint_names = read_joint_names(robot)
    guessed = guess_columns(renamed, prismatic, joint_names)
    choices = drop_unreachable(guessed, renamed.columns, robot)
    for choice in choices:
        if not choice.readings:
            raise refuse_missing(as_given, choice, robot, choices)
    own = [name_originals(choice, converted.originals) for choice in choices]
    named = name_meanings(own, meanings)
    draft = StudyDraft(
        robot, source, table, given, named, originals=converted.originals, meanings=meanings
    )
    if gears is not None:
        draft = replace(draft, gears=gears).remark(gears.sentence)
    taken = {*draft.columns.values(), *given}
    measured = rename_columns(draft.measured, given)
    optional = guess_optional_columns(measured, taken)
    first = merge_columns([choice.readings[0] for choice in draft.choices])
    optional = add_target(optional, rename_columns(measured, first))
    draft = replace(draft, optional=tuple(optional))
    return settle_by_arm(draft)


def _draft_headerless(
    source: DataFile | Table, table: Table, robot: Robot, given: Mapping[str, str]
) -> StudyDraft:
    """Read a table without header, of readings and coordinates in the order that the nominal arm
    fits. Raises DataError where it fits neither clearly better."""
    orders = list_orders(table, robot.n)
    drafts = [draft_study(each, robot, given) for each in orders]
    misfits = [_measure_draft(draft) for draft in drafts]
    least = min(misfits)
    most = max(misfits)
    best = misfits.index(least)
    is_good = least <= MAX_REACH_SHARE * robot.reach
    is_clear = most >= CLEAR_FACTOR * least
    if not (is_good and is_clear):
        raise table.where.refuse(
            "there is no header, and the nominal arm tells neither that joint readings come before "
            "X, Y, Z nor that they come after.",
            remedy="Write the columns' names in a line above them: q1_deg, …, x_mm, y_mm, z_mm.",
        )
    order = ("joint readings, then X, Y, Z", "X, Y, Z, then joint readings")[best]
    draft = drafts[best]
    if not draft.originals:
        names = dict(zip(orders[best].columns, table.columns, strict=True))
        draft = replace(draft, source=source, originals=names)
    return draft.remark(f"Without a header: {order}, as the nominal arm fits them.")


def _measure_draft(draft: StudyDraft) -> float:
    """Compute how far the positions are from the nominal arm [mm]; infinite where they cannot be
    read."""
    first = [choice.readings[0] for choice in draft.choices]
    return _try_readings(draft, first)


def add_orientation(draft: StudyDraft) -> StudyDraft:
    """Add the orientation where columns look like one and follow the nominal arm, to a draft whose
    other choices are settled."""
    robot = draft.robot
    columns = draft.columns
    taken = set(columns.values())
    choice = guess_orientation(draft.measured, taken, robot.name)
    given = set(draft.given)
    is_given = given & set(ORIENTATION_COLUMNS)
    if choice is None or is_given:
        return draft
    choice, remark = settle_orientation(draft.source, robot, columns, choice)
    if not choice.readings:
        return draft.remark(remark)
    before = draft.choices
    choices = (*before, choice)
    return replace(draft, choices=choices)


# -- which reading the arm fits
# --------------------------------------------------------------------------------------------


def settle_by_arm(draft: StudyDraft) -> StudyDraft:
    """Settle choices that names and values leave open by the nominal arm, where it fits one
    reading clearly better than all others."""
    if not any(choice.is_doubtful for choice in draft.choices):
        return draft
    readings = [choice.readings for choice in draft.choices]
    combinations = list(product(*readings))
    if len(combinations) > MAX_TRIED:
        return draft
    misfits = [_try_readings(draft, combination) for combination in combinations]
    tried = list(zip(combinations, misfits, strict=True))
    good = MAX_REACH_SHARE * draft.robot.reach
    measured = drop_computed(draft.choices, tried, draft.table, draft.robot, good)
    if measured.sentence:
        left = replace(draft, choices=measured.choices)
        return settle_by_arm(left.remark(measured.sentence))
    best, second = sorted(misfits)[:2]
    is_good = best <= good or best <= REFUSED_SHARE * draft.robot.reach < second
    is_clear = second >= CLEAR_FACTOR * best
    chosen = combinations[misfits.index(best)]
    if not (is_good and is_clear and is_only_position(chosen, tried, good)):
        targets = describe_several_targets(tried, good)
        return draft.remark(targets) if targets else draft
    other = "not at all"
    if np.isfinite(second):
        other = f"to {write_rounded(second)} mm"
    reason = f"the nominal arm then fits to {write_rounded(best)} mm, otherwise {other}"
    for choice, reading in zip(draft.choices, chosen, strict=True):
        if not choice.is_doubtful:
            continue
        reasons = filter(None, (reading.reason, reason))
        explained = replace(reading, reason="; ".join(reasons))
        draft = draft.choose(choice.what, explained)
    return draft


def _try_readings(draft: StudyDraft, readings: Sequence[Reading]) -> float:
    """Compute how far the positions are from the nominal arm [mm] by some readings; infinite where
    the file cannot be read so."""
    columns = {**draft.given, **merge_columns(readings)}
    source: DataFile | Table = draft.table
    if not draft.meanings:
        source = draft.source
        columns = {name: draft.originals.get(own, own) for name, own in columns.items()}
    try:
        data = read_measurements(source, draft.robot, columns)
    except ModelselError:
        return float("inf")
    misfit = measure_misfit(draft.robot, data)
    return float("inf") if misfit is None else misfit


# -- what is said and written
# --------------------------------------------------------------------------------------------


def describe_draft(draft: StudyDraft, data: Measurements) -> list[str]:
    """Say how a file is read, and how well the nominal arm fits it."""
    robot = draft.robot
    lines = [
        f"Robot: {robot.name}, {count_words(robot.n, 'joint')}, links of {robot.reach:,.0f} mm in all."
    ]
    lines += [note.sentence for note in draft.table.notes]
    if draft.given:
        pairs = [f'{name} = "{own}"' for name, own in draft.given.items()]
        lines.append(f"As given: {', '.join(pairs)}.")
    for choice in draft.choices:
        first, *_ = choice.readings
        what = choice.what.capitalize()
        lines.append(f"{what}: {first.sentence}.")
    if not any("qw" in choice.readings[0].columns for choice in draft.choices):
        lines += describe_quaternions(draft.contract_table(), data)
    lines += describe_optional(draft.optional, data)
    counts = [count_words(len(data), "row"), count_words(data.configurations, "configuration")]
    targets = len(data.targets)
    if targets > 1:
        counts.append(count_words(targets, "target"))
    lines.append(f"{', '.join(counts)}.")
    lines += describe_misfit(robot, data)
    lines.append(_describe_split(data))
    lines += [note.sentence for note in data.notes if note.code in TOLD_NOTES]
    lines += offer_uncertainties(draft.measured, draft.columns)
    taken = {*draft.columns.values(), *draft.originals}
    lines += describe_other_columns(draft.measured, taken, data, draft.list_uncausal())
    return [*lines, *draft.remarks]


def count_estimation(data: Measurements) -> int | None:
    """Return how many configurations estimate; None where all of them do."""
    if data.configurations < MIN_SPLIT:
        return None
    held_out = min(round(HELD_OUT_SHARE * data.configurations), MAX_HELD_OUT)
    return data.configurations - held_out


def _describe_split(data: Measurements) -> str:
    count = count_estimation(data)
    if count is None:
        return f"All configurations fit the models: from {MIN_SPLIT} on, some would be held out."
    held_out = data.configurations - count
    return f"{count} configurations fit the models, {held_out} are held out."
