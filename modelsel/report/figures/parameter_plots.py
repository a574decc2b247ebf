"""Every fitted parameter with its interval, how parameters hang together, the posterior of the
informative few."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..style import AFTER, BLUE, GREY, INK, ORANGE, QUIET, WIDTH, scaled, shortened, styled, svg

MOST = 64  # rows of the forest
SHOWN = 6  # names of the posterior's picture
MATRIX = 48  # names of the correlation's picture


def forest(parameters: list[dict[str, Any]]) -> bytes:
    """Estimates in units of their own standard error (a 95 % interval is 3.92 of them), strongest
    first: what lies inside the grey band may be nought."""
    score = [3.92 * p["estimate"] / (p["high"] - p["low"]) for p in parameters]
    order = sorted(range(len(parameters)), key=lambda k: -abs(score[k]))[:MOST]
    half = (len(order) + 1) // 2
    top = abs(score[order[0]]) * 1.6
    with styled() as sheets:
        fig, axes = sheets.subplots(
            1,
            2 if len(order) > half else 1,
            figsize=(WIDTH, 0.135 * half + 0.6),
            layout="constrained",
            squeeze=False,
            sharex=True,
        )
        for ax, part in zip(axes[0], (order[:half], order[half:]), strict=False):
            rows = np.arange(len(part))
            z = np.array([score[k] for k in part])
            ax.set_xscale("symlog", linthresh=4)
            ax.axvspan(-1.96, 1.96, color="#EFEFEF", lw=0)
            ax.axvline(0, color="#BBBBBB", lw=0.7)
            ax.hlines(rows, z - 1.96, z + 1.96, color=QUIET, lw=1)
            sure = np.abs(z) > 1.96
            ax.plot(z[sure], rows[sure], "o", ms=3.5, color=BLUE)
            ax.plot(z[~sure], rows[~sure], "o", ms=3.5, mfc="white", mec=BLUE)
            ax.set_yticks(
                rows,
                [shortened(parameters[k]["symbol"], 24) for k in part],
                fontsize=6.5,
                color=INK,
            )
            ax.set_ylim(half - 0.4, -0.6)
            ax.set_xlim(-top, top)
            ticks = [t for t in (1000, 100, 10) if t < top]
            ax.set_xticks([*(-t for t in ticks), 0, *reversed(ticks)])
            ax.xaxis.set_major_formatter(lambda v, _: f"{v:g}".replace("-", "−"))
            ax.xaxis.set_minor_formatter(lambda v, _: "")
            ax.tick_params(axis="y", length=0)
            ax.set_xlabel("estimate in standard errors")
        return svg(fig, "Parameter significance")


def correlation(block: dict[str, Any]) -> bytes:
    """The correlation matrix of the estimates, clusters first; size and shade grow with |r|, hollow
    where it is negative."""
    order = [s for cluster in block["clusters"] for s in cluster]
    order += [s for s in block["symbols"] if s not in order]
    order = list(dict.fromkeys(order))[:MATRIX]
    place = {s: k for k, s in enumerate(block["symbols"])}
    at = [place[s] for s in order]
    r = np.array(
        [[np.nan if v is None else v for v in row] for row in block["matrix"]], dtype=float
    )[np.ix_(at, at)]
    n, i, j = len(order), *np.tril_indices(len(order), -1)
    size = np.abs(np.nan_to_num(r[i, j]))
    keep = size > 0.1
    i, j, size, negative = i[keep], j[keep], size[keep], r[i, j][keep] < 0
    with styled() as sheets:
        fig, ax = sheets.subplots(figsize=(WIDTH * 0.8, WIDTH * 0.75), layout="constrained")
        area = (230.0 / max(n, 6)) ** 2
        ax.scatter(
            j[~negative],
            i[~negative],
            s=area * size[~negative],
            c=BLUE,
            linewidths=0,
            alpha=0.25 + 0.75 * size[~negative],
        )
        ax.scatter(
            j[negative],
            i[negative],
            s=area * size[negative],
            facecolors="none",
            edgecolors=ORANGE,
            linewidths=0.5 + size[negative],
        )
        ax.set_xticks(range(n), order, rotation=90, fontsize=5.5)
        ax.set_yticks(range(n), order, fontsize=5.5)
        ax.set_xlim(-0.8, n - 0.2)
        ax.set_ylim(n - 0.2, -0.8)
        ax.tick_params(length=0)
        ax.spines[:].set_color(GREY)
        return svg(fig, "Correlation of the estimates")


def posterior(trace: dict[str, Any], units: dict[str, str]) -> bytes:
    """Draws of the informative few, pair by pair, with their distributions on the diagonal; `units`
    by name."""
    draws, names = np.array(trace["draws"], dtype=float)[:, :SHOWN], trace["names"][:SHOWN]
    n = draws.shape[1]
    titles = []
    for k, name in enumerate(names):
        stem, over, per = units.get(name, "1").partition("/")
        factor, unit = scaled(stem, float(np.abs(draws[:, k]).max(initial=0)))
        draws[:, k] *= factor
        titles.append(
            shortened(name, 14) + ("" if unit + over + per == "1" else f"\n[{unit}{over}{per}]")
        )
    with styled() as sheets:
        fig, axes = sheets.subplots(
            n, n, figsize=(WIDTH, WIDTH * 0.86), squeeze=False, layout="constrained"
        )
        for a in range(n):
            for b in range(n):
                ax = axes[a, b]
                if b > a:
                    ax.remove()
                    continue
                if a == b:
                    ax.hist(draws[:, a], bins=20, color=GREY, edgecolor=AFTER, linewidth=0.6)
                    ax.set_title(titles[a], fontsize=7, loc="center")
                    ax.set_yticks([])
                else:
                    ax.plot(draws[:, b], draws[:, a], ".", ms=1.6, color=AFTER, alpha=0.6, mew=0)
                ax.tick_params(labelsize=5, length=1.5, pad=1)
                ax.locator_params(nbins=3)
                ax.ticklabel_format(axis="both", style="plain", useOffset=False)
                if a < n - 1:
                    ax.set_xticklabels([])
                if b or a == b:
                    ax.set_yticklabels([])
        return svg(fig, "Posterior")
