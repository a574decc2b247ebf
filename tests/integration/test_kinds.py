"""Rows that are no points: coordinates, wires, ball-bars, distances, touched points, plates; read,
fitted, named, judged."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from builders import study_with
from gauged import ANCHORS, NOISE, TOOL, Campaign, hold
from hidden_effects import at, one
from report_studies import terminal_lines

from modelsel.calibration.calibration_file import calibration_text
from modelsel.calibration.loading import parse_calibration
from modelsel.calibration.plan_pool import build_pool
from modelsel.calibration.prediction import predict
from modelsel.calibration.validation.validation import judge
from modelsel.config.study_file import Study, parse_study
from modelsel.diagnosis.columns.candidate_columns import stack_design
from modelsel.diagnosis.columns.screw_columns import build_screw_columns
from modelsel.diagnosis.faults.outliers import estimate_scale, find_gross_outliers
from modelsel.diagnosis.procedure import diagnose_split
from modelsel.diagnosis.separation import Inquiry
from modelsel.exceptions import DataError, NotEstimable, StudyError
from modelsel.fitting.batch import Ensemble
from modelsel.fitting.design import Model, compute_design, residuals
from modelsel.fitting.least_squares import fit
from modelsel.fitting.linearisation import Linearisation
from modelsel.fitting.noise import Floor
from modelsel.fitting.observation import Fixtures
from modelsel.fitting.problem import Problem
from modelsel.fitting.undetermined import describe_unidentifiable
from modelsel.measurements.campaign.features import FREE_NUMBERS, KINDS, KindColumns
from modelsel.measurements.known_features import KnownFeature, apply_known_features
from modelsel.measurements.measurements import Measurements, build_measurements
from modelsel.measurements.reader import read_measurements
from modelsel.mechanisms.geometry import build_setup
from modelsel.mechanisms.registry import build_mechanisms, mechanism
from modelsel.mechanisms.terms import FixtureTerm, Screw, Term
from modelsel.results.conclusions.goodness_of_fit import lack_of_fit_notes, measure_lack_of_fit
from modelsel.results.storage import details_text
from modelsel.robot.files import load_robot
from modelsel.selection.cross_validation import fold as fold_scene
from modelsel.selection.cross_validation import fold_by_unit
from modelsel.selection.evaluation import Split
from modelsel.selection.splits import assign_folds
from modelsel.selection.streaming import Parts, list_parts
from modelsel.study.inputs.inputs import read_known_features
from modelsel.study.inspection.inspection import inspect_measurements
from modelsel.study.inspection.inspection_text import format_inspection
from modelsel.study.pipeline.runner import run_study
from modelsel.study.preparation.preparation import prepare
from modelsel.study.simulation import simulate_readings
from modelsel.uncertainty.log_posterior import LogPosterior
from modelsel.uncertainty.nuisance import assign_components

ARM = [False] * 6
PUMA = load_robot("puma760")
COUPLING = one("wrist-coupling", "", at(5, "rz", lambda s: s.q[:, 3]), 1.2e-3)
OFFERED = tuple(
    p
    for name in ("wrist-coupling", "joint-compliance", "encoder-scale", "gear-eccentricity")
    for p in build_mechanisms(name, PUMA)
)


def campaign(seed: int = 7) -> Campaign:
    return Campaign(np.random.default_rng(seed), [COUPLING])


def made(c: Campaign, folder: Path, **known: KnownFeature) -> Measurements:
    return apply_known_features(read_measurements(c.file(folder), ARM), known)


def model(data: Measurements, *names: str, register: bool = False) -> Model:
    features = () if data.gauges is None else data.gauges.features
    placing = build_setup(PUMA, len(data.targets), 1, register, data.rotation is not None, features)
    return Model(
        (
            *((placing,) if placing.terms else ()),
            *(mechanism(name, PUMA) for name in ("geometric", *names)),
        )
    )


INSTRUMENT = {"range_mm": 0.01, "range_ppm": 5, "angle_urad": 5}


def study(estimation: int | None = None, **more: object) -> Study:
    return study_with(TOOL, 3, estimation=estimation, **more)


def prepared(data: Measurements, estimation: int, **more: object) -> Split:
    return prepare(study(estimation, **more), PUMA, data)[0]


# -- each kind
# -----------------------------------------------------------------------------------------------------------------

FILLED: dict[str, Callable[[Campaign], None]] = {
    "axes": lambda c: c.axes(150),
    "wires": lambda c: c.wires(150),
    "wires of unknown zero": lambda c: c.wires(150, dead=12.5),
    "ball-bars": lambda c: c.bars(150, {"b1": 600.0, "b2": 400.0, "b3": 500.0}, given=True),
    "ball-bars of unknown length": lambda c: c.bars(
        150, {"b1": 600.0, "b2": 400.0, "b3": 500.0}, given=False
    ),
    "distances": lambda c: c.distances(150),
    "touched points": lambda c: c.touches(90, 9),
    "plates": lambda c: c.plates(150, 5),
    "wires and points": lambda c: (c.wires(90), c.points(30))[0],
}


TELL = {
    "axes": 27,
    "wires and points": 27,
    "touched points": 20,
    "plates": 20,
    "ball-bars of unknown length": 20,
}  # others: 21


@pytest.mark.parametrize("what", FILLED)
def test_an_effect_is_found_and_held_out_errors_are_noise(what, tmp_path) -> None:
    c = campaign()
    FILLED[what](c)
    known = dict.fromkeys(ANCHORS, KnownFeature(zero=True)) if "zero" in what else {}
    measured = made(c, tmp_path, **known)
    data = prepared(measured, round(0.7 * measured.configurations))
    assert data.problem.data.gauges is not None
    base = fit(
        data.training, model(measured)
    )  # points tell 27 numbers of this arm; six are where the base stands
    assert sum(not base.terms[k].fixture for k in base.representatives) == TELL.get(what, 21)
    assert all(k in base.found.kept for k, t in enumerate(base.terms) if t.fixture)
    data, extension, _ = diagnose_split(data, Inquiry(model(measured), OFFERED, 1, cells=False))
    assert [e.candidate.mechanism.name for e in extension.effects] == ["wrist-coupling:5"]
    (effect,) = extension.effects
    assert effect.estimate[0] == pytest.approx(1.2e-3, abs=4 * effect.standard_error[0])
    left = extension.fit.residuals(data.problem)[~data.estimation]
    count = data.problem.measured[~data.estimation].sum()
    expected = NOISE * np.sqrt(1 + extension.fit.rank / extension.fit.rows)
    assert np.sqrt(np.square(left).sum() / count) == pytest.approx(expected, rel=0.25)
    assert extension.fit.sigma == pytest.approx(1, rel=0.2)  # s_mm is the noise that was put in
    lack = measure_lack_of_fit(SimpleNamespace(fit=extension.fit), Floor(NOISE, "stated"), data)
    assert lack.f == pytest.approx(
        extension.fit.sigma**2
    )  # over the coordinates that rows of a kind have
    assert lack_of_fit_notes(lack) == ()


def every_kind(rng: np.random.Generator) -> tuple[Problem, tuple[Term, ...], np.ndarray]:
    """A row of every kind, eight times over, features and tracker anywhere, and a model with its
    point."""
    kind = list(KINDS) * 8
    shared = [k if k in FREE_NUMBERS else "" for k in kind]
    length = np.where(np.isin(kind, ("wire", "distance")), 1000.0, np.nan)
    data = build_measurements(
        PUMA.draw(rng, len(kind)),
        rng.normal(0, 500, (len(kind), 3)),
        kinds=KindColumns(kind, shared, length),
    )
    count = len(data.gauges.features)
    turned = np.linalg.qr(rng.normal(size=(count + 1, 3, 3)))[0]
    fixtures = Fixtures(rng.normal(0, 1500, (count, 3)), turned[1:], rng.uniform(0, 100, count))
    bound = replace(
        Problem(PUMA, data, np.array([TOOL])),
        fixtures=fixtures,
        placement=(turned[:1], rng.normal(0, 100, (1, 3))),
    )
    terms = model(data, "gravity-twist", "approach-backlash:2").terms
    terms += tuple(
        FixtureTerm(f"{axis} again", feature=k, axis=axis)
        for k, f in enumerate(data.gauges.features)
        for axis in ("length",)
        if f.kind == "wire"
    )
    return (
        bound,
        terms,
        np.array([rng.normal() * (3 if t.unit.startswith("mm") else 1e-2) for t in terms]),
    )


@pytest.mark.parametrize("distances", [True, False])
def test_products_of_the_candidates_columns_for_rows_of_every_kind(rng, distances: bool) -> None:
    """Columns by place and cause against the design written out; a distance has two places."""
    bound, terms, theta = every_kind(rng)
    if not distances:
        bound = bound.take(~bound.observed().of("distance"))
    terms = tuple(term for term in terms if term.screws)
    at = Linearisation(terms, theta[: len(terms)])
    X, r = stack_design(bound, terms, at)
    screws = build_screw_columns(bound, terms, at, 500.0)
    assert screws.rows == len(r) == bound.coordinates
    V = rng.normal(size=(len(r), 5))
    np.testing.assert_allclose(screws.dot(V), X.T @ V, rtol=1e-10, atol=1e-8)
    some = np.arange(0, len(terms), 3)
    np.testing.assert_allclose(screws.expand(some), X[:, some].T, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(screws.gram(some), X[:, some].T @ X[:, some], rtol=1e-10, atol=1e-8)


def test_columns_are_the_derivatives_of_what_rows_read(rng) -> None:
    bound, terms, theta = every_kind(rng)
    X, r = compute_design(bound, terms, Linearisation(terms, theta))
    np.testing.assert_allclose(r, residuals(bound, terms, theta), atol=1e-9)
    for k, term in enumerate(terms):
        h = np.zeros(len(terms))
        h[k] = 1e-2 if term.unit.startswith("mm") else 1e-5
        steps = (residuals(bound, terms, theta - h) - residuals(bound, terms, theta + h)) / (
            2 * h[k]
        )
        np.testing.assert_allclose(
            X[:, :, k], steps, atol=1e-6 * max(np.abs(steps).max(), 1e-3), err_msg=term.symbol
        )
    assert not X[~bound.components_measured].any()
    assert {s.frame for t in terms for s in t.screws} == set(range(1, 8))
    assert any(isinstance(t, FixtureTerm) for t in terms)


def test_many_draws_at_once_and_some_rows_alone_read_the_same(rng) -> None:
    bound, terms, theta = every_kind(rng)
    whole = residuals(bound, terms, theta)
    many = Ensemble(bound, terms).residuals(np.stack([theta, 0.5 * theta]))
    np.testing.assert_allclose(many[0].T, whole, atol=1e-9)
    np.testing.assert_allclose(many[1].T, residuals(bound, terms, 0.5 * theta), atol=1e-9)
    np.testing.assert_allclose(
        residuals(bound.take(np.arange(5, 40)), terms, theta), whole[5:40], atol=1e-9
    )


def test_lengths_are_what_the_words_say(rng) -> None:
    """A residual by hand: readings minus what the target's positions say."""
    bound, _, _ = every_kind(rng)
    gauges, fixtures, r = bound.data.gauges, bound.fixtures, residuals(bound)
    x, place = -residuals(bound.bare), {f.name: k for k, f in enumerate(gauges.features)}
    for kind, sign in (("wire", 1000.0), ("ball-bar", 0.0)):
        k, rows = place[kind], gauges.of(kind)
        away = np.linalg.norm(x[rows] - fixtures.centre[k], axis=1) - fixtures.length[k]
        np.testing.assert_allclose(
            r[rows], np.column_stack([sign - away, 0 * away, 0 * away]), atol=1e-9
        )
    rows, k = gauges.of("plane"), place["plane"]
    np.testing.assert_allclose(
        r[rows, 0], -(x[rows] - fixtures.centre[k]) @ fixtures.axes[k][2], atol=1e-9
    )
    rows = gauges.of("y")
    np.testing.assert_allclose(
        r[rows], np.array([0, 1, 0]) * (bound.data.position[rows] - x[rows]), atol=1e-9
    )
    rows = gauges.of("distance")
    start = -residuals(bound.origin)
    np.testing.assert_allclose(
        r[rows, 0], 1000 - np.linalg.norm(x[rows] - start[rows], axis=1), atol=1e-9
    )


