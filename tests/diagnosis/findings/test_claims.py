"""A finding claims as much as is proven: the cause where a registered mechanism is planted, no more
than the drivers where something else is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from builders import drawn, seeds
from hidden_arm import Arm, State, arm, measured
from hidden_arm import Effect as Planted
from hidden_effects import at, together

from modelsel._typing import Array
from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.candidates.signatures import LEVELS, PROVEN, read_signatures
from modelsel.diagnosis.findings.claim_sentences import (
    describe_claim,
    describe_levels,
    describe_proven,
    describe_what,
    is_settled,
    list_likelier,
    name_drivers,
    name_places,
)
from modelsel.diagnosis.findings.claims import build_claim, weigh_own_functions
from modelsel.diagnosis.findings.effects import Claim, Effect
from modelsel.diagnosis.findings.outcome import Diagnosis
from modelsel.diagnosis.findings.sentences import label_effect
from modelsel.diagnosis.inference.credible_sets import CredibleSet, Entry
from modelsel.diagnosis.procedure import diagnose
from modelsel.diagnosis.rivals.finding_groups import list_finding_groups
from modelsel.diagnosis.rivals.unlisted_shapes import (
    CHANGING,
    MORE_DRIVERS,
    UNLISTED_ODDS,
    Price,
    list_rivals,
)
from modelsel.diagnosis.search.mechanism_families import find_families
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.diagnosis.shapes.shape_constants import find_own_wave
from modelsel.diagnosis.shapes.unregistered import build_wave
from modelsel.fitting.design import Model
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.causes import Bump, Named, cos, q, sin, torque
from modelsel.mechanisms.environment import tracker_bumped, tracker_step
from modelsel.mechanisms.registry import build_faults, every, mechanism
from modelsel.mechanisms.terms import Mechanism, Screw, Term
from modelsel.results.runs.finding_records import find_fitted
from modelsel.robot.files import load_robot

SIGMA = 0.05
ROBOTS = ("puma760", "ur10e", "irb120")
Values = Callable[[State], Array]


def plant(
    robot: str,
    rng: np.random.Generator,
    *turns: tuple[int, Values],
    times: float = 8.0,
    m: int = 80,
) -> Problem:
    """`m` configurations of an arm whose joints turn by more than they read, by so many `times` the
    noise at the farthest, through the tests' own exact kinematics."""
    body: Arm = arm(load_robot(robot), rng, (40.0, -25.0, 100.0))
    state = State(body, body.draw(rng, m), {})
    exact = measured(body, state, ())
    parts = []
    for joint, values in turns:
        term = together(at(joint, "rz", values))
        size = np.linalg.norm(move(body, state, term, 1e-4) - exact, axis=1).max() / 1e-4
        parts.append((term, times * SIGMA / size))
    for term, size in parts:
        exact = exact + move(body, state, term, size) - measured(body, state, ())
    noisy = exact + SIGMA * rng.standard_normal(exact.shape)
    return Problem(load_robot(robot), build_measurements(state.q, noisy), body.tool[None])


def move(body: Arm, state: State, term: object, size: float) -> Array:
    effect = Planted("planted", "", (term,), np.ones(1))  # type: ignore[arg-type]
    return measured(body, state, (effect.scaled(size),))


def claims_of(at: Problem) -> list[tuple[Effect, Claim]]:
    effects = diagnose(at, seed=1).effects
    assert all(effect.claim is not None for effect in effects)
    return [(effect, effect.claim) for effect in effects if effect.claim is not None]


# -- what is planted


UNLISTED: dict[str, tuple[int, Values, set[str]]] = {
    "growth of a step": (3, lambda s: s.progress * np.tanh(4 * s.q[:, 2]), {"q3", "progress"}),
    "creep": (5, lambda s: np.sqrt(s.progress) * s.q[:, 4], {"q5"}),
    "pull": (4, lambda s: np.tanh(s.q[:, 3]) * (1 + np.tanh(s.q[:, 0])), {"q4", "q1"}),
    "soft step": (3, lambda s: np.tanh(4 * s.q[:, 2]), {"q3"}),
    "friction that grows with the load": (
        2,
        lambda s: -np.sign(s.move[:, 1]) * np.abs(s.moment(2)[:, 2]),
        {"approach2", "torque2"},
    ),
}


