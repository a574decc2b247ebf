"""Effects that the catalogue lacks: how often a cause is falsely named, and how much of the truth is.

    python -m benchmarks.unlisted --studies 20 --seed 31 --workers 2 --out benchmarks/results/unlisted.txt

Arms of the catalogue with geometric errors, 40 to 120 configurations, noise 0.05 mm a coordinate.
One effect of KINDS is planted through exact kinematics; the target's largest displacement by it is
1 to 8 times the noise, drawn (`--larger 3`: 3 to 24 times). Every study goes through outliers, parts of the errors and naming as
`modelsel study` does. benchmarks/unlisted_plants.py has the table of what is true of each kind. The
oracle has the true formula as one candidate more: it finds where its F test on the geometric base
is beyond the scan's own family-wise 5 %, and its fit of geometry and formula to the same data sets
the held-out error.

Jumps (an encoder's, a sawtooth's) have a line without them: between two readings the data say
nothing of where the formula jumps, which the oracle knows."""

from __future__ import annotations

import re
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from zlib import crc32

import numpy as np
from hidden_arm import Arm, Effect, State, arm, geometry, holds, measured, said
from hidden_oracle import critical_p
from scipy.special import betaincc

from modelsel import Model, mechanism
from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.columns.candidate_columns import build_columns, stack_design
from modelsel.diagnosis.findings.effects import Effect as Finding
from modelsel.diagnosis.inference.scan import build_scan, compute_basis
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.fitting.least_squares import Fit, fit
from modelsel.fitting.problem import Problem
from modelsel.mechanisms.causes import Named
from modelsel.mechanisms.registry import build_faults, every
from modelsel.mechanisms.terms import Mechanism, Screw, Term
from modelsel.robot.files import load_robot

from .cases import EXPLAINS, FRESH, bound, visible
from .noise import DRAWS, LEVEL, SIGMA, SURE, diagnose_campaign
from .runner import Job, build_parser, count_most, interval, name_command, run_lines
from .unlisted_plants import GROUPS, KINDS, Kind, Plant, Truth, find_truth, scale_parts

Array = np.ndarray
Generator = np.random.Generator

ARMS = ("puma760", "ur5", "irb120", "ur10e", "irb1600", "iiwa14")
CONFIGURATIONS = (40, 120)
TOOL = (40.0, -25.0, 100.0)
# draws of a plant until geometry leaves something of it
TRIES = 100
# share of the variance of a state variable from which a joint's reading counts as its driver
DRIVES = 0.1
# waves a turn within which a count is the right one: what a turn of data hardly tells apart
RESOLVED = 0.25
# a wave or a saw of a joint's angle, with how many it has a turn
WAVES = r"(?:sin|cos|saw)\((?:([\d.]+)\*)?q\d+(?:[+-][\d.e-]+)?\)"


@dataclass(frozen=True, eq=False)
class Campaign:
    """A campaign with what is planted, and fresh configurations of the same arm."""

    robot: str
    arm: Arm
    state: State
    fresh: State
    plant: Plant
    truth: Truth
    noise: Array

    @cached_property
    def problem(self) -> Problem:
        """What modelsel is given."""
        exact = measured(self.arm, self.state, self.plant.parts)
        return bound(self.arm, self.robot, self.state, exact + self.noise)

    @cached_property
    def unseen(self) -> Problem:
        """Fresh configurations, without noise."""
        exact = measured(self.arm, self.fresh, self.plant.parts)
        return bound(self.arm, self.robot, self.fresh, exact)


def draw_campaign(kind: Kind, robot: str, rng: Generator, larger: float = 1.0) -> Campaign:
    """Draw a campaign of a kind on one of the arms; its effect may be `larger` than by its kind."""
    body = arm(load_robot(robot), rng, TOOL)
    low, high = CONFIGURATIONS
    plant = None
    while plant is None:
        state = draw_state(body, rng, int(rng.integers(low, high + 1)), kind.payload)
        fresh = draw_state(body, rng, FRESH, kind.payload)
        plant = draw_plant(kind, body, (state, fresh), rng)
    sizes = SIGMA * larger * rng.uniform(*kind.sizes, len(plant.parts))
    plant = scale_parts(plant, state, sizes)
    noise = SIGMA * rng.standard_normal((state.m, 3))
    if plant.louder is not None:
        noise *= plant.louder(state)[:, None]
    truth = find_truth(plant, fresh, rng)
    return Campaign(robot, body, state, fresh, plant, truth, noise)


def draw_state(body: Arm, rng: Generator, m: int, payload: bool) -> State:
    covariates = {"payload_kg": rng.choice([0.0, 5.0, 10.0], m)} if payload else {}
    return State(body, body.draw(rng, m), covariates)


