"""modelsel: what a robot's model gets wrong, why, and what is gained by saying so.

The steps of a study, each callable alone; names are loaded when first used, so that importing costs nothing.
"""
from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType
from typing import Any

from .version import VERSION

__version__ = VERSION

_HOME = {
    "read_study": "config", "Study": "config", "run": "study", "save": "study", "load": "robotfile", "read_robot": "robotfile",
    "builtin_names": "robotfile", "forward": "robot", "screw_field": "robot", "read_measurements": "io",
    "measurements": "measurements", "scene": "scene", "register": "register", "Model": "design", "residuals": "design",
    "design": "design", "fit": "fit", "Fit": "fit", "mechanism": "registry", "every": "registry", "BUILTIN": "registry",
    "candidates": "candidates", "extend": "extend", "choose": "split", "errors": "validate", "gain": "validate",
    "simulate": "simulate", "Cause": "causes", "Screw": "screws", "Term": "screws", "Mechanism": "screws", "PerJoint": "registry",
}
__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(import_module(f"modelsel.{_HOME[name]}"), name)
    raise AttributeError(f"module modelsel has no attribute {name}")


def __dir__() -> list[str]:
    return [*__all__, "__version__"]


class _Door(ModuleType):
    """The package: importing a submodule that shares a public name does not hide the name."""

    def __setattr__(self, name: str, value: Any) -> None:
        if not (name in _HOME and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Door
