"""A name has the sign that physics allows it: what is forbidden is not told as it, and the evidence
is that of half a prior.

Positions come from readings that are moved by the error, or from the chain of the robot files; the
evidence from integrals."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from builders import bind, drawn, measured, planted, seeds, small_arm, study_of
from scipy.integrate import quad
from searches import search_separated

from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.candidates.signatures import PROVEN
from modelsel.diagnosis.columns.candidate_columns import build_columns, stack_design
from modelsel.diagnosis.findings.effect_sentences import describe_effect
from modelsel.diagnosis.findings.effects import Effect
from modelsel.diagnosis.findings.sentences import label_effect, list_usual_causes
from modelsel.diagnosis.inference.credible_sets import CredibleSet
from modelsel.diagnosis.inference.evidence import compute_log_bayes_factors, normalise_strength
from modelsel.diagnosis.inference.scan import Scan, build_scan, compute_basis
from modelsel.diagnosis.inference.sign_constraints import find_contrary_terms
from modelsel.diagnosis.procedure import diagnose_split
from modelsel.diagnosis.separation import Inquiry
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.fitting.design import Model
from modelsel.fitting.least_squares import fit
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.registry import build_faults, build_mechanisms, every, mechanism
from modelsel.mechanisms.terms import Mechanism, Screw, Term
from modelsel.robot.files import builtin_names, load_robot
from modelsel.robot.gravity import compute_joint_torques, compute_unit_moments
from modelsel.robot.kinematics import Robot, forward, pose

ARM = load_robot("ur10")
BASE = Model((mechanism("geometric", ARM),))
TOOL, SIGMA = np.array([60.0, -40.0, 120.0]), 0.03
Array = np.ndarray


def named(
    position: Array, q: Array, rng: np.random.Generator, arm: Robot = ARM
) -> tuple[Effect, ...]:
    at = bind(arm, build_measurements(q, position, prismatic=arm.prismatic), TOOL)
    at = measured(at, at.data.position + rng.normal(0, SIGMA, position.shape))
    base = Model((mechanism("geometric", arm),))
    return diagnose_split(
        study_of(at), Inquiry(base, (*every(arm), *build_faults(arm)), 1, cells=True)
    )[1].effects


def turned(joint: int, by: Array, q: Array) -> Array:
    """Positions of the arm whose joint stands off its reading."""
    moved = q.copy()
    moved[:, joint - 1] += by
    return forward(ARM, moved, TOOL)


@cache
def offer() -> tuple[Candidate, ...]:
    """Every candidate, for tests that ask nothing of the rows they are made for."""
    return build_candidates(drawn(ARM, np.random.default_rng(1), 40), BASE, every(ARM))


def from_base(at: Problem) -> tuple[Scan, tuple[Candidate, ...], Array]:
    fitted, found = fit(at, BASE), offer()
    X, _ = stack_design(at, BASE.terms, fitted.at())
    Q = compute_basis(X[:, list(fitted.found.kept)])
    return build_scan(build_columns(at, found, fitted.at()), Q), found, Q


# -- the evidence
# -------------------------------------------------------------------------------------------------------------


@pytest.mark.integration
@seeds(1, 2)
@pytest.mark.parametrize("m", [15, 60])
def test_a_one_sided_term_has_the_evidence_of_half_a_normal_prior(
    rng: np.random.Generator, m: int
) -> None:
    """Against the integral over the coefficient b, the noise level integrated out: that of
    rss(b)^(-(ν+1)/2) on one side, twice, over that on both. From fits of the right sign to fits far
    on the wrong one."""
    seen, found, Q = from_base(drawn(ARM, rng, m))
    g = next(
        int(g)
        for g in seen.signed
        if found[g].label == "joint-compliance:2" and len(found[g].mechanism.terms) == 1
    )
    column = seen.columns.expand(g)[0]
    column = column - Q @ (Q.T @ column)
    column /= np.linalg.norm(column)
    noise = rng.normal(size=len(Q))
    noise -= Q @ (Q.T @ noise)
    noise -= column * (column @ noise)
    nu = seen.freedom
    for size in (-8.0, -5.0, -2.0, 0.0, 1.0, 4.0):
        y = noise + size * column
        total = float(y @ y)
        share = normalise_strength(seen.strength(seen.see(y).column), np.array([total]))
        for ratio in (3.0, 1e3):

            def density(
                b: float, ratio: float = ratio, size: float = size, total: float = total
            ) -> float:
                rss = total - 2 * b * size + b * b * (1 + 1 / ratio)
                return float((rss / total) ** (-(nu + 1) / 2))

            top = size / (1 + 1 / ratio)
            right = (
                quad(density, 0, np.inf, points=None, epsabs=0, limit=500)[0]
                if size <= 0
                else (quad(density, 0, top, epsabs=0)[0] + quad(density, top, np.inf, epsabs=0)[0])
            )
            width = np.sqrt(total / nu)
            whole = sum(
                quad(density, top + a * width, top + b * width, epsabs=0)[0]
                for a, b in ((-np.inf, -5), (-5, 0), (0, 5), (5, np.inf))
            )
            explained = size * size / total * ratio / (1 + ratio)
            both = -0.5 * np.log1p(ratio) - 0.5 * nu * np.log1p(-explained)
            got = float(compute_log_bayes_factors(seen, share, ratio)[g, 0])
            assert got == pytest.approx(both + np.log(2 * right / whole), abs=0.1), (
                size,
                ratio,
            )  # Wallace's
    y = noise - 300 * column
    share = normalise_strength(seen.strength(seen.see(y).column), np.array([y @ y]))
    assert (
        -20 < float(compute_log_bayes_factors(seen, share, 1e3)[g, 0]) < -3
    )  # however strong: worth less than no effect


@seeds(1, slow=(2,))
def test_of_several_terms_the_one_least_of_its_sign_counts(rng: np.random.Generator) -> None:
    """Its t is the one of the least-squares fit of the mechanism's columns beyond the model, at
    unit noise."""
    seen, found, Q = from_base(drawn(ARM, rng, 40))
    y = rng.normal(size=len(Q))
    y -= Q @ (Q.T @ y)
    root = seen.strength(seen.see(y).column).root[:, 0]
    checked = 0
    for g, got in zip(seen.signed, root, strict=True):
        terms = found[g].mechanism.terms
        if seen.sizes[g] < len(terms):
            continue
        A = seen.columns.expand(g).T
        A = A - Q @ (Q.T @ A)
        A /= np.linalg.norm(A, axis=0)
        covariance = np.linalg.inv(A.T @ A)
        t = covariance @ (A.T @ y) / np.sqrt(np.diag(covariance))
        assert got == pytest.approx(
            min(t[k] * term.sign for k, term in enumerate(terms) if term.sign), rel=1e-3, abs=1e-3
        )
        checked += len(terms) > 1
    assert checked > 3


# -- what is named
# ------------------------------------------------------------------------------------------------------------


@pytest.mark.long
@seeds(1, 2)
@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("kind", ["compliance", "play"])
def test_what_gravity_forbids_is_not_named_after_it(
    kind: str, sign: int, rng: np.random.Generator
) -> None:
    """A joint that yields with its gravity torque, and one that rises against it; play that gravity
    takes up, and its like."""
    q = ARM.draw(rng, 90)
    joint = int(rng.choice([2, 4]))
    torque = compute_joint_torques(ARM, pose(ARM, q, TOOL), q)[joint - 1]
    by = 1e-3 * torque / np.abs(torque).max() if kind == "compliance" else 4e-4 * np.sign(torque)
    effects = named(turned(joint, sign * by, q), q, rng)
    stems = {e.candidate.label.partition(":")[0] for e in effects}
    assert effects
    for e in effects:
        if e.candidate.registered:
            each = zip(e.candidate.mechanism.terms, e.estimate, e.standard_error, strict=True)
            assert not any(t.sign * v < -3 * s for t, v, s in each), describe_effect(e)
    expected = (
        {"backlash"} if kind == "play" else {"joint-compliance", "joint2-twist", "joint3-twist"}
    )
    assert bool(stems & expected) == (sign > 0), [describe_effect(e) for e in effects]
    if sign < 0:
        assert any(
            "would do the same with the opposite sign only, so this is not" in describe_effect(e)
            for e in effects
        )


@pytest.mark.long
@seeds(1, 2, 3)
@pytest.mark.parametrize(
    ("sign", "name", "words"),
    [
        (-1, "approach-backlash", "stops short of its reading"),
        (1, "overshoot", "rests past its reading"),
    ],
)
def test_play_is_short_of_the_reading_and_overshoot_past_it(
    sign: int, name: str, words: str, rng: np.random.Generator
) -> None:
    q, joint = ARM.draw(rng, 90), int(rng.integers(1, 6))
    last = np.sign(np.diff(q[:, joint - 1], prepend=q[0, joint - 1]))
    (effect,) = named(turned(joint, sign * 3e-4 * last, q), q, rng)
    assert effect.candidate.label == f"{name}:{joint}"
    assert words in describe_effect(effect)


@pytest.mark.parametrize(
    ("name", "sign", "label", "words"),
    [
        ("joint-compliance:2", 1, "joint-compliance:2", "Joint 2 winds up in proportion"),
        (
            "joint-compliance:2",
            -1,
            "joint-compliance:2 with the opposite sign",
            (
                "Frame 2 turns about its z axis (γ2) in proportion to the gravity torque about joint 2; "
                "joint-compliance:2 would have the opposite sign, so this is something else"
            ),
        ),
        ("settle:3", 1, "settle:3 with the opposite sign", "Joint 3 is past its reading"),
        ("settle:3", -1, "settle:3", "Joint 3 is short of its reading"),
        ("encoder-scale:3", 1, "encoder-scale:3", "Joint 3 moves more than its reading says"),
        ("encoder-scale:3", -1, "encoder-scale:3", "Joint 3 moves less than its reading says"),
        ("tracker-scale", 1, "tracker-scale", "Measured lengths are too long"),
        ("tracker-scale", -1, "tracker-scale", "Measured lengths are too short"),
    ],
)
def test_a_sign_that_physics_forbids_is_not_told_as_the_mechanism(name, sign, label, words) -> None:
    """Whatever fitted it so: neither its sentence, nor its bare name, nor the parts that cause it."""
    one = build_mechanisms(name, ARM)[0]
    candidate = Candidate(one, CandidateKind.MECHANISM, 1.0)
    named_alone = CredibleSet(1.0, (), 0, "found", np.zeros(1))
    effect = Effect(candidate, named_alone, 0.01, np.array([sign * 1e-5]), np.array([1e-7]))
    assert label_effect(effect) == label
    said = describe_effect(effect)
    assert said.startswith(words)
    assert f" ({label}, probability" in said
    assert (list_usual_causes(effect) == one.usual_causes) == (label == name)


def test_a_one_sided_mechanism_has_a_cell_without_a_name_beside_it(
    rng: np.random.Generator,
) -> None:
    """With the same screws; none beside a mechanism of either sign, nor where both signs have a
    name. A plug-in's, too."""
    cause = mechanism("joint-compliance:4", ARM).terms[0].screws[0].cause
    own = Mechanism("sag", (Term("s", (Screw(4, "rz", cause),), None, -1),))
    either = Mechanism("either", (Term("s", (Screw(5, "rx", cause),)),))
    two = mechanism("approach-backlash:2", ARM), mechanism("overshoot:2", ARM)
    found = build_candidates(drawn(ARM, rng, 20), BASE, (*two, own, either))

    def same(m: Mechanism) -> list[bool]:
        return [
            c.registered
            for c in found
            if [t.screws for t in c.mechanism.terms] == [t.screws for t in m.terms]
        ]

    assert same(own) == [True, False]
    assert same(either) == [True]
    assert same(two[0]) == [True, True]
    assert [c.but_for_sign for c in found if c.but_for_sign] == [(own,)]
    assert sum(c.prior for c in found) == pytest.approx(1.0)


