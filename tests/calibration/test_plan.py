"""What to measure next: formulas against refits and simulation, and ten chosen configurations
against forty drawn ones."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pandas as pd
import pytest
from builders import drawn
from click.testing import CliRunner

from modelsel import Study, plan_next, simulate_study
from modelsel import run_study as study_run
from modelsel._choices import PLAN_CRITERIA
from modelsel.calibration.experiment_design import (
    Rivals,
    _naming_probability,
    _Pair,
    choose_for_parameters,
    choose_for_rivals,
    compute_indices,
    compute_naming_probability,
    count_more_needed,
    merge_indistinct,
)
from modelsel.calibration.plan_pool import Pool, build_pool
from modelsel.cli.main import run_command_line
from modelsel.config.study_file import parse_study
from modelsel.exceptions import DataError, StudyError
from modelsel.fitting.design import compute_design
from modelsel.fitting.linearisation import Linearisation
from modelsel.fitting.possible_parts import MIN_EXCESS
from modelsel.fitting.whitening import UNIT, Whitening
from modelsel.measurements.campaign.visits import count_distinct
from modelsel.measurements.reader import read_measurements
from modelsel.mechanisms.causes import Named
from modelsel.mechanisms.registry import build_mechanisms, mechanism
from modelsel.mechanisms.terms import Screw, Term
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import forward
from modelsel.study.planning.configuration_pool import describe_conditions
from modelsel.study.planning.learning_curve import describe_size
from modelsel.study.planning.planned_repeats import (
    MAX_POSTURES,
    TIMES,
    format_repeats,
    plan_repeats,
)
from modelsel.study.planning.planning import format_plan
from modelsel.study.planning.rival_sentences import describe_rivals, follows_gravity

ROBOT = load_robot("puma760")
GEOMETRY = mechanism("geometric", ROBOT)
SIGMA = 0.05
NAMES = (
    ("joint-compliance:2", "base-tilt"),
    ("backlash:3", "joint-compliance:3"),
    ("encoder-scale:5", "wrist-coupling:5"),
    ("link-bending:2", "joint-compliance:3"),
    ("joint2-twist", "base-tilt"),
    ("thermal-growth:2", "thermal-zero:3"),
    ("gear-eccentricity:4", "axis-wobble:4"),
    ("encoder-eccentricity:5", "gear-ripple:5:3"),
)


def simulated(
    rng: np.random.Generator, names: tuple[str, ...], possible: int, size: float = 0.012
) -> tuple[Pool, Rivals]:
    """60 configurations measured, rivals that move the target by `size` mm rms beyond the geometry,
    a pool of others."""
    known, more = drawn(ROBOT, rng, 60), drawn(ROBOT, rng, possible)
    mechanisms = [build_mechanisms(name, ROBOT)[0] for name in names]
    Q = np.linalg.svd(
        compute_design(known, GEOMETRY.terms)[0].reshape(180, -1), full_matrices=False
    )[0][:, :25]
    estimates = []
    for m in mechanisms:
        theta = np.array([t.size[1] for t in m.terms])
        moved = (compute_design(known, m.terms)[0] @ theta).ravel()
        estimates.append(theta * size / np.sqrt(np.square(moved - Q @ (Q.T @ moved)).sum() / 60))
    even = np.full(len(names), 1 / len(names))
    rivals = Rivals(
        names, tuple(m.terms for m in mechanisms), tuple(estimates), even, GEOMETRY.terms
    )
    terms = [*GEOMETRY.terms, *(t for m in mechanisms for t in m.terms)]
    return build_pool(known, more, terms, Linearisation((), np.zeros(0)), SIGMA), rivals


def test_right_is_the_formula() -> None:
    """methods: δ = 4, ρ = 0.9 gives 0.8144; nothing between them, a coin; all between them,
    certainty."""
    assert _naming_probability(np.array(16.0), np.array(16 * (1 - 0.81))) == pytest.approx(
        0.8144, abs=1e-4
    )
    assert _naming_probability(np.array(100.0), np.array(0.0)) == 0.5
    assert _naming_probability(np.array(100.0), np.array(100.0)) == pytest.approx(1.0, abs=1e-9)


def test_a_motor_torque_that_a_file_measures_is_no_moment_of_weight() -> None:
    for name, by_weight in (("torque_Nm", False), ("torque2", True), ("moment_x", True)):
        term = Term("k", (Screw(2, "rz", Named(name)),))
        only = Rivals((name,), ((term,),), (np.ones(1),), np.ones(1), ())
        assert follows_gravity(only) is by_weight


def test_update_is_a_refit(rng) -> None:
    """Δ with a configuration added, against least squares of all rows."""
    p, rivals = simulated(rng, NAMES[1], 12)
    pair = _Pair(p, rivals, 0, 1)
    _, left = pair.with_each()
    columns, truth = p.of([*rivals.others, *rivals.terms[1]]), p.of(rivals.terms[0])
    scale = np.sqrt(
        np.square(p.possible[:, :, columns]).sum(1).mean(0)
        + np.square(p.known[:, :, columns]).sum(1).mean(0)
    )
    for k in range(12):
        A = np.concatenate([p.known, p.possible[k : k + 1]]).reshape(-1, len(p.terms)) / SIGMA
        whole = np.vstack([A[:, columns], np.diag(scale / 10)])  # the prior: 10 mm
        y = np.concatenate([A[:, truth] @ rivals.estimates[0], np.zeros(len(columns))])
        assert left[k] == pytest.approx(
            np.square(y - whole @ np.linalg.lstsq(whole, y, rcond=None)[0]).sum(), rel=1e-5
        )
    pair.add(3)
    assert pair.compute_rest(slice(None)) == pytest.approx(left[3], rel=1e-6)


def named_rate(
    p: Pool, rivals: Rivals, some: list[int], rng: np.random.Generator, draws: int = 1500
) -> float:
    """How often the true rival fits better, simulated: least squares of each on noisy data, the
    rivals true in turn."""
    A = np.concatenate([p.known, p.possible[some]]).reshape(-1, len(p.terms)) / SIGMA
    A = A / np.where(scale := np.linalg.norm(A, axis=0), scale, 1.0)
    span = [
        np.linalg.svd(A[:, p.of([*rivals.others, *t])], full_matrices=False) for t in rivals.terms
    ]
    bases = [U[:, 1e-9 * S[0] < S] for U, S, _ in span]
    right = 0
    for i in (0, 1):
        truth = p.of(rivals.terms[i])
        y = (A[:, truth] @ (scale[truth] * rivals.estimates[i]))[:, None] + rng.standard_normal(
            (len(A), draws)
        )
        held = [np.square(Q.T @ y).sum(0) for Q in bases]
        right += int((held[i] > held[1 - i]).sum())
    return right / (2 * draws)


@pytest.mark.parametrize("names", NAMES[1:4:2])
def test_probability_is_the_rate_of_naming(names, rng) -> None:
    p, rivals = simulated(rng, names, 30, 0.02)
    for some in ([], list(range(15))):
        assert named_rate(p, rivals, some, rng) == pytest.approx(
            compute_naming_probability(p, [rivals], some), abs=0.04
        )


@pytest.mark.slow
def test_ten_chosen_separate_what_forty_drawn_do(rng) -> None:
    """The figure to reach: over eight pairs of rivals, told by formula; and named at that rate in
    simulated data."""
    chosen, random, rates = [], [], []
    for names in NAMES:
        p, rivals = simulated(rng, names, 3000)
        rows, told = choose_for_rivals(p, [rivals], 10)
        draws = [rng.choice(3000, 40, replace=False).tolist() for _ in range(8)]
        chosen.append(told[-1])
        random.append(np.mean([compute_naming_probability(p, [rivals], some) for some in draws]))
        assert told[0] < told[-1]
        assert len(set(rows)) == 10
        if len(rivals.terms[0]) == len(rivals.terms[1]) == 1:
            rates.append([named_rate(p, rivals, some, rng) for some in (rows, draws[0], [])])
    assert np.mean(chosen) >= np.mean(random)
    ten, forty, none = np.mean(rates, axis=0)
    assert ten > forty - 0.02 > none


def test_what_no_choice_tells_is_one(rng) -> None:
    p, rivals = simulated(rng, NAMES[1], 50)
    twice = Rivals(
        ("a", "b", "a again"),
        (*rivals.terms, rivals.terms[0]),
        (*rivals.estimates, rivals.estimates[0]),
        np.array([0.4, 0.35, 0.25]),
        rivals.others,
    )
    left, twins = merge_indistinct(p, twice)
    assert left.names == ("a", "b")
    np.testing.assert_allclose(left.probability, [0.65, 0.35])
    assert twins == ("a again and a",)
    only, _ = merge_indistinct(
        p,
        replace(
            twice,
            names=("a", "a again"),
            terms=twice.terms[::2],
            estimates=twice.estimates[::2],
            probability=np.array([0.5, 0.5]),
        ),
    )
    assert only is None
    _, twins = merge_indistinct(p, replace(twice, names=("a", "b", "a")))
    assert twins == ()


def kept(p: Pool) -> list[Term]:
    from modelsel.fitting.identifiability import identify
    from modelsel.fitting.reduction import reduce

    A = p.known[:, :, : len(GEOMETRY.terms)].reshape(-1, len(GEOMETRY.terms))
    return [GEOMETRY.terms[k] for k in identify(reduce(A, A[:, 0])).kept]


def test_indices_are_those_of_the_singular_values(rng) -> None:
    """Sun & Hollerbach 2008, from the singular values of the scaled matrix itself."""
    p, _ = simulated(rng, NAMES[0], 40)
    terms = kept(p)
    columns = p.of(terms)
    A = np.concatenate([p.known, p.possible[[2, 7]]])[:, :, columns]
    A = A / np.sqrt(np.square(p.possible[:, :, columns]).sum(1).mean(0)) / SIGMA
    s = np.linalg.svd(A.reshape(-1, len(columns)), compute_uv=False)
    found = compute_indices(p, terms, [2, 7])
    expected = {
        "o1": np.prod(s) ** (1 / len(s)) / np.sqrt(62),
        "o2": s[-1] / s[0],
        "o3": s[-1],
        "o4": s[-1] ** 2 / s[0],
        "o5": 1 / (1 / s).sum(),
        "d": 2 * np.log(s).sum(),
        "a": -np.log((1 / s**2).sum()),
    }
    for name, value in expected.items():
        assert found[name] == pytest.approx(value, rel=1e-6)


@pytest.mark.parametrize("criterion", PLAN_CRITERIA)
def test_criterion_beats_chance(criterion, rng) -> None:
    p, _ = simulated(rng, NAMES[0], 150)
    terms = kept(p)
    rows = choose_for_parameters(p, terms, 6, criterion)
    drawn_ = max(
        compute_indices(p, terms, rng.choice(150, 6, replace=False).tolist())[criterion]
        for _ in range(40)
    )
    assert compute_indices(p, terms, rows)[criterion] > drawn_
    assert len(set(rows)) == 6


def test_the_command_offers_every_criterion() -> None:
    """Listed there once more, so that `modelsel plan --help` loads no numpy."""


def test_more_needed() -> None:
    """Noncentrality is configurations x size²: a quarter of the size takes sixteen times as
    many."""
    assert count_more_needed(0.02, 80, 0.005) == 16 * 80 - 80
    assert count_more_needed(0.02, 80, 0.03) == 0


STUDY = """name = "rivals"
seed = 3
[robot]
name = "puma760"
tool_mm = [30, 0, 100]
[measurements]
file = "measurements.csv"
[split]
estimation = 50
[model]
candidates = ["gear-eccentricity", "axis-wobble", "encoder-eccentricity", "joint-compliance", "base-tilt", "joint2-twist"]
[simulate]
configurations = 60
noise_mm = 0.06
[[simulate.effect]]
frame = 2
axis = "rz"
cause = "cos(q2)"
size = 7e-5
"""


@pytest.mark.slow
def test_command(tmp_path, rng) -> None:
    (tmp_path / "study.toml").write_text(STUDY)
    runner = CliRunner()

    def run(*words: str):
        return runner.invoke(run_command_line, [str(w) for w in words])

    assert run("simulate", tmp_path, "--out", tmp_path / "measurements.csv").exit_code == 0
    ran = run(
        "plan",
        tmp_path,
        "--limits",
        "--count",
        "4",
        "--out",
        tmp_path / "next.csv",
        "--size",
        "0.01",
    )
    assert ran.exit_code == 0, ran.output
    assert "told from its nearest rival with probability" in ran.output
    assert "An effect of 0.01 mm rms" in ran.output
    narrow = run("plan", tmp_path, "--joint", "q2_deg=-10:10", "--count", "3", "--json")
    assert all(
        abs(row["q2_rad"]) <= np.radians(10) for row in json.loads(narrow.stdout)["configurations"]
    )
    for wrong in ("q2_deg", "q2_deg=5", "q2_deg=a:b", "q2=1:2", "q9_deg=1:2"):
        assert run("plan", tmp_path, "--joint", wrong).exit_code == 2
    chosen = pd.read_csv(tmp_path / "next.csv")
    assert len(chosen) == 4
    # no candidate of this study looks at a direction of approach
    assert "approach1" not in chosen
    pd.DataFrame({f"q{j}_deg": rng.uniform(-90, 90, 40) for j in range(1, 7)}).to_csv(
        tmp_path / "pool.csv", index=False
    )
    first, again = (
        run(
            "plan",
            tmp_path,
            "--pool",
            tmp_path / "pool.csv",
            "--count",
            "3",
            "--json",
            "--for",
            "o2",
        )
        for _ in "ab"
    )
    assert first.exit_code == 0, first.output
    assert first.stdout == again.stdout
    assert run("plan", tmp_path, "--pool", tmp_path / "pool.csv", "--limits").exit_code == 2
    rounds = run("plan", tmp_path, "--count", "12", "--repeats", "4", "--json")
    found = json.loads(rounds.stdout)
    assert len(found["repeats"]["plan_rows"]) == MAX_POSTURES
    assert found["repeats"]["degrees_of_freedom"] == 3 * MAX_POSTURES
    assert len(found["configurations"]) == 12 + 3 * MAX_POSTURES
    assert run("plan", tmp_path, "--repeats", "1").exit_code == 2
    result = study_run(tmp_path, sampling=False)
    planned = plan_next(result, 4, limits=True)  # the same from Python, and in a notebook
    pd.testing.assert_frame_equal(planned.to_frame(), chosen, atol=1e-6)
    assert "told from its nearest rival with probability" in planned._repr_html_()
    with pytest.raises(DataError, match="DataFrame: column q1_rad or q1_deg is missing"):
        plan_next(result, 3, pool=chosen.drop(columns="q1_rad"))


@pytest.mark.integration
def test_ranges_and_units_are_the_users(rng) -> None:
    """Drawn within what was measured, wider or narrower where that is asked, and written in the
    units that were read."""
    robot = load_robot("irb120")
    at = drawn(robot, rng, 60, (30.0, 0.0, 100.0))
    q = np.degrees(at.data.q) * 0.4
    x = forward(robot, np.radians(q), np.array([30.0, 0.0, 100.0])) + rng.normal(0, 0.05, (60, 3))
    frame = pd.DataFrame(
        {
            f"q{j}_{'rad' if j == 6 else 'deg'}": np.radians(q[:, j - 1]) if j == 6 else q[:, j - 1]
            for j in range(1, 7)
        }
        | dict(zip(("x_mm", "y_mm", "z_mm"), x.T, strict=True))
    )
    result = study_run(
        Study(
            name="s",
            robot={"name": "irb120", "tool_mm": (30, 0, 100)},
            measurements=frame,
            model={"candidates": ["backlash"]},
        ),
        sampling=False,
    )
    near, wide = plan_next(result, 12).to_frame(), plan_next(result, 12, limits=True).to_frame()
    names = [f"q{j}_deg" for j in range(1, 6)] + ["q6_rad"]
    assert list(near)[:6] == list(wide)[:6] == names
    low, high = frame[names].min(), frame[names].max()
    assert ((near[names] >= low) & (near[names] <= high)).all(axis=None)
    assert not ((wide[names] >= low) & (wide[names] <= high)).all(axis=None)
    limit = np.array([j.limits for j in robot.joints])
    assert (
        np.abs(np.radians(wide["q2_deg"]) - limit[1].mean()) <= np.ptp(limit[1]) / 2 + 1e-9
    ).all()
    own = plan_next(result, 12, joints={"q2_deg": (-170.0, -150.0), "q6_rad": (3.0, 3.5)})
    assert own.to_frame()["q2_deg"].between(-170, -150).all()
    assert own.to_frame()["q6_rad"].between(3.0, 3.5).all()
    wide = repr(plan_next(result, 2, limits=True))
    assert "Drawn within the robot file's limits." in wide
    assert "Collisions are not known here" in wide
    assert "Drawn within the joint ranges measured, q2_deg, q6_rad as given." in repr(own)
    beyond = "q2_deg goes beyond the joint's limits in the robot file, -110 to 110"
    assert repr(own).count("goes beyond") == 1
    assert beyond in repr(own)
    for wrong, said in (
        ({"q7_deg": (0, 1)}, '"q7_deg" is not a joint'),
        ({"q2_deg": (9, 1)}, "from a lower to a higher number"),
    ):
        with pytest.raises(StudyError, match=said):
            plan_next(result, 3, joints=wrong)
    with pytest.raises(StudyError, match=r"purpose: expected one of rivals, d, a, .*, found 'e'"):
        plan_next(result, 3, purpose="e")


def test_every_target_is_seen_at_every_configuration(rng) -> None:
    """A pool without targets is seen through all of the study's; one that lists them unevenly is
    refused."""
    from modelsel.measurements.measurements import build_measurements
    from modelsel.study.planning.configuration_pool import repeat_for_targets
    from modelsel.study.planning.planning import tabulate_configurations

    at = drawn(ROBOT, rng, 40, target=["a", "b"] * 20, configuration=np.repeat(np.arange(20), 2))
    q = ROBOT.draw(rng, 7)
    possible = repeat_for_targets(build_measurements(q, np.zeros((7, 3))), ("a", "b"))
    assert len(possible) == 14
    assert possible.configurations == 7
    tools = np.array([[40.0, 0, 100], [0, 60.0, 100]])
    known, more = (replace(at, data=data, tools=tools) for data in (at.data, possible))
    p = build_pool(known, more, GEOMETRY.terms, Linearisation((), np.zeros(0)), SIGMA)
    assert p.possible.shape == (7, 6, len(GEOMETRY.terms))
    assert p.configurations == 20
    c = load_calibration_like(known)
    np.testing.assert_allclose(tabulate_configurations(c, possible, [4, 2])["q3_rad"], q[[4, 2], 2])
    torn = replace(more, data=possible.take(np.arange(13)))
    with pytest.raises(DataError, match="different numbers of rows"):
        build_pool(known, torn, GEOMETRY.terms, Linearisation((), np.zeros(0)), SIGMA)


def load_calibration_like(at):
    """A calibration of the geometry alone, for its robot."""
    from modelsel.calibration.calibration import calibrate
    from modelsel.fitting.design import Model
    from modelsel.fitting.least_squares import fit
    from modelsel.fitting.noise import Floor
    from modelsel.selection.evaluation import Split

    rows = np.ones(len(at), bool)
    return calibrate(
        "plan",
        Split(at, rows, ~rows, np.zeros(len(at), np.intp), True),
        fit(at, Model((GEOMETRY,))),
        Floor(SIGMA, "stated"),
        None,
        False,
        {},
    )


# -- repeats
# --------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def fitted():
    """A study of 60 configurations, each measured once."""
    study = parse_study(STUDY.replace("[model]", "[model]\nbase = []"), "study.toml")
    frame = simulate_study(study)
    return study_run(study.with_measurements(frame), sampling=False)


@pytest.mark.integration
def test_a_plan_proposes_repeats_and_writes_them_where_asked(fitted, tmp_path) -> None:
    """The first round is the plan as it is without; the others repeat what is far apart, each visit
    with a number of its own, and the file reads back."""
    plain, rounds = plan_next(fitted, 16), plan_next(fitted, 16, repeats=4)
    again = rounds.repeats
    assert again.numbers == plain.repeats.numbers
    assert (plain.repeats.times, again.times, again.before) == (TIMES, 4, 0)
    assert len(again.numbers) == MAX_POSTURES
    before, after = plain.to_frame(), rounds.to_frame()
    assert len(before) == 16
    assert list(after) == [*before, "configuration"]
    pd.testing.assert_frame_equal(after[:16][list(before)], before)
    orders = []
    for k in range(3):
        own = after[16 + MAX_POSTURES * k :][:MAX_POSTURES][list(before)].to_numpy()
        orders.append([int((before == row).all(axis=1).argmax()) for row in own])
    assert all(tuple(sorted(order)) == again.numbers for order in orders)
    assert len({tuple(order) for order in orders}) == 3
    assert all(one[-1] != other[0] for one, other in pairwise(orders))
    pd.testing.assert_frame_equal(plan_next(fitted, 16, repeats=4).to_frame(), after)
    after.to_csv(tmp_path / "next.csv", index=False)
    data = read_measurements(tmp_path / "next.csv", fitted.robot, positions=False)
    assert data.configurations == 16 + 3 * MAX_POSTURES
    assert count_distinct(data.block) == 16

    freedom = MAX_POSTURES * (TIMES - 1)
    assert format_plan(plain)[-1] == (
        f"Repeats: configurations {', '.join(str(k + 1) for k in again.numbers)} of these, each "
        "measured 3 times in separate rounds, tell what a joint does not repeat, at best to "
        f"{100 / np.sqrt(2 * freedom):.0f} % of it (one standard error; {freedom} degrees of "
        "freedom)."
    )


@pytest.mark.integration
def test_learning_counts_configurations_that_estimate(fitted) -> None:
    """A user measures more of them than estimate: the total is told at the study's own split."""
    counts = fitted.record.configurations
    total = counts.estimation + counts.held_out
    planned = plan_next(fitted, 4)
    (learning,) = [line for line in format_plan(planned) if line.startswith("To find smaller")]
    assert learning.startswith(
        f"To find smaller effects: {counts.estimation} of {total} measured configurations estimate now"
    )
    assert learning.endswith(" more that estimate.")
    raised = counts.estimation + len(planned.rows)
    assert any(
        f"set `estimation = {raised}` under [split]" in line for line in format_plan(planned)
    )
    told = describe_size(replace(planned, configurations=24, measured=60), 0.05, 7)
    assert "after 7 more configurations that estimate, of 18 in all where the split" in told
    whole = describe_size(replace(planned, configurations=60, measured=60), 0.05, 7)
    assert whole.endswith("probability after 7 more configurations that estimate.")