@pytest.mark.slow
@seeds(1, 2)
@pytest.mark.parametrize("kind", UNLISTED)
def test_no_cause_is_claimed_of_what_no_list_has(kind: str, rng: np.random.Generator) -> None:
    joint, values, drivers = UNLISTED[kind]
    # of what grows from nothing the data show half as much
    times = 16.0 if "progress" in drivers else 8.0
    told = claims_of(plant(ROBOTS[int(rng.integers(3))], rng, (joint, values), times=times))
    assert told
    for effect, claim in told:
        if kind == "soft step" and effect.candidate.kind is CandidateKind.RAMP:
            continue  # that is what it is, but for the corners
        assert claim.level not in ("cause", "shape") or claim.probability < PROVEN, effect
    named = {name for effect, _ in told for name in effect.candidate.mechanism.names()}
    assert drivers <= named


SHAPES: dict[CandidateKind, Values] = {
    CandidateKind.GROWTH: lambda s: s.progress * np.sin(s.q[:, 2] + 0.4),
    CandidateKind.JUMP: lambda s: (s.q[:, 2] > np.quantile(s.q[:, 2], 0.4)).astype(float),
    CandidateKind.RAMP: lambda s: np.clip(s.q[:, 2] - np.quantile(s.q[:, 2], 0.45), -0.4, 0.4),
    CandidateKind.SOFT_LAG: lambda s: (
        -np.tanh(s.move[:, 2] / np.quantile(np.abs(s.move[:, 2]), 0.3))
    ),
    CandidateKind.PERIOD: lambda s: np.sin(6 * s.q[:, 2]) + 0.7 * np.sin(12 * s.q[:, 2] + 2.0),
    CandidateKind.SAW: lambda s: np.mod(6 * s.q[:, 2] + 0.9, 2 * np.pi) / np.pi - 1,
    CandidateKind.POWER: lambda s: s.moment(3)[:, 2] * np.abs(s.moment(3)[:, 2]),
    CandidateKind.PULL: lambda s: np.maximum(s.q[:, 1] - np.quantile(s.q[:, 1], 0.45), 0) ** 2,
}


@pytest.mark.slow
@seeds(1, 2)
@pytest.mark.parametrize("kind", SHAPES)
def test_a_shape_without_a_cause_is_told_as_what_it_is(
    kind: CandidateKind, rng: np.random.Generator
) -> None:
    told = claims_of(plant(ROBOTS[int(rng.integers(3))], rng, (3, SHAPES[kind]), times=12.0))
    effect, claim = told[0]
    assert effect.candidate.kind is kind
    assert set(effect.candidate.mechanism.names_by_place()) == {(3, "rz")}
    assert claim.level in ("drivers", "shape")


@pytest.mark.slow
@seeds(1, 2, 3)
def test_two_proportional_errors_of_a_joint_are_no_product(rng: np.random.Generator) -> None:
    """The product of two readings was told, which holds either by itself, with a size of zero."""
    sign = rng.choice([-1.0, 1.0])
    turns = [(5, lambda s: s.q[:, 3]), (5, lambda s: sign * s.q[:, 4])]
    at = plant(str(rng.choice(ROBOTS)), rng, *turns, times=rng.uniform(6, 12), m=100)
    told = {effect.candidate.label for effect, _ in claims_of(at)}
    assert told == {"wrist-coupling:5", "encoder-scale:5"}


@pytest.mark.slow
@seeds(1, 2, 3)
def test_a_wave_of_any_number_is_one_wave(rng: np.random.Generator) -> None:
    """Between the numbers that are looked for: it was told with the nearest of them, beside a second
    wave or a joint that does not repeat."""
    count = int(rng.integers(6, 30)) + rng.uniform(0.3, 0.7)
    joint = int(rng.choice([1, 4]))
    turned = (joint, lambda s: np.sin(count * s.q[:, joint - 1] + 1.0))
    at = plant(str(rng.choice(ROBOTS)), rng, turned, times=12.0, m=200)
    ((effect, claim),) = claims_of(at)
    assert claim.level == "shape"
    told, own = find_own_wave(effect.candidate.mechanism)
    assert told == joint
    assert own == pytest.approx(count, abs=0.06)


