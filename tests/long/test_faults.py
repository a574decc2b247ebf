"""What may go wrong around a study: killed, interrupted, no room, no right, no file, no terminal,
two at once, no network."""

from __future__ import annotations

import json
import os
import resource
import shutil
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner
from fuzz_base import base_files
from fuzz_clean import WRITTEN
from fuzz_judge import guarded

from modelsel._files import claim_folder, write_all, write_atomically
from modelsel.cli.main import run_command_line
from modelsel.exceptions import StudyError

HERE = Path(__file__).parents[1] / "support"
COMMAND = [
    sys.executable,
    "-c",
    "from modelsel.cli.main import run_command_line; run_command_line(prog_name='modelsel')",
]
pytestmark = pytest.mark.skipif(os.name == "nt", reason="signals and limits of Unix")


@pytest.fixture
def study(tmp_path: Path) -> Path:
    for name, content in base_files().items():
        (tmp_path / name).write_bytes(content)
    return tmp_path / "study.toml"


def words(study: Path, out: Path, *more: str) -> list[str]:
    return ["study", str(study), "--out", str(out), "--no-report", "--no-sampling", *more]


def invoked(*arguments: str) -> tuple[int, str]:
    ran = CliRunner().invoke(run_command_line, list(arguments))
    return ran.exit_code, ran.output


def everything(folder: Path) -> set[str]:
    return {str(p.relative_to(folder)) for p in folder.rglob("*")}


# -- killed, interrupted
# ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("kills", "more"), [(60, []), (4, ["sampling"])], ids=["study", "chain"])
def test_killed_at_any_step(kills, more, tmp_path) -> None:
    """SIGKILL at every step on the disk (drawn ones of a chain): every file left is whole, old or
    new; files of two runs are never read as one; run again, the bytes are those of an unbroken
    run."""
    seed = os.environ.get("MODELSEL_SEED", "7")
    ran = subprocess.run(
        [sys.executable, str(HERE / "fault_host.py"), str(tmp_path), str(kills), seed, *more],
        capture_output=True,
        text=True,
        check=False,
        timeout=600,
    )
    assert not ran.returncode, ran.stderr
    found = json.loads(ran.stdout)
    said = f"MODELSEL_SEED={seed}: {found}"
    assert found["killed"] == min(kills, found["steps"]), said
    assert not found.get("not killed"), said
    assert not found["broken"], said
    assert not found["taken for one run"], said
    assert found["resumed"] == found["resumed to the same bytes"] > 0, said
    if not more:
        assert found["left old"] > 0 < found["left new"], said


@pytest.mark.parametrize("by", [signal.SIGINT, signal.SIGTERM], ids=["SIGINT", "SIGTERM"])
def test_interrupted(by, study, tmp_path) -> None:
    """130, with the command that goes on, and nothing left."""
    code = (
        "import signal, sys, time, modelsel.study.pipeline.runner as s\n"
        # a shell's background job begins deaf to it
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "s.analyse = lambda *a, **k: (print('there', flush=True), time.sleep(60))\n"
        "from modelsel.cli.main import run_command_line; run_command_line(prog_name='modelsel')"
    )
    ran = subprocess.Popen(
        [sys.executable, "-c", code, *words(study, tmp_path / "out")],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert ran.stdout is not None
    assert ran.stdout.readline() == "there\n"
    ran.send_signal(by)
    _, said = ran.communicate(timeout=60)
    assert ran.returncode == 130
    assert f"to go on: modelsel {' '.join(words(study, tmp_path / 'out'))} --resume" in said
    assert "Traceback" not in said
    assert not (tmp_path / "out").exists()


# -- no room, no right, no file
# ---------------------------------------------------------------------------------------


def test_no_room(study, tmp_path, monkeypatch) -> None:
    """A full disk: a message, the older result untouched, the new one at least told, nothing
    half-written."""
    assert invoked(*words(study, tmp_path / "out"))[0] == 0
    before = {p: p.read_bytes() for p in (tmp_path / "out").iterdir()}
    study.write_text(study.read_text().replace("seed = 3", "seed = 4"))

    def full(handle: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    status, said = invoked(*words(study, tmp_path / "out"))
    assert status == 2
    assert "cannot be written: No space left on device. Give another folder." in said
    assert "On held-out configurations" in said
    assert {p: p.read_bytes() for p in (tmp_path / "out").iterdir()} == before


def test_no_room_at_all(study, tmp_path) -> None:
    """Files that may not grow beyond 4 kB, set by the system."""

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))

    ran = subprocess.run(
        [*COMMAND, *words(study, tmp_path / "out")],
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=limit,
    )
    assert ran.returncode == 2
    assert "cannot be written: File too large" in ran.stderr
    assert "Traceback" not in ran.stderr
    assert not (tmp_path / "out").exists()


