"""How long is the arm? Planes, touched points and bars of unknown length do not say: an arm of half the size meets them all.

Worse, the smaller arm meets them better, by half of every error, and least squares would shrink it to nothing. One length then
stays as drawn, and all others are relative to it (Bennett & Hollerbach 1991, closed-loop calibration). Nor do touched points say
which way the base looks: about points that nobody knows the whole may turn.
"""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..mechanisms.causes import ONE, Number
from ..mechanisms.terms import Term
from .identify import Identified
from .reduce import Source
from .scene import Scene

APART_MM = 1.0     # spread of readings that tells one size from another
KNOWN = {"same-point": 2, "plane": 4}      # known features that do


def sized(scene: Scene | Source) -> bool:
    """Whether some row measures a length: a coordinate, a wire, a distance, a bar of known length, features at known places."""
    if isinstance(scene, Source) or (gauges := scene.data.gauges) is None or any(j.prismatic for j in scene.robot.joints):
        return True
    if gauges.of("distance").any() or any(f.kind in ("wire", "ball-bar") and "length" not in f.free for f in gauges.features):
        return True
    readings = [gauges.length[gauges.feature == k] for k, f in enumerate(gauges.features) if f.kind == "wire"]
    readings += [scene.data.position[gauges.of("point", "xyz"[a]), a] for a in range(3)]
    if any(len(r) and np.ptp(r) > APART_MM for r in readings):
        return True
    return any(sum(f.kind == kind and f.position is not None and "tz" not in f.free for f in gauges.features) >= count
               for kind, count in KNOWN.items())


def turned(scene: Scene | Source) -> bool:
    """Whether touched points stand alone: no row is measured in a frame, no feature is known. Of wires and planes the columns say
    so themselves; touched points seem to tell, by as much as they miss each other on the nominal arm."""
    if isinstance(scene, Source) or (gauges := scene.data.gauges) is None:
        return False
    known = any(f.kind != "distance" and not {"tx", "tz"} & set(f.free) for f in gauges.features)
    return bool(gauges.of("same-point").any()) and not known and not gauges.of("point", "x", "y", "z").any()


def as_drawn(found: Identified, scene: Scene | Source, terms: Sequence[Term]) -> Identified:
    """Without the representatives that these data leave as drawn: the way the base looks, and the largest length of the arm where
    they measure none and every length is open."""
    if turned(scene):
        base = [k for k in found.kept if [(s.frame, s.axis[0], s.cause) for s in terms[k].screws] == [(1, "r", ONE)]]
        found = replace(found, kept=tuple(k for k in found.kept if k not in base), still=tuple(base))
    if sized(scene) or isinstance(scene, Source):
        return found
    robot = scene.robot
    lengths = {(f + 1, "xyz"[i]): v for f, fixed in enumerate(robot.fixed[:-1]) for i, v in fixed.offset}
    last = np.zeros(3)
    for i, v in robot.fixed[-1].offset:
        last[i] = v
    lengths |= {(robot.n + 1, "xyz"[i]): float(v) for i, v in enumerate(last + scene.tools[0]) if v}
    place = {(t.screws[0].frame, t.screws[0].axis[1:]): k for k, t in enumerate(terms)
             if len(t.screws) == 1 and t.screws[0].axis[0] == "t" and isinstance(t.screws[0].cause, Number)}
    if not lengths.keys() <= place.keys():
        return found
    direction = np.zeros(len(terms))
    for key, value in lengths.items():
        direction[place[key]] = value
    own = np.abs(direction @ found.relation)
    open_ = [i for i, k in enumerate(found.exact) if k in place.values() and k in found.kept]
    if not open_ or not own[open_].any():
        return found
    held = found.exact[max(open_, key=lambda i: float(own[i]))]
    return replace(found, kept=tuple(k for k in found.kept if k != held), held=held)
