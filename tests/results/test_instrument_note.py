"""A finding that depends on the distance from the instrument says where that is taken to stand."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest
from builders import drawn

from modelsel.mechanisms.registry import mechanism
from modelsel.results.conclusions.finding_notes import instrument_notes
from modelsel.robot.files import load_robot


def named(*names: str) -> SimpleNamespace:
    """A diagnosis of these mechanisms."""
    robot = load_robot("puma760")
    candidates = [SimpleNamespace(label=name, mechanism=mechanism(name, robot)) for name in names]
    return SimpleNamespace(effects=[SimpleNamespace(candidate=c) for c in candidates])


@pytest.mark.parametrize(
    ("names", "tracker", "count"),
    [
        (("refraction",), (0.0, 0.0, 0.0), 1),
        (("backlash:3",), (0.0, 0.0, 0.0), 0),
        (("backlash:3", "refraction"), (4000.0, 0.0, 500.0), 0),
    ],
)
def test_only_an_instrument_within_reach_is_doubted(
    names: tuple[str, ...], tracker: tuple[float, float, float], count: int, rng
) -> None:
    problem = replace(drawn(load_robot("puma760"), rng, 30), tracker=tracker)
    notes = instrument_notes(problem, named(*names))
    assert len(notes) == count
    if count:
        assert notes[0].sentence.startswith(
            "by refraction the positions err as seen from the instrument"
        )
        assert "tracker_mm under [noise]" in notes[0].sentence
