"""A study on a terminal: the verdict first, on one screen, within 80 columns; everything with
--verbose, the verdict alone with --quiet."""

from __future__ import annotations

import copy
import io
import json
import shutil
from pathlib import Path

from click.testing import CliRunner
from report_studies import read_source, source_of, written

from modelsel.cli.main import run_command_line
from modelsel.fitting.undetermined import write_unidentifiable
from modelsel.report.document import Source
from modelsel.report.terminal import WIDTH, Amount, show_study
from modelsel.report.terminal_fleet import write_fleet
from modelsel.report.terminal_summary import _describe_standing
from modelsel.report.text_tables import Row, Span, write_numbered_tables, write_table
from modelsel.results.numbers.quantities import format_figure
from modelsel.results.schemas.finding_schema import BEYOND_WORDS
from modelsel.results.sentences.small_findings import choose_shown, find_named
from modelsel.results.sentences.study_sentences import describe_name_probability, format_mm

SCREEN = 40


def shown(source: Source, amount: Amount, width: int = WIDTH) -> list[str]:
    """The lines that a study prints."""
    from rich.console import Console

    stream = io.StringIO()
    show_study(source.record, source.details, Console(file=stream, width=width), amount)
    return stream.getvalue().splitlines()


def crowded(folder: Path) -> Source:
    """The PUMA study with its findings three times, so that a screen cannot hold them."""
    result, details = written(folder)
    result["findings"] *= 3
    details["findings"] *= 3
    return source_of(result, details)


def folded(lines: list[str]) -> str:
    return " ".join(" ".join(lines).split())


def test_verdict_comes_first_on_one_screen(drawn) -> None:
    source = source_of(*written(drawn))
    lines = shown(source, Amount.SUMMARY)
    assert len(lines) < SCREEN - 2  # the command adds the files that it has written
    assert max(map(len, lines)) <= WIDTH
    text = folded(lines)
    places = [text.index(folded([one])) for one in source.record.verdict]
    findings = zip(source.record.findings, source.details.findings, strict=True)
    by_size = sorted(findings, key=lambda pair: -pair[0].worst.mm)
    places += [text.index(drawn.what) for _, drawn in by_size]
    assert places == sorted(places)
    assert [drawn for _, drawn in by_size] == source.details.findings
    assert len({pair[0].worst.mm for pair in by_size}) > 1


def test_unproven_finding_has_the_probability_of_its_name(drawn) -> None:
    """Where not even the place is proven, what it could be stands in the sentence above, with the
    probabilities; none is told twice."""
    finding = read_source(drawn).record.findings[0]
    claim = finding.claim.model_copy(update={"level": "place", "probability": 0.54})
    unproven = finding.model_copy(update={"claim": claim})
    assert _describe_standing(unproven, "a") == "best described by a"
    proven = claim.model_copy(update={"probability": 0.97})
    partly = finding.model_copy(update={"claim": proven})
    named = describe_name_probability(finding)
    assert _describe_standing(partly, "a") == f"probability 0.97; best described by a ({named})"


def test_rivals_of_one_name_are_told_together(drawn) -> None:
    finding = read_source(drawn).record.findings[0]
    first = finding.credible_set[0].model_copy(update={"probability": 0.2})
    update = {"verdict": "cannot be told apart", "credible_set": [first] * 3, "levels": []}
    several = finding.model_copy(update=update)
    told = _describe_standing(several, first.name)
    assert told.startswith(f"not told apart: {first.name} (0.60)")
    assert told.count(first.name) == 1


def test_where_a_constant_alone_is_open_twins_are_no_rivals(drawn) -> None:
    finding = read_source(drawn).record.findings[1]
    first = finding.first
    steps = []
    for at in (0.4, 0.3):
        screws = [first.screws[0].model_copy(update={"cause": f"(sign(progress-{at})+1)/2"})]
        for name in ("fault:tracker-bumped", "tracker-step"):
            change = {"mechanism": name, "probability": 0.24, "screws": screws}
            steps.append(first.model_copy(update=change))
    change = {"verdict": "cannot be told apart", "claim": None, "doubtful": False}
    step = finding.model_copy(update=change | {"credible_set": steps})
    told = _describe_standing(step, "fault:tracker-bumped (3)")
    assert told == "fault:tracker-bumped (3), the constant is open (--verbose lists its values)"
    rival = step.model_copy(update={"credible_set": [*steps, first]})
    assert _describe_standing(rival, "a").startswith("not told apart: ")


