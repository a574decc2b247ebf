"""Parts of the errors whose variance is known: the likelihood is that of the whole covariance, and
what is sought beside them is at its maximum."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

from modelsel.fitting.largest_likelihood import MOST_OF_FEW, maximise_likelihood
from modelsel.fitting.possible_parts import PossiblePart, choose_parts
from modelsel.fitting.restricted_likelihood import LinearModel, evaluate_likelihood
from modelsel.fitting.shared_errors import SharedError

ROWS, VISITS = 90, 30
KNOWN = 0.7


@pytest.fixture
def parts(rng) -> tuple[SharedError, SharedError]:
    """One of known variance that a visit shares, and one to be sought, of ten groups."""
    visit = np.arange(VISITS).repeat(3)
    known = SharedError(rng.normal(size=(ROWS, 3, 1)), visit, known=KNOWN)
    sought = SharedError(rng.normal(size=(ROWS, 3, 1)), np.arange(ROWS) // 9)
    return known, sought


@pytest.fixture
def model(rng, parts) -> LinearModel:
    """Four columns; what both parts add is in the response."""
    columns = rng.normal(size=(4, 3, ROWS))
    response = 0.3 * rng.normal(size=(3, ROWS))
    for part in parts:
        draws = 0.8 * rng.normal(size=VISITS)
        response += (part.loading[:, :, 0] * draws[part.level][:, None]).T
    return LinearModel(columns, response, float(3 * ROWS - 4))


def dense(model: LinearModel, parts, phi: float, sought: float) -> float:
    """Twice the restricted log likelihood, by matrices of all numbers."""
    X = model.columns.transpose(2, 1, 0).reshape(3 * ROWS, -1)
    y = model.response.T.reshape(-1)
    V = phi * np.eye(3 * ROWS)
    for part, variance in zip(parts, (KNOWN, sought), strict=True):
        B = part.loading.reshape(3 * ROWS, 1)
        same = np.equal.outer(part.level.repeat(3), part.level.repeat(3))
        V += variance * (B @ B.T) * same
    W = np.linalg.inv(V)
    inner = X.T @ W @ X
    left = y - X @ np.linalg.solve(inner, X.T @ W @ y)
    return -left @ W @ left - np.linalg.slogdet(V)[1] - np.linalg.slogdet(inner)[1]


def test_likelihood_is_that_of_the_whole_covariance(model, parts) -> None:
    known, sought = parts

    def ours(phi: float, variance: float) -> float:
        own = [replace(known, variance=KNOWN / phi), replace(sought, variance=variance / phi)]
        at = evaluate_likelihood(model, own)
        assert at.phi == pytest.approx(phi)
        return at.log

    points = [(0.1, 0.2), (0.09, 0.02), (0.3, 0.5)]
    gains = [ours(*point) - ours(*points[0]) for point in points]
    expected = [dense(model, parts, *point) - dense(model, parts, *points[0]) for point in points]
    np.testing.assert_allclose(gains, expected, rtol=1e-9)


@pytest.mark.parametrize("held", [False, True])
def test_what_is_sought_beside_a_known_part_is_at_its_maximum(model, parts, held) -> None:
    known, sought = parts
    own = [replace(known, variance=KNOWN / 2.0), replace(sought, variance=0.1)]
    at = maximise_likelihood(model, own[1:], own[:1]) if held else maximise_likelihood(model, own)
    best = minimize(
        lambda x: -dense(model, parts, *np.exp(x)), np.log([0.1, 0.1]), method="Nelder-Mead"
    )
    phi, variance = np.exp(best.x)
    assert at.phi == pytest.approx(phi, rel=1e-3)
    first, second = at.parts
    assert first.variance * at.phi == pytest.approx(KNOWN)
    assert second.variance * at.phi == pytest.approx(variance, rel=2e-3)


def test_no_instrument_is_without_noise(model, parts) -> None:
    """A known part far larger than what is left leaves φ where a part is as large as one can be."""
    known = replace(parts[0], known=1e6, variance=1e6)
    at = maximise_likelihood(model, [known])
    assert at.parts[0].variance * np.square(known.loading).sum(2).mean() == pytest.approx(
        MOST_OF_FEW
    )


def test_parts_are_chosen_by_name(parts) -> None:
    """The fixed ones stand first and are known; of two of one name the first is fixed."""
    names = [("joint 1", "repeats"), ("configuration", "targets"), ("configuration", "repeats")]
    listed = [PossiblePart(name, "mm", parts[1], 3.0, by) for name, by in names]

    def chosen(allowed, *fixed) -> list[tuple[str, str, float | None]]:
        return [(p.name, p.told_by, p.error.known) for p in choose_parts(listed, allowed, fixed)]

    assert chosen(None) == [(*name, None) for name in names]
    assert chosen([]) == []
    assert chosen(["joints"]) == [("joint 1", "repeats", None)]
    assert chosen(["joint 11"]) == []
    assert chosen(None, ("configuration", 0.5), ("group", 1.0)) == [
        ("configuration", "given", 0.25),
        ("joint 1", "repeats", None),
        ("configuration", "repeats", None),
    ]


def test_a_model_without_columns_has_a_likelihood(model) -> None:
    bare = replace(model, columns=model.columns[:0], freedom=float(3 * ROWS))
    at = evaluate_likelihood(bare, ())
    square = float(np.square(model.response).sum())
    assert at.log == pytest.approx(-3 * ROWS * np.log(square))
    assert maximise_likelihood(bare, ()).phi == pytest.approx(square / (3 * ROWS))
