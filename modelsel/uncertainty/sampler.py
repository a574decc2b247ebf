"""emcee, wrapped: one seed and the same chain again, chunks that can be resumed, and no number from
an unconverged chain.

Moves: differential evolution 0.8, snooker 0.2 (ter Braak 2006; ter Braak & Vrugt 2008), from
walkers spread more widely than the posterior; a third of them draws an inner constant anew where
there is one. The chain is done when it is longer than 50 autocorrelation times, these are stable,
and R-hat is low."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from .._typing import Array
from .log_posterior import LogPosterior
from .mcmc import autocorrelation_time, build_moves, r_hat
from .posterior import Importance

if TYPE_CHECKING:
    import pandas as pd

LONG = 50  # autocorrelation times
STABLE = 0.1  # change of the longest time between two checks
AGREE = 1.05  # largest R-hat; walkers of 50 autocorrelation times come to 1.02 when all is well
FIRST, GROWTH = 600, 1.5
MOST_STEPS = 20_000
THINNED = (1, 2, 4, 5, 10)  # every which step is stored: autocorrelation times grow with the names
WALKERS, PER_NAME = 48, 3
SHOWN = 400  # draws kept for pictures
PICTURED = 6  # names in them
PROBABILITIES = (0.025, 0.5, 0.975)

RandomState = tuple[str, Array, int, int, float]


@dataclass(frozen=True, eq=False)
class State:
    """An unfinished chain: stored steps (n, W, d), their log densities (n, W), accepted moves among
    the stored steps (W,), emcee's random state."""

    chain: Array
    log_density: Array
    accepted: Array
    random: RandomState


class Keeper(Protocol):
    """Where unfinished chains are kept."""

    def load(self, names: Sequence[str]) -> State | None:
        """What was kept for these names, if anything."""
        ...

    def keep(self, names: Sequence[str], state: State, *, now: bool = False) -> None:
        """Keep a chain; unless `now`, only when the last time was some seconds ago."""
        ...


