"""From named effects to the contract's findings, and what absence of a finding means."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ..._typing import Array
from ...diagnosis.candidates.candidate import Candidate
from ...diagnosis.candidates.signatures import LEVELS
from ...diagnosis.faults.data_faults import Fault, find_concerned_rows
from ...diagnosis.findings.claim_sentences import (
    ClaimedLevel,
    describe_claim,
    describe_levels,
    describe_proven,
    is_settled,
)
from ...diagnosis.findings.effects import Effect
from ...diagnosis.findings.sentences import list_usual_causes
from ...diagnosis.inference.credible_sets import Entry
from ...exceptions import write_rounded
from ...fitting.problem import Problem
from ...measurements.quantities.contract_columns import KNOWN_COVARIATES
from ...mechanisms.causes import Cause, find_bump
from ...mechanisms.terms import Term
from ...selection.gain import Change, Gain, OrientationGain

Spot = tuple[int, str, str]  # frame, axis, cause
Values = dict[str, Any]


@dataclass(frozen=True, eq=False)
class Finding:
    """One decision: an effect, its sentence, what it gains on held-out rows; `orientation_gain`: the
    same of orientation, where it turns the target more than it moves it, each against what is left;
    `condition`: a sentence on what it depends on that is in question."""

    effect: Effect
    gain: Gain
    orientation_gain: OrientationGain | None = None
    condition: str = ""

    def __repr__(self) -> str:
        return f"Finding: {self.sentence}"

    @property
    def sentence(self) -> str:
        """In a metrologist's words: what moves, whether held-out configurations speak against it, and which parts
        usually do this, where that is proven."""
        words = describe_proven(self.effect, self._doubt)
        if self.against:
            words += f" Held-out configurations speak against it: {self.against}."
        if self.condition:
            words += f" {self.condition}"
        causes = list_usual_causes(self.effect)
        if causes and is_settled(self.effect):
            words += f" Usual causes: {', '.join(causes)}."
        return words

    @property
    def doubtful(self) -> bool:
        """Whether the held-out error does not fall when it joins the model, of position and, where its
        turning prevails, of orientation."""
        falls = [change.fall for change in self._known_changes]
        return bool(falls) and max(falls) <= 0

    @property
    def _known_changes(self) -> list[Change]:
        """What it changes of held-out errors, where some are held out: of orientation first."""
        changes = [self.gain.change]
        if self.orientation_gain is not None:
            changes.insert(0, self.orientation_gain.change)
        return [change for change in changes if change is not None]

    @property
    def _doubt(self) -> str:
        """What stands beside its name where it is doubtful."""
        if not self.doubtful:
            return ""
        if self.against:
            return "doubtful"
        first = self._known_changes[0]
        more = f"{write_rounded(-first.fall)} {first.unit}"
        return f"doubtful: the held-out error does not fall with it ({more} rms more)"

    @property
    def against(self) -> str:
        """What it adds to the held-out error, where it is doubtful and the whole interval of its gain is negative; else
        nothing."""
        if not self.doubtful:
            return ""
        for _, _, interval, unit in self._known_changes:
            if interval is not None and interval[1] < 0:
                low, high = (f"{write_rounded(-end)} {unit}" for end in reversed(interval))
                what = "orientation error" if unit == "mrad" else "error"
                return f"their {what} grows by {low} to {high} rms with it (95 %)"
        return ""


def uses_derived_names(names: frozenset[str], problem: Problem) -> bool:
    """Return whether a cause uses a name that is neither a joint reading nor a column of the data."""
    readings = {f"q{joint}" for joint in range(1, problem.robot.n + 1)}
    columns = {*problem.data.covariates, *KNOWN_COVARIATES}
    return bool(names - readings - columns)


def list_screws(candidate: Candidate, estimate: Array, problem: Problem) -> list[Values]:
    """Return the contract's screws of an entry: each place and cause once.

    Derived causes and free functions come with their values at the problem's rows (the estimation rows, in file
    order), free functions as they are fitted; `estimate` (k,) is of the candidate's terms."""
    curves = fitted_curves(candidate.mechanism.terms, estimate, problem)
    listed: dict[tuple[int, str, str], Values] = {}
    for term in candidate.mechanism.terms:
        for screw in term.screws:
            key = (screw.frame, screw.axis, str(screw.cause))
            if key not in listed:
                values = _cause_values(screw.cause, problem, curves.get(key))
                listed[key] = dict(zip(("frame", "axis", "cause"), key, strict=True)) | values
    return list(listed.values())


