"""modelsel: what a robot's model gets wrong, why, and what is gained by saying so.

The steps of a study, each callable alone; names are loaded when first used, so that importing costs nothing.
"""
from __future__ import annotations

from importlib import import_module
from typing import Any

from .version import VERSION

__version__ = VERSION

_HOME = {  # a name that is also a module's (fit, scene, extend …) is imported from there: from modelsel.fit import fit
    "read_study": "config", "Study": "config", "run": "study", "save": "study", "load": "robotfile", "read_robot": "robotfile",
    "builtin_names": "robotfile", "forward": "robot", "screw_field": "robot", "read_measurements": "io", "Model": "design",
    "residuals": "design", "Fit": "fit", "mechanism": "registry", "every": "registry", "BUILTIN": "registry",
    "PerJoint": "registry", "choose": "split", "gain": "validate", "Cause": "causes", "Screw": "screws", "Term": "screws",
    "Mechanism": "screws", "load_calibration": "calibration", "Calibration": "calibration", "predict": "calibration",
    "calibration_of": "study",
}
__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(import_module(f"modelsel.{_HOME[name]}"), name)
    raise AttributeError(f"module modelsel has no attribute {name}")


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
