"""The analysis of one study's measurements: outliers, names, ladder, table, gain."""
from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import __version__
from .candidates import Candidate
from .compare import Comparison, Data, Rung, compare, rung, strongest
from .config import Study
from .design import Model
from .explain import Nested, Say, explain, nested
from .extend import Extension, models
from .findings import Finding, detection_limit, finding_dict, screws_of
from .fit import Fit
from .identify import Unidentifiable, unidentifiable
from .measurements import Measurements, Note
from .mechanisms.geometry import setup
from .noise import Floor
from .prepare import Plan, generator, prepare, reweigh_rotation
from .registry import BUILTIN, Registry, mechanism
from .result import candidates_dict, dumps, rung_dict
from .robot import Robot
from .robust import GROSS, far_off
from .screws import Mechanism
from .validate import Gain, errors, gain
from .words import display, label


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
    extension: Extension = field(repr=False)
    nothing_else: tuple[str, float | None]
    nested: Nested | None
    unidentifiable: tuple[Unidentifiable, ...]
    warnings: tuple[Note, ...]
    provenance: Mapping[str, str] = field(repr=False)

    def to_dict(self) -> dict[str, Any]:
        """The contract's result."""
        data = self.data.scene.data
        estimation = self.data.estimation
        return {
            "schema": 1, "study": self.study.name, "robot": self.robot.name, "seed": self.study.seed,
            "provenance": dict(self.provenance),
            "configurations": {"estimation": data.take(estimation).configurations,
                               "held_out": data.take(~estimation).configurations,
                               "estimation_rows": data.row[estimation]},
            "noise_floor": {"coordinate_mm": self.floor.coordinate_mm, "source": self.floor.source},
            "ladder": [rung_dict(r) for r in self.ladder],
            "candidates": candidates_dict(self.comparison),
            "findings": [finding_dict(f, self.data.scene.take(estimation)) for f in self.findings],
            "nothing_else": {"sentence": self.nothing_else[0], "detection_limit_mm": self.nothing_else[1]},
            "nested_cv": None if self.nested is None else {
                "folds": self.nested.folds, "geometric": asdict(self.nested.base), "chosen": asdict(self.nested.chosen),
                "named_in_folds": self.nested.named},
            "chosen": {"mechanisms": [*self.study.model.base, *(e.candidate.mechanism.name for e in self.extension.effects
                                                                if e.candidate.registered)],
                       "cells": [s for e in self.extension.effects if not e.candidate.registered
                                 for s in screws_of(e.candidate, self.data.scene.take(estimation))]},
            "path": list(self.extension.path),
            "outliers": data.row[self.data.outlying],
            "unidentifiable": [{"sentence": u.sentence, "parameters": list(u.parameters)} for u in self.unidentifiable],
            "warnings": [{"code": w.code, "sentence": w.sentence} for w in self.warnings],
            "sampling": None,
        }

    def to_json(self) -> str:
        """result.json's text."""
        return dumps(self.to_dict())


