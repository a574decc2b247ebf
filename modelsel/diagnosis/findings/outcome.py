"""The outcome of a diagnosis: the extended model with its named effects and what is left."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..._typing import Array
from ...fitting.design import Model
from ...fitting.error_structure import ErrorStructure
from ...fitting.least_squares import Fit
from ...mechanisms.terms import Mechanism
from ..candidates.candidate import Candidate
from ..inference.credible_sets import CredibleSet
from ..search.path_sentences import DROPPED
from ..search.weighed_models import WeighedModel
from .effect_sentences import describe_effect
from .effects import Effect
from .stated_probability import write_chance


@dataclass(frozen=True, eq=False, repr=False)
class Diagnosis:
    """What is wrong with a base model: the effects that extend it, in the order they were found.

    `model` and `fit`: the extended model;
    `path`: what was tried on the way. `left`: the strongest explanation of what remains, with its
    p-value `left_p`, whatever it is (None without candidates); `held_back`: its p-value under equal
    normal noise, where that would have named it and the signs of the residual's own rows do not.
    `bound`: the evidence that a further effect needs; `single_f` (G,): the F statistic of every
    candidate `offered` alone on the base, `map_p` (G,): its family-wise p-value, none until effects
    are proven; `errors`: the parts that the errors have, which do not repeat and are no effects;
    `models`: the most probable sets of effects, of all that were weighed."""

    base: Model
    effects: tuple[Effect, ...]
    model: Model
    fit: Fit
    path: tuple[str, ...]
    left: CredibleSet | None
    left_p: float
    held_back: float | None
    bound: float
    single_f: Array = field(repr=False)
    map_p: Array = field(default_factory=lambda: np.zeros(0), repr=False)
    offered: tuple[Candidate, ...] = field(default=(), repr=False)
    errors: ErrorStructure = field(default_factory=ErrorStructure)
    models: tuple[WeighedModel, ...] = field(default=(), repr=False)

    @property
    def registered(self) -> tuple[Mechanism, ...]:
        """The registered mechanisms of the arm among the effects."""
        registered = []
        for effect in self.effects:
            candidate = effect.candidate
            if candidate.registered and candidate.fault is None:
                mechanism = candidate.mechanism
                registered.append(mechanism)
        return tuple(registered)

    @property
    def findings(self) -> tuple[str, ...]:
        """One sentence per effect: what, how much, how probable, and its p-value."""
        findings = []
        for effect in self.effects:
            sentence = describe_effect(effect)
            stem = sentence.rstrip(".")
            findings.append(f"{stem}; {write_chance(effect.p)}.")
        return tuple(findings)

    @property
    def dropped(self) -> tuple[str, ...]:
        """The labels of effects that were added and did not stay, each once."""
        kept = [effect.candidate.label for effect in self.effects]
        dropped = []
        for step in self.path:
            label = step.removeprefix(DROPPED)
            was_dropped = label != step
            if was_dropped and label not in kept:
                dropped.append(label)
        return tuple(dict.fromkeys(dropped))

    def __repr__(self) -> str:
        names = [mechanism.name for mechanism in self.base.mechanisms]
        base = ", ".join(names) or "the nominal model"
        count = len(self.effects)
        effects = f"{count} effects"
        if count == 0:
            effects = "no effects"
        elif count == 1:
            effects = "1 effect"
        lines = [f"Diagnosis of {base}: {effects}"]
        for k, sentence in enumerate(self.findings, 1):
            numbered = f"  {k}. {sentence}"
            lines.append(numbered)
        if self.left is not None:
            lines.append(f"  The strongest of what is left has {write_chance(self.left_p)}.")
        return "\n".join(lines)


def build_empty(base: Model, base_fit: Fit) -> Diagnosis:
    """Build the diagnosis without candidates: nothing may extend the base."""
    nothing = np.zeros(0)
    return Diagnosis(
        base=base,
        effects=(),
        model=base,
        fit=base_fit,
        path=(),
        left=None,
        left_p=1.0,
        held_back=None,
        bound=np.inf,
        single_f=nothing,
    )
