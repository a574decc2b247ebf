"""The figures of the statistics page on how sure a result is: folds, standard errors; each is (SVG,
what to see in it)."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache

import numpy as np
from arm import short
from campaigns import BASE, ROBOT, measured
from example import run_example

from modelsel._typing import Array
from modelsel.fitting.design import compute_design
from modelsel.fitting.least_squares import fit
from modelsel.mechanisms.registry import mechanism
from modelsel.report.style import BLUE, INK, ORANGE, QUIET, svg, use_style
from modelsel.selection.cross_validation import cross_validate, fold
from modelsel.selection.splits import assign_folds


@cache
def grouped() -> tuple[bytes, str]:
    """Cross-validation by row and by configuration, on rows that belong together."""
    from scipy.linalg import lstsq

    times, arm_error = (
        4,
        0.06,
    )  # each configuration is seen four times; the arm's own error at it stays the same
    once, rng = measured(60, [], 5, noise=0.0), np.random.default_rng(5)
    theta = fit(once, BASE)
    new = measured(240, [], 5, noise=0.0)
    pool = [
        t
        for j in range(1, 7)
        for w in (3, 5, 7, 9, 11, 13)
        for t in mechanism(f"gear-ripple:{j}:{w}", ROBOT).terms
    ]
    pool = [pool[k] for k in rng.permutation(len(pool))]
    index = np.repeat(np.arange(60), times)
    noise = rng.normal(0, arm_error, (60, 3))[index] + rng.normal(0, 0.02, (60 * times, 3))
    rows = once.take(index)
    rows = replace(rows, data=replace(rows.data, position=rows.data.position + noise))
    sizes, curves = range(0, 61, 10), {"fit": [], "row": [], "configuration": [], "new": []}
    by = {
        "configuration": assign_folds(rows.data, 10, np.random.default_rng(1)),
        "row": rng.permutation(60 * times) % 10,
    }
    base = len(BASE.terms)
    whole = (*BASE.terms, *pool)
    (A, r), (B, s) = (
        tuple(
            x.reshape(x.shape[0] * 3, *x.shape[2:]) for x in compute_design(part, whole, theta.at())
        )
        for part in (rows, new)
    )
    folded = {kind: fold(rows, whole, of, theta.at()) for kind, of in by.items()}
    for count in sizes:
        delta = lstsq(A[:, : base + count], r, cond=1e-9, lapack_driver="gelsy")[0]
        curves["fit"].append(_rms(r - A[:, : base + count] @ delta))
        curves["new"].append(
            float(np.hypot(_rms(s - B[:, : base + count] @ delta), np.hypot(arm_error, 0.02)))
        )
        for kind, parts in folded.items():
            curves[kind].append(cross_validate(parts.select(range(base + count))).rms)
    with use_style() as plt:
        fig, ax = plt.subplots(figsize=(6.5, 2.5), layout="constrained")
        for kind, style, colour, words in (
            ("new", "-", INK, "new configurations: the truth"),
            ("configuration", "o-", BLUE, "folds by configuration"),
            ("row", "s--", ORANGE, "folds by row"),
            ("fit", ":", QUIET, "the fit's own residual"),
        ):
            ax.plot(list(sizes), curves[kind], style, color=colour, ms=3.5, lw=1.3, label=words)
        ax.set_xlabel("columns in the model that describe nothing")
        ax.set_ylabel("rms of a coordinate [mm]")
        ax.set_ylim(0)
        ax.grid(True, axis="y")
        ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
        drawn = svg(fig, "Cross-validation by row and by configuration")
    return short(drawn), (
        f"60 configurations measured {times} times each; the arm errs by {arm_error} mm at each, the same every "
        "time, the tracker by 0.02 mm. Folds of rows leave copies of the held-out rows in the fit and see no harm"
        " in useless columns. Folds of configurations do."
    )


def _rms(values: Array) -> float:
    return float(np.sqrt(np.square(values).mean()))


@cache
def posterior() -> tuple[bytes, str]:
    """Three standard errors of every named coefficient, and the chain's interval."""
    result = json.loads(run_example().to_json())
    named = [p for p in result["parameters"] if p["mechanism"] != "geometric"]
    chain = {q["name"]: q for q in result["sampling"]["quantiles"]}
    with use_style() as plt:
        fig, ax = plt.subplots(figsize=(6.5, 2.6), layout="constrained")
        for x, p in enumerate(named):
            unit, centre = p["standard_error"], p["estimate"]
            for dx, error, colour in (
                (-0.24, p["standard_error"], QUIET),
                (-0.08, p["bootstrap_error"], ORANGE),
                (0.08, p["posterior_error"], BLUE),
            ):
                ax.plot(
                    [x + dx] * 2,
                    [-1.96 * error / unit, 1.96 * error / unit],
                    color=colour,
                    lw=3,
                    solid_capstyle="butt",
                )
            if (q := chain.get(p["symbol"])) is not None:
                ax.plot(
                    [x + 0.24] * 2,
                    [(q["low"] - centre) / unit, (q["high"] - centre) / unit],
                    color=INK,
                    lw=1.2,
                    marker="_",
                    ms=5,
                )
        for colour, words in (
            (QUIET, "least squares"),
            (ORANGE, "bootstrap"),
            (BLUE, "closed form"),
            (INK, "chain on the exact arm"),
        ):
            ax.plot([], [], color=colour, lw=3 if colour != INK else 1.2, label=words)
        ax.axhline(0, color="#BBBBBB", lw=0.6, zorder=0)
        ax.set_xticks(
            range(len(named)), [p["symbol"].partition(" of ")[0] for p in named], color=INK
        )
        ax.set_ylabel("95 % interval\n[standard errors]")
        ax.set_ylim(-3.2, 3.2)
        ax.legend(
            ncols=4,
            loc="lower left",
            bbox_to_anchor=(0, 1.0),
            borderaxespad=0,
            columnspacing=1.2,
            handlelength=1.4,
            fontsize=7,
        )
        drawn = svg(fig, "Intervals of the named coefficients")
    return short(drawn), (
        "The named coefficients of the PUMA study. Where the four agree, the noise is as assumed and the arm is "
        "linear enough; where the bootstrap is wider, a few configurations carry the result."
    )