@pytest.mark.slow
@seeds(1, 2, 3)
def test_a_saw_is_no_joint_that_does_not_repeat(rng: np.random.Generator) -> None:
    """Of few configurations a wave holds too little of a saw to be preferred."""
    joint, teeth, begin = int(rng.integers(2, 5)), int(rng.integers(3, 9)), rng.uniform(0, 6)

    def saw(s: State) -> Array:
        return np.mod(teeth * s.q[:, joint - 1] + begin, 2 * np.pi) / np.pi - 1

    at_ = plant(ROBOTS[int(rng.integers(3))], rng, (joint, saw), times=12.0, m=40)
    found: Diagnosis = diagnose(at_, seed=1)
    assert f"joint {joint}" not in found.errors.names
    (effect,) = found.effects
    assert effect.candidate.kind is CandidateKind.SAW
    assert set(effect.candidate.mechanism.names_by_place()) == {(joint, "rz")}


@pytest.mark.slow
@seeds(1, 2)
@pytest.mark.parametrize(
    ("name", "joint", "values"),
    [
        ("encoder-scale:4", 4, lambda s: s.q[:, 3]),
        ("gear-eccentricity:3", 3, lambda s: np.sin(s.q[:, 2] + 0.7)),
        ("wrist-coupling:5", 5, lambda s: s.q[:, 3]),
        ("approach-backlash:3", 3, lambda s: -np.sign(s.move[:, 2])),
    ],
)
def test_the_cause_is_claimed_of_what_the_registry_has(
    name: str, joint: int, values: Values, rng: np.random.Generator
) -> None:
    told = claims_of(plant(ROBOTS[int(rng.integers(3))], rng, (joint, values), times=16.0))
    own = [claim for effect, claim in told if effect.candidate.label == name]
    assert [claim.level for claim in own] == ["cause"]


@pytest.mark.slow
@seeds(1, 2, 3)
def test_joints_that_lag_are_named_one_by_one(rng: np.random.Generator) -> None:
    shares = rng.uniform(0.4, 1.0, 3)
    turns = [
        (j, lambda s, j=j, k=k: -k * s.move[:, j - 1])
        for j, k in zip((1, 2, 3), shares, strict=True)
    ]
    at_ = plant(ROBOTS[int(rng.integers(3))], rng, *turns)
    found: Diagnosis = diagnose(at_, seed=1)
    assert sorted(e.candidate.label for e in found.effects) == ["settle:1", "settle:2", "settle:3"]


# -- what is weighed


def small(rng: np.random.Generator) -> Problem:
    return plant("puma760", rng, (3, lambda s: s.q[:, 2]))


def single(place: tuple[int, str], *causes: object, prior: float = 0.01) -> Candidate:
    terms = tuple(Term(f"m{k}", (Screw(*place, c),)) for k, c in enumerate(causes))  # type: ignore[arg-type]
    return Candidate(Mechanism("own", terms), CandidateKind.CELL, prior)


@seeds(1)
def test_a_direction_stands_against_its_products_with_a_load_and_with_functions_of_joints(
    rng: np.random.Generator,
) -> None:
    at_ = small(rng)
    own = single((3, "rz"), Named("approach3"))
    drivers = [
        frozenset(rival.candidate.mechanism.names())
        for rival in list_rivals(at_, own)
        if rival.agrees == "place"
    ]
    assert frozenset({"approach3", "torque3"}) in drivers
    assert {frozenset({"approach3", f"q{j}"}) for j in range(1, 7)} <= set(drivers)
    for other in (((1, "rz"), "approach1"), ((3, "rx"), "approach3"), ((3, "rz"), "approach2")):
        place, name = other
        names = [
            one.candidate.mechanism.names() for one in list_rivals(at_, single(place, Named(name)))
        ]
        assert not any(f"torque{place[0]}" in one for one in names)


