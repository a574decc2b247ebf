"""NIST's certified regressions (Statistical Reference Datasets) through the solver that ships, and
through its peers.

    python tests/support/certified.py [--out benchmarks/results/certified.txt]

The linear sets are in MODELSEL_DATA/nist-strd; the nonlinear ones in nist_nonlinear.json, taken by
a script from NIST's own files (public domain), which lmfit 1.3.4 has in its source archive, folder
NIST_STRD. Nothing here solves: a regression is a `Source`, whose reduction `fit` asks for."""

from __future__ import annotations

import argparse
import json
import os
import sys
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import scipy.linalg
import scipy.optimize

from modelsel._typing import Array
from modelsel.exceptions import ModelselError
from modelsel.fitting.design import Model
from modelsel.fitting.identifiability import identify, solve
from modelsel.fitting.least_squares import Fit, fit
from modelsel.fitting.linearisation import Linearisation
from modelsel.fitting.reduction import Reduction, Source, reduce
from modelsel.mechanisms.causes import Named
from modelsel.mechanisms.terms import Mechanism, Screw, Term

LINEAR = (
    "norris",
    "pontius",
    "noint1",
    "noint2",
    "filip",
    "longley",
    *(f"wampler{k}" for k in range(1, 6)),
)
DATA = (
    Path(os.environ.get("MODELSEL_DATA") or Path(__file__).parents[3] / "shared" / "data")
    / "nist-strd"
)
MOST = 15.0  # digits that a double can show
SETTLED = 1e-11  # of the response's length: a step below it ends the iteration

# certified.json slips in two entries: NIST has 0.429796848199937E-03, and Wampler5's are a hundred
# times Wampler4's
SLIPS = {("norris", 1): 4.29796848199937e-4, ("wampler5", 1): 23635517.35}


@dataclass(frozen=True, eq=False)
class Certified:
    """Coefficients and standard errors (p,), residual standard deviation, how many digits of the
    coefficients are certified."""

    coefficients: Array
    errors: Array
    deviation: float
    digits: float

    def correct(self, estimate: Array) -> float:
        """Correct digits of the worst coefficient: log relative error, capped at what is certified;
        zero where there are none."""
        with np.errstate(invalid="ignore", over="ignore"):
            error = np.abs(estimate / self.coefficients - 1)
        return float(
            np.clip(
                -np.log10(np.maximum(np.nan_to_num(error, nan=1.0), 1e-16)), 0.0, self.digits
            ).min()
        )


@cache
def linear(name: str) -> tuple[Array, Array, Certified]:
    """(matrix, response, certified) of a linear set. Raises FileNotFoundError where there are no
    data."""
    entry = json.loads((DATA / "certified.json").read_text())[name]
    table = np.genfromtxt(DATA / f"{name}.csv", delimiter=",", names=True)
    cap = entry.get("coefficient_digits", entry["digits"])
    errors = np.array([SLIPS.get((name, k), e) for k, e in enumerate(entry["standard_errors"])])
    known = Certified(
        np.array(entry["coefficients"], float),
        errors,
        entry["residual_sd"],
        MOST if cap == "exact" else cap,
    )
    if name == "longley":
        return (
            np.column_stack([np.ones(len(table)), *(table[f"x{k}"] for k in range(1, 7))]),
            table["y"],
            known,
        )
    degree = int(entry["model"].partition("degree ")[2].split()[0])
    return (
        np.vander(table["x"], degree + 1, increasing=True)[:, "no intercept" in entry["model"] :],
        table["y"],
        known,
    )


Curve = Callable[[Sequence[Any], Any], Any]


def _peaks(b: Sequence[Any], x: Any) -> Any:
    return (
        b[0] * np.exp(-b[1] * x)
        + b[2] * np.exp(-((x - b[3]) ** 2) / b[4] ** 2)
        + b[5] * np.exp(-((x - b[6]) ** 2) / b[7] ** 2)
    )


def _cubics(b: Sequence[Any], x: Any) -> Any:
    return (b[0] + x * (b[1] + x * (b[2] + x * b[3]))) / (1 + x * (b[4] + x * (b[5] + x * b[6])))


def _wave(x: Any, period: Any, cosine: Any, sine: Any) -> Any:
    return cosine * np.cos(2 * np.pi * x / period) + sine * np.sin(2 * np.pi * x / period)


def _decays(b: Sequence[Any], x: Any) -> Any:
    return b[0] * np.exp(-b[1] * x) + b[2] * np.exp(-b[3] * x) + b[4] * np.exp(-b[5] * x)


def _chwirut(b: Sequence[Any], x: Any) -> Any:
    return np.exp(-b[0] * x) / (b[1] + b[2] * x)