# -- what the data cannot tell
# ---------------------------------------------------------------------------------------------------


def test_without_a_length_one_stays_as_drawn_and_that_is_said(tmp_path) -> None:
    c = campaign()
    c.touches(90, 9)
    measured = made(c, tmp_path)
    data = prepared(measured, 90)
    fitted = fit(data.training, model(measured, "wrist-coupling:5"))
    held = fitted.terms[fitted.found.held]
    assert (held.symbol, fitted.theta[fitted.found.held]) == (
        "a3",
        0.0,
    )  # the longest: 431.8 mm from joint 2 to 3
    assert fitted.sigma == pytest.approx(1, rel=0.2)  # not shrunk to nothing
    said = " ".join(u.sentence for u in describe_unidentifiable(fitted.found, fitted.terms))
    assert "a3 is kept at zero: no row measures a length" in said
    assert "α1, β1 and γ1 are kept at zero: no row is measured in a fixed frame" in said
    assert "x of p0" in said  # nor where the base stands
    assert "a1" in said
    c.distances(6)
    more = made(c, tmp_path)
    assert fit(prepared(more, 96).training, model(more, "wrist-coupling:5")).found.held is None


def test_a_feature_that_no_estimation_row_measures_is_left_out(tmp_path) -> None:
    c = campaign()
    c.points(40)
    c.wires(30)
    measured = made(c, tmp_path)
    labels = np.array(
        ["held-out" if k >= 60 else "estimation" for k in range(70)], dtype=object
    )  # all of w3
    data, _, notes = prepare(study(column="role"), PUMA, measured, labels)
    assert len(data.problem) == 60
    note = next(n for n in notes if n.code == "feature-unseen")
    assert note.sentence.startswith("10 held-out rows are left out: no estimation row measures w3")
    known = apply_known_features(measured, {"w3": KnownFeature(position=ANCHORS["w3"])})
    assert len(prepare(study(column="role"), PUMA, known, labels)[0].problem) == 70


