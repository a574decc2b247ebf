"""What is told of a credible set: names with the probabilities of all their forms."""

from __future__ import annotations

import numpy as np
import pytest

from modelsel.diagnosis.candidates.candidate import Candidate
from modelsel.diagnosis.inference.credible_sets import CredibleSet, Entry
from modelsel.diagnosis.shapes.candidate_kinds import CandidateKind
from modelsel.mechanisms.registry import build_mechanisms
from modelsel.robot.files import load_robot


def test_names_are_listed_by_what_all_their_forms_hold() -> None:
    """The likeliest form was first, though another name's were likelier together."""
    arm = load_robot("ur5e")
    (one,) = build_mechanisms("tracker-scale", arm)
    first, second, *_ = build_mechanisms("link-bending:2", arm)
    shares = [(one, 0.4), (first, 0.3), (second, 0.25)]
    entries = []
    for place, (mechanism, share) in enumerate(shares):
        candidate = Candidate(mechanism, CandidateKind.MECHANISM, 0.01)
        entries.append(Entry(candidate, share, False, np.ones(1), place))
    named = CredibleSet(1.0, tuple(entries), 0, "found", np.zeros(3), 0)
    summed = named.sum_by_label()
    assert list(summed) == ["link-bending:2", "tracker-scale"]
    assert summed["link-bending:2"] == pytest.approx(0.55)