CURVES: dict[str, Curve] = {  # as the "model" of each set in nist_nonlinear.json says
    "Bennett5": lambda b, x: b[0] * (b[1] + x) ** (-1 / b[2]),
    "BoxBOD": lambda b, x: b[0] * (1 - np.exp(-b[1] * x)),
    "Chwirut1": _chwirut,
    "Chwirut2": _chwirut,
    "DanWood": lambda b, x: b[0] * x ** b[1],
    "ENSO": lambda b, x: (
        b[0] + _wave(x, 12, b[1], b[2]) + _wave(x, b[3], b[4], b[5]) + _wave(x, b[6], b[7], b[8])
    ),
    "Eckerle4": lambda b, x: b[0] / b[1] * np.exp(-0.5 * ((x - b[2]) / b[1]) ** 2),
    "Gauss1": _peaks,
    "Gauss2": _peaks,
    "Gauss3": _peaks,
    "Hahn1": _cubics,
    "Thurber": _cubics,
    "Kirby2": lambda b, x: (b[0] + x * (b[1] + x * b[2])) / (1 + x * (b[3] + x * b[4])),
    "Lanczos1": _decays,
    "Lanczos2": _decays,
    "Lanczos3": _decays,
    "MGH09": lambda b, x: b[0] * (x * x + x * b[1]) / (x * x + x * b[2] + b[3]),
    "MGH10": lambda b, x: b[0] * np.exp(b[1] / (x + b[2])),
    "MGH17": lambda b, x: b[0] + b[1] * np.exp(-x * b[3]) + b[2] * np.exp(-x * b[4]),
    "Misra1a": lambda b, x: b[0] * (1 - np.exp(-b[1] * x)),
    "Misra1b": lambda b, x: b[0] * (1 - (1 + b[1] * x / 2) ** -2),
    "Misra1c": lambda b, x: b[0] * (1 - (1 + 2 * b[1] * x) ** -0.5),
    "Misra1d": lambda b, x: b[0] * b[1] * x / (1 + b[1] * x),
    "Nelson": lambda b, x: b[0] - b[1] * x[0] * np.exp(-b[2] * x[1]),
    "Rat42": lambda b, x: b[0] / (1 + np.exp(b[1] - b[2] * x)),
    "Rat43": lambda b, x: b[0] / (1 + np.exp(b[1] - b[2] * x)) ** (1 / b[3]),
    "Roszman1": lambda b, x: b[0] - b[1] * x - np.arctan(b[2] / (x - b[3])) / np.pi,
}


@cache
def curves() -> dict[str, dict[str, Any]]:
    """The nonlinear sets as stored."""
    return dict(json.loads((Path(__file__).parent / "nist_nonlinear.json").read_text()))


@dataclass(frozen=True, eq=False)
class Regression(Source):
    """A least-squares problem for `fit`: `curve` (b, x) -> prediction (N,) of the response;
    parameters are departures from `start` (p,). Derivatives by complex steps, exact to rounding."""

    curve: Curve
    x: Array
    response: Array
    start: Array

    def __len__(self) -> int:
        return len(self.response)

    def at(self, theta: Array) -> tuple[Array, Array]:
        """(derivatives (N, p), residual (N,)) at departures theta."""
        b = self.start + theta
        with np.errstate(all="ignore"):
            left = self.response - self.curve(b, self.x)
            steps = 1e-30j * np.diag(np.where(b, np.abs(b), 1.0))
            columns = [np.imag(self.curve(b + h, self.x)) / np.abs(h).sum() for h in steps]
        return np.column_stack(columns), np.asarray(left)

    def reduced(
        self,
        terms: Sequence[Term],
        at: Linearisation | None = None,
        only: Sequence[int] | None = None,
    ) -> Reduction:
        assert only is None or len(only) == len(terms)
        return reduce(*self.at(np.zeros(len(self.start)) if at is None else at.theta))


def model(p: int) -> Model:
    """p numbers without any meaning for an arm."""
    terms = tuple(Term(f"b{k}", (Screw(1, "tx", Named(f"x{k}")),)) for k in range(1, p + 1))
    return Model((Mechanism("certified", terms),))


def nonlinear(name: str, start: int) -> tuple[Regression, Certified]:
    """A nonlinear set and what is certified, from NIST's start 1 or 2."""
    entry = curves()[name]
    y, *x = np.array(entry["rows (y, x)"]).T
    known = Certified(
        np.array(entry["certified"]),
        np.array(entry["standard deviations"]),
        entry["residual standard deviation"],
        11.0,
    )
    return Regression(
        CURVES[name],
        x[0] if len(x) == 1 else np.array(x),
        np.log(y) if name == "Nelson" else y,
        np.array(entry[f"start {start}"]),
    ), known


