"""Keep unfinished chains on disk, for `--resume`.

A chain is in a hidden file beside the result, whole or not at all, and belongs to one run: its
data, study, versions and parameters.
"""

from __future__ import annotations

import io
import json
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from zipfile import BadZipFile, ZipFile

import numpy as np
from numpy.typing import NDArray

from ..._files import HIDDEN, write_atomically
from ...exceptions import StudyError
from ...uncertainty.walk import State

COPY_INTERVAL_S = 5.0  # between two copies; how often copies are made does not change the result
# what identifies a run, in the words of messages
IDENTITY = {
    "data_sha256": "the measurements",
    "study_sha256": "the study file",
    "robot_sha256": "the robot",
    "modelsel": "modelsel's version",
    "numpy": "numpy's version",
    "names": "the parameters",
}
RANDOM_KEY = 624  # words of a Mersenne twister's state


class Checkpoint:
    """The unfinished chain of an output folder, in DIR/.modelsel/sampling.npz.

    `resume`: go on from the chain that is there; else it is overwritten.
    """

    def __init__(self, folder: Path, resume: bool):
        identity: dict[str, object] = {}
        hidden = folder / HIDDEN
        self.path = hidden / "sampling.npz"
        self.resume = resume
        self.identity = identity
        self.last_copy = time.monotonic()

    def bind(self, provenance: Mapping[str, str]) -> None:
        """Take the data, study and versions of the run.

        Raises StudyError where the chain on disk has others.
        """
        identity = dict[str, object]()
        for key in IDENTITY:
            if key in provenance:
                identity[key] = provenance[key]
        self.identity = identity
        if self.resume:
            stored = self._read()
            self._compare(stored, identity)

    def load(self, names: Sequence[str]) -> State | None:
        """Return the chain on disk; None where there is none, or without `resume`.

        Raises StudyError where its parameters have other names.
        """
        stored = self._read() if self.resume else None
        if stored is None:
            return None
        self._compare(stored, {**self.identity, "names": list(names)})
        position, has_gauss, gauss = stored["random_rest"].tolist()
        random = ("MT19937", stored["random_key"], int(position), int(has_gauss), gauss)
        return State(
            chain=stored["chain"],
            log_density=stored["log_density"],
            accepted=stored["accepted"],
            random=random,
        )

    def keep(self, names: Sequence[str], state: State, *, now: bool = False) -> None:
        """Write the chain, unless it was written less than COPY_INTERVAL_S ago."""
        if not now and time.monotonic() - self.last_copy < COPY_INTERVAL_S:
            return
        identity = json.dumps({**self.identity, "names": list(names)})
        _, key, position, has_gauss, gauss = state.random
        content = io.BytesIO()
        np.savez(
            content,
            identity=np.array(identity),
            chain=state.chain,
            log_density=state.log_density,
            accepted=state.accepted,
            random_key=key,
            random_rest=np.array([position, has_gauss, gauss], float),
        )
        write_atomically(self.path, content.getvalue())
        self.last_copy = time.monotonic()

    def clear(self) -> None:
        """Remove the chain, and its folder if that is empty."""
        self.path.unlink(missing_ok=True)
        folder = self.path.parent
        if not folder.is_dir():
            return
        empty = not any(folder.iterdir())
        if empty:
            folder.rmdir()

    def _read(self) -> dict[str, NDArray[Any]] | None:
        """Return the arrays on disk; None without a file. Raises StudyError for another file."""
        try:
            content = self.path.read_bytes()
        except FileNotFoundError:
            return None
        except OSError:
            content = b""
        try:
            stored = _read_arrays(content)
            _check_arrays(stored)
            return stored
        except (OSError, ValueError, EOFError, KeyError, NotImplementedError, BadZipFile):
            raise StudyError(
                f"{self.path}: not a chain that can be resumed; run again without --resume."
            ) from None

    def _compare(
        self, stored: Mapping[str, NDArray[Any]] | None, expected: Mapping[str, object]
    ) -> None:
        """Check that a stored chain belongs to this run. Raises StudyError."""
        if stored is None:
            return
        identity = json.loads(str(stored["identity"]))
        changed = [IDENTITY[key] for key in expected if identity.get(key) != expected[key]]
        if changed:
            raise StudyError(
                f"--resume: the unfinished chain in {self.path.parent} belongs to another run: "
                f"{' and '.join(changed)} changed. Run again without --resume to start afresh."
            )


def _read_arrays(content: bytes) -> dict[str, NDArray[Any]]:
    """Read all arrays of a file of numpy's; what else it may be, and damage, raise errors of many
    kinds."""
    whole = io.BytesIO(content)
    archive = ZipFile(whole)  # a single array is none
    archive.close()
    arrays = {}
    with np.load(io.BytesIO(content), allow_pickle=False) as file:
        for key in file.files:
            arrays[key] = file[key]
    return arrays


def _check_arrays(stored: Mapping[str, NDArray[Any]]) -> None:
    """Check that arrays are those of a chain (n, W, d), n > 0. Raises KeyError or ValueError."""
    identity = json.loads(str(stored["identity"]))
    steps, walkers, _ = stored["chain"].shape
    shapes = {
        "log_density": (steps, walkers),
        "accepted": (walkers,),
        "random_key": (RANDOM_KEY,),
        "random_rest": (3,),
    }
    fits = all(stored[key].shape == shape for key, shape in shapes.items())
    if not (fits and steps and isinstance(identity, dict)):
        raise ValueError("the arrays are not those of a chain")
