"""A sampled moment of a weak step: its posterior is proper, the chain finds all of it, and a dense
formula agrees."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from builders import drawn, planted, small_arm, study_of
from scipy.special import logsumexp

from modelsel._typing import Array
from modelsel.diagnosis.inference.evidence import RATIOS
from modelsel.fitting.design import Model, compute_design
from modelsel.fitting.least_squares import Fit, fit
from modelsel.fitting.problem import Problem
from modelsel.mechanisms.environment import tracker_step
from modelsel.mechanisms.registry import BUILTIN, mechanism
from modelsel.uncertainty.log_posterior import LogPosterior
from modelsel.uncertainty.nuisance import assign_components, list_constants
from modelsel.uncertainty.posterior import Importance
from modelsel.uncertainty.sampler import sample_posterior
from modelsel.uncertainty.sampling_options import SamplingOptions
from modelsel.uncertainty.summary import build_log_posterior

ARM = small_arm()
BASE = Model((mechanism("geometric", ARM),))
FIRST = len(BASE.terms)
NOTHING = Importance(1, 1.0, "")


# chains of 15 autocorrelation times, for tests whose answer does not depend on their number
SHORT = SamplingOptions(min_times=15, max_r_hat=1.2)


def stepped(*moments: float) -> Model:
    """The arm's geometry and a tracker moved at some moments."""
    return Model((*BASE.mechanisms, *(tracker_step(ARM, at) for at in moments)))


def weak(rng: np.random.Generator, size: float = 0.02) -> tuple[Problem, Fit]:
    """A step hardly larger than what noise of 0.05 mm hides, fitted where a scan over the moments
    puts it."""
    at, truth = drawn(ARM, rng, 40), stepped(float(rng.uniform(0.1, 0.9)))
    theta = np.zeros(FIRST + 6)
    theta[FIRST:] = size * np.array([1, 1, 1, 1e-3, 1e-3, 1e-3]) * rng.normal(size=6)
    problem = planted(at, truth.terms, theta, rng, 0.05)
    return problem, min(
        (fit(problem, stepped(round(x, 3))) for x in np.arange(0.1, 0.91, 0.05)),
        key=lambda f: f.rss,
    )


def target(problem: Problem, fitted: Fit) -> LogPosterior:
    """The step's size, its moment and the noise scale; normal noise."""
    chosen = tuple(k for k in fitted.found.kept if k >= FIRST)
    inner = list_constants(problem, fitted.model, BUILTIN)
    names = (*map(str, chosen), "noise scale", *(c.name for c in inner))
    return LogPosterior(
        fitted, assign_components(problem), chosen, names, ("1",) * len(names), constants=inner
    )


def dense(problem: Problem, fitted: Fit, moments: Array, ratio: float) -> Array:
    """(T,) log density of the moment: base as the fit has it, the step's six normal of variance
    ratio · s² · S⁻¹, s² integrated out, from whole design matrices of steps at the moments, the
    rows of the base's prior below them."""
    base = [k for k in fitted.found.kept if k < FIRST]
    X, left = (
        part.reshape(len(problem) * 3, -1)
        for part in compute_design(problem, fitted.terms, fitted.at())
    )
    y = np.concatenate([left[:, 0] + X @ fitted.theta, np.zeros(len(fitted.root))])
    W = np.vstack([X, fitted.root])[:, base]
    steps = [
        np.pad(
            compute_design(problem, stepped(t).terms[FIRST:], fitted.at())[0].reshape(-1, 6),
            ((0, len(fitted.root)), (0, 0)),
        )
        for t in moments
    ]
    M = np.eye(len(y)) - W @ np.linalg.pinv(W)
    precision = np.mean([Z.T @ M @ Z for Z in steps], axis=0) / ratio
    out = []
    for Z in steps:
        A = np.hstack([W, Z])
        inner = A.T @ A
        inner[len(base) :, len(base) :] += precision
        rss = y @ y - y @ A @ np.linalg.solve(inner, A.T @ y)
        out.append(
            0.5 * np.linalg.slogdet(precision)[1]
            - 0.5 * np.linalg.slogdet(inner)[1]
            - 0.5 * (3 * len(problem) + fitted.by_prior - len(base)) * np.log(rss)
        )
    return np.array(out)


