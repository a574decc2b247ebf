"""The analysis of one study's measurements: outliers, names, ladder, table, gain."""
from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..data.measurements import Measurements, Note
from ..elsewhere.confidence import Confidence, Request, confidence, sampled
from ..elsewhere.explain import Nested, Say, explain, nested
from ..elsewhere.prepare import Plan, generator, prepare, reweigh_rotation
from ..fitting.noise import Floor
from ..machine.robot import Robot
from ..matrix.design import Model
from ..matrix.identify import Unidentifiable, unidentifiable
from ..sure.sampling import Keeper
from ..which.candidates import Candidate
from ..which.compare import Comparison, Data, Rung, compare, rung, strongest
from ..which.validate import Gain, gain
from ..why.extend import Extension, models
from ..why.faults import Fault, misplaced
from ..why.maps import ErrorMap, error_map
from ..why.predictor import Predictable
from ..why.words import label
from ..words.version import VERSION
from ..wrong.mechanisms.geometry import setup
from ..wrong.registry import Registry, mechanism
from ..wrong.screws import Mechanism, Screw
from .config import Study
from .findings import Finding, fault_dict, finding_dict, screws_of
from .left import (
    Placed,
    estimated_floor,
    features,
    fit_of,
    held_out_outliers,
    noise_dict,
    nothing_else,
    per_row,
    predictable_left,
    remeasured,
    rows_seen,
    thinned,
)
from .result import candidates_dict, dumps, rung_dict
from .verdict import verdict


@dataclass(frozen=True, eq=False)
class Result:
    """A finished study: values for programs, `to_json` for the contract's file."""

    study: Study
    robot: Robot
    data: Data
    floor: Floor
    ladder: tuple[Rung, ...]
    comparison: Comparison | None
    chosen: Rung
    gain: Gain
    findings: tuple[Finding, ...]
    faults: tuple[Fault, ...]
    extension: Extension = field(repr=False)
    error_map: ErrorMap = field(repr=False)
    nothing_else: tuple[str, float | None]
    predictable: Predictable | None
    nested: Nested | None
    unidentifiable: tuple[Unidentifiable, ...]
    warnings: tuple[Note, ...]
    confidence: Confidence
    provenance: Mapping[str, str] = field(repr=False)

    @property
    def features(self) -> tuple[Placed, ...]:
        """Where the chosen model has the features that rows share."""
        return features(self.data.scene, fit_of(self.chosen))

    @property
    def named(self) -> list[tuple[str, str]]:
        """(name, verdict) of every finding, faults of single rows first, as result.json lists them."""
        return [*((f"fault:{f.name}", "found") for f in self.faults),
                *((label(f.effect.candidate), f.effect.named.verdict) for f in self.findings)]

    def to_dict(self) -> dict[str, Any]:
        """The contract's result."""
        data = self.data.scene.data
        estimation = self.data.estimation
        extending = [] if self.study.model.candidates == [] else [e.candidate for e in self.extension.effects]
        return {
            "schema": 1, "study": self.study.name, "robot": self.robot.name, "seed": self.study.seed,
            "provenance": dict(self.provenance),
            "verdict": list(verdict(self.ladder[0], self.chosen, self.gain, self.floor, self.named,
                                    self.study.model.candidates != [], self.nothing_else[0])),
            "configurations": {"estimation": data.take(estimation).configurations,
                               "held_out": data.take(~estimation).configurations,
                               "estimation_rows": data.row[estimation]},
            "noise_floor": noise_dict(self.floor, data),
            **({} if data.gauges is None else {"features": [asdict(f) for f in self.features]}),
            "ladder": [rung_dict(r) for r in self.ladder],
            "candidates": candidates_dict(self.comparison),
            "findings": [*(fault_dict(f) for f in self.faults),
                         *(finding_dict(f, self.data.scene.take(estimation)) for f in self.findings)],
            "nothing_else": {"sentence": self.nothing_else[0], "detection_limit_mm": self.nothing_else[1],
                             "predictable": None if self.predictable is None else asdict(self.predictable)},
            "nested_cv": None if self.nested is None else {
                "folds": self.nested.folds, "geometric": asdict(self.nested.base), "chosen": asdict(self.nested.chosen),
                "named_in_folds": self.nested.named},
            "chosen": {"mechanisms": [*self.study.model.base, *(c.mechanism.name for c in extending if c.registered)],
                       "cells": [s for c in extending if not c.registered
                                 for s in screws_of(c, self.data.scene.take(estimation))]},
            "path": list(self.extension.path),
            "error_map": {"places": list(self.error_map.places), "causes": list(self.error_map.causes), "f": self.error_map.f,
                          "p_family_wise": self.error_map.p},
            "outliers": data.row[self.data.outlying],
            "unidentifiable": [{"sentence": u.sentence, "parameters": list(u.parameters)} for u in self.unidentifiable],
            "warnings": [{"code": w.code, "sentence": w.sentence} for w in (*self.warnings, *self.confidence.notes)],
            **self.confidence.to_dict(),
        }

    def to_json(self) -> str:
        """result.json's text."""
        return dumps(self.to_dict())


