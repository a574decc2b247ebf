"""Progress of long work: what is being done, how much of it is done, how long it will take.

Work is given a function `say` and calls it with text. A plain string begins a stage; `News` tells
of the stage that has begun. `Progress` is such a function. It shows a line that is rewritten on a
terminal and in a notebook; in a log a line per stage, and of one that lasts a line per quarter. A remaining time is only told where the
amount of work is known: else it is the number of the step among those of the whole.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from typing import Any, Protocol, TextIO

from ._arguments import check_function, check_type
from ._typing import Say
from .exceptions import write_percent

# seconds of work seen before the rest is extrapolated
MIN_SEEN_S = 1.0
# seconds without a line after which a log has one about a stage that goes on
MIN_QUIET_S = 10.0
QUARTERS = 4
CLEAR_LINE = "\r\x1b[K"
USUAL_WIDTH = 80


class News(str):
    """A line about the stage that has begun.

    done: share of the stage that is done, 0 to 1; None where it is not known.
    kept: whether the line stays, as a result does; others are overwritten by the next.
    """

    __slots__ = ("done", "kept")
    done: float | None
    kept: bool

    def __new__(cls, text: str, done: float | None = None, *, kept: bool = False) -> News:
        """Make a line; to those who expect text it is text."""
        line = super().__new__(cls, text)
        line.done = done
        line.kept = kept
        return line


class Screen(Protocol):
    """Where progress is shown."""

    def begin(self, line: str) -> None:
        """Tell that a stage begins."""

    def keep(self, line: str) -> None:
        """Show a line that stays."""

    def rewrite(self, line: str) -> None:
        """Show a line in place of the one before."""

    def mark(self, line: str) -> None:
        """Write how far a long stage is, where no line is rewritten."""

    def clear(self) -> None:
        """Take the rewritten line away."""


class Progress:
    """Shows what it is told: `progress("fitting"); progress(News("3 of 5 folds", 0.6))`.

    steps: how the stages of the whole begin, in order; a stage is counted by them.
    """

    def __init__(
        self,
        steps: Sequence[str] = (),
        screen: Screen | None = None,
        clock: Callable[[], float] = time.perf_counter,
    ):
        self.steps = steps
        self.screen = choose_screen() if screen is None else screen
        self.clock = clock
        self.start = clock()
        self.stage = ""
        self.phase = ""  # the last news that does not stay
        self.count = ""
        self.seen: tuple[float, float] | None = None  # time and share of the first news
        self.marked = 0.0  # time of the last line that stays
        self.quarter = -1  # of the stage, of which the last line was that told how far it is

    def __call__(self, line: str) -> None:
        """Show a line: the next stage, or news of this one."""
        now = self.clock() - self.start
        if isinstance(line, News):
            self._tell(line, now)
            return
        self.stage = line
        self.phase = ""
        self.seen = None
        self.marked = now
        self.quarter = -1
        count = len(self.steps)
        for number, step in enumerate(self.steps, 1):
            if line.startswith(step):
                self.count = f"step {number} of {count}"
        self.screen.begin(f"{now:6.1f} s  {line}")
        self._show(now)

    def clear(self) -> None:
        """Take the line away: others want to write."""
        self.screen.clear()

    def _tell(self, news: News, now: float) -> None:
        if news.kept:
            self.screen.keep(f"{now:6.1f} s  {news}")
            self.marked = now
        else:
            self.phase = str(news)
        left, seconds = "", None
        if news.done is not None:
            left = write_percent(news.done)
            seconds = self._extrapolate(news.done, now)
            if seconds is not None:
                remaining = format_seconds(seconds)
                left += f", {remaining} left"
        self._show(now, self.phase, left)
        # one share alone tells no pace
        if not news.kept and (news.done is None or seconds is not None):
            self._mark(now, news.done or 0.0, left)

    def _mark(self, now: float, done: float, left: str) -> None:
        """Leave a line at each quarter of a stage, unless the last line is recent."""
        quarter = int(QUARTERS * done)
        quiet = now - self.marked
        if quarter <= self.quarter or quiet < MIN_QUIET_S:
            return
        line = self._write_line(now, self.phase, left)
        self.screen.mark(line)
        self.marked = now
        self.quarter = quarter

    def _extrapolate(self, done: float, now: float) -> float | None:
        """Return the seconds that the rest of the stage takes at the pace seen so far."""
        if self.seen is None:
            self.seen = now, done
        before, share = self.seen
        if now - before < MIN_SEEN_S or not share < done < 1:
            return None
        return (now - before) / (done - share) * (1 - done)

    def _show(self, now: float, *news: str) -> None:
        line = self._write_line(now, *news)
        self.screen.rewrite(line)

    def _write_line(self, now: float, *news: str) -> str:
        parts = [self.stage, *(part for part in news if part)]
        step = f" ({self.count})" if self.count else ""
        return f"{now:6.1f} s  {', '.join(parts)}{step}"


def format_seconds(seconds: float) -> str:
    """Return a time that is known roughly, in words."""
    if seconds < 60:
        return f"about {max(seconds, 1):.0f} s"
    if seconds < 3600:
        return f"about {seconds / 60:.0f} min"
    return f"about {seconds / 3600:.1f} h"


@contextmanager
def show_progress(steps: Sequence[str] = (), hidden: bool = False) -> Iterator[Progress]:
    """Show progress until the work is done or fails, on whatever is there; nothing where hidden."""
    display = Progress(steps, HiddenScreen() if hidden else None)
    try:
        yield display
    finally:
        display.clear()


def follow(
    say: Say | None, progress: bool | None, steps: Sequence[str] = ()
) -> AbstractContextManager[Say | Progress]:
    """Return what work is to tell: a display where `progress` is wanted, else `say` if there is one.

    Where nothing is said of either (None), a terminal shows progress: somebody waits there.
    """
    check_function("say", say, "a function that takes a line of text")
    check_type("progress", progress, (bool, type(None)), "True or False")
    if progress is None:
        is_unheard = say is None and find_notebook() is None
        progress = is_unheard and is_terminal(sys.stderr)
    if progress:
        return show_progress(steps)
    listener: Say = keep_silent if say is None else say
    return nullcontext(listener)


def keep_silent(_: str) -> None:
    """Show nothing of what work tells."""


# -- where it is shown


def choose_screen(stream: TextIO | None = None) -> Screen:
    """Choose a notebook's display, a terminal's line that is rewritten, or the lines of a log."""
    shell = find_notebook()
    if shell is not None:
        return NotebookScreen()
    stream = sys.stderr if stream is None else stream
    return TerminalScreen(stream) if is_terminal(stream) else LogScreen(stream)


def is_terminal(stream: TextIO | None) -> bool:
    """Return whether a stream is a terminal that can rewrite a line."""
    return stream is not None and stream.isatty() and os.environ.get("TERM") != "dumb"


def find_notebook() -> Any:
    """Return the shell of the notebook in which this runs; None elsewhere. Imports nothing."""
    ipython = sys.modules.get("IPython")
    shell = None if ipython is None else ipython.get_ipython()
    return shell if hasattr(shell, "kernel") else None


class HiddenScreen:
    """Shows nothing."""

    def begin(self, line: str) -> None:
        """Show nothing."""

    def keep(self, line: str) -> None:
        """Show nothing."""

    def rewrite(self, line: str) -> None:
        """Show nothing."""

    def mark(self, line: str) -> None:
        """Show nothing."""

    def clear(self) -> None:
        """Leave nothing to take away."""


class LogScreen:
    """A line per stage, per quarter of a long one and per result, on a stream that cannot go back."""

    def __init__(self, stream: TextIO):
        self.stream = stream

    def begin(self, line: str) -> None:
        """Write the stage."""
        self.keep(line)

    def keep(self, line: str) -> None:
        """Write the line at once."""
        print(line, file=self.stream, flush=True)

    def rewrite(self, line: str) -> None:
        """Write nothing."""

    def mark(self, line: str) -> None:
        """Write the line at once."""
        self.keep(line)

    def clear(self) -> None:
        """Leave what is written."""


class TerminalScreen:
    """A terminal's last line, rewritten; what is kept stands above it."""

    def __init__(self, stream: TextIO):
        self.stream = stream

    def begin(self, line: str) -> None:
        """Leave it to `rewrite`."""

    def keep(self, line: str) -> None:
        """Write the line above the last one, which the next call writes anew."""
        self._write(f"{CLEAR_LINE}{line}\n")

    def mark(self, line: str) -> None:
        """Leave it to `rewrite`."""

    def rewrite(self, line: str) -> None:
        """Write the last line, as much of it as fits."""
        width = USUAL_WIDTH
        with suppress(OSError, ValueError):
            width = os.get_terminal_size(self.stream.fileno()).columns or USUAL_WIDTH
        shown = line if len(line) < width else line[: max(width - 2, 0)] + "…"
        self._write(f"{CLEAR_LINE}{shown}")

    def clear(self) -> None:
        """Empty the last line."""
        self._write(CLEAR_LINE)

    def _write(self, text: str) -> None:
        self.stream.write(text)
        self.stream.flush()


class NotebookScreen:
    """An output of a notebook's cell that is updated in place."""

    def __init__(self) -> None:
        self.kept: list[str] = []
        self.handle: Any = None

    def begin(self, line: str) -> None:
        """Leave it to `rewrite`."""

    def keep(self, line: str) -> None:
        """Keep the line above the last one."""
        self.kept.append(line)

    def mark(self, line: str) -> None:
        """Leave it to `rewrite`."""

    def rewrite(self, line: str) -> None:
        """Show what is kept, and the last line."""
        from IPython.display import display

        shown = {"text/plain": "\n".join([*self.kept, *([line] if line else [])])}
        if self.handle is None:
            self.handle = display(shown, raw=True, display_id=True)  # type: ignore[no-untyped-call]
        else:
            self.handle.update(shown, raw=True)

    def clear(self) -> None:
        """Leave what is kept."""
        if self.handle is not None:
            self.rewrite("")
