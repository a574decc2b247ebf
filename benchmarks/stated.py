"""Whether probabilities are right as often as they say: what findings claim, against the truth.

    python -m benchmarks.stated --studies 210 --seed 2611 --out benchmarks/results/stated.txt

Two lines of studies. *listed*: the cases of benchmarks.naming, 0 to 3 effects of the catalogue and
of its error map, 40 to 200 configurations, 0.3 to 5 times the noise. *unlisted*: the campaigns of
benchmarks.unlisted, whose kinds take turns. Every study goes through outliers, parts of the errors
and naming as `modelsel study` does. A finding has a probability at each of four levels (place,
drivers, shape, cause) and claims the deepest one that holds; every one is held against what was
planted, claimed or not. Of listed effects an explanation is right at every level where it does to the
target what one of them does (0.97 of it beyond the geometry, on fresh configurations); else its
place and drivers may still be. Of unlisted ones benchmarks.unlisted says what is right. The curve
is drawn beside the table."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from zlib import crc32

import numpy as np

from modelsel import Model, mechanism
from modelsel.diagnosis.candidates.signatures import LEVELS, PROVEN
from modelsel.diagnosis.findings.effects import Effect as Finding
from modelsel.fitting.problem import Problem
from modelsel.mechanisms.registry import build_faults

from .cases import Case, draw
from .listed import find_listed, judge_listed
from .noise import diagnose_campaign
from .runner import Job, build_parser, interval, name_command, run_lines
from .score import Judge
from .summary import interval as bounds
from .unlisted import ARMS, Campaign, draw_campaign, judge_levels
from .unlisted_plants import KINDS

Array = np.ndarray

LINES = {"listed": "listed effects", "unlisted": "unlisted effects"}
EDGES = (0.005, 0.1, 0.3, 0.5, 0.7, 0.9, 0.99, 1.0)


@dataclass(frozen=True)
class Study:
    """What one study said: of every finding the name, the level that it claims, the probability of
    each level and whether that much is right."""

    line: str
    number: int
    arm: str
    words: tuple[str, ...]
    claims: tuple[tuple[str, str, tuple[float, ...], tuple[bool, ...]], ...]
    seconds: float

    @property
    def claimed(self) -> list[tuple[float, bool]]:
        """(probability, right) of what every finding claims."""
        at = [(LEVELS.index(level), p, right) for _, level, p, right in self.claims]
        return [(p[k], right[k]) for k, p, right in at]

    @property
    def every(self) -> list[tuple[float, bool]]:
        """(probability, right) of every level of every finding."""
        return [pair for _, _, p, right in self.claims for pair in zip(p, right, strict=True)]


# -- studies


def run_one(job: Job) -> Study:
    """Run one study of a line, by its seed and number."""
    line, seed, number = job
    return run_listed(seed, number) if line == "listed" else run_unlisted(seed, number)


def run_listed(seed: int, number: int) -> Study:
    started = time.process_time()
    case: Case = draw([seed, number])
    at, unseen = case.problem(), case.unseen()
    findings = _diagnose(at, number)
    judge, rng = Judge(case, unseen), np.random.default_rng((seed, number, 1))
    truths = [find_listed(effect, case.fresh, rng) for effect in case.effects]
    rights = [
        judge_listed(finding, judge.held(finding.candidate), truths, unseen) for finding in findings
    ]
    words = tuple(effect.words for effect in case.effects)
    return _keep("listed", number, case.robot, words, findings, rights, started)


def run_unlisted(seed: int, number: int) -> Study:
    started = time.process_time()
    names = list(KINDS)
    name = names[number % len(names)]
    rng = np.random.default_rng((seed, crc32(name.encode()), number))
    robot = ARMS[(number // len(names)) % len(ARMS)]
    campaign: Campaign = draw_campaign(KINDS[name], robot, rng)
    findings = _diagnose(campaign.problem, number)
    rights = [judge_levels(finding.candidate.mechanism, campaign) for finding in findings]
    return _keep("unlisted", number, robot, (campaign.plant.words,), findings, rights, started)


def _diagnose(at: Problem, number: int) -> Sequence[Finding]:
    base = Model((mechanism("geometric", at.robot),))
    _, diagnosis = diagnose_campaign(at, base, number, faults=build_faults(at.robot))
    return diagnosis.effects


def _keep(
    line: str,
    number: int,
    arm: str,
    words: tuple[str, ...],
    findings: Sequence[Finding],
    rights: Sequence[dict[str, bool]],
    started: float,
) -> Study:
    claims = []
    for finding, right in zip(findings, rights, strict=True):
        claim = finding.claim
        if claim is None:
            continue
        told = tuple(bool(right[level]) for level in LEVELS)
        claims.append((finding.candidate.label, claim.level, claim.levels, told))
    return Study(line, number, arm, words, tuple(claims), time.process_time() - started)


# -- table and picture

Pairs = Sequence[tuple[float, bool]]


def group_studies(studies: Sequence[Study]) -> dict[str, list[Study]]:
    """Group the studies of each line that has some, and all of them together."""
    groups = {words: [s for s in studies if s.line == line] for line, words in LINES.items()}
    return {words: own for words, own in groups.items() if own} | {"both": list(studies)}


def bin_pairs(pairs: Pairs) -> list[tuple[float, float, int, int]]:
    """Bin what was said: (edge, mean probability, right, all) of every bin that holds some."""
    out = []
    for low, high in pairwise(EDGES):
        within = [(p, r) for p, r in pairs if low <= p < high or (p == high == EDGES[-1])]
        if within:
            mean = float(np.mean([p for p, _ in within]))
            out.append((low, mean, sum(r for _, r in within), len(within)))
    return out


def tabulate_curve(words: str, pairs: Pairs) -> list[str]:
    """The curve of what was said: by probability, the share that is right."""
    lines = [f"{words}", f"    {'stated':<16}{'mean':>7}{'said':>7}  right"]
    highs = dict(pairwise(EDGES))
    for low, mean, right, n in bin_pairs(pairs):
        stated = f"{low:g} to {highs[low]:g}"
        lines.append(f"    {stated:<16}{mean:>7.3f}{n:>7}  {interval(right, n)}")
    return lines


def tabulate_sure(studies: Sequence[Study]) -> list[str]:
    """How many of the claims with 0.9 and more are right."""
    lines = [f"claims with a probability of {PROVEN:g} or more", f"    {'':<20}{'said':>5}  right"]
    for words, own in group_studies(studies).items():
        sure = [r for s in own for p, r in s.claimed if p >= PROVEN]
        if sure:
            lines.append(f"    {words:<20}{len(sure):>5}  {interval(sum(sure), len(sure))}")
    for k, level in enumerate(LEVELS):
        claims = [(p[k], right[k]) for s in studies for _, at, p, right in s.claims if at == level]
        told = [r for p, r in claims if p >= PROVEN]
        if told:
            lines.append(
                f"    {'both, ' + level:<20}{len(told):>5}  {interval(sum(told), len(told))}"
            )
    return lines


def tabulate(studies: Sequence[Study], command: str) -> str:
    """All tables, the command first."""
    seconds = sum(s.seconds for s in studies) / max(len(studies), 1)
    counts = ", ".join(
        f"{sum(s.line == line for s in studies)} studies of {words}"
        for line, words in LINES.items()
    )
    lines = [
        command,
        f"{counts}; {seconds:.1f} s a study. Rates with 95 % intervals (Clopper-Pearson).",
        "",
    ]
    lines += [*tabulate_sure(studies), ""]
    for words, own in group_studies(studies).items():
        claimed = [pair for s in own for pair in s.claimed]
        every = [pair for s in own for pair in s.every]
        lines += [*tabulate_curve(f"{words}: what findings claim", claimed), ""]
        lines += [*tabulate_curve(f"{words}: every level of every finding", every), ""]
    wrong = [
        f"    {s.line:<9} {s.arm:<8} planted {'; '.join(s.words) or 'nothing'}; claimed {name} ({level} {p[k]:.2f})"
        for s in studies
        for name, level, p, right in s.claims
        for k in [LEVELS.index(level)]
        if p[k] >= PROVEN and not right[k]
    ]
    lines += ["claims with 0.9 or more that are not right", *(wrong or ["    none"])]
    return "\n".join(lines).rstrip()


def draw_picture(studies: Sequence[Study], path: Path) -> None:
    """Draw stated probability against the share that is right, with 95 % intervals."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.6, 4.2), layout="constrained")
    heads = ("what findings claim", "every level of every finding")
    for axes, head in zip(figure.subplots(1, 2, sharey=True), heads, strict=True):
        axes.plot([0, 1], [0, 1], color="0.6", lw=1, label="as often as stated")
        groups = group_studies(studies)
        for k, (words, own) in enumerate(groups.items()):
            pairs = [pair for s in own for pair in (s.claimed if head == heads[0] else s.every)]
            binned = bin_pairs(pairs)
            if not binned:
                continue
            is_all = words == "both"
            mean = np.array([row[1] for row in binned])
            rates = np.array([bounds(right, n) for _, _, right, n in binned])
            spread = np.abs(rates[:, 1:].T - rates[:, 0])
            axes.errorbar(
                mean + 0.008 * (k - 1),
                rates[:, 0],
                yerr=spread,
                fmt="s" if is_all else "o",
                ms=5 if is_all else 4,
                lw=1,
                color="k" if is_all else f"C{k}",
                label=words,
            )
        axes.set(xlabel="stated probability", xlim=(-0.02, 1.02), ylim=(-0.02, 1.02), title=head)
        axes.spines[["top", "right"]].set_visible(False)
    figure.axes[0].set_ylabel("share that is right")
    figure.axes[1].legend(frameon=False, loc="lower right")
    figure.savefig(path, dpi=110, metadata={"Software": None})


def main() -> None:
    parser = build_parser(__doc__.splitlines()[0], list(LINES), studies=210, seed=2611)
    asked = parser.parse_args()
    studies = run_lines(asked, list(LINES), Study, run_one)
    text = tabulate(studies, name_command("stated", asked, list(LINES)))
    print(text)
    if asked.out:
        asked.out.write_text(text + "\n")
        draw_picture(studies, asked.out.with_suffix(".png"))


if __name__ == "__main__":
    main()
