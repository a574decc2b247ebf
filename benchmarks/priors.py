"""What the priors of the candidates do: the same cases named with other priors.

    python -m benchmarks.priors --studies 20 --seed 2612 --out benchmarks/results/priors.txt

Two lines of cases: *planted*, drawn as in benchmarks.naming with 1 to 3 effects, and *nothing*
with none. Each is named as often as PRIORS has entries, from the same data: with the priors as they
are; with one probability for every candidate; with the odds of the registered names against all
else doubled and halved; and with the names of what was planted weighed as if five of their findings
had been contradicted, or fifty. Found and right are those of benchmarks.naming: of effects that some
candidate holds, and that an oracle finds in 99 %."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from hidden_oracle import critical_p, held_by
from searches import search_separated

from modelsel import Model, mechanism
from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.candidates.candidate_list import build_candidates
from modelsel.diagnosis.candidates.options import DiagnosisOptions
from modelsel.diagnosis.candidates.prior_weights import weigh_outcomes
from modelsel.fitting.least_squares import fit
from modelsel.fitting.problem import Problem
from modelsel.mechanisms.registry import every

from .cases import Case, draw, powers
from .rivals import bench
from .runner import Job, build_parser, interval, name_command, run_lines
from .score import Judge, score
from .summary import REPRESENTED, SURE

LINES = {"planted": "1 to 3 effects", "nothing": "no effect"}
# probability from which a name is said as if it were sure
NAMED = 0.9
# drawn effects that a planted case has, by its number
COUNTS = (1, 2, 3)

Found = tuple[Candidate, ...]
# (problem, base, its candidates, kinds that are planted) -> the candidates with other priors
Prior = Callable[[Problem, Model, Found, Sequence[str]], Found]


def keep(at: Problem, base: Model, found: Found, kinds: Sequence[str]) -> Found:
    return found


def flatten(at: Problem, base: Model, found: Found, kinds: Sequence[str]) -> Found:
    """Give every candidate the same probability."""
    return tuple(replace(c, prior=1 / len(found)) for c in found)


def shift(factor: float) -> Prior:
    """Multiply the odds of the registered names, together, against all else."""

    def change(at: Problem, base: Model, found: Found, kinds: Sequence[str]) -> Found:
        share = sum(c.prior for c in found if c.registered)
        odds = factor * share / (1 - share)
        wanted = odds / (1 + odds)
        ratio = wanted / share, (1 - wanted) / (1 - share)
        return tuple(replace(c, prior=c.prior * ratio[not c.registered]) for c in found)

    return change


def contradict(count: int) -> Prior:
    """Weigh the names of what is planted as after some findings that were contradicted."""

    def change(at: Problem, base: Model, found: Found, kinds: Sequence[str]) -> Found:
        weights = tuple((kind, weigh_outcomes(0, count)) for kind in kinds)
        options = DiagnosisOptions(weights=weights)
        return build_candidates(at, base, every(at.robot), options=options)

    return change


PRIORS: dict[str, Prior] = {
    "as they are": keep,
    "one for every candidate": flatten,
    "registered, odds doubled": shift(2.0),
    "registered, odds halved": shift(0.5),
    "true names contradicted 5 times": contradict(5),
    "true names contradicted 50 times": contradict(50),
}


@dataclass(frozen=True)
class Study:
    """What one case gave: whether an oracle finds each effect and some candidate holds it; for each
    of the priors (found, right, named, surplus, surely wrong): of every effect whether something is
    about it, whether that holds it, its probability, findings that nothing needs, and sure ones
    that hold nothing."""

    line: str
    number: int
    robot: str
    words: tuple[str, ...]
    findable: tuple[bool, ...]
    registered: tuple[bool, ...]
    outcomes: tuple[tuple[tuple[bool, ...], tuple[bool, ...], tuple[str, ...], int, int], ...]
    seconds: float


def run_one(job: Job) -> Study:
    """Run one case with every prior."""
    line, seed, number = job
    started = time.process_time()
    count = COUNTS[number % len(COUNTS)] if line == "planted" else 0
    case = draw([seed, number, count], count)
    at, base = case.problem(), Model((mechanism("geometric", case.problem().robot),))
    found = build_candidates(at, base, every(at.robot))
    kinds = [effect.kind for effect in case.effects]
    judge = Judge(case, case.unseen())
    outcomes = tuple(
        name_with(prior(at, base, found, kinds), at, base, judge, number)
        for prior in PRIORS.values()
    )
    names = {c.mechanism.stem for c in found if c.registered}
    return Study(
        line,
        number,
        case.robot,
        tuple(effect.words for effect in case.effects),
        find_findable(case, at, base, found, np.random.default_rng((seed, number, 2))),
        tuple(kind in names for kind in kinds),
        outcomes,
        time.process_time() - started,
    )


def name_with(
    found: Found, at: Problem, base: Model, judge: Judge, number: int
) -> tuple[tuple[bool, ...], tuple[bool, ...], tuple[str, ...], int, int]:
    """Name the effects of a case with the priors of `found`."""
    diagnosis = search_separated(at, base, found, number)
    entries = [effect.named.entries[0] for effect in diagnosis.effects]
    tops = [entry.candidate for entry in entries]
    scored = score(judge, tops, diagnosis.fit.residuals(judge.problem)[:, :3])
    wrong = 0
    for entry in entries:
        holds = any(share > REPRESENTED for share in judge.held(entry.candidate))
        wrong += entry.probability >= NAMED and not holds
    return (
        tuple(scored["found"]),
        tuple(scored["right"]),
        tuple(scored["said"]),
        int(scored["extra"]),
        int(wrong),
    )


def find_findable(
    case: Case, at: Problem, base: Model, found: Found, rng: np.random.Generator
) -> tuple[bool, ...]:
    """Find which effects an oracle finds in 99 % and some candidate holds."""
    if not case.effects:
        return ()
    table = bench(at, case.unseen(), base, fit(at, base), found)
    power, _ = powers(case, critical_p(table.first, rng))
    held = [held_by(e.displacement(case.state), table.first).max() for e in case.effects]
    sure = [p >= SURE or np.isnan(p) for p in power]
    return tuple(bool(s and h > REPRESENTED) for s, h in zip(sure, held, strict=True))


def tabulate(studies: Sequence[Study], command: str) -> str:
    """A line for every prior, the command first."""
    planted = [s for s in studies if s.line == "planted"]
    nothing = [s for s in studies if s.line == "nothing"]
    seconds = sum(s.seconds for s in studies)
    lines = [
        command,
        (
            f"{len(planted)} cases of 1 to 3 effects, {len(nothing)} of none, the same for every prior; "
            f"{seconds:.0f} s. Rates with 95 % intervals (Clopper-Pearson)."
        ),
        (
            "right: of effects that an oracle finds and some candidate holds; registered: of those the "
            "registered mechanisms. other: effects"
        ),
        (
            "that are called otherwise than with the priors as they are. surplus: cases with a finding "
            "that nothing planted needs. sure and"
        ),
        "wrong: findings with 0.9 or more that hold nothing planted. alarm: cases of none with a finding.",
        "",
        f"{'priors':<34}{'right':<33}{'registered':<33}{'other':>6}{'surplus':>9}{'sure, wrong':>13}  alarm",
    ]
    lines += [tabulate_prior(k, words, planted, nothing) for k, words in enumerate(PRIORS)]
    return "\n".join(lines)


def tabulate_prior(k: int, words: str, planted: Sequence[Study], nothing: Sequence[Study]) -> str:
    """The line of a prior."""
    sure = [(s, t) for s in planted for t, there in enumerate(s.findable) if there]
    right = [s.outcomes[k][1][t] for s, t in sure]
    own = [s.outcomes[k][1][t] for s, t in sure if s.registered[t]]
    other = sum(s.outcomes[k][2][t] != s.outcomes[0][2][t] for s, t in sure)
    surplus = sum(s.outcomes[k][3] > 0 for s in planted)
    wrong = sum(s.outcomes[k][4] for s in planted)
    alarms = sum(s.outcomes[k][3] > 0 for s in nothing)
    cells = [
        f"{interval(sum(r), len(r))} ({sum(r)} of {len(r)})" if r else "-" for r in (right, own)
    ]
    alarm = interval(alarms, len(nothing)) if nothing else "-"
    return f"{words:<34}{cells[0]:<33}{cells[1]:<33}{other:>6}{surplus:>9}{wrong:>13}  {alarm}"


def main() -> None:
    parser = build_parser(__doc__.splitlines()[0], list(LINES), studies=20, seed=2612)
    asked = parser.parse_args()
    studies = run_lines(asked, list(LINES), Study, run_one)
    text = tabulate(studies, name_command("priors", asked, list(LINES)))
    print(text)
    if asked.out:
        asked.out.write_text(text + "\n")


if __name__ == "__main__":
    main()
