"""benchmarks.unlisted: what is planted, what is true of it, the oracle, and how claims are counted."""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hidden_arm import State, arm, measured
from scipy.stats import f

ROOT = Path(__file__).parents[2]
if not (ROOT / "benchmarks").is_dir():
    pytest.skip("a source distribution has no benchmarks", allow_module_level=True)
sys.path.append(str(ROOT))

from benchmarks import runner, unlisted  # noqa: E402
from benchmarks.noise import SIGMA  # noqa: E402
from benchmarks.unlisted_plants import (  # noqa: E402
    KINDS,
    Plant,
    Truth,
    draw_lag,
    draw_sawtooth,
    find_truth,
    scale_parts,
)
from modelsel import Model, mechanism  # noqa: E402
from modelsel.diagnosis.candidates.candidate import Candidate  # noqa: E402
from modelsel.diagnosis.columns.candidate_columns import stack_design  # noqa: E402
from modelsel.diagnosis.findings.effects import Claim  # noqa: E402
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind  # noqa: E402
from modelsel.fitting.least_squares import fit  # noqa: E402
from modelsel.mechanisms.cause_formulas import parse  # noqa: E402
from modelsel.mechanisms.causes import Cause, q, sin  # noqa: E402
from modelsel.mechanisms.drives import gear_ripple, read_too_early  # noqa: E402
from modelsel.mechanisms.registry import build_mechanisms  # noqa: E402
from modelsel.mechanisms.terms import Mechanism, Screw, Term  # noqa: E402
from modelsel.robot.files import load_robot  # noqa: E402

PLANTED = [name for name in KINDS if name not in ("noise", "tool")]


def drawn(name: str, seed: int = 1, robot: str = "puma760") -> unlisted.Campaign:
    return unlisted.draw_campaign(KINDS[name], robot, np.random.default_rng(seed))


def finding(own: Mechanism, probability: float = 0.95, kind=CandidateKind.MECHANISM, **more):
    """As much of a finding as is judged."""
    candidate = Candidate(own, kind, 0.1)
    entry = SimpleNamespace(candidate=candidate, probability=probability)
    named = SimpleNamespace(entries=[entry])
    return SimpleNamespace(**{"claim": None, "candidate": candidate, "named": named, **more})


def registered(name: str, robot: str = "puma760") -> Mechanism:
    return build_mechanisms(name, load_robot(robot))[0]


def cell(frame: int, axis: str, *causes: Cause) -> Mechanism:
    terms = tuple(Term(f"m{k}", (Screw(frame, axis, cause),)) for k, cause in enumerate(causes))
    return Mechanism("cell", terms)


@pytest.mark.parametrize("name", [*PLANTED, "tool"])
def test_largest_displacement_of_a_part_is_its_size(name) -> None:
    """What is planted moves the target, through the exact chain, by as much as was drawn."""
    one = drawn(name)
    for part in one.plant.parts:
        exact = measured(one.arm, one.state, [part]) - measured(one.arm, one.state, [])
        low, high = KINDS[name].sizes
        largest = np.linalg.norm(exact, axis=1).max() / SIGMA
        assert 0.98 * low < largest < 1.02 * high


@pytest.mark.parametrize("name", PLANTED)
def test_oracle_has_the_formula_that_is_planted(name) -> None:
    """The package's fit of geometry and formula returns the formula as it is, without noise."""
    one = drawn(name)
    exact = measured(one.arm, one.state, one.plant.told)
    at = unlisted.bound(one.arm, one.robot, one.state, exact)
    at = unlisted.add_truth(at, one.plant.told, one.state)
    own = unlisted.describe_truth(one.plant.told, one.state)
    both = Model((mechanism("geometric", at.robot), own))
    assert fit(at, both).theta[-len(own.terms) :] == pytest.approx(1, abs=1e-3)


def test_oracle_tests_by_f() -> None:
    """Its p-value is that of the F test of two nested regressions, here by their sums of squares."""
    one = drawn("lag-123", 3)
    base = Model((mechanism("geometric", one.problem.robot),))
    own = unlisted.describe_truth(one.plant.told, one.state)
    quiet = replace(one, plant=Plant("nothing")).problem
    at = unlisted.add_truth(quiet, one.plant.told, one.state)
    both, plain = Model((*base.mechanisms, own)), fit(at, base)
    columns, left = stack_design(at, both.terms, plain.at())
    fitted = columns[:, [*plain.found.kept, *range(len(base.terms), len(both.terms))]]
    less = np.square(left - fitted @ np.linalg.lstsq(fitted, left)[0]).sum()
    fitted = fitted[:, :-3]
    more = np.square(left - fitted @ np.linalg.lstsq(fitted, left)[0]).sum()
    free = len(left) - np.linalg.matrix_rank(fitted) - 3
    expected = f.sf((more - less) / 3 / (less / free), 3, free)
    assert 0.01 < expected < 0.99
    assert unlisted.compute_p(at, base, both, plain)[0] == pytest.approx(expected, rel=1e-6)