@pytest.mark.slow
def test_moment_of_a_weak_step_is_the_dense_formula(rng: np.random.Generator) -> None:
    """Prior size as the evidence has it, moments as often as the formula says."""
    problem, fitted = weak(rng)
    aim = target(problem, fitted)
    moments = (np.arange(1000) + 0.5) / 1000
    (found,) = aim._conditionals
    value = {r: logsumexp(dense(problem, fitted, moments[2::5], r)) for r in map(float, RATIOS)}
    assert value[found.ratio] > max(value.values()) - 0.05
    chain = sample_posterior(aim, NOTHING, "", rng, options=SHORT)
    assert chain.converged
    log_density = dense(problem, fitted, moments, found.ratio)
    share = np.cumsum(np.exp(log_density - logsumexp(log_density)))
    drawn_share = (chain.chain[:, :, -1].ravel()[:, None] < moments[::25] + 0.0005).mean(0)
    off = np.abs(drawn_share - share[::25])
    assert off.max() < 4 * 0.5 / np.sqrt(chain.effective[-1]) + 0.01, off


@pytest.mark.slow
def test_a_weak_step_converges(rng: np.random.Generator) -> None:
    """With a tail, too, as a study samples it; without a prior on the step's size walkers were lost
    beyond the ends, where the step moves nothing: 16,000 steps of autocorrelation."""
    problem, fitted = weak(rng)
    chain = sample_posterior(
        build_log_posterior(study_of(problem), fitted, BASE, BUILTIN),
        NOTHING,
        "",
        rng,
        options=SHORT,
    )
    assert chain.names[-1] == "constant of tracker-step"
    assert chain.converged
    assert chain.steps < 5_000
    assert np.abs(chain.quantiles[:3]).max() < 2.0  # mm, of a step of 0.02 mm


def test_walkers_start_everywhere(rng: np.random.Generator) -> None:
    problem, fitted = weak(rng)
    aim = target(problem, fitted)
    start = aim.start(rng, 200)
    moments = aim.natural(start)[:, -1]
    assert np.histogram(moments, 10, (0, 1))[0].min() > 5
    assert np.isfinite(aim.log_density(start)).all()
    assert 1.5 < start[:, :-1].std() < 2.5


@pytest.mark.long
def test_two_steps_keep_their_order(rng: np.random.Generator) -> None:
    """Two moments of one mechanism are not exchanged: no chain would converge on two names for one
    thing."""
    truth, model = stepped(0.312, 0.688), stepped(0.7, 0.3)
    theta = np.zeros(FIRST + 12)
    theta[FIRST : FIRST + 3], theta[FIRST + 6 : FIRST + 9] = 0.3, -0.3
    problem = planted(drawn(ARM, rng, 40), truth.terms, theta, rng, 0.05)
    aim = target(problem, fit(problem, model))
    assert [c.name for c in aim.constants] == [
        "constant of tracker-step (1)",
        "constant of tracker-step (2)",
    ]
    later, earlier = aim.natural(aim.start(rng, 100))[:, -2:].T
    assert (earlier < later).all()
    assert len(aim._conditionals) == 2
    assert not np.intersect1d(aim._conditionals[0].affected, aim._conditionals[1].affected).size
    later, earlier = sample_posterior(aim, NOTHING, "", rng, options=SHORT).quantiles[-2:]
    assert 0.25 < earlier[0] < earlier[2] < 0.35
    assert 0.65 < later[0] < later[2] < 0.75


def test_units_are_a_change_of_variables(rng: np.random.Generator) -> None:
    """The volume of the walkers' units, against finite differences."""
    problem, fitted = weak(rng)
    aim = target(replace(problem), fitted)
    (c,) = aim._conditionals
    volume = []
    for walker in aim.start(rng, 4):
        jacobian = np.stack(
            [
                (aim.natural(walker + h) - aim.natural(walker - h)) / 2e-5
                for h in 1e-5 * np.eye(aim.size)
            ],
            axis=1,
        )
        volume.append(np.linalg.slogdet(jacobian)[1] - c.log_volume(aim.natural(walker)[-1:])[0])
    assert np.ptp(volume) < 1e-6
