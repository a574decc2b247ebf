"""What the chosen model leaves and how well its parameters are known; sections without their keys
in result.json are left out."""

from __future__ import annotations

from typing import Any

from ...diagnosis.sentences import choose_prefix
from ...results.storage import Source
from ..document import Block, heading, points, table, text
from ..figures import ladder, space
from ..figures import parameter_plots as parameters
from ..terminal import mm

PAIRS = 8
QUANTILES = 24


def residuals(source: Source) -> list[Block]:
    """Residual vectors in the workspace: nominal, base, chosen."""
    details, result = source.details, source.result
    last = len(result["ladder"]) - 1
    which = list(dict.fromkeys([0, details["base"], last]))
    named = {0: "nominal", details["base"]: "base", last: "chosen"}
    return [
        heading("Residuals in the workspace"),
        source.figure(
            "vectors",
            space.vectors(details, [(k, named[k]) for k in which]),
            "Residual vectors, measured minus predicted, each picture at the magnification written above it. Arrows "
            "that agree with their "
            "neighbours are a systematic error; the chosen model should leave none that do. Outliers are left out.",
            "Three-dimensional residual vectors of "
            + ", ".join(
                f"the {named[k]} model (mean {mm(result['ladder'][k]['estimation']['mean_mm'])} mm on estimation configurations)"
                for k in which
            )
            + ".",
        ),
        heading("What else was looked for", 2),
        text(" ".join([result["nothing_else"]["sentence"], _predictable(result)]).strip()),
    ]


def _predictable(result: dict[str, Any]) -> str:
    found = result["nothing_else"].get("predictable")
    if found is None:
        return ""
    if found["p"] <= 0.05 and found["share"] > 0.01:
        return (
            f"Some smooth function of the configuration would still predict {found['share']:.0%} of what is left (p = "
            f"{found['p']:.2g}): the chosen "
            "model has not said everything."
        )
    return f"No smooth function of the configuration predicts what is left (p = {found['p']:.2g})."


def held_out(source: Source) -> list[Block]:
    """Distribution of the errors per rung."""
    result = source.result
    picture = ladder.held_out(result, source.details)
    side = "held-out" if result["configurations"]["held_out"] else "estimation"
    if picture is None:
        return []
    first, last = result["ladder"][0], result["ladder"][-1]
    key = "held_out" if last["held_out"]["p95_mm"] is not None else "estimation"
    return [
        heading(
            "Held-out errors" if side == "held-out" else "Errors (nothing is held out)", opens=False
        ),
        source.figure(
            "held-out",
            picture,
            f"Share of {side} configurations whose error stays below a length. The further left and the steeper, "
            "the better; a curve that crosses another is worse for some configurations."
            + (
                f" {ladder.CURVES} of the ladder's {len(ladder.rungs(result))} models, called as there."
                if len(ladder.rungs(result)) > ladder.CURVES
                else ""
            ),
            f"Distribution of {side} errors per model: 95 % stay below {mm(first[key]['p95_mm'])} mm with the nominal and below "
            f"{mm(last[key]['p95_mm'])} mm with the chosen model.",
        ),
    ]


def significance(source: Source) -> list[Block]:
    """Forest plot and table by mechanism."""
    result, blocks = source.result, list[Block]()
    known = [p for p in result.get("parameters") or [] if p["low"] < p["high"]]
    if known:
        picture = parameters.forest(known)
        weak = [p["symbol"] for p in known if p["low"] < 0 < p["high"]]
        blocks.append(
            source.figure(
                "forest",
                picture,
                "Every fitted parameter in units of its own standard error, the surest first, with its 95 % "
                "interval. Inside the "
                "grey band, open: it may be nought."
                + (
                    f" The {parameters.MOST} strongest of {len(known)} are drawn."
                    if len(known) > parameters.MOST
                    else ""
                ),
                f"Forest plot of {len(known)} parameters; {len(weak)} may be nought"
                + (f": {', '.join(weak[:12])}." if weak else "."),
            )
        )
    if result.get("significance"):
        weighed = result["significance"]
        numbers = {
            "mean mm": [mm(s["mean_mm"]) for s in weighed],
            "worst mm": [mm(s["max_mm"]) for s in weighed],
            "nominal p": [_p(s["p"]) for s in weighed],
            "log10 evidence": [_signed(s["log10_evidence"]) for s in weighed],
            "held-out rms mm": [
                f"{mm(s['held_out_rms_without_mm'])} → {mm(s['held_out_rms_mm'])}" for s in weighed
            ],
            "stable": ["–" if s["stability"] is None else f"{s['stability']:.0%}" for s in weighed],
        }
        numbers = {
            name: column for name, column in numbers.items() if set(column) != {"–"}
        }  # a long run leaves some out
        said = "Mean and worst displacement of the target by each mechanism. Held-out: rms without it and with it."
        if "stable" in numbers:
            said += " Stable: share of half-samples in which it stays significant."
        if {"nominal p", "stable"} & set(numbers):
            said += " Nominal p and stable take the names as given: the search is not repeated for them."
        odd = [
            f"{s['mechanism']}: {s['catalogue']}"
            for s in weighed
            if s["catalogue"] != "as expected"
        ]
        blocks += [
            heading("By mechanism", 2),
            table(
                [("mechanism", "left"), *((name, "right") for name in numbers)],
                [
                    list(row)
                    for row in zip(
                        [s["mechanism"] for s in weighed], *numbers.values(), strict=True
                    )
                ],
                said,
                [1.0, *[0.0] * len(numbers)],
            ),
        ]
        if odd:
            blocks.append(points(odd))
    return [heading("Significance"), *blocks] if blocks else []