@pytest.mark.slow
def test_oracle_is_better_than_the_base_and_finds_a_large_effect() -> None:
    one = drawn("cable", 5)
    larger = scale_parts(one.plant, one.state, np.array([8 * SIGMA]))
    one = replace(one, plant=larger)
    base = Model((mechanism("geometric", one.problem.robot),))
    oracle = unlisted.build_oracle(one, base, np.random.default_rng(0))
    assert 0 < oracle.critical < 1e-3
    assert oracle.p < oracle.critical
    plain = unlisted.compute_rms(fit(one.problem, base), one.unseen)
    assert unlisted.compute_rms(oracle.fit, oracle.unseen) < 0.8 * plain


def test_truth_of_a_plant() -> None:
    """Places that move the target alike, and readings that drive, are found on the arm."""
    cable = drawn("cable").truth
    assert cable.places == {(4, "rz"), (5, "rx")}  # the wrist's axes meet
    assert cable.needed == cable.allowed == {"q1", "q4"}
    growth = drawn("growth", 2)
    joint = next(iter(growth.truth.needed - {"time"}))
    assert growth.truth.needed == growth.truth.allowed == {joint, "time"}
    assert (int(joint[1:]), "rz") in growth.truth.places
    sag = drawn("sag").truth
    assert sag.needed == {"q2", "q3"}
    assert "q1" not in sag.allowed
    assert sag.holds_place(frozenset(((1, "rx"), (1, "rz"))))
    assert not sag.holds_place(frozenset(((1, "rz"),)))
    lag = drawn("lag").truth
    assert not lag.needed
    assert lag.allowed == {f"move{j}" for j in range(1, 7)}
    assert drawn("noise").truth == drawn("tool").truth == Truth()


def joint_of(one: unlisted.Campaign) -> int:
    """The joint that a plant of one joint turns."""
    twist = one.plant.parts[0].perturbation(one.state)[0]
    return int(np.flatnonzero(np.abs(twist[:, :, 5]).max(0))[0]) + 1


JUDGED = [
    ("spring", "joint-compliance:{j}", True),
    ("spring", "backlash:{j}", False),
    ("spring", "gravity-twist", False),
    ("cable", "encoder-scale:4", False),
    ("growth", "gear-eccentricity:{j}", False),
    ("stiction", "approach-backlash:{j}", True),
    ("stiction", "overshoot:{j}", False),
    ("drift", "tracker-drift", True),
    ("drift", "tracker-step", False),
    ("sag", "refraction", False),
    ("lag", "settle:3", True),
    ("lag", "approach-backlash:3", False),
    ("lag-123", "settle:3", True),
    ("lag-123", "settle:4", False),
    ("noise", "backlash:3", False),
    ("tool", "tool-droop", False),
]


@pytest.mark.parametrize(("name", "said", "right"), JUDGED)
def test_names(name, said, right) -> None:
    """A registered name is true by the table of the kinds, and at a true place only."""
    one = drawn(name)
    said = said.format(j=joint_of(one)) if "{" in said else said
    claim = unlisted.judge(finding(registered(said)), one)
    assert (claim.name, claim.level, claim.right) == (said, "cause", right)


def test_a_true_name_of_another_joint_is_false() -> None:
    one = drawn("spring")
    other = 5 - joint_of(one)
    claim = unlisted.judge(finding(registered(f"joint-compliance:{other}")), one)
    assert not claim.at_place
    assert not claim.right


def test_the_fault_is_true_where_all_joints_lag_alone() -> None:
    fault = read_too_early(load_robot("puma760"))
    assert unlisted.judge(finding(fault), drawn("lag")).right
    assert not unlisted.judge(finding(fault), drawn("lag-123")).right


def test_waves_of_a_saw() -> None:
    """Waves of a multiple of its teeth are true of a saw, others are not, nor is one of a turn."""
    one = drawn("sawtooth")
    j, teeth = joint_of(one), one.plant.teeth
    robot = load_robot("puma760")
    right = [
        unlisted.judge(finding(gear_ripple(robot, j, waves)), one).right
        for waves in (teeth, 2 * teeth, teeth + 1, 2 * teeth + 0.25, 2 * teeth + 0.5)
    ]
    assert right == [True, True, False, True, False]
    assert not unlisted.judge(finding(registered(f"gear-eccentricity:{j}")), one).right
    wave = cell(j, "rz", sin(float(teeth) * q(j)))
    assert unlisted.judge(finding(wave, kind=CandidateKind.JOINT_WAVE), one).right


