"""What is given away: the wheel and the sdist are the same bytes wherever and whenever they are
built, without a network."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

from modelsel._version import VERSION

ROOT = Path(__file__).parents[2]
HOSTS = re.compile(
    rb"pypi\.(?:org|python)|pythonhosted|anaconda\.(?:org|com)|--(?:extra-)?index-url|registry\.npmjs|crates\.io"
)
LOCK = re.compile(r"\.lock$|lock\.(json|ya?ml|toml)$|requirements.*\.txt$")
OFFLINE = "import socket\ndef no(*a, **k): raise RuntimeError('a socket was opened')\nsocket.socket.__init__ = no\n"


def tracked() -> list[Path]:
    ran = subprocess.run(
        ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    if ran.returncode:
        pytest.skip("no git checkout: the files of the project are not known")
    return [Path(name) for name in ran.stdout.split("\0") if name and (ROOT / name).is_file()]


def built(tree: Path, out: Path, epoch: str) -> dict[str, str]:
    """Name -> SHA-256 of what hatchling builds in a tree, with sockets that break."""
    code = OFFLINE + "import sys\nfrom hatchling.cli import hatchling\nsys.exit(hatchling())"
    ran = subprocess.run(
        [sys.executable, "-c", code, "build", "-d", str(out), "-t", "sdist", "-t", "wheel"],
        cwd=tree,
        check=False,
        env=os.environ | {"SOURCE_DATE_EPOCH": epoch},
        capture_output=True,
        text=True,
    )
    assert not ran.returncode, ran.stdout + ran.stderr
    return {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in sorted(out.iterdir())}


@pytest.mark.slow
def test_the_same_bytes_twice(tmp_path) -> None:
    """Two copies of the tree, laid out in another order, hours apart."""
    files = tracked()
    for name, order, hour in (("a", files, 0), ("b", files[::-1], 7200)):
        for file in order:
            place = tmp_path / name / file
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(ROOT / file, place)
            os.utime(place, (1_600_000_000 + hour,) * 2)
    first, second = (
        built(tmp_path / name, tmp_path / f"{name}-out", "1700000000") for name in "ab"
    )
    assert first == second
    assert sorted(name.rpartition(".")[2] for name in first) == ["gz", "whl"]
    with zipfile.ZipFile(next((tmp_path / "a-out").glob("*.whl"))) as wheel:
        packed = {name for name in wheel.namelist() if name.startswith("modelsel/")}
    assert packed == {str(file) for file in files if file.parts[0] == "modelsel"}
    with tarfile.open(next((tmp_path / "a-out").glob("*.gz"))) as sdist:
        sdist.extractall(
            tmp_path / "s", **({"filter": "data"} if hasattr(tarfile, "data_filter") else {})
        )  # since 3.11.4
    again = built(next((tmp_path / "s").iterdir()), tmp_path / "s-out", "1700000000")
    assert {n: h for n, h in again.items() if n.endswith("whl")} == {
        n: h for n, h in first.items() if n.endswith("whl")
    }
    other = built(tmp_path / "a", tmp_path / "c-out", "1700086400")
    assert other != first, "the date does not matter at all: this test could not fail"


def test_no_registry_is_named() -> None:
    """Where packages come from is the user's to say: no lock file, and no file that names a
    registry's host."""
    here = Path(__file__).name
    wrong = [
        str(file)
        for file in tracked()
        if file.name != here and HOSTS.search((ROOT / file).read_bytes())
    ]
    assert not wrong
    assert not [str(file) for file in tracked() if LOCK.search(file.name)]


def test_the_version_stands_once() -> None:
    """The package's version is the citation's and the changelog's newest."""
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    cited = re.search(r"^version: (\S+)$", citation, re.MULTILINE)
    day = re.search(r'^date-released: "(\S+)"$', citation, re.MULTILINE)
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    newest = re.search(r"^## \[(\d[^\]]*)\] - (\S+)$", changelog, re.MULTILINE)
    assert newest is not None
    assert newest.groups() == (VERSION, day[1] if day else None)
    assert cited is not None
    assert cited[1] == VERSION
