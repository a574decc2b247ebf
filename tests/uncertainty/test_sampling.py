"""emcee against the closed form, densities against quadrature and dense formulas, diagnostics
against arviz-stats, resuming."""

from __future__ import annotations

import io
import json
import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from builders import drawn, one, planted, small_arm, study_of
from click.testing import CliRunner
from scipy.integrate import quad

from modelsel._progress import News
from modelsel._typing import Array
from modelsel.cli.main import run_command_line
from modelsel.exceptions import StudyError
from modelsel.fitting.design import Model, compute_design
from modelsel.fitting.least_squares import Fit, fit
from modelsel.fitting.noise import Instrument, weigh
from modelsel.fitting.problem import Problem
from modelsel.fitting.shared_errors import SharedErrors
from modelsel.fitting.whitening import Whitening
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.causes import q, sin
from modelsel.mechanisms.environment import target_step, tracker_step
from modelsel.mechanisms.moved_targets import limit_to_targets
from modelsel.mechanisms.registry import BUILTIN, mechanism
from modelsel.results.storage import WRITES
from modelsel.robot.kinematics import forward
from modelsel.robot.rigid import from_rpy
from modelsel.study.pipeline.checkpoint import Checkpoint
from modelsel.uncertainty.log_posterior import TAIL, LogPosterior
from modelsel.uncertainty.mcmc import (
    autocorrelation_time,
    build_moves,
    propose_independent,
    propose_snooker,
    r_hat,
)
from modelsel.uncertainty.nuisance import assign_components, list_constants, merge_components
from modelsel.uncertainty.parameters import label_terms
from modelsel.uncertainty.posterior import Importance
from modelsel.uncertainty.sampler import Sampling, sample_posterior
from modelsel.uncertainty.sampling_options import SamplingOptions
from modelsel.uncertainty.summary import assess_confidence as certainty
from modelsel.uncertainty.summary import build_log_posterior, describe_sampling, sample_confidence
from modelsel.uncertainty.walk import State

ARM = small_arm()
BASE = Model((mechanism("geometric", ARM),))
MODEL = Model(
    (*BASE.mechanisms, mechanism("joint-compliance:2", ARM), mechanism("gear-eccentricity:2", ARM))
)
NOTHING = Importance(1, 1.0, "")


@pytest.fixture
def problem(rng: np.random.Generator) -> Problem:
    return planted(drawn(ARM, rng, 20), MODEL.terms, np.zeros(len(MODEL.terms)), rng, 0.1)


# chains of 12 autocorrelation times, for tests whose answer does not depend on their number
SHORT = SamplingOptions(min_times=12, max_r_hat=1.2)


def target(at: Problem, fitted: Fit, chosen: Sequence[int], **more: object) -> LogPosterior:
    noise = assign_components(at)
    tail = (TAIL,) if more.get("tail") else ()
    names = (*(str(k) for k in chosen), *noise.names, *tail)
    return LogPosterior(fitted, noise, tuple(chosen), names, ("1",) * len(names), **more)  # type: ignore[arg-type]


def named(fitted: Fit) -> list[int]:
    return [k for k in fitted.found.kept if k >= len(BASE.terms)]


def close(chain: Sampling, errors: float = 4.0) -> None:
    """Medians and 95 % limits against the closed form's, in Monte-Carlo standard errors of a
    quantile: √(p(1−p)/n) over the density there, which for a normal is 2.1 and 1.25 standard
    deviations / √n."""
    spread = (chain.closed_form[:, 2] - chain.closed_form[:, 0]) / 3.92
    off = (
        np.abs(chain.quantiles - chain.closed_form)
        / spread[:, None]
        * np.sqrt(chain.effective)[:, None]
    )
    assert (off < errors * np.array([2.7, 1.25, 2.7])).all(), off


@pytest.mark.parametrize("exact", [True, False])
def test_emcee_agrees_with_the_closed_form(
    problem: Problem, rng: np.random.Generator, exact: bool
) -> None:
    """Every coefficient on the exact chain; or some of many on the reduced data, the others
    integrated out."""
    few = Model((one(1, "tx"), one(2, "tx"), one(1, "rz"), one(2, "rz", sin(q(1)))))
    fitted = fit(problem, few if exact else MODEL)
    chosen = fitted.found.kept if exact else named(fitted)
    chain = sample_posterior(target(problem, fitted, chosen, exact=exact), NOTHING, "", rng)
    assert chain.converged
    assert chain.effective.min() > 2000
    assert 0.1 < chain.acceptance < 0.6
    close(chain)


