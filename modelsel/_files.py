"""Atomic output: write to a temporary file in the target folder, then rename; one run at a time in
a folder."""

from __future__ import annotations

import os
import secrets
import stat
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from ._names import guard_cell
from ._text import find_read_problem
from .exceptions import StudyError

if TYPE_CHECKING:
    import pandas as pd

PARQUET_SUFFIXES = (".parquet", ".pq")
STUDY_FILE = "study.toml"  # of a study's own folder
# in an output folder while a run works there: its lock, files not yet in place, an unfinished chain
HIDDEN = ".modelsel"
LOCK = "lock"
UNFINISHED = ".modelsel-part-"  # begins the name of a file that is not yet in place
NEW = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
NO_LINK = getattr(os, "O_NOFOLLOW", 0)


def write_atomically(path: Path, content: bytes) -> None:
    """Write a file whole or not at all. Raises StudyError with the reason."""
    files = {path: content}
    _write(files, path.parent)


def write_all(folder: Path, files: Mapping[str, bytes], outdated: Iterable[str] = ()) -> None:
    """Write files of a folder, whole or not at all: all of them are on the disk before the first
    takes its place, in the order given. Files that they leave `outdated` are removed just before
    that: an old one never stands beside a new one. Raises StudyError with the reason."""
    old = [folder / name for name in outdated]
    try:
        _write({folder / name: content for name, content in files.items()}, folder / HIDDEN, old)
    finally:
        with suppress(OSError):
            (folder / HIDDEN).rmdir()


def _write(files: Mapping[Path, bytes], beside: Path, outdated: Iterable[Path] = ()) -> None:
    ready: dict[Path, Path] = {}
    path = beside
    try:
        for path in files:
            _refuse_other_than_file(path)
        try:
            _folder(beside)
            for path, content in files.items():
                temporary = beside / f"{UNFINISHED}{secrets.token_hex(4)}-{path.name}"
                handle = os.open(
                    temporary, NEW, 0o666
                )  # less what the umask takes away, as any file of this user
                ready[path] = temporary
                with os.fdopen(handle, "wb") as file:
                    file.write(content)
                    file.flush()
                    os.fsync(file.fileno())
            for path in outdated:
                path.unlink(missing_ok=True)
            for path, temporary in ready.items():
                temporary.replace(path)
        finally:
            for temporary in ready.values():
                temporary.unlink(missing_ok=True)
    except OSError as error:
        raise StudyError(
            f"{path}: cannot be written: {error.strerror or error}. Give another folder."
        ) from None


def _refuse_other_than_file(path: Path) -> None:
    """Refuse a folder, a device or a pipe, which a file must not take the place of. Raises
    StudyError."""
    if not path.exists():
        return
    problem = find_read_problem(path)
    if problem is not None:
        raise StudyError(f"{path}: cannot be written: {problem}. Give another file.")


def _folder(path: Path) -> None:
    """Make a folder where it is not there. Raises OSError; for the hidden one also where it is a
    link: what it leads to is not this program's to write or to clear."""
    is_hidden = path.name == HIDDEN
    if is_hidden and path.is_symlink():
        raise OSError(f"{HIDDEN} is a link to another folder; remove the link")
    path.mkdir(parents=True, exist_ok=True)


def csv_bytes(frame: pd.DataFrame, digits: str | None) -> bytes:
    """Write a table as CSV, its numbers as `digits` says ("%.10g"), None for as many as tell each
    from its neighbours; text that a spreadsheet would run as a formula is guarded."""
    safe = frame.copy()
    for k, dtype in enumerate(frame.dtypes):
        if dtype.kind not in "fiub":
            column = safe.iloc[:, k]
            guarded = [guard_cell(cell) if isinstance(cell, str) else cell for cell in column]
            safe.isetitem(k, guarded)
    text: str = safe.to_csv(index=False, float_format=digits, lineterminator="\n")
    return text.encode()


def write_frame(frame: pd.DataFrame, path: Path, digits: str) -> None:
    """Write a table as Parquet where the path says so, else as CSV. Raises StudyError."""
    if path.suffix.lower() in PARQUET_SUFFIXES:
        write_atomically(path, frame.to_parquet(index=False))
    else:
        write_atomically(path, csv_bytes(frame, digits))


def check_writable(folder: Path) -> None:
    """Refuse a folder that cannot be written before the work is done. Raises StudyError; leaves
    nothing behind."""
    is_link = folder.is_symlink()
    if is_link and not folder.exists():
        raise StudyError(
            f"{folder}: a link to a folder that is not there. Make that folder, or give another."
        )
    for nearest in (folder, *folder.parents):
        if nearest.exists():
            break
    is_writable = nearest.is_dir() and os.access(nearest, os.W_OK)
    if not is_writable:
        raise StudyError(f"{folder}: cannot be written. Give another folder.")


@contextmanager
def claim_folder(folder: Path) -> Iterator[None]:
    """Claim the output folder for this process alone, and make it where it is not there; what a
    killed run left unfinished is removed, and so are folders that stay empty. Raises StudyError
    where another run works in it."""
    made = [place for place in (folder, *folder.parents) if not place.exists()]
    hidden = folder / HIDDEN
    handle = None
    try:
        try:
            _folder(hidden)
            handle = _locked(hidden / LOCK)
        except BlockingIOError:
            raise StudyError(
                f"{folder}: another run of modelsel is already working in this folder. Wait for it, or give another folder."
            ) from None
        except OSError as error:
            raise StudyError(
                f"{folder}: cannot be written: {error.strerror or error}. Give another folder."
            ) from None
        _clear(hidden)
        yield
    finally:
        if handle is not None:
            with suppress(
                OSError
            ):  # removed while it is held: who waits for it sees that it is another file
                (hidden / LOCK).unlink()
            os.close(handle)
        for place in (hidden, *made):
            with suppress(OSError):
                place.rmdir()


def _clear(hidden: Path) -> None:
    """Remove what a killed run left unfinished: files of this program's own naming, nothing
    else."""
    for left in hidden.glob(f"{UNFINISHED}*"):
        mode = left.lstat().st_mode
        if stat.S_ISREG(mode):
            left.unlink(missing_ok=True)


def _locked(path: Path) -> int:
    """Open a file that this process alone has locked, until it ends however it ends. Raises
    BlockingIOError."""
    while True:
        handle = os.open(path, os.O_RDWR | os.O_CREAT | NO_LINK, 0o666)
        try:
            import fcntl

            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if path.exists() and os.fstat(handle).st_ino == path.stat().st_ino:
                return handle
        except ImportError:  # Windows: no lock
            return handle
        except OSError as error:
            os.close(handle)
            raise BlockingIOError from error
        os.close(handle)
