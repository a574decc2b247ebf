"""The sentences about a study that the terminal, the PDF and the page to explore share, each written once; and the
figures in them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from math import copysign

from ..._short_numbers import round_numbers
from ...diagnosis.candidates.signatures import PROVEN
from ...diagnosis.findings.stated_probability import (
    describe_level_probability,
    find_named_level,
    format_probability,
    scale_listed,
    write_chance,
)
from ...diagnosis.inference.simulation_counts import REST_FLIPS
from ...exceptions import write_percent, write_rounded
from ...measurements.formats.row_places import Where
from ...notices import HOPELESS_FIT, list_alarms
from ..numbers.quantities import ANGLES
from ..schemas.finding_schema import EntryRecord, FindingRecord
from ..schemas.model_schema import RungRecord, WeighedModelRecord
from ..schemas.schema import FeatureRecord, StudyRecord
from .small_findings import split_findings

# what the table of subsets is for, said with it
TABLE_PURPOSE = (
    "The table asks which names predict best together, and may add one by chance; naming asks of each whether chance "
    "would do as well, over all that was scanned. Only naming makes findings, and the two may differ. Weighted CV, which notes go by, counts every cross-validated error in "
    "units of its noise, orientations among them; CV rms is of positions alone, in mm."
)
# the sets of effects that the search has weighed, and what their table is for
SETS_TITLE = "Sets of effects and their probabilities"
SETS_PURPOSE = (
    "Probability among all sets that the search weighed around the findings: one effect more or less, one for another, "
    "two for one, one for two. What a finding claims with 0.9 or more holds in as many of them. Where a likelier set "
    "only adds effects or leaves some out, the findings stand: the stepwise search has tested these steps under more than one null "
    "distribution, not only under independent noise."
)
# what figures that take the names as given do not say
NOMINAL_CAVEAT = "take the names as given: the search is not repeated for them; the p of a finding is that of the whole search."
# p and share from which a smooth function is said to predict what is left
MAX_PREDICTABLE_P = 0.05
MIN_PREDICTABLE_SHARE = 0.01
# the smallest p that drawn signs can tell: below it, p is a bound
SMALLEST_P = 0.001
# mm from which three decimals are more than anyone reads
LARGEST_FINE_MM = 9.9995
SMALLEST_GAIN_MM = 1e-4  # mm; a smaller gain is told as this
FEATURE_POSITIONS = {
    "wire": "its anchor stands",
    "ball-bar": "its sphere stands",
    "same-point": "it stands",
    "plane": "a point of it is",
}


# -- figures
# --------------------------------------------------------------------------------------------------------------------


def format_mm(value: float | None) -> str:
    """Return a length [mm] with three decimals, two from 10 mm on; a dash where undefined."""
    if value is None:
        return "–"
    is_fine = abs(value) < LARGEST_FINE_MM
    return f"{value:.3f}" if is_fine else f"{value:.2f}"


def format_motion(mm: float | None, mrad: float | None) -> str:
    """Return a displacement [mm]; of what moves the target by nothing that three decimals show, how
    far it turns it, with its unit; zero where three decimals show nothing of either."""
    nothing = format_mm(0.0)
    moved = format_mm(mm)
    turned = format_mm(mrad)
    if mrad is None or moved != nothing or turned == nothing:
        return moved
    return f"{write_rounded(mrad)} mrad"


def format_gain(value: float) -> str:
    """Return a change of a length [mm] as `format_mm` does; of one that is smaller a digit more, no less
    than SMALLEST_GAIN_MM, so that its sign is seen."""
    text = format_mm(value)
    if float(text) == 0 != value:
        text = f"{copysign(max(abs(value), SMALLEST_GAIN_MM), value):.4f}"
    return text.replace("-", "−")


def format_p(p: float | None) -> str:
    """Return a nominal p: a bound where drawn signs can tell no smaller one."""
    if p is None:
        return "–"
    if p <= SMALLEST_P:
        return f"{'<' if p < SMALLEST_P else '≤'}{SMALLEST_P}"
    return f"{p:.3f}"


def format_share(share: float | None) -> str:
    """Return a share in percent; a dash where undefined."""
    return "–" if share is None else write_percent(share)


def format_weight(weight: float | None) -> str:
    """Return the probability of a subset; a dash where undefined."""
    if weight is None:
        return "–"
    return "<0.001" if weight < 0.0005 else f"{weight:.3f}"


def describe_sets(models: Sequence[WeighedModelRecord]) -> list[str]:
    """Return what each set of effects has beside that of the findings, or lacks."""
    found = Counter(effect for model in models if model.chosen for effect in model.effects)
    sentences = []
    for model in models:
        own = Counter(model.effects)
        added = (own - found).elements()
        missing = (found - own).elements()
        more = " + ".join(map(round_numbers, added))
        fewer = " + ".join(map(round_numbers, sorted(missing)))
        sentence = "the findings" if found else "none"
        if more and not found:
            sentence = more
        elif more and fewer:
            sentence = f"{more} in place of {fewer}"
        elif more:
            sentence = f"the findings + {more}"
        elif fewer:
            sentence = f"the findings without {fewer}"
        sentences.append(sentence)
    return sentences


def count_rows(rows: Sequence[int]) -> str:
    """Return how many rows, in words: 1 row, 2 rows."""
    return f"{len(rows)} row{'s' * (len(rows) != 1)}"


# -- models
# ---------------------------------------------------------------------------------------------------------------------


def list_errors(rung: RungRecord) -> list[str]:
    """Return mean and worst error [mm] of both sides of the split."""
    estimation, held_out = rung.estimation, rung.held_out
    return [
        format_mm(estimation.mean_mm),
        format_mm(estimation.max_mm),
        format_mm(held_out.mean_mm),
        format_mm(held_out.max_mm),
    ]


def common_mechanisms(models: Sequence[RungRecord]) -> list[str]:
    """Return the mechanisms that all models begin with."""
    common: list[str] = []
    for names in zip(*(model.mechanisms for model in models), strict=False):
        if len(set(names)) > 1:
            break
        common.append(names[0])
    return common


# -- verdict
# --------------------------------------------------------------------------------------------------------------------


def opening_sentences(record: StudyRecord) -> list[str]:
    """Return the sentences that lead a report: what in the set-up or the data looks wrong, then the verdict."""
    return [*alarm_sentences(record), *record.verdict]


def alarm_sentences(record: StudyRecord) -> list[str]:
    """Return what in the set-up or the data looks wrong."""
    return list_alarms(record.warnings)


def hopeless_sentences(record: StudyRecord) -> list[str]:
    """Return what the verdict of a hopeless fit begins with; none of any other."""
    return [warning.sentence for warning in record.warnings if warning.code == HOPELESS_FIT]


def gain_sentence(record: StudyRecord) -> str:
    """Return the verdict's sentence about the position error before and after."""
    return record.verdict[len(hopeless_sentences(record))]


