"""The records of findings: verdicts, credible sets, estimates and gains."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from ..._records import Number, Pair, StrictRecord, Text, Whole
from ...diagnosis.candidates.signatures import PROVEN
from ...diagnosis.findings.stated_probability import find_named_level
from ...selection.gain import Change, Gain, OrientationGain
from .record_types import Axis, Figure, Texts

FAULT = "fault:"  # begins the name of a data fault
# marks a figure of joint readings that were not measured, and what it says
BEYOND = "*"
BEYOND_WORDS = "* there a joint stands beyond its measured range"


class ScrewRecord(StrictRecord):
    """A place and a cause; for derived causes and free functions also the values of the cause at
    every estimation row."""

    frame: Whole
    axis: Axis
    cause: Text
    values: list[Figure] | None = None

    @property
    def place(self) -> str:
        """The frame and the axis."""
        return f"frame {self.frame} {self.axis}"

    @property
    def is_free(self) -> bool:
        """Whether the cause is a free function of a joint."""
        return self.cause.startswith("free(")

    @property
    def free_driver(self) -> str:
        """What its free function depends on; the whole cause where it is none."""
        cause = self.cause
        inner = cause.removeprefix("free(")
        return inner.removesuffix(")")


class EntryRecord(StrictRecord):
    """One explanation of a credible set."""

    mechanism: Text | None
    probability: Number
    screws: list[ScrewRecord]
    alike: bool
    label: Text | None = None

    @property
    def is_fault(self) -> bool:
        """Whether the explanation is a fault of the data."""
        return self.mechanism is not None and self.mechanism.startswith(FAULT)

    @property
    def causes(self) -> list[str]:
        """The causes, each once, in the screws' order."""
        return list(dict.fromkeys(screw.cause for screw in self.screws))

    @property
    def name(self) -> str:
        """The registered name, or place and cause: frame 6 ty · q4."""
        if self.mechanism:
            return self.mechanism
        if self.label:
            return self.label
        if not self.screws:
            return "an unnamed effect"
        first = self.screws[0]
        return first.cause if first.is_free else f"{first.place} · {' & '.join(self.causes)}"

    @property
    def cells(self) -> str:
        """Places and causes: frame 5 rz · q4."""
        return "; ".join(f"{screw.place} · {screw.cause}" for screw in self.screws)


class EstimateRecord(StrictRecord):
    """One fitted number of a finding."""

    symbol: Text
    value: Figure
    standard_error: Figure
    unit: Text


class AfterSelectionRecord(StrictRecord):
    """The factor by which to multiply the estimate of a finding to allow for the search."""

    factor: Number
    low: Number
    high: Number


class GainRecord(StrictRecord):
    """Held-out error without and with a finding: of position [mm] and, if its turning prevails, of
    orientation [mrad]; a positive interval means less error."""

    held_out_rms_before_mm: Figure
    held_out_rms_after_mm: Figure
    interval_mm: Pair | None
    held_out_rms_before_mrad: Figure = None
    held_out_rms_after_mrad: Figure = None
    interval_mrad: Pair | None = None

    @property
    def of_position(self) -> Change | None:
        """What it changes of the position error, where anything is held out."""
        gain = Gain(self.held_out_rms_before_mm, self.held_out_rms_after_mm, self.interval_mm)
        return gain.change

    @property
    def of_orientation(self) -> Change | None:
        """What it changes of the orientation error, where its turning prevails."""
        before = self.held_out_rms_before_mrad
        gain = OrientationGain(before, self.held_out_rms_after_mrad, self.interval_mrad)
        return gain.change

    @property
    def told(self) -> Change | None:
        """The change to tell where one is told: of orientation, where that falls or nothing does."""
        moved = self.of_position
        turned = self.of_orientation
        if moved is None or turned is None:
            return turned or moved
        only_position_falls = moved.fall > 0 >= turned.fall
        return moved if only_position_falls else turned


class UsableRecord(StrictRecord):
    """A number in a unit that people use, with its 95 % interval."""

    quantity: Text
    value: Number
    low: Figure
    high: Figure
    unit: Text
    text: Text


class WorstRecord(StrictRecord):
    """The configuration at which a finding moves the target most."""

    mm: Number
    low: Figure
    high: Figure
    joints_deg: list[Number]
    unmeasured_joints: list[Whole]
    text: Text

    @property
    def mark(self) -> str:
        """What marks a figure that is of joint readings beyond the measured ones."""
        return BEYOND if self.unmeasured_joints else ""


