"""Whole studies of drawn arms, and what is wrong with their sentences."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pandas as pd
from drawn_arms import LONGER, UP, Campaign

from modelsel import Result, Study, run_study
from modelsel.fitting.design import residuals
from modelsel.fitting.prior import usual_sizes

SIX, SEVEN = ("ur5e", "puma760", "irb120", "ur10e"), ("iiwa14", "fr3")


def studied(one: Campaign, seed: int, **model: object) -> Result:
    """The study of a drawn campaign, tracker and target unknown."""
    return run_study(
        Study(
            name="drawn",
            seed=seed,
            measurements=pd.DataFrame(one.columns),
            model=model,
            robot={"nominal": one.robot, "register": True},
        ),
        sampling=False,
    )


def missed(result: Result, q: np.ndarray, where: np.ndarray) -> float:
    """Root mean square error [mm] at readings q with the tool made longer."""
    at, fitted = result.split.problem, result.models.chosen.fit
    data = replace(at.data.take(np.zeros(len(q), np.intp)), q=q, position=where)
    longer = replace(at, data=data, tools=at.tools + UP * LONGER)
    return float(np.sqrt(np.square(residuals(longer, fitted.terms, fitted.theta)).sum(1).mean()))


def off(result: Result, one: Campaign) -> tuple[np.ndarray, np.ndarray]:
    """(errors in standard errors, estimates in usual sizes) of every geometric parameter that the
    set-up does not leave open."""
    fitted, sizes = result.models.chosen.fit, usual_sizes(result.models.chosen.fit.model)
    place = [
        (k, t.screws[0].frame - 1, ["tx", "ty", "tz", "rx", "ry", "rz"].index(t.screws[0].axis))
        for k, t in enumerate(fitted.terms)
        if t.usual in one.robot.usual and k in fitted.found.kept
    ]
    away = [(fitted.theta[k] - one.errors[f, a]) / fitted.standard_errors[k] for k, f, a in place]
    return np.abs(away), np.abs([fitted.theta[k] / sizes[k] for k, _, _ in place])


def contradictions(result: Result) -> list[str]:
    """Sentences that say that a parameter is kept at zero which is not, or the reverse."""
    record = {
        t.symbol: v
        for t, v in zip(result.models.chosen.fit.terms, result.models.chosen.fit.theta, strict=True)
    }
    zero = [
        (u, re.search(r"([^;:]*) (?:is|are) kept at zero", u.sentence))
        for u in result.models.unidentifiable
    ]
    return [
        f"{symbol} = {record[symbol]}: {u.sentence}"
        for u, said in zero
        if said
        for symbol in u.parameters
        if re.search(rf"\b{re.escape(symbol)}\b", said[1]) and record[symbol]
    ]