def _cause_values(cause: Cause, problem: Problem, curve: Array | None) -> Values:
    """Return the values that a screw's cause is written with, if any; of a free function its curve."""
    if curve is not None:
        return {"values": curve}
    if uses_derived_names(cause.names(), problem):
        return {"values": np.broadcast_to(cause.of(problem), (len(problem),))}
    return {}


def fitted_curves(terms: Sequence[Term], estimate: Array, problem: Problem) -> dict[Spot, Array]:
    """Return the fitted values of free functions at the problem's rows, by place and cause."""
    curves: dict[Spot, Array] = {}
    for term, coefficient in zip(terms, estimate, strict=True):
        for screw in term.screws:
            if find_bump(screw.cause) is not None:
                spot = screw.frame, screw.axis, str(screw.cause)
                curve = curves.get(spot, np.zeros(len(problem)))
                curves[spot] = curve + coefficient * screw.cause.of(problem)
    return curves


def describe_finding(finding: Finding, problem: Problem) -> Values:
    """Return the contract's finding without its figures; `problem` holds the estimation rows in file order."""
    effect = finding.effect
    is_fault = effect.candidate.fault is not None
    rows = find_concerned_rows(effect.candidate.mechanism, problem) if is_fault else None
    return {
        "sentence": finding.sentence,
        "verdict": effect.named.verdict,
        "p_value": effect.p,
        **({} if rows is None else {"rows": rows}),
        "credible_set": [_entry(entry, effect, problem) for entry in effect.named.entries],
        "fitted": find_fitted(effect),
        "more_entries": effect.named.more,
        **_describe_claims(effect),
        "estimate": _estimate(effect),
        "after_selection": effect.after_selection and effect.after_selection._asdict(),
        "gain": _describe_gains(finding),
        "doubtful": finding.doubtful,
        "usual_causes": list(list_usual_causes(effect)),
    }


def _describe_gains(finding: Finding) -> Values:
    """Return what it gains on held-out rows, of orientation where its turning prevails."""
    gain = asdict(finding.gain)
    if finding.orientation_gain is None:
        return gain
    turning = asdict(finding.orientation_gain)
    return gain | turning


def _describe_claims(effect: Effect) -> Values:
    """Return the deepest level that is proven, and all four."""
    claimed = describe_claim(effect)
    if claimed is None:
        return {}
    levels = describe_levels(effect)
    return {"claim": claimed._asdict(), "levels": [level._asdict() for level in levels]}


def find_fitted(effect: Effect) -> int:
    """Find the place of the effect's own explanation in its credible set."""
    candidates = [entry.candidate for entry in effect.named.entries]
    return candidates.index(effect.candidate)


def _entry(entry: Entry, effect: Effect, problem: Problem) -> Values:
    """Return one explanation of a credible set."""
    is_named = entry.candidate == effect.candidate
    estimate = effect.estimate if is_named else entry.estimate
    return {
        "mechanism": entry.candidate.registered_name,
        "probability": entry.probability,
        "screws": list_screws(entry.candidate, estimate, problem),
        "alike": entry.alike,
        "label": entry.candidate.label,
    }


def _estimate(effect: Effect) -> list[Values]:
    """Return the fitted numbers of an effect."""
    terms = effect.candidate.mechanism.terms
    numbers = zip(terms, effect.estimate, effect.standard_error, strict=True)
    return [
        {"symbol": term.symbol, "value": value, "standard_error": error, "unit": term.unit}
        for term, value, error in numbers
    ]


def describe_fault(fault: Fault) -> Values:
    """Return the contract's finding of a fault of single rows."""
    entry = {
        "mechanism": fault.kind.label,
        "probability": fault.probability,
        "screws": [],
        "alike": True,
    }
    claimed = ClaimedLevel("cause", fault.probability, fault.sentence)
    return {
        "sentence": fault.sentence,
        "verdict": "found",
        "p_value": fault.p,
        "rows": fault.rows,
        "credible_set": [entry],
        "more_entries": 0,
        "claim": claimed._asdict(),
        "levels": [claimed._replace(level=level)._asdict() for level in LEVELS],
        "estimate": [],
        "gain": asdict(Gain(None, None, None)),
    }
