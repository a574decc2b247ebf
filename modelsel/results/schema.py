"""What result.json and details.json hold, as shapes: what a folder is read back by. Undefined
figures are null."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from .._json import Each, Maybe
from ..robot.rigid import AXES

NUMBER, TEXTS = Maybe(float), Each(str)
THREE, PAIR = Each(float, 3), Each(float, 2)
RUN = {"data_sha256": str, "study_sha256": str}

# -- result.json
# ---------------------------------------------------------------------------------------------------------------

ERRORS = {
    "mean_mm": NUMBER,
    "rms_mm": NUMBER,
    "p95_mm": NUMBER,
    "max_mm": NUMBER,
    "rows": int,
    "left_out": int,
    "mean_all_mm": NUMBER,
}
RUNG = {
    "mechanisms": TEXTS,
    "parameters": int,
    "rank": int,
    "estimation": ERRORS,
    "held_out": ERRORS,
    "cv_rms_mm": NUMBER,
    **dict.fromkeys(
        ("cv_mean_mm", "aicc", "bic", "aic", "gcv", "ebic", "log_predictive_density"), NUMBER
    ),
}
SCREW = {"frame": int, "axis": frozenset(AXES), "cause": str, "values?": Each(NUMBER)}
ENTRY = {"mechanism": Maybe(str), "probability": float, "screws": Each(SCREW), "alike": bool}
FINDING = {
    "sentence": str,
    "verdict": str,
    "p_value": float,
    "rows?": Each(int),
    "credible_set": Each(ENTRY, least=1),
    "more_entries": int,
    "estimate": Each({"symbol": str, "value": NUMBER, "standard_error": NUMBER, "unit": str}),
    "gain": {
        "held_out_rms_before_mm": NUMBER,
        "held_out_rms_after_mm": NUMBER,
        "interval_mm": Maybe(PAIR),
    },
}
SUBSET = {**RUNG, "weight": NUMBER, "note": str}
SEARCH = {
    "mechanisms": int,
    "criterion": str,
    "nodes": int,
    "proven": bool,
    "may_be_beaten_by": NUMBER,
    "best": TEXTS,
}
QUANTILES = {
    "name": str,
    "unit": str,
    **{
        f"{side}{key}": NUMBER for side in ("", "closed_form_") for key in ("low", "median", "high")
    },
}
SAMPLING = {
    "effective_samples": NUMBER,
    "r_hat": NUMBER,
    "tau": NUMBER,
    "converged": bool,
    "steps": int,
    "walkers": int,
    "sentence": str,
    "quantiles": Each(QUANTILES),
    "trace": {"names": TEXTS, "draws": Each(Each(float))},
}
PARAMETER = {
    "symbol": str,
    "mechanism": str,
    "unit": str,
    "estimate": float,
    "standard_error": NUMBER,
    "bootstrap_error": NUMBER,
    "posterior_error": NUMBER,
    "low": NUMBER,
    "high": NUMBER,
    "mean_mm": NUMBER,
    "max_mm": NUMBER,
    "configurations": NUMBER,
    "differ": bool,
}
SIGNIFICANCE = {
    "mechanism": str,
    "parameters": TEXTS,
    "mean_mm": NUMBER,
    "max_mm": NUMBER,
    "f": NUMBER,
    "p": NUMBER,
    "log10_evidence": NUMBER,
    "cv_rms_mm": NUMBER,
    "cv_rms_without_mm": NUMBER,
    "held_out_rms_mm": NUMBER,
    "held_out_rms_without_mm": NUMBER,
    "catalogue": str,
    "stability": NUMBER,
}
RESULT = {
    "study": str,
    "robot": str,
    "seed": int,
    "provenance": {"modelsel": str, **RUN},
    "verdict": TEXTS,
    "configurations": {"estimation": int, "held_out": int, "estimation_rows": Each(int)},
    "noise_floor": {"coordinate_mm": float, "source": str, "mean_mm?": float},
    "features?": Each(
        {
            "name": str,
            "kind": str,
            "position_mm": THREE,
            "normal": Maybe(THREE),
            "length_mm": NUMBER,
            "fitted": TEXTS,
        }
    ),
    "ladder": Each(RUNG, least=1),
    "candidates": {
        "compared": int,
        "best": Each(SUBSET),
        "choice": Maybe(TEXTS),
        "considered": TEXTS,
        "set_aside": TEXTS,
        "search?": SEARCH,
    },
    "findings": Each(FINDING),
    "nothing_else": {
        "sentence": str,
        "detection_limit_mm": NUMBER,
        "predictable": Maybe({"share": float, "p": float}),
        "lack_of_fit?": Maybe(
            dict.fromkeys(("f", "p", "floor_mm", "unexplained_mm", "low_mm", "high_mm"), float)
        ),
    },
    "nested_cv": Maybe(
        {
            "folds": int,
            "geometric": {"mean_mm": NUMBER},
            "chosen": {"mean_mm": NUMBER},
            "named_in_folds": {str: int},
        }
    ),
    "chosen": {"mechanisms": TEXTS, "cells": Each(SCREW)},
    "path": TEXTS,
    "error_map": {
        "places": TEXTS,
        "causes": TEXTS,
        "f": Each(Each(NUMBER)),
        "p_family_wise": Each(Each(NUMBER)),
    },
    "outliers": Each(int),
    "unidentifiable": Each({"sentence": str, "parameters": TEXTS}),
    "warnings": Each({"code": str, "sentence": str}),
    "sampling": Maybe(SAMPLING),
    "parameters": Each(PARAMETER),
    "correlation": {
        "symbols": TEXTS,
        "matrix": Each(Each(NUMBER)),
        "pairs": Each({"a": str, "b": str, "r": float, "sentence": str}),
        "clusters": Each(TEXTS),
    },
    "significance": Each(SIGNIFICANCE),
}

# -- details.json
# --------------------------------------------------------------------------------------------------------------

CARD = {
    "name": str,
    "sentence": str,
    "equation": str,
    "source": str,
    "terms": Each(
        {
            "symbol": str,
            "unit": str,
            "screws": TEXTS,
            "size": Maybe(PAIR),
            "sign": int,
            "expected": str,
        }
    ),
}
PANEL = {
    "frames": Each(int),
    "axis": frozenset(["", *AXES]),
    "against": str,
    "against_unit": str,
    "unit": frozenset(["mm", "rad"]),
    "kind": str,
    "x": Each(float),
    "before": Each(float),
    "after": Each(float),
    "weight": Each(float),
    "curve": Each(Each(float), 2),
}
DETAILS = {
    **RUN,
    "rows": {
        "of": int,
        "row": Each(int),
        "estimation": Each(int),
        "outlying": Each(int),
        "q": Each(Each(float, least=1)),
        "measured_mm": Each(THREE),
    },
    "places?": {"word": frozenset(["line", "row"]), "first": int, "at": Maybe({str: int})},
    "joints": Each({"unit": frozenset(["mm", "rad"]), "limits": Maybe(PAIR)}),
    "arm_mm": Each(THREE),
    "base": int,
    "rungs": Each({"residual_mm": Each(THREE), "rotation_rad": Maybe(Each(THREE))}),
    "map": {
        "places": Each(
            {"frame": int, "axis": frozenset(AXES), "turns_only": bool, "d": Each(THREE)}
        ),
        "columns": Each(
            {
                "wave": NUMBER,
                "angle": Maybe(str),
                "joint": Maybe(int),
                "values": Maybe(Each(Each(float))),
                "unit?": str,
            }
        ),
        "slopes": Each(Each(Maybe(Each(float)))),
        "named": Each((int, int, str)),
    },
    "cards": {str: CARD},
    "findings": Each(
        {"label": str, "what": str, "panels": Each(PANEL), "more_panels": int, "rivals": TEXTS}
    ),
}


def disagreement(result: Mapping[str, Any], details: Mapping[str, Any]) -> str | None:
    """What in the two files of a run, each of its shape, is not of one length or beyond an end;
    None where all is."""
    rows, whole, drawn, ladder = (
        details["rows"],
        result["error_map"],
        details["map"],
        result["ladder"],
    )
    m, n, places, causes = (
        len(rows["row"]),
        len(details["joints"]),
        len(whole["places"]),
        len(whole["causes"]),
    )
    block, trace = (
        result["correlation"],
        (result["sampling"] or {"trace": {"names": [], "draws": []}})["trace"],
    )
    counts = [
        (
            "details.json: rows",
            m,
            [len(rows[key]) for key in ("estimation", "outlying", "q", "measured_mm")],
        ),
        ("details.json: rows.q", n, map(len, rows["q"])),
        ("details.json: arm_mm", n + 1 if n else 1, [len(details["arm_mm"])]),
        ("details.json: rungs", len(ladder), [len(details["rungs"])]),
        ("details.json: rungs.residual_mm", m, (len(r["residual_mm"]) for r in details["rungs"])),
        (
            "details.json: rungs.rotation_rad",
            m,
            (len(r["rotation_rad"] or r["residual_mm"]) for r in details["rungs"]),
        ),
        ("details.json: findings", len(result["findings"]), [len(details["findings"])]),
        ("details.json: map.places", places, [len(drawn["places"])]),
        ("details.json: map.places.d", m, (len(p["d"]) for p in drawn["places"])),
        ("details.json: map.columns", causes, [len(drawn["columns"])]),
        (
            "details.json: map.columns.values",
            m,
            (len(v) for c in drawn["columns"] for v in c["values"] or []),
        ),
        (
            "result.json: error_map.f",
            places,
            [len(whole["f"]), len(whole["p_family_wise"]), len(drawn["slopes"])],
        ),
        (
            "result.json: error_map.f",
            causes,
            (
                len(row)
                for some in (whole["f"], whole["p_family_wise"], drawn["slopes"])
                for row in some
            ),
        ),
        (
            "result.json: correlation.matrix",
            len(block["symbols"]),
            [len(block["matrix"]), *map(len, block["matrix"])],
        ),
        ("result.json: sampling.trace.draws", len(trace["names"]), map(len, trace["draws"])),
        *(
            (
                f"details.json: findings.{k}.panels",
                len(p["x"]),
                [len(p[key]) for key in ("before", "after", "weight")],
            )
            for k, f in enumerate(details["findings"], 1)
            for p in f["panels"]
        ),
        *(
            (f"details.json: findings.{k}.panels.curve", len(p["curve"][0]), [len(p["curve"][1])])
            for k, f in enumerate(details["findings"], 1)
            for p in f["panels"]
        ),
    ]
    for place, wanted, found in counts:
        if (odd := next((count for count in found if count != wanted), None)) is not None:
            return f"{place} has {odd} where {wanted} belong"
    if not all(0 <= i < places and 0 <= j < causes for i, j, _ in drawn["named"]):
        return "details.json: map.named names a cell that the map does not have"
    if not 0 <= details["base"] < len(ladder):
        return f"details.json: base is {details['base']}, and the ladder has {len(ladder)} rungs"
    return None