def test_few_configurations_are_repeated_more_often(fitted) -> None:
    """As often as it takes to tell anything; a lone one, too. The study's own repeats count."""
    for count, times in ((4, 4), (1, 11), (12, TIMES)):
        planned = plan_next(fitted, count).repeats
        assert planned.times == times
        assert planned.freedom >= MIN_EXCESS
    repeated = plan_repeats(np.eye(4), np.eye(4)[:, :3], before=40)
    assert repeated.freedom == 40 + 4 * 3
    assert "52 degrees of freedom, 40 of them the study's" in format_repeats(repeated)


def test_a_pool_of_few_configurations_is_told(fitted) -> None:
    pool = plan_next(fitted, 5).to_frame()
    assert "The pool has 5 configurations, fewer than the 8 asked for" in repr(
        plan_next(fitted, 8, pool=pool)
    )
    assert "The pool has" not in repr(plan_next(fitted, 5, pool=pool))


@pytest.mark.integration
def test_directions_are_planned_where_a_candidate_looks_at_them(fitted) -> None:
    """They are instructions then, which the order of the rows does not follow, and that is said."""
    plain = plan_next(fitted, 5)
    assert "approach1" not in plain.to_frame()
    assert "approach1" not in repr(plain)
    study = STUDY.replace("[model]", "[model]\nbase = []").replace(
        '"gear-ecc', '"approach-backlash", "gear-ecc'
    )
    read = parse_study(study, "study.toml")
    found = study_run(read.with_measurements(simulate_study(read)), sampling=False)
    planned = plan_next(found, 5)
    names = [f"approach{j}" for j in range(1, 7)]
    assert set(np.unique(planned.to_frame()[names])) == {-1, 1}
    assert "approach1 … approach6 are instructions" in repr(planned)


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"count": 0}, "count: expected a whole number from 1 on, found 0"),
        ({"count": -1}, "count: expected a whole number from 1 on, found -1"),
        ({"count": 2.5}, "count: expected a whole number from 1 on, found 2.5"),
        ({"count": True}, "count: expected a whole number from 1 on, found True"),
        ({"repeats": 1}, "repeats: expected a whole number from 2 on, found 1"),
    ],
)
def test_numbers_of_configurations_are_whole(fitted, asked, said) -> None:
    with pytest.raises(StudyError, match=said):
        plan_next(fitted, **asked)


