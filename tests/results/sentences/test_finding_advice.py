"""What to do about a finding: one of four words, no part, worth what the held-out error falls."""

from __future__ import annotations

import pytest
from report_studies import read_source

from modelsel.mechanisms.registry import BUILTIN, every
from modelsel.results.schemas.finding_schema import EntryRecord, GainRecord
from modelsel.results.sentences import finding_advice
from modelsel.results.sentences.finding_advice import advise, list_frames
from modelsel.robot.files import load_robot

ACTIONS = {"Adjust", "Replace", "Model", "Measure"}


def test_one_line_each_and_its_worth_is_the_fall_of_the_held_out_error(drawn) -> None:
    record = read_source(drawn).record
    assert record.findings
    for finding in record.findings:
        advice = advise(record, finding)
        gain = finding.gain
        assert advice.action in ACTIONS
        assert "\n" not in advice.sentence
        assert "{" not in advice.sentence
        fall = gain.held_out_rms_before_mm - gain.held_out_rms_after_mm
        assert advice.worth.replace("−", "-").startswith(f"{fall:.3f} mm")
        assert f"({gain.interval_mm[0]:.3f} to" in advice.worth.replace("−", "-")


def test_every_mechanism_has_advice_that_names_no_part() -> None:
    """None of the usual causes of any mechanism stands in the advice for it."""
    stems = {name.partition(":")[0] for name in BUILTIN if not name.startswith("fault:")}
    assert stems - {"geometric"} <= set(finding_advice.BY_STEM)
    for mechanism in every(load_robot("puma760")):
        _, how = finding_advice.BY_STEM.get(mechanism.stem, finding_advice._UNNAMED)
        words = set(how.split())
        assert not words & {"gear", "encoder", "bearing", "belt", "shaft", "disk", "bolts"}
        assert not [part for part in mechanism.usual_causes if part in how]


def test_what_is_to_be_modelled_asks_something_of_the_reader() -> None:
    """A verb, or what to model it with; no statement about the model."""
    chosen = [*finding_advice.BY_STEM.values(), *vars(finding_advice).values()]
    pairs = [one for one in chosen if isinstance(one, tuple) and len(one) == 2]
    told = {how for action, how in pairs if action == "Model"}
    assert len(told) > 7
    assert {how.split()[0] for how in told} <= {"correct", "with", "each"}


@pytest.mark.parametrize(
    ("change", "action"),
    [
        ({"doubtful": True}, "Measure"),
        ({"verdict": "cannot be told apart"}, "Measure"),
        ({"mechanism": "fault:swapped"}, "Measure"),
        ({"mechanism": "tracker-drift"}, "Measure"),
        ({"mechanism": "approach-backlash:2"}, "Adjust"),
        ({"mechanism": "gear-ripple:2"}, "Model"),
        ({"mechanism": None}, "Model"),
        ({"mechanism": "somebody's-plug-in:2"}, "Model"),
    ],
)
def test_the_action_follows_what_is_known(drawn, change, action) -> None:
    record = read_source(drawn).record
    finding = record.findings[1]
    if "mechanism" in change:
        first: EntryRecord = finding.first.model_copy(update=change)
        change = {"credible_set": [first]}
    assert advise(record, finding.model_copy(update=change)).action == action


@pytest.mark.parametrize("name", [None, "somebody's-plug-in:2"])
def test_only_what_no_mechanism_describes_is_said_to_have_none(drawn, name) -> None:
    record = read_source(drawn).record
    finding = record.findings[1]
    first = finding.first.model_copy(update={"mechanism": name})
    sentence = advise(record, finding.model_copy(update={"credible_set": [first]})).sentence
    assert "it has no name" not in sentence
    assert ("no registered mechanism describes it" in sentence) == (name is None)
    assert "but have a look at what moves" in sentence


@pytest.mark.parametrize(
    ("driver", "words"),
    [
        ("q1", "over the reading of joint 1; that holds until the joint is taken apart"),
        ("q2", "over the reading of joint 2; that holds until the joint is taken apart"),
        ("move3", "over the last move of joint 3; that holds until the joint is taken apart"),
        ("temperature_C", "over the temperature"),
    ],
)
def test_a_free_function_is_corrected_over_its_driver_whatever_frame_moves(
    drawn, driver, words
) -> None:
    record = read_source(drawn).record
    finding = record.findings[1]
    free = {"cause": f"free({driver})", "frame": 1}
    screws = [finding.first.screws[0].model_copy(update=free)]
    entry = finding.first.model_copy(update={"mechanism": None, "screws": screws})
    advice = advise(record, finding.model_copy(update={"credible_set": [entry]}))
    assert advice.sentence == f"Model: correct it {words}."


@pytest.mark.parametrize("name", ["joint-compliance:2", "payload-deflection:2"])
def test_a_spring_with_the_payload_in_it_is_predicted_from_it(drawn, name: str) -> None:
    record = read_source(drawn).record
    finding = record.findings[1]
    said = []
    for cause in ("torque2", "torque2+payload_kg*torque2_7"):
        screws = [finding.first.screws[0].model_copy(update={"cause": cause})]
        entry = finding.first.model_copy(update={"mechanism": name, "screws": screws})
        said.append(advise(record, finding.model_copy(update={"credible_set": [entry]})).sentence)
    assert said[0].endswith("for other loads, record payload_kg and measure again.")
    assert said[1].endswith("with payload_kg in every plan that is corrected.")