def draw_plant(kind: Kind, body: Arm, states: Sequence[State], rng: Generator) -> Plant | None:
    """Draw a plant of which the geometry leaves enough to see, in more than one configuration; None
    where these configurations show none."""
    for _ in range(TRIES):
        plant = kind.draw(rng, body)
        if not kind.visible:
            return plant
        small = scale_parts(plant, states[0], np.full(len(plant.parts), SIGMA))
        if all(visible(part, state) for part in small.told for state in states):
            return plant
    return None


# -- what is said, and whether it is true


@dataclass(frozen=True)
class Claim:
    """What one finding claims: its name, how deep ("place", "drivers", "shape", "cause") and with
    which probability; whether that much is true; where it is at a true place, and what drives it."""

    name: str
    level: str
    probability: float
    right: bool
    at_place: bool
    drivers: tuple[str, ...]


def read_finding(finding: Finding) -> tuple[str, float]:
    """Read (level, probability) of what a finding claims."""
    claim = finding.claim
    if claim is not None:
        return claim.level, claim.probability
    candidate = finding.candidate
    alike = [e for e in finding.named.entries if e.candidate.label == candidate.label]
    probability = float(sum(e.probability for e in alike))
    if candidate.registered:
        return "cause", probability
    if candidate.kind is CandidateKind.FREE_FUNCTION:
        return "drivers", probability
    return "shape", probability


def judge(finding: Finding, campaign: Campaign) -> Claim:
    """Judge what a finding claims by what was planted."""
    level, probability = read_finding(finding)
    own = finding.candidate.mechanism
    if finding.claim is not None and finding.claim.acts:
        own = keep_places(own, {place for place, _ in finding.claim.acts})
    right = judge_levels(own, campaign)
    ordered = tuple(sorted(name_drivers(own, campaign.unseen)))
    name = finding.candidate.label
    return Claim(name, level, probability, right[level], right["place"], ordered)


def keep_places(own: Mechanism, places: set[tuple[int, str]]) -> Mechanism:
    """The screws of a mechanism at the places that its claim names."""
    terms = (
        replace(term, screws=tuple(s for s in term.screws if (s.frame, s.axis) in places))
        for term in own.terms
    )
    return replace(own, terms=tuple(term for term in terms if term.screws))


def judge_levels(own: Mechanism, campaign: Campaign) -> dict[str, bool]:
    """Judge what an explanation says of a plant at each level."""
    truth = campaign.truth
    at_place = truth.holds_place(find_places(own))
    drivers = name_drivers(own, campaign.unseen)
    driven = bool(drivers) and drivers <= truth.allowed
    return {
        "place": at_place,
        "drivers": at_place and driven,
        "shape": bool(at_place and driven and holds_shape(own, campaign)),
        "cause": bool(at_place and is_true_name(own, campaign.plant)),
    }


def find_places(own: Mechanism) -> frozenset[tuple[int, str]]:
    return frozenset((screw.frame, screw.axis) for term in own.terms for screw in term.screws)


def is_true_name(own: Mechanism, plant: Plant) -> bool:
    """Whether a registered name is among those that are true of a plant."""
    stem = re.sub(r":\d+$", "", own.name)
    return stem in plant.stems and (not plant.teeth or fits_teeth(own, plant.teeth))


def fits_teeth(own: Mechanism, teeth: int) -> bool:
    """Whether an explanation is a wave, or a saw, of a multiple of a saw's teeth."""
    causes = [str(screw.cause) for term in own.terms for screw in term.screws]
    found = [re.fullmatch(WAVES, cause) for cause in causes]
    counts = [float(own[1] or 1) if own else 0.0 for own in found]
    nearest = [teeth * max(1, round(count / teeth)) for count in counts]
    return all(abs(count - near) <= RESOLVED for count, near in zip(counts, nearest))


def holds_shape(own: Mechanism, campaign: Campaign) -> bool:
    """Whether a formula does what some part of the plant does beyond the geometry."""
    if campaign.plant.teeth and fits_teeth(own, campaign.plant.teeth):
        return True
    J = campaign.arm.screws(campaign.fresh.q)
    columns, Q = said(own, campaign.unseen, J), geometry(J)
    parts = [part.displacement(campaign.fresh) for part in campaign.plant.told]
    return any(holds(columns, part, Q) > EXPLAINS for part in parts)


NAMED_DRIVERS = {"progress": "time", "time_s": "time", "payload_kg": "payload"}


