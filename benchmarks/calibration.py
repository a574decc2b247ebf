"""Whether the intervals mean what they say, and what the sampling costs.

    python -m benchmarks.calibration --studies 2000 --chains 100 --out benchmarks/results/calibration.txt

Coverage and rank histograms of the closed form over simulated studies of a three-joint arm; the
same of emcee with a Student-t tail, its 1/ν drawn from its prior (short chains: a rank needs no two
thousand draws); the same where a tracker was moved at a moment that is drawn, too, by little or by
more (--steps); what emcee 3.1.6's own snooker move does to a normal density; effective samples per
second on the PUMA study."""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.stats import chi2

from modelsel import Model, mechanism, read_study
from modelsel.fitting.design import residuals
from modelsel.fitting.least_squares import Fit, fit
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.environment import tracker_step
from modelsel.mechanisms.registry import BUILTIN
from modelsel.robot.kinematics import Joint, Robot, forward
from modelsel.study.pipeline.result import Result
from modelsel.study.pipeline.runner import run_study
from modelsel.uncertainty import conditional_priors as conditional
from modelsel.uncertainty.log_posterior import TAIL, LogPosterior
from modelsel.uncertainty.nuisance import assign_components, list_constants
from modelsel.uncertainty.posterior import (
    Importance,
    linear_posterior,
    summarise_importance,
    weight_draws,
)
from modelsel.uncertainty.sampler import sample_posterior
from modelsel.uncertainty.sampling_options import SamplingOptions

TOOL = np.array([40.0, -25.0, 100.0])
BINS = 10