@dataclass(frozen=True, eq=False)
class Sampling:
    """A finished chain: `chain` (n, W, d) in the units of the report, every `thin`-th step after
    `burn` stored ones; times in steps, by name; quantiles (d, 3) at 2.5, 50 and 97.5 % and the
    closed form's; `what` says what was sampled."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    chain: Array = field(repr=False)
    thin: int
    steps: int
    tau: Array
    r_hat: Array
    acceptance: float
    converged: bool
    closed_form: Array = field(repr=False)
    importance: Importance
    what: str

    @property
    def walkers(self) -> int:
        """How many."""
        return int(self.chain.shape[1])

    @property
    def effective(self) -> Array:
        """(d,) effective samples of emcee itself."""
        return np.asarray(self.chain.shape[0] * self.thin * self.walkers / self.tau)

    @property
    def quantiles(self) -> Array:
        """(d, 3) of the chain."""
        return np.asarray(np.quantile(self.chain, PROBABILITIES, axis=(0, 1)).T)

    @property
    def spread(self) -> Array:
        """(d,) standard deviations."""
        return np.asarray(self.chain.std((0, 1)))

    def to_dict(self) -> dict[str, Any]:
        """The result file's entry; quantiles and draws of an unconverged chain are null."""
        from dataclasses import asdict

        keys = ("low", "median", "high")
        quantiles = self.quantiles if self.converged else np.full((len(self.names), 3), np.nan)
        informative = self._informative()
        flat = self.chain.reshape(-1, len(self.names))
        step = -(-len(flat) // SHOWN)
        return {
            "effective_samples": self.effective.min(),
            "r_hat": self.r_hat.max(),
            "tau": self.tau.max(),
            "converged": self.converged,
            "acceptance": self.acceptance,
            "steps": self.steps,
            "walkers": self.walkers,
            "sampled": list(self.names),
            "sentence": self.what,
            "quantiles": [
                {
                    "name": name,
                    "unit": unit,
                    **dict(zip(keys, q, strict=True)),
                    **{f"closed_form_{k}": v for k, v in zip(keys, c, strict=True)},
                }
                for name, unit, q, c in zip(
                    self.names, self.units, quantiles, self.closed_form, strict=True
                )
            ],
            "importance": asdict(self.importance),
            "trace": {
                "names": [self.names[j] for j in informative],
                "draws": flat[::step, informative] if self.converged else [],
            },
        }

    def _informative(self) -> list[int]:
        """The names most correlated with another, in order."""
        if len(self.names) <= PICTURED:
            return list(range(len(self.names)))
        r = np.abs(np.corrcoef(self.chain.reshape(-1, len(self.names)).T)) - np.eye(len(self.names))
        return sorted(np.argsort(-np.nan_to_num(r).max(0), kind="stable")[:PICTURED].tolist())

    def to_dataframe(self) -> pd.DataFrame:
        """A row per stored step and walker, a column per name."""
        import pandas as pd

        n, W, d = self.chain.shape
        index = pd.MultiIndex.from_product([range(n), range(W)], names=["step", "walker"])
        return pd.DataFrame(self.chain.reshape(n * W, d), index=index, columns=list(self.names))

    def to_arviz(self) -> Any:
        """An ArviZ data tree: the walkers are its chains. Raises ImportError naming the extra where
        ArviZ is missing."""
        try:
            from arviz_base import from_dict
        except ImportError:
            raise ImportError(
                "to_arviz needs ArviZ: python -m pip install 'modelsel[arviz]'"
            ) from None
        return from_dict(
            {"posterior": {name: self.chain[:, :, j].T for j, name in enumerate(self.names)}}
        )


def schedule_check(check: int, need: float) -> int:
    """Steps at which the chain is judged next: when it should be long enough, but no more than
    GROWTH times later, so that the times are seen to settle."""
    wanted = min(GROWTH * check, max(1.02 * need, 1.15 * check))
    return min(MOST_STEPS, 100 * int(np.ceil(wanted / 100)))


def sample_posterior(
    log_posterior: LogPosterior,
    importance: Importance,
    what: str,
    rng: np.random.Generator,
    *,
    say: Callable[[str], None] = lambda _: None,
    keeper: Keeper | None = None,
) -> Sampling:
    """Run emcee on a target until it has converged, or for MOST_STEPS. An interruption keeps the
    chunks that are done."""
    thin = max(n for n in THINNED if n == 1 or 6 * n <= log_posterior.size)
    done = None if keeper is None else keeper.load(log_posterior.names)
    walker = _Walk(log_posterior, rng, thin, done)
    tau: Array | None = None
    check = min(FIRST, MOST_STEPS)
    while True:
        try:
            while walker.steps < check:
                walker.run(min(100 * thin, check - walker.steps))
                if keeper is not None:
                    keeper.keep(log_posterior.names, walker.state())
        except KeyboardInterrupt:
            if keeper is not None and walker.steps:
                keeper.keep(log_posterior.names, walker.state(), now=True)
            raise
        chain = log_posterior.values(
            walker.chain[: check // thin]
        )  # a resumed chain is judged where the unbroken one was
        before, tau = tau, _times(chain, thin)
        longest, kept = float(tau.max()), check - _burn(tau, thin, len(chain)) * thin
        need = LONG * longest + (check - kept)
        say(
            f"sampling: tau {longest:.0f}, {check:,} of {need:,.0f} steps, {min(check / need, 1):.0%}"
        )
        stable = before is not None and abs(longest - float(before.max())) < STABLE * longest
        long = kept > LONG * longest and stable
        if long or check == MOST_STEPS:
            agree = r_hat(chain[_burn(tau, thin, len(chain)) :])
            if check == MOST_STEPS or agree.max() < AGREE:
                return _finished(
                    log_posterior,
                    walker,
                    tau,
                    agree,
                    bool(long and agree.max() < AGREE),
                    importance,
                    what,
                )
        check = schedule_check(check, need)


def _times(chain: Array, thin: int) -> Array:
    return np.maximum(autocorrelation_time(chain[len(chain) // 10 :]) * thin, 1.0)


def _burn(tau: Array, thin: int, stored: int) -> int:
    """Stored steps left out at the start: two autocorrelation times."""
    longest = float(tau.max())
    return (
        stored // 2
        if not np.isfinite(longest)
        else min(int(np.ceil(2 * longest / thin)), stored // 2)
    )


def _finished(
    log_posterior: LogPosterior,
    walker: _Walk,
    tau: Array,
    agree: Array,
    converged: bool,
    importance: Importance,
    what: str,
) -> Sampling:
    chain = log_posterior.values(walker.chain[_burn(tau, walker.thin, len(walker.chain)) :])
    return Sampling(
        log_posterior.names,
        log_posterior.units,
        chain,
        walker.thin,
        walker.steps,
        tau,
        agree,
        float(walker.accepted.mean()) * walker.thin / walker.steps,
        converged,
        log_posterior.closed_form(PROBABILITIES),
        importance,
        what,
    )


class _Walk:
    """emcee's ensemble and what it has done so far."""

    def __init__(
        self, log_posterior: LogPosterior, rng: np.random.Generator, thin: int, done: State | None
    ):
        import emcee

        walkers = max(WALKERS, 2 * -(-PER_NAME * log_posterior.size // 2))
        start = log_posterior.start(rng, walkers)
        seed = int(rng.integers(2**32))
        if done is None:
            # emcee draws from a legacy RandomState; its own `random_state` setter fails silently on
            # what is not one
            first = np.random.RandomState(seed).get_state(legacy=True)
            self.parts, self.densities = [np.empty((0, *start.shape))], [np.empty((0, walkers))]
            self.accepted = np.zeros(walkers)
            self.here = emcee.State(start, random_state=first)
        else:
            self.parts, self.densities, self.accepted = (
                [done.chain],
                [done.log_density],
                done.accepted,
            )
            self.here = emcee.State(
                done.chain[-1], log_prob=done.log_density[-1], random_state=done.random
            )
        self.thin = thin
        self.sampler = emcee.EnsembleSampler(
            walkers,
            log_posterior.size,
            log_posterior.log_density,
            moves=build_moves(log_posterior.ranges),
            vectorize=True,
        )
        self.sampler.log_prob_fn = (
            log_posterior.log_density
        )  # bare: emcee's wrapper prints a traceback, on Ctrl-C too

    @property
    def chain(self) -> Array:
        """(stored, W, d)."""
        self.parts = [np.concatenate(self.parts)]
        return self.parts[0]

    @property
    def steps(self) -> int:
        """Steps done."""
        return sum(map(len, self.parts)) * self.thin

    def run(self, steps: int) -> None:
        """So many steps more."""
        self.sampler.reset()
        after = self.sampler.run_mcmc(
            self.here, steps // self.thin, thin_by=self.thin, skip_initial_state_check=True
        )
        self.parts.append(self.sampler.get_chain())
        self.densities.append(self.sampler.get_log_prob())
        self.accepted = self.accepted + self.sampler.backend.accepted
        self.here = after

    def state(self) -> State:
        """What a resumed run needs."""
        self.densities = [np.concatenate(self.densities)]
        return State(self.chain, self.densities[0], self.accepted, self.here.random_state)