def test_folds_keep_every_feature_in_the_others(tmp_path) -> None:
    c = campaign()
    for k in range(20):
        c.add("same-point", c.arm.draw(c.rng, 2), f"p{k}")
    data = made(c, tmp_path)
    fold = assign_folds(data, 10, np.random.default_rng(0))
    assert all(len(np.unique(fold[data.gauges.feature == k])) == 2 for k in range(20))


def test_folds_count_what_was_measured(tmp_path) -> None:
    c = campaign()
    c.points(30)
    c.wires(60)
    measured = made(c, tmp_path)
    data = prepared(measured, 90)
    folded = fold_scene(data.training, model(measured).terms, data.training_folds)
    each = [f.rows for f in fold_by_unit(data.training, model(measured).terms, np.arange(90))]
    assert np.concatenate(each).tolist() == [3] * 30 + [1] * 60
    assert folded.rows.tolist() == [
        int(3 * (data.folds[:30] == k).sum() + (data.folds[30:] == k).sum()) for k in range(10)
    ]


def test_a_wrong_wire_length_is_an_outlier_and_a_wrong_point_too(tmp_path) -> None:
    c = campaign()
    c.points(40)
    c.wires(90)
    c.rows[70]["length_mm"] += 3.0
    c.rows[11]["y_mm"] += 3.0
    measured = made(c, tmp_path)
    at = prepared(measured, 130).problem
    flagged = find_gross_outliers(at, fit(at, model(measured, "wrist-coupling:5")))
    assert np.flatnonzero(flagged).tolist() == [11, 70]