@seeds(1)
def test_unlisted_shapes_are_half_as_probable_as_what_is_listed_of_the_same(
    rng: np.random.Generator,
) -> None:
    at_ = small(rng)
    own = single((3, "rz"), q(3))
    price = Price(rng.uniform(0.001, 0.01), rng.uniform(1e-5, 1e-3))
    rivals = list_rivals(at_, own, price)
    assert {r.agrees for r in rivals} == {"drivers", "place", ""}
    priors: dict[tuple[str, object, frozenset[str]], float] = {}
    for rival in rivals:
        mechanism = rival.candidate.mechanism
        (place,) = mechanism.names_by_place()
        assert (place == (3, "rz")) == (rival.agrees != "")
        question = rival.agrees, place, mechanism.names()
        priors[question] = priors.get(question, 0.0) + rival.candidate.prior
    (alike,) = (key for key in priors if key[0] == "drivers")
    assert alike[2] == {"q3"}
    assert priors.pop(alike) == pytest.approx(UNLISTED_ODDS * price.finding)
    # the finding's own shape may change, with some further driver or along the campaign
    changing = [key for key in priors if key[0] == "place" and "q3" in key[2]]
    assert len(changing) == 6
    changes = sum(priors.pop(key) for key in changing)
    expected = MORE_DRIVERS * price.finding + CHANGING * own.prior
    assert changes == pytest.approx(expected)
    assert len(priors) > 30
    assert list(priors.values()) == pytest.approx([UNLISTED_ODDS * price.cell] * len(priors))


@seeds(1)
def test_a_finding_of_two_drivers_stands_against_either_and_against_both_elsewhere(
    rng: np.random.Generator,
) -> None:
    at_ = small(rng)
    both = frozenset({"q2", "q5"})
    rivals = list_rivals(at_, single((3, "rz"), Named("q2", "rad") * Named("q5", "rad")))
    of_place = {r.candidate.mechanism.names() for r in rivals if r.agrees == "place"}
    assert {frozenset({"q2"}), frozenset({"q5"})} <= of_place
    elsewhere = [r.candidate.mechanism for r in rivals if r.agrees == ""]
    places = {place for m in elsewhere if m.names() == both for place in m.names_by_place()}
    assert {(2, "rz"), (4, "rz")} <= places


@seeds(1)
def test_what_a_study_lists_has_no_rivals(rng: np.random.Generator) -> None:
    at_ = small(rng)
    asked = Candidate(single((3, "rz"), q(3)).mechanism, CandidateKind.MECHANISM, 0.01, asked=True)
    assert list_rivals(at_, asked) == []
    assert list_finding_groups(at_, {0: asked, 1: asked}) == []


@seeds(1)
def test_findings_of_one_place_are_weighed_together(rng: np.random.Generator) -> None:
    at_ = small(rng)
    effects = {
        4: single((3, "rz"), torque(3)),
        7: single((3, "rz"), q(1)),
        9: single((2, "rz"), q(1)),
        11: single((3, "rz"), q(3)),
    }
    groups = {one.members: one for one in list_finding_groups(at_, effects)}
    assert (4, 7) in groups
    assert all(9 not in members for members in groups)
    # one joint's own angle is weighed elsewhere, three drivers are too many for a free shape
    assert (11,) not in groups
    kinds = {shape.kind for shape in groups[4, 7, 11].shapes}
    assert kinds == {CandidateKind.POWER}


def test_signatures_agree_level_by_level() -> None:
    wave = [sin(q(2)), cos(q(2))]
    found = [
        single((3, "rz"), *wave),
        single((3, "rz"), *wave[::-1]),
        single((3, "rz"), q(2)),
        single((4, "rz"), q(2)),
        Candidate(single((3, "rz"), q(2)).mechanism, CandidateKind.SHAPE, 0.1),
    ]
    place, drivers, shape, cause = read_signatures(found)
    assert list(place == place[0]) == [True, True, True, False, True]
    assert list(drivers == drivers[0]) == [True, True, True, False, True]
    assert list(shape[:4] == shape[0]) == [True, True, False, False]
    assert shape[4] == -1
    assert (cause == -1).all()


def test_waves_of_about_one_number_have_one_shape() -> None:
    waves = [build_wave(3, count) for count in (14.25, 14.31, 14.75)]
    found = [Candidate(one, CandidateKind.JOINT_WAVE, 0.1) for one in waves]
    shape = read_signatures(found)[LEVELS.index("shape")]
    assert list(shape == shape[0]) == [True, True, False]


def test_two_waves_of_a_joint_may_be_one_between(rng: np.random.Generator) -> None:
    """Of one joint's own functions only waves are weighed together."""
    at = drawn("puma760", rng, 40)
    waves = {g: build_wave(3, count) for g, count in ((1, 9.25), (5, 10.0))}
    found = {g: Candidate(one, CandidateKind.JOINT_WAVE, 0.1) for g, one in waves.items()}
    found[8] = Candidate(mechanism("encoder-scale:3", at.robot), CandidateKind.MECHANISM, 0.1)
    together = {one.members: one for one in list_finding_groups(at, found)}
    shapes = together[1, 5].shapes
    assert {shape.kind for shape in shapes} == {CandidateKind.JOINT_WAVE}
    numbers = sorted(find_own_wave(shape.mechanism)[1] for shape in shapes)
    assert 9.0 < numbers[0] < 9.25 < numbers[-1] < 10.25
    scale_and_eccentricity = {1: found[8], 2: single((3, "rz"), sin(q(3)), cos(q(3)))}
    assert not list_finding_groups(at, scale_and_eccentricity)