def describe_split(record: StudyRecord) -> str:
    """Return how the configurations are split, without a full stop."""
    counts = record.configurations
    verb = "is" if counts.held_out == 1 else "are"
    return (
        f"{counts.estimation:,} configurations fit the models, {counts.held_out:,} {verb} held out"
    )


# -- findings
# -------------------------------------------------------------------------------------------------------------------


def label_entries(entries: Sequence[EntryRecord]) -> list[str]:
    """Return the names of a credible set; where one stands there more than once, with the cause that tells them
    apart."""
    names = [entry.name for entry in entries]
    return [
        f"{name}, {round_numbers(entry.screws[0].cause)}"
        if names.count(name) > 1 and entry.screws
        else name
        for name, entry in zip(names, entries, strict=True)
    ]


def describe_probability(finding: FindingRecord) -> str:
    """Return how probable the cause of a finding is; where that is not proven, what is and how probable."""
    levels = finding.level_probabilities
    return describe_level_probability(levels) if levels else format_probability(finding.of_name)


def describe_name_probability(finding: FindingRecord) -> str:
    """Return how probable the name of a finding is."""
    levels = finding.level_probabilities
    probability = levels[find_named_level(levels)] if levels else finding.of_name
    return format_probability(probability)


def weigh_listed_record(finding: FindingRecord) -> float:
    """Return by what the probabilities of listed explanations are multiplied where they are told
    beside that of the name."""
    return scale_listed(finding.level_probabilities, finding.of_name)


def write_levels(finding: FindingRecord) -> str:
    """Return the probability of every level of a finding, as a sentence; empty of faults of the data and where
    they were not weighed."""
    if finding.first.is_fault or finding.claim is None:
        return ""
    told = finding.levels[: find_named_level(finding.level_probabilities) + 1]
    levels = ", ".join(f"{one.level} {format_probability(one.probability)}" for one in told)
    rest = ""
    if len(told) < len(finding.levels):
        rest = "; no registered mechanism describes it"
    of = f", of what {finding.fitted_entry.name} says" if finding.likelier else ""
    return f"Probability, level by level{of}: {levels}{rest}."


def describe_doubt(finding: FindingRecord) -> str:
    """Return what follows the verdict of a doubtful finding; nothing where it is not."""
    if not finding.doubtful:
        return ""
    return ", but doubtful" if finding.is_found else ", and doubtful"


def write_finding_line(finding: FindingRecord) -> str:
    """Return a finding in one line of a terminal."""
    if finding.first.is_fault:
        return finding.sentence
    verdict = "Found" if finding.is_found else "Not told apart"
    claim = finding.claim
    if finding.is_found and claim is not None and claim.probability < PROVEN:
        verdict += ", not named"
    verdict += describe_doubt(finding)
    levels = write_levels(finding)
    line = f"{verdict}: {finding.sentence} {levels}"
    return line.rstrip()


