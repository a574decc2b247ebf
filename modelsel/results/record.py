"""result.json: the contract's keys from the study's values, the same bytes for the same input."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from ..selection.comparison import SubsetComparison
from ..selection.evaluation import Evaluation


def rung_dict(evaluation: Evaluation) -> dict[str, Any]:
    """One rung of the ladder or row of the table."""
    return {
        "mechanisms": list(evaluation.names),
        "parameters": evaluation.parameters,
        "rank": evaluation.rank,
        "estimation": asdict(evaluation.estimation),
        "held_out": asdict(evaluation.held_out),
        "cv_rms_mm": evaluation.cv_rms_mm,
        "cv_mean_mm": evaluation.cv_mean_mm,
        "aicc": evaluation.aicc,
        "bic": evaluation.bic,
        "aic": evaluation.aic,
        "gcv": evaluation.gcv,
        "ebic": evaluation.ebic,
        "log_predictive_density": evaluation.log_density,
    }


def candidates_dict(comparison: SubsetComparison | None) -> dict[str, Any]:
    """The table of subsets."""
    if comparison is None:
        return {"compared": 0, "best": [], "choice": None, "considered": [], "set_aside": []}
    return {
        "compared": comparison.compared,
        "choice": list(comparison.choice),
        "considered": list(comparison.considered),
        "set_aside": list(comparison.set_aside),
        **(
            {}
            if (found := comparison.certified) is None
            else {
                "search": {
                    "mechanisms": len(comparison.considered),
                    "criterion": "BIC",
                    "nodes": found.nodes,
                    "proven": found.proven,
                    "may_be_beaten_by": found.gap,
                    "best": [
                        m
                        for m, taken in zip(comparison.considered, found.members, strict=True)
                        if taken
                    ],
                }
            }
        ),
        "best": [{**rung_dict(r), "weight": r.weight, "note": r.note} for r in comparison.best],
    }
