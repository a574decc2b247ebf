"""The figures of the pages on statistics and repeatability, computed by modelsel on simulated campaigns:
each is (SVG, what to see in it)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import catalogue
import lasting
import numpy as np
import repeating
from arm import short
from campaigns import BASE, NOISE, ROBOT, View, effect, look, measured

from modelsel._typing import Array
from modelsel.diagnosis.findings.outcome import build_empty
from modelsel.diagnosis.inference.credible_sets import ask
from modelsel.diagnosis.inference.evidence import (
    RATIOS,
    compute_factors,
    compute_log_bayes_factors,
    draw_null,
    normalise_strength,
    sum_evidence,
)
from modelsel.diagnosis.search.state import LEVEL
from modelsel.diagnosis.unexplained import POWER, compute_detection_limit
from modelsel.mechanisms.registry import mechanism
from modelsel.report.style import BLUE, GREY, INK, ORANGE, QUIET, svg, use_style

Figure = Callable[[], tuple[bytes, str]]
PLANTED, SIZE = "wrist-coupling:5", 1.15e-4
DRAWS = 499
THIN = 15  # of the many candidates that say nothing one in so many is drawn
SHARES = (
    "joint3-twist",
    "joint-compliance:2",
    "backlash:3",
    "base-tilt",
    "wrist-coupling:5",
    "gear-eccentricity:1",
    "gear-ripple:4",
    "axis-wobble:1",
    "tool-droop",
    "thermal-zero:1",
    "tracker-drift",
    "tracker-scale",
)


@cache
def projection() -> tuple[bytes, str]:
    """How much of each mechanism geometry takes."""
    absorbed, _ = catalogue.common()
    share = np.array([absorbed[n] ** 2 for n in SHARES])
    order = np.argsort(share)
    with use_style() as plt:
        fig, ax = plt.subplots(figsize=(6.5, 2.7), layout="constrained")
        rows = np.arange(len(SHARES))
        ax.barh(
            rows,
            1 - share[order],
            color=BLUE,
            height=0.7,
            label="left beyond geometry: what can be found",
        )
        ax.barh(
            rows,
            share[order],
            left=1 - share[order],
            color=GREY,
            height=0.7,
            label="taken by geometry",
        )
        ax.set_yticks(rows, [SHARES[k] for k in order], color=INK)
        ax.set_ylim(len(SHARES) - 0.5, -0.5)
        ax.set_xlim(0, 1)
        ax.xaxis.set_major_formatter(lambda v, _: f"{v:.0%}")
        ax.set_xlabel("share of the mean squared displacement of the target")
        ax.legend(ncols=2, loc="lower left", bbox_to_anchor=(0, 1.0), borderaxespad=0)
        drawn = svg(fig, "What geometry takes of each mechanism")
    return short(drawn), (
        f"{catalogue.COUNT} configurations drawn for {catalogue.ROBOT}. Grey is not lost to the robot, the fit "
        "corrects it; but it is called geometry, and nobody can tell it from geometry."
    )


@cache
def _pair() -> tuple[View, View, Array, Array]:
    """A campaign with one effect: seen beyond geometry, and beyond geometry and the effect; the
    null's evidences, log priors."""
    at = measured(80, effect(PLANTED, SIZE), 11)
    before = look(at)
    prior = np.log([c.prior for c in before.found])
    least = draw_null(before.seen, prior, DRAWS, np.random.default_rng(1))[0]
    named = [mechanism(PLANTED, ROBOT)]
    return before, look(at, BASE + named, before.cols), least, prior


