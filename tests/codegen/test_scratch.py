"""Temporary folders: removed by their run, or by the next one if that was killed; never anybody else's."""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest

from codegen import scratch
from codegen.scratch import Scratch

HOLDER = """
import sys, tempfile, time
from pathlib import Path
from codegen.scratch import Scratch
folder = Scratch({beside})
(folder.path / "file").write_text("x")
print(folder.path, flush=True)
time.sleep(60)
"""


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder for temporary files, that this process has not looked at."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    scratch._remove_abandoned.cache_clear()
    return tmp_path


def holder(place: Path, beside: str = "") -> tuple[subprocess.Popen[str], Path]:
    """Another run with a temporary folder."""
    process = subprocess.Popen(
        [sys.executable, "-c", HOLDER.format(beside=beside)], env=os.environ | {"TMPDIR": str(place)},
        stdout=subprocess.PIPE, text=True, cwd=Path(scratch.__file__).parents[1],
    )  # fmt: skip
    assert process.stdout is not None
    return process, Path(process.stdout.readline().strip())


def killed(process: subprocess.Popen[str]) -> None:
    process.kill()
    process.communicate()


def test_a_folder_is_removed_at_its_end(place: Path) -> None:
    with Scratch() as folder:
        (folder / "file").write_text("x")
        assert folder.parent == place
    assert list(place.iterdir()) == []


@pytest.mark.parametrize("beside", [False, True], ids=["TMPDIR", "beside a file"])
def test_what_a_killed_run_left_is_removed_by_the_next(place: Path, beside: bool) -> None:
    process, folder = holder(place, f"Path({str(place)!r})" * beside)
    assert (folder / "file").exists()
    killed(process)
    assert folder.exists()
    with Scratch(place if beside else None):
        assert not folder.exists()


def test_folders_deeper_than_any_path_are_removed(place: Path) -> None:
    # given a folder with 1,500 others in each other, one of them closed
    with Scratch() as folder:
        here = os.open(folder, os.O_RDONLY)
        for depth in range(1500):
            os.mkdir("deep", dir_fd=here)
            inner = os.open("deep", os.O_RDONLY, dir_fd=here)
            os.close(os.open("file", os.O_CREAT | os.O_WRONLY, dir_fd=inner))
            os.symlink("/", "link", dir_fd=inner)
            if depth == 700:
                os.chmod("deep", 0, dir_fd=here)
            os.close(here)
            here = inner
        os.close(here)
    # then
    assert list(place.iterdir()) == []


def test_a_folder_that_was_given_another_name_is_removed(place: Path) -> None:
    with Scratch() as folder:
        (folder / "file").write_text("x")
        folder.rename(place / "other")
    assert list(place.iterdir()) == []


def test_the_folder_of_a_living_run_stays(place: Path) -> None:
    process, folder = holder(place)
    try:
        os.utime(folder, (0, 0))  # however old it looks
        with Scratch():
            pass
        assert (folder / "file").exists()
    finally:
        killed(process)


def test_a_child_of_the_killed_run_still_holds_the_folder(place: Path) -> None:
    # given a run that is killed while a process that it forked works on
    fork = "import os\nif os.fork():\n    os.kill(os.getpid(), 9)\ntime.sleep(3)"
    script = HOLDER.format(beside="").replace("time.sleep(60)", fork)
    process = subprocess.Popen(
        [sys.executable, "-c", script], env=os.environ | {"TMPDIR": str(place)},
        stdout=subprocess.PIPE, text=True, cwd=Path(scratch.__file__).parents[1],
    )  # fmt: skip
    assert process.stdout is not None
    folder = Path(process.stdout.readline().strip())
    process.wait()
    # then it stays until that ends, too
    with Scratch():
        assert folder.exists()
    process.stdout.read()  # until the child ends
    time.sleep(0.2)
    scratch._remove_abandoned.cache_clear()
    with Scratch():
        assert not folder.exists()


def test_nothing_else_is_removed(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # given folders of other names, another mode, a link, a file, and one of another user
    monkeypatch.setattr(os, "geteuid", lambda: 12345)
    theirs = place / f"{scratch.PREFIX}abcdefgh"
    theirs.mkdir(mode=0o700)
    with Scratch():
        assert theirs.exists()
    monkeypatch.undo()
    monkeypatch.setattr(tempfile, "tempdir", str(place))
    theirs.rmdir()
    names = (f"{scratch.PREFIX}mine", "canine-abcdefgh", f"{scratch.PREFIX}abcdefgh.old")
    kept = [place / name for name in names]
    for folder in kept:
        folder.mkdir(mode=0o700)
    open_to_all = place / f"{scratch.PREFIX}12345678"
    open_to_all.mkdir(mode=0o755)
    link = place / f"{scratch.PREFIX}links_to"
    link.symlink_to(kept[0])
    file = place / f"{scratch.PREFIX}a_file__"
    file.write_text("x")
    left = place / f"{scratch.PREFIX}leftover"
    left.mkdir(mode=0o700)
    # when
    scratch._remove_abandoned.cache_clear()
    with Scratch():
        pass
    # then only what has our name and mode is gone
    assert all(path.exists() for path in (*kept, open_to_all, link, file))
    assert not left.exists()
