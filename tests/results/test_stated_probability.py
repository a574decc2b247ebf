"""One probability of a finding, wherever it is told: that of the deepest level that is proven."""

from __future__ import annotations

import json

import pytest
from report_studies import read_source, written

from modelsel.diagnosis.candidates.signatures import LEVELS, PROVEN
from modelsel.diagnosis.findings.stated_probability import (
    describe_level_probability,
    find_named_level,
    find_stated_level,
    format_chance,
    format_probability,
    scale_listed,
)
from modelsel.report.document import collect_blocks
from modelsel.report.drawing import PAGES
from modelsel.report.html import slim_record
from modelsel.report.terminal_summary import _describe_standing
from modelsel.results.agreement import find_disagreement
from modelsel.results.reading import read_records
from modelsel.results.sentences.finding_advice import advise
from modelsel.results.sentences.study_sentences import (
    describe_probability,
    write_figures,
    write_finding_line,
    write_levels,
)
from modelsel.results.sentences.tables import TABLES


@pytest.mark.parametrize(
    ("levels", "stated", "named", "words"),
    [
        ((1.0, 1.0, 0.96, 0.96), 3, 3, "0.96"),
        ((0.99, 0.989, 0.891, 0.888), 1, 3, "0.99 for the drivers, 0.89 for the cause"),
        ((1.0, 0.71, 0.34, 0.34), 0, 3, "1.00 for the place, 0.34 for the cause"),
        ((0.54, 0.53, 0.53, 0.53), 3, 3, "0.53"),
        ((1.0, 1.0, 0.97, 0.0), 2, 2, "0.97"),
        ((1.0, 0.95, 0.0, 0.0), 1, 1, "0.95"),
        ((0.0, 0.0, 0.0, 0.0), 0, 0, "below 0.01"),
    ],
)
def test_deepest_level_that_is_proven(levels, stated, named, words) -> None:
    assert find_stated_level(levels) == stated
    assert find_named_level(levels) == named
    assert describe_level_probability(levels) == words


@pytest.mark.parametrize(
    ("probability", "words"),
    [(0.8995, "0.899"), (0.89996, "0.899"), (0.9, "0.90"), (0.894, "0.89"), (0.996, "1.00")],
)
def test_a_probability_below_the_threshold_reads_as_below_it(probability, words) -> None:
    assert format_probability(probability) == words
    assert (float(words) >= PROVEN) == (probability >= PROVEN)


@pytest.mark.parametrize(
    ("p", "words"), [(0.0504, "0.0504"), (0.05, "0.05"), (0.0496, "0.05"), (0.12, "0.12")]
)
def test_a_chance_above_the_threshold_reads_as_above_it(p, words) -> None:
    assert format_chance(p) == words


def test_listed_explanations_are_weighed_as_the_name_is() -> None:
    """Of 0.72 among those listed, 0.34 is left once shapes that no list has are weighed."""
    assert scale_listed((1.0, 0.7, 0.34, 0.34), 0.72) == pytest.approx(0.34 / 0.72)
    assert scale_listed((), 0.72) == 1.0
    assert scale_listed((1.0, 1.0, 1.0, 0.99), 0.98) == 1.0
    assert scale_listed((1.0, 1.0, 1.0, 0.99), 0.0) == 1.0


def partly(finding):
    """A finding of which the drivers alone are proven."""
    values = (0.99, 0.989, 0.88, 0.88)
    levels = [
        level.model_copy(update={"probability": p})
        for level, p in zip(finding.levels, values, strict=True)
    ]
    return finding.model_copy(update={"levels": levels, "claim": levels[1]})


def test_all_outputs_tell_the_same_probabilities(drawn) -> None:
    """The cover, the terminal, and the ladder of levels, of a finding whose cause is not proven."""
    source = read_source(drawn)
    whole = source.record.findings[1]
    assert describe_probability(whole) == f"{whole.levels[3].probability:.2f}"
    finding = partly(whole)
    assert describe_probability(finding) == "0.99 for the drivers, 0.88 for the cause"
    assert _describe_standing(finding, "a") == "probability 0.99; best described by a (0.88)"
    ladder = "Probability, level by level: place 0.99, drivers 0.99, shape 0.88, cause 0.88."
    assert write_levels(finding) == ladder
    findings = [*source.record.findings]
    findings[1] = finding
    object.__setattr__(source, "record", source.record.model_copy(update={"findings": findings}))
    blocks = collect_blocks(source, PAGES, ("first", "findings"))
    text = str(blocks)
    assert "0.99 for the drivers, 0.88 for the cause" in text
    assert ladder in text
    name = finding.first.name
    assert f"with its probability: {name} 0.88" in text or len(finding.credible_set) == 1


@pytest.mark.parametrize(
    ("level", "probability", "verdict"),
    [
        ("cause", 0.97, "found"),
        ("shape", 0.95, "found, cause not proven"),
        ("drivers", 0.95, "found, shape not proven"),
        ("place", 0.95, "found, drivers not proven"),
        ("place", 0.4, "found, not named"),
    ],
)
def test_what_hangs_on_a_name_waits_for_it(drawn, level, probability, verdict) -> None:
    """The verdict says what is not proven; numbers and advice of a mechanism say "if"."""
    record = read_source(drawn).record
    whole = next(one for one in record.findings if one.first.name == "encoder-eccentricity:1")
    finding = claiming(whole, level, probability)
    assert finding.told_verdict == verdict
    is_proven = verdict == "found"
    assert finding.is_name_open is not is_proven
    figures = write_figures(finding)
    assert figures.startswith("If it is encoder-eccentricity:1: ") is not is_proven
    assert (advise(record, finding).sentence == advise(record, whole).sentence) is is_proven
    assert write_finding_line(finding).startswith("Found, not named") is (probability < 0.9)


