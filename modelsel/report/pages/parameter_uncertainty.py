"""What the chosen model leaves and how well its parameters are known."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from ...diagnosis.sentences import choose_prefix
from ...results.model_schema import QuantilesRecord, SamplingRecord
from ...results.schema import StudyRecord
from ...results.study_sentences import describe_predictable, format_mm, write_sampling_sentences
from ..document import Block, Source, make_heading, make_list, make_table, make_text
from ..figures import ladder, parameter_plots, space

MAX_PAIRS = 8
MAX_QUANTILES = 24


# -- residuals
# --------------------------------------------------------------------------------------------------------------------


def write_residuals_page(source: Source) -> list[Block]:
    """Write the residual vectors in the workspace: nominal, base, chosen."""
    record, details = source.record, source.details
    names = {0: "nominal", details.base: "base", len(record.ladder) - 1: "chosen"}
    rungs = list(names.items())
    caption = (
        "Residual vectors, measured minus predicted, each picture at the magnification written above it. Arrows that agree "
        "with their neighbours are a systematic error; the chosen model should leave none that do. Outliers are left out."
    )
    remainder = [record.nothing_else.sentence, describe_predictable(record)]
    draw = partial(space.draw_vectors, details, rungs)
    return [
        make_heading("Residuals in the workspace"),
        source.add_figure("vectors", draw, caption, _vector_words(record, rungs)),
        make_heading("What else was looked for", 2),
        make_text(" ".join(remainder).strip()),
    ]


def _vector_words(record: StudyRecord, rungs: Sequence[tuple[int, str]]) -> str:
    """Return the picture of the residual vectors for those who cannot see it."""
    models = [
        f"the {name} model (mean {format_mm(record.ladder[rung].estimation.mean_mm)} mm on estimation configurations)"
        for rung, name in rungs
    ]
    return f"Three-dimensional residual vectors of {', '.join(models)}."


def write_held_out_page(source: Source) -> list[Block]:
    """Write the distribution of the errors per rung."""
    record = source.record
    if not ladder.select_rows(source.details).any():
        return []
    draw = partial(ladder.draw_error_distribution, record, source.details)
    side = record.side.replace("_", "-")
    title = "Held-out errors" if side == "held-out" else "Errors (nothing is held out)"
    caption = (
        f"Share of {side} configurations whose error stays below a length. The further left and the steeper, the better; a "
        "curve that crosses another is worse for some configurations."
    )
    models = len(ladder.select_way(record))
    if models > ladder.MAX_CURVES:
        caption += f" {ladder.MAX_CURVES} of the ladder's {models} models, called as there."
    first, last = record.ladder[0], record.ladder[-1]
    measured = "held_out" if last.held_out.p95_mm is not None else "estimation"
    before, after = (format_mm(rung.side(measured).p95_mm) for rung in (first, last))
    words = (
        f"Distribution of {side} errors per model: 95 % stay below {before} mm with the nominal and below {after} mm with the "
        "chosen model."
    )
    heading = make_heading(title, opens=False)
    figure = source.add_figure("held-out", draw, caption, words)
    return [heading, figure]


# -- correlation
# ------------------------------------------------------------------------------------------------------------------


def write_correlation_page(source: Source) -> list[Block]:
    """Write which parameters the data know only together."""
    correlation = source.record.correlation
    count, drawn = len(correlation.symbols), parameter_plots.MAX_MATRIX
    if count < 2:
        return []
    clusters = [cluster for cluster in correlation.clusters if len(cluster) > 1]
    caption = (
        "Correlation of the estimates, clusters together. Filled: positive; open ring: negative; the larger, the stronger. "
        "Parameters of one cluster are known together better than apart."
    )
    if count > drawn:
        caption += f" {drawn} of {count} parameters are drawn, the clusters first."
    words = f"Correlation matrix of {count} parameters in {len(clusters)} clusters."
    draw = partial(parameter_plots.draw_correlation, correlation)
    blocks = [make_heading("Correlation"), source.add_figure("correlation", draw, caption, words)]
    if correlation.pairs:
        blocks.append(make_list([pair.sentence for pair in correlation.pairs[:MAX_PAIRS]]))
    return blocks


# -- posterior
# --------------------------------------------------------------------------------------------------------------------


def write_posterior_page(source: Source) -> list[Block]:
    """Write the draws of the informative few, and what the sampler says of itself."""
    sampling = source.record.sampling
    if sampling is None:
        return []
    blocks = [make_heading("Posterior")]
    blocks += [make_text(sentence) for sentence in write_sampling_sentences(source.record)]
    if sampling.converged:
        blocks += _write_draws(source, sampling)
    return [*blocks, *_write_quantiles(sampling.quantiles)]


def _write_draws(source: Source, sampling: SamplingRecord) -> list[Block]:
    """Write the picture of the draws; nothing where there are none."""
    trace = sampling.trace
    if not trace.names or not trace.draws:
        return []
    units = {one.name: one.unit for one in sampling.quantiles}
    caption = (
        "Draws from the posterior of the informative few, in the parameters' own units. A narrow slanting cloud: two "
        "parameters that the data know only together."
    )
    names = ", ".join(trace.names[: parameter_plots.MAX_DRAWN])
    draw = partial(parameter_plots.draw_posterior, trace, units)
    words = f"Pairwise posterior draws of {names}."
    return [source.add_figure("posterior", draw, caption, words)]


QUANTILE_COLUMNS = (
    ("parameter", "left"),
    ("2.5 %", "right"),
    ("median", "right"),
    ("97.5 %", "right"),
    ("2.5 %, closed form", "right"),
    ("97.5 %, closed form", "right"),
    ("unit", "left"),
)


def _write_quantiles(quantiles: Sequence[QuantilesRecord]) -> list[Block]:
    """Write the table of quantiles; nothing where there are none."""
    if not quantiles:
        return []
    rows = [[one.name, *_format_quantiles(one)] for one in quantiles[:MAX_QUANTILES]]
    caption = "Sampled as described above; the closed form is that of least squares."
    return [make_table(QUANTILE_COLUMNS, rows, caption, [0.0] * len(QUANTILE_COLUMNS))]


def _format_quantiles(one: QuantilesRecord) -> list[str]:
    """Return the five quantiles of a parameter in one unit, to the place that three digits of the widest give; then
    the unit."""
    values = [one.low, one.median, one.high, one.closed_form_low, one.closed_form_high]
    largest = max((abs(value) for value in values if value is not None), default=0.0)
    factor, unit = choose_prefix(largest, one.unit)
    exponent = int(f"{largest / factor:.2e}".partition("e")[2])
    decimals = max(2 - exponent, 0)
    figures = ["–" if value is None else f"{value / factor:.{decimals}f}" for value in values]
    return [*figures, unit]