@pytest.mark.parametrize("name", builtin_names())
def test_play_yields_to_gravity_as_a_spring_does(name: str) -> None:
    """The cause of every joint's play by gravity, times its sign, goes with the torque, that of a
    payload among it where the play has it."""
    arm = load_robot(name)
    rng = np.random.default_rng(3)
    q = arm.draw(rng, 200)
    payload = rng.choice([0.0, 1.0, 3.0], 200)
    positions = forward(arm, q, TOOL)
    at = bind(arm, build_measurements(q, positions, covariates={"payload_kg": payload}), TOOL)
    nominal = pose(arm, q, TOOL)
    torque = compute_joint_torques(arm, nominal, q)
    moments = compute_unit_moments(arm, nominal)
    for m in every(arm):
        if m.name.startswith("backlash:"):
            (term,), joint = m.terms, int(m.name.partition(":")[2])
            load = torque[joint - 1]
            if "payload_kg" in m.names():
                load = load + payload * moments[joint, arm.n + 1][2]
            side = term.sign * at.cause(term.screws[0].cause)
            assert np.mean(side * np.sign(load)) > 0.5


# -- what was moved, and arms with slides
# -----------------------------------------------------------------------------------


@pytest.mark.slow
@seeds(1, 2)
def test_a_target_that_was_moved_is_a_step_at_the_target_and_its_size_the_whole_move(
    rng: np.random.Generator,
) -> None:
    """1 mm across the flange, after 60 % of the campaign: it was told as a drift."""
    q = ARM.draw(rng, 100)
    move = rng.normal(size=3)
    move /= np.linalg.norm(move)
    position = forward(ARM, q, TOOL)
    position[60:] = forward(ARM, q, TOOL + move)[60:]
    (effect,) = named(position, q, rng)
    assert effect.candidate.label == "target-step"
    assert "The target stands elsewhere on the flange from about row 60 on" in describe_effect(
        effect
    )
    assert np.abs((effect.estimate - move) / effect.standard_error).max() < 4
    assert effect.standard_error.max() < 0.05