def test_single_numbers_and_points_have_one_robust_scale(rng) -> None:
    seen = (
        np.arange(40_000)[:, None] % 2 <= np.arange(2, -1, -1)[None] // 2
    )  # all three, or the first alone
    size = np.linalg.norm(rng.normal(size=seen.shape) * seen, axis=1)
    for rows in (slice(0, None, 2), slice(1, None, 2), slice(None)):
        assert estimate_scale(size[rows], seen[rows]) == pytest.approx(1, rel=0.03)


def test_what_a_set_up_cannot_be_is_refused(tmp_path) -> None:
    c = campaign()
    c.points(3)
    c.wires(60)
    with pytest.raises(
        NotEstimable,
        match="3 estimation configurations have a measured point; registration needs 4",
    ):
        prepared(made(c, tmp_path), 63, register=True)
    for k, row in enumerate(c.rows):
        row["group"] = f"day {k % 2}"
    with pytest.raises(StudyError, match='feature "w1" is in several groups'):
        prepared(made(c, tmp_path), 63, register="per group")
    for row in c.rows[3:]:
        row["group"] = "day 0"
    c.distances(1)
    for row, day in zip(c.rows[-2:], ("day 0", "day 1"), strict=True):
        row["group"] = day
    with pytest.raises(StudyError, match='feature "d0" is in several groups'):
        prepared(made(c, tmp_path), 63, register="per group")
    del c.rows[-2:]
    few, sides = (
        made(c, tmp_path),
        np.array(["held-out"] * 3 + ["estimation"] * 3 + ["held-out"] * 57, dtype=object),
    )
    with pytest.raises(
        NotEstimable, match=r'feature "w1" \(wire\) has 3 estimation rows; to place it takes 4'
    ):
        prepare(study(column="role"), PUMA, few, sides)


def test_anchors_stand_where_they_stood_in_a_registered_frame(tmp_path) -> None:
    c = campaign()
    c.points(40)
    c.wires(60)
    R, t = (
        np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0],
        np.array([2000.0, -500.0, 300.0]),
    )
    R *= np.linalg.det(R)
    for row in c.rows[:40]:
        row |= dict(
            zip(
                ("x_mm", "y_mm", "z_mm"),
                R @ [row["x_mm"], row["y_mm"], row["z_mm"]] + t,
                strict=True,
            )
        )
    measured = made(c, tmp_path)
    data = prepared(measured, 80, register=True)
    fitted = fit(data.training, model(measured, "wrist-coupling:5", register=True))
    value = dict(zip((t.symbol for t in fitted.terms), fitted.theta, strict=True))
    for k, (name, anchor) in enumerate(ANCHORS.items()):
        place = data.problem.fixtures.centre[k] + [value[f"{axis} of {name}"] for axis in "xyz"]
        np.testing.assert_allclose(place, R @ anchor + t, atol=0.3)