def _p(value: float | None) -> str:
    return (
        "–"
        if value is None
        else "<0.001"
        if value < 0.001
        else "≤0.001"
        if value == 0.001
        else f"{value:.3f}"
    )


def _signed(value: float | None) -> str:
    return "–" if value is None else f"{value:+.1f}".replace("-", "−")


def correlation(source: Source) -> list[Block]:
    """Which parameters hang together."""
    block = source.result.get("correlation")
    if not block or not block.get("matrix") or len(block["symbols"]) < 2:
        return []
    clusters = [c for c in block["clusters"] if len(c) > 1]
    count, most = len(block["symbols"]), parameters.MATRIX
    part = f" {most} of {count} parameters are drawn, the clusters first." if count > most else ""
    out = [
        heading("Correlation"),
        source.figure(
            "correlation",
            parameters.correlation(block),
            "Correlation of the estimates, clusters together. Filled: positive; open ring: "
            "negative; the larger, the stronger. Parameters of one cluster are known together better than apart."
            + part,
            f"Correlation matrix of {count} parameters in {len(clusters)} clusters.",
        ),
    ]
    if block["pairs"]:
        out.append(points([p["sentence"] for p in block["pairs"][:PAIRS]]))
    return out


def posterior(source: Source) -> list[Block]:
    """Draws of the informative few, and what the sampler says of itself."""
    found = source.result.get("sampling")
    if not found:
        return []
    blocks = [heading("Posterior")]
    if not found.get("converged"):
        blocks.append(
            text(
                "The chains had not converged when sampling ended; no quantile of theirs is quoted."
            )
        )
    if found.get("sentence"):
        blocks.append(text(found["sentence"]))
    if found.get("converged"):
        blocks.append(
            text(
                f"{found['steps']:,} steps of {found['walkers']} walkers, autocorrelation time {found['tau']:.0f}: "
                f"{found['effective_samples']:,.0f} effective samples, R-hat {found['r_hat']:.3f}."
            )
        )
    if found.get("importance"):
        blocks.append(text(found["importance"]["sentence"]))
    trace = found.get("trace")
    if found.get("converged") and trace and len(trace["names"]) and len(trace["draws"]):
        blocks.append(
            source.figure(
                "posterior",
                parameters.posterior(
                    trace, {q["name"]: q["unit"] for q in found.get("quantiles") or []}
                ),
                "Draws from the posterior of the informative few, in the parameters' own "
                "units. A narrow slanting cloud: two parameters that the data know only together.",
                f"Pairwise posterior draws of {', '.join(trace['names'][: parameters.SHOWN])}.",
            )
        )
    if found.get("quantiles"):
        rows = [[q["name"], *_quantiles(q)] for q in found["quantiles"][:QUANTILES]]
        blocks.append(
            table(
                [
                    ("parameter", "left"),
                    *(
                        (n, "right")
                        for n in (
                            "2.5 %",
                            "median",
                            "97.5 %",
                            "2.5 %, closed form",
                            "97.5 %, closed form",
                        )
                    ),
                    ("unit", "left"),
                ],
                rows,
                "Sampled as said above; beside it what least squares says in closed form.",
                [0.0] * 7,
            )
        )
    return blocks


def _quantiles(found: dict[str, Any]) -> list[str]:
    """The five quantiles of a parameter in one unit, to the place that three digits of the widest
    give; then the unit."""
    values = [found[k] for k in ("low", "median", "high", "closed_form_low", "closed_form_high")]
    biggest = max((abs(v) for v in values if v is not None), default=0.0)
    factor, unit = choose_prefix(biggest, found["unit"])
    places = max(2 - int(f"{biggest / factor:.2e}".partition("e")[2]), 0)
    return [*("–" if v is None else f"{v / factor:.{places}f}" for v in values), unit]