def test_two_names_of_one_move_say_the_same(rng: np.random.Generator) -> None:
    """A bumped tracker and a step of it, of any moment: each was told with half of the probability."""
    at = load_robot("irb120")
    share = int(rng.integers(1, 200)) / 200
    bumped, moved = tracker_bumped(at, share), tracker_step(at, share)
    other = mechanism("encoder-scale:2", at)
    found = [Candidate(one, CandidateKind.MECHANISM, 0.1) for one in (bumped, moved, other)]
    for known in read_signatures(found):
        assert known[0] == known[1] >= 0
        assert known[0] != known[2]
    assert bumped.sentence == moved.sentence


def test_the_shape_of_a_part_of_a_joints_own_function_is_proven_with_the_others_alone(rng) -> None:
    """The others of another joint, of other drivers, or small beside it, take nothing from it."""
    at_ = plant("puma760", rng)
    found = [
        single((3, "rz"), q(3)),
        single((3, "rz"), sin(3.0 * q(3))),
        single((3, "rz"), sin(2.0 * q(3))),
        single((4, "rz"), q(4)),
        single((3, "rz"), q(2)),
    ]
    size = {0: 1.0, 1: 0.5, 2: 0.2, 3: 1.0, 4: 1.0}
    search = SimpleNamespace(
        problem=at_,
        candidates=found,
        traits=SimpleNamespace(signatures=read_signatures(found)),
        compute_displacement=lambda g, _: np.array([size[g]]),
    )
    levels = {g: np.array([1.0, 1.0, p, p]) for g, p in enumerate((0.95, 0.3, 0.1, 0.4, 0.2))}
    shares = weigh_own_functions(search, None, [0, 1, 2, 3, 4], levels)
    assert shares == {0: 0.3, 1: 0.1, 2: 0.3}


def test_families_are_sums_of_single_joints() -> None:
    robot = load_robot("puma760")
    found = [
        Candidate(m, CandidateKind.MECHANISM, 0.01) for m in (*build_faults(robot), *every(robot))
    ]
    families = {
        found[one.whole].label: sorted(found[g].label for g in one.parts)
        for one in find_families(found)
    }
    assert families["fault:read-too-early"] == [f"settle:{j}" for j in range(1, 7)]
    assert families["gravity-twist"] == ["joint2-twist", "joint3-twist"]


def test_a_product_of_readings_holds_either_by_itself(rng: np.random.Generator) -> None:
    """One reading alone is no case of the product."""
    at_ = drawn("puma760", rng, 40)
    robot = at_.robot
    base = Model((mechanism("geometric", robot),))
    found = build_candidates(at_, base, every(robot))
    products = {found[one.whole].label: one for one in find_families(found) if one.one_place}
    family = products["frame 5 rz · q4 times q5"]
    assert {found[g].label for g in family.parts} == {"wrist-coupling:5", "encoder-scale:5"}
    assert all(found[g].kind is CandidateKind.PRODUCT for g in (f.whole for f in products.values()))
    first, second = family.parts
    assert family.list_chosen([first]) == []
    assert family.list_chosen([first, second]) == [first, second]
    assert family.list_chosen([family.whole, -1]) == [family.whole]


# -- what is said


def effect_of(candidate: Candidate, *levels: float) -> Effect:
    count = len(candidate.mechanism.terms)
    held = [name for name, p in zip(LEVELS, levels, strict=True) if p >= PROVEN]
    numbers = np.full(count, 1e-3)
    entry = Entry(candidate, levels[-1], True, numbers, 0)
    named = CredibleSet(10.0, (entry,), 0, "found", np.zeros(1), 0)
    claim = Claim(held[-1] if held else "place", levels)
    return Effect(candidate, named, 0.001, numbers, numbers / 10, claim=claim)