def name_drivers(own: Mechanism, at: Problem) -> frozenset[str]:
    """Name what drives an explanation: readings (behind torques and positions, too), last moves,
    time, payload."""
    drivers: set[str] = set()
    for name in own.names():
        motion = re.fullmatch(r"(?:approach|move|drag)(\d+)(?:_\d+)?", name)
        if motion:
            drivers.add(f"move{motion[1]}")
        elif name in NAMED_DRIVERS or re.fullmatch(r"q\d+", name):
            drivers.add(NAMED_DRIVERS.get(name, name))
        else:
            drivers |= find_readings(name, at)
    return frozenset(drivers)


def find_readings(name: str, at: Problem) -> set[str]:
    """Find the joints whose readings change a state variable, by readings exchanged between rows."""
    plain = at.state.value(name)
    varies = 2 * len(plain) * float(np.var(plain))
    order = np.random.default_rng(0).permutation(len(plain))
    joints = set()
    for j in range(at.robot.n):
        q = at.data.q.copy()
        q[:, j] = q[order, j]
        other = replace(at, data=replace(at.data, q=q))
        if np.square(other.state.value(name) - plain).sum() > DRIVES * varies:
            joints.add(f"q{j + 1}")
    return joints


# -- the oracle


@dataclass(frozen=True, eq=False)
class Oracle:
    """Who has the true formula: the p-value of its F test on the base, the scan's critical one, and
    its fit."""

    p: float
    critical: float
    fit: Fit
    unseen: Problem


def build_oracle(campaign: Campaign, base: Model, rng: Generator) -> Oracle:
    """Fit geometry and the true formula, a number for each part that readings tell of."""
    at, unseen = campaign.problem, campaign.unseen
    plain = fit(at, base)
    if not campaign.plant.told:
        return Oracle(1.0, 0.0, plain, unseen)
    own = describe_truth(campaign.plant.told, campaign.state)
    with_truth = add_truth(at, campaign.plant.told, campaign.state)
    both = Model((*base.mechanisms, own))
    p, Q = compute_p(with_truth, base, both, plain)
    found = build_candidates(at, base, (*build_faults(at.robot), *every(at.robot)))
    critical = critical_p(build_scan(build_columns(at, found, plain.at()), Q), rng, DRAWS, LEVEL)
    there = add_truth(unseen, campaign.plant.told, campaign.fresh)
    return Oracle(p, critical, fit(with_truth, both), there)


def compute_p(at: Problem, base: Model, both: Model, plain: Fit) -> tuple[float, Array]:
    """(p-value of the F test of what `both` has beyond the base, basis of the fitted base)."""
    columns, left = stack_design(at, both.terms, plain.at())
    Q = compute_basis(columns[:, list(plain.found.kept)])
    own, left = columns[:, len(base.terms) :], left - Q @ (Q.T @ left)
    Z = compute_basis(own - Q @ (Q.T @ own))
    k, freedom = Z.shape[1], len(left) - Q.shape[1]
    share = float(np.square(Z.T @ left).sum() / np.square(left).sum())
    return float(betaincc(k / 2, (freedom - k) / 2, share)), Q


def list_screws(part: Effect, state: State) -> list[tuple[int, str, Array]]:
    """List (frame, axis, size (m,)) of the screws of a part."""
    twist, _ = part.perturbation(state)
    axes = ("tx", "ty", "tz", "rx", "ry", "rz")
    places = zip(*np.nonzero(np.abs(twist).max(0)))
    return [(int(f) + 1, axes[a], twist[:, f, a]) for f, a in places]


def describe_truth(parts: Iterable[Effect], state: State) -> Mechanism:
    """The true formula as a mechanism whose causes are columns beside the data."""
    terms = [
        Term(
            f"true{k}",
            tuple(
                Screw(f, a, Named(f"true{k}{f}{a}", "1")) for f, a, _ in list_screws(part, state)
            ),
        )
        for k, part in enumerate(parts)
    ]
    return Mechanism("truth", tuple(terms))


def add_truth(at: Problem, parts: Iterable[Effect], state: State) -> Problem:
    """The same rows with the columns of the true formula."""
    columns = {
        f"true{k}{f}{a}": size
        for k, part in enumerate(parts)
        for f, a, size in list_screws(part, state)
    }
    return replace(at, data=replace(at.data, covariates={**at.data.covariates, **columns}))


# -- studies