def test_an_anchor_beside_a_plane_of_positions_needs_a_first_guess(tmp_path) -> None:
    c = campaign()
    q, good = hold(c.arm, c.effects, c.arm.draw(c.rng, 60), lambda x: x[:, 2:] - 200.0)
    q = q[good][:30]
    c.add("wire", q, "w1", length_mm=np.linalg.norm(c.exact(q) - ANCHORS["w1"], axis=1))
    c.points(20)
    with pytest.raises(
        NotEstimable, match=r"lie in a plane: it could stand on either side.*estimate = true"
    ):
        prepared(made(c, tmp_path), 40)
    data = prepared(
        made(c, tmp_path, w1=KnownFeature(position=(700.0, -1000.0, 400.0), estimate=True)), 40
    )
    assert np.linalg.norm(data.problem.fixtures.centre[0] - ANCHORS["w1"]) < 60


# -- a file, a study, and what comes after
# ------------------------------------------------------------------------------------


def test_a_study_says_where_features_are_and_its_calibration_is_the_arm(tmp_path) -> None:
    c = campaign()
    c.points(30)
    c.wires(45)
    c.distances(25)
    c.plates(40, 2)
    c.file(tmp_path)
    study = parse_study(
        f"""
        name = "wires"
        [robot]
        name = "puma760"
        tool_mm = {list(TOOL)}
        [measurements]
        file = "measurements.csv"
        [measurements.features.w2]
        position_mm = {list(ANCHORS["w2"])}
        [split]
        estimation = 110
        [model]
        candidates = ["wrist-coupling", "joint-compliance"]
        """,
        "study.toml",
    )
    result = run_study(study, tmp_path, sampling=False)
    told = result.record.to_dict()
    assert [(f["name"], f["fitted"]) for f in told["features"]][:2] == [
        ("w1", ["x of w1", "y of w1", "z of w1"]),
        ("w2", []),
    ]
    np.testing.assert_allclose(told["features"][0]["position_mm"], ANCHORS["w1"], atol=0.3)
    assert (told["configurations"]["estimation"], told["configurations"]["held_out"]) == (110, 30)
    assert told["noise_floor"]["mean_mm"] == pytest.approx(
        NOISE * (30 * np.sqrt(8 / np.pi) + 110 * np.sqrt(2 / np.pi)) / 140
    )
    assert any(
        line.startswith("Feature plate0 (plane): a point of it is at")
        for line in terminal_lines(result.record, result.details)
    )
    assert "NaN" not in details_text(result.details)
    stored = parse_calibration(calibration_text(result.calibration))
    assert not any(t.fixture for t in stored.terms)
    q = c.arm.draw(c.rng, 50)
    fresh = build_measurements(q, c.exact(q) + c.noise(50, 3))
    assert np.linalg.norm(predict(stored, stored.problem(fresh)) - c.exact(q), axis=1).mean() < 0.1
    assert not judge(stored, fresh, free_setup=False).drifted
    with pytest.raises(DataError, match="some rows are not points"):
        judge(stored, read_measurements(tmp_path / "measurements.csv", ARM), free_setup=False)


def test_the_sampled_density_is_the_closed_form_where_the_chain_is_linear(tmp_path) -> None:
    c = campaign()
    c.wires(90)
    c.points(10)
    measured = made(c, tmp_path)
    data = prepared(measured, 100)
    fitted = fit(data.training, model(measured, "wrist-coupling:5"))
    psi = (len(fitted.terms) - 1,)
    target = LogPosterior(
        fitted, assign_components(data.training), psi, ("w54", "noise scale"), ("rad", "1")
    )
    walkers = np.random.default_rng(1).normal(0, 1, (12, 2))
    exact, linear = target.log_density(walkers), replace(target, exact=False).log_density(walkers)
    np.testing.assert_allclose(exact - exact[0], linear - linear[0], atol=0.05)


def test_simulated_rows_read_what_the_planted_arm_reads(tmp_path) -> None:
    c = campaign()
    c.points(6)
    c.axes(6)
    c.wires(30)
    c.distances(5)
    known = {name: KnownFeature(position=place) for name, place in ANCHORS.items()}
    data = made(c, tmp_path, **known)
    planted = Term(
        "p", (Screw(5, "rz", mechanism("wrist-coupling:5", PUMA).terms[0].screws[0].cause),)
    )
    frame = simulate_readings(
        PUMA,
        np.array([TOOL]),
        [(planted.screws[0], 1e-3)],
        data=data,
        noise_mm=0.0,
        rng=np.random.default_rng(0),
    )
    frame.to_csv(tmp_path / "made.csv", index=False)
    back = apply_known_features(read_measurements(tmp_path / "made.csv", ARM), known)
    assert (len(back), back.gauges.kind.tolist()) == (len(data), data.gauges.kind.tolist())
    every = prepared(back, 40).problem
    np.testing.assert_allclose(residuals(every, (planted,), np.array([1e-3])), 0, atol=1e-8)
    c.plates(10, 1)
    with pytest.raises(StudyError, match="rows of kind plane hold the arm to a place"):
        simulate_readings(
            PUMA,
            np.array([TOOL]),
            [],
            data=made(c, tmp_path),
            noise_mm=0.1,
            rng=np.random.default_rng(0),
        )