@dataclass(frozen=True, eq=False)
class Question:
    """What a study asks: its file, its set-up, the nominal robot, the mechanisms that may extend the base, the registry."""

    study: Study
    plan: Plan
    robot: Robot
    everything: tuple[Mechanism, ...]
    registry: Registry

    def model(self, names: Sequence[str], measured: Measurements, best: Mapping[str, Mechanism] | None = None) -> Model:
        """The mechanisms of a rung, with what the set-up leaves open; `best` says which constant a scanned name stands for."""
        groups = len(measured.groups) if self.plan.per_group else 1
        features = () if measured.gauges is None else measured.gauges.features
        placement = setup(self.robot, len(measured.targets), groups, self.plan.register, measured.rotation is not None, features)
        return Model((*((placement,) if placement.terms else ()),
                      *((best or {}).get(n) or mechanism(n, self.robot, self.registry) for n in names)))

    @property
    def cells(self) -> bool:
        """Whether causes nobody registered may be named, too; with `candidates = []` everything is said, nothing extended."""
        return self.study.model.candidates in ("all", [])


def analyse(question: Question, measured: Measurements, *, labels: NDArray[np.object_] | None = None,
            say: Say = lambda _: None, data_sha256: str = "") -> Result:
    """The study of measurements already read. Raises StudyError, DataError or NotEstimable."""
    study, plan = question.study, question.plan
    say("registering and splitting" if plan.register else "splitting")
    data, floor, notes = prepare(question.robot, measured, plan, labels)
    measured = data.scene.data                          # without the rows that nothing can be said of
    base, base_names = question.model(study.model.base, measured), tuple(study.model.base)
    data = _weighed(question, data, base)
    say("looking for outliers")
    data, extension, found = explain(data, base, question.everything, study.seed, question.cells, say)
    nominal, base_rung = rung(data, question.model((), measured), ("nominal",)), rung(data, base, base_names)
    if thinned(extension, data):
        notes = (*notes, Note("scan-of-some", f"What is wrong was looked for in {rows_seen(extension, data)} of "
                              f"the {int(data.used.sum())} estimation rows, drawn by the seed; every fit, error and gain is of "
                              "all rows."))
    say("comparing all subsets of the candidates")
    offered, aside = strongest(found, extension.single_f, [e.candidate for e in extension.effects])
    comparison = compare(data, base, fit_of(base_rung), offered, base_names, aside) if offered else None
    say("measuring the gain")
    steps = _steps(data, base_rung, extension)
    rungs = [nominal, *_ladder(question, data, measured, base_rung, best_constants(found, extension.single_f))]
    rungs += [r for r in (steps if study.model.candidates != [] else steps[:1]) if _same(r) not in [_same(x) for x in rungs]]
    chosen = steps[-1] if study.model.candidates != [] else base_rung
    rungs = [*(r for r in rungs if r is not chosen and (_same(r) != _same(chosen) or r is nominal)), chosen]

    data = replace(data, outlying=data.outlying | held_out_outliers(data, [r for r in rungs if r is not nominal]))
    faults = misplaced(data.scene, data.outlying, fit_of(chosen), generator(study.seed, "null"))
    held = ~data.estimation & ~data.outlying

    def paired(before: Rung, after: Rung) -> Gain:
        rng = generator(study.seed, "gain")
        return gain(before.residual[held][:, :3], after.residual[held][:, :3], measured.block[held], rng)

    findings = tuple(Finding(e, paired(a, b)) for e, a, b in zip(extension.effects, steps, steps[1:], strict=False))
    if comparison is not None and set(comparison.choice) != set(chosen.names):
        notes = (*notes, Note("table-differs", "The one-standard-error choice of the table of subsets is "
                              f"{' + '.join(comparison.choice)}; the chosen model follows what was named."))
    within = None
    if study.split.nested_folds:
        say(f"the whole procedure again in {study.split.nested_folds} folds")
        within = nested(data, base, question.everything, study.seed, question.cells, study.split.nested_folds)
    ladder = tuple(remeasured(r, data) for r in rungs)
    say("weighing every mechanism of the chosen model")
    sure = confidence(data, fit_of(chosen), chosen.names, study.seed)
    return Result(study, question.robot, data, per_row(floor or estimated_floor(chosen, data), data), ladder, comparison,
                  remeasured(chosen, data), paired(nominal, chosen), findings, faults, extension, error_map(extension, found),
                  nothing_else(extension, found, data, steps[-1]), predictable_left(data, steps[-1],
                  generator(study.seed, "flips")), within,
                  unidentifiable(fit_of(base_rung).found, base.terms), notes, sure, provenance(study, data_sha256))


