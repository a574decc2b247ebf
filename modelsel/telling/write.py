"""Output files: written beside their place, then renamed, so that nothing is ever half there; one run at a time in a folder."""
from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from ..words.errors import StudyError

HIDDEN = ".modelsel"      # in an output folder while a run works there: its lock, files not yet in place, an unfinished chain
LOCK = "lock"


def write_beside(path: Path, content: bytes) -> None:
    """Write a file whole or not at all. Raises StudyError with the reason."""
    _write({path: content}, path.parent)


def write_all(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write files of a folder, whole or not at all: all of them are on the disk before the first takes its place, in the order
    given. Raises StudyError with the reason."""
    try:
        _write({folder / name: content for name, content in files.items()}, folder / HIDDEN)
    finally:
        with suppress(OSError):
            (folder / HIDDEN).rmdir()


def _write(files: Mapping[Path, bytes], beside: Path) -> None:
    ready: dict[Path, Path] = {}
    path = beside
    try:
        try:
            beside.mkdir(parents=True, exist_ok=True)
            for path, content in files.items():
                handle, name = tempfile.mkstemp(dir=beside, prefix=f".{path.name}.")
                ready[path] = Path(name)
                with os.fdopen(handle, "wb") as file:
                    file.write(content)
                    file.flush()
                    os.fsync(file.fileno())
                ready[path].chmod(0o644)
            for path, temporary in ready.items():
                temporary.replace(path)
        finally:
            for temporary in ready.values():
                temporary.unlink(missing_ok=True)
    except OSError as error:
        raise StudyError(f"{path}: cannot be written: {error.strerror or error}. Give another folder with --out.") from None


def check_writable(folder: Path) -> None:
    """Refuse a folder that cannot be written before the work is done. Raises StudyError; leaves nothing behind."""
    nearest = folder
    while not nearest.exists() and nearest != nearest.parent:
        nearest = nearest.parent
    if not nearest.is_dir() or not os.access(nearest, os.W_OK):
        raise StudyError(f"{folder}: cannot be written. Give another folder with --out.")


@contextmanager
def claimed(folder: Path) -> Iterator[None]:
    """The output folder for this process alone, made where it is not there; what a killed run left unfinished is removed, and
    folders that stay empty are too. Raises StudyError where another run works in it."""
    made = [place for place in (folder, *folder.parents) if not place.exists()]
    hidden = folder / HIDDEN
    handle = None
    try:
        try:
            hidden.mkdir(parents=True, exist_ok=True)
            handle = _locked(hidden / LOCK)
        except BlockingIOError:
            raise StudyError(f"{folder}: another run of modelsel works in this folder. Wait for it, or give another folder with "
                             "--out.") from None
        except OSError as error:
            raise StudyError(f"{folder}: cannot be written: {error.strerror or error}. Give another folder with --out.") from None
        for left in hidden.glob(".*"):
            left.unlink(missing_ok=True)
        yield
    finally:
        if handle is not None:
            with suppress(OSError):           # removed while it is held: who waits for it sees that it is another file
                (hidden / LOCK).unlink()
            os.close(handle)
        for place in (hidden, *made):
            with suppress(OSError):
                place.rmdir()


def _locked(path: Path) -> int:
    """An open file that this process alone has locked, until it ends however it ends. Raises BlockingIOError."""
    while True:
        handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            import fcntl
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if path.exists() and os.fstat(handle).st_ino == path.stat().st_ino:
                return handle
        except ImportError:                   # Windows: no lock
            return handle
        except OSError as error:
            os.close(handle)
            raise BlockingIOError from error
        os.close(handle)
