"""Sampling with emcee: reproducible from one seed, resumable in chunks, and no number from an
unconverged chain.

Moves: differential evolution 0.4, snooker 0.1 (ter Braak 2006; ter Braak & Vrugt 2008), and 0.5 that
draw a walker anew about where the others stand, from walkers spread more widely than the posterior;
where there are inner constants, a third of the moves draws one of them anew. The chain has converged when it is longer than 50 autocorrelation times,
these are stable, and R-hat is low (`SamplingOptions`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from .._progress import News, keep_silent
from .._typing import Array, Say
from .log_posterior import LogPosterior
from .mcmc import autocorrelation_time, r_hat
from .posterior import Importance
from .sampling_options import CHUNK, DEFAULT_SAMPLING, SamplingOptions
from .walk import State, Walk

if TYPE_CHECKING:
    import pandas as pd

# every which step may be stored: autocorrelation times grow with the number of names
THINNINGS = (1, 2, 4, 5, 10)
# names for each further step that is skipped
NAMES_PER_STEP = 6
# draws kept for pictures, and names in them
MAX_DRAWS = 400
MAX_PICTURED = 6
PROBABILITIES = (0.025, 0.5, 0.975)
QUANTILE_KEYS = ("low", "median", "high")


class Keeper(Protocol):
    """Store of unfinished chains."""

    def load(self, names: Sequence[str]) -> State | None:
        """Load the chain kept for these names, if there is one."""
        ...

    def keep(self, names: Sequence[str], state: State, *, now: bool = False) -> None:
        """Keep a chain; unless `now`, only if some seconds have passed since the last time."""
        ...


@dataclass(frozen=True, eq=False)
class Sampling:
    """A finished chain of d numbers.

    names, units: of the d numbers.
    chain: (n, W, d) in the units of the report, every `thin`-th step without the burn-in.
    thin, steps: steps per stored step, and steps in all.
    tau: (d,) autocorrelation times in steps.
    r_hat: (d,) rank-normalised split R-hat.
    acceptance: share of accepted moves.
    converged: whether the chain fulfils the options; if not, none of its numbers are quoted.
    closed_form: (d, 3) quantiles of the closed form at 2.5, 50 and 97.5 %.
    importance: quality of the closed form.
    what: a sentence that says what was sampled.
    """

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
        """Number of walkers W."""
        shape = self.chain.shape
        return int(shape[1])

    @property
    def effective(self) -> Array:
        """(d,) effective number of independent samples: all steps of all walkers over tau."""
        steps = self.chain.shape[0] * self.thin
        return np.asarray(steps * self.walkers / self.tau)

    @property
    def quantiles(self) -> Array:
        """(d, 3) quantiles of the chain at 2.5, 50 and 97.5 %."""
        quantiles = np.quantile(self.chain, PROBABILITIES, axis=(0, 1))
        return np.asarray(quantiles.T)

    @property
    def spread(self) -> Array:
        """(d,) standard deviations of the chain."""
        chain = self.chain
        deviation = chain.std((0, 1))
        return np.asarray(deviation)

    def to_dict(self) -> dict[str, Any]:
        """Return the result file's entry; quantiles and draws of an unconverged chain are null."""
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
            "quantiles": self._quantile_records(),
            "importance": asdict(self.importance),
            "trace": self._trace_record(),
        }

    def _quantile_records(self) -> list[dict[str, Any]]:
        """List the quantiles of every name, of the chain and of the closed form."""
        quantiles = np.full((len(self.names), 3), np.nan)
        if self.converged:
            quantiles = self.quantiles
        records = []
        for j, name in enumerate(self.names):
            record = {"name": name, "unit": self.units[j]}
            record |= dict(zip(QUANTILE_KEYS, quantiles[j], strict=True))
            closed = zip(QUANTILE_KEYS, self.closed_form[j], strict=True)
            record |= {f"closed_form_{key}": value for key, value in closed}
            records.append(record)
        return records

    def _trace_record(self) -> dict[str, Any]:
        """Select some draws of the most informative names, for pictures."""
        pictured = self._pictured()
        count = len(self.names)
        flat = self.chain.reshape(-1, count)
        step = -(-len(flat) // MAX_DRAWS)
        draws = flat[::step, pictured]
        return {
            "names": [self.names[j] for j in pictured],
            "draws": draws if self.converged else [],
        }

    def _pictured(self) -> list[int]:
        """Return the positions of the names most correlated with another, in order."""
        count = len(self.names)
        if count <= MAX_PICTURED:
            return list(range(count))
        flat = self.chain.reshape(-1, count)
        correlation = np.abs(np.corrcoef(flat.T)) - np.eye(count)
        strongest = np.nan_to_num(correlation).max(0)
        return sorted(np.argsort(-strongest, kind="stable")[:MAX_PICTURED].tolist())

    def to_dataframe(self) -> pd.DataFrame:
        """Return a table with a row per stored step and walker, and a column per name."""
        import pandas as pd

        n, W, d = self.chain.shape
        index = pd.MultiIndex.from_product([range(n), range(W)], names=["step", "walker"])
        return pd.DataFrame(self.chain.reshape(n * W, d), index=index, columns=list(self.names))

    def to_arviz(self) -> Any:
        """Return an ArviZ data tree, the walkers as its chains.

        Raises ImportError, with the command that installs it, where ArviZ is missing."""
        try:
            from arviz_base import from_dict
        except ImportError:
            raise ImportError(
                "to_arviz needs ArviZ: python -m pip install 'modelsel[arviz]'"
            ) from None
        chains = {name: self.chain[:, :, j].T for j, name in enumerate(self.names)}
        return from_dict({"posterior": chains})


def sample_posterior(
    log_posterior: LogPosterior,
    importance: Importance,
    what: str,
    rng: np.random.Generator,
    *,
    say: Say = keep_silent,
    keeper: Keeper | None = None,
    options: SamplingOptions = DEFAULT_SAMPLING,
) -> Sampling:
    """Sample a log posterior with emcee until the chain has converged, or for `options.max_steps`.

    importance, what: stored with the result. `say` is told the progress. `keeper` keeps the chunks
    that are done, so that an interrupted chain can be resumed."""
    thin = _choose_thinning(log_posterior.size)
    state = None if keeper is None else keeper.load(log_posterior.names)
    walk = Walk(log_posterior, rng, thin, state, options)
    tau: Array | None = None
    check = min(options.first_check, options.max_steps)
    needed: float | None = None
    while True:
        _advance(walk, check, keeper, needed, say)
        # a resumed chain is judged where the unbroken one was
        chain = log_posterior.values(walk.chain[: check // thin])
        before = tau
        tau = _autocorrelation_times(chain, thin)
        longest = float(tau.max())
        burnt = _burn_in(tau, thin, len(chain))
        kept = check - burnt * thin
        needed = options.min_times * longest + (check - kept)
        needed = min(needed, options.max_steps)
        change = np.inf if before is None else abs(longest - float(before.max()))
        settled = change < options.max_change * longest
        long = kept > options.min_times * longest and settled
        last = check == options.max_steps
        if long or last:
            agreement = r_hat(chain[burnt:])
            agrees = bool(agreement.max() < options.max_r_hat)
            if last or agrees:
                return _finish(walk, tau, agreement, long and agrees, importance, what)
        check = options.next_check(check, needed)


def _choose_thinning(names: int) -> int:
    """Choose every which step to store, from the number of names."""
    return max(n for n in THINNINGS if n == 1 or NAMES_PER_STEP * n <= names)


def _advance(walk: Walk, steps: int, keeper: Keeper | None, needed: float | None, say: Say) -> None:
    """Run a walk up to so many steps; an interruption keeps the chunks that are done.

    needed: steps that the chain will take in all, as far as is known."""
    names = walk.log_posterior.names
    try:
        while walk.steps < steps:
            walk.run(min(CHUNK * walk.thin, steps - walk.steps))
            say(_describe_advance(walk.steps, steps, needed))
            if keeper is not None:
                keeper.keep(names, walk.state())
    except KeyboardInterrupt:
        if keeper is not None and walk.steps:
            keeper.keep(names, walk.state(), now=True)
        raise


def _describe_advance(done: int, next_look: int, needed: float | None) -> News:
    """Describe how far a chain is; before the first look nobody knows how long it must be."""
    if needed is None:
        return News(f"{done:,} of at least {next_look:,} steps")
    most = max(next_look, needed)
    return News(f"{done:,} of {most:,.0f} steps", done / most)


def _autocorrelation_times(chain: Array, thin: int) -> Array:
    """Compute autocorrelation times (d,) in steps, at least one, without the first tenth of the
    chain."""
    tenth = len(chain) // 10
    rest = chain[tenth:]
    stored = autocorrelation_time(rest)
    times = stored * thin
    return np.maximum(times, 1.0)


def _burn_in(tau: Array, thin: int, stored: int) -> int:
    """Count the stored steps to leave out at the start: two autocorrelation times, at most half of
    them."""
    half = stored // 2
    longest = float(tau.max())
    if not np.isfinite(longest):
        return half
    needed = 2 * longest / thin
    return min(int(np.ceil(needed)), half)


def _finish(
    walk: Walk, tau: Array, agreement: Array, converged: bool, importance: Importance, what: str
) -> Sampling:
    log_posterior = walk.log_posterior
    burnt = _burn_in(tau, walk.thin, len(walk.chain))
    return Sampling(
        log_posterior.names,
        log_posterior.units,
        log_posterior.values(walk.chain[burnt:]),
        walk.thin,
        walk.steps,
        tau,
        agreement,
        float(walk.accepted.mean()) * walk.thin / walk.steps,
        converged,
        log_posterior.closed_form(PROBABILITIES),
        importance,
        what,
    )
