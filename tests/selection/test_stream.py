"""Configurations in pieces: any order, any grouping, any machine, and the answers of all rows at
once."""

from __future__ import annotations

import re

import numpy as np
import pandas as pd
import pytest
from builders import drawn, planted

from modelsel.exceptions import DataError
from modelsel.fitting.design import Model
from modelsel.fitting.identifiability import solve
from modelsel.fitting.least_squares import fit
from modelsel.fitting.linearisation import Linearisation
from modelsel.fitting.problem import Problem
from modelsel.fitting.reduction import merged
from modelsel.mechanisms.causes import Named
from modelsel.mechanisms.registry import mechanism
from modelsel.mechanisms.terms import Mechanism, Screw, Term
from modelsel.robot.files import load_robot
from modelsel.selection.cross_validation import cross_validate, fold
from modelsel.selection.streaming import Parts, Stream, fit_parts, hash_folds, list_parts
from modelsel.selection.subsets import sweep_subsets

TOOL = (40.0, -25.0, 100.0)


def model(*names: str) -> Model:
    return Model(
        tuple(
            mechanism(name, load_robot("puma760"))
            for name in names or ("geometric", "joint2-twist")
        )
    )


def some_scene(rng: np.random.Generator, m: int = 240) -> Problem:
    which = model()
    theta = rng.normal(size=len(which.terms)) * np.array(
        [0.3 if t.unit.startswith("mm") else 3e-4 for t in which.terms]
    )
    return planted(drawn("puma760", rng, m), which.terms, theta, rng, 0.05)


def test_pieces_in_any_order_are_the_whole(rng) -> None:
    at, which = some_scene(rng), model()
    fitted = fit(at, which, held="nothing")
    theta, kept = fitted.theta, fitted.found.kept
    pieces = np.array_split(rng.permutation(len(at)), 7)
    streams = [Stream.empty(which.terms, 5, theta).add(at.take(p)) for p in pieces]
    left = streams[0].merge(streams[1]).merge(streams[2].merge(streams[3]))
    found = left.merge(streams[6].merge(streams[4].merge(streams[5])))
    once = Stream.empty(which.terms, 5, theta).add(at)
    whole, in_one = merged(found.folds), merged(once.folds)
    assert whole.rows == in_one.rows == 3 * len(at)
    a, b = solve(whole, kept), solve(in_one, kept)
    np.testing.assert_allclose(a[0], b[0], rtol=0, atol=1e-9 * np.abs(theta).max())
    assert a[2] == pytest.approx(b[2], rel=1e-11)
    one = cross_validate(found.folded(), kept)
    other = cross_validate(
        fold(at, which.terms, hash_folds(at.data, 5), Linearisation(which.terms, theta)), kept
    )
    np.testing.assert_allclose(one.held_out, other.held_out, rtol=1e-9)


def test_search_on_the_reduced_data(rng) -> None:
    at, base, extra = (
        some_scene(rng),
        model("geometric"),
        model("geometric", "joint2-twist", "joint3-twist", "backlash:3"),
    )
    kept = list(fit(at, base, held="nothing").found.kept)
    groups = [[k] for k in range(len(base.terms), len(extra.terms))]
    stream = Stream.empty(extra.terms, 6)
    for piece in np.array_split(np.arange(len(at)), 5):
        stream = stream.add(at.take(piece))
    found = sweep_subsets(stream.folded(), kept, groups)
    whole = sweep_subsets(fold(at, extra.terms, hash_folds(at.data, 6)), kept, groups)
    np.testing.assert_allclose(found.held_out, whole.held_out, rtol=1e-9)
    np.testing.assert_allclose(found.rss, whole.rss, rtol=1e-9)


def test_streams_of_different_points_do_not_merge(rng) -> None:
    terms = model().terms
    with pytest.raises(ValueError, match="different"):
        Stream.empty(terms).merge(Stream.empty(terms, at=np.ones(len(terms))))
    with pytest.raises(ValueError, match="different"):
        Stream.empty(terms, 5).merge(Stream.empty(terms, 6))