@pytest.mark.slow
def test_slides_and_turns_are_sampled_together_in_their_own_units(rng: np.random.Generator) -> None:
    """Coefficients in mm, rad and mm/mm, of sizes a thousand apart, each as the closed form has it."""
    sliding = small_arm(prismatic=True)
    scale = one(3, "tz", q(3, "mm"))
    few = Model((one(2, "tx"), one(1, "rz"), one(3, "rx"), one(3, "ty", q(3, "mm")), scale))
    at = drawn(sliding, rng, 40)
    at = planted(at, few.terms, np.zeros(5), rng, 0.1)
    fitted = fit(at, few)
    assert [term.unit for term in few.terms] == ["mm", "rad", "rad", "mm/mm", "mm/mm"]
    chosen = fitted.found.kept
    assert len(chosen) == 5
    chain = sample_posterior(target(at, fitted, chosen), NOTHING, "", rng)
    assert chain.converged
    close(chain)


@pytest.mark.integration
def test_integrated_coefficients_change_nothing(problem: Problem, rng: np.random.Generator) -> None:
    fitted = fit(problem, MODEL)
    close(sample_posterior(target(problem, fitted, named(fitted)), NOTHING, "", rng))


def test_linear_and_exact_densities_agree(problem: Problem, rng: np.random.Generator) -> None:
    precision = np.zeros(len(MODEL.terms))
    precision[-1] = 1e8
    for fitted in (fit(problem, MODEL), fit(problem, MODEL, precision=precision)):
        for chosen in (named(fitted), named(fitted)[:1]):
            whole, reduced = (target(problem, fitted, chosen, exact=e) for e in (True, False))
            walkers = rng.standard_normal((6, whole.size))  # as far as the closed form's draws
            a, b = whole.log_density(walkers), reduced.log_density(walkers)
            assert np.allclose(a - a[0], b - b[0], atol=1e-3)


def test_several_scales_are_the_restricted_likelihood(rng: np.random.Generator) -> None:
    """Against the formula with the whole covariance matrix written out (Patterson & Thompson 1971),
    and the prior of what data hardly determine, in units of the first scale."""
    instrument = Instrument(0.05, 10.0, 60.0, (1500.0, -800.0, 400.0))
    at, _ = weigh(
        planted(drawn(ARM, rng, 9), MODEL.terms, np.zeros(len(MODEL.terms)), rng, 0.1),
        instrument,
        None,
    )
    fitted = fit(at, MODEL)
    noise = assign_components(at, instrument)
    assert noise.names == ("noise along the beam", "noise across the beam")
    chosen = tuple(named(fitted))
    whole = LogPosterior(
        fitted, noise, chosen, (*map(str, chosen), *noise.names), ("1",) * (len(chosen) + 2)
    )
    X, r = compute_design(at, MODEL.terms, fitted.at())
    rest = [k for k in fitted.found.kept if k not in chosen]
    X = X.reshape(-1, len(MODEL.terms))[:, rest]
    line = at.data.position - np.array(instrument.at)
    d = np.linalg.norm(line, axis=1)
    u = line / d[:, None]
    assert not at.whitening.uniform
    root = np.linalg.inv(at.whitening.matrices)
    walkers = np.zeros((4, whole.size))
    walkers[:, len(chosen) :] = rng.normal(0, 3, (4, 2))
    expected = []
    for scales in np.exp(whole.natural(walkers)[:, len(chosen) :]):
        blocks = (scales[0] ** 2 * (0.05 + 1e-5 * d) ** 2)[:, None, None] * np.einsum(
            "mi,mj->mij", u, u
        ) + (scales[1] ** 2 * (60e-6 * d) ** 2)[:, None, None] * (
            np.eye(3) - np.einsum("mi,mj->mij", u, u)
        )
        S = np.zeros((27, 27))
        for k in range(9):
            S[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] = blocks[k]
        plain = np.einsum("mij,mjp->mip", root, X.reshape(9, 3, -1)).reshape(27, -1)
        raw = np.einsum("mij,mj->mi", root, r).ravel()
        inverse = np.linalg.inv(S)
        held, pull = fitted.root[:, rest] / scales[0], -fitted.root @ fitted.theta / scales[0]
        gram, cross = (
            plain.T @ inverse @ plain + held.T @ held,
            plain.T @ inverse @ raw + held.T @ pull,
        )
        left = raw @ inverse @ raw + pull @ pull - cross @ np.linalg.solve(gram, cross)
        left += (
            np.linalg.slogdet(S)[1]
            + np.linalg.slogdet(gram)[1]
            + 2 * fitted.by_prior * np.log(scales[0])
        )
        expected.append(-0.5 * left)
    found = whole.log_density(walkers)
    assert np.allclose(found - found[0], np.array(expected) - expected[0], atol=1e-6)