@cache
def scan() -> tuple[bytes, str]:
    """The evidence of every candidate alone."""
    before, after, least, prior = _pair()
    bound = float(np.quantile(least, 1 - LEVEL))
    frame = np.array([c.mechanism.terms[0].screws[0].frame for c in before.found])
    registered = np.array([c.registered for c in before.found])
    order = np.argsort(frame, kind="stable")
    with use_style() as plt:
        fig, axes = plt.subplots(1, 2, figsize=(6.5, 2.7), layout="constrained", sharey=True)
        for ax, view, title in zip(
            axes,
            (before, after),
            ("beyond geometry", f"beyond geometry and {PLANTED}"),
            strict=True,
        ):
            y = np.maximum(compute_factors(view.seen, view.rest).max(0) + prior, -19.5)[order]
            x = np.arange(len(y))
            few = (y > -5) | (x % THIN == 0)
            for mine, colour, size in (
                (~registered[order], "#A8A8A8", 3),
                (registered[order], BLUE, 7),
            ):
                ax.scatter(x[mine & few], y[mine & few], s=size, color=colour, lw=0)
            ax.axhline(bound, color=ORANGE, lw=1)
            ax.set_title(title)
            edges = np.searchsorted(frame[order], np.arange(1, ROBOT.n + 3))
            ax.set_xticks(
                (edges[1:] + edges[:-1]) / 2, [*map(str, range(1, ROBOT.n + 1)), "target"]
            )
            ax.tick_params(axis="x", length=0)
            ax.set_xlabel("frame")
        axes[0].set_ylabel("log (prior × Bayes factor)")
        axes[0].annotate(
            "bound: chance, 5 %",
            (0, bound),
            (2, 3),
            textcoords="offset points",
            color=ORANGE,
            fontsize=7,
        )
        best = int(np.argmax((compute_factors(before.seen, before.rest).max(0) + prior)[order]))
        axes[0].annotate(
            PLANTED,
            (best, (compute_factors(before.seen, before.rest).max(0) + prior)[order][best]),
            (-6, 0),
            ha="right",
            va="center",
            textcoords="offset points",
            color=BLUE,
            fontsize=7.5,
        )
        drawn = svg(fig, "The scan before and after the effect is in the model")
    return short(drawn), (
        f"{len(before.found):,} candidates, each a dot (far below the bound one in {THIN} is drawn): blue the "
        f"registered mechanisms, grey the cells of the error map. {PLANTED}, planted with {SIZE * 1e6:.0f} "
        f"µrad/rad in noise of {NOISE} mm, stands out with its echoes; with it in the model nothing passes the "
        "bound, and the search stops."
    )


@cache
def max_test() -> tuple[bytes, str]:
    """What chance alone would show, and what was seen."""
    before, after, least, prior = _pair()
    bound = float(np.quantile(least, 1 - LEVEL))
    seen = [sum_evidence(compute_factors(v.seen, v.rest), prior)[0] for v in (before, after)]
    with use_style() as plt:
        fig, ax = plt.subplots(figsize=(6.5, 2.1), layout="constrained")
        ax.hist(
            least,
            bins=np.arange(least.min(), least.max() + 0.2, 0.2),
            color=GREY,
            label=f"pure noise, {DRAWS} draws",
        )
        ax.set_xlim(least.min() - 0.6, seen[0] + 0.8)
        ax.axvline(bound, color=ORANGE, lw=1.2, label="bound: 5 % of the draws lie beyond")
        where = (
            (seen[0], BLUE, "seen beyond geometry"),
            (seen[1], "white", f"seen with {PLANTED} in the model"),
        )
        for value, fill, words in where:
            ax.plot(value, 12, "v", ms=7, mfc=fill, mec=BLUE, ls="", label=f"{words}: {value:.1f}")
        ax.legend(loc="upper right")
        ax.set_xlabel("log evidence that anything at all is there")
        ax.set_ylabel(f"of {DRAWS} draws")
        drawn = svg(fig, "The null of the whole scan")
    return short(drawn), (
        "Grey: the largest evidence that pure noise shows anywhere in the same scan of the same configurations. A"
        " finding counts when it lies beyond the bound: 5 % for the whole scan together, not for each of its "
        "thousands of questions."
    )


@cache
def credible() -> tuple[bytes, str]:
    """One effect, ever more configurations."""
    counts, truth = (25, 50, 120), "joint-compliance:2"
    rows = []
    for m in counts:
        view = look(measured(m, effect(truth, 1.5e-6), 30))
        log_prior = np.log([one.prior for one in view.found])
        rows.append(ask(view.seen, view.found, log_prior, view.rest).answer(None))
    with use_style() as plt:
        fig, ax = plt.subplots(figsize=(6.5, 1.8), layout="constrained")
        for y, named in enumerate(rows):
            start = 0.0
            for k, e in enumerate(named.entries[:9]):
                label = e.candidate.registered_name or "a cell"
                colour = (
                    BLUE
                    if label == truth
                    else ("#56B4E9" if e.alike else ("#C9C9C9" if k % 2 else "#B3B3B3"))
                )
                ax.barh(
                    y,
                    e.probability,
                    left=start,
                    color=colour,
                    height=0.66,
                    edgecolor="white",
                    lw=0.7,
                )
                if e.probability > 0.16:
                    ax.text(
                        start + e.probability / 2,
                        y,
                        label,
                        ha="center",
                        va="center",
                        fontsize=6.5,
                        color="white" if colour == BLUE else INK,
                    )
                start += e.probability
            if named.more:
                ax.barh(y, 0.95 - start, left=start, color="#EDEDED", height=0.66)
            ax.text(
                1.01,
                y,
                f"{named.verdict}, {len(named.entries) + named.more} in the set",
                va="center",
                fontsize=7,
                color=QUIET,
            )
        ax.set_yticks(range(len(counts)), [f"{m} configurations" for m in counts], color=INK)
        ax.set_ylim(len(counts) - 0.5, -0.5)
        ax.set_xlim(0, 1)
        ax.xaxis.set_major_formatter(lambda v, _: f"{v:.0%}")
        ax.set_xlabel("probability of each explanation")
        drawn = svg(fig, "Credible sets of one effect")
    return short(drawn), (
        f"The same effect, {truth}, in ever longer campaigns. Dark blue: what was planted; light blue: what moves "
        "the target like the first of its set; grey: rivals. The set says what the data know, and no more."
    )