def test_a_claim_says_no_more_than_is_proven() -> None:
    robot = load_robot("puma760")
    uneven = Candidate(mechanism("gear-eccentricity:3", robot), CandidateKind.MECHANISM, 0.01)
    sure = effect_of(uneven, 1.0, 0.99, 0.98, 0.95)
    assert "unevenly" in describe_proven(sure)
    doubtful = effect_of(uneven, 1.0, 0.99, 0.4, 0.4)
    claimed = describe_claim(doubtful)
    assert claimed is not None
    assert claimed.level == "drivers"
    assert claimed.probability == 0.99
    assert "joint 3" in claimed.text
    assert "unevenly" not in claimed.text
    assert describe_proven(doubtful).startswith(claimed.text)
    assert [one.level for one in describe_levels(doubtful)] == list(LEVELS)


def test_a_sentence_has_one_probability_of_each_level() -> None:
    """That of what is claimed, and beside the name that of the name, though it is alone on its list."""
    robot = load_robot("puma760")
    uneven = Candidate(mechanism("gear-eccentricity:3", robot), CandidateKind.MECHANISM, 0.01)
    partly = effect_of(uneven, 0.99, 0.989, 0.888, 0.888)
    listed = replace(partly.named.entries[0], probability=0.989)
    partly = replace(partly, named=replace(partly.named, entries=(listed,)))
    assert not is_settled(partly)
    said = describe_proven(partly)
    assert "probability 0.99 for the drivers); it could be gear-eccentricity:3 (0.89)" in said
    doubted = describe_proven(partly, "doubtful (0.01 mm rms more)")
    assert "for the drivers), doubtful (0.01 mm rms more); it could be" in doubted
    whole = effect_of(uneven, 1.0, 0.99, 0.98, 0.95)
    assert "(gear-eccentricity:3, probability 0.95)" in describe_proven(whole)
    one_joint = replace(partly, claim=replace(partly.claim, moves_joints=True))
    assert describe_proven(one_joint).startswith(
        "Joint 3 is off its reading, depending on its own reading; how is not proven"
    )


def test_a_size_is_told_with_the_name_that_it_is_of() -> None:
    """Where another name is likelier than the fitted one, that one leads the list."""
    robot = load_robot("puma760")
    uneven = Candidate(mechanism("gear-eccentricity:3", robot), CandidateKind.MECHANISM, 0.01)
    other = Candidate(mechanism("encoder-scale:3", robot), CandidateKind.MECHANISM, 0.01)
    effect = effect_of(uneven, 0.99, 0.98, 0.4, 0.4)
    own = effect.named.entries[0]
    entries = (replace(own, candidate=other, probability=0.58), own)
    likelier = replace(effect, named=replace(effect.named, entries=entries))
    assert list_likelier(likelier) == ["encoder-scale:3"]
    assert "(fitted as gear-eccentricity:3: amplitude " in describe_proven(likelier)
    assert "encoder-scale:3 (0.58) or gear-eccentricity:3 (0.40)" in describe_proven(likelier)
    unlikely = replace(entries[0], probability=0.3)
    less = replace(effect, named=replace(effect.named, entries=(own, unlikely)))
    assert list_likelier(less) == []
    assert "fitted as" not in describe_proven(less)
    assert find_fitted(likelier) == 1
    assert find_fitted(less) == 0


def test_a_cause_is_not_told_where_not_even_its_place_is_proven() -> None:
    robot = load_robot("puma760")
    uneven = Candidate(mechanism("gear-eccentricity:3", robot), CandidateKind.MECHANISM, 0.01)
    open_effect = effect_of(uneven, 0.88, 0.87, 0.54, 0.54)
    said = describe_proven(open_effect)
    assert said.startswith("What moves is not proven: gear-eccentricity:3 (0.54) (")
    assert "probability 0.88 for the place" in said
    assert "it could be" not in said
    assert "unevenly" not in describe_what(open_effect)
    untold = replace(open_effect, named=replace(open_effect.named, verdict="cannot be told apart"))
    assert describe_proven(untold) == said
    assert describe_what(untold) == describe_what(open_effect)


