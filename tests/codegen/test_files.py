"""Files are written whole or not at all."""

from __future__ import annotations

import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from codegen.blocks.block_c import write_files
from codegen.files import write_whole


def test_what_cannot_be_written_leaves_what_was_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # given a file, and a disk that is full halfway
    path = write_whole(tmp_path / "a", b"before")

    def fill(part: Path, content: bytes) -> None:
        with part.open("wb") as stream:
            stream.write(content[:2])
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", fill)
    # when it is written anew
    with pytest.raises(OSError, match="No space left"):
        write_whole(path, b"after")
    # then the old one stays, and nothing lies beside it
    assert path.read_bytes() == b"before"
    assert list(tmp_path.iterdir()) == [path]


def test_what_a_killed_writer_left_goes_with_the_next_write(tmp_path: Path) -> None:
    # given a process that is killed while it writes
    code = f"""
import os, signal
from pathlib import Path
Path.replace = lambda part, path: os.kill(os.getpid(), signal.SIGKILL)
from codegen.files import write_whole
write_whole(Path({str(tmp_path)!r}, "a"), b"half")
"""
    ended = subprocess.run([sys.executable, "-c", code], check=False)
    assert ended.returncode == -signal.SIGKILL
    [left] = tmp_path.iterdir()
    # when another process writes the file
    subprocess.run([sys.executable, "-c", code.replace("Path.replace =", "unused =")], check=True)
    # then nothing of the killed one lies there
    assert not left.exists()
    assert [path.name for path in tmp_path.iterdir()] == ["a"]


def test_two_writers_of_one_file_do_not_collide(tmp_path: Path) -> None:
    # given two texts that go to the same file many times at once
    texts = ["a" * 100_000, "b" * 100_000]
    with ThreadPoolExecutor(8) as pool:
        written = [pool.submit(write_files, {"x.c": texts[i % 2]}, tmp_path) for i in range(400)]
    # then each got through, and one of the texts is there whole
    assert [future.exception() for future in written] == [None] * 400
    assert (tmp_path / "x.c").read_text() in texts
    assert [path.name for path in tmp_path.iterdir()] == ["x.c"]