def test_check_counts_rows_by_kind(tmp_path) -> None:
    c = campaign()
    c.wires(60)
    c.touches(20, 4)
    found = inspect_measurements(PUMA, read_measurements(c.file(tmp_path), ARM))
    assert found["kinds"] == {"wire": 60, "same-point": 20}
    assert (
        "Rows by kind: 60 wire (w1, w2, w3), 20 same-point (p0, p1, p2, p3)"
        in format_inspection(found)
    )


def test_poses_stand_beside_wires(tmp_path) -> None:
    c = campaign()
    c.points(40)
    c.wires(30)
    for row in c.rows[:40]:
        row |= {"qw": 1.0, "qx": 0.0, "qy": 0.0, "qz": 0.0}
    bound = prepared(made(c, tmp_path), 50).problem
    assert bound.coordinates == 40 * 6 + 30
    assert not residuals(bound)[40:, 1:].any()
    assert residuals(bound)[:40].all()
    c.rows[3]["qw"] = np.nan
    with pytest.raises(DataError, match="line 5, column qw"):
        made(c, tmp_path)


# -- bad files
# ----------------------------------------------------------------------------------------------------------------

HEAD = "q1_rad,q2_rad,kind,feature,length_mm,x_mm,y_mm,z_mm"
GOOD = [
    "0,0.1,point,,,1,2,3",
    "0,0.2,z,,,,,3",
    "0,0.3,wire,w,900,,,",
    "0,0.4,distance,d,,,,",
    "0,0.5,distance,d,12,,,",
]
BAD = {
    "0,1,wires,w,900,,,": r'line 7, column kind: "wires" is not a kind of measurement. Did you mean "wire"\?',
    "0,1,,w,900,,,": 'line 7, column kind: "" is not a kind',
    "0,1,wire,,900,,,": "line 7, column feature: a row of kind wire has to name its feature",
    "0,1,point,w,,1,2,3": "line 7, column feature: a row of kind point does not name a feature",
    "0,1,ball-bar,w,900,,,": 'feature "w" is of kind wire on line 4 and of kind ball-bar here',
    "0,1,wire,w,,,,": "line 7, column length_mm: expected a finite number, found an empty cell",
    "0,1,wire,w,-3,,,": "line 7, column length_mm: a length must be above zero",
    "0,1,z,,,5,,3": 'line 7, column x_mm: found "5", but a row of this kind measures nothing there',
    "0,1,z,,,,,": "line 7, column z_mm: expected a finite number, found an empty cell",
    "0,1,point,,,1,2,": "line 7, column z_mm: expected a finite number",
    "0,1,plane,p,4,,,": 'line 7, column length_mm: found "4"',
    "0,1,distance,e,,,,": 'line 7: distance "e" has one row',
}


def written(folder: Path, *lines: str) -> Path:
    (folder / "rows.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return folder / "rows.csv"


@pytest.mark.parametrize("line", BAD)
def test_a_bad_row_is_refused_with_its_place(line, tmp_path) -> None:
    with pytest.raises(DataError, match=BAD[line]):
        read_measurements(written(tmp_path, HEAD, *GOOD, line), ARM[:2])


def test_good_rows_are_read_as_they_stand(tmp_path) -> None:
    data = read_measurements(written(tmp_path, HEAD, *GOOD), ARM[:2])
    assert [KINDS[k] for k in data.gauges.kind] == [
        "point",
        "z",
        "wire",
        "distance",
    ]  # a distance begins at its first row
    assert data.row.tolist() == [0, 1, 2, 4]
    np.testing.assert_array_equal(data.position[1], [np.nan, np.nan, 3])
    np.testing.assert_array_equal(data.gauges.length, [np.nan, np.nan, 900, 12])
    np.testing.assert_array_equal(data.gauges.origin.q[3], [0, 0.4])
    assert data.block[3] not in data.block[:3]
    others = "0,0.6,distance,d,14,,,", "0,0.7,distance,e,,,,", "0,0.8,distance,e,9,,,"
    more = read_measurements(written(tmp_path, HEAD, *GOOD, *others), ARM[:2])
    assert [len(more), len(np.unique(more.block))] == [6, 5]  # two that begin alike are never apart


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("0,1,wire,w,-3,,,", "DataFrame, row 5, column length_mm: a length must be above"),
        ("0,1,ball-bar,w,900,,,", "of kind wire on row 2 and of kind ball-bar here"),
        ("0,1,z,,,5,,3", 'row 5, column x_mm: found "5.0", but a row of this kind'),
    ],
)
def test_a_bad_row_of_a_dataframe_is_refused_with_its_place(line, said, tmp_path) -> None:
    import pandas as pd

    frame = pd.read_csv(written(tmp_path, HEAD, *GOOD, line))
    with pytest.raises(DataError, match=said):
        read_measurements(frame, ARM[:2])


