"""Weights of registered names: how much likelier than another one each is beforehand."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

from ...measurements.campaign.state_names import StateKind, state_kind
from ...mechanisms.drifts import warms_up
from ...mechanisms.moved_targets import find_moved_targets
from ...mechanisms.terms import Mechanism

# findings that a name is credited with before any outcome is known: what nine in ten that are
# right would leave
CREDIT_CONFIRMED, CREDIT_CONTRADICTED = 9.0, 1.0


def weigh_outcomes(confirmed: int, contradicted: int) -> float:
    """Weigh a registered name by what became of its findings.

    Confirmed ones were borne out, by a part that was opened or a later campaign; contradicted ones
    were not. The share of a name's findings that are right has a beta distribution, which begins
    with a mean of 0.9 and the strength of ten findings; the weight is the odds of its mean over
    those at the beginning: 1 without outcomes, 0.25 after three that were contradicted, 2 after
    nine that were confirmed. Raises ValueError for negative counts."""
    if confirmed < 0 or contradicted < 0:
        raise ValueError("numbers of findings are not negative")
    odds = (CREDIT_CONFIRMED + confirmed) / (CREDIT_CONTRADICTED + contradicted)
    return odds / (CREDIT_CONFIRMED / CREDIT_CONTRADICTED)


def choose_weight(name: str, weights: Mapping[str, float]) -> float:
    """Choose the weight of a registered name: its own, else that of the name without its joint,
    else 1."""
    stem, _, _ = name.partition(":")
    return weights.get(name, weights.get(stem, 1.0))


def weigh_names(mechanisms: Sequence[Mechanism], weights: Mapping[str, float]) -> dict[str, float]:
    """Weigh the names of registered mechanisms. Those that move one target of several share the
    weight of one name among them: more reflectors make no slip likelier than any other error. So do those
    that move more targets than one."""
    stems: dict[str, tuple[str, bool]] = {}
    weighed = {}
    for m in mechanisms:
        name = m.name
        moved = find_moved_targets(m)
        if moved:
            stems[name] = m.stem, len(moved) > 1
        weighed[name] = choose_weight(name, weights)
    sharing = Counter(stems.values())
    for name, stem in stems.items():
        count = sharing[stem]
        weighed[name] /= count
    return weighed


def share_constants(mechanisms: Sequence[Mechanism]) -> list[float]:
    """Share the prior of every name among its constants: evenly, but that a temperature as it is weighs
    as much as with all lags together, and other courses of a drift as much as all warm-ups."""
    forms = []
    for m in mechanisms:
        late = _is_late(m)
        warming = warms_up(m)
        forms.append((m.name, late, warming))
    constants = Counter(forms)
    sorts = Counter(name for name, *_ in constants)
    shares = []
    for form in forms:
        sharing = sorts[form[0]] * constants[form]
        shares.append(1 / sharing)
    return shares


def _is_late(mechanism: Mechanism) -> bool:
    return any(state_kind(name) is StateKind.LATE for name in mechanism.names())
