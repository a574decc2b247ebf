"""Text files that people write: read as UTF-8, with or without a byte-order mark; what cannot be
read is said."""

from __future__ import annotations

import re
import stat
import tomllib
from pathlib import Path
from typing import Any

from .exceptions import StudyError

MAX_FILE_BYTES = 50_000_000  # bytes; nobody writes more by hand
DEEP_KEY = re.compile(
    r"(?<![\w\"'.-])(?:[\w\"'-]++\s*+\.\s*+){60}"
)  # a key of so many parts: tomllib would take minutes

# what tomllib says of names that stand twice, and our words for it
TOML_WORDS = (
    (re.compile(r"Cannot overwrite a value|Duplicate inline table key '.*'"), "a key stands twice"),
    (re.compile(r"Cannot declare \(.*\) twice"), "a table stands twice"),
    (re.compile(r"Cannot mutate immutable namespace \(.*\)(?= \()"), "a key stands twice"),
)


def find_read_problem(path: Path) -> str | None:
    """Say in a few words why a path cannot be read as a file; None where it can. A device or a pipe
    may never end."""
    try:
        mode = path.stat().st_mode
    except (FileNotFoundError, NotADirectoryError):
        return "no such file"
    except (OSError, ValueError) as error:
        return (getattr(error, "strerror", None) or "no such file").lower()
    return (
        None
        if stat.S_ISREG(mode)
        else "it is a folder"
        if stat.S_ISDIR(mode)
        else "it is a device or a pipe, not a file"
    )


def read_text(path: Path, what: str, as_it_is: bool = False) -> str:
    """Read a file's text; `what` it is, for the message. Lines end in \\n, or `as_it_is` as in the
    file. Raises StudyError."""
    why = find_read_problem(path)
    if why is None:
        try:
            if path.stat().st_size > MAX_FILE_BYTES:
                raise StudyError(
                    f"{path.name}: {what} has more than {MAX_FILE_BYTES // 1_000_000} MB: another file? Check its name."
                )
            text = path.read_bytes().decode("utf-8-sig")
            return text if as_it_is else text.replace("\r\n", "\n")
        except UnicodeDecodeError:
            why = "it is not UTF-8 text"
        except OSError as error:
            why = str(error.strerror or error).lower()
    if why == "no such file":
        raise StudyError(
            f"{path}: there is no such {what.removeprefix('the ')}. Check its name and folder."
        )
    raise StudyError(
        f"{path.name}: {what} cannot be read: {why}. Check its name, or save it as UTF-8."
    )


def parse_toml(text: str, where: str) -> dict[str, Any]:
    """Parse a TOML file's table. Raises StudyError with line and column of what is wrong."""
    try:
        if DEEP_KEY.search(text):
            raise RecursionError
        return tomllib.loads(text)
    except RecursionError:
        raise StudyError(
            f"{where}: not valid TOML: nested too deeply. Tables of tables of a few levels are expected."
        ) from None
    except ValueError as error:  # TOMLDecodeError; a whole number of thousands of digits
        said = "a number with too many digits"
        if isinstance(error, tomllib.TOMLDecodeError):
            said = _reword_toml_error(str(error))
        raise StudyError(f"{where}: not valid TOML: {said}. Correct this place.") from None


def _reword_toml_error(message: str) -> str:
    """Say in plain words what tomllib says of a name that stands twice; anything else as it is."""
    for theirs, ours in TOML_WORDS:
        message = theirs.sub(ours, message)
    return message
