"""Progress: what a terminal, a log and a notebook show of the same work, by a clock of our own."""

from __future__ import annotations

import io
import subprocess
import sys
from types import ModuleType

import numpy as np
import pytest

from modelsel._progress import (
    CLEAR_LINE,
    LogScreen,
    News,
    NotebookScreen,
    Progress,
    TerminalScreen,
    choose_screen,
    follow,
    format_seconds,
    show_progress,
)


class Clock:
    """Seconds that pass when told to."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


class Terminal(io.StringIO):
    """What a terminal was sent."""

    def isatty(self) -> bool:
        return True

    def lines(self) -> list[str]:
        """What stood on the last line, one state after another, and the lines left above it."""
        return [line for line in self.getvalue().split(CLEAR_LINE) if line]


def work(progress: Progress, clock: Clock) -> None:
    """Two stages: a finding in the first, a known amount of work in the second."""
    progress("naming: 12 candidates")
    clock.now += 1.5
    progress(News("found backlash:3", kept=True))
    clock.now += 0.5
    progress("sampling")
    for seconds, news in (
        (1, News("600 steps")),
        (1, News("800 of 2,000 steps", 0.4)),
        (3, News("1,000 of 2,000 steps", 0.5)),
        (3, News("2,000 of 2,000 steps", 1.0)),
    ):
        clock.now += seconds
        progress(news)
    progress.clear()


def test_a_terminal_has_one_line_that_is_rewritten() -> None:
    clock, stream = Clock(), Terminal()
    work(Progress(["reading", "naming", "sampling"], TerminalScreen(stream), clock), clock)
    assert stream.lines() == [
        "   0.0 s  naming: 12 candidates (step 2 of 3)",
        "   1.5 s  found backlash:3\n",
        "   1.5 s  naming: 12 candidates (step 2 of 3)",
        "   2.0 s  sampling (step 3 of 3)",
        "   3.0 s  sampling, 600 steps (step 3 of 3)",
        # one share alone tells no pace
        "   4.0 s  sampling, 800 of 2,000 steps, 40 % (step 3 of 3)",
        # a tenth in three seconds: half in fifteen
        "   7.0 s  sampling, 1,000 of 2,000 steps, 50 %, about 15 s left (step 3 of 3)",
        "  10.0 s  sampling, 2,000 of 2,000 steps, 100 % (step 3 of 3)",
    ]
    assert stream.getvalue().endswith(CLEAR_LINE)
    assert stream.getvalue().count("\n") == 1


def test_what_is_being_done_stays_beside_a_result() -> None:
    clock, stream = Clock(), Terminal()
    progress = Progress((), TerminalScreen(stream), clock)
    progress("naming")
    progress(News("searching"))
    progress(News("found backlash:3", kept=True))
    progress("sampling")
    last = [line.split("  ")[-1] for line in stream.lines()]
    assert last == [
        "naming",
        "naming, searching",
        "found backlash:3\n",
        "naming, searching",
        "sampling",
    ]


def test_a_log_has_a_line_per_stage() -> None:
    clock, stream = Clock(), io.StringIO()
    work(Progress((), LogScreen(stream), clock), clock)
    assert stream.getvalue().splitlines() == [
        "   0.0 s  naming: 12 candidates",
        "   1.5 s  found backlash:3",
        "   2.0 s  sampling",
    ]


def test_a_log_tells_how_far_a_long_stage_is_at_each_quarter() -> None:
    """First that it goes on, then with the time that is left; no line while the last one is recent."""
    clock, stream = Clock(), io.StringIO()
    progress = Progress(["naming", "sampling"], LogScreen(stream), clock)
    progress("sampling")
    for share in (None, None, *np.arange(4, 21) / 20):
        clock.now += 8
        words = "500 steps" if share is None else f"{share:.2f} of it"
        progress(News(words, None if share is None else float(share)))
    assert stream.getvalue().splitlines() == [
        "   0.0 s  sampling",
        "  16.0 s  sampling, 500 steps (step 2 of 2)",
        "  32.0 s  sampling, 0.25 of it, 25 %, about 2 min left (step 2 of 2)",
        "  72.0 s  sampling, 0.50 of it, 50 %, about 1 min left (step 2 of 2)",
        " 112.0 s  sampling, 0.75 of it, 75 %, about 40 s left (step 2 of 2)",
    ]


def test_a_notebook_has_one_output_that_is_rewritten(monkeypatch) -> None:
    shown: list[str] = []

    class Handle:
        def update(self, bundle, raw) -> None:
            shown.append(bundle["text/plain"])

    def display(bundle, raw, display_id) -> Handle:
        assert not shown
        handle = Handle()
        handle.update(bundle, raw)
        return handle

    for name in ("IPython", "IPython.display"):
        monkeypatch.setitem(sys.modules, name, ModuleType(name))
    shell = type("Shell", (), {"kernel": None})()
    monkeypatch.setattr(sys.modules["IPython"], "get_ipython", lambda: shell, raising=False)
    monkeypatch.setattr(sys.modules["IPython.display"], "display", display, raising=False)
    clock = Clock()
    screen = choose_screen()
    assert isinstance(screen, NotebookScreen)
    work(Progress((), screen, clock), clock)
    assert shown[0] == "   0.0 s  naming: 12 candidates"
    assert (
        shown[-2] == "   1.5 s  found backlash:3\n  10.0 s  sampling, 2,000 of 2,000 steps, 100 %"
    )
    assert shown[-1] == "   1.5 s  found backlash:3"


def test_ipython_on_a_terminal_is_a_terminal(monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "IPython", ModuleType("IPython"))
    monkeypatch.setattr(sys.modules["IPython"], "get_ipython", object, raising=False)
    monkeypatch.delenv("TERM", raising=False)
    assert isinstance(choose_screen(Terminal()), TerminalScreen)
    assert isinstance(choose_screen(io.StringIO()), LogScreen)
    monkeypatch.setenv("TERM", "dumb")
    assert isinstance(choose_screen(Terminal()), LogScreen)


def test_nothing_heavy_is_imported() -> None:
    code = (
        "import sys; from modelsel._progress import Progress; Progress()('reading');"
        "print({'IPython', 'rich', 'click', 'pandas', 'scipy'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True, text=True)
    assert done.stdout == "set()\n"
    assert done.stderr == "   0.0 s  reading\n"


def test_work_taken_up_counts_from_where_it_was() -> None:
    """Half was done in an earlier run, so that the pace is that of this one."""
    clock, stream = Clock(), Terminal()
    progress = Progress((), TerminalScreen(stream), clock)
    progress("sampling")
    for done in (0.5, 0.6):
        progress(News("", done))
        clock.now += 2
    assert stream.lines()[-1] == "   2.0 s  sampling, 60 %, about 8 s left"


def test_a_long_line_is_cut(monkeypatch) -> None:
    stream = Terminal()
    Progress((), TerminalScreen(stream))("x" * 200)
    (line,) = stream.lines()
    assert len(line) == 79
    assert line.endswith("x…")


def test_news_is_text_to_a_listener_of_ones_own() -> None:
    said: list[str] = []
    with follow(said.append, progress=False) as say:
        say(News("3 of 5 folds", 0.6))
    assert said == ["3 of 5 folds"]


@pytest.mark.parametrize(
    ("terminal", "given", "shows"), [(True, None, True), (True, print, False), (False, None, False)]
)
def test_a_terminal_shows_progress_unless_told_otherwise(
    monkeypatch, terminal, given, shows
) -> None:
    """Somebody waits at a terminal; a log, or a listener of one's own, is left alone."""
    stream = Terminal() if terminal else io.StringIO()
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setenv("TERM", "xterm")
    for progress in (None, False):
        with follow(given, progress) as say:
            say("reading")
        assert ("reading" in stream.getvalue()) == (shows and progress is None)
        stream.seek(0)
        stream.truncate()


def test_hidden_progress_shows_nothing(monkeypatch) -> None:
    stream = Terminal()
    monkeypatch.setattr(sys, "stderr", stream)
    with show_progress(hidden=True) as say:
        say("reading")
        say(News("3 of 5 folds", 0.6, kept=True))
    assert stream.getvalue() == ""


def _fail() -> None:
    with follow(print, progress=True) as say:
        say("reading")
        raise KeyError


def test_a_display_of_ones_own_is_cleared_when_work_fails(monkeypatch) -> None:
    stream = Terminal()
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setenv("TERM", "xterm")
    with pytest.raises(KeyError):
        _fail()
    assert stream.getvalue() == f"{CLEAR_LINE}   0.0 s  reading{CLEAR_LINE}"


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(0.2, "about 1 s"), (59, "about 59 s"), (150, "about 2 min"), (5400, "about 1.5 h")],
)
def test_times_in_words(seconds, words) -> None:
    assert format_seconds(seconds) == words