def outweighed(finding, rival: str = "gear-ripple:1"):
    """A finding whose drivers alone are proven, and of which another name is likelier than the
    fitted one."""
    names = (rival, finding.first.mechanism)
    entries = [
        finding.first.model_copy(update={"mechanism": name, "label": name, "probability": p})
        for name, p in zip(names, (0.58, 0.4), strict=True)
    ]
    partly = claiming(finding, "drivers", 0.95)
    levels = [
        one.model_copy(update={"probability": min(one.probability, p)})
        for one, p in zip(partly.levels, (1.0, 1.0, 0.4, 0.4), strict=True)
    ]
    update = {"credible_set": entries, "fitted": 1, "levels": levels}
    return partly.model_copy(update=update)


def test_figures_are_of_the_name_that_they_are_told_with(drawn) -> None:
    """The likeliest explanation leads the list; numbers, levels and model are of the fitted one."""
    record = read_source(drawn).record
    whole = next(one for one in record.findings if one.first.name == "encoder-eccentricity:1")
    finding = outweighed(whole)
    assert finding.first.name == "gear-ripple:1"
    assert write_figures(finding).startswith("If it is encoder-eccentricity:1: ")
    levels = write_levels(finding)
    assert levels.startswith("Probability, level by level, of what encoder-eccentricity:1 says: ")
    assert write_levels(claiming(whole, "drivers", 0.95)).startswith(
        "Probability, level by level: "
    )
    assert finding.of_name == 0.4
    several = record.model_copy(update={"findings": [finding]})
    for name in ("findings", "estimates"):
        table = TABLES[name](several)
        assert set(table["name"]) == {"encoder-eccentricity:1"}
    assert advise(record, finding).action == advise(record, claiming(whole, "shape", 0.95)).action


def test_a_name_that_another_outweighs_does_not_describe_best(drawn) -> None:
    source = read_source(drawn)
    findings = [*source.record.findings]
    place = next(k for k, f in enumerate(findings) if f.first.name == "encoder-eccentricity:1")
    whole = findings[place]
    finding = findings[place] = outweighed(whole)
    assert finding.likelier == ["gear-ripple:1"]
    told = _describe_standing(finding, "a")
    assert told == "probability 0.95; fitted as a (0.40); gear-ripple:1 (0.58) is likelier"
    unproven = finding.claim.model_copy(update={"level": "place", "probability": 0.54})
    unsure = finding.model_copy(update={"claim": unproven})
    assert _describe_standing(unsure, "a") == "fitted as a"
    object.__setattr__(source, "record", source.record.model_copy(update={"findings": findings}))
    text = str(collect_blocks(source, PAGES, ("first", "findings")))
    assert f"Finding {place + 1}: fitted as encoder-eccentricity:1" in text
    assert f"Finding {place + 1}: best described by" not in text
    values = slim_record(source.record)["findings"]
    assert [one["fitted"] for one in values] == [int(k == place) for k in range(len(values))]


def test_the_fitted_explanation_is_one_of_those_listed(drawn) -> None:
    record, details = read_records(drawn)
    assert find_disagreement(record, details) is None
    for number in (-1, len(record.findings[0].credible_set)):
        first = record.findings[0].model_copy(update={"fitted": number})
        spoilt = record.model_copy(update={"findings": [first, *record.findings[1:]]})
        words = find_disagreement(spoilt, details)
        assert words is not None
        assert words.startswith(f"result.json: findings.1.fitted is {number}, and")


@pytest.mark.parametrize("more", ["", " (2)", " with the opposite sign"])
def test_an_earlier_file_has_the_fitted_explanation_by_its_name(drawn, tmp_path, more) -> None:
    result, details = written(drawn)
    finding, drawn_finding = result["findings"][1], details["findings"][1]
    own = finding["credible_set"][0]
    likelier = own | {"mechanism": "encoder-scale:1", "label": "encoder-scale:1"}
    finding["credible_set"] = [likelier, own]
    drawn_finding["label"] = own["mechanism"] + more
    del finding["fitted"]
    for name, values in (("result", result), ("details", details)):
        (tmp_path / f"{name}.json").write_text(json.dumps(values), encoding="utf-8")
    record, _ = read_records(tmp_path)
    assert [one.fitted for one in record.findings] == [0, 1] + [0] * (len(record.findings) - 2)


def claiming(finding, level: str, probability: float):
    """A finding that claims a level, and no deeper one."""
    depth = LEVELS.index(level)
    deeper = min(probability, 0.5)
    levels = [
        one.model_copy(update={"probability": probability if k <= depth else deeper})
        for k, one in enumerate(finding.levels)
    ]
    return finding.model_copy(update={"levels": levels, "claim": levels[depth]})


def test_a_name_that_says_no_cause_is_open_only_if_its_own_level_is(drawn) -> None:
    """Play with the opposite sign is a step whose shape is proven: its numbers hang on no name."""
    record = read_source(drawn).record
    against = next(one for one in record.findings if one.first.name == "backlash:3")
    assert against.levels[3].probability == 0
    assert not against.is_name_open
    assert "f it is" not in write_figures(against)
    assert against.told_verdict == "found"
