"""From named effects to the contract's findings, and what absence of a finding means."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from .._typing import Array
from ..diagnosis.candidates import Candidate, exceeds_cell_limit
from ..diagnosis.credible_sets import Entry
from ..diagnosis.data_faults import Fault, find_concerned_rows
from ..diagnosis.effects import Effect
from ..diagnosis.outcome import Diagnosis
from ..diagnosis.sentences import describe_effect, format_length
from ..fitting.problem import Problem
from ..mechanisms.causes import Bump
from ..mechanisms.terms import Term
from ..notices import Note
from ..selection.evaluation import Evaluation, Gain, Split, compare_held_out

PLAIN = ("payload_kg", "temperature_C", "time_s")
CLEARLY, RARELY = (
    1.25,
    1e-3,
)  # how much more held-out rows err than promised, and how rarely so by chance, to be said


@dataclass(frozen=True, eq=False)
class Finding:
    """One decision: an effect, its sentence, what it gains on held-out rows."""

    effect: Effect
    gain: Gain

    @property
    def sentence(self) -> str:
        """In a metrologist's words, and whether held-out configurations speak against it."""
        return describe_effect(self.effect) + (
            f" Held-out configurations speak against it: {self.against}." if self.against else ""
        )

    @property
    def against(self) -> str:
        """What it adds to the held-out error, where the whole interval of its gain is negative;
        else nothing."""
        interval = self.gain.interval_mm
        if interval is None or interval[1] >= 0:
            return ""
        return f"their error grows by {format_length(-interval[1])} to {format_length(-interval[0])} rms with it (95 %)"


def derived(names: frozenset[str], problem: Problem) -> bool:
    """Whether a cause uses a name that is neither a joint reading nor a column of the data."""
    plain = (
        {f"q{j}" for j in range(1, problem.robot.n + 1)} | set(problem.data.covariates) | set(PLAIN)
    )
    return bool(names - plain)


def screws_of(
    candidate: Candidate, problem: Problem, curve: dict[tuple[int, str], Array] | None = None
) -> list[dict[str, Any]]:
    """The contract's screws of an entry: each place and cause once; derived causes and free
    functions with their values at the problem's rows (the estimation rows, in file order). Screws
    that move nothing on these data are left out."""
    out: dict[tuple[int, str, str], dict[str, Any]] = {}
    for term in candidate.mechanism.terms:
        for s in term.screws:
            key = (s.frame, s.axis, str(s.cause))
            if key in out:
                continue
            entry: dict[str, Any] = {"frame": s.frame, "axis": s.axis, "cause": str(s.cause)}
            if isinstance(s.cause, Bump):
                fitted = (curve or {}).get((s.frame, s.axis))
                entry["values"] = np.zeros(len(problem)) if fitted is None else fitted
            elif derived(s.cause.names(), problem):
                entry["values"] = np.broadcast_to(s.cause.of(problem), (len(problem),))
            out[key] = entry
    return list(out.values())


def curve_of(
    terms: Sequence[Term], estimate: Array, problem: Problem
) -> dict[tuple[int, str], Array]:
    """(frame, axis) -> fitted values of a free function at the problem's rows."""
    out: dict[tuple[int, str], Array] = {}
    for term, value in zip(terms, estimate, strict=True):
        for s in term.screws:
            if isinstance(s.cause, Bump):
                key = (s.frame, s.axis)
                out[key] = out.get(key, np.zeros(len(problem))) + value * s.cause.of(problem)
    return out