def fitted(problem: Regression) -> Fit:
    """By the function that fits arms."""
    step = SETTLED * float(np.linalg.norm(problem.response))
    with np.errstate(all="ignore"):
        return fit(problem, model(len(problem.start)), step_mm=step, iterations=2000)


def shipped(X: Array, y: Array) -> Array:
    """(p,) by one reduction and solve; zero where the rank falls short."""
    reduction = reduce(X, y)
    kept = list(identify(reduction).kept)
    out = np.zeros(X.shape[1])
    out[kept] = solve(reduction, kept)[0]
    return out


def iterated(X: Array, y: Array) -> Array:
    """(p,) by `fit`, which goes on from the residual that is left."""
    return fitted(Regression(lambda b, x: x @ b, X, y, np.zeros(X.shape[1]))).theta


def peers() -> dict[str, Callable[[Array, Array], Array]]:
    """Least squares (matrix, response) -> estimate of other programs."""
    import statsmodels.api as sm

    return {
        "numpy lstsq": lambda X, y: np.linalg.lstsq(X, y, rcond=None)[0],
        **{
            f"scipy {d}": lambda X, y, d=d: scipy.linalg.lstsq(X, y, lapack_driver=d)[0]
            for d in ("gelsd", "gelsy", "gelss")
        },
        "statsmodels": lambda X, y: sm.OLS(y, X).fit().params,
        "statsmodels qr": lambda X, y: sm.OLS(y, X).fit(method="qr").params,
    }


def in_any_order(
    name: str,
    solvers: Sequence[Callable[[Array, Array], Array]],
    orders: int,
    rng: np.random.Generator,
) -> Array:
    """(orders, solvers) correct digits of a linear set, its rows as in the file and then in drawn
    orders: the digits of one order are a matter of luck."""
    X, y, known = linear(name)
    out = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # statsmodels on Filip's rank
        for k in range(orders):
            order = np.arange(len(y)) if k == 0 else rng.permutation(len(y))
            out.append([known.correct(solver(X[order], y[order])) for solver in solvers])
    return np.array(out)


def tried(name: str, start: int) -> tuple[float, float]:
    """Correct digits of `fit`, and of MINPACK's lmder by SciPy, both with the same derivatives;
    zero where refused."""
    problem, known = nonlinear(name, start)
    try:
        ours = known.correct(problem.start + fitted(problem).theta)
    except (ModelselError, ArithmeticError, ValueError, np.linalg.LinAlgError):
        ours = 0.0
    try:
        with np.errstate(all="ignore"):
            found = scipy.optimize.least_squares(
                lambda t: -problem.at(t)[1],
                np.zeros(len(problem.start)),
                lambda t: problem.at(t)[0],
                method="lm",
                xtol=1e-15,
                ftol=1e-15,
                gtol=1e-15,
                max_nfev=20_000,
            )
        theirs = known.correct(problem.start + found.x)
    except ValueError:
        theirs = 0.0
    return ours, theirs


def table(orders: int, rng: np.random.Generator) -> str:
    """What the documentation shows."""
    others = peers()
    solvers = {"modelsel": shipped, "its fit": iterated, **others}
    lines = [
        f"Linear sets: correct digits of the worst coefficient, median (least) of {orders} orders of the rows.",
        "",
        f"{'':10}" + "".join(f"{k:>16}" for k in solvers),
    ]
    for name in LINEAR:
        digits = in_any_order(name, list(solvers.values()), orders, rng)
        both = zip(np.median(digits, 0), digits.min(0), strict=True)
        lines.append(
            f"{name:10}" + "".join(f"{median:9.1f} ({least:4.1f})" for median, least in both)
        )
    lines += [
        "",
        "Nonlinear sets: correct digits, of 11 certified, from NIST's two starts.",
        "",
        f"{'':10}{'level':>10}{'fit, start 1':>16}{'start 2':>10}{'lmder, start 1':>18}{'start 2':>10}",
    ]
    for name, entry in curves().items():
        (a, c), (b, d) = tried(name, 1), tried(name, 2)
        lines.append(f"{name:10}{entry['level'].lower():>10}{a:16.1f}{b:10.1f}{c:18.1f}{d:10.1f}")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--orders", type=int, default=100)
    parser.add_argument("--out", type=Path)
    asked = parser.parse_args()
    said = table(asked.orders, np.random.default_rng(1))
    sys.stdout.write(said)
    if asked.out:
        asked.out.write_text(said)


if __name__ == "__main__":
    main()