def test_equal_readings_share_a_fold(rng) -> None:
    at = some_scene(rng, 60)
    twice = at.take(np.concatenate([np.arange(60), np.arange(60)]))
    found = hash_folds(twice.data, 10)
    assert np.array_equal(found[:60], found[60:])
    counts = np.bincount(hash_folds(drawn("puma760", rng, 5000).data, 10))
    assert counts.min() > 400  # 500 each, give or take 21


@pytest.mark.integration
def test_partitions_on_disk(rng, tmp_path) -> None:
    """Two Parquet files of several row groups give the fit of the rows in memory; a pass reads each
    piece once."""
    at, which = some_scene(rng, 300), model("geometric")
    names = [*(f"q{j}_rad" for j in range(1, 7)), "x_mm", "y_mm", "z_mm"]
    table = pd.DataFrame(np.column_stack([at.data.q, at.data.position]), columns=names)
    for k, rows in enumerate((slice(0, 130), slice(130, 300))):
        table[rows].to_parquet(tmp_path / f"part{k}.parquet", row_group_size=50, index=False)
    files = [tmp_path / "part0.parquet", tmp_path / "part1.parquet"]
    asked: list[int] = []

    def watched(work, items):
        asked.append(len(items))
        return map(work, items)

    source = Parts(at.robot, TOOL, list_parts(files), watched)
    assert (len(source), len(source.parts)) == (300, 7)
    found, cv = fit_parts(source, which, 5)
    whole = fit(at, which)
    assert found.found.kept == whole.found.kept
    np.testing.assert_allclose(
        found.theta, whole.theta, rtol=0, atol=1e-7 * np.abs(whole.theta).max()
    )
    assert found.rss == pytest.approx(whole.rss, rel=1e-9)
    assert cv.rms == pytest.approx(whole.sigma, rel=0.2)
    assert set(asked) == {7}
    with pytest.raises(DataError, match="no such file"):
        list_parts([tmp_path / "absent.parquet"])


def test_parts_fit_positions_alone(rng, tmp_path) -> None:
    """Orientations in the files change nothing: a radian is no millimetre."""
    at, which = some_scene(rng, 120), model("geometric")
    names = [*(f"q{j}_rad" for j in range(1, 7)), "x_mm", "y_mm", "z_mm"]
    table = pd.DataFrame(np.column_stack([at.data.q, at.data.position]), columns=names)
    quaternions = rng.normal(size=(120, 4))
    quaternions /= np.linalg.norm(quaternions, axis=1)[:, None]
    turned = table.assign(**dict(zip(("qw", "qx", "qy", "qz"), quaternions.T, strict=True)))
    results = []
    for name, own in (("plain", table), ("turned", turned)):
        own.to_parquet(tmp_path / f"{name}.parquet", index=False)
        source = Parts(at.robot, TOOL, list_parts([tmp_path / f"{name}.parquet"]))
        results.append(fit_parts(source, which, 5))
    (plain, of_plain), (posed, of_posed) = results
    assert posed.rss == plain.rss
    assert of_posed.rms == of_plain.rms


def test_covariates_named_like_states_do_not_hang_on_other_parts(rng, tmp_path) -> None:
    at = some_scene(rng, 80)
    frame = at.data.to_frame()
    frame["move_speed"] = rng.uniform(10, 100, len(frame))
    frame["approach_speed"] = rng.uniform(10, 100, len(frame))
    stated = [name for name in frame.columns if re.fullmatch(r"approach\d", name)]
    frame.drop(columns=stated).to_parquet(tmp_path / "day.parquet", index=False)
    arm = load_robot("puma760")
    terms = [
        Term(f"k{k}", (Screw(k, "tx", Named(name)),))
        for k, name in enumerate(("move_speed", "approach_speed"), 1)
    ]
    which = Model((mechanism("geometric", arm), Mechanism("speed", tuple(terms))))
    fitted, _ = fit_parts(Parts(arm, TOOL, list_parts([tmp_path / "day.parquet"])), which)
    assert len(fitted.theta) == len(which.terms)