@pytest.mark.slow
def test_a_step_of_the_tracker_is_the_whole_move(rng: np.random.Generator) -> None:
    q = ARM.draw(rng, 100)
    move = np.array([0.5, -0.3, 0.4])
    position = forward(ARM, q, TOOL) + np.where(np.arange(100)[:, None] < 45, 0.0, move)
    (effect,) = named(position, q, rng)
    assert effect.candidate.label in ("tracker-step", "fault:tracker-bumped")
    turn = ARM.joints[0].before[:3, :3]
    assert np.abs(turn @ effect.estimate[:3] - move).max() < 5 * effect.standard_error[:3].max()


@pytest.mark.integration
@pytest.mark.parametrize(
    ("sign", "words"), [(1, "stand past their readings"), (-1, "are short of their readings")]
)
def test_an_arm_with_slides_that_is_read_too_early_is_told(
    sign: int, words: str, rng: np.random.Generator
) -> None:
    """All joints, turning and sliding, lack the same share of their last move: a number without a
    unit."""
    arm = replace(small_arm(prismatic=True), gravity=(0.0, 0.0, -1.0))
    q = arm.draw(rng, 120)
    lag = 2e-3 * sign * np.diff(q, axis=0, prepend=q[:1])
    effect = named(forward(arm, q + lag, TOOL), q, rng, arm)[0]
    assert effect.candidate.label == "fault:read-too-early"
    assert effect.candidate.mechanism.terms[0].unit == "1"
    assert effect.estimate[0] == pytest.approx(2e-3 * sign, abs=4 * effect.standard_error[0])
    assert words in describe_effect(effect)