def test_what_is_likelier_than_the_names_is_told_as_something_else() -> None:
    """Where sets of effects hold most of the probability one name stood there with 0.18."""
    robot = load_robot("puma760")
    uneven = Candidate(mechanism("gear-eccentricity:3", robot), CandidateKind.MECHANISM, 0.01)
    unlikely = describe_proven(effect_of(uneven, 0.57, 0.18, 0.18, 0.18))
    # what its place holds beyond the name is no chance
    assert (
        "not proven: gear-eccentricity:3 (0.18), something else at the place of the first (0.39) or "
        "something else, or chance (0.43) (" in unlikely
    )
    nowhere = describe_proven(effect_of(uneven, 0.18, 0.18, 0.18, 0.18))
    assert "gear-eccentricity:3 (0.18) or something else, or chance (0.82) (" in nowhere
    assert "something else" not in describe_proven(effect_of(uneven, 0.88, 0.87, 0.54, 0.54))


def test_what_a_place_holds_is_told_beside_its_names() -> None:
    """A finding was told with 0.88 for its place, and with 0.86 for something else or chance."""
    robot = load_robot("puma760")
    uneven = Candidate(mechanism("gear-eccentricity:3", robot), CandidateKind.MECHANISM, 0.01)
    other = Candidate(mechanism("axis-wobble:2", robot), CandidateKind.MECHANISM, 0.01)
    effect = effect_of(uneven, 0.88, 0.13, 0.13, 0.13)
    first = effect.named.entries[0]
    second = replace(first, candidate=other, probability=0.01)
    said = describe_proven(replace(effect, named=replace(effect.named, entries=(first, second))))
    assert (
        "gear-eccentricity:3 (0.13), axis-wobble:2 (0.01), something else at the place of the first "
        "(0.75) or something else, or chance (0.11) (" in said
    )
    assert "probability 0.88 for the place" in said


def test_names_that_move_alike_are_together_as_probable_as_the_name_is_told() -> None:
    """The listed probabilities are scaled to the level that is told, and so is their sum."""
    robot = load_robot("puma760")
    uneven = Candidate(mechanism("gear-eccentricity:3", robot), CandidateKind.MECHANISM, 0.01)
    other = Candidate(mechanism("encoder-scale:3", robot), CandidateKind.MECHANISM, 0.01)
    effect = effect_of(uneven, 0.99, 0.98, 0.96, 0.92)
    first = replace(effect.named.entries[0], probability=0.96)
    twin = replace(first, candidate=other, probability=0.04)
    effect = replace(effect, named=replace(effect.named, entries=(first, twin)))
    said = describe_proven(effect)
    assert (
        "probability 0.92; encoder-scale:3 would move the target in the same way, together 0.96)"
        in said
    )


def test_one_of_several_effects_of_a_name_has_its_number() -> None:
    """As the ladder has it; constants of one name are one rival."""
    robot = load_robot("puma760")
    uneven = Candidate(mechanism("gear-eccentricity:3", robot), CandidateKind.MECHANISM, 0.01)
    other = Candidate(mechanism("encoder-scale:3", robot), CandidateKind.MECHANISM, 0.01)
    second = replace(effect_of(uneven, 0.99, 0.98, 0.5, 0.5), number=2)
    first = replace(second.named.entries[0], probability=0.3)
    rivals = (first, replace(first, candidate=other), replace(first, probability=0.2))
    second = replace(second, named=replace(second.named, entries=rivals))
    assert label_effect(second) == "gear-eccentricity:3 (2)"
    assert "it could be gear-eccentricity:3 (2) (0.50) or encoder-scale:3 (0.30);" in (
        describe_proven(second)
    )
    named = replace(second.named, verdict="cannot be told apart")
    open_name = replace(second, named=named, claim=None)
    assert "(gear-eccentricity:3 0.50, encoder-scale:3 0.30)" in describe_proven(open_name)


def test_drivers_and_places_in_words() -> None:
    assert name_drivers({"q4", "q1"}) == "the reading of joint 1 and the reading of joint 4"
    assert name_drivers({"torque2"}) == "the gravity torque about joint 2"
    assert name_drivers({"progress"}) == "the course of the campaign"
    assert name_drivers({"spindle_kW", "temperature_C"}) == (
        "the column spindle_kW and the temperature"
    )
    shifts = single((5, "ty"), Bump("q2", 0.0, 0.5))
    assert name_places(effect_of(shifts, 0.99, 0.5, 0.1, 0.1)) == "Frame 5 shifts along its y axis"