@dataclass(frozen=True)
class Study:
    """What one study claimed of a plant, and how near it came to the oracle (p-values; errors, rms
    of a coordinate on fresh configurations [mm]); `place`: some finding is at a true place and none
    surely elsewhere; `drivers`: those there name what drives it; `parts`: of the errors, that were
    found besides; `as_part`: no finding is at a true place or surely elsewhere, and a joint of the
    plant is said not to repeat."""

    line: str
    number: int
    arm: str
    words: str
    configurations: int
    claims: tuple[tuple[str, str, float, bool, bool, tuple[str, ...]], ...]
    parts: tuple[str, ...]
    place: bool
    drivers: bool
    as_part: bool
    oracle_p: float
    critical_p: float
    error: float
    oracle_error: float
    seconds: float

    @property
    def read(self) -> tuple[Claim, ...]:
        """The claims by name."""
        return tuple(Claim(*claim) for claim in self.claims)

    @property
    def place_right(self) -> bool:
        """Whether the place is told: of what does not repeat, in the budget of repeatability, too."""
        return self.place or (self.as_part and not KINDS[self.line].repeats)

    @property
    def findable(self) -> bool:
        """Whether the oracle finds the effect."""
        return self.oracle_p <= self.critical_p

    def list_false(self, *levels: str) -> list[Claim]:
        """What is surely and falsely claimed at some levels."""
        sure = [claim for claim in self.read if claim.probability > SURE and not claim.right]
        return [claim for claim in sure if claim.level in levels]


def run_one(job: Job, larger: float = 1.0) -> Study:
    """Run one study of a line, by its seed and number."""
    name, seed, number = job
    started = time.process_time()
    rng = np.random.default_rng((seed, crc32(name.encode()), number))
    campaign = draw_campaign(KINDS[name], ARMS[number % len(ARMS)], rng, larger)
    at = campaign.problem
    base = Model((mechanism("geometric", at.robot),))
    _, diagnosis = diagnose_campaign(at, base, number, faults=build_faults(at.robot))
    claims = [judge(finding, campaign) for finding in diagnosis.effects]
    place, drivers = find_right(claims, campaign.truth)
    oracle = build_oracle(campaign, base, rng)
    return Study(
        name,
        number,
        campaign.robot,
        campaign.plant.words,
        campaign.state.m,
        tuple((c.name, c.level, c.probability, c.right, c.at_place, c.drivers) for c in claims),
        diagnosis.errors.names,
        place,
        drivers,
        is_told_as_part(claims, diagnosis.errors.names, campaign.truth),
        oracle.p,
        oracle.critical,
        compute_rms(diagnosis.fit, campaign.unseen),
        compute_rms(oracle.fit, oracle.unseen),
        time.process_time() - started,
    )


def find_right(claims: Sequence[Claim], truth: Truth) -> tuple[bool, bool]:
    """Whether (the place, the drivers) of a plant are rightly told by all findings together."""
    there = [claim for claim in claims if claim.at_place]
    elsewhere = any(not c.at_place and c.probability > SURE for c in claims)
    named = frozenset(driver for claim in there for driver in claim.drivers)
    place = bool(there) and not elsewhere
    return place, place and bool(named) and truth.needed <= named <= truth.allowed


def is_told_as_part(claims: Sequence[Claim], parts: Sequence[str], truth: Truth) -> bool:
    """Whether the budget of repeatability tells the joint of a plant, where no finding tells a place."""
    if any(claim.at_place or claim.probability > SURE for claim in claims):
        return False
    joints = [re.fullmatch(r"joint (\d+)", part) for part in parts]
    return any(truth.holds_place(frozenset({(int(own[1]), "rz")})) for own in joints if own)


def compute_rms(fitted: Fit, at: Problem) -> float:
    """Root mean square of what a fit leaves of a coordinate [mm]."""
    return float(np.sqrt(np.square(fitted.residuals(at)[:, :3]).mean()))


# -- tables

HEADS = ("cause falsely named", "cause or shape", "place right", "drivers right")


def tabulate_kind(words: str, studies: Sequence[Study]) -> str:
    """The line of a kind."""
    n = len(studies)
    told = [s for s in studies if s.findable]
    cells = [
        interval(sum(bool(s.list_false("cause")) for s in studies), n),
        interval(sum(bool(s.list_false("cause", "shape")) for s in studies), n),
        interval(sum(s.place_right for s in told), len(told)) if told else "-",
        interval(sum(s.drivers for s in told), len(told)) if told else "-",
    ]
    ratio = np.array([s.error / s.oracle_error for s in studies])
    mean = np.sqrt(sum(s.error**2 for s in studies) / sum(s.oracle_error**2 for s in studies))
    error = f"{mean:.3f} {np.median(ratio):.3f} {ratio.max():.2f}"
    false = [re.sub(r":\d+$", "", c.name) for s in studies for c in s.list_false("cause", "shape")]
    line = f"{words:<28}{n:>7}{len(told):>7}  " + "".join(f"{cell:<23}" for cell in cells)
    return f"{line}{error:<19}{count_most(false)}"


