"""Joints that may have an error that repeats are told apart from the noise that was estimated with them."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from error_parts import part, records

from modelsel.fitting.error_structure import ErrorStructure
from modelsel.fitting.noise import Floor
from modelsel.results.conclusions.verdict import NamedErrors, Noise, write_verdict
from modelsel.results.repeatability.unsure_joints import (
    UnsureJoints,
    describe_noise_floor,
    tell_unsure,
)
from modelsel.selection.gain import Gain

# as of 97 waves a turn that nothing has: the instrument has 0.02 mm, and with the joint 0.08
INSTRUMENT = part("instrument", 0.02, 0.018, 0.022, share=1 / 16, at_target=0.02 * 3**0.5)
LOOSE = part(
    "joint 1", 2e-4, 1e-4, 3e-4, told_by="directions", share=15 / 16, at_target=0.06 * 5**0.5
)
OTHER = part("joint 3", 2e-4, 1e-4, 3e-4, told_by="directions", at_target=0.05)
ESTIMATED = Floor(0.08, "estimated", 200)


def say(noise: Noise) -> str:
    rung = SimpleNamespace(estimation=SimpleNamespace(rms_mm=0.5))
    gain = Gain(2.0, 1.0, (0.9, 1.1))
    sentence, _, _ = write_verdict(rung, rung, gain, noise, NamedErrors([]), "all", "Nothing.")
    return sentence


def tell(*joints: object, floor: Floor = ESTIMATED) -> UnsureJoints:
    return tell_unsure(ErrorStructure((INSTRUMENT, *joints)), floor)


def test_the_instrument_comes_first_and_the_joint_apart() -> None:
    """All of it was told as noise of 0.0800 mm."""
    unsure = tell(LOOSE)
    assert unsure.names == ("joint 1",)
    assert unsure.rest_mm == pytest.approx(0.02 * 3**0.5)
    said = say(Noise(ESTIMATED, unsure=unsure))
    assert said.endswith(
        "noise of 0.0200 mm per coordinate (estimated) would leave 0.0346 mm, and with joint 1, which may "
        "have an error that repeats, 0.139 mm."
    )
    assert "joints 1 and 3, which may have errors that repeat, 0." in say(
        Noise(ESTIMATED, unsure=tell(LOOSE, OTHER))
    )
    both = say(Noise(ESTIMATED, 0.0, 0.2, unsure))
    assert "with joint 1, which may have an error that repeats, and the uncertainty of the" in both


@pytest.mark.parametrize("told_by", ["repeats", "given"])
def test_a_joint_that_is_known_not_to_repeat_is_noise(told_by: str) -> None:
    sure = part("joint 1", 2e-4, 1e-4, 3e-4, told_by=told_by, at_target=0.1)
    unsure = tell(sure)
    assert unsure.names == ()
    assert say(Noise(ESTIMATED, unsure=unsure)) == say(Noise(ESTIMATED))


def test_a_floor_of_another_source_does_not_hold_it() -> None:
    floor = Floor(0.02, "stated")
    assert tell(LOOSE, floor=floor) == UnsureJoints()


def test_a_part_that_hardly_matters_is_not_told() -> None:
    small = part("joint 1", 1e-6, 1e-7, 2e-6, told_by="directions", at_target=0.01)
    assert say(Noise(ESTIMATED, unsure=tell(small))) == say(Noise(ESTIMATED))


@pytest.mark.parametrize(
    ("source", "said"),
    [
        (
            "estimated",
            "0.0200 mm per coordinate (estimated), and with joint 1, which may have an error that repeats, 0.0800 mm per coordinate",
        ),
        ("repeats", "0.0800 mm per coordinate (repeats)"),
    ],
)
def test_a_page_says_the_same_of_the_floor(source: str, said: str) -> None:
    floor = SimpleNamespace(coordinate_mm=0.08, source=source, rms_mm=None)
    record = SimpleNamespace(noise_floor=floor, repeatability=records(INSTRUMENT, LOOSE))
    assert describe_noise_floor(record) == said
    # of rows with two coordinates on average, a length of as much is more in each of these
    two = SimpleNamespace(coordinate_mm=0.08, source=source, rms_mm=0.08 * 2**0.5)
    fewer = SimpleNamespace(noise_floor=two, repeatability=record.repeatability)
    assert describe_noise_floor(fewer).startswith(
        "0.0245 mm" if source == "estimated" else "0.0800 mm"
    )
    bare = SimpleNamespace(noise_floor=floor, repeatability=[])
    assert describe_noise_floor(bare) == f"0.0800 mm per coordinate ({source})"