@pytest.mark.parametrize(
    ("slides", "place", "driver", "words"),
    [
        (False, (2, "rz"), "q2", "Joint 2 is off its reading"),
        (False, (2, "rz"), "q4", "Joint 2 is off its reading"),
        (
            False,
            (2, "tz"),
            "q2",
            "Frame 2 shifts along its z axis (frame 3 or 4 would move the target alike)",
        ),
        (False, (7, "rz"), "q2", "Frame 7 turns about its z axis"),
        (True, (2, "tz"), "torque2", "Joint 2 is off its reading"),
        (
            True,
            (2, "tz"),
            "q3",
            "Joint 2 is off its reading (frame 3 or 4 would move the target alike)",
        ),
        (True, (2, "rz"), "q2", "Frame 2 turns about its z axis"),
        (
            False,
            (1, "rz"),
            "progress",
            "Joint 1 is off its reading (the instrument would move the target alike)",
        ),
        (
            True,
            (2, "tz"),
            "progress",
            "Joint 2 is off its reading (frame 3 or 4 would move the target alike)",
        ),
        (
            False,
            (1, "tz"),
            "progress",
            "Frame 1 shifts along its z axis (frame 2, or the instrument, would move the target alike)",
        ),
        (
            False,
            (1, "tx"),
            "progress",
            "Frame 1 shifts along its x axis (the instrument would move the target alike)",
        ),
        (
            False,
            (2, "tz"),
            "progress",
            "Frame 2 shifts along its z axis (frame 3 or 4 would move the target alike)",
        ),
    ],
)
def test_only_the_motion_of_a_joint_is_told_as_the_joints(
    slides: bool, place: tuple[int, str], driver: str, words: str, rng: np.random.Generator
) -> None:
    """A frame behind the last joint has none; a slide that turns is no slide off its reading. What depends
    on another joint may as well be of a frame that moves alike."""
    robot = load_robot("puma760")
    second = replace(robot.joints[1], prismatic=slides)
    robot = replace(robot, joints=(robot.joints[0], second, *robot.joints[2:]))
    readings = robot.draw(rng, 10)
    problem = Problem(robot, build_measurements(readings, np.zeros((10, 3))), np.zeros((1, 3)))
    candidate = single(place, sin(Named(driver)))
    claim = build_claim(problem, candidate, np.array([0.99, 0.4, 0.1, 0.1]))
    effect = replace(effect_of(candidate, 0.99, 0.4, 0.1, 0.1), claim=claim)
    assert name_places(effect) == words
    assert describe_proven(effect).startswith(f"{words}; what this depends on is not proven")


def test_a_torque_is_one_driver_whatever_masses_make_it() -> None:
    """Declared masses and unknown ones are one mechanism, and so are their place and drivers."""
    robot = load_robot("puma760")
    built = [one for one in every(robot) if one.name == "joint-compliance:4"]
    found = [Candidate(one, CandidateKind.MECHANISM, 0.1) for one in built]
    assert len(found) == 2
    for known in read_signatures(found):
        assert known[0] == known[1] >= 0


def test_a_level_holds_no_more_than_what_it_builds_on(rng: np.random.Generator) -> None:
    robot = load_robot("puma760")
    data = build_measurements(robot.draw(rng, 10), np.zeros((10, 3)))
    problem = Problem(robot, data, np.zeros((1, 3)))
    candidate = single((2, "rz"), sin(q(2)), cos(q(3)))
    claim = build_claim(problem, candidate, np.array([0.95, 0.8, 0.99, 0.97]))
    assert claim.levels == (0.95, 0.8, 0.8, 0.8)
    assert claim.level == "place"


@pytest.mark.parametrize(
    ("levels", "rest"),
    [
        ((0.99, 0.2, 0.2, 0.2), "something else there (0.80)"),
        ((0.99, 0.99, 0.2, 0.2), "another function of these (0.80)"),
        ((0.99, 0.99, 0.99, 0.2), "another cause of this shape (0.80)"),
    ],
)
def test_what_is_proven_is_not_told_to_be_chance(levels: tuple[float, ...], rest: str) -> None:
    """Of a drive whose drivers were proven with 1.00 it was said that it could be chance, with 1.00."""
    robot = load_robot("puma760")
    uneven = Candidate(mechanism("gear-eccentricity:3", robot), CandidateKind.MECHANISM, 0.01)
    assert f"it could be gear-eccentricity:3 (0.20) or {rest}" in describe_proven(
        effect_of(uneven, *levels)
    )