@pytest.mark.parametrize("nu", [3.0, 8.0, 100.0])
def test_tail_with_a_coefficient_integrated_out(rng: np.random.Generator, nu: float) -> None:
    """A Student-t per point: the approximate integral over one coefficient against quadrature, to 1
    % of a density."""
    model = Model((one(1, "tx"), one(2, "rz", sin(q(1)))))
    at = drawn(ARM, rng, 25)
    problem = planted(at, model.terms, np.zeros(2), rng, 0.1)
    fitted = fit(problem, model)
    whole = target(problem, fitted, (1,), tail=True)
    X, r = compute_design(problem, model.terms, fitted.at())
    points, expected = np.zeros((3, 3)), []
    points[:, 2] = (1 / nu - whole.natural(np.zeros((1, 3)))[0, 2]) / 0.05
    points[:, 0], points[:, 1] = (0.0, 1.5, -1.0), (0.0, 1.0, -2.0)
    for psi, log_s, _ in whole.natural(points):
        e, s = r - X[:, :, 1] * (psi - fitted.theta[1]), np.exp(log_s)

        def log_density(beta: float, e: Array = e, s: float = s) -> float:
            distance = np.square((e - X[:, :, 0] * beta) / s).sum(1)
            return float(-(nu + 3) / 2 * np.log1p(distance / nu).sum() - 75 * np.log(s))

        top = log_density(0.0)
        area = quad(
            lambda beta, f=log_density, top=top: np.exp(f(beta) - top),
            -0.5,
            0.5,
            points=[0.0],
            limit=200,
        )[0]
        expected.append(top + np.log(area))
    found = whole.log_density(points)
    assert np.allclose(found - found[0], np.array(expected) - expected[0], atol=0.03)


@pytest.mark.slow
def test_tail_is_found(rng: np.random.Generator) -> None:
    """Noise with 3 degrees of freedom is told from normal noise."""
    at = drawn(ARM, rng, 80)
    tails = []
    for noise in (
        rng.normal(0, 0.1, (80, 3)) / np.sqrt(rng.chisquare(3, (80, 1)) / 3),
        rng.normal(0, 0.1, (80, 3)),
    ):
        problem = replace(at, data=replace(at.data, position=at.data.position + noise))
        fitted = fit(problem, MODEL)
        tails.append(
            sample_posterior(
                target(problem, fitted, named(fitted), tail=True),
                NOTHING,
                "",
                np.random.default_rng(1),
                options=SHORT,
            ).quantiles[-1]
        )
    assert tails[0][0] > 0.1
    assert tails[0][2] > 0.3
    assert tails[1][2] < 0.2


def stepped(at: float) -> Model:
    """The base and a tracker moved at a moment."""
    return Model((*BASE.mechanisms, tracker_step(ARM, at)))


@pytest.mark.unit
def test_the_moment_at_which_one_target_slipped_is_a_constant(rng: np.random.Generator) -> None:
    """Of a target that is named like a joint, or with a digit that is no number."""
    names = ("2", "²")
    q = ARM.draw(rng, 40)
    data = build_measurements(q, np.zeros((40, 3)), target=np.tile(names, 20))
    at = Problem(ARM, data, np.array([[40.0, -25, 100], [10, 60, 90]]))
    for number, name in enumerate(names):
        step = limit_to_targets(target_step(ARM, 0.6), {number: name})
        model = Model((*BASE.mechanisms, step))
        (constant,) = list_constants(at, model, BUILTIN)
        assert constant.name == f"constant of target-step:{name}"
        assert constant.held == 0.6
        is_other = data.target != number
        for _, _, change in constant.tables:
            assert not change[:, is_other].any()
            assert change[:, ~is_other].any()


@pytest.mark.slow
def test_the_moment_of_a_step_is_sampled(rng: np.random.Generator) -> None:
    """tracker-step's constant is scanned in steps of 0.025; the chain finds it between two
    configurations."""
    model, truth = stepped(0.6), stepped(0.612)
    at = drawn(ARM, rng, 40)
    theta = np.zeros(len(model.terms))
    theta[len(BASE.terms) : len(BASE.terms) + 3] = 2.0
    data = study_of(planted(at, truth.terms, theta, rng, 0.05))
    fitted = fit(data.training, model)
    chosen = build_log_posterior(data, fitted, BASE, BUILTIN)
    assert chosen.names[-1] == "constant of tracker-step"
    assert "constant of tracker-step" in describe_sampling(chosen)
    low, _, high = sample_posterior(chosen, NOTHING, "", rng, options=SHORT).quantiles[-1]
    progress = np.unique(data.problem.data.progress)
    assert (
        progress[progress < 0.612].max() - 0.01
        < low
        < high
        < progress[progress > 0.612].min() + 0.01
    )