def arm() -> Robot:
    first, second, third, last = (np.eye(4) for _ in range(4))
    first[2, 3], second[0, 3], third[0, 3], last[0, 3] = 300.0, 50.0, 400.0, 350.0
    second[:3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    return Robot("small", "made up", (Joint(first), Joint(second), Joint(third)), last)


ARM = arm()
BASE = Model((mechanism("geometric", ARM),))
MODEL = Model((*BASE.mechanisms, mechanism("joint-compliance:2", ARM)))


def simulated(
    at: Problem, rng: np.random.Generator, sigma: float, nu: float | None
) -> tuple[Problem, Fit, np.ndarray]:
    """(a study, its fit, what was planted)."""
    kept = list(fit(at, MODEL, held="nothing").found.kept)
    truth = np.zeros(len(MODEL.terms))
    truth[kept] = rng.normal(0, 0.3 * np.array([MODEL.terms[k].size[1] for k in kept]))
    noise = rng.normal(0, sigma, (len(at), 3))
    if nu is not None:
        noise /= np.sqrt(rng.chisquare(nu, (len(at), 1)) / nu)
    planted = replace(
        at,
        data=replace(
            at.data, position=at.data.position - residuals(at, MODEL.terms, truth) + noise
        ),
    )
    return planted, fit(planted, MODEL, start=truth, held="nothing"), truth


def uniform(ranks: np.ndarray) -> float:
    """Smallest p of the chi-square tests of uniformity, one a parameter, times their number."""
    counts = np.stack([np.histogram(r, BINS, (0, 1))[0] for r in ranks.T])
    expected = len(ranks) / BINS
    return float(
        min(
            chi2.sf(np.square(counts - expected).sum(1) / expected, BINS - 1).min()
            * ranks.shape[1],
            1,
        )
    )


def closed(studies: int, rng: np.random.Generator) -> list[str]:
    q = ARM.draw(rng, 12)
    at = Problem(ARM, build_measurements(q, forward(ARM, q, TOOL)), TOOL[None])
    ranks, covered = [], []
    for _ in range(studies):
        sigma = float(np.exp(rng.normal(-2, 0.5)))
        planted, fitted, truth = simulated(at, rng, sigma, None)
        kept, known = list(fitted.found.kept), linear_posterior(fitted)
        draws = weight_draws(planted, fitted, known.draw(rng, 199))
        ranks.append(draws.weight @ (draws.theta[:, kept] < truth[kept]))
        low, high = known.quantile(np.array([0.025, 0.975])).T
        covered.append(
            [
                *((low[kept] < truth[kept]) & (truth[kept] < high[kept])),
                known.scale_quantile(0.025) < sigma < known.scale_quantile(0.975),
            ]
        )
    share = np.mean(covered, axis=0)
    return [
        (
            f"closed form, {studies:,} studies of {len(kept)} parameters: 95 % intervals cover {share[:-1].mean():.2%} "
            f"({share[:-1].min():.2%} to {share[:-1].max():.2%}), of the noise scale {share[-1]:.2%}; "
            f"ranks against uniform: smallest p {uniform(np.array(ranks)):.2f} (times their number)"
        )
    ]


def chains(count: int, rng: np.random.Generator) -> list[str]:
    options = SamplingOptions(min_times=15, max_r_hat=1.3)
    q = ARM.draw(rng, 25)
    at = Problem(ARM, build_measurements(q, forward(ARM, q, TOOL)), TOOL[None])
    ranks, covered = [], []
    for _ in range(count):
        sigma, tail = float(np.exp(rng.normal(-2, 0.5))), rng.uniform(0, 0.5)
        planted, fitted, truth = simulated(at, rng, sigma, 1 / tail)
        chosen = tuple(fitted.found.kept[-4:])
        names = (*map(str, chosen), "noise scale", TAIL)
        target = LogPosterior(
            fitted, assign_components(planted), chosen, names, ("1",) * len(names), True
        )
        done = sample_posterior(target, Importance(1, 1.0, ""), "", rng, options=options)
        planted_values = np.array([*truth[list(chosen)], sigma, tail])
        ranks.append((done.chain < planted_values).mean((0, 1)))
        low, _, high = done.quantiles.T
        covered.append((low < planted_values) & (planted_values < high))
    share = np.mean(covered, axis=0)
    return [
        (
            f"emcee, {count} studies, Student-t noise, 1/ν from its prior, {len(names)} sampled, {len(fitted.found.kept) - 4} "
            f"integrated out: 95 % intervals cover {share.mean():.1%} ({', '.join(f'{s:.0%}' for s in share)}); ranks against "
            f"uniform: smallest p {uniform(np.array(ranks)):.2f} (times their number)"
        )
    ]


def moments(count: int, rng: np.random.Generator, ratio: float) -> list[str]:
    """A step of the tracker, its moment and size drawn from their priors; every model is fitted
    with the step where a scan puts it. The prior's ratio v/s² is given, not found from the data."""
    options = SamplingOptions(min_times=20, max_r_hat=1.1)
    conditional.RATIOS = np.array([ratio])
    m, k = 50, len(BASE.terms)
    q = ARM.draw(rng, m)
    at = Problem(ARM, build_measurements(q, forward(ARM, q, TOOL)), TOOL[None])
    quiet = replace(
        at, data=replace(at.data, position=at.data.position + rng.normal(0, 1.0, (m, 3)))
    )
    root = (
        _target(quiet, fit(quiet, stepped(0.5)))._conditionals[0].prior
    )  # of any step, the middle one as good as another
    ranks, covered, converged, steps = [], [], 0, []
    for _ in range(count):
        sigma, tail, moment = (
            float(np.exp(rng.normal(-2, 0.5))),
            rng.uniform(0, 0.5),
            rng.uniform(0, 1),
        )
        truth = stepped(moment)
        theta = np.zeros(len(truth.terms))
        kept = [j for j in fit(at, truth, held="nothing").found.kept if j < k]
        theta[kept] = rng.normal(0, 0.3 * np.array([truth.terms[j].size[1] for j in kept]))
        theta[k:] = sigma * np.linalg.solve(root, rng.standard_normal(6))
        noise = rng.normal(0, sigma, (m, 3)) / np.sqrt(rng.chisquare(1 / tail, (m, 1)) * tail)
        planted = replace(
            at,
            data=replace(
                at.data, position=at.data.position - residuals(at, truth.terms, theta) + noise
            ),
        )
        fitted = min(
            (fit(planted, stepped(round(x, 3))) for x in np.arange(0.1, 0.91, 0.05)),
            key=lambda f: f.rss,
        )
        done = sample_posterior(
            _target(planted, fitted), Importance(1, 1.0, ""), "", rng, options=options
        )
        planted_values = np.array([*theta[k:], sigma, tail, moment])
        ranks.append((done.chain < planted_values).mean((0, 1)))
        low, _, high = done.quantiles.T
        covered.append((low < planted_values) & (planted_values < high))
        converged, steps = converged + done.converged, [*steps, done.steps]
    share = np.mean(covered, axis=0)
    return [
        (
            f"a step of the tracker, {count} studies, prior v/s² = {ratio:.3g}: {converged} chains of 20 autocorrelation times converged, after {min(steps):,} "
            f"to {max(steps):,} steps; 95 % intervals cover {share.mean():.1%} ({', '.join(f'{s:.0%}' for s in share)}; the last is "
            f"the moment's); ranks against uniform: smallest p {uniform(np.array(ranks)):.2f} (times their number)"
        )
    ]


def _target(at: Problem, fitted: Fit) -> LogPosterior:
    """Of a step's size and moment, noise scale and tail."""
    chosen = tuple(range(len(BASE.terms), len(fitted.terms)))
    inner = list_constants(at, fitted.model, BUILTIN)
    names = (*map(str, chosen), "noise scale", TAIL, "moment")
    return LogPosterior(
        fitted, assign_components(at), chosen, names, ("1",) * len(names), True, inner
    )


def stepped(at: float) -> Model:
    """The arm's geometry, and a tracker that was moved at a moment."""
    return Model((*BASE.mechanisms, tracker_step(ARM, at)))


def snookers(rng: np.random.Generator, d: int = 11) -> list[str]:
    import emcee

    from modelsel.uncertainty.mcmc import build_moves

    spread = []
    for mix in ([(emcee.moves.DEMove(), 0.8), (emcee.moves.DESnookerMove(), 0.2)], build_moves()):
        sampler = emcee.EnsembleSampler(
            48, d, lambda x: -0.5 * np.square(x).sum(1), moves=mix, vectorize=True
        )
        first = np.random.RandomState(1).get_state(legacy=True)
        sampler.run_mcmc(emcee.State(rng.normal(size=(48, d)), random_state=first), 20_000)
        spread.append(sampler.get_chain(discard=500).std())
    return [
        (
            f"standard deviation of a standard normal in {d} dimensions: {spread[0]:.3f} with emcee's own snooker move, "
            f"{spread[1]:.3f} with ours"
        )
    ]


def speed(result: Result, again: Result) -> list[str]:
    fitted, training = result.models.chosen.fit, result.split.training
    rng = np.random.default_rng(1)
    known = linear_posterior(fitted)
    start = time.process_time()
    for _ in range(20):
        known.draw(rng, 4000)
    plain = 80_000 / (time.process_time() - start)
    start = time.process_time()
    draws = weight_draws(training, fitted, known.draw(rng, 4000))
    exact = draws.effective / (time.process_time() - start)
    out = []
    for each, over in ((result, "default"), (again, "all")):
        s = each.uncertainty.sampling
        start = time.process_time()
        target = LogPosterior(
            fitted,
            assign_components(training),
            tuple(k for k in fitted.found.kept if over == "all" or k >= 39),
            s.names,
            s.units,
            over == "default",
        )
        sample_posterior(target, summarise_importance(draws), "", np.random.default_rng(2))
        seconds = time.process_time() - start
        rate = s.effective.min() / seconds
        out.append(
            f"puma760, over {over}: {len(s.names)} sampled, {s.effective.min():,.0f} effective samples in {seconds:.1f} s of "
            f"one core, {rate:,.0f} a second; closed form {plain / rate:,.0f} times that, weighted on the exact chain "
            f"{exact / rate:,.0f} times"
        )
    return [
        (
            f"closed-form draws of {fitted.rank} parameters: {plain:,.0f} a second, {exact:,.0f} effective a second with exact "
            f"weights ({summarise_importance(draws).sentence})"
        ),
        *out,
    ]


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--studies", type=int, default=2000)
    parser.add_argument("--chains", type=int, default=100)
    parser.add_argument("--steps", type=int, default=40)
    parser.add_argument("--out", type=Path)
    asked = parser.parse_args()
    study = read_study("studies/puma760")
    both = [
        run_study(
            study.model_copy(update={"sampling": study.sampling.model_copy(update={"over": over})}),
            "studies/puma760",
        )
        for over in ("default", "all")
    ]
    lines = speed(both[0], both[1])
    lines += snookers(np.random.default_rng(3)) + closed(asked.studies, np.random.default_rng(4))
    lines += chains(asked.chains, np.random.default_rng(5))
    for seed, ratio in enumerate((3.0, 100.0), 6):
        lines += moments(asked.steps, np.random.default_rng(seed), ratio)
    print("\n".join(lines))
    if asked.out:
        asked.out.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
