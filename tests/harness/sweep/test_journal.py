"""The journal of a sweep: what it gives back, what it drops, what it refuses."""

from __future__ import annotations

import fcntl
import os
import zlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from harness.sweep import journal as journal_module
from harness.sweep.chunks import SUMS, Chunk, Job, TrialType
from harness.sweep.journal import JournalError, open_journal
from models.errors import UsageError

TYPE = TrialType("a", {}, (), 7500)
JOB = Job("cts", ("x",), tuple((float(p),) for p in range(4)), (TYPE,), 50, 7)  # 200 trials


def chunk(start: int, stop: int, job: Job = JOB) -> Chunk:
    """Results that tell one trial from another."""
    points = (stop - 1) // job.trials - start // job.trials + 1
    ticks = (1000 + np.arange(start, stop)).astype(job.dtype)
    return Chunk(start, stop, ticks, start + np.arange(points * len(SUMS)).reshape(points, len(SUMS)))


def append(folder: Path, *chunks: Chunk, job: Job = JOB) -> None:
    with open_journal(folder, job, "fingerprint", "about") as journal:
        for each in chunks:
            journal.append(each)


def kept(folder: Path, job: Job = JOB) -> tuple[list[tuple[int, int]], int]:
    """The chunks in a folder's journal, and the number of lines dropped; chunks must be whole."""
    with open_journal(folder, job, "fingerprint", "about") as journal:
        for each in journal.chunks:
            expected = chunk(each.start, each.stop, job)
            assert each.ticks.dtype == expected.ticks.dtype
            assert each.ticks.tolist() == expected.ticks.tolist()
            assert each.sums.tolist() == expected.sums.tolist()
        assert journal.empty == (not journal.chunks)
        return [(each.start, each.stop) for each in journal.chunks], journal.dropped


def test_a_journal_gives_back_its_chunks_in_the_order_of_trials(tmp_path: Path) -> None:
    append(tmp_path, chunk(100, 130), chunk(0, 30))
    append(tmp_path, chunk(30, 100), chunk(199, 200))
    assert kept(tmp_path) == ([(0, 30), (30, 100), (100, 130), (199, 200)], 0)


def test_ticks_beyond_16_bits_are_given_back(tmp_path: Path) -> None:
    day = replace(JOB, trial_types=(TrialType("day", {}, (), 2_160_000),))
    append(tmp_path, chunk(0, 200, day), job=day)
    assert chunk(0, 200, day).ticks.dtype == np.uint32
    assert kept(tmp_path, day) == ([(0, 200)], 0)


def test_a_new_journal_is_empty_until_a_chunk_is_there(tmp_path: Path) -> None:
    with open_journal(tmp_path / "new" / "folder", JOB, "fingerprint", "about") as journal:
        assert journal.empty
        journal.append(chunk(0, 10))
        assert not journal.empty
        journal.remove()
        journal.remove()  # again does no harm
    assert list((tmp_path / "new" / "folder").iterdir()) == []


def test_a_journal_does_not_count_a_trial_twice(tmp_path: Path) -> None:
    # given chunks that overlap, of other sizes
    append(tmp_path, chunk(60, 90), chunk(0, 30), chunk(80, 110), chunk(29, 40), chunk(110, 120))
    # then no trial is taken from two of them
    assert kept(tmp_path) == ([(0, 30), (60, 90), (110, 120)], 2)


def line(content: bytes) -> bytes:
    return b"%08x %b\n" % (zlib.crc32(content), content)


def edited(old: bytes, new: bytes) -> Callable[[bytes], bytes]:
    """An edit of a line whose checksum is set right again."""

    def edit(text: bytes) -> bytes:
        assert old in text
        return line(text[9:-1].replace(old, new, 1))

    return edit