def test_held_constant_moves_nothing(rng: np.random.Generator) -> None:
    model = stepped(0.6)
    (constant,) = list_constants(drawn(ARM, rng, 30), model, BUILTIN)
    assert constant.held == 0.6
    into: dict[tuple[int, int], Array] = {}
    constant.add_twist(np.ones((2, len(model.terms))), np.array([0.6, 0.9]), into)
    assert set(into) == {(0, a) for a in range(6)}
    assert not into[0, 0][0].any()
    assert into[0, 0][1].min() == -1.0


# -- diagnostics and moves
# -----------------------------------------------------------------------------------------------


def wandering(rng: np.random.Generator, steps: int = 2000, walkers: int = 6) -> Array:
    """Autoregressive chains (steps, walkers, 3) of different memory."""
    out = np.zeros((steps, walkers, 3))
    memory = np.array([0.0, 0.6, 0.95])
    for k in range(1, steps):
        out[k] = memory * out[k - 1] + rng.normal(size=(walkers, 3))
    return out[200:]


@pytest.mark.integration
def test_diagnostics_against_arviz(rng: np.random.Generator) -> None:
    from arviz_stats.base import array_stats

    chain = wandering(rng)
    apart = chain.copy()
    apart[:, 0] += 1.0
    for each in (chain, apart, np.exp(chain)):
        expected = [
            array_stats.rhat(each[:, :, j].T, chain_axis=0, draw_axis=1, method="rank")
            for j in range(3)
        ]
        assert np.allclose(r_hat(each), expected, rtol=1e-6)
    tau = autocorrelation_time(chain)
    assert np.allclose(tau, (1, 1.6 / 0.4, 1.95 / 0.05), rtol=0.15)  # (1 + memory) / (1 − memory)
    effective = [
        array_stats.ess(chain[:, :, j].T, chain_axis=0, draw_axis=1, method="mean")
        for j in range(3)
    ]
    assert np.allclose(chain.shape[0] * chain.shape[1] / tau, effective, rtol=0.15)
    assert np.isinf(autocorrelation_time(np.ones((50, 4, 1)))).all()


def test_snooker_keeps_a_normal_normal(rng: np.random.Generator) -> None:
    """One step from exact draws of a standard normal leaves the variance at 1 (emcee 3.1.6's own
    move does not)."""
    n, d = 200_000, 8
    x, z, first, second = rng.normal(size=(4, n, d))
    proposal, log_factor = propose_snooker(x, z, first - second)
    log_ratio = log_factor + 0.5 * (np.square(x).sum(1) - np.square(proposal).sum(1))
    accepted = np.log(rng.random(n)) < log_ratio
    after = np.where(accepted[:, None], proposal, x)
    assert accepted.mean() > 0.2
    assert abs(np.square(after).mean() - 1) < 4 * np.sqrt(2 / (n * d))


def test_independent_proposals_keep_a_density_that_is_not_normal(rng: np.random.Generator) -> None:
    """One step from exact draws of a gamma and of a correlated normal density leaves their moments,
    though the others are few, and what is held stays."""
    n, others = 200_000, 12
    covariance = np.array([[1.0, 0.8], [0.8, 1.0]])

    def draw(count: int) -> np.ndarray:
        normal = rng.multivariate_normal(np.zeros(2), covariance, count)
        return np.column_stack([rng.gamma(4.0, size=count), normal, rng.random(count)])

    def log_density(x: np.ndarray) -> np.ndarray:
        inverse = np.linalg.inv(covariance)
        normal = np.einsum("wi,ij,wj->w", x[:, 1:3], inverse, x[:, 1:3])
        gamma = 3 * np.log(np.maximum(x[:, 0], 1e-300)) - x[:, 0]
        return np.where(x[:, 0] > 0, gamma - 0.5 * normal, -np.inf)

    x = draw(n)
    proposal, log_factor = propose_independent(x, draw(others), rng.normal(size=x.shape), [3])
    assert (proposal[:, 3] == x[:, 3]).all()
    accepted = np.log(rng.random(n)) < log_factor + log_density(proposal) - log_density(x)
    after = np.where(accepted[:, None], proposal, x)
    assert accepted.mean() > 0.2
    assert abs(after[:, 0].mean() - 4) < 4 * 2 / np.sqrt(n)
    assert abs(after[:, 0].var() - 4) < 4 * np.sqrt(56 / n)  # of a gamma: its fourth moment
    assert np.abs(np.cov(after[:, 1:3].T) - covariance).max() < 4 * np.sqrt(2 / n)


