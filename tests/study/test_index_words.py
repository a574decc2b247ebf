"""The indices of observability are named in words."""

from __future__ import annotations

from types import SimpleNamespace

from modelsel.study.planning.planning import _format_indices


def test_indices_of_observability_are_told_in_words() -> None:
    names = ("d", "a", "o1", "o2", "o3", "o4", "o5")
    plan = SimpleNamespace(indices=dict.fromkeys(names, (1.0, 2.0)))
    said = _format_indices(plan)
    assert "larger is better" in said
    assert "O2 (smallest over largest singular value) 1.00 -> 2.00" in said
    assert "O3 (least determined direction) 1.00 -> 2.00" in said
