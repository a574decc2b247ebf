"""A test belongs to one stage, whatever marks its file, itself and its parameters have."""

from __future__ import annotations

import pytest

pytestmark = pytest.mark.slow
STAGES = {"unit", "integration", "docs", "slow", "long"}


def list_stages(item: pytest.Item) -> list[str]:
    return [mark.name for mark in item.iter_markers() if mark.name in STAGES]


@pytest.mark.unit
def test_the_mark_of_a_test_counts_before_its_files(request: pytest.FixtureRequest) -> None:
    """`-m slow` ran it, too."""
    assert list_stages(request.node) == ["unit"]


@pytest.mark.integration
@pytest.mark.parametrize("name", [pytest.param("a", marks=pytest.mark.unit)])
def test_the_mark_of_a_parameter_counts_first(name: str, request: pytest.FixtureRequest) -> None:
    assert name in request.node.name
    assert list_stages(request.node) == ["unit"]