def test_a_chain_of_many_names_forgets_soon(rng: np.random.Generator) -> None:
    """Half of the moves do not depend on where a walker stands: its time is that of a few steps."""
    import emcee

    start = emcee.State(
        rng.normal(size=(60, 20)), random_state=np.random.RandomState(3).get_state()
    )
    sampler = emcee.EnsembleSampler(
        60, 20, lambda x: -0.5 * np.square(x).sum(1), moves=build_moves(), vectorize=True
    )
    sampler.run_mcmc(start, 1000)
    assert autocorrelation_time(sampler.get_chain(discard=100)).max() < 20


# -- one seed, interruption, resuming
# ----------------------------------------------------------------------------------------


class Broken:
    """A keeper in memory; interrupts after some chunks."""

    def __init__(self, after: int, state: State | None = None):
        self.after, self.state, self.kept = after, state, False

    def load(self, names: Sequence[str]) -> State | None:
        return self.state

    def keep(self, names: Sequence[str], state: State, *, now: bool = False) -> None:
        self.state, self.kept = state, self.kept or now
        self.after -= 1
        if self.after == 0:
            raise KeyboardInterrupt


@pytest.mark.slow
@pytest.mark.parametrize("after", [1, 3, 4])
def test_resumed_chain_is_the_unbroken_one(problem: Problem, after: int) -> None:
    fitted = fit(problem, MODEL)
    aim = target(problem, fitted, named(fitted), exact=False)
    whole, again = (sample_posterior(aim, NOTHING, "", np.random.default_rng(3)) for _ in range(2))
    assert np.array_equal(whole.chain, again.chain)
    keeper = Broken(after)
    with pytest.raises(KeyboardInterrupt):
        sample_posterior(aim, NOTHING, "", np.random.default_rng(3), keeper=keeper)
    assert keeper.kept
    resumed = sample_posterior(
        aim, NOTHING, "", np.random.default_rng(3), keeper=Broken(0, keeper.state)
    )
    assert np.array_equal(whole.chain, resumed.chain)
    assert json.dumps(whole.to_dict(), default=np.ndarray.tolist) == json.dumps(
        resumed.to_dict(), default=np.ndarray.tolist
    )
    assert not np.array_equal(
        whole.chain, sample_posterior(aim, NOTHING, "", np.random.default_rng(4)).chain
    )


def test_checkpoint_belongs_to_one_run(tmp_path: Path, rng: np.random.Generator) -> None:
    names, identity = (
        ["a", "b"],
        {"data_sha256": "1", "study_sha256": "2", "modelsel": "3", "numpy": "4", "scipy": "5"},
    )
    state = State(
        rng.normal(size=(5, 4, 2)),
        rng.normal(size=(5, 4)),
        np.arange(4.0),
        np.random.RandomState(1).get_state(legacy=True),
    )
    first = Checkpoint(tmp_path, resume=False)
    first.bind(identity)
    first.keep(names, state, now=True)
    again = Checkpoint(tmp_path, resume=True)
    again.bind(identity)
    found = again.load(names)
    assert found is not None
    for a, b in (
        (found.chain, state.chain),
        (found.log_density, state.log_density),
        (found.accepted, state.accepted),
        (found.random[1], state.random[1]),
        (found.random[2:], state.random[2:]),
    ):
        assert np.array_equal(a, b)
    with pytest.raises(StudyError, match="the parameters changed"):
        again.load(["a", "c"])
    with pytest.raises(StudyError, match="the measurements changed"):
        Checkpoint(tmp_path, resume=True).bind({**identity, "data_sha256": "9"})
    with pytest.raises(StudyError, match="the robot changed"):
        Checkpoint(tmp_path, resume=True).bind({**identity, "robot_sha256": "9"})
    assert Checkpoint(tmp_path, resume=False).load(names) is None
    whole = again.path.read_bytes()
    other, single, unequal = io.BytesIO(), io.BytesIO(), io.BytesIO()
    np.savez(other, chain=state.chain)
    np.save(single, state.chain)
    arrays = dict(np.load(again.path))
    np.savez(unequal, **{**arrays, "accepted": np.zeros(3)})
    damaged = (b"", b"not a chain", whole[:100], whole[:-100], whole[500:])
    for content in (*damaged, other.getvalue(), single.getvalue(), unequal.getvalue()):
        again.path.write_bytes(content)
        with pytest.raises(StudyError, match="run again without --resume"):
            Checkpoint(tmp_path, resume=True).bind(identity)
    again.clear()
    assert not list(tmp_path.iterdir())