def with_sampling(question: Question, result: Result, say: Say = lambda _: None, keeper: Keeper | None = None) -> Result:
    """A result with its chosen model's posterior sampled."""
    plan, study, measured = question.plan, question.study, result.data.scene.data
    request = Request(question.model(study.model.base, measured), study.sampling.over, plan.instrument,
                      plan.stated_mm is not None, question.registry)
    found = sampled(result.confidence, result.data, fit_of(result.chosen), request, study.seed, say, keeper)
    return replace(result, confidence=found)


def _weighed(question: Question, data: Data, base: Model) -> Data:
    """With orientations of unstated uncertainty: rotational rows weighed by their own residuals, nominal then base."""
    if data.scene.data.rotation is not None:
        for model in (question.model((), data.scene.data), base):
            data = reweigh_rotation(data, question.plan, rung(data, model, ()).residual)
    return data


def _same(r: Rung) -> tuple[tuple[str, ...], frozenset[tuple[Screw, ...]]]:
    """What makes two rungs one: their names and what these stand for."""
    return r.names, frozenset(t.screws for t in fit_of(r).terms)


def best_constants(found: Sequence[Candidate], single_f: NDArray[np.float64]) -> dict[str, Mechanism]:
    """Of every registered name with several constants, the one that alone explains most beyond the base."""
    best: dict[str, tuple[float, Mechanism]] = {}
    count: dict[str, int] = {}
    for candidate, f in zip(found, single_f, strict=True):
        if candidate.registered:
            name = candidate.mechanism.name
            count[name] = count.get(name, 0) + 1
            if name not in best or f > best[name][0]:
                best[name] = (float(f), candidate.mechanism)
    return {name: m for name, (_, m) in best.items() if count[name] > 1}


def _ladder(question: Question, data: Data, measured: Measurements, base_rung: Rung, best: Mapping[str, Mechanism]) -> list[Rung]:
    """The study's own rungs, or the base."""
    return [base_rung if tuple(names) == base_rung.names else rung(data, question.model(names, measured, best), names)
            for names in question.study.model.ladder or [list(base_rung.names)]]


def _steps(data: Data, base_rung: Rung, extension: Extension) -> list[Rung]:
    """From the base, a rung to every effect, in the order they were found."""
    steps = [base_rung]
    for k in range(1, len(extension.effects) + 1):
        so_far = [e.candidate for e in extension.effects[:k]]
        names = (*base_rung.names, *(label(c) for c in so_far))
        last = extension.fit if k == len(extension.effects) and not thinned(extension, data) else None
        steps.append(rung(data, models(extension.base, so_far), names, last, start=steps[-1].fit))
    return steps


def provenance(study: Study, data_sha256: str) -> dict[str, str]:
    """Versions and hashes; no path, time or host."""
    import scipy
    return {"modelsel": VERSION, "numpy": np.__version__, "scipy": scipy.__version__, "data_sha256": data_sha256,
            "study_sha256": hashlib.sha256(study.model_dump_json().encode()).hexdigest()}
