"""Effective samples a second of the exact posterior (closed form and importance weights) against
emcee with the same likelihood."""

from __future__ import annotations

import importlib.util
import time

import numpy as np

from modelsel.fitting.least_squares import fit

from .timing import arm_scene

M, STEPS, WALKERS = 80, 15_000, 60


def run() -> dict[str, float]:
    if importlib.util.find_spec("modelsel.uncertainty.posterior") is None:
        print("posterior: modelsel.uncertainty.posterior is not there; its figure is left out")
        return {}
    import emcee

    from modelsel.fitting.batch import Ensemble
    from modelsel.uncertainty.posterior import linear_posterior, weight_draws

    problem, model = arm_scene(M)
    fitted = fit(problem, model, held="nothing")  # emcee's likelihood has no prior either
    kept = list(fitted.found.kept)
    rng = np.random.default_rng(2)

    best = 0.0
    for _ in range(3):
        start = time.process_time()
        exact = linear_posterior(fitted)
        draws = weight_draws(problem, fitted, exact.draw(rng, 4000))
        best = max(best, draws.effective / (time.process_time() - start))

    ensemble, d = Ensemble(problem, fitted.terms), len(kept) + 1

    def log_probability(x: np.ndarray) -> np.ndarray:
        theta = np.zeros((len(x), len(fitted.terms)))
        theta[:, kept] = x[:, :-1]
        cost = np.square(ensemble.residuals(theta)).sum((1, 2))
        return -cost / (2 * np.exp(2 * x[:, -1])) - fitted.rows * x[:, -1]

    first = exact.draw(rng, WALKERS)
    p0 = np.column_stack([first.theta[:, kept], np.log(first.sigma)])
    out = {}
    moves = {"": None, "_de": [(emcee.moves.DEMove(), 0.8), (emcee.moves.DESnookerMove(), 0.2)]}
    for name, move in moves.items():
        sampler = emcee.EnsembleSampler(WALKERS, d, log_probability, vectorize=True, moves=move)
        state = emcee.State(p0, random_state=np.random.RandomState(3).get_state())
        start = time.process_time()
        sampler.run_mcmc(state, STEPS)
        seconds = time.process_time() - start
        tau = float(sampler.get_autocorr_time(quiet=True, tol=0).mean())
        rate = STEPS * WALKERS / max(tau, 1.0) / seconds
        out[f"posterior_vs_emcee{name}"] = best / rate
        out[f"emcee{name}_tau"] = tau
    return out | {
        "posterior_effective_per_second": best,
        "posterior_effective_share": draws.effective / 4000,
    }
