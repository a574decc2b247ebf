"""A chain that grows: emcee's ensemble, the steps it has done, and what goes on from them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .._typing import Array
from .log_posterior import LogPosterior
from .mcmc import build_moves
from .sampling_options import SamplingOptions

RandomState = tuple[str, Array, int, int, float]


@dataclass(frozen=True, eq=False)
class State:
    """An unfinished chain.

    chain: stored steps (n, W, d).
    log_density: (n, W) of the stored steps.
    accepted: (W,) accepted moves among the stored steps.
    random: emcee's random state.
    """

    chain: Array
    log_density: Array
    accepted: Array
    random: RandomState


class Walk:
    """emcee's ensemble and the steps it has done."""

    def __init__(
        self,
        log_posterior: LogPosterior,
        rng: np.random.Generator,
        thin: int,
        state: State | None,
        options: SamplingOptions,
    ):
        import emcee

        self.log_posterior = log_posterior
        self.thin = thin
        pairs = -(-options.walkers_per_name * log_posterior.size // 2)
        walkers = max(options.min_walkers, 2 * pairs)
        # drawn in any case, so that a resumed chain goes on with the same random numbers
        start = log_posterior.start(rng, walkers)
        seed = int(rng.integers(2**32))
        if state is None:
            self._begin(start, seed)
        else:
            self._resume(state)
        self.sampler = emcee.EnsembleSampler(
            walkers,
            log_posterior.size,
            log_posterior.log_density,
            moves=build_moves(log_posterior.ranges),
            vectorize=True,
        )
        # bare: emcee's own prints a traceback, on Ctrl-C too, and takes long over each walker
        self.sampler.compute_log_prob = self._log_density

    def _begin(self, start: Array, seed: int) -> None:
        """Begin a chain at walkers (W, d)."""
        import emcee

        # emcee draws from a legacy RandomState; its own `random_state` setter fails silently on
        # what is not one
        random = np.random.RandomState(seed).get_state(legacy=True)
        self.parts = [np.empty((0, *start.shape))]
        self.densities = [np.empty((0, len(start)))]
        self.accepted = np.zeros(len(start))
        self.position = emcee.State(start, random_state=random)

    def _resume(self, state: State) -> None:
        """Resume an unfinished chain."""
        import emcee

        self.parts = [state.chain]
        self.densities = [state.log_density]
        self.accepted = state.accepted
        self.position = emcee.State(
            state.chain[-1], log_prob=state.log_density[-1], random_state=state.random
        )

    def _log_density(self, walkers: Array) -> tuple[Array, None]:
        """Compute the log density (W,) and, as emcee expects, nothing more."""
        density = self.log_posterior.log_density(walkers)
        if np.isnan(density).any():
            raise ValueError("the log density is undefined")
        return density, None

    @property
    def chain(self) -> Array:
        """(stored, W, d)."""
        chain = np.concatenate(self.parts)
        self.parts = [chain]
        return chain

    @property
    def steps(self) -> int:
        """Number of steps done."""
        stored = 0
        for part in self.parts:
            stored += len(part)
        return stored * self.thin

    def run(self, steps: int) -> None:
        """Run so many more steps."""
        self.sampler.reset()
        after = self.sampler.run_mcmc(
            self.position, steps // self.thin, thin_by=self.thin, skip_initial_state_check=True
        )
        self.parts.append(self.sampler.get_chain())
        self.densities.append(self.sampler.get_log_prob())
        self.accepted = self.accepted + self.sampler.backend.accepted
        self.position = after

    def state(self) -> State:
        """Return what a resumed run needs."""
        self.densities = [np.concatenate(self.densities)]
        return State(self.chain, self.densities[0], self.accepted, self.position.random_state)