def analyse(study: Study, plan: Plan, robot: Robot, measured: Measurements, everything: tuple[Mechanism, ...], *,
            labels: NDArray[np.object_] | None = None, registry: Registry = BUILTIN, say: Say = lambda _: None,
            data_sha256: str = "") -> Result:
    """The study of measurements already read; `everything`: the mechanisms that may extend the base."""
    say("registering and splitting" if plan.register else "splitting")
    data, floor, notes = prepare(robot, measured, plan, labels)
    orientation = measured.rotation is not None
    placement = setup(robot, len(measured.targets), len(measured.groups) if plan.per_group else 1, plan.register, orientation)
    fixed = (placement,) if placement.terms else ()
    base = Model((*fixed, *(mechanism(name, robot, registry) for name in study.model.base)))
    base_names = tuple(study.model.base)

    say("fitting the base")
    nominal = rung(data, Model(fixed), ("nominal",))
    if orientation:
        data = reweigh_rotation(data, plan, nominal.residual)
        data = reweigh_rotation(data, plan, rung(data, base, base_names).residual)
        nominal = rung(data, Model(fixed), ("nominal",))
    base_rung = rung(data, base, base_names) if base_names else nominal
    base_fit = _fit(base_rung)

    say("looking for outliers")
    cells = study.model.candidates == "all"
    data, extension, found = explain(data, base, everything, study.seed, cells, say)
    outliers = data.outlying
    nominal, base_rung = rung(data, Model(fixed), ("nominal",)), rung(data, base, base_names)
    say("comparing all subsets of the candidates")
    offered, aside = strongest(found, extension.single_f)
    comparison = compare(data, base, _fit(base_rung), offered, base_names, aside) if offered else None
    rungs = [nominal]
    for names in study.model.ladder or [list(base_names)]:
        model = Model((*fixed, *(mechanism(name, robot, registry) for name in names)))
        rungs.append(base_rung if tuple(names) == base_names else rung(data, model, names))
    say("measuring the gain")
    steps = [base_rung]
    for k in range(1, len(extension.effects) + 1):
        chosen_so_far = [e.candidate for e in extension.effects[:k]]
        last = k == len(extension.effects)
        steps.append(rung(data, models(base, chosen_so_far), (*base_names, *(label(c) for c in chosen_so_far)),
                          extension.fit if last else None))
    if steps[0].names not in [r.names for r in rungs]:
        rungs.append(steps[0])
    rungs += steps[1:]
    chosen = steps[-1]
    if rungs[-1] is not chosen:      # the ladder asked for more than the data support: the chosen model closes it
        rungs.append(chosen)

    data = replace(data, outlying=outliers | held_out_outliers(data, [r for r in rungs if r is not nominal]))
    rungs = [remeasured(r, data) for r in rungs]
    chosen = rungs[-1]
    held = ~data.estimation & ~data.outlying
    def paired(before: Rung, after: Rung) -> Gain:
        return gain(before.residual[held][:, :3], after.residual[held][:, :3], measured.block[held], generator(study.seed, "gain"))
    findings = tuple(Finding(e, paired(a, b)) for e, a, b in zip(extension.effects, steps, steps[1:], strict=False))
    if floor is None:
        floor = estimated_floor(chosen, data)
    if comparison is not None and set(comparison.choice) != set(chosen.names):
        notes = (*notes, Note("table-differs", "The one-standard-error choice of the table of subsets is "
                              f"{' + '.join(comparison.choice)}; the chosen model follows what was named."))
    within = None
    if study.split.nested_folds:
        say(f"the whole procedure again in {study.split.nested_folds} folds")
        within = nested(data, base, everything, study.seed, cells, study.split.nested_folds)
    return Result(study, robot, data, floor, tuple(rungs), comparison, chosen, paired(nominal, chosen), findings, extension,
                  nothing_else(extension, found, data, chosen), within, unidentifiable(_fit(base_rung).found, base.terms), notes,
                  provenance(study, data_sha256))


def held_out_outliers(data: Data, rungs: Sequence[Rung]) -> NDArray[np.bool_]:
    """Held-out rows beyond 8 robust standard deviations of the estimation residuals in every rung from the base on."""
    out = ~data.estimation
    for r in rungs:
        out = out & far_off(r.residual, r.residual[data.used], GROSS)
    return np.asarray(out)


def remeasured(r: Rung, data: Data) -> Rung:
    """A rung with its errors taken again, the outlying rows left out."""
    return replace(r, estimation=errors(r.residual[data.estimation], data.outlying[data.estimation]),
                   held_out=errors(r.residual[~data.estimation], data.outlying[~data.estimation]))


def nothing_else(extension: Extension, found: tuple[Candidate, ...], data: Data, chosen: Rung) -> tuple[str, float | None]:
    """(sentence, limit in mm): what a further effect would have had to be to be found."""
    if not found:
        return "No mechanism may extend the base in this study: nothing was searched.", None
    sigma = estimated_floor(chosen, data).coordinate_mm
    limit = detection_limit(extension, [c.prior for c in found], int(data.used.sum()), sigma)
    more = "else " if extension.effects else ""
    left = f" The strongest of what is left would come by chance with probability {extension.left_p:.2g}."
    return f"Nothing {more}was found; an effect above {display(limit)} rms would have been found with 90 %.{left}", limit


def estimated_floor(rung_: Rung, data: Data) -> Floor:
    """One coordinate's standard deviation [mm] from the residuals of a fitted model."""
    fitted = _fit(rung_)
    return Floor(float(np.sqrt(np.square(rung_.residual[data.used][:, :3]).mean() * fitted.rows / fitted.freedom)), "estimated",
                 fitted.freedom)


def _fit(rung_: Rung) -> Fit:
    assert rung_.fit is not None
    return rung_.fit


def provenance(study: Study, data_sha256: str) -> dict[str, str]:
    """Versions and hashes; no path, time or host."""
    import scipy
    return {"modelsel": __version__, "numpy": np.__version__, "scipy": scipy.__version__, "data_sha256": data_sha256,
            "study_sha256": hashlib.sha256(study.model_dump_json().encode()).hexdigest()}