STUDY = """
name = "small"
seed = 4
[robot]
file = "robot.toml"
tool_mm = [40, -25, 100]
[measurements]
file = "data.csv"
[split]
estimation = 20
[model]
candidates = []
"""
ROBOT = """
name = "small"
source = "made up for tests"
[[joint]]
xyz_mm = [0, 0, 300]
axis = [0, 0, 1]
[[joint]]
xyz_mm = [50, 0, 0]
axis = [0, -1, 0]
[[joint]]
xyz_mm = [400, 0, 0]
axis = [0, -1, 0]
[last]
xyz_mm = [350, 0, 0]
"""


@pytest.fixture
def folder(tmp_path: Path, rng: np.random.Generator) -> Path:
    """A study of its own in a folder, with an angle of joint 2 off."""
    from modelsel.robot.files import read_robot

    (tmp_path / "study.toml").write_text(STUDY)
    (tmp_path / "robot.toml").write_text(ROBOT)
    arm = read_robot(tmp_path / "robot.toml")
    angles = rng.uniform(-1.5, 1.5, (30, 3))
    where = forward(arm, angles + np.array([0, 2e-3, 0]), np.array([40.0, -25, 100])) + rng.normal(
        0, 0.05, (30, 3)
    )
    lines = [
        "q1_rad,q2_rad,q3_rad,x_mm,y_mm,z_mm",
        *(",".join(f"{v:.9f}" for v in row) for row in np.hstack([angles, where])),
    ]
    (tmp_path / "data.csv").write_text("\n".join(lines) + "\n")
    return tmp_path


def invoke(
    monkeypatch: pytest.MonkeyPatch, *arguments: str, max_steps: int = 20_000
) -> tuple[int, str]:
    """The command; its chains short and on the QR-reduced data, which take a second."""
    options = replace(SHORT, max_evaluations=0, max_steps=max_steps)
    for step in (build_log_posterior, sample_confidence):
        brief = partial(step, options=options)
        monkeypatch.setattr(f"modelsel.study.pipeline.pipeline.{step.__name__}", brief)
    monkeypatch.setattr(sys, "argv", ["modelsel", *arguments])
    done = CliRunner().invoke(run_command_line, list(arguments))
    return done.exit_code, done.output