def test_more_findings_than_a_screen_holds_are_counted(drawn) -> None:
    source = crowded(drawn)
    lines = shown(source, Amount.SUMMARY)
    assert len(lines) < SCREEN - 2
    (more,) = [line for line in lines if "more, which --verbose shows" in line]
    told = folded(lines).count("probability") - 1  # the verdict has one
    assert int(more.split()[1]) == len(source.record.findings) - told


def test_quiet_is_the_verdict_alone(drawn) -> None:
    source = source_of(*written(drawn))
    assert folded(shown(source, Amount.VERDICT)) == folded(source.record.verdict)


def test_everything_fits_without_a_broken_word(drawn) -> None:
    """Every mechanism, cause and place of the tables stands there in one piece."""
    source = crowded(drawn)
    lines = shown(source, Amount.EVERYTHING)
    assert max(map(len, lines)) <= WIDTH
    words = set(" ".join(lines).split())
    record = source.record
    assert {name for rung in record.ladder for name in rung.mechanisms if " " not in name} <= words
    assert {one.mechanism for one in record.significance} <= words
    assert {place.split()[1] for place in record.error_map.places} <= words
    assert all(folded([one.sentence]) in folded(lines) for one in record.findings)
    undetermined = write_unidentifiable(record.unidentifiable)
    assert all(folded([sentence]) in folded(lines) for sentence in undetermined)
    assert all(folded([one.sentence]) in folded(lines) for one in record.warnings)


def test_letters_of_the_map_are_explained_by_its_causes(drawn) -> None:
    source = source_of(*written(drawn))
    text = folded(shown(source, Amount.EVERYTHING))
    causes = source.record.error_map.causes
    assert sum(f"{letter} {cause}" in text for letter in "abcdefghijklmn" for cause in causes) >= 14


def test_a_word_wider_than_its_column_has_a_line_of_its_own() -> None:
    rows = [Row("short", ["1.0"]), Row("x" * 30, ["2.0"], remark="odd")]
    lines = write_table("name", ["a long head"], "", rows, 24)
    assert [line.split() for line in lines[-3:]] == [["x" * 30], ["2.0"], ["odd"]]
    assert all(len(line) <= 24 for line in lines if "x" not in line)


def test_lines_of_joined_names_begin_with_the_plus() -> None:
    names = "approach-backlash:3 + encoder-eccentricity:1 + wrist-coupling:5"
    rows = [Row(names, ["1.0"], names)]
    for width in (40, 60, 80):
        lines = write_table("names", ["figure"], "found", rows, width)
        assert folded(lines).count(" + ") == 4
        assert not any(line.rstrip().endswith("+") for line in lines)


def test_a_span_stands_above_its_heads() -> None:
    rows = [Row("model", ["0.896", "2.081", "0.800"])]
    heads = ("mean", "worst", "CV rms")
    lines = write_table("", heads, "", rows, 40, [Span("estimation", 0, 1)])
    assert [line.split() for line in lines[:2]] == [["estimation", "CV"], ["mean", "worst", "rms"]]
    assert lines[0].index("estimation") <= lines[1].index("mean")


def test_ladder_says_which_side_its_errors_are_of(drawn) -> None:
    lines = shown(source_of(*written(drawn)), Amount.EVERYTHING)
    heads = next(k for k, line in enumerate(lines) if line.startswith("model "))
    assert {"estimation", "held-out"} <= set(lines[heads - 1].split())
    assert "blank: not scanned" in folded(lines)


def test_columns_that_do_not_fit_stand_in_a_table_below() -> None:
    readings = {f"q{j}_deg": ["-123.4567", "1.0000"] for j in range(1, 7)}
    sides = {f"approach{j}": ["-1", "1"] for j in range(1, 7)}
    rest = {"temperature_C": ["22.0000", "23.0000"]}
    first, second = write_numbered_tables([readings, sides, rest], 80)
    assert max(map(len, first + second)) <= 80
    assert first[0].split() == list(readings)
    assert second[0].split() == [*sides, *rest]
    assert [line.split()[0] for line in second[1:]] == ["1", "2"]
    narrow = write_numbered_tables([readings, sides, rest], 40)
    assert max(len(line) for table in narrow for line in table) <= 40
    assert sum(len(table[0].split()) for table in narrow) == 13


def test_fleet_cuts_no_name() -> None:
    found = "encoder-eccentricity:1 + approach-backlash:3 + joint-compliance:2"
    errors = {"nominal_mm": 1.967, "base_mm": 0.334, "chosen_mm": 0.042}
    done = {"state": "done", "estimation": 60, "held_out": 1000, "found_as": found, **errors}
    failed = {"state": "failed", "name": "broken", "why": "no such column"}
    lines = write_fleet([{"name": "Zelle 7 nach dem Crash", **done}, failed], 80)
    assert max(map(len, lines)) <= 80
    assert {"encoder-eccentricity:1", "approach-backlash:3"} <= set(folded(lines).split())
    assert not any(line.strip() == "+" for line in lines)
    assert "broken failed: no such column" in lines


