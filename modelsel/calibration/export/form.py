"""An exported calibration: its text, what the form leaves out, and how far that is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..constant_part import Part, compute_points, sample_workspace
from ..prediction import compute_pose

if TYPE_CHECKING:
    from ..calibration import Calibration


@dataclass(frozen=True)
class Exported:
    """A file's text; `error_mm` largest difference between what is read back and the fit, in what
    the form can carry, over `configurations`; `left_out` in words, and how far the whole model is
    from the file: (rms, largest) mm. `errors`: of which rows, rms [mm] of the nominal arm, of the
    file, of the whole model (None where that is not known)."""

    text: str
    error_mm: float
    configurations: int
    left_out: tuple[str, ...] = ()
    left_out_mm: tuple[float, float] = (0.0, 0.0)
    notes: tuple[str, ...] = ()
    errors: tuple[str, float, float, float] | None = None

    @property
    def worse(self) -> str | None:
        """That the file is worse than the nominal arm, in words; None where it is not, or nobody
        knows."""
        if self.errors is None or self.errors[2] <= self.errors[1]:
            return None
        rows, nominal, own, _ = self.errors
        return f"this file is worse than the nominal arm: {own:.3g} mm rms against {nominal:.3g} mm, {rows}"


def describe_left_out(some: Sequence[Part]) -> tuple[str, ...]:
    """What a set of screws is, in words, once each mechanism."""
    out: dict[str, list[str]] = {}
    for p in some:
        places = out.setdefault(p.mechanism, [])
        places += [
            place for s in p.term.screws if (place := f"frame {s.frame} {s.axis}") not in places
        ]
    return tuple(f"{name} ({', '.join(places)})" for name, places in out.items())


def measure_whole(c: Calibration, text: str, read: Callable[[str, int], list[Part]]) -> Exported:
    """Measured as screws put back into the nominal chain."""
    worst = 0.0
    for t in range(len(c.targets)):
        at = sample_workspace(c, t)
        wanted = compute_pose(at, c.terms, c.theta).target.T
        worst = max(
            worst, float(np.linalg.norm(compute_points(at, read(text, t)) - wanted, axis=1).max())
        )
    return Exported(text, worst, len(at) * len(c.targets))