class TurningRecord(StrictRecord):
    """How far a finding turns the target, and the configuration at which it turns it most."""

    rms_mrad: Number
    mrad: Number
    low: Figure
    high: Figure
    joints_deg: list[Number]
    unmeasured_joints: list[Whole]
    text: Text
    prevails: bool

    @property
    def mark(self) -> str:
        """What marks a figure that is of joint readings beyond the measured ones."""
        return BEYOND if self.unmeasured_joints else ""


class SmallFindingsRecord(StrictRecord):
    """The findings that do not matter, taken together."""

    count: Whole
    rms_mm: Number
    rms_mrad: Figure = None
    sentence: Text


class ClaimRecord(StrictRecord):
    """What a finding says at one level, and the probability of that."""

    level: Literal["place", "drivers", "shape", "cause"]
    probability: Number
    text: Text


# the level after each, which is not proven where the name is not
NEXT_LEVEL = {"place": "drivers", "drivers": "shape", "shape": "cause"}


class FindingRecord(StrictRecord):
    """One decision of the search."""

    sentence: Text = Field(description="the finding in words")
    verdict: Text = Field(description="`found` or `cannot be told apart`")
    p_value: Number = Field(
        description="family-wise p over the whole scan; an effect is found at 0.05 or less"
    )
    rows: list[Whole] | None = Field(
        None,
        description='only for data faults (`"mechanism": "fault:<name>"`): the rows concerned, counted '
        "from 0",
    )
    credible_set: Annotated[list[EntryRecord], Field(min_length=1)] = Field(
        description="explanations, the most probable first, until their probabilities add up to 0.95 or "
        "20 entries are listed: `mechanism` (null for a cell of the error map), "
        "`label` (its name in words), `probability` (among all explanations that were weighed; beside a finding's "
        "name it is told times the share of shapes that are in no list, so that the name is as probable as its "
        "level in `levels`), `alike` (moves the target as the first one does), `screws` (`frame "
        "axis cause`, and `values` at every estimation row if the cause is a free function or "
        "uses a name that is neither a joint reading nor a column of the file)"
    )
    fitted: Whole = Field(
        0,
        description="place in `credible_set`, counted from 0, of the explanation that is fitted. The "
        "finding's name, `estimate`, `levels`, `worst` and `usable` are of this one; those "
        "before it are likelier",
    )
    more_entries: Whole = Field(description="number of further explanations in the credible set")
    claim: ClaimRecord | None = Field(
        None,
        description="the deepest level with a probability of at least 0.9, otherwise the place: `level "
        "probability text`",
    )
    levels: list[ClaimRecord] = Field(
        default_factory=list,
        description="the levels place (where something moves), drivers (what it depends on), shape (how) "
        "and cause (why), in the form of `claim`. The probability of a level is the share of "
        "all explanations that agree with the finding up to it, including shapes that are in "
        "no list",
    )
    estimate: list[EstimateRecord] = Field(
        description="its fitted numbers: `symbol value standard_error unit`; the standard error is the "
        "larger of least squares' and the bootstrap's"
    )
    after_selection: AfterSelectionRecord | None = Field(
        None,
        description="factor by which to multiply the estimate to allow for the search that found it: "
        "`factor` (median) and its 95 % interval `low high`; null for free functions and "
        "other effects whose shape is left open",
    )
    gain: GainRecord = Field(
        description="held-out rms error of position before and after the finding joins the ladder, with "
        "the 95 % interval of the difference: `held_out_rms_before_mm held_out_rms_after_mm "
        "interval_mm`. If the error only falls when the finding is added to all others, the "
        "figures are those. Only if `turning.prevails` also the same of orientation, on the "
        "ladder: `held_out_rms_before_mrad held_out_rms_after_mrad interval_mrad`"
    )
    doubtful: bool = Field(
        False,
        description="the held-out error does not fall when it joins the model, neither on the ladder nor "
        "when added to all other findings; if `turning.prevails`, neither that of position "
        "nor that of orientation",
    )
    usual_causes: Texts = Field(
        default_factory=list,
        description="parts that usually cause what its name says; the data cannot tell which. Sentences list "
        "them where the name is proven",
    )
    matters: bool = Field(
        True,
        description="its mean square is above a tenth of the mean square left, in position or in "
        "orientation, or its rms is above the noise; `small_findings` sums up the others",
    )
    rms_mm: Figure = Field(
        None,
        description="rms displacement of the target over the estimation rows, beyond the base and the "
        "other findings that matter; absent for faults of single rows",
    )
    worst: WorstRecord | None = Field(
        None,
        description="where it moves the target most, over the estimation rows (at most 4,000 of them) and "
        "4,000 drawn configurations: `mm` with its 95 % interval `low` to `high`, "
        "`joints_deg` (mm for a prismatic joint), `unmeasured_joints` (joints that are beyond "
        "their measured range there), `text`; absent for faults of single rows",
    )
    turning: TurningRecord | None = Field(
        None,
        description="only if orientations were measured: how far it turns the target. `rms_mrad`: rms "
        "over the estimation rows, beyond the base; `mrad`: its largest turn, with the other "
        "keys of `worst`; `prevails`: it changes the orientation more than the position, each "
        "relative to what is left of it, so that sentences give both",
    )
    usable: list[UsableRecord] = Field(
        default_factory=list,
        description="[usable numbers](../how-to/numbers.md): `quantity value low high unit text`, in the "
        "units `arcsec mrad mm ppm ppm/K N m/rad`; `low` or `high` is null if the data leave "
        "that end open",
    )

    @property
    def first(self) -> EntryRecord:
        """The most probable explanation."""
        return self.credible_set[0]

    @property
    def fitted_entry(self) -> EntryRecord:
        """The explanation that is fitted, of which its figures and its name are."""
        return self.credible_set[self.fitted]

    @property
    def likelier(self) -> list[str]:
        """The names that are more probable than that of the explanation which is fitted."""
        own = self.of_name
        weights = self.sum_by_name().items()
        return [name for name, weight in weights if weight > own]

    def sum_by_name(self) -> dict[str, float]:
        """Sum the probabilities of listed explanations by their name, whatever their constants."""
        weights: dict[str, float] = {}
        for entry in self.credible_set:
            before = weights.get(entry.name, 0.0)
            weights[entry.name] = before + entry.probability
        return weights

    @property
    def is_found(self) -> bool:
        """Whether the data single out one name."""
        return self.verdict == "found"

    @property
    def is_constant_open(self) -> bool:
        """Whether the data leave a constant open and no more: every listed name is that of the fitted
        explanation, or with some constant the same displacement."""
        own = self.fitted_entry
        cells = own.cells
        twins = set()
        names = set()
        constants = set()
        for entry in self.credible_set:
            name = entry.name
            names.add(name)
            if entry.cells == cells:
                twins.add(name)
            if name == own.name:
                constants.add(entry.cells)
        is_open = len(constants) > 1
        return is_open and names <= twins

    @property
    def is_name_open(self) -> bool:
        """Whether the data leave its name open: the level that it says is not proven."""
        levels = self.level_probabilities
        if not levels or self.first.is_fault:
            return False
        named = find_named_level(levels)
        return levels[named] < PROVEN

    @property
    def told_verdict(self) -> str:
        """The verdict, with what of its name is not proven."""
        claim = self.claim
        if claim is None or not self.is_found or not self.is_name_open:
            return self.verdict
        if claim.probability < PROVEN:
            return f"{self.verdict}, not named"
        return f"{self.verdict}, {NEXT_LEVEL[claim.level]} not proven"

    @property
    def level_probabilities(self) -> list[float]:
        """The probability (4,) of every level; none where they were not weighed."""
        return [level.probability for level in self.levels]

    @property
    def told_turning(self) -> TurningRecord | None:
        """How far it turns the target, where that is told beside how far it moves it."""
        if self.turning is None or not self.turning.prevails:
            return None
        return self.turning

    @property
    def only_turns(self) -> bool:
        """Whether it turns the target and does not move it."""
        is_still = self.worst is not None and self.worst.mm == 0
        return is_still and self.told_turning is not None

    @property
    def of_name(self) -> float:
        """How probable the name of the fitted one is among the listed explanations."""
        of_name = self.sum_by_name()[self.fitted_entry.name]
        return min(of_name, 1.0)

    @property
    def alike(self) -> float:
        """How probable those listed explanations are, together, that move the target as the first
        does."""
        together = sum(entry.probability for entry in self.credible_set if entry.alike)
        return min(together, 1.0)