def ran(folder: Path, *words: str, status: int = 0) -> str:
    done = CliRunner().invoke(run_command_line, ["report", str(folder), *words])
    assert done.exit_code == status, done.output
    return done.stdout if status == 0 else done.output


def test_report_shows_what_study_did(drawn, tmp_path) -> None:
    folder = Path(shutil.copytree(drawn, tmp_path / "study"))
    verdict = folded(json.loads((folder / "result.json").read_text())["verdict"])
    for words in ((), ("--verbose",), ("-v",)):
        text = ran(folder, "--pages", "first", *words)
        assert verdict in folded([text])
        assert ("Ladder:" in text) == bool(words)
        assert "report-pages.pdf" in folded([text])
    assert folded([ran(folder, "--pages", "first", "--quiet")]) == verdict
    assert "give one of them" in ran(folder, "-v", "-q", status=2)


def test_errors_in_full_say_which_configurations_they_are_of(drawn) -> None:
    """The verdict beside them has those of the other configurations."""
    source = read_source(drawn)
    text = folded(shown(source, Amount.EVERYTHING))
    first, last = source.record.ladder[0].estimation, source.record.ladder[-1].estimation
    said = f"Estimation configurations: {format_mm(first.mean_mm)} mm mean and"
    assert f"{said} {format_mm(first.max_mm)} mm at worst with the nominal model, " in text
    assert f"{format_mm(last.mean_mm)} mm mean with the chosen one (" in text


def named_last(folder: Path) -> Source:
    """Twelve findings with names of their own, of which the verdict names the last; the second's
    largest figure is of joint readings that were not measured."""
    result, details = written(folder)
    result["findings"] = [*result["findings"], *copy.deepcopy(result["findings"])]
    details["findings"] = [*details["findings"], *copy.deepcopy(details["findings"])]
    for number, one in enumerate(details["findings"]):
        one["label"] = f"letter-{'abcdefghijkl'[number]}"
    result["findings"][1]["worst"]["unmeasured_joints"] = [1, 4]
    result["verdict"] = ["One error was named: letter-l."] * 9
    return source_of(result, details)


def test_what_the_verdict_names_is_never_left_out(drawn) -> None:
    """The others are told in short before they are counted."""
    lines = shown(named_last(drawn), Amount.SUMMARY)
    (last,) = [line for line in lines if "letter-l," in line]
    assert "letter-l, probability" in last
    assert any("letter-b, probability" in line for line in lines)
    assert len(lines) < SCREEN - 2
    narrow = shown(named_last(drawn), Amount.SUMMARY, 40)
    assert any("letter-l" in line for line in narrow[20:])
    assert any("more, which --verbose shows" in line for line in narrow)


def test_a_figure_beyond_the_measured_readings_is_marked(drawn) -> None:
    source = named_last(drawn)
    lines = shown(source, Amount.SUMMARY)
    size = format_figure(source.record.findings[1].worst.mm)
    (marked,) = [line for line in lines if f"{size}*" in line]
    below = lines[lines.index(marked) + 1]
    assert "letter-b" in marked + below
    assert sum(BEYOND_WORDS in line for line in lines) == 1
    plain_lines = shown(source_of(*written(drawn)), Amount.SUMMARY)
    assert not any(BEYOND_WORDS in line for line in plain_lines)


def test_a_table_has_what_the_verdict_names() -> None:
    labels = ["a", "b", "a", "c"]
    assert find_named(["Named: a and c."], labels) == {0, 3}
    # a name within another one is not named
    parts = ["backlash:1", "approach-backlash:1", "backlash:12"]
    assert find_named(["Named: approach-backlash:1 and backlash:12."], parts) == {1, 2}
    assert choose_shown([0, 1, 2, 3], {0, 3}, 3) == [0, 1, 3]
    assert choose_shown([0, 1, 3], {1, 3}, 1) == [1, 3]


def test_the_map_is_no_wider_than_the_terminal(drawn) -> None:
    source = source_of(*written(drawn))
    for width in (40, 60):
        lines = shown(source, Amount.EVERYTHING, width)
        (head,) = [k for k, line in enumerate(lines) if line.startswith("frame  ")]
        assert all(len(line) <= width for line in lines[head : head + 30])
        assert len(lines[head].split()) == 1 + min((width - 6) // 4, 14)