def test_no_right(study) -> None:
    """A folder where nobody may write, root neither."""
    status, said = invoked(*words(study, Path("/proc/modelsel/out")))
    assert status == 2
    assert "/proc/modelsel/out" in said
    assert "cannot be written" in said


def test_out_is_a_file(study, tmp_path) -> None:
    (tmp_path / "out").write_text("mine")
    assert invoked(*words(study, tmp_path / "out"))[0] == 2
    assert invoked(*words(study, tmp_path / "out" / "below"))[0] == 2
    assert (tmp_path / "out").read_text() == "mine"


@pytest.mark.parametrize("what", ["gone", "changed"])
def test_the_file_does_not_stay(what, study, tmp_path, monkeypatch) -> None:
    """The measurements vanish, or are written to, while they are read."""
    from modelsel.study.inputs import inputs as module

    read = module.read_measurements

    def meddled(path: Path, *rest: object, **named: object) -> object:
        found = read(path, *rest, **named)  # type: ignore[arg-type]
        path.unlink() if what == "gone" else path.write_text(path.read_text() + "\n")
        return found

    monkeypatch.setattr(module, "read_measurements", meddled)
    status, said = invoked(*words(study, tmp_path / "out"))
    assert status == 3
    assert ("cannot be read any more" if what == "gone" else "changed while it was read") in said
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("target", ["/dev/zero", "pipe", ".", "loop"])
def test_no_file_to_read(target, study, tmp_path) -> None:
    """A device without end, a pipe nobody writes to, a folder, a link to itself."""
    (tmp_path / "loop").symlink_to("loop")
    os.mkfifo(tmp_path / "pipe")
    study.write_text(study.read_text().replace("measurements.csv", target))
    status, said = invoked(*words(study, tmp_path / "out"))
    assert (status, "Traceback" in said) == (3, False)
    assert (
        invoked("study", str(tmp_path / target), "--out", str(tmp_path / "out"))[0] == 2
        or target == "."
    )
    study.write_text(
        study.read_text().replace("robot.toml", target).replace(target, "measurements.csv", 1)
    )
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_no_terminal(study, tmp_path) -> None:
    """Every stream closed, and an output nobody reads: the files are written."""
    for k, ending in enumerate(("<&- >&- 2>&-", "| true")):
        out = tmp_path / f"out{k}"
        subprocess.run(
            ["bash", "-c", f'"$@" {ending}', "-", *COMMAND, *words(study, out)],
            check=False,
            timeout=60,
        )
        assert {p.name for p in out.iterdir()} == WRITTEN


# -- two at once
# ------------------------------------------------------------------------------------------------------


def test_two_at_once(study, tmp_path) -> None:
    out = tmp_path / "out"
    with claim_folder(out):
        status, said = invoked(*words(study, out))
        assert status == 2
        assert "another run of modelsel is already working in this folder" in said
        assert everything(out) == {".modelsel", ".modelsel/lock"}
    assert not out.exists()
    assert invoked(*words(study, out))[0] == 0