@pytest.mark.parametrize(
    ("damage", "dropped", "lost"),
    [
        (lambda text: b"", 0, 1),
        (lambda text: b"\n", 1, 1),
        (lambda text: b"{}\n", 1, 1),
        (lambda text: b"\0" * 5000, 1, 2),  # the line after it is lost with it
        (lambda text: text[:-1] + b"\xff\n", 1, 1),
        (lambda text: text.replace(b'"sums": [[', b'"sums": [[1'), 1, 1),  # good JSON with a wrong checksum
        (lambda text: text + text, 1, 0),
        (lambda text: line(b"[1, 2]"), 1, 1),
        (lambda text: line(b"{"), 1, 1),
        (lambda text: line(b"{}"), 1, 1),
        (edited(b'"start": 20', b'"start": "x"'), 1, 1),
        (edited(b'"start": 20', b'"start": null'), 1, 1),
        (edited(b'"start": 20', b'"start": 19'), 1, 1),  # 21 trials with 20 ticks
        (edited(b'"start": 20', b'"start": -10'), 1, 1),
        (edited(b'"stop": 40', b'"stop": 20'), 1, 1),
        (edited(b'"stop": 40', b'"stop": 201'), 1, 1),
        (edited(b'"sums": [[', b'"sums": [[0, '), 1, 1),  # a count too many
        (edited(b'"sums": [[', b'"sums": [[], ['), 1, 1),
        (edited(b'"ticks": "', b'"ticks": "AAAA'), 1, 1),
        (edited(b'"ticks": "', b'"ticks": "A'), 1, 1),
    ],
)  # fmt: skip
def test_a_damaged_line_is_dropped_and_those_around_it_are_kept(
    tmp_path: Path, damage: Callable[[bytes], bytes], dropped: int, lost: int
) -> None:
    # given three chunks, of which the second line is damaged
    spans = [(0, 20), (20, 40), (40, 60)]
    append(tmp_path, *(chunk(*span) for span in spans))
    path = tmp_path / "sweep.journal"
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join([*lines[:2], damage(lines[2]), *lines[3:]]))
    # then
    left = [spans[0], *spans[1 + lost :]] if lost else spans
    assert kept(tmp_path) == (left, dropped)


@pytest.mark.parametrize(
    ("start", "stop", "fits"),
    [(0, 200, True), (0, 50, True), (40, 51, True), (199, 200, True), (150, 201, False)],
)
def test_chunks_lie_within_the_job(tmp_path: Path, start: int, stop: int, fits: bool) -> None:
    append(tmp_path, chunk(start, stop))
    assert kept(tmp_path) == (([(start, stop)], 0) if fits else ([], 1))


def test_a_chunk_of_the_wrong_points_is_dropped(tmp_path: Path) -> None:
    for start, stop, points in ((40, 60, 1), (40, 50, 2), (50, 60, 2)):
        sums = np.zeros((points, len(SUMS)), dtype=np.int64)
        append(tmp_path, Chunk(start, stop, np.ones(stop - start, np.uint16), sums))
    assert kept(tmp_path) == ([], 3)


def test_a_torn_last_line_is_cut_off_and_writing_goes_on(tmp_path: Path) -> None:
    append(tmp_path, chunk(0, 30), chunk(30, 60))
    path = tmp_path / "sweep.journal"
    path.write_bytes(path.read_bytes()[:-25])
    assert kept(tmp_path) == ([(0, 30)], 1)
    append(tmp_path, chunk(60, 90))
    assert kept(tmp_path) == ([(0, 30), (60, 90)], 0)


def test_a_journal_whose_first_line_is_torn_begins_anew(tmp_path: Path) -> None:
    # given a disk that was full when the journal was begun
    append(tmp_path)
    path = tmp_path / "sweep.journal"
    first = path.read_bytes()
    for length in (0, 1, len(first) - 1):
        path.write_bytes(first[:length])
        append(tmp_path, chunk(0, 30))
        assert kept(tmp_path) == ([(0, 30)], 0)


