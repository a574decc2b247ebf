"""What a person reads: values with their errors, what would tell entries apart, tables of what is
there."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from report_studies import read_source

from modelsel._short_numbers import round_numbers
from modelsel.calibration.commands.compensation import Commands
from modelsel.cli.compensate import _sentence
from modelsel.cli.main import run_command_line
from modelsel.diagnosis.findings.fitted_curves import find_waves, measure_heights
from modelsel.diagnosis.findings.sentences import describe_amount, format_angle, format_quantity
from modelsel.diagnosis.findings.stated_probability import bound_chance, format_chance, write_chance
from modelsel.mechanisms.causes import Bump
from modelsel.mechanisms.terms import Screw, Term
from modelsel.report.figures.finding import panel_height
from modelsel.report.pages.calibrated import _write_mechanisms
from modelsel.report.pages.findings import advise_separation
from modelsel.report.pages.parameter_uncertainty import _format_quantiles
from modelsel.results.schemas.finding_schema import EntryRecord, ScrewRecord
from modelsel.results.schemas.model_schema import QuantilesRecord, SignificanceRecord
from modelsel.results.sentences.study_sentences import describe_probability
from modelsel.results.sentences.tables import label_models
from modelsel.robot.files import load_robot


@pytest.mark.parametrize(
    ("value", "error", "unit", "said"),
    [
        (-1.432e-3, 1.3e-5, "rad", "-1.432 ± 0.013 mrad"),
        (1.0e-3, 3.44e-5, "rad", "1.000 ± 0.034 mrad"),
        (-169e-6, 25e-6, "rad", "-0.169 ± 0.025 mrad"),
        (0.0249, 0.0177, "mm", "0.025 ± 0.018 mm"),
        (727e-9, 31e-6, "rad", "1 ± 31 µrad"),
        (-2e-7, 2.2e-5, "rad/rad", "0 ± 22 µrad/rad"),
        (1.0, 0.0996, "mm", "1.00 ± 0.10 mm"),
        (1.2e-5, 1.1e-6, "1/K", "12.0 ± 1.1 ppm/K"),
        (2e-3, None, "rad", "2.00 mrad"),
        (1e-4, None, "rad/rad", "0.100 mrad/rad"),
        (0.0, None, "mm", "0 mm"),
        (0.25, None, "1", "0.250"),
    ],
)
def test_a_value_ends_where_its_two_digit_error_does(
    value: float, error: float | None, unit: str, said: str
) -> None:
    """GUM 7.2.6."""
    assert format_quantity(value, error, unit) == said


def test_a_range_that_moves_nothing_is_not_said() -> None:
    bumps = [Bump("progress", centre, 0.5) for centre in np.arange(-0.5, 2.0, 0.5)]
    terms = [
        Term(f"v{axis}{k}", (Screw(1, axis, bump),))
        for axis in ("tx", "rx")
        for k, bump in enumerate(bumps)
    ]
    # a single spline is two thirds of its coefficient high
    one = np.array([0.0, 0.0, 1.5, 0.0, 0.0])
    shifts, nothing, turns = 0.0739 * one, 5e-12 * one, 4e-5 * one
    error = np.ones(10)
    said = describe_amount(terms, np.concatenate([shifts, nothing]), error)
    assert said == "peak to peak 0.0739 mm"
    said = describe_amount(terms, np.concatenate([shifts, turns]), error)
    assert said == "peak to peak 0.0739 mm and 40.0 µrad"


def test_the_range_of_a_curve_is_that_of_its_values() -> None:
    """Coefficients of splines lie farther apart than the curve that they draw."""
    width = 0.5
    bumps = [Bump("q2", centre, width) for centre in np.arange(-3.0, 3.1, width)]
    terms = [Term(f"f{k}", (Screw(2, "rz", bump),)) for k, bump in enumerate(bumps)]
    coefficients = 1e-3 * (-1.0) ** np.arange(len(bumps))
    # alternating coefficients draw a third of their range (de Boor: 4/6 - 2/6 at the knots)
    height = measure_heights(terms, coefficients)["rad"]
    grid = np.linspace(-2.0, 2.0, 2001)
    curve = sum(c * b.shape(grid) for c, b in zip(coefficients, bumps, strict=True))
    assert np.ptp(curve) == pytest.approx(2e-3 / 3, rel=1e-3)
    # and at an end, without a neighbour, half of a coefficient
    assert height == pytest.approx(1e-3 * (1 / 2 + 1 / 3), rel=1e-3)


def test_a_slide_has_no_waves_a_turn() -> None:
    bumps = [Bump("q1", centre, 50.0) for centre in np.arange(0.0, 801.0, 50.0)]
    terms = [Term(f"f{k}", (Screw(1, "ry", bump),)) for k, bump in enumerate(bumps)]
    values = 1e-3 * np.sin(np.arange(len(bumps)))
    assert find_waves(terms, values) == []
    turning = [
        replace(t, screws=(replace(t.screws[0], cause=Bump("q1", 0.2 * k, 0.2)),))
        for k, t in enumerate(terms)
    ]
    assert find_waves(turning, values)


@pytest.mark.parametrize("bow", [0.0, 3.0])
def test_a_curve_that_is_mostly_something_else_has_no_waves(bow) -> None:
    """Waves of a few turns follow a part of any smooth curve."""
    width = 0.1
    centres = np.arange(-1.5, 1.51, width)
    terms = [Term(f"f{k}", (Screw(2, "rz", Bump("q2", c, width)),)) for k, c in enumerate(centres)]
    values = 1e-4 * (np.sin(12 * centres) + bow * centres**2)
    told = describe_amount(terms, values, np.full(len(terms), 1e-7))
    assert ("mostly" in told) == (not bow)
    assert ("in 12 waves a turn" in told) == (not bow)


def test_terms_of_one_kind_share_a_unit() -> None:
    terms = [Term(name, (Screw(2, "rz"),)) for name in ("c2", "m2")]
    told = describe_amount(terms, np.array([3e-5, 1.23e-7]), np.array([1e-6, 1.46e-7]))
    assert told == "c2 = 30.0 ± 1.0 µrad, m2 = 0.12 ± 0.15 µrad"


def test_an_angle_of_many_mrad_is_in_degrees() -> None:
    assert list(map(format_angle, (1.68e-6, 4e-4, 1.0))) == ["1.68 µrad", "0.400 mrad", "57.3°"]


def entry(mechanism: str | None, *screws: tuple[int, str, str], alike: bool = False) -> EntryRecord:
    """One entry of a credible set."""
    listed = [ScrewRecord(frame=frame, axis=axis, cause=cause) for frame, axis, cause in screws]
    return EntryRecord(mechanism=mechanism, probability=0.3, alike=alike, screws=listed)


def test_nothing_is_promised_where_rivals_move_the_target_alike() -> None:
    """sin(2 (q2 + pi / 2)) is -sin(2 q2): no configuration changes them independently."""
    own = entry("encoder-eccentricity:2", (2, "rz", "sin(2*q2)"), (2, "rz", "cos(2*q2)"))
    twice = (2, "rz", "sin(2*(q2+1.570796327))")
    once = (2, "rz", "sin(q2+1.570796327)")
    (told,) = advise_separation([own, entry("counterbalance", once, twice, alike=True)])
    assert told == (
        "encoder-eccentricity:2 and counterbalance move the target in the same way wherever it was "
        "measured: either corrects the error there. modelsel plan says whether other configurations "
        "would tell them apart."
    )
    warm = entry("thermal-zero", (2, "rz", "temperature_C"), alike=True)
    (told,) = advise_separation([own, warm])
    assert told.endswith("configurations are measured again at another time of the campaign.")


def test_what_tells_apart_names_both_and_what_they_differ_in() -> None:
    own = entry("joint-compliance:5", (5, "rz", "torque5"))
    other = entry("joint-compliance:5", (5, "rz", "torque5_6"))
    assert advise_separation([own, other]) == [
        (
            "joint-compliance:5, torque5 and joint-compliance:5, torque5_6 have different causes (torque5 against torque5_6): "
            "configurations in which these change independently of each other tell them apart."
        )
    ]
    cell, wave = (
        entry(None, (2, "tx", "cos(q2)")),
        entry(None, (1, "tz", "sin(q2)"), (1, "tz", "cos(q2)")),
    )
    assert "(cos(q2) against sin(q2) & cos(q2))" in advise_separation([cell, wave])[0]
    step = (1, "tx", "sign(progress-0.05)")
    bumped, moved = entry("fault:tracker-bumped", step), entry("tracker-step", step)
    assert advise_separation([bumped, moved]) == [
        (
            "fault:tracker-bumped and tracker-step are two names of one displacement: no measurement tells them apart, either "
            "corrects the error."
        )
    ]
    elsewhere = advise_separation([cell, entry(None, (7, "ty", "cos(q2)"))])
    assert "the same cause at frame 2 tx and frame 7 ty: a second target" in elsewhere[0]


def test_a_parameters_quantiles_have_one_unit() -> None:
    found = {
        "unit": "rad",
        "low": -60.9e-6,
        "median": 727e-9,
        "high": 63.5e-6,
        "closed_form_low": -60.5e-6,
        "closed_form_median": 0.0,
        "closed_form_high": None,
    }
    assert _format_quantiles(QuantilesRecord(name="p", **found)) == [
        "−60.9",
        "0.7",
        "63.5",
        "−60.5",
        "–",
        "µrad",
    ]
    same = dict.fromkeys(found, 0.019) | {"unit": "1"}
    assert _format_quantiles(QuantilesRecord(name="p", **same)) == ["0.0190"] * 5 + [""]


def test_a_column_of_nothing_but_dashes_is_not_shown() -> None:
    one = {
        "mechanism": "geometric",
        "parameters": ["a1"],
        "f": None,
        "cv_rms_mm": None,
        "cv_rms_without_mm": None,
        "mean_mm": 6.0,
        "max_mm": 9.8,
        "p": 0.0,
        "log10_evidence": None,
        "stability": None,
        "held_out_rms_without_mm": 5.6,
        "held_out_rms_mm": 0.07,
        "catalogue": "as expected",
    }
    for known, names in (
        ({}, ["mean mm", "worst mm", "nominal p", "held-out rms mm"]),
        ({"stability": 0.5}, ["mean mm", "worst mm", "nominal p", "held-out rms mm", "stable"]),
    ):
        table = next(
            b
            for b in _write_mechanisms([SignificanceRecord(**one | known)])
            if b["kind"] == "table"
        )
        assert [c["name"] for c in table["columns"]] == ["mechanism", *names]
        assert ("Stable" in table["caption"]) == bool(known)
        assert "take the names as given" in table["caption"]


def test_the_set_up_alone_has_a_name_in_every_table() -> None:
    assert label_models([["nominal"], [], ["geometric"], ["geometric", "backlash:3"]]) == [
        "nominal",
        "set-up alone",
        "geometric",
        "+ backlash:3",
    ]


def test_a_mechanism_that_a_model_has_twice_is_numbered() -> None:
    bumped = "fault:tracker-bumped"
    once, twice = ["geometric", bumped, "backlash:3"], ["geometric", bumped, "backlash:3", bumped]
    assert label_models([["geometric"], once, twice]) == [
        "geometric",
        f"+ {bumped} (1) + backlash:3",
        f"+ {bumped} (2)",
    ]


def test_a_robot_without_masses_says_so() -> None:
    assert load_robot("puma760").joints[0].mass is None
    shown = CliRunner().invoke(run_command_line, ["robots", "puma760"]).output
    assert "mass not known; transform before it [mm]:" in shown
    assert "None" not in shown


def test_the_package_runs_as_a_module() -> None:
    said = subprocess.run(
        [sys.executable, "-m", "modelsel", "--version"], capture_output=True, text=True, check=True
    ).stdout
    assert said.startswith("modelsel")


def test_turns_and_slides_are_bounded_each_in_its_unit() -> None:
    made = Commands(*(np.zeros((2, 3)) for _ in range(3)), *(np.ones(2) for _ in range(4)))
    made.change[:] = [[1e-3, -2e-3, 0.05], [0.0, 0.0, -0.07]]
    for slides, said in ((False, "70.0 mrad."), (True, "2.00 mrad or 70.0 µm.")):
        assert _sentence(made, np.array([False, False, slides])).endswith(
            f"No joint changes by more than {said}"
        )


def test_a_fitted_effect_is_drawn_whole() -> None:
    points = np.linspace(-1.0, 1.0, 101)
    assert panel_height(points, 0.5 * points) == pytest.approx(1.15 * 0.98)
    assert panel_height(points, 2.0 * points) == pytest.approx(2.1)
    assert panel_height(points, 1e6 * points) == pytest.approx(3 * 1.15 * 0.98)
    assert panel_height(points, 1e6 * points, np.inf) == pytest.approx(1.05e6)
    assert panel_height(0 * points, 0 * points) > 0


def test_long_numbers_of_causes_are_rounded_for_people() -> None:
    assert round_numbers("cos(q2-q3-0.1007809991)") == "cos(q2-q3-0.1008)"
    assert round_numbers("sin(2*q4+1.570796327) & q1-20") == "sin(2*q4+1.571) & q1-20"


def test_probability_of_a_name_is_that_of_all_its_entries(drawn) -> None:
    """As the finding's sentence has it."""
    for finding in read_source(drawn).record.findings:
        told = describe_probability(finding).partition(";")[0]
        assert f"probability {told}" in finding.sentence


def test_the_least_p_of_a_simulation_is_a_bound() -> None:
    """(1 + 0) / (B + 1) says that no draw did as well."""
    assert bound_chance(1 / 186) == "at most 0.0054"
    assert bound_chance(3 / 200) == "0.015"
    assert bound_chance(0.5) == "0.5"
    assert bound_chance(2 / 186) == "0.011"
    assert write_chance(1 / 200, [199]) == "p ≤ 0.005"
    assert write_chance(5 / 200, [199]) == "p = 0.025"
    assert write_chance(4e-6) == "p < 0.0001"
    assert format_chance(4e-6) == "below 0.0001"
    assert bound_chance(1e-6) == "below 0.0001"