def test_every_kind_goes_through_a_dataframe_and_back(tmp_path) -> None:
    c = campaign()
    c.points(6)
    c.axes(6)
    c.wires(9)
    c.bars(6, {"b1": 600.0}, given=True)
    c.distances(3)
    c.touches(4, 1)
    c.plates(4, 1)
    for row in c.rows[:6]:
        row |= {
            "qw": 0.6,
            "qx": 0.0,
            "qy": 0.8,
            "qz": 0.0,
            "srx_rad": 1e-4,
            "sry_rad": 2e-4,
            "srz_rad": 3e-4,
        }
        row |= {"s_mm": np.nan, "sx_mm": 0.1, "sy_mm": 0.2, "sz_mm": 0.3}
    for k, row in enumerate(c.rows):
        row |= {"group": f"day {k % 2}", "temperature_C": 20.0 + k}
    data = made(c, tmp_path)
    for back in (read_measurements(data.to_frame(), ARM), read_measurements(c.file(tmp_path), ARM)):
        assert back.gauges.features == data.gauges.features
        for mine, other in (
            (back, data),
            (back.gauges.origin, data.gauges.origin),
            (back.gauges, data.gauges),
        ):
            for name, values in vars(other).items():
                if isinstance(values, np.ndarray) and not (
                    name == "position" and mine is back.gauges.origin
                ):
                    np.testing.assert_allclose(
                        getattr(mine, name), values, rtol=1e-12, atol=1e-12, err_msg=name
                    )
        np.testing.assert_array_equal(
            back.covariates["temperature_C"], data.covariates["temperature_C"]
        )
    some = data.take(data.gauges.of("distance", "wire"))
    assert len(read_measurements(some.to_frame(), ARM)) == len(some) == 12


def test_copies_are_of_one_kind_feature_and_reading(tmp_path) -> None:
    c = campaign()
    c.wires(30)
    c.points(3)
    c.touches(4, 1)
    for k, row in enumerate(c.rows):
        row["order"] = k
    again = [c.rows[4] | {"order": 100}, c.rows[31] | {"order": 101}, c.rows[34] | {"order": 102}]
    others = [
        c.rows[4] | {"order": 103, "feature": "w2"},
        c.rows[35] | {"order": 104, "feature": "p1"},
    ]
    c.rows += [*again, *others]
    data = read_measurements(c.file(tmp_path), ARM)
    assert data.row.tolist() == [*range(37), 40, 41]
    (note,) = (n.sentence for n in data.notes if n.code == "copied-rows")
    assert note.startswith("3 rows hold the readings")
    assert "line 39 is line 6 again" in note
    assert read_measurements(data.to_frame(), ARM).row.tolist() == [*range(39)]


def test_repeated_readings_of_one_coarse_number_are_no_copies(tmp_path) -> None:
    c = campaign()
    for _ in range(3):
        c.wires(30)
    for k, first in enumerate(c.rows[:30] * 3):
        c.rows[k] = first | {
            "order": k,
            "length_mm": round(5 * (first["length_mm"] + c.rng.normal(0, 0.05))) / 5,
        }
    assert len(read_measurements(c.file(tmp_path), ARM)) == 90


def test_uncertainties_are_the_rows_own(tmp_path) -> None:
    head, rows = f"{HEAD},s_mm,sx_mm,sy_mm,sz_mm", [f"{line}," for line in GOOD]
    tails = [",0.1,0.2,0.3", "0.4,,,", "0.5,,,", "0.6,,,", "0.7,,,"]
    data = read_measurements(
        written(tmp_path, head, *(a[:-1] + "," + b for a, b in zip(rows, tails, strict=True))),
        ARM[:2],
    )
    np.testing.assert_array_equal(data.sigma[:, 0], [0.1, 0.4, 0.5, 0.7])
    np.testing.assert_array_equal(data.sigma[0], [0.1, 0.2, 0.3])
    tails[2] = ",,,"
    with pytest.raises(
        DataError,
        match="line 4, column s_mm: a row of kind wire has no standard uncertainty above zero",
    ):
        read_measurements(
            written(tmp_path, head, *(a[:-1] + "," + b for a, b in zip(rows, tails, strict=True))),
            ARM[:2],
        )


def test_files_that_mean_something_else_by_these_names_are_read_as_before(tmp_path) -> None:
    data = read_measurements(
        written(
            tmp_path,
            "q1_rad,q2_rad,x_mm,y_mm,z_mm,kind,s_mm,length_mm",
            "0,1,1,2,3,sphere,7,8",
            "1,1,1,2,3,cone,7,8",
        ),
        ARM[:2],
    )
    assert data.gauges is None
    assert set(data.covariates) == {"s_mm", "length_mm"}
    assert 'Columns that hold no numbers are ignored: "kind".' in [n.sentence for n in data.notes]