@pytest.mark.parametrize("size", ["nan", "inf", "1e-300", "0", "-1"])
def test_a_size_that_is_no_length_is_refused(size, tmp_path) -> None:
    ran = CliRunner().invoke(run_command_line, ["plan", str(tmp_path), "--size", size])
    assert ran.exit_code == 2, ran.output
    assert "expected a length from 0.000001 to 10000 mm" in ran.output


def test_what_is_no_study_is_refused() -> None:
    with pytest.raises(StudyError, match="expected a Study, or the path of a study file"):
        study_run(3)


def test_repeats_are_spread_over_the_workspace(rng) -> None:
    """Of a crowd and ten others far apart, one of the crowd at most."""
    corners = 100 * np.concatenate([np.eye(5), -np.eye(5)])
    q = np.concatenate([rng.normal(size=(30, 5)), corners])
    chosen = plan_repeats(q, np.zeros((40, 3)), before=0).numbers
    assert sum(number >= 30 for number in chosen) >= MAX_POSTURES - 1


def test_a_joint_that_stands_still_spreads_nothing() -> None:
    """Its mean differs from it by rounding."""
    q = np.column_stack([np.linspace(-1, 1, 21), np.full(21, 0.7)])
    chosen = plan_repeats(q, np.zeros((21, 3)), before=0).numbers
    assert {0, 20} <= set(chosen)


