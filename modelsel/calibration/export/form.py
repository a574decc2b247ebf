"""An exported calibration: its text, what the form leaves out, and how far that is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..._typing import Array
from ...exceptions import write_rounded
from ...fitting.problem import Problem
from ...mechanisms.instrument import MISREADINGS
from ..constant_part import Part, compute_points, sample_workspace
from ..prediction import compute_pose

if TYPE_CHECKING:
    from ..calibration import Calibration

# mm below which a length is told in µm
LEAST_MM = 1e-2


@dataclass(frozen=True)
class Exported:
    """A file's text; `error_mm` largest difference between what is read back and the fit, in what
    the form can carry, over `configurations`; `left_out` in words, and how far the whole model is
    from the file: (rms, largest) mm. `errors`: of which rows, rms [mm] of the nominal arm, of the
    file, of the whole model (None where that is not known); from `useful` times the nominal arm's
    error on, the file is said to be no better. `table`: what it holds beside the nominal arm, in
    lines."""

    text: str
    error_mm: float
    configurations: int
    left_out: tuple[str, ...] = ()
    left_out_mm: tuple[float, float] = (0.0, 0.0)
    notes: tuple[str, ...] = ()
    errors: tuple[str, float, float, float] | None = None
    useful: float = 1.0
    table: tuple[str, ...] = ()

    def __repr__(self) -> str:
        size = len(self.text)
        told = f"Export of {size:,} characters"
        if self.left_out:
            missing = "; ".join(self.left_out)
            told += f", without {missing}"
        return told

    @property
    def worse(self) -> str | None:
        """That the file is worse than the nominal arm, in words; None where it is not, or nobody
        knows."""
        if self.errors is None:
            return None
        rows, nominal, own, _ = self.errors
        if own <= self.useful * nominal:
            return None
        compared = "worse" if own > nominal else "hardly better"
        left = write_rounded(own)
        before = write_rounded(nominal)
        return f"this file is {compared} than the nominal arm: {left} mm rms against {before} mm, {rows}"


def describe_left_out(parts: Sequence[Part]) -> tuple[str, ...]:
    """Describe what a form leaves out, once each mechanism; of a cell of the error map its place
    and causes, as elsewhere."""
    out: dict[str, list[str]] = {}
    causes: dict[str, list[str]] = {}
    for part in parts:
        places = out.setdefault(part.mechanism, [])
        first, *_ = part.term.screws
        cause = str(first.cause)
        causes.setdefault(part.mechanism, []).append(cause)
        for screw in part.term.screws:
            frame = screw.frame
            place = f"frame {frame} {screw.axis}"
            if place not in places:
                places.append(place)
    sentences = []
    for name, places in out.items():
        listed = ", ".join(places)
        sentence = f"{name} ({listed})"
        if " " in name and name not in MISREADINGS:
            driven = " & ".join(causes[name])
            sentence = f"{listed} · {driven}"
        sentences.append(sentence)
    return tuple(sentences)


def measure_export(
    c: Calibration,
    text: str,
    compute_difference: Callable[[int, Problem], Array],
    notes: tuple[str, ...] = (),
) -> Exported:
    """Measure an exported text over the workspace of every target.

    `compute_difference` gives, of a target's number and its configurations, where the text has the
    target minus where it should be (m, 3) mm."""
    worst = 0.0
    configurations = 0
    for target in range(len(c.targets)):
        at = sample_workspace(c, target)
        difference = compute_difference(target, at)
        errors = np.linalg.norm(difference, axis=1)
        largest = float(errors.max())
        worst = max(worst, largest)
        configurations += len(at)
    return Exported(text, worst, configurations, notes=notes)


def measure_whole(c: Calibration, text: str, read: Callable[[str, int], list[Part]]) -> Exported:
    """Measure exported screws, put back into the nominal chain."""

    def compute_difference(target: int, at: Problem) -> Array:
        wanted = compute_pose(at, c.terms, c.theta).target.T
        return compute_points(at, read(text, target)) - wanted

    return measure_export(c, text, compute_difference)


def write_difference(mm: float) -> str:
    """Write a length [mm] with two digits, in µm where it is below LEAST_MM."""
    if mm < LEAST_MM:
        return f"{write_rounded(mm * 1e3, 2)} µm"
    return f"{write_rounded(mm, 2)} mm"