@pytest.mark.parametrize(
    ("name", "rows", "words"),
    [
        ("fault:tracker-bumped", 2, "Measure: the rows that it concerns again"),
        ("fault:tracker-bumped", 30, "Model: each placement as a group of its own"),
        ("fault:tracker-bumped", 58, "Measure: the rows that it concerns again"),
        ("fault:row-order", 30, "Measure: the rows that it concerns again"),
        ("fault:read-too-early", 60, "Measure: again with the arm at rest"),
        ("fault:time-offset", 60, "Measure: again with positions and joint readings of the same"),
    ],
)
def test_a_fault_of_many_rows_is_not_measured_again(drawn, name, rows, words) -> None:
    """Sixty configurations: two placements need four of them each."""
    record = read_source(drawn).record
    counts = {"estimation": 60, "estimation_rows": list(range(60))}
    record = record.model_copy(
        update={"configurations": record.configurations.model_copy(update=counts)}
    )
    finding = record.findings[1]
    entry = finding.first.model_copy(update={"mechanism": name})
    changed = {"credible_set": [entry], "rows": list(range(rows))}
    said = advise(record, finding.model_copy(update=changed)).sentence
    assert said.startswith(words)
    assert ("commanded angles may stand in" in said) == (name == "fault:read-too-early")


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("target-step", "Measure: again with the target fixed; leave it out of the controller."),
        (
            "target-step:ball {2}",
            "Measure: again with target ball {2} fixed; or give it another name in the file from there on.",
        ),
    ],
)
def test_one_target_that_slipped_leaves_the_others(drawn, name: str, sentence: str) -> None:
    record = read_source(drawn).record
    finding = record.findings[1]
    screws = [finding.first.screws[0].model_copy(update={"frame": 7, "axis": "tx"})]
    entry = finding.first.model_copy(update={"mechanism": name, "screws": screws})
    assert advise(record, finding.model_copy(update={"credible_set": [entry]})).sentence == sentence


def test_several_targets_that_slipped_alike_are_all_fixed(drawn) -> None:
    record = read_source(drawn).record
    finding = record.findings[1]
    screw = finding.first.screws[0].model_copy(update={"frame": 7, "axis": "tx"})
    own = {"mechanism": "target-step:A & C", "screws": [screw, screw]}
    entry = finding.first.model_copy(update=own)
    advice = advise(record, finding.model_copy(update={"credible_set": [entry]}))
    assert advice.sentence == (
        "Measure: again with targets A & C fixed; or give them other names in the file from there on."
    )


def test_larger_than_usual_is_inspected(drawn) -> None:
    """What the catalogue finds too large is worth a look; a sign that physics forbids is no play."""
    record = read_source(drawn).record
    finding = record.findings[1]
    name = finding.first.mechanism
    for note, action in (("d4s is larger than usual", "Replace"), ("as expected", "Model")):
        noted = [
            one.model_copy(update={"catalogue": note}) if one.mechanism == name else one
            for one in record.significance
        ]
        assert advise(record.model_copy(update={"significance": noted}), finding).action == action
    contrary = record.findings[-1].model_copy(update={"doubtful": False})
    assert (
        "the other sign"
        in {one.mechanism: one for one in record.significance}[contrary.first.mechanism].catalogue
    )
    assert advise(record, contrary).action == "Model"


def test_a_gain_that_rounds_to_nought_is_no_minus_nought(drawn) -> None:
    record = read_source(drawn).record
    first = record.findings[1]
    changes = ((0.05, 0.0502, "−0.0002"), (0.05, 0.049993, "0.0001"), (0.05, 0.05, "0.000"))
    for before, after, worth in changes:
        gain = first.gain.model_copy(
            update={"held_out_rms_before_mm": before, "held_out_rms_after_mm": after}
        )
        told = advise(record, first.model_copy(update={"gain": gain})).worth
        assert told.partition(" ")[0] == worth


def test_where_the_place_alone_is_proven_rivals_are_told_apart_first(drawn) -> None:
    record = read_source(drawn).record
    finding = record.findings[1]
    claim = finding.claim.model_copy(update={"level": "place", "probability": 0.99})
    advice = advise(record, finding.model_copy(update={"claim": claim}))
    assert advice.action == "Measure"


def test_nothing_held_out_is_worth_a_dash_and_places_are_frames(drawn) -> None:
    record = read_source(drawn).record
    unknown = GainRecord(held_out_rms_before_mm=None, held_out_rms_after_mm=None, interval_mm=None)
    first = record.findings[0]
    assert advise(record, first.model_copy(update={"gain": unknown})).worth == "–"
    assert list_frames(first) == [2, 3]
    base = [screw.model_copy(update={"frame": 1}) for screw in first.first.screws]
    for name in ("tracker-drift", "fault:tracker-bumped"):
        drift = first.first.model_copy(update={"mechanism": name, "screws": base})
        assert list_frames(first.model_copy(update={"credible_set": [drift]})) == [0]


@pytest.mark.parametrize(
    ("frames", "words"),
    [
        ((3,), "before joint 3 is touched"),
        ((3, 2), "before joints 2 and 3 are touched"),
        ((7,), "before the target is touched"),
        ((6, 7), "before joint 6 and the target are touched"),
        ((0,), "before the base is touched"),
    ],
)
def test_the_places_of_a_finding_are_named(drawn, frames, words) -> None:
    record = read_source(drawn).record
    finding = record.findings[0]
    entry = finding.first
    screws = [entry.screws[0].model_copy(update={"frame": frame}) for frame in frames]
    first = entry.model_copy(update={"screws": screws})
    listed = [first, *finding.credible_set[1:]]
    unsure = finding.model_copy(
        update={"credible_set": listed, "verdict": "cannot be told apart", "doubtful": False}
    )
    assert words in advise(record, unsure).sentence