def test_rivals_are_named_once_and_what_poses_cannot_tell_is_said() -> None:
    names = [("link-bending:2", "joint-compliance:3", "joint-compliance:3")]
    said = describe_rivals(names, (0.55, 0.57), None, 10, True)
    assert "Rivals: link-bending:2 or joint-compliance:3. The" in said
    assert "Poses will hardly tell these apart; what may: another payload" in said
    assert "hardly" not in describe_rivals(names, (0.55, 0.75), None, 10, True)
    assert "hardly" not in describe_rivals(names, (0.97, 0.98), None, 10, True)
    assert "payload_kg" not in describe_rivals(names, (0.55, 0.57), None, 10, False)


def test_orientations_that_are_measured_are_planned_with(rng) -> None:
    """Their terms, which no position tells, are parameters of the study: none may make the
    information singular."""
    from modelsel.mechanisms.geometry import build_setup

    setup = build_setup(ROBOT, 1, 1, False, True, ())
    terms = [
        *GEOMETRY.terms,
        *(t for t in setup.terms if t.key not in {k.key for k in GEOMETRY.terms}),
    ]
    known, more = drawn(ROBOT, rng, 60), drawn(ROBOT, rng, 40)
    turned = np.tile(np.eye(3), (60, 1, 1))
    matrices = np.tile(np.diag([1 / SIGMA] * 3 + [1 / 2e-4] * 3), (60, 1, 1))
    oriented = replace(
        known,
        data=replace(known.data, rotation=turned),
        tool_rotations=np.eye(3)[None],
        whitening=Whitening(1.0, matrices),
    )
    at = Linearisation((), np.zeros(0))
    p = build_pool(oriented, more, terms, at, SIGMA)
    assert p.known.shape == (60, 6, len(terms))
    assert p.possible.shape == (40, 6, len(terms))
    design = compute_design(replace(oriented, whitening=UNIT), terms, at)[0]
    np.testing.assert_allclose(p.known[:, :3], design[:, :3])
    np.testing.assert_allclose(p.known[:, 3:], design[:, 3:] * SIGMA / 2e-4)
    rotations = [t for t in terms if t.screws[0].frame == 7 and t.screws[0].axis[0] == "r"]
    assert rotations
    rows = choose_for_parameters(p, rotations, 5, "d")
    assert len(set(rows)) == 5
    with pytest.raises(np.linalg.LinAlgError):  # as from positions alone
        choose_for_parameters(build_pool(known, more, terms, at, SIGMA), rotations, 5, "d")


def test_clocks_and_counters_are_no_conditions(rng) -> None:
    """Payload, temperature and what the model looks at are; what the course of the campaign sets
    cannot be set."""
    from modelsel.study.planning.configuration_pool import keep_conditions

    data = drawn(ROBOT, rng, 6).data
    more = {**data.covariates, "stamp": np.arange(6.0), "frames": np.full(6, 183.0)}
    pool = replace(data, covariates=more)
    kept = keep_conditions(pool, {"q2", "current_A", "time_s"})
    assert set(kept.covariates) == {"payload_kg", "temperature_C", "current_A"}


def test_what_to_do_with_conditions_is_said() -> None:
    assert not describe_conditions(["q1_deg", "q2_mm", "approach1", "configuration"])
    told = describe_conditions(["q1_deg", "approach1", "payload_kg", "temperature_C"])
    assert told.startswith("payload_kg and temperature_C: as in the measured rows. Set what can be")


def test_small_indices_of_observability_are_written_with_their_powers() -> None:
    from modelsel.study.planning.planning import _write_index

    assert _write_index(4.64e-15) == "4.6e-15"
    assert [_write_index(value) for value in (0.0, 0.0275, 22.68)] == ["0", "0.0275", "22.7"]
