"""Configurations that are measured and that could be, as columns of the terms of a model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from .._linalg import orthonormal_basis, project_out
from .._typing import Array
from ..exceptions import DataError
from ..fitting.design import compute_design
from ..fitting.linearisation import Linearisation
from ..fitting.noise import RAD_PER_MM
from ..fitting.problem import Problem
from ..fitting.whitening import UNIT
from ..mechanisms.terms import Term


@dataclass(frozen=True, eq=False)
class Pool:
    """What is measured already and what could be, as columns in mm: `known` (K, c, p), `possible`
    (P, r, p) with r coordinates a configuration; `terms` are the columns'; sigma [mm]. A row has 3
    coordinates, with orientations 6, their angles in the mm that are as uncertain."""

    terms: tuple[Term, ...]
    known: Array
    possible: Array
    sigma: float
    configurations: int  # known ones

    def of(self, terms: Sequence[Term]) -> list[int]:
        """Return the columns of some terms; features of the set-up have none."""
        place = {term.key: column for column, term in enumerate(self.terms)}
        columns = dict[int, None]()
        for term in terms:
            if term.fixture:
                continue
            column = place[term.key]
            columns[column] = None
        return list(columns)


def build_pool(
    known: Problem, possible: Problem, terms: Sequence[Term], at: Linearisation, sigma: float
) -> Pool:
    """Linearise the known rows and every configuration of the possible ones at the fitted model;
    what the known rows say of features they share is projected out. Where the known rows have
    orientations, the possible ones are taken to be measured with them, too. Raises DataError where
    configurations have different numbers of rows."""
    mm_per_rad = _weigh_orientations(known)
    distinct = tuple({t.key: t for t in terms if not t.fixture}.values())
    features = tuple({t.key: t for t in terms if t.fixture}.values())

    def columns(problem: Problem, of: Sequence[Term] = distinct) -> Array:
        rotation = None if mm_per_rad is None else np.tile(np.eye(3), (len(problem), 1, 1))
        data = replace(problem.data, rotation=rotation)
        tool_rotations = None if mm_per_rad is None else problem.tool_rotations
        plain = replace(problem, whitening=UNIT, data=data, tool_rotations=tool_rotations)
        design = compute_design(plain, of, at)[0]
        design[:, 3:] *= mm_per_rad or 1.0
        return design

    each = np.unique(possible.data.configuration, return_counts=True)[1]
    if np.ptp(each):
        raise DataError(
            "the pool's configurations have different numbers of rows.",
            remedy="List every target in each, or none.",
        )
    order = np.argsort(possible.data.configuration, kind="stable")
    measured = columns(known)
    if features:
        basis = orthonormal_basis(columns(known, features).reshape(-1, len(features)))
        measured = project_out(measured.reshape(-1, len(distinct)), basis).reshape(measured.shape)
    return Pool(
        distinct,
        measured,
        columns(possible)[order].reshape(len(each), -1, len(distinct)),
        sigma,
        known.data.configurations,
    )


def _weigh_orientations(known: Problem) -> float | None:
    """Return the mm of a position that are as uncertain as a radian of an orientation; None where
    no orientation is measured."""
    if known.data.rotation is None:
        return None
    matrices = known.whitening.matrices
    if matrices is None:
        return 1 / RAD_PER_MM
    position, rotation = np.split(np.diagonal(matrices, 0, 1, 2), 2, axis=1)
    measured = known.components_measured[:, 3:]
    return float(np.median(rotation[measured]) / np.median(position))