def tabulate_claims(studies: Sequence[Study]) -> list[str]:
    """How many of the claims with a high probability are true, level by level."""
    lines = [f"claims with more than {SURE:g} that are true"]
    claims = [c for s in studies for c in s.read if c.probability > SURE]
    for level in ("place", "drivers", "shape", "cause"):
        own = [c.right for c in claims if c.level == level]
        if own:
            lines.append(f"    {level:<10}{len(own):>5}  {interval(sum(own), len(own))}")
    if claims:
        right = interval(sum(c.right for c in claims), len(claims))
        lines.append(f"    {'all':<10}{len(claims):>5}  {right}")
    return lines


def tabulate_parts(words: str, studies: Sequence[Study]) -> str:
    """Which parts the errors are said to have, beyond the instrument's."""
    found = count_most((part for s in studies for part in s.parts if part != "instrument"), 6)
    return f"parts of the errors, {words + ':':<28}{found}"


def tabulate_places(studies: Sequence[Study]) -> str:
    """How often the place is told, by a finding or as a joint that is said not to repeat."""
    told = [s for s in studies if s.findable]
    hits = sum(s.place or s.as_part for s in told)
    rate = interval(hits, len(told))
    return f"place right, by findings or as a joint that does not repeat: {rate} of {len(told)}"


def tabulate_exact(name: str, studies: Sequence[Study]) -> str:
    """How often the names that must be found are, and no other."""
    exact = KINDS[name].exact
    hits = sum(sorted(c.name for c in s.read) == sorted(exact) for s in studies)
    said_ = count_most(" + ".join(sorted(c.name for c in s.read)) or "nothing" for s in studies)
    rate = interval(hits, len(studies))
    return f"{KINDS[name].words}: named {' + '.join(exact)} and nothing else {rate}; said: {said_}"


def is_counted(study: Study, group: str) -> bool:
    """Whether a study is of a group of kinds, and not of those that the catalogue has."""
    kind = KINDS[study.line]
    return kind.group == group and not kind.exact


def tabulate(studies: Sequence[Study], command: str) -> str:
    """All tables, the command first."""
    done = {name: [s for s in studies if s.line == name] for name in KINDS}
    done = {name: own for name, own in done.items() if own}
    seconds = sum(s.seconds for s in studies) / max(len(studies), 1)
    how = (
        f"Rates with 95 % intervals (Clopper-Pearson), arms {', '.join(ARMS)}; {seconds:.1f} s a study.\n"
        "Falsely named: in a study, with more than 0.9. Place and drivers: of the studies in which the "
        "oracle finds the effect.\nError on fresh configurations over the oracle's: of all studies "
        "together, median, largest."
    )
    heads = "".join(f"{head:<23}" for head in HEADS)
    lines = [f"{'planted':<28}{'studies':>7}{'oracle':>7}  {heads}{'error':<19}falsely named"]
    lines += [tabulate_kind(KINDS[name].words, own) for name, own in done.items()]
    groups = {group: [s for s in studies if is_counted(s, group)] for group in GROUPS}
    planted = groups[GROUPS[0]]
    steady = [s for s in planted if not KINDS[s.line].jumps]
    for words, own in {GROUPS[0]: planted, "of these, without jumps": steady, **groups}.items():
        if own:
            lines.append(tabulate_kind(words, own))
    parts = [tabulate_parts(KINDS[name].words, own) for name, own in done.items()]
    exact = [tabulate_exact(name, own) for name, own in done.items() if KINDS[name].exact]
    places = tabulate_places(planted) if planted else ""
    return "\n".join(
        (
            command,
            how,
            "",
            *lines,
            "",
            places,
            "",
            *tabulate_claims(studies),
            "",
            *parts,
            "",
            *exact,
        )
    ).rstrip()


def main() -> None:
    parser = build_parser(__doc__.splitlines()[0], list(KINDS), studies=20, seed=31)
    parser.add_argument("--larger", type=float, default=1.0, help="times the sizes of the kinds")
    asked = parser.parse_args()
    studies = run_lines(asked, list(KINDS), Study, partial(run_one, larger=asked.larger))
    command = name_command("unlisted", asked, list(KINDS))
    if asked.larger != 1:
        command += f" --larger {asked.larger:g}"
    text = tabulate(studies, command)
    print(text)
    if asked.out:
        asked.out.write_text(text + "\n")


if __name__ == "__main__":
    main()
