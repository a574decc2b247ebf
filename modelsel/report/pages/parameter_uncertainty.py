"""What the chosen model leaves and how well its parameters are known."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from ...diagnosis.findings.sentences import choose_prefix
from ...fitting.undetermined import write_unidentifiable
from ...results.schemas.model_schema import QuantilesRecord, SamplingRecord
from ...results.schemas.schema import StudyRecord
from ...results.sentences.parameter_table import number_owners
from ...results.sentences.study_sentences import (
    describe_predictable,
    format_mm,
    write_sampling_sentences,
)
from ..document import (
    Block,
    Source,
    keep_together,
    make_heading,
    make_list,
    make_table,
    make_text,
    put_beside,
)
from ..figures import ladder, parameter_plots
from ..figures.residual_panels import draw_residuals, list_drivers

MAX_PAIRS = 8
MAX_QUANTILES = 24
UNIDENTIFIABLE = (
    "The data determine only combinations of these parameters, or hardly determine them. Where they leave a value open, "
    "its usual size decides, and its standard error says how far; predictions where the target was measured are the same."
)
DRIVERS = (
    "Measured minus predicted, by the chosen model. Means that leave the grey band together, or follow a curve, show an "
    "error that repeats with the quantity below it. report.html has the residuals as vectors in the workspace."
)
CERTAINTY_TITLE = "How well the parameters are known"
# what names of scales of the noise begin with, and what such a scale is
NOISE = "noise"
SCALE_OF_NOISE = (
    " Noise: standard deviation of one coordinate, or a multiple of the noise that the unit names."
)
SCALE_BESIDE_PARTS = (
    " Noise: of one coordinate, without what else does not repeat, so that it may be far below the noise floor, or a "
    "multiple of the noise that the unit names. All parts of what does not repeat grow with it."
)
# units of scales that multiply a noise, in result.json; and what that noise is, by the source of its floor
MULTIPLES = ("of the stated", "of the estimated")
STATED_NOISE = "of the stated noise"
NOISES = {
    "repeats": "of the noise floor",
    "target pairs": "of the noise floor",
    "estimated": "of the assumed noise",
}
DETERMINED = "The data determine every parameter of the chosen model."


# -- residuals
# --------------------------------------------------------------------------------------------------------------------


def write_residuals_page(source: Source) -> list[Block]:
    """Write what the chosen model leaves: how much on held-out configurations, what else was looked for, and the
    residuals against everything that they could still depend on."""
    record = source.record
    words = [record.nothing_else.sentence, describe_predictable(record)]
    told = [make_text(sentence) for sentence in [_describe_errors(record), *words] if sentence]
    figure = _write_distribution(source)
    heading = make_heading("What the chosen model leaves")
    top = [put_beside(told, figure)] if figure else told
    return [heading, *top, *_write_panels(source)]


def _describe_errors(record: StudyRecord) -> str:
    """Return what 95 % of the configurations stay below, before and after, and the worst."""
    first, last = (rung.side(record.side) for rung in (record.ladder[0], record.ladder[-1]))
    where = "held-out configurations" if record.side == "held_out" else "configurations"
    if last.p95_mm is None:
        return ""
    return (
        f"95 % of the {where} stay below {format_mm(first.p95_mm)} mm with the nominal and below {format_mm(last.p95_mm)} mm "
        f"with the chosen model; the worst is at {format_mm(last.max_mm)} mm."
    )


def _write_distribution(source: Source) -> list[Block]:
    """Write the distribution of the errors per rung; nothing where every row is an outlier."""
    record = source.record
    if not ladder.select_rows(source.details).any():
        return []
    draw = partial(ladder.draw_error_distribution, record, source.details)
    side = record.side.replace("_", "-")
    title = "Held-out errors" if side == "held-out" else "Errors (nothing is held out)"
    caption = f"{title}: share of configurations whose error stays below a length. The further left and the steeper, the better."
    models = len(ladder.select_way(record))
    if models > ladder.MAX_CURVES:
        caption += (
            f" {ladder.MAX_CURVES} of the first page's {models} models, by the names used there."
        )
    errors = _describe_errors(record)
    words = f"Distribution of {side} errors per model. {errors}".strip()
    return [source.add_figure("held-out", draw, caption, words)]


def _write_panels(source: Source) -> list[Block]:
    """Write the residuals against joints, order, last move and temperature; nothing where none of them changes."""
    details = source.details
    drivers = list_drivers(details)
    if not drivers:
        return []
    caption = "Residuals of the chosen model along x, y and z of the instrument's frame; dots: single rows, outliers left out."
    names = ", ".join(driver.name for driver in drivers)
    draw = partial(draw_residuals, details, drivers)
    words = f"Residuals of the chosen model with their means in small panels, against {names}."
    figure = source.add_figure("residuals", draw, caption, words)
    heading = make_heading("Residuals against what may drive them")
    return [keep_together([heading, make_text(DRIVERS), figure])]


# -- what the data determine
# ------------------------------------------------------------------------------------------------------------------


def write_unidentifiable_page(source: Source) -> list[Block]:
    """Write the combinations that no data of this kind determine."""
    groups = source.record.unidentifiable
    heading = make_heading("What the data cannot tell")
    if not groups:
        words = make_text(DETERMINED)
        return [heading, words]
    words = make_text(UNIDENTIFIABLE)
    sentences = write_unidentifiable(groups)
    listed = make_list(sentences) | {"dense": True}
    return [heading, words, listed]


def _write_correlation(source: Source) -> list[Block]:
    """Write the picture of which parameters the data know only together; nothing of fewer than two."""
    correlation = source.record.correlation
    count, drawn = len(correlation.symbols), parameter_plots.MAX_MATRIX
    if count < 2:
        return []
    clusters = [cluster for cluster in correlation.clusters if len(cluster) > 1]
    caption = "Correlation of the estimates, clusters together. Filled: positive; open ring: negative; the larger, the stronger."
    if count > drawn:
        caption += f" {drawn} of {count} parameters are drawn, the clusters first."
    caption += _explain_numbers(parameter_plots.order_symbols(correlation))
    words = f"Correlation matrix of {count} parameters in {len(clusters)} clusters."
    draw = partial(parameter_plots.draw_correlation, correlation)
    return [source.add_figure("correlation", draw, caption, words)]


# -- posterior
# --------------------------------------------------------------------------------------------------------------------


def write_posterior_page(source: Source) -> list[Block]:
    """Write how well the parameters are known: correlation, what the sampler says of itself, draws of the
    informative few and their quantiles."""
    sampling = source.record.sampling
    words = write_certainty(source.record)
    correlation = _write_correlation(source)
    draws = _write_draws(source, sampling) if sampling is not None and sampling.converged else []
    table = [] if sampling is None else _write_quantiles(sampling.quantiles, source.record)
    heading = make_heading(CERTAINTY_TITLE)
    if correlation and draws:
        whole = keep_together([heading, *words, put_beside(correlation, draws)])
        return [whole, *table]
    if correlation:
        return [heading, put_beside(words, correlation), *table]
    blocks = [*words, *draws, *table]
    return [heading, *blocks] if blocks else []


def write_certainty(record: StudyRecord) -> list[Block]:
    """Write what the sampler says of itself, and which parameters the data know only together."""
    pairs = [pair.sentence for pair in record.correlation.pairs[:MAX_PAIRS]]
    words = [make_text(sentence) for sentence in write_sampling_sentences(record)]
    return [*words, make_list(pairs)] if pairs else words


def _write_draws(source: Source, sampling: SamplingRecord) -> list[Block]:
    """Write the picture of the draws; nothing where there are none."""
    trace = sampling.trace
    if not trace.names or not trace.draws:
        return []
    quantiles = name_units(sampling.quantiles, source.record)
    units = {one.name: _choose_unit(one) for one in quantiles}
    caption = (
        "Draws from the posterior of the informative few. A narrow slanting cloud: two "
        "parameters that the data know only together."
    )
    drawn = trace.names[: parameter_plots.MAX_DRAWN]
    caption += _explain_numbers(drawn)
    names = ", ".join(drawn)
    draw = partial(parameter_plots.draw_posterior, trace, units)
    words = f"Pairwise posterior draws of {names}."
    return [source.add_figure("posterior", draw, caption, words)]


def _explain_numbers(symbols: Sequence[str]) -> str:
    """Return of which mechanisms the numbered symbols are; nothing where none is numbered."""
    _, owners = number_owners(symbols)
    listed = [f"({number}) {owner}" for number, owner in enumerate(owners, 1)]
    return f" Numbers in brackets: {'; '.join(listed)}." if listed else ""


QUANTILE_COLUMNS = (
    ("parameter", "left"),
    ("2.5 %", "right"),
    ("median", "right"),
    ("97.5 %", "right"),
    ("2.5 %, closed form", "right"),
    ("97.5 %, closed form", "right"),
    ("unit", "left"),
)


def _write_quantiles(quantiles: Sequence[QuantilesRecord], record: StudyRecord) -> list[Block]:
    """Write the table of quantiles; nothing where there are none."""
    named = name_units(quantiles, record)
    rows = tabulate_quantiles(named)
    if not rows:
        return []
    caption = caption_quantiles(quantiles, record)
    table = make_table(QUANTILE_COLUMNS, rows, caption, [0.0] * len(QUANTILE_COLUMNS))
    return [table | {"dense": True}]


def name_units(quantiles: Sequence[QuantilesRecord], record: StudyRecord) -> list[QuantilesRecord]:
    """Return the quantiles, those of multiples of a noise with what it is."""
    named = []
    for one in quantiles:
        unit = one.unit
        if unit in MULTIPLES:
            source = record.noise_floor.source
            unit = NOISES.get(source, STATED_NOISE)
        named.append(one.model_copy(update={"unit": unit}))
    return named


def tabulate_quantiles(quantiles: Sequence[QuantilesRecord]) -> list[list[str]]:
    """Return the rows of the table of quantiles: the name, five figures and their unit."""
    return [[one.name, *_format_quantiles(one)] for one in quantiles[:MAX_QUANTILES]]


def caption_quantiles(quantiles: Sequence[QuantilesRecord], record: StudyRecord) -> str:
    """Return the caption of the table of quantiles."""
    caption = "Sampled as described above; the closed form is that of least squares."
    if any(one.name.startswith(NOISE) for one in quantiles):
        caption += SCALE_BESIDE_PARTS if len(record.repeatability) > 1 else SCALE_OF_NOISE
    return caption


def _measure_largest(one: QuantilesRecord) -> float:
    """Return the size of the largest of a parameter's quantiles."""
    values = [one.low, one.median, one.high, one.closed_form_low, one.closed_form_high]
    return max((abs(value) for value in values if value is not None), default=0.0)


def _choose_unit(one: QuantilesRecord) -> tuple[float, str]:
    """Return what a parameter's values are divided by, in the table as in the picture, and the unit then."""
    return choose_prefix(_measure_largest(one), one.unit)


def _format_quantiles(one: QuantilesRecord) -> list[str]:
    """Return the five quantiles of a parameter in one unit, to the place that three digits of the widest give; then
    the unit."""
    values = [one.low, one.median, one.high, one.closed_form_low, one.closed_form_high]
    factor, unit = _choose_unit(one)
    exponent = int(f"{_measure_largest(one) / factor:.2e}".partition("e")[2])
    decimals = max(2 - exponent, 0)
    figures = ["–" if value is None else f"{value / factor:.{decimals}f}" for value in values]
    signed = [figure.replace("-", "−") for figure in figures]
    return [*signed, unit]
