"""Where a result is doubted: what a model leaves beyond the noise floor, findings that held-out
rows speak against, data faults' probabilities, free functions that have no F."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from builders import bind, planted, small_arm, study_of
from scipy.stats import f as fisher
from scipy.stats import kstest, multivariate_t

from modelsel.diagnosis.faults.data_faults import find_misplaced_rows
from modelsel.diagnosis.inference.simulation_counts import FAULT_DRAWS
from modelsel.fitting.design import Model, compute_design
from modelsel.fitting.least_squares import fit
from modelsel.fitting.noise import Floor, from_repeats
from modelsel.fitting.problem import Problem
from modelsel.fitting.shrinkage import fit_shrunk
from modelsel.fitting.whitening import Whitening
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.causes import Bump
from modelsel.mechanisms.registry import mechanism
from modelsel.mechanisms.terms import Mechanism, Screw, Term
from modelsel.results.conclusions.finding_notes import opposed_finding_notes
from modelsel.results.conclusions.goodness_of_fit import (
    LackOfFit,
    lack_of_fit_notes,
    measure_lack_of_fit,
)
from modelsel.results.runs.finding_records import Finding, describe_fault
from modelsel.robot.kinematics import forward
from modelsel.selection.evaluation import Split, evaluate
from modelsel.selection.gain import Gain, OrientationGain
from modelsel.study.preparation.stated_noise import choose_noise_floor
from modelsel.uncertainty.parameters import bootstrap_parameters
from modelsel.uncertainty.significance import assess_significance, compare_nested

ARM, SIGMA = small_arm(), 0.05
BASE = Model((mechanism("geometric", ARM),))
MORE = Model((*BASE.mechanisms, mechanism("joint-compliance:2", ARM)))
TOOLS = np.array([(250.0, -60.0, 90.0), (-90.0, 160.0, 120.0)])


def campaign(
    rng: np.random.Generator, postures: int, times: int = 1, targets: int = 1, shared: float = 0.0
) -> Problem:
    """Geometry alone, SIGMA in every row; `shared` [mm] of every posture besides."""
    own = np.tile(np.repeat(np.arange(postures), targets), times)
    target = np.tile(np.arange(targets), postures * times)
    angles = ARM.draw(rng, postures)[own]
    position = np.array(
        [forward(ARM, a[None], TOOLS[t])[0] for a, t in zip(angles, target, strict=True)]
    )
    visit = np.repeat(np.arange(postures * times), targets)
    at = bind(
        ARM,
        build_measurements(angles, position, target=[f"r{t}" for t in target], configuration=visit),
        TOOLS[:targets],
    )
    noise = rng.normal(0, SIGMA, position.shape) + shared * rng.standard_normal((postures, 3))[own]
    return replace(at, data=replace(at.data, position=at.data.position + noise))


def weighed(at: Problem) -> Split:
    return study_of(replace(at, whitening=Whitening(1 / SIGMA)))


# -- the noise floor
# ------------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_lack_of_fit_is_uniform_where_there_is_none(rng) -> None:
    """Of a stated floor and of repeats; and where the noise is 1.3 times the floor it is said, with
    how much more."""
    stated, repeated = [], []
    for _ in range(60):
        data = weighed(campaign(rng, 30))
        stated.append(
            measure_lack_of_fit(
                evaluate(data, BASE, ("geometric",)), Floor(SIGMA, "stated"), data
            ).p
        )
        data = weighed(campaign(rng, 20, times=3))
        repeated.append(
            measure_lack_of_fit(
                evaluate(data, BASE, ("geometric",)),
                from_repeats(data.problem.data, data.problem.placed),
                data,
            ).p
        )
    for p in (stated, repeated):
        assert kstest(p, "uniform").pvalue > 1e-4
    data = weighed(campaign(rng, 100))
    found = measure_lack_of_fit(
        evaluate(data, BASE, ("geometric",)),
        Floor(SIGMA / 1.3, "stated"),
        study_of(replace(data.problem, whitening=Whitening(1.3 / SIGMA))),
    )
    assert found.f == pytest.approx(1.69, rel=0.25)
    assert found.low_mm < SIGMA * np.sqrt(1 - 1 / 1.69) < found.high_mm
    (note,) = lack_of_fit_notes(found)
    assert note.code == "lack-of-fit"
    assert f"F = {found.f:.3g}" in note.sentence
    for found in (
        LackOfFit(1.2, 1e-9, 0.1, 0.04, 0.0, 0.1),
        LackOfFit(4.0, 0.2, 0.1, 0.2, 0.0, 0.3),
        None,
    ):
        assert lack_of_fit_notes(found) == ()
    (note,) = lack_of_fit_notes(LackOfFit(0.5, 1 - 1e-5, 0.1, 0.0, 0.0, 0.0))
    assert note.code == "lack-of-fit"
    assert "of the floor of 0.100 mm per coordinate it leaves 0.0707 mm" in note.sentence
    for found, stated in (
        (LackOfFit(0.5, 1 - 1e-5, 0.1, 0.0, 0.0, 0.0), False),
        (LackOfFit(0.5, 0.99, 0.1, 0.0, 0.0, 0.0), True),
        (LackOfFit(0.9, 1 - 1e-9, 0.1, 0.0, 0.0, 0.0), True),
    ):
        assert lack_of_fit_notes(found, stated) == ()


def test_lack_of_fit_against_repeats_is_the_textbooks(rng) -> None:
    """F of methods.md A.8, written out with dense matrices; an error that a posture's repeats share
    is lack of fit."""
    at = campaign(rng, 25, times=3, shared=0.08)
    data = weighed(at)
    found = measure_lack_of_fit(
        evaluate(data, BASE, ("geometric",)), from_repeats(at.data, at.placed), data
    )
    fitted = fit(data.training, BASE)
    X, r = compute_design(data.problem.unweighted(), BASE.terms, fitted.at())
    X = X[:, :, list(fitted.found.kept)].reshape(r.size, -1)
    e = r.ravel() - X @ np.linalg.lstsq(X, r.ravel(), rcond=None)[0]
    y = at.data.position.reshape(3, 25, 3)
    pure = np.square(y - y.mean(0)).sum()
    n, m, rank = r.size, 75, np.linalg.matrix_rank(X)
    f = ((e @ e - pure) / (m - rank)) / (pure / (n - m))
    assert found.f == pytest.approx(f, rel=1e-4)
    assert found.p == pytest.approx(fisher.sf(f, m - rank, n - m), rel=1e-2)
    assert found.p < 1e-6
    assert found.low_mm < 0.08 < found.high_mm


def test_what_is_unexplained_beyond_shared_errors_is_in_millimetres(rng) -> None:
    """Of residuals of 0.2 mm, 0.013 mm were said to be unexplained where the floor was 0.003 mm by pairs
    of targets: F counts what the rows share, the figure did not."""
    at = campaign(rng, 60, targets=2)
    stated = Whitening(10 / SIGMA)
    estimated = Whitening(2 / SIGMA, stated=stated)
    data = study_of(replace(at, whitening=estimated))
    found = measure_lack_of_fit(
        evaluate(data, BASE, ("geometric",)), Floor(SIGMA / 10, "pairs", 100.0), data
    )
    assert found.expected_mm == pytest.approx(SIGMA / 2)
    assert found.f == pytest.approx(4, rel=0.3)
    assert found.low_mm < SIGMA * np.sqrt(3 / 4) < found.high_mm
    (note,) = lack_of_fit_notes(found)
    assert "0.0250 mm with what else does not repeat" in note.sentence


def test_no_test_against_what_is_estimated(rng) -> None:
    data = weighed(campaign(rng, 20))
    chosen = evaluate(data, BASE, ("geometric",))
    assert measure_lack_of_fit(chosen, None, data) is None
    assert measure_lack_of_fit(chosen, Floor(SIGMA, "estimated", 10.0), data) is None
    assert (
        measure_lack_of_fit(chosen, Floor(SIGMA, "repeats", 40.0), data) is None
    )  # none of these rows repeats another


# -- findings
# -------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("interval", "said"),
    [((-0.03, -0.01), True), ((-0.03, 0.01), False), ((0.01, 0.02), False), (None, False)],
)
def test_a_finding_that_held_out_rows_speak_against(interval, said, monkeypatch) -> None:
    effect = SimpleNamespace(label="play")
    monkeypatch.setattr(
        "modelsel.results.runs.finding_records.describe_proven",
        lambda _, doubt: f"Joint 2 has play, {doubt}.",
    )
    monkeypatch.setattr(
        "modelsel.results.runs.finding_records.list_usual_causes", lambda _: ("gear", "key")
    )
    is_proven = True
    monkeypatch.setattr("modelsel.results.runs.finding_records.is_settled", lambda _: is_proven)
    finding = Finding(effect, Gain(0.1, 0.12, interval))
    assert finding.doubtful
    doubt = (
        "doubtful"
        if said
        else "doubtful: the held-out error does not fall with it (0.0200 mm rms more)"
    )
    assert finding.sentence.startswith(f"Joint 2 has play, {doubt}.")
    assert finding.sentence.endswith(" Usual causes: gear, key.")
    assert (
        "speak against it: their error grows by 0.0100 mm to 0.0300 mm rms" in finding.sentence
    ) == said
    assert [n.code for n in opposed_finding_notes([finding])] == ["held-out-against"] * said
    is_proven = False
    assert "Usual causes" not in finding.sentence


@pytest.mark.parametrize(
    ("gain", "doubtful"),
    [
        (Gain(0.1, 0.09, (-0.01, 0.03)), False),
        (Gain(0.1, 0.1, (-0.01, 0.01)), True),
        (Gain(0.1, 0.101, None), True),
        (Gain(None, None, None), False),
    ],
)
def test_a_finding_without_a_gain_is_doubtful(gain, doubtful) -> None:
    assert Finding(SimpleNamespace(), gain).doubtful == doubtful


@pytest.mark.parametrize(
    ("mm", "mrad", "doubtful", "against"),
    [
        ((0.1, 0.11, (-0.02, -0.01)), (0.5, 0.3, (0.1, 0.3)), False, ""),
        ((0.1, 0.09, (-0.01, 0.02)), (0.5, 0.6, (-0.2, -0.1)), False, ""),
        ((0.1, 0.11, (-0.02, 0.01)), (0.5, 0.6, (-0.2, 0.1)), True, ""),
        (
            (0.1, 0.11, (-0.02, -0.01)),
            (0.5, 0.6, (-0.2, -0.1)),
            True,
            "their orientation error grows by 0.100 mrad to 0.200 mrad rms with it (95 %)",
        ),
        (
            (0.1, 0.11, (-0.02, -0.01)),
            (0.5, 0.6, (-0.2, 0.1)),
            True,
            "their error grows by 0.0100 mm to 0.0200 mm rms with it (95 %)",
        ),
        ((0.1, 0.11, (-0.02, 0.01)), (None, None, None), True, ""),
    ],
)
def test_a_finding_that_turns_is_doubtful_where_neither_error_falls(
    mm, mrad, doubtful, against
) -> None:
    finding = Finding(SimpleNamespace(), Gain(*mm), OrientationGain(*mrad))
    assert finding.doubtful == doubtful
    assert finding.against == against
    more = "0.0100 mm" if mrad[0] is None else "0.100 mrad"
    said = {
        (False, False): "",
        (True, True): "doubtful",
        (True, False): f"doubtful: the held-out error does not fall with it ({more} rms more)",
    }
    assert finding._doubt == said[doubtful, bool(against)]


def test_free_functions_have_no_f(rng) -> None:
    """They are shrunk: F, its p and a share of halves belong to coefficients that are free."""
    terms = tuple(Term(f"f{k}", (Screw(3, "rz", Bump("q3", 0.8 * k, 0.8)),)) for k in range(-3, 4))
    model = Model((*MORE.mechanisms, Mechanism("free(q3)", terms, "", "", "")))
    data = study_of(planted(campaign(rng, 60), BASE.terms, np.zeros(len(BASE.terms)), rng, SIGMA))
    fitted = fit_shrunk(data.training, model)
    boot = bootstrap_parameters(data, fitted, rng)
    own = [k for k, t in enumerate(fitted.terms) if t in terms and k in fitted.found.kept]
    assert own
    assert compare_nested(fitted, own, boot) == (None, None, None)
    rows = {
        s.mechanism: s
        for s in assess_significance(
            data, fitted, ("geometric", "joint-compliance:2", "free(q3)"), boot, rng
        )
    }
    assert (rows["free(q3)"].f, rows["free(q3)"].p, rows["free(q3)"].stability) == (
        None,
        None,
        None,
    )
    assert rows["free(q3)"].cv_rms_without_mm is not None
    assert None not in (
        rows["joint-compliance:2"].f,
        rows["joint-compliance:2"].p,
        rows["joint-compliance:2"].stability,
    )


# -- data faults
# ----------------------------------------------------------------------------------------------------------------


def test_a_faults_probability_is_a_posterior(rng) -> None:
    """Against densities of scipy, row by row: exchanged or any gross error, as likely before, each
    row as likely as not among them. It is not 1 - p, whose least value the number of draws sets."""
    at = campaign(rng, 20, targets=2)
    fitted = fit(at, BASE)
    position = at.data.position.copy()
    position[[4, 5]] = position[[5, 4]]
    position[30] += (0.0, 25.0, 0.0)
    wrong = replace(at, data=replace(at.data, position=position))
    outlying = np.isin(np.arange(len(at)), [4, 5, 30])
    (fault,) = find_misplaced_rows(wrong, outlying, fitted, rng)
    assert fault.name == "swapped-reflectors"
    assert fault.rows.tolist() == [4, 5]
    residual = fitted.residuals(wrong)
    scale = np.median(np.linalg.norm(residual[~outlying], axis=1)) / 1.5382
    reach = ARM.reach + np.linalg.norm(TOOLS, axis=1).max()
    factor = 0.5  # row 30 is not among them
    for row, other in ((4, 5), (5, 4)):
        there = (
            multivariate_t(np.zeros(3), scale**2 * np.eye(3), 4).pdf(
                position[row] - (position - residual)[other]
            )
            / 2
        )
        anywhere = 1 / (
            4 * np.pi * np.linalg.norm(residual[row]) ** 3 * np.log(reach / (8 * scale))
        )
        factor *= (1 + there / anywhere) / 2
    assert fault.probability == pytest.approx(factor / (1 + factor), rel=1e-9)
    assert 1 - fault.probability < 0.1 / (FAULT_DRAWS + 1)
    assert describe_fault(fault)["credible_set"][0]["probability"] == fault.probability


def test_gross_errors_are_no_exchange(rng) -> None:
    """Rows that are off by as much in directions of their own are no fault with a name."""
    at = campaign(rng, 20, targets=2)
    fitted = fit(at, BASE)
    position = at.data.position.copy()
    size = np.linalg.norm(position[4] - position[5])
    for row in (4, 5, 30, 31):
        way = rng.standard_normal(3)
        position[row] += size * way / np.linalg.norm(way)
    outlying = np.isin(np.arange(len(at)), [4, 5, 30, 31])
    assert (
        find_misplaced_rows(
            replace(at, data=replace(at.data, position=position)), outlying, fitted, rng
        )
        == ()
    )


def test_what_a_model_knows_to_differ_between_repeats_is_no_noise(rng) -> None:
    """Of postures measured without a load and with one, the load's part was told as noise, tenfold."""
    at = campaign(rng, 25, times=3)
    exact = at.data.position
    moved = replace(at.data, position=exact + np.repeat(np.arange(3.0), 25)[:, None])
    data = weighed(replace(at, data=moved))
    raw = from_repeats(moved, at.placed)
    chosen = SimpleNamespace(residual=exact)
    told = choose_noise_floor(data, raw, chosen)
    assert raw.coordinate_mm > 5 * SIGMA
    assert told.source == "repeats"
    assert told.coordinate_mm == pytest.approx(from_repeats(at.data, at.placed).coordinate_mm)
    stated = Floor(0.2, "stated")
    assert choose_noise_floor(data, stated, chosen) == stated


def test_the_pure_error_of_repeats_is_the_same_whatever_floor_is_told(rng) -> None:
    """With the floor that the chosen model leaves, a tenth of the rows' weight, it was told as a tenth."""
    data = weighed(campaign(rng, 25, times=3))
    base = evaluate(data, BASE, ("geometric",))
    floor = from_repeats(data.problem.data, data.problem.placed)
    told = replace(floor, coordinate_mm=floor.coordinate_mm / 10)
    first, second = (measure_lack_of_fit(base, one, data) for one in (floor, told))
    assert first == second
    assert first.floor_mm == pytest.approx(SIGMA, rel=0.2)
