"""Output files: written beside their place, then renamed, so that nothing is ever half there."""
from __future__ import annotations

import os
import tempfile
from pathlib import Path

from ..words.errors import StudyError


def write_beside(path: Path, content: bytes) -> None:
    """Write a file whole or not at all. Raises StudyError with the reason."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            Path(name).chmod(0o644)
            Path(name).replace(path)
        except BaseException:
            Path(name).unlink(missing_ok=True)
            raise
    except OSError as error:
        raise StudyError(f"{path}: cannot be written: {error.strerror or error}. Give another folder with --out.") from None


def check_writable(folder: Path) -> None:
    """Refuse a folder that cannot be written before the work is done. Raises StudyError; leaves nothing behind."""
    nearest = folder
    while not nearest.exists() and nearest != nearest.parent:
        nearest = nearest.parent
    if not nearest.is_dir() or not os.access(nearest, os.W_OK):
        raise StudyError(f"{folder}: cannot be written. Give another folder with --out.")