def test_shapes() -> None:
    """A formula is true where it does what is planted, at its place, by its drivers."""
    kinds = {"kind": CandidateKind.CELL}
    link = drawn("link", 4)
    twist = np.abs(link.plant.parts[0].perturbation(link.state)[0]).max(0)
    frame, axis = int(twist.max(1).argmax()) + 1, f"t{'xyz'[twist.max(0)[:3].argmax()]}"
    payload = parse("payload_kg", {"payload_kg": "kg"})
    claim = unlisted.judge(finding(cell(frame, axis, payload), **kinds), link)
    assert (claim.level, claim.drivers, claim.right) == ("shape", ("payload",), True)
    elsewhere = unlisted.judge(finding(cell(6, "rz", payload), **kinds), link)
    assert not elsewhere.right
    growth = drawn("growth", 2)
    j = joint_of(growth)
    wave = unlisted.judge(finding(cell(j, "rz", sin(q(j))), **kinds), growth)
    assert wave.at_place
    assert not wave.right


def test_readings_behind_a_torque() -> None:
    one = drawn("spring")
    j = joint_of(one)
    torque = cell(j, "rz", parse(f"torque{j}", {f"torque{j}": "N m"}))
    claim = unlisted.judge(finding(torque, kind=CandidateKind.CELL), one)
    assert set(claim.drivers) >= one.truth.needed
    assert set(claim.drivers) <= one.truth.allowed


def test_reading_of_findings() -> None:
    """Without a claim, a registered name is a cause, a free function tells drivers; with one, it
    counts."""
    own = registered("encoder-scale:4")
    assert unlisted.read_finding(finding(own, 0.95)) == ("cause", 0.95)
    free = finding(own, 0.9, CandidateKind.FREE_FUNCTION)
    assert unlisted.read_finding(free) == ("drivers", 0.9)
    assert unlisted.read_finding(finding(own, 0.8, CandidateKind.CELL)) == ("shape", 0.8)
    claim = Claim("place", (0.99, 0.5, 0.1, 0.1))
    told = finding(own, 0.95, claim=claim)
    assert unlisted.read_finding(told) == ("place", 0.99)
    assert unlisted.judge(told, drawn("cable")).right


def claim_of(level="cause", probability=0.95, right=False, at_place=True, drivers=("q4",)):
    return unlisted.Claim("a", level, probability, right, at_place, drivers)


def test_place_and_drivers_of_all_findings_together() -> None:
    truth = Truth(
        frozenset(((4, "rz"),)), frozenset(), frozenset(("q1", "q4")), frozenset(("q1", "q4"))
    )
    both = [claim_of(), claim_of(drivers=("q1",))]
    assert unlisted.find_right(both, truth) == (True, True)
    assert unlisted.find_right(both[:1], truth) == (True, False)
    assert unlisted.find_right([claim_of(drivers=("q1", "q4", "q5"))], truth) == (True, False)
    assert unlisted.find_right([], truth) == (False, False)
    sure = claim_of(at_place=False)
    assert unlisted.find_right([*both, sure], truth) == (False, False)
    unsure = claim_of(at_place=False, probability=0.5)
    assert unlisted.find_right([*both, unsure], truth) == (True, True)


def test_a_joint_that_does_not_repeat_tells_the_place() -> None:
    truth = Truth(frozenset(((4, "rz"),)))
    parts = ("instrument", "lasting", "joint 4")
    assert unlisted.is_told_as_part([], parts, truth)
    assert not unlisted.is_told_as_part([], parts[:2], truth)
    assert not unlisted.is_told_as_part([], ("joint 3",), truth)
    sure = claim_of(at_place=False)
    assert not unlisted.is_told_as_part([sure], parts, truth)
    unsure = replace(sure, probability=0.5)
    assert unlisted.is_told_as_part([unsure], parts, truth)
    assert not unlisted.is_told_as_part([claim_of()], parts, truth)  # a finding tells it


def test_what_does_not_repeat_may_be_told_by_the_budget_alone() -> None:
    """A joint that sticks at random does not repeat; one with a saw does."""
    told = replace(study_of(0, line="stiction"), place=False, as_part=True)
    assert told.place_right
    assert not replace(told, line="sawtooth").place_right
    assert not replace(told, as_part=False).place_right
    assert runner.interval(1, 1) in unlisted.tabulate_kind("stiction", [told])