def list_figures(finding: FindingRecord) -> list[str]:
    """Return what a finding means in usable numbers, its worst effect, and the most that it turns the target where
    that is told; none of a fault of single rows."""
    worst, turning = finding.worst, finding.told_turning
    # the worst says of its figure where that is, too
    every = finding.usable
    usable = [one for one in every if worst is None or one.value != worst.mm]
    figures: list[str] = []
    previous = ""
    for one in usable:
        if one.unit == "mm" and previous in ANGLES:
            figures[-1] += f", {one.text}"
        else:
            figures.append(one.text)
        previous = one.unit
    if figures and finding.is_name_open:
        figures[0] = f"if it is {finding.fitted_entry.name}: {figures[0]}"
    if turning is not None:
        figures.append(turning.text)
    if worst is not None:
        figures.append(worst.text)
    return figures


def write_figures(finding: FindingRecord) -> str:
    """Return `list_figures` as one sentence; empty where there are none."""
    text = "; ".join(list_figures(finding))
    return f"{text[0].upper()}{text[1:]}." if text else ""


def write_finding_lines(record: StudyRecord) -> list[str]:
    """Return the findings in lines of a terminal: those that matter with their numbers, the others in one line."""
    told, grouped = split_findings(record.findings, record.small_findings)
    lines = []
    for k in told:
        finding = record.findings[k]
        lines.append(write_finding_line(finding))
        figures = write_figures(finding)
        if figures:
            lines.append(f"    {figures}")
    if grouped and record.small_findings is not None:
        lines.append(record.small_findings.sentence)
    return lines


def describe_predictable(record: StudyRecord) -> str:
    """Return whether a smooth function of the configuration would predict what is left; empty where it was not
    asked."""
    predictable = record.nothing_else.predictable
    if predictable is None:
        return ""
    chance = f"({write_chance(predictable.p, [REST_FLIPS])})"
    if has_predictable_rest(record):
        return (
            f"Some smooth function of the configuration would still predict {write_percent(predictable.share)} of what is left "
            f"{chance}: the chosen model does not explain everything."
        )
    return f"No smooth function of the configuration predicts the remaining error {chance}."


def has_predictable_rest(record: StudyRecord) -> bool:
    """Return whether a smooth function of the configuration would predict some of what is left."""
    predictable = record.nothing_else.predictable
    if predictable is None:
        return False
    return predictable.p <= MAX_PREDICTABLE_P and predictable.share > MIN_PREDICTABLE_SHARE


def describe_outliers(record: StudyRecord, where: Where, most: int) -> str:
    """Return which rows were left out; empty where none was. `where`: what the user calls rows."""
    rows = record.outliers
    if not rows:
        return ""
    places = where.listed(rows, most)
    labels = where.label(rows, most)
    if labels:
        places = f"{labels}; {places}"
    return f"Outliers left out: {count_rows(rows)} ({places})."


# -- uncertainty
# ----------------------------------------------------------------------------------------------------------------


def write_sampling_sentences(record: StudyRecord) -> list[str]:
    """Return what was sampled, how the chain went, and whether the closed form says the same; none where nothing was
    sampled."""
    sampling = record.sampling
    if sampling is None:
        return []
    sentences = [sampling.sentence, _describe_chain(record)]
    if sampling.importance is not None:
        sentences.append(sampling.importance.sentence)
    return [sentence for sentence in sentences if sentence]


def _describe_chain(record: StudyRecord) -> str:
    sampling = record.sampling
    assert sampling is not None
    chain = f"{sampling.steps:,} steps of {sampling.walkers} walkers"
    if not sampling.converged:
        return f"{chain}: the chains had not converged when sampling ended; no quantile of theirs is quoted."
    return (
        f"{chain}, autocorrelation time {sampling.tau:.0f}: {sampling.effective_samples:,.0f} effective samples, "
        f"R-hat {sampling.r_hat:.3f}."
    )


# -- set-up
# ---------------------------------------------------------------------------------------------------------------------


def describe_feature(feature: FeatureRecord) -> str:
    """Return where the chosen model has a feature that rows share."""
    position = ", ".join(f"{value:.2f}" for value in feature.position_mm)
    parts = [f"{FEATURE_POSITIONS[feature.kind]} at {position} mm"]
    if feature.normal is not None:
        normal = ", ".join(f"{value:.5f}" for value in feature.normal)
        parts.append(f"square to {normal}")
    if feature.length_mm is not None:
        length = f"{feature.length_mm:.3f} mm"
        is_bar = feature.kind == "ball-bar"
        parts.append(f"{length} long" if is_bar else f"its readings leave out {length}")
    return f"Feature {feature.name} ({feature.kind}): {', '.join(parts)}."