def _evidences(view: View, prior: Array, responses: Array) -> Array:
    """(B,) log evidence of each response (N, B), as `evidence` has it of one."""
    share = normalise_strength(
        view.seen.strength(view.seen.columns.dot(responses)), np.square(responses).sum(0)
    )
    joint = [compute_log_bayes_factors(view.seen, share, float(r)) + prior[:, None] for r in RATIOS]
    return np.asarray(np.max([np.logaddexp.reduce(j, axis=0) for j in joint], axis=0))


def _limit(view: View, least: Array, prior: Array) -> tuple[float, float]:
    """(the bound of a scan, the detection limit that a study without findings states [mm])."""
    bound = float(np.quantile(least, 1 - LEVEL))
    nothing = replace(build_empty(BASE, view.fitted), bound=bound)
    return bound, compute_detection_limit(nothing, list(np.exp(prior)), 80, NOISE)


@cache
def detection() -> tuple[bytes, str]:
    """How often an effect of a given size is found: by formula and by trying."""
    from scipy.optimize import brentq
    from scipy.special import chndtr

    view, _, least, prior = _pair()
    (bound, limit), rng, tries = _limit(view, least, prior), np.random.default_rng(9), 40
    seen, cell = view.seen, int(np.argsort(np.abs(prior - np.median(prior)), kind="stable")[0])
    cell = next(
        g
        for g, c in enumerate(view.found)
        if not c.registered and len(c.mechanism.terms) == 1 and seen.sizes[g] == 1 and g >= cell
    )
    moved = view.cols.expand(cell)[0]
    moved = moved - seen.Q @ (seen.Q.T @ moved)
    moved *= np.sqrt(80) / np.linalg.norm(moved)  # 1 mm rms a row, beyond the model
    sizes, hits = np.linspace(0.25, 1.75, 7) * limit, list[float]()
    for size in sizes:
        noise = rng.normal(0, NOISE, (len(moved), tries)) + size * moved[:, None]
        noise -= seen.Q @ (seen.Q.T @ noise)
        hits.append(float(np.mean(_evidences(view, prior, noise) > bound)))
    strength = 80 * np.square(limit / NOISE)
    critical = brentq(lambda c: chndtr(c, 1, strength) - (1 - POWER), 1e-3, strength)
    fine = np.linspace(0, 1.8 * limit, 80)
    with use_style() as plt:
        fig, ax = plt.subplots(figsize=(6.5, 2.3), layout="constrained")
        ax.plot(
            1e3 * fine,
            1 - chndtr(critical, 1, 80 * np.square(fine / NOISE)),
            color=BLUE,
            lw=1.4,
            label="formula: noncentral χ²",
        )
        error = np.sqrt(np.array(hits) * (1 - np.array(hits)) / tries)
        ax.errorbar(
            1e3 * sizes,
            hits,
            error,
            fmt="o",
            ms=4,
            color=ORANGE,
            lw=1,
            label=f"tried, {tries} campaigns each",
        )
        ax.axhline(POWER, color=QUIET, lw=0.6, ls=":")
        ax.axvline(1e3 * limit, color=QUIET, lw=0.8)
        ax.text(
            1e3 * limit, 0.04, f" stated limit: {1e3 * limit:.1f} µm rms", fontsize=7.5, color=QUIET
        )
        ax.yaxis.set_major_formatter(lambda v, _: f"{v:.0%}")
        ax.set_xlabel("size of the effect beyond geometry [µm rms at the target]")
        ax.set_ylabel("found")
        ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
        drawn = svg(fig, "How large an effect must be to be found")
    return short(drawn), (
        f"80 configurations, noise {1e3 * NOISE:.0f} µm a coordinate. An effect of half the noise is found almost "
        "surely, because 240 coordinates speak for it. Below the limit something is found now and then: false alarms, "
        "5 %, are counted here and not in the formula, and so are echoes. There its absence proves nothing."
    )


ALL: dict[str, Figure] = {
    "projection": projection,
    "scan": scan,
    "max-test": max_test,
    "credible": credible,
    "grouped": lasting.grouped,
    "detection": detection,
    "posterior": lasting.posterior,
    "repeatability": repeating.parts,
}