def test_a_claim_is_judged_where_it_acts() -> None:
    """A link that bends is told at the axis of the next joint alone."""
    at = load_robot("puma760")
    bending = mechanism("link-bending:3", at)
    short = unlisted.keep_places(bending, {(4, "rz")})
    assert unlisted.find_places(short) == {(4, "rz")}
    assert unlisted.find_places(bending) > {(4, "rz")}


def study_of(number: int, *claims: unlisted.Claim, line="cable", error=0.02) -> unlisted.Study:
    values = tuple((c.name, c.level, c.probability, c.right, c.at_place, c.drivers) for c in claims)
    return unlisted.Study(
        line,
        number,
        "ur5",
        "",
        40,
        values,
        ("joint 2",),
        True,
        False,
        False,
        1e-9,
        1e-5,
        error,
        0.01,
        1.0,
    )


def test_table() -> None:
    """Only what is sure and false, and a cause or a shape, counts as falsely named."""
    studies = [
        study_of(0, claim_of()),
        study_of(1, claim_of("shape")),
        study_of(2, claim_of(right=True), claim_of("place")),
        study_of(3, claim_of(probability=0.9)),
    ]
    line = unlisted.tabulate_kind("cable", studies)
    assert runner.interval(1, 4) in line
    assert runner.interval(2, 4) in line
    assert runner.interval(4, 4) in line  # places
    assert "2.000 2.000 2.00" in line
    said = "\n".join(unlisted.tabulate_claims(studies))
    assert runner.interval(1, 4) in said
    names = [replace(claim_of(), name=f"settle:{j}") for j in (3, 1, 2)]
    exact = [study_of(0, *names, line="lag-123"), study_of(1, *names[:2], line="lag-123")]
    assert runner.interval(1, 2) in unlisted.tabulate_exact("lag-123", exact)
    text = unlisted.tabulate([*studies, *exact], "python -m")
    assert text.startswith("python -m")
    assert "joint 2 4" in text  # parts of the errors
    told = [replace(studies[0], place=False, as_part=True), replace(studies[1], place=False)]
    either = unlisted.tabulate_places([*told, *studies[2:]])
    assert either.endswith(f"{runner.interval(3, 4)} of 4")
    assert either in unlisted.tabulate([*told, *studies[2:]], "")


@dataclass(frozen=True)
class Ran:
    line: str
    number: int
    names: tuple[tuple[str, float], ...]


def run_ran(job: runner.Job) -> Ran:
    name, seed, number = job
    return Ran(name, number, ((f"seed {seed}", 0.5),))


def test_a_run_goes_on_from_what_it_kept(tmp_path) -> None:
    keep = tmp_path / "kept.jsonl"
    given = ["--studies", "1", "--seed", "7", "--keep", str(keep)]
    asked = runner.build_parser("words", ["a", "b"], 5, 1).parse_args(given)
    first = runner.run_lines(asked, ["a", "b"], Ran, run_ran)
    assert [(s.line, s.number) for s in first] == [("a", 0), ("b", 0)]
    more = ["--studies", "2", *given[2:]]
    asked = runner.build_parser("words", ["a", "b"], 5, 1).parse_args(more)
    keep.write_text(keep.read_text().replace("seed 7", "kept"))
    again = runner.run_lines(asked, ["a", "b"], Ran, run_ran)
    assert [s.names[0][0] for s in again] == ["kept", "seed 7", "kept", "seed 7"]
    assert runner.name_command("noise", asked, ["a", "b"]) == (
        "python -m benchmarks.noise --studies 2 --seed 7"
    )


def test_lag_and_saw_without_geometry() -> None:
    """Formulas by hand: a share of the last move stays behind; a saw goes from -1 to 1."""
    rng = np.random.default_rng(0)
    body = arm(load_robot("ur5"), rng)
    state = State(body, body.draw(rng, 200))
    lag = draw_lag(rng, body).parts[0].perturbation(state)[0]
    assert not lag[0].any()
    np.testing.assert_allclose(lag[5, 2, 5], state.q[4, 2] - state.q[5, 2])
    saw: Plant = draw_sawtooth(rng, body)
    values = saw.parts[0].perturbation(state)[0][:, :, 5]
    values = values[:, np.abs(values).any(0)][:, 0]
    assert -1 <= values.min() < -0.9 < 0.9 < values.max() <= 1
    j = int(saw.words.split(",")[0].split()[-1])
    shifted = replace(state, q=state.q + 2 * np.pi / saw.teeth * np.eye(6)[j - 1])
    again = saw.parts[0].perturbation(shifted)[0][:, j - 1, 5]
    np.testing.assert_allclose(again, values, atol=1e-9)
    assert find_truth(saw, state, rng).needed == {f"q{j}"}