def test_units_that_are_no_shares_still_differ() -> None:
    cause = mechanism("settle:1", ARM).terms[0].screws[0].cause
    with pytest.raises(ValueError, match="different units"):
        _ = Term("bad", (Screw(1, "rz", cause), Screw(1, "tz", cause))).unit


def test_one_term_of_several_with_a_forbidden_sign_is_told(rng: np.random.Generator) -> None:
    """Beyond what chance gives one of so many terms; a mechanism of one term needs less."""
    arm = load_robot("ur5e")
    bending = next(one for one in build_mechanisms("link-bending:1", arm) if len(one.terms) > 2)
    terms = len(bending.terms)
    error = rng.uniform(1e-6, 1e-5, terms)
    wrong = int(rng.integers(terms))
    estimate = 2 * error
    estimate[wrong] = -3.2 * error[wrong]
    assert find_contrary_terms(bending, estimate, error).nonzero()[0].tolist() == [wrong]
    estimate[wrong] = -2.1 * error[wrong]
    assert not find_contrary_terms(bending, estimate, error).any()
    alone = mechanism("payload-deflection:2", arm)
    assert find_contrary_terms(alone, np.array([-2.1]), np.ones(1)).all()
    assert not find_contrary_terms(alone, np.array([-1.8]), np.ones(1)).any()


@pytest.mark.integration
def test_a_cause_of_a_forbidden_sign_is_not_proven(rng: np.random.Generator) -> None:
    """However much likelier it is than what else was weighed."""
    arm = load_robot("ur5e")
    bending = next(one for one in build_mechanisms("link-bending:1", arm) if len(one.terms) > 2)
    base = Model((mechanism("geometric", arm),))
    levels = []
    for sign in (1, -1):
        size = np.full(len(bending.terms), 2e-5)
        size[0] *= 5 * sign
        at = planted(drawn(arm, rng, 80), bending.terms, size, rng, 0.03)
        found = build_candidates(at, base, [bending], cells=False)
        (effect,) = search_separated(at, base, found).effects
        assert effect.claim is not None
        levels.append(effect.claim.levels[-1])
    assert levels[0] > PROVEN
    assert levels[1] == 0.0