def finding_dict(finding: Finding, problem: Problem) -> dict[str, Any]:
    """The contract's finding; `problem` holds the estimation rows in file order."""
    effect = finding.effect

    def curve(entry: Entry) -> dict[tuple[int, str], Array]:
        estimate = effect.estimate if entry.candidate == effect.candidate else entry.estimate
        return curve_of(entry.candidate.mechanism.terms, estimate, problem)

    rows = {}
    if effect.candidate.fault is not None:
        rows = {"rows": find_concerned_rows(effect.candidate.mechanism, problem)}
    return {
        "sentence": finding.sentence,
        "verdict": effect.named.verdict,
        "p_value": effect.p,
        **rows,
        "credible_set": [
            {
                "mechanism": e.candidate.registered_name,
                "probability": e.probability,
                "screws": screws_of(e.candidate, problem, curve(e)),
                "alike": e.alike,
            }
            for e in effect.named.entries
        ],
        "more_entries": effect.named.more,
        "estimate": [
            {"symbol": t.symbol, "value": v, "standard_error": e, "unit": t.unit}
            for t, v, e in zip(
                effect.candidate.mechanism.terms,
                effect.estimate,
                effect.standard_error,
                strict=True,
            )
        ],
        "gain": asdict(finding.gain),
    }


def fault_dict(fault: Fault) -> dict[str, Any]:
    """The contract's finding of a data fault."""
    return {
        "sentence": fault.sentence,
        "verdict": "found",
        "p_value": fault.p,
        "rows": fault.rows,
        "credible_set": [
            {
                "mechanism": fault.kind.label,
                "probability": fault.probability,
                "screws": [],
                "alike": True,
            }
        ],
        "more_entries": 0,
        "estimate": [],
        "gain": asdict(Gain(None, None, None)),
    }


def uneven(diagnosis: Diagnosis) -> tuple[Note, ...]:
    """What independent normal noise would have named and the residual's own signs do not."""
    if diagnosis.held_back is None or diagnosis.left is None:
        return ()
    first = diagnosis.left.entries[0].candidate.label
    return (
        Note(
            "uneven-noise",
            f"{first} is not named: if the noise were normal, independent and alike everywhere, chance "
            f"would explain it with probability {diagnosis.held_back:.2g}, but the residuals as they are, with the signs of "
            f"whole postures (or groups) changed, do as well with probability {diagnosis.left_p:.2g}. Rows of one posture "
            "may share an error, a few rows may be loud, the noise may be larger in one direction, or errors may last from "
            "one configuration to the next.",
        ),
    )


def opposed(findings: Sequence[Finding]) -> tuple[Note, ...]:
    """Findings that make the held-out error larger, by the whole interval of their gain."""
    return tuple(
        Note(
            "held-out-against",
            f"{f.effect.candidate.label} was named, but held-out configurations speak against it: "
            f"{f.against}. Do not compensate for it before further measurements confirm it.",
        )
        for f in findings
        if f.against
    )


def surprised(split: Split, chosen: Evaluation) -> tuple[Note, ...]:
    """Held-out configurations that err clearly more than cross-validation within the estimation
    rows promises."""
    held, block = ~split.estimation & ~split.outlying, split.problem.data.block
    if chosen.crossed is None:
        return ()
    seen = np.linalg.norm(chosen.residual[held][:, :3], axis=1)
    times, p = compare_held_out(chosen.crossed, block[split.used], seen, block[held])
    if times < CLEARLY or p > RARELY:
        return ()
    return (
        Note(
            "held-out-surprise",
            f"The held-out configurations err by {format_length(rms(seen))} rms where cross-validation "
            f"within the estimation configurations promises {format_length(rms(chosen.crossed))} (by chance with probability "
            f"{p:.1g}): something acts there that the estimation configurations do not show. Neither the findings nor their "
            "absence speak of it: let such configurations estimate, too.",
        ),
    )


def rms(values: Array) -> float:
    """Root mean square."""
    return float(np.sqrt(np.square(values).mean()))


def beside(problem: Problem) -> tuple[Note, ...]:
    """Where the arm has so many joints that the error map is not whole."""
    if not exceeds_cell_limit(problem):
        return ()
    return (
        Note(
            "map-of-neighbours",
            f"With {problem.robot.n} joints the whole error map is too large: causes nobody registered "
            "were looked for only at the places of the joints they look at, and next to these.",
        ),
    )
