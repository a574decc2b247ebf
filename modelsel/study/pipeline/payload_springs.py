"""Tell of every spring under the arm's weight and the payload what the payload alone says of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...diagnosis.candidates.nested_loads import COMPLIANCE
from ...diagnosis.findings.effects import Effect
from ...diagnosis.findings.springs_apart import SpringsApart, compare_springs
from ...exceptions import NotEstimable
from ...fitting.design import Model
from ...fitting.least_squares import Fit
from ...fitting.problem import Problem
from ...fitting.shrinkage import fit_shrunk
from ...mechanisms.compliance import (
    DECLARED,
    joint_compliance,
    needs_both_loads,
    payload_deflection,
)
from ...mechanisms.terms import Mechanism
from ...results.runs.finding_records import Finding


def add_payload_springs(
    findings: Sequence[Finding], problem: Problem, fitted: Fit
) -> tuple[Finding, ...]:
    """Return the findings, each spring under both loads with what it is under each; `fitted`: the model
    that has them, to the rows of `problem`."""
    told = []
    for finding in findings:
        effect = finding.effect
        apart = _tell_apart(effect, problem, fitted)
        told.append(replace(finding, effect=replace(effect, apart=apart)))
    return tuple(told)


def _tell_apart(effect: Effect, problem: Problem, fitted: Fit) -> SpringsApart | None:
    """Tell an effect apart; None where it is no spring under both loads, and where the data do not determine
    the two."""
    mechanism = effect.candidate.mechanism
    joint = mechanism.joint
    others = [one for one in fitted.model.mechanisms if one != mechanism]
    is_spring = mechanism.stem == COMPLIANCE and needs_both_loads(mechanism)
    if joint is None or not is_spring or len(others) == len(fitted.model.mechanisms):
        return None
    own = joint_compliance(problem.robot, joint, DECLARED)
    payload = payload_deflection(problem.robot, joint)
    if own in others or payload in others:
        return None
    model = Model((*others, own, payload))
    try:
        apart = fit_shrunk(problem, model, fitted, held="all")
    except NotEstimable:
        return None
    terms = [*apart.locate(own), *apart.locate(payload)]
    covariance = apart.covariance[np.ix_(terms, terms)]
    wider = _compare_errors(effect, fitted, mechanism)
    return compare_springs(apart.theta[terms], covariance * wider**2)


def _compare_errors(effect: Effect, fitted: Fit, mechanism: Mechanism) -> float:
    """Compare the standard error of an effect with that of the fit, which may be smaller."""
    (term,) = fitted.locate(mechanism)
    of_fit = float(fitted.standard_errors[term])
    (error,) = effect.standard_error
    return max(float(error) / of_fit, 1.0) if of_fit else 1.0
