"""Unfinished chains on disk: beside the result in a hidden folder, whole or not at all, and only
for the run they belong to."""

from __future__ import annotations

import io
import json
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._files import HIDDEN, write_atomically
from ..exceptions import StudyError
from ..uncertainty.sampler import State

EVERY = 5.0  # seconds between two copies; what is written has no part in the result
WHAT = {
    "data_sha256": "the measurements",
    "study_sha256": "the study file",
    "modelsel": "modelsel's version",
    "numpy": "numpy's version",
    "names": "the parameters",
}


class Checkpoint:
    """DIR/.modelsel/sampling.npz. `resume`: take up what is there; else it is overwritten."""

    def __init__(self, folder: Path, resume: bool):
        self.path, self.resume = folder / HIDDEN / "sampling.npz", resume
        self.identity: dict[str, object] = {}
        self.last = time.monotonic()

    def bind(self, identity: Mapping[str, str]) -> None:
        """Say which data, study and versions the run has. Raises StudyError where the chain on disk
        has others."""
        self.identity = {key: identity[key] for key in WHAT if key in identity}
        if self.resume:
            self._compare(self._read(), self.identity)

    def load(self, names: Sequence[str]) -> State | None:
        """The chain that was kept. Raises StudyError where it is over other parameters."""
        held = self._read() if self.resume else None
        if held is None:
            return None
        self._compare(held, {**self.identity, "names": list(names)})
        position, has_gauss, gauss = (float(number) for number in held["random_rest"])
        return State(
            held["chain"],
            held["log_density"],
            held["accepted"],
            ("MT19937", held["random_key"], int(position), int(has_gauss), gauss),
        )

    def keep(self, names: Sequence[str], state: State, *, now: bool = False) -> None:
        """Write the chain, unless it was written moments ago."""
        if not now and time.monotonic() - self.last < EVERY:
            return
        out = io.BytesIO()
        _, key, position, has_gauss, gauss = state.random
        np.savez(
            out,
            identity=np.array(json.dumps({**self.identity, "names": list(names)})),
            chain=state.chain,
            log_density=state.log_density,
            accepted=state.accepted,
            random_key=key,
            random_rest=np.array([position, has_gauss, gauss], float),
        )
        write_atomically(self.path, out.getvalue())
        self.last = time.monotonic()

    def clear(self) -> None:
        """The run is done: nothing is left behind."""
        self.path.unlink(missing_ok=True)
        if self.path.parent.is_dir() and not any(self.path.parent.iterdir()):
            self.path.parent.rmdir()

    def _read(self) -> dict[str, NDArray[Any]] | None:
        try:
            with np.load(self.path, allow_pickle=False) as file:
                return {key: file[key] for key in file.files}
        except FileNotFoundError:
            return None
        except (OSError, ValueError, EOFError, KeyError):
            raise StudyError(
                f"{self.path}: not a chain that can be resumed; run again without --resume."
            ) from None

    def _compare(
        self, held: Mapping[str, NDArray[Any]] | None, expected: Mapping[str, object]
    ) -> None:
        if held is None:
            return
        found = json.loads(str(held["identity"]))
        other = [WHAT[key] for key in expected if found.get(key) != expected[key]]
        if other:
            raise StudyError(
                f"--resume: the unfinished chain in {self.path.parent} belongs to another run: "
                f"{' and '.join(other)} changed. Run again without --resume to start afresh."
            )