@pytest.mark.slow
def test_interrupted_study_resumes(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Ctrl-C: exit 130 with the command that resumes, and the same bytes in the end; another study
    is refused."""
    command = ("study", str(folder), "--out", str(folder / "out"), "--no-report")
    status, _ = invoke(monkeypatch, *command)
    assert status == 0
    whole = (folder / "out" / "result.json").read_bytes()
    chain = json.loads(whole)["sampling"]
    assert chain["converged"]
    assert chain["effective_samples"] > 500
    assert {p.name for p in (folder / "out").iterdir()} == set(WRITES)
    (folder / "out" / "result.json").unlink()

    density, left = LogPosterior.log_density, [700]

    def stops(self: LogPosterior, walkers: Array) -> Array:
        left[0] -= 1
        if not left[0]:
            raise KeyboardInterrupt
        return density(self, walkers)

    monkeypatch.setattr(LogPosterior, "log_density", stops)
    status, output = invoke(monkeypatch, *command)
    assert status == 130
    assert "Traceback" not in output + capfd.readouterr().err
    assert f"modelsel {' '.join(command)} --resume" in output
    monkeypatch.setattr(LogPosterior, "log_density", density)
    text = (folder / "study.toml").read_text()
    (folder / "study.toml").write_text(text.replace("seed = 4", "seed = 5"))
    status, output = invoke(monkeypatch, *command, "--resume")
    assert status == 2
    assert "the study file changed" in output
    (folder / "study.toml").write_text(text)
    assert invoke(monkeypatch, *command, "--resume")[0] == 0
    assert (folder / "out" / "result.json").read_bytes() == whole
    assert not (folder / "out" / ".modelsel").exists()


@pytest.mark.slow
def test_unconverged_chain_is_not_quoted(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    command = ("study", str(folder), "--out", str(folder / "out"))
    status, output = invoke(monkeypatch, *command, max_steps=60)
    assert status == 5
    assert "has not converged after 60 steps" in output
    result = json.loads((folder / "out" / "result.json").read_text())
    assert not result["sampling"]["converged"]
    assert {
        row[key] for row in result["sampling"]["quantiles"] for key in ("low", "median", "high")
    } == {None}
    assert result["sampling"]["trace"]["draws"] == []
    assert "unconverged" in [w["code"] for w in result["warnings"]]


@pytest.mark.slow
def test_over_all_and_without(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`over = "all"` samples every parameter; --no-sampling none, and the tables stay."""
    (folder / "study.toml").write_text(STUDY + '[sampling]\nover = "all"\n')
    assert invoke(monkeypatch, "study", str(folder), "--out", str(folder / "out"))[0] == 0
    result = json.loads((folder / "out" / "result.json").read_text())
    assert result["sampling"]["sampled"] == [
        *(p["symbol"] for p in result["parameters"]),
        "noise scale",
    ]
    assert all(
        abs(np.log(p["posterior_error"] / p["standard_error"])) < 0.2 for p in result["parameters"]
    )
    assert (
        invoke(monkeypatch, "study", str(folder), "--out", str(folder / "out"), "--no-sampling")[0]
        == 0
    )
    bare = json.loads((folder / "out" / "result.json").read_text())
    assert bare["sampling"] is None
    assert all(p["posterior_error"] is None for p in bare["parameters"])
    assert bare["significance"] == result["significance"]
    assert bare["correlation"] == result["correlation"]


@pytest.mark.integration
def test_chain_as_frame_and_arviz(
    problem: Problem, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    fitted = fit(problem, MODEL)
    chain = sample_posterior(target(problem, fitted, named(fitted), exact=False), NOTHING, "", rng)
    frame = chain.to_dataframe()
    assert list(frame.columns) == list(chain.names)
    assert np.array_equal(frame.loc[(7, 3)], chain.chain[7, 3])
    tree = chain.to_arviz()
    assert np.array_equal(tree["posterior"][chain.names[1]].values[3], chain.chain[:, 3, 1])
    monkeypatch.setitem(sys.modules, "arviz_base", None)
    with pytest.raises(ImportError, match=r"modelsel\[arviz\]"):
        chain.to_arviz()


# -- what is sampled, over odd data
# ---------------------------------------------------------------------------------------------


def test_many_rows_are_sampled_reduced_and_said(rng: np.random.Generator) -> None:
    at = planted(drawn(ARM, rng, 600), MODEL.terms, np.zeros(len(MODEL.terms)), rng, 0.1)
    data = study_of(at)
    fitted = fit(data.training, MODEL)
    aim = build_log_posterior(data, fitted, BASE, BUILTIN)
    assert not aim.exact
    assert aim.names == (*(label_terms(MODEL)[k] for k in named(fitted)), "noise scale")
    assert "of 600 rows, would take too long" in describe_sampling(aim)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["sigma", "orientation", "targets", "sliding"])
def test_odd_data_are_sampled(rng: np.random.Generator, kind: str) -> None:
    """Noise scales per axis or of the orientations come back near what was simulated; outliers stay
    out."""
    arm = small_arm(prismatic=kind == "sliding")
    base = Model((mechanism("geometric", arm),))
    joints = arm.draw(rng, 30)
    position = forward(arm, joints, np.array([40.0, -25, 100])) + rng.normal(
        0, [0.1, 0.1, 0.3], (30, 3)
    )
    more: dict[str, object] = {}
    if kind == "sigma":
        more = {"sigma": np.full((30, 3), 0.1)}
    if kind == "targets":
        more = {"target": np.array(["a", "b"] * 15)}
    at = drawn(arm, rng, 30)
    at = replace(at, data=build_measurements(joints, position, **more))  # type: ignore[arg-type]
    at = replace(at, tools=np.tile(at.tools[:1], (len(at.data.targets), 1)))
    if kind == "orientation":
        turned = np.einsum("ijm->mij", at.pose(slice(None)).rotation)
        turned = np.einsum(
            "mij,mjk->mik",
            np.array([from_rpy(*angles) for angles in rng.normal(0, 3e-4, (30, 3))]),
            turned,
        )
        at = replace(
            at,
            data=replace(at.data, rotation=turned),
            tool_rotations=np.eye(3)[None],
            whitening=Whitening(
                matrices=np.tile(np.diag([10.0, 10, 10, 1000, 1000, 1000]), (30, 1, 1))
            ),
        )
    elif kind == "sigma":
        at, _floor = weigh(at, None, None)
    data = study_of(at)
    data.outlying[3] = True
    data.problem.data.position[3] += 50.0
    fitted = fit(data.training, base)
    found = sample_confidence(
        certainty(data, fitted, ("geometric",), 1),
        data,
        build_log_posterior(data, fitted, base, BUILTIN),
        1,
        options=SHORT,
    )
    chain = found.sampling
    assert chain is not None
    assert chain.converged
    scales = {
        name: chain.quantiles[j] for j, name in enumerate(chain.names) if name.startswith("noise")
    }
    if kind == "sigma":
        assert list(scales) == ["noise in x", "noise in y", "noise in z"]
        assert 0.7 < scales["noise in x"][1] < 1.5  # simulated: 1, and 3 along z
        assert 2 < scales["noise in z"][1] < 4.5
    if kind == "orientation":
        # simulated: 0.3 mrad where the weights have 1, and more than the 0.1 mm of the positions
        low, _, high = scales["noise of orientation"]
        assert low < 3e-4 < high < 1e-3
        assert scales["noise of position"][1] > 0.1


def test_halves_move_as_emcee_moves_them() -> None:
    """The same chain from the same random numbers, with walkers outside the prior among the first."""
    import emcee

    def log_density(walkers: np.ndarray) -> np.ndarray:
        inside = np.abs(walkers).max(1) < 3
        return np.where(inside, -0.5 * np.square(walkers).sum(1), -np.inf)

    start = np.random.default_rng(2).normal(0, 2, (16, 3))
    assert np.isneginf(log_density(start)).any()
    random = np.random.RandomState(5).get_state(legacy=True)
    chains = []
    for move in (emcee.moves.DEMove(), build_moves()[0][0]):
        sampler = emcee.EnsembleSampler(16, 3, log_density, moves=move, vectorize=True)
        with np.errstate(invalid="ignore"):
            sampler.run_mcmc(emcee.State(start, random_state=random), 200)
        chains.append((sampler.get_chain(), sampler.get_log_prob(), sampler.acceptance_fraction))
    for by_emcee, by_halves in zip(*chains, strict=True):
        np.testing.assert_array_equal(by_halves, by_emcee)
    assert 0.1 < chains[0][2].mean() < 0.9


def test_progress_tells_steps_and_then_their_share(problem: Problem) -> None:
    fitted = fit(problem, MODEL)
    aim = target(problem, fitted, named(fitted), exact=False)
    said: list[str] = []
    rng = np.random.default_rng(1)
    options = SamplingOptions(max_steps=400, first_check=200)
    sample_posterior(aim, NOTHING, "", rng, say=said.append, options=options)
    shares = [news.done for news in said if isinstance(news, News)]
    assert len(shares) == len(said) >= 3
    assert shares[0] is None
    known = [share for share in shares if share is not None]
    assert known == sorted(known)
    assert known[-1] == 1


def test_a_scale_of_noise_has_the_unit_of_what_it_multiplies(problem: Problem) -> None:
    """mm where nothing is stated, though errors that rows share were estimated beside it; of stated
    uncertainties it is a multiple, and of estimated ones."""
    stated = Whitening(4.0)
    shared = Whitening(4.0, None, SharedErrors(()), stated)
    noise = assign_components(replace(problem, whitening=shared))
    assert noise.units == ("mm",)
    assert noise.factor.tolist() == [0.25]
    matrices = np.tile(np.eye(3), (len(problem), 1, 1))
    by_row = assign_components(replace(problem, whitening=Whitening(1.0, matrices)))
    assert by_row.units == ("of the stated",)
    told = Whitening(1.0, matrices, SharedErrors(()), stated)
    assert assign_components(replace(problem, whitening=told)).units == ("of the estimated",)


def test_scales_beside_orientations_are_in_mm_and_rad(problem: Problem) -> None:
    """Where nothing is stated, weights are those of what the base leaves: no multiple of them says anything."""
    rows = len(problem)
    turned = np.tile(np.eye(3), (rows, 1, 1))
    weights = np.diag([4.0] * 3 + [500.0] * 3)
    whitening = Whitening(matrices=np.tile(weights, (rows, 1, 1)))
    data = replace(problem.data, rotation=turned)
    posed = replace(problem, data=data, whitening=whitening)
    noise = assign_components(posed)
    assert noise.units == ("mm", "rad")
    np.testing.assert_allclose(noise.factor, [0.25, 0.002])
    merged = merge_components(noise)
    assert (merged.units, merged.factor.tolist()) == (("mm",), [0.25])
    stated = replace(posed, data=replace(data, sigma_rotation=np.full((rows, 3), 0.002)))
    assert assign_components(stated).units == ("mm", "of the stated")