def test_a_claim_ends_with_its_process(tmp_path) -> None:
    """What a killed run leaves unfinished is removed by the next; its chain is not."""
    code = (
        "import os, sys, pathlib\nfrom modelsel._files import claim_folder\n"
        "with claim_folder(pathlib.Path(sys.argv[1])): os._exit(9)"
    )
    assert (
        subprocess.run([sys.executable, "-c", code, str(tmp_path / "out")], check=False).returncode
        == 9
    )
    hidden = tmp_path / "out" / ".modelsel"
    (hidden / ".modelsel-part-0a1b2c3d-result.json").write_text("{")
    (hidden / "sampling.npz").write_text("chain")
    (hidden / ".mine").write_text("somebody else's")
    with claim_folder(tmp_path / "out"):
        assert everything(hidden) == {"lock", "sampling.npz", ".mine"}
    assert everything(tmp_path / "out") == {
        ".modelsel",
        ".modelsel/sampling.npz",
        ".modelsel/.mine",
    }


def test_a_linked_hidden_folder_is_left_alone(study, tmp_path) -> None:
    """The output folder's hidden folder leads elsewhere: nothing there is removed, written or
    opened, and the link is said."""
    home, out = tmp_path / "home", tmp_path / "out"
    home.mkdir()
    out.mkdir()
    for name in (".bashrc", ".modelsel-part-0a1b2c3d-x", "notes"):
        (home / name).write_text("mine")
    (out / ".modelsel").symlink_to(home)
    status, said = invoked(*words(study, out))
    assert status == 2
    assert "link to another folder" in said
    with pytest.raises(StudyError, match="link to another folder"):
        write_all(out, {"a": b"new"})
    assert everything(home) == {".bashrc", ".modelsel-part-0a1b2c3d-x", "notes"}
    assert everything(out) == {".modelsel"}
    (out / ".modelsel").unlink()
    (out / ".modelsel").mkdir()
    (out / ".modelsel" / "lock").symlink_to(home / "notes")
    assert invoked(*words(study, out))[0] == 2
    assert (home / "notes").read_text() == "mine"


@pytest.mark.parametrize("mask", [0o077, 0o027, 0o022, 0o002])
def test_the_umask_holds(mask, tmp_path) -> None:
    """Files are readable to whom this user's other files are; no more, no less."""
    before = os.umask(mask)
    try:
        write_all(tmp_path / "run", {"a": b"new"})
        write_atomically(tmp_path / "b", b"new")
        with claim_folder(tmp_path / "held"):
            modes = [
                (tmp_path / name).stat().st_mode & 0o777
                for name in ("run/a", "b", "held/.modelsel/lock")
            ]
    finally:
        os.umask(before)
    assert modes == [0o666 & ~mask] * 3


def test_files_of_a_run_come_together(tmp_path) -> None:
    """The second cannot be written: the first is not replaced."""
    write_all(tmp_path, {"a": b"old", "b": b"old"})
    with pytest.raises(StudyError, match="cannot be written"):
        write_all(tmp_path, {"a": b"new", "b" * 300: b"new"})
    assert (tmp_path / "a").read_bytes() == b"old"
    assert everything(tmp_path) == {"a", "b"}


# -- no network
# -------------------------------------------------------------------------------------------------------


def test_no_network(study, tmp_path) -> None:
    """A whole study with its report where a socket breaks the run, in a namespace without a network
    where there are such."""
    code = (
        "import socket\n"
        "def broken(*a, **k): raise RuntimeError('a socket was opened')\n"
        "socket.socket.__init__ = broken\n"
        "from modelsel.cli.main import run_command_line; run_command_line(prog_name='modelsel')"
    )
    words_ = ["study", str(study), "--out", str(tmp_path / "out"), "--no-sampling"]
    alone = ["unshare", "-rn"]
    if shutil.which("unshare") is None or subprocess.run([*alone, "true"], check=False).returncode:
        alone = []
    ran = subprocess.run(
        [*alone, sys.executable, "-c", code, *words_],
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert not ran.returncode, ran.stderr
    assert "Warning" not in ran.stderr  # a map of one place leaves room for its words
    assert {p.name for p in (tmp_path / "out").iterdir()} == {*WRITTEN, "report.pdf", "report.html"}


def test_the_socket_guard_can_fail() -> None:
    with (
        guarded(),
        pytest.raises(AssertionError, match="a socket was opened"),
        socket.socket() as s,
    ):
        s.connect(("localhost", 1))