def test_what_a_study_knows_of_features_is_checked(tmp_path) -> None:
    c = campaign()
    c.wires(30)
    c.plates(10, 1)
    c.bars(10, {"bar": 400.0}, given=True)
    point = (1.0, 2.0, 3.0)
    with pytest.raises(StudyError) as refused:
        made(
            c,
            tmp_path,
            w9=KnownFeature(position=point),
            w1=KnownFeature(normal=point),
            plate0=KnownFeature(position=point),
            bar=KnownFeature(length=400.0),
        )
    assert [p.partition(":")[2].strip() for p in refused.value.problems] == [
        "no row of the file names it. Known: bar, plate0, w1, w2, w3.",
        "normal goes with plane, but its rows are of kind wire.",
        "a known plane needs position_mm and normal.",
        "length_mm stands in its rows already; give it once.",
    ]
    with pytest.raises(StudyError, match="say how a tracker measures points"):
        prepare(study(40, noise=INSTRUMENT), PUMA, replace(made(c, tmp_path), sigma=None))
    both = study(40, noise={**INSTRUMENT, "floor_mm": 0.1})
    _, floor, _ = prepare(both, PUMA, replace(made(c, tmp_path), sigma=None))
    assert (floor.coordinate_mm, floor.source) == (0.1, "stated")


def test_a_study_without_features_is_hashed_as_before() -> None:
    text = 'name = "a"\n[robot]\nname = "puma760"\ntool_mm = [0, 0, 100]\n[measurements]\nfile = "a.csv"\n'
    assert "features" not in parse_study(text, "study.toml").model_dump_json()
    known = parse_study(text + "[measurements.features.w]\nposition_mm = [1, 2, 3]\n", "study.toml")
    assert '"features":{"w":{"position_mm":[1.0,2.0,3.0]' in known.model_dump_json()
    with pytest.raises(StudyError, match=r'unknown key "positon_mm"\. Did you mean "position_mm"'):
        parse_study(text + "[measurements.features.w]\npositon_mm = [1, 2, 3]\n", "study.toml")


def test_parts_of_a_set_are_points(tmp_path) -> None:
    import pandas as pd

    c = campaign()
    c.wires(30)
    pd.DataFrame(c.rows).to_parquet(tmp_path / "rows.parquet", index=False)
    some = list_parts([tmp_path / "rows.parquet"])
    with pytest.raises(DataError, match="only measured points can be fitted in parts"):
        Parts(PUMA, TOOL, some).problem(some[0])


def test_a_plan_reckons_with_what_wires_leave_open(tmp_path) -> None:
    """The information beyond free anchors is the Schur complement of all columns' information."""
    c = campaign()
    c.wires(90)
    c.points(10)
    measured = made(c, tmp_path)
    known = prepared(measured, 100).training
    fitted = fit(known, model(measured))
    some = [fitted.terms[k] for k in fitted.representatives]
    at, pool_scene = (
        fitted.at(),
        Problem(PUMA, build_measurements(c.arm.draw(c.rng, 5), np.zeros((5, 3))), np.array([TOOL])),
    )
    p = build_pool(known, pool_scene, fitted.terms, at, NOISE)
    X = compute_design(known.unweighted(), some, at)[0].reshape(-1, len(some))
    own = [k for k, t in enumerate(some) if not t.fixture]
    columns = p.known.reshape(-1, len(p.terms))[:, p.of(some)]
    inverse = np.linalg.inv(X.T @ X)[np.ix_(own, own)]
    np.testing.assert_allclose(columns.T @ columns @ inverse, np.eye(len(own)), atol=1e-5)


def test_the_page_s_example_is_read(tmp_path) -> None:
    text = (Path(__file__).parents[2] / "docs" / "how-to" / "other-measurements.md").read_text(
        encoding="utf-8"
    )
    rows, known = (
        text.partition(f"```{language}\n")[2].partition("```")[0] for language in ("csv", "toml")
    )
    data = read_measurements(written(tmp_path, rows.strip()), ARM)
    assert [KINDS[k] for k in data.gauges.kind] == ["point", "z", "wire", "distance", "same-point"]
    study = (
        'name = "a"\n[robot]\nname = "puma760"\ntool_mm = [0, 0, 100]\n[measurements]\nfile = "a.csv"\n'
        + known
    )
    assert set(read_known_features(parse_study(study, "study.toml"))) == {"north", "plate", "bar"}
    assert all(
        f"| `{kind}` |" in text or f"`{kind}`, " in text or f"`{kind}` |" in text for kind in KINDS
    )