@pytest.mark.parametrize(
    "content", [b"my notes of the cruise\n", b'{"sweep": "of an older version"}\n', b"\0" * 100, line(b"{}")]
)
def test_a_file_that_is_not_a_journal_is_left_alone(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "sweep.journal"
    path.write_bytes(content)
    with pytest.raises(UsageError) as caught, open_journal(tmp_path, JOB, "fingerprint", "about"):
        pass
    assert str(caught.value) == (
        f"{path}: its first line is damaged, or it is not a sweep's journal; remove it, or choose another "
        "folder with --out"
    )
    assert path.read_bytes() == content


def test_the_journal_of_another_job_is_left_alone(tmp_path: Path) -> None:
    append(tmp_path, chunk(0, 30))
    content = (tmp_path / "sweep.journal").read_bytes()
    with pytest.raises(UsageError) as caught, open_journal(tmp_path, JOB, "another", "other words"):
        pass
    assert str(caught.value) == (
        f"{tmp_path}: holds another unfinished sweep (about); it differs in another version of the program "
        "or its models. Run that again to finish it, remove sweep.journal, or choose another folder with "
        "--out"
    )
    assert (tmp_path / "sweep.journal").read_bytes() == content


def test_a_journal_is_written_by_one_process_at_a_time(tmp_path: Path) -> None:
    with (
        open_journal(tmp_path, JOB, "fingerprint", "about"),
        pytest.raises(UsageError, match="another sweep is being written there; choose another folder"),
        open_journal(tmp_path, JOB, "fingerprint", "about"),
    ):
        pass
    append(tmp_path, chunk(0, 30))  # it is free again
    assert kept(tmp_path) == ([(0, 30)], 0)


def test_a_journal_that_was_removed_before_it_was_locked_is_made_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # given another process that is done, and removes its journal, between our opening and locking it
    removed = False

    def late(handle: int, how: int) -> None:
        nonlocal removed
        if not removed:
            removed = True
            (tmp_path / "sweep.journal").unlink()
        fcntl.flock(handle, how)

    with monkeypatch.context() as patch:
        patch.setattr(journal_module, "fcntl", Replaced(fcntl, flock=late))
        # then the lock is on the file that is there
        with (
            open_journal(tmp_path, JOB, "fingerprint", "about"),
            pytest.raises(UsageError, match="another sweep is being written there"),
            open_journal(tmp_path, JOB, "fingerprint", "about"),
        ):
            pass


def test_no_file_stays_open_whatever_happens(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(handle: int, how: int) -> None:
        raise MemoryError

    opened = len(os.listdir("/proc/self/fd"))
    for flock in (fcntl.flock, fails):
        monkeypatch.setattr(journal_module, "fcntl", Replaced(fcntl, flock=flock))
        with pytest.raises(MemoryError), open_journal(tmp_path, JOB, "fingerprint", "about"):
            raise MemoryError
        assert len(os.listdir("/proc/self/fd")) == opened


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(UsageError) as caught, open_journal(tmp_path / "file" / "b", JOB, "f", "a"):
        pass
    assert str(caught.value) == (
        f"{tmp_path}/file/b/sweep.journal: cannot be written (Not a directory); choose another folder with "
        "--out"
    )


class Replaced:
    """A module with some of its functions replaced."""

    def __init__(self, module: object, **functions: object) -> None:
        self.__dict__.update(vars(module) | functions)


class Disk:
    """`os`, whose disk has room for so many bytes."""

    def __init__(self, room: int) -> None:
        self.room = room

    def write(self, handle: int, data: memoryview) -> int:
        if not self.room:
            raise OSError(28, "No space left on device")
        written = os.write(handle, data[: self.room])
        self.room -= written
        return written


def test_a_disk_that_is_full_at_once_leaves_no_journal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for room in (0, 10):
        monkeypatch.setattr(journal_module, "os", Replaced(os, write=Disk(room).write))
        with pytest.raises(JournalError) as caught, open_journal(tmp_path, JOB, "fingerprint", "about"):
            pass
        assert str(caught.value) == (
            f"{tmp_path}/sweep.journal: cannot be written (No space left on device); make room, or choose "
            "another folder with --out"
        )
        assert list(tmp_path.iterdir()) == []


def test_a_disk_that_fills_up_keeps_the_chunks_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # given room for the first line and one chunk and a half
    append(tmp_path / "a")
    first = (tmp_path / "a" / "sweep.journal").stat().st_size
    append(tmp_path / "a", chunk(0, 30))
    one = (tmp_path / "a" / "sweep.journal").stat().st_size - first
    monkeypatch.setattr(journal_module, "os", Replaced(os, write=Disk(first + one + one // 2).write))
    with open_journal(tmp_path / "b", JOB, "fingerprint", "about") as journal:
        journal.append(chunk(0, 30))
        with pytest.raises(JournalError, match="the chunks before are kept: make room, and the same command"):
            journal.append(chunk(30, 60))
    monkeypatch.undo()
    assert kept(tmp_path / "b") == ([(0, 30)], 1)
    # and without a chunk there is nothing to keep
    monkeypatch.setattr(journal_module, "os", Replaced(os, write=Disk(first).write))
    with (
        open_journal(tmp_path / "c", JOB, "fingerprint", "about") as journal,
        pytest.raises(JournalError, match="make room, and give the command again"),
    ):
        journal.append(chunk(0, 30))
