"""Estimation configurations are spread in joints and covariates, follow from the seed, and never
tear repeats apart."""

from __future__ import annotations

import numpy as np
import pytest
from builders import seeds, study_with

from modelsel.exceptions import StudyError
from modelsel.measurements.measurements import Measurements, build_measurements
from modelsel.robot.files import load_robot
from modelsel.selection.splits import _exchange, _features, _Shortlist, split_configurations
from modelsel.study.preparation.row_selection import choose_estimation_rows

ARM = load_robot("puma760")
TURNS = tuple(j.prismatic for j in ARM.joints)


def campaign(rng: np.random.Generator, m: int = 200) -> Measurements:
    """Single-joint sweeps and lines as in the paper, temperature drifting up late, payload hung on
    at a few."""
    start, end = ARM.draw(rng, m // 10), ARM.draw(rng, m // 10)
    one = rng.integers(0, 6, m // 10)
    end = np.where(np.arange(6) == one[:, None], end, start)
    q = (start[:, None] + np.linspace(0, 1, 10)[None, :, None] * (end - start)[:, None]).reshape(
        -1, 6
    )
    temperature = 20 + 15 * (np.arange(m) / m) ** 4
    payload = 3.0 * (np.arange(m) % 25 == 7)
    return build_measurements(
        q, rng.normal(size=(m, 3)), covariates={"temperature_C": temperature, "payload_kg": payload}
    )


def information(X: np.ndarray, inside: np.ndarray) -> float:
    """log-determinant of the information of features (m, d) and a constant."""
    X = np.column_stack([np.ones(len(X)), X / np.sqrt(np.square(X).mean(0))])
    return float(np.linalg.slogdet(X[inside].T @ X[inside] + 1e-9 * np.eye(X.shape[1]))[1])


def rough(rng: np.random.Generator, count: int, of: int) -> np.ndarray:
    inside = np.zeros(of, bool)
    inside[rng.permutation(of)[:count]] = True
    return inside


@seeds(1, 2, 3, 4)
def test_better_spread_than_chance(rng) -> None:
    """Eighty of two hundred, against fifty random draws: no joint or covariate worse covered than
    by the usual draw, all together better than by any."""
    data = campaign(rng)
    inside = split_configurations(data, 80, TURNS, rng)
    assert inside.sum() == 80
    draws = [rough(rng, 80, 200) for _ in range(50)]
    whole = np.column_stack([np.sin(data.q), np.cos(data.q), *data.covariates.values()])
    assert information(whole, inside) > max(information(whole, d) for d in draws)
    joints = [
        np.column_stack([f(k * q) for k in (1, 2) for f in (np.sin, np.cos)]) for q in data.q.T
    ]
    for values in (*joints, *(c[:, None] for c in data.covariates.values())):
        assert (
            information(values, inside) >= np.median([information(values, d) for d in draws]) - 0.3
        )  # nats, of 21
    temperature = data.covariates["temperature_C"]
    assert temperature[inside].max() > 20 + 0.95 * (
        temperature.max() - 20
    )  # the late drift is seen
    assert (
        temperature[inside].std() > 1.1 * temperature[:80].std()
    )  # the first eighty rows never do
    payload = data.covariates["payload_kg"] > 0
    assert inside[payload].mean() > 0.4


def test_the_start_alone_is_no_design(rng) -> None:
    """The exchange raises the determinant that it says it raises."""
    data = campaign(rng)
    X = _features(data, np.arange(len(data)), TURNS)
    inside = split_configurations(data, 80, TURNS, rng)

    def size(of: np.ndarray) -> float:
        return float(np.linalg.slogdet(X[of].T @ X[of] + 1e-6 * np.eye(X.shape[1]))[1])

    assert size(inside) > max(size(rough(rng, 80, 200)) for _ in range(50)) + 3


def test_one_seed_one_split(rng) -> None:
    data = campaign(rng)
    first, again, other = (
        split_configurations(data, 80, TURNS, np.random.default_rng(seed)) for seed in (5, 5, 6)
    )
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


@seeds(1, 2, 3)
def test_repeats_stay_on_one_side(rng) -> None:
    """Readings visited up to five times, two targets at each visit."""
    q = ARM.draw(rng, 40)[rng.permutation(np.r_[np.arange(40), rng.integers(0, 40, 60)])].repeat(
        2, axis=0
    )
    data = build_measurements(q, rng.normal(size=(200, 3)), target=["a", "b"] * 100)
    inside = split_configurations(data, 50, TURNS, rng)
    for reading in np.unique(q, axis=0):
        assert len(np.unique(inside[(q == reading).all(1)])) == 1
    most = max(len(np.unique(data.configuration[data.block == b])) for b in data.block)
    assert (
        abs(data.take(inside).configurations - 50) < most
    )  # as asked, but for what belongs together


@pytest.mark.parametrize("count", [1, 199, 200])
def test_any_count(count, rng) -> None:
    assert split_configurations(campaign(rng), count, TURNS, rng).sum() == count


def test_a_prismatic_joint(rng) -> None:
    """mm are not angles: no harmonics of a slide."""
    q = np.column_stack([rng.uniform(0, 500, 100), rng.uniform(-3, 3, 100)])
    data = build_measurements(q, np.zeros((100, 3)))
    inside = split_configurations(data, 30, (True, False), rng)
    assert inside.sum() == 30
    assert q[inside, 0].std() > q[:, 0].std()


# -- as a study asks for it
# -------------------------------------------------------------------------------------------


def test_default_size(rng) -> None:
    """Two fifths; all of a small file."""
    data = campaign(rng)
    assert choose_estimation_rows(study_with(), data, None, TURNS).sum() == 80
    assert choose_estimation_rows(study_with(), data.take(np.arange(20)), None, TURNS).all()


def test_by_column(rng) -> None:
    data = campaign(rng)
    role = np.array(["estimation", "held-out"], object)[(np.arange(200) % 3 == 0).astype(int)]
    assert np.array_equal(
        choose_estimation_rows(study_with(column="role"), data, role, TURNS),
        np.arange(200) % 3 != 0,
    )


def test_splits_that_cannot_be(rng) -> None:
    data = campaign(rng, 40)

    def refuse(labels: list[str], match: str, **plan: object) -> None:
        with pytest.raises(StudyError, match=match):
            choose_estimation_rows(
                study_with(column="role", **plan), data, np.array(labels, object), TURNS
            )

    refuse(
        ["estimation"] * 39 + ["held_out"], 'holds "held_out"; expected "estimation" or "held-out"'
    )
    refuse(["held-out"] * 40, "nothing is left for estimation")
    with pytest.raises(
        StudyError, match=r"split\.estimation = 41, but the file has 40 configurations"
    ):
        choose_estimation_rows(study_with(estimation=41), data, None, TURNS)
    twice = build_measurements(np.zeros((2, 6)), np.zeros((2, 3)), configuration=["a", "b"])
    with pytest.raises(StudyError, match="equal joint readings are on both sides"):
        choose_estimation_rows(
            study_with(column="role"), twice, np.array(["estimation", "held-out"], object), TURNS
        )


def _exchange_by_all(X: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """Fedorov's exchange with the information inverted and every leverage computed at each step."""
    inside = inside.copy()
    for _ in range(40 * int(np.sqrt(inside.sum()))):
        C = np.linalg.inv(X[inside].T @ X[inside] + 1e-6 * np.eye(X.shape[1]))
        leverage = ((X @ C) * X).sum(1)
        leaving = np.flatnonzero(inside)[np.argsort(leverage[inside])[:32]]
        joining = np.flatnonzero(~inside)[np.argsort(-leverage[~inside])[:32]]
        ratio = (1 + leverage[joining])[None] * (1 - leverage[leaving])[:, None]
        ratio += (X[leaving] @ C @ X[joining].T) ** 2
        i, j = np.unravel_index(ratio.argmax(), ratio.shape)
        if ratio[i, j] <= 1 + 1e-6:
            break
        inside[leaving[i]], inside[joining[j]] = False, True
    return inside


@pytest.mark.parametrize("count", [40, 1300])
def test_a_shortlist_exchanges_what_all_blocks_would(rng, count: int) -> None:
    """Of far more blocks than are listed, and of few, the same blocks end inside, one by one."""
    blocks = 2 * count + 100
    X = np.column_stack([np.ones(blocks), rng.normal(size=(blocks, 5))])
    inside = rough(rng, count, blocks)
    expected = _exchange_by_all(X, inside)
    _exchange(X, inside, np.ones(blocks, int))
    assert (inside == expected).all()


def test_a_shortlist_holds_every_candidate_or_says_that_it_may_not(rng) -> None:
    """Whenever it is sufficient, its candidates are those of all blocks, and its leverages true."""
    X = np.column_stack([np.ones(4000), rng.standard_t(3, size=(4000, 6))])
    inside = rough(rng, 1800, 4000)
    sufficient = 0
    shortlist = _Shortlist.choose(X, inside, X[inside].T @ X[inside])
    for _ in range(200):
        leaving, joining = shortlist.find_candidates()
        C = np.linalg.inv(X[inside].T @ X[inside])
        leverage = ((X @ C) * X).sum(1)
        np.testing.assert_allclose(shortlist.leverage, leverage[shortlist.blocks], rtol=1e-9)
        if shortlist.is_sufficient(leaving, joining):
            sufficient += 1
            least = np.flatnonzero(inside)[np.argsort(leverage[inside])[:32]]
            largest = np.flatnonzero(~inside)[np.argsort(-leverage[~inside])[:32]]
            assert set(shortlist.blocks[leaving]) == set(least)
            assert set(shortlist.blocks[joining]) == set(largest)
        shortlist.swap(int(leaving[0]), int(joining[0]))
        inside = np.isin(np.arange(4000), shortlist.blocks[shortlist.inside]) | (
            inside & ~np.isin(np.arange(4000), shortlist.blocks)
        )
    assert 0 < sufficient < 200
