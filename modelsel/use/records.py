"""Causes, terms, mechanisms and robots as plain JSON values, and back: structure as structure, nothing parsed from text."""

from __future__ import annotations

from .._json import PAIR, THREE, Each, Maybe
from ..mechanisms.serialization import TERM
from ..robot.files import JOINT, ROTATION, TRANSFORM
from .refit import REFITS

CALIBRATION = {
    "kind": frozenset(["calibration"]), "study": str,
    "robot": {"name": str, "source": str, "gravity": Maybe(THREE), "joints": Each(JOINT, least=1), "last_mm": TRANSFORM,
              "usual?": PAIR},
    "targets": Each({"name": str, "tool_mm": THREE, "rotation": Maybe(ROTATION)}, least=1),
    "groups": Each({"name": str, "rotation": ROTATION, "translation_mm": THREE}, least=1),
    "registered": bool, "tracker_mm": THREE,
    "mechanisms": Each({"name": str, "sentence": str, "equation": str, "source": str, "terms": Each(TERM),
                         "contrary?": str}),
    "estimates": Each({"symbol": str, "value": float, "standard_error": float, "unit": str, "estimable": bool}),
    "covariance_factor": {"rows": Each(Each(float))},
    "noise_floor": {"coordinate_mm": float, "source": str, "freedom": Maybe(float)}, "held_out_rms_mm": Maybe(float),
    "ranges": {str: PAIR}, "provenance": {str: str}, "refits?": REFITS}
