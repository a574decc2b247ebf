"""Free functions are shrunk: every one's coefficients have a variance of their own, found by
maximum marginal likelihood."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .._typing import Array, Index
from .design import Model
from .least_squares import STEP_MM, Fit, Held, fit
from .problem import Problem
from .splines import spline, splines

ROUNDS = 60
STIFFEST = 1e6  # largest precision of a coefficient, in squared norms of its column
START = {"r": 3e-4, "t": 0.1}  # rad, mm: first guess of a coefficient's size


def wide_groups(model: Model) -> list[Index]:
    """Term indices of every free function, shifts and turns apart: each group is shrunk by a
    variance of its own."""
    place = {t.key: k for k, t in enumerate(model.terms)}
    out: dict[tuple[int, str], list[int]] = {}
    for number, m in enumerate(model.mechanisms):
        for t in m.terms:
            if spline(t) is not None:
                out.setdefault((number, t.screws[0].axis[0]), []).append(place[t.key])
    return [np.array(group, dtype=np.intp) for group in out.values()]


def variances(fitted: Fit, groups: Sequence[Index]) -> Array:
    """(p,) precisions sigma²/v of every term: MacKay's fixed point of the marginal likelihood, v
    one number a group."""
    kept = list(fitted.found.kept)
    where = {k: i for i, k in enumerate(kept)}
    inside = [np.array([where[k] for k in g if k in where], dtype=np.intp) for g in groups]
    R: Array = fitted.reduction.R[:-1, kept]
    response = fitted.reduction.R[:-1, -1] + R @ fitted.theta[kept]
    gram, cross, rest = R.T @ R, R.T @ response, float(fitted.reduction.R[-1, -1] ** 2)
    weak = np.zeros((0, len(kept))) if fitted.weak.rows is None else fitted.weak.rows[:, kept]
    held = gram + weak.T @ weak  # what the data hardly determine is held by its own prior
    precision: Array = np.zeros(len(kept))
    inverse: Array = np.eye(len(kept))  # of the prior's correlation, by blocks
    for index, root in splines(fitted.terms):
        at = [n for n, k in enumerate(index) if k in where]
        place = [where[index[n]] for n in at]
        half = np.linalg.inv(root)[:, at]
        inverse[np.ix_(place, place)] = half.T @ half
    for g, i in zip(groups, inside, strict=True):
        precision[i] = 1.0 if fitted.precision is None else fitted.precision[g[0]]
    for _ in range(ROUNDS):
        scale = np.sqrt(precision)
        covariance: Array = np.asarray(
            np.linalg.inv(held + scale[:, None] * inverse * scale), dtype=np.float64
        )
        beta = covariance @ cross
        rss = float(np.square(response - R @ beta).sum()) + rest
        tight = inverse * covariance  # its sum over a group: the trace of the two blocks' product
        spent = [
            len(i) - float(precision[i] @ tight[np.ix_(i, i)].sum(1)) for i in inside
        ]  # effective parameters
        fixed = len(kept) - sum(map(len, inside))
        sigma2 = rss / max(fitted.rows - fixed - sum(spent), 1.0)
        new: Array = precision.copy()
        for i, used in zip(inside, spent, strict=True):
            most = STIFFEST * float(
                gram[i, i].max(initial=0.0)
            )  # a function that is not there is held at nought
            size = float(beta[i] @ inverse[np.ix_(i, i)] @ beta[i])
            new[i] = min(sigma2 * max(used, 1e-3) / max(size, 1e-300), most)
        if np.allclose(new, precision, rtol=1e-3):
            precision = new
            break
        precision = new
    out = np.zeros(len(fitted.theta))
    out[kept] = precision
    return out


def fit_shrunk(
    problem: Problem,
    model: Model,
    start: Fit | None = None,
    step_mm: float = STEP_MM,
    *,
    held: Held = "geometry",
) -> Fit:
    """Fit a model, its free functions shrunk; a plain fit where it has none. `start`: a fit of a
    similar model; `held` as in `fit`."""
    known = (
        {} if start is None else dict(zip((t.key for t in start.terms), start.theta, strict=True))
    )
    theta = None if start is None else np.array([known.get(t.key, 0.0) for t in model.terms])
    groups = wide_groups(model)
    if not groups:
        return fit(problem, model, start=theta, step_mm=step_mm, held=held)
    weight = problem.whitening.typical_weight(None)
    before = (
        {}
        if start is None or start.precision is None
        else dict(zip((t.key for t in start.terms), start.precision, strict=True))
    )
    precision = np.zeros(len(model.terms))
    for g in groups:
        first = model.terms[g[0]]
        usual = START[first.screws[0].axis[0]]
        precision[g] = before.get(first.key, (0.1 * weight / usual) ** 2)
    fitted = fit(problem, model, precision=precision, start=theta, step_mm=step_mm, held=held)
    for _ in range(2):
        new = variances(fitted, groups)
        settled = np.allclose(new, precision, rtol=0.1)
        precision = new
        fitted = fit(problem, model, precision=new, start=fitted.theta, step_mm=step_mm, held=held)
        if settled:
            break
    return fitted
