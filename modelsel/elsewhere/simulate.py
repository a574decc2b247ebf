"""Simulated measurements: the exact chain with planted screws and noise, in contract form."""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..data.measurements import measurements
from ..machine.robot import Robot
from ..matrix.design import residuals
from ..matrix.scene import scene
from ..words.errors import StudyError
from ..words.rigid import Array
from ..wrong.screws import Screw, Term

if TYPE_CHECKING:
    import pandas as pd


def simulate(robot: Robot, tool: Array, effects: Sequence[tuple[Screw, float]], *, q: Array, noise_mm: float,
             rng: np.random.Generator, covariates: Mapping[str, Array] | None = None) -> pd.DataFrame:
    """A DataFrame in contract form: joint readings q (m, n), the exact chain's positions with every effect (screw, size in
    mm or rad per unit of its cause) in it, and normal noise of `noise_mm` per coordinate. Frame 0 is the tracker's."""
    import pandas as pd
    bound = scene(robot, measurements(q, np.zeros((len(q), 3)), covariates=covariates), np.atleast_2d(tool))
    terms = tuple(Term(f"p{k}", (screw,)) for k, (screw, _) in enumerate(effects))
    with np.errstate(all="ignore"):
        position = -residuals(bound, terms, np.array([size for _, size in effects]))[:, :3]
    if not np.isfinite(position).all():
        raise StudyError("simulate: a planted effect is not finite at some configurations; check its cause and size")
    position = position + rng.normal(0.0, noise_mm, position.shape)
    frame = {f"q{j + 1}_{'mm' if joint.prismatic else 'rad'}": q[:, j] for j, joint in enumerate(robot.joints)}
    frame |= {f"{axis}_mm": position[:, a] for a, axis in enumerate("xyz")}
    return pd.DataFrame(frame | dict(covariates or {}))
