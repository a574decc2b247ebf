"""What a study knows of the features that rows share: anchors, spheres, points, planes, ball-bars."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from ..exceptions import StudyError, suggest
from .campaign.features import FREE_NUMBERS, Feature
from .measurements import Measurements

# keys of a feature in the study file, and the kinds that have them
KINDS_WITH_KEY = {
    "normal": ("plane",),
    "length_mm": ("ball-bar",),
    "zero": ("wire",),
    "position_mm": ("wire", "ball-bar", "same-point", "plane"),
}


@dataclass(frozen=True)
class KnownFeature:
    """A feature as a study describes it: where it is, a plane's normal, a ball-bar's length;
    `estimate`: these are a first guess; `zero`: the wire's reading leaves out a length that is not
    known."""

    position: tuple[float, float, float] | None = None
    normal: tuple[float, float, float] | None = None
    length: float | None = None
    estimate: bool = False
    zero: bool = False


def apply_known_features(data: Measurements, known: Mapping[str, KnownFeature]) -> Measurements:
    """Complete the features of measurements by what a study knows of them. Raises StudyError with
    every problem."""
    gauges = data.gauges
    features = () if gauges is None else gauges.features
    names = [feature.name for feature in features]
    problems = [
        f"{_place_of(name)}: no row of the file names it. {suggest(name, names)}"
        for name in known
        if name not in names
    ]
    completed = []
    for feature in features:
        place = _place_of(feature.name)
        knowledge = known.get(feature.name, KnownFeature())
        problems += [f"{place}: {p}" for p in _find_problems(feature, knowledge)]
        completed.append(_complete_feature(feature, knowledge))
    if problems:
        raise StudyError(*problems)
    if gauges is None:
        return data
    gauges = replace(gauges, features=tuple(completed))
    return replace(data, gauges=gauges)


def _place_of(name: str) -> str:
    """Name the place of a feature in the study file."""
    return f"measurements.features.{name}"


def _find_problems(feature: Feature, known: KnownFeature) -> list[str]:
    """Find what a study says of a feature that its kind does not have, or that contradicts its
    rows."""
    given = {
        "normal": known.normal is not None,
        "length_mm": known.length is not None,
        "zero": known.zero,
        "position_mm": known.position is not None,
    }
    problems = [
        f"{key} goes with {', '.join(kinds)}, but its rows are of kind {feature.kind}."
        for key, kinds in KINDS_WITH_KEY.items()
        if given[key] and feature.kind not in kinds
    ]
    if feature.kind == "plane" and given["position_mm"] != given["normal"]:
        problems.append("a known plane needs position_mm and normal.")
    in_rows = feature.kind == "ball-bar" and "length" not in feature.free
    if in_rows and given["length_mm"]:
        problems.append("length_mm stands in its rows already; give it once.")
    return problems


def _complete_feature(feature: Feature, known: KnownFeature) -> Feature:
    is_placed = known.position is not None and not known.estimate
    free = () if is_placed else FREE_NUMBERS[feature.kind]
    is_open_bar = feature.kind == "ball-bar" and "length" in feature.free
    is_unknown_bar = is_open_bar and known.length is None
    if known.zero or is_unknown_bar:
        free = (*free, "length")
    return replace(
        feature, position=known.position, normal=known.normal, length=known.length, free=free
    )
