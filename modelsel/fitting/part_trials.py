"""Trials of one more part of the errors: which of those offered raises the likelihood most.

The slope of the likelihood at zero variance bounds what a part that does not last can gain, so that
few parts have to be fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

from .error_directions import compute_alignment_p
from .error_sizes import compute_size_p
from .largest_likelihood import maximise_likelihood
from .possible_parts import BY_TARGETS, DIRECTIONS, PossiblePart
from .restricted_likelihood import Likelihood, evaluate_likelihood
from .shared_errors import SharedError
from .turned_errors import compute_turned_p

# probability with which chance gives a part that is none, and up to which a part that is not taken
# for one may be there all the same
LEVEL = 0.01
UNSURE = 0.2
# what rows of a visit or of a posture share, whatever tells it, and what the targets of one visit do
SHARED_BY_ROWS = "configuration"
OF_A_VISIT = SHARED_BY_ROWS, BY_TARGETS
# parts that do not last which are tried at every step, and one more for each joint that is turned down
TRIED = 2
# by so much twice the log likelihood is larger, 20 to 1, where what a joint does comes back with the
# posture: then it is no joint that does not repeat
COMES_BACK = 6.0
# gain of twice the log likelihood that something lasting needs beyond what does not last
HANDICAP = 6.0


class NextPart(NamedTuple):
    """The outcome of a trial.

    `found`: the parts with the one that raises the likelihood most, and their fit; None where that may
    be chance. `unsure`: in that case the parts with one that may still be there, and does not last."""

    found: tuple[list[PossiblePart], Likelihood] | None
    unsure: tuple[SharedError, ...] | None = None


def find_next(
    at: Likelihood, offered: Sequence[PossiblePart], chosen: list[PossiblePart]
) -> NextPart:
    """Find the part that raises the likelihood most."""
    scores = _score_parts(at, offered, chosen)
    lasting = [score for score in scores if score.lasts]
    lengths = _sort_lengths([score.part for score in lasting])
    others = [score for score in scores if not score.lasts]
    # what lasts first: nothing bounds what it may gain
    tried = lasting[:1] + others
    best: _Trial | None = None
    unsure: _Trial | None = None
    left = TRIED
    gain_of_even = _measure_even(at, [score.part for score in tried])
    beside = _Beside.of(at, others)
    for score in tried:
        if left == 0:
            break
        left -= not score.lasts
        may_be_there = score.may_exceed(best, LEVEL)
        is_first = bool(others) and score is others[0]
        if not may_be_there and not (is_first and score.may_exceed(best, UNSURE)):
            continue
        even = gain_of_even if score.part.even is not None else 0.0
        trial = _try(at, score.part, score.variance, even)
        if score.lasts:
            trial = _climb(at, lengths, trial)
        elif trial.p <= LEVEL:
            trial = beside.hold(trial)
            left += trial.p > LEVEL
        # what rows of a visit share resembles what lasts for a moment
        if trial.p <= LEVEL and may_be_there and (best is None or trial.worth > best.worth):
            best = trial
        elif trial.p <= UNSURE and not score.lasts:
            unsure = trial
    if best is None:
        divided = _divide_lasting(at, offered, chosen)
        return NextPart(divided, None if unsure is None else unsure.every)
    start = best.every
    after = maximise_likelihood(at.model, start, exact=False)
    return NextPart(([*chosen, best.part], after))


def _divide_lasting(
    at: Likelihood, offered: Sequence[PossiblePart], chosen: Sequence[PossiblePart]
) -> tuple[list[PossiblePart], Likelihood] | None:
    """Divide an error that lasts into what the targets of a visit share and what lasts longer, which
    together resemble one that fades soon; None where that gains no more than by chance."""
    now = _find_lasting(chosen)
    names = {(one.name, one.told_by) for one in chosen}
    visits = [one for one in offered if (one.name, one.told_by) == OF_A_VISIT]
    if now is None or not visits or OF_A_VISIT in names:
        return None
    visit = visits[0]
    own = next(part for part in at.parts if part.is_like(now.error))
    rest = [part for part in at.parts if part is not own]
    half = own.variance / 2
    best, longest = at, now
    for one in _sort_lengths(offered):
        if one.error.length <= now.error.length:
            continue
        start = [*rest, replace(one.error, variance=half), replace(visit.error, variance=half)]
        trial = maximise_likelihood(at.model, start, exact=False)
        if trial.log <= best.log:
            break
        best, longest = trial, one
    if longest is now:
        return None
    gain = best.log - at.log - _measure_even(at, [visit])
    p = visit.tests * compute_p(gain)
    if p > LEVEL:
        return None
    others = [one for one in chosen if one is not now]
    return [*others, longest, visit], best


def change_length(
    at: Likelihood, offered: Sequence[PossiblePart], chosen: list[PossiblePart]
) -> tuple[list[PossiblePart], Likelihood]:
    """Change the correlation length of the part that lasts, if there is one, as long as the
    likelihood gains."""
    now = _find_lasting(chosen)
    if now is None:
        return chosen, at
    own = next(part for part in at.parts if part.is_like(now.error))
    others = [part for part in at.parts if part is not own]
    without = evaluate_likelihood(at.model, others)
    every = (*others, own)
    first = _Trial(now, every, at.log, 0.0)
    best = _climb(without, _sort_lengths(offered), first)
    if best is first:
        return chosen, at
    after = maximise_likelihood(at.model, best.every, exact=False)
    rest = [one for one in chosen if one is not now]
    return [*rest, best.part], after


def _find_lasting(chosen: Sequence[PossiblePart]) -> PossiblePart | None:
    """Find the part that lasts among those chosen."""
    for one in chosen:
        if one.error.time is not None:
            return one
    return None


def _sort_lengths(offered: Sequence[PossiblePart]) -> list[PossiblePart]:
    """Sort the lasting errors that are offered by their lengths."""
    lasting = [one for one in offered if one.error.time is not None]
    lasting.sort(key=lambda one: one.error.length)
    return lasting


def _score_parts(
    at: Likelihood, offered: Sequence[PossiblePart], chosen: Sequence[PossiblePart]
) -> list[_Score]:
    """Score the parts that may still be added, the highest first."""
    names = {(one.name, one.told_by) for one in chosen}
    scores = []
    for one in offered:
        if (one.name, one.told_by) in names:
            continue
        score = _score(at, one)
        if score is None or _is_chance(at, one):
            continue
        scores.append(score)
    scores.sort(key=lambda score: -score.most)
    return scores


def _is_chance(at: Likelihood, part: PossiblePart) -> bool:
    """Whether the errors that a part would make larger are so large by chance."""
    if part.compared is None:
        return False
    p = compute_size_p(at, part.error, part.compared)
    return part.tests * p > LEVEL


class _Score(NamedTuple):
    """A part that is not included yet, scored by the slope of twice the log likelihood at zero.

    `most`: the slope's square over the information, more than the likelihood gains by what does not
    last: with n equal mean squares x times those of independent errors these are n (x - 1)²/x and n
    (x - 1 - ln x), and ln x >= 1 - 1/x. `variance`: about what it will be; `before`: the log without
    it."""

    part: PossiblePart
    most: float
    variance: float
    before: float

    @property
    def lasts(self) -> bool:
        """Whether the part lasts in order or time."""
        return self.part.error.time is not None

    def may_exceed(self, best: _Trial | None, level: float) -> bool:
        """Whether it may be more than chance gives in so many studies, and worth more than the best
        so far."""
        if self.lasts:
            return True
        p = self.part.tests * compute_p(self.most)
        if p > level:
            return False
        if best is None:
            return True
        return self.before + self.most > best.worth


def _score(at: Likelihood, part: PossiblePart) -> _Score | None:
    """Score a part; None where it would lower the likelihood."""
    slope, moved = at.slope(part.error)
    matrix = at.information(moved)
    information = matrix.item()
    if slope <= 0 or information <= 0:
        return None
    variance = slope / information
    most = slope * variance
    before = at.log
    return _Score(part, most, variance, before)


def _handicap(part: PossiblePart) -> float:
    """What a lasting part must gain beyond what does not last."""
    return HANDICAP * (part.error.time is not None)


class _Trial(NamedTuple):
    """One more part, the others unchanged: `every` part with its variance, twice the log likelihood,
    the p-value of its gain, and the gain of noise that is `even`. The likelihood object is large,
    and not kept."""

    part: PossiblePart
    every: tuple[SharedError, ...]
    log: float
    p: float
    even: float = 0.0

    @property
    def worth(self) -> float:
        """Twice the log likelihood, less what the part must gain beyond others."""
        return self.log - self.even - _handicap(self.part)


def _measure_even(at: Likelihood, tried: Sequence[PossiblePart]) -> float:
    """Measure what twice the log likelihood gains by noise that is alike in all rows, where a part
    that is tried must gain more than that."""
    all_even = (part.even for part in tried if part.even is not None)
    even = next(all_even, None)
    if even is None:
        return 0.0
    trial = maximise_likelihood(at.model, [even], at.parts, exact=False)
    return max(trial.log - at.log, 0.0)


def _try(at: Likelihood, part: PossiblePart, variance: float, even: float) -> _Trial:
    start = replace(part.error, variance=variance)
    trial = maximise_likelihood(at.model, [start], at.parts, exact=False)
    gain = trial.log - at.log - even
    p = part.tests * compute_p(gain)
    is_there = any(part.error.is_like(own) for own in trial.parts)
    if not is_there:
        p = 1.0
    elif part.told_by == DIRECTIONS:
        # a few loud rows gain as much as a joint that does not repeat
        by_chance = part.tests * compute_alignment_p(at, part.error)
        p = max(p, by_chance)
    elif part.repeating is not None and _comes_back(at, part.repeating, trial):
        p = 1.0
    return _Trial(part, trial.parts, trial.log, p, even)


@dataclass(frozen=True, eq=False)
class _Beside:
    """What rows of a visit or of a posture may share in all directions, `shared`, beside a joint that
    these rows tell: a likelihood without it gives some of that to joints."""

    at: Likelihood
    shared: tuple[SharedError, ...]

    @classmethod
    def of(cls, at: Likelihood, scores: Sequence[_Score]) -> _Beside:
        """Return what rows may share of the parts that are scored."""
        shared = []
        for score in scores:
            if score.part.name == SHARED_BY_ROWS:
                own = replace(score.part.error, variance=score.variance)
                shared.append(own)
        return cls(at, tuple(shared))

    @cached_property
    def without(self) -> Likelihood:
        """The likelihood with what rows share, and no joint."""
        if not self.shared:
            return self.at
        return maximise_likelihood(self.at.model, self.shared, self.at.parts, exact=False)

    def hold(self, trial: _Trial) -> _Trial:
        """Hold the trial of a joint that several rows tell against what these rows share, and against
        errors of the same lengths that are turned at random."""
        if not trial.part.by_rows:
            return trial
        joint = trial.every[-1]
        without = self.without
        both = maximise_likelihood(self.at.model, (*self.shared, joint), self.at.parts, exact=False)
        gain = both.log - without.log
        p = compute_p(gain)
        if p <= LEVEL:
            turned = compute_turned_p(without, joint)
            p = max(p, turned)
        return trial._replace(p=max(trial.p, p))


def _comes_back(at: Likelihood, repeating: SharedError, trial: Likelihood) -> bool:
    """Whether an error that comes back with the posture tells the data better than a trial's, of another
    draw a visit."""
    start = replace(repeating, variance=trial.parts[-1].variance)
    again = maximise_likelihood(at.model, [start], at.parts, exact=False)
    return again.log - trial.log > COMES_BACK


def _climb(at: Likelihood, lengths: Sequence[PossiblePart], best: _Trial) -> _Trial:
    """Try the neighbouring correlation lengths as long as the likelihood rises."""
    first = best
    for step in (1, -1):
        k = lengths.index(best.part) + step
        while 0 <= k < len(lengths):
            last = best.every[-1:]
            variance = last[0].variance if last else 1.0
            trial = _try(at, lengths[k], variance, best.even)
            if trial.log <= best.log:
                break
            best = trial
            k += step
        if best is not first:
            break  # below it lies what was there first
    return best


def compute_p(gain: float) -> float:
    """Compute how often a part that is not there gains as much twice the log likelihood by chance."""
    from scipy.special import chdtrc

    return 0.5 * float(chdtrc(1, gain)) if gain > 0 else 1.0
