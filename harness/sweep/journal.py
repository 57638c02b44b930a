"""The journal of a sweep: a line for every chunk that is done, so that an interrupted sweep goes on there.

The first line says whose it is. Each line begins with its CRC-32, so that one that a killed process, a full
disk or a bad one has left is not believed; those around it are.
"""

from __future__ import annotations

import base64
import fcntl
import json
import os
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from harness.sweep.chunks import SUMS, Chunk, Job
from models.errors import CanineError, UsageError

JOURNAL = "sweep.journal"


class JournalError(CanineError):
    """The journal cannot be written."""


class Journal:
    """The journal in a folder, open and locked.

    Attributes:
        found: the chunks that an earlier process has left; none has a trial of another.
        dropped: how many lines are damaged, or have trials that another line has.
        empty: it holds no chunk.
    """

    def __init__(self, path: Path, handle: int, job: Job) -> None:
        self.path, self._handle, self._job = path, handle, job
        self.found: list[Chunk] = []
        self.dropped = 0
        self.empty = True

    def append(self, chunk: Chunk) -> None:
        """Keep a chunk: it is with the operating system when this returns.

        Raises:
            JournalError: there is no room.
        """
        packed = base64.b64encode(zlib.compress(chunk.ticks.astype(_packed(self._job)).tobytes(), 1))
        line = {
            "start": chunk.start,
            "stop": chunk.stop,
            "sums": chunk.sums.tolist(),
            "ticks": packed.decode(),
        }
        try:
            self._write(_line(line))
        except OSError as reason:
            then = (
                "make room, and give the command again"
                if self.empty
                else "the chunks before are kept: make room, and the same command goes on there"
            )
            raise JournalError(f"{self.path}: cannot be written ({reason.strerror}); {then}") from reason
        self.empty = False

    def remove(self) -> None:
        """The sweep is done, and its results are written."""
        self.path.unlink(missing_ok=True)

    def _write(self, line: bytes) -> None:
        rest = memoryview(line)
        while rest:
            rest = rest[os.write(self._handle, rest) :]

    def _start(self, fingerprint: str, about: str) -> None:
        """Read what is there, or begin."""
        ours = _line({"sweep": fingerprint, "about": about})
        with os.fdopen(os.dup(self._handle), "rb") as lines:
            first = lines.readline()
            if first != ours and ours.startswith(first):  # nothing, or all that there was room for
                self._begin(ours)
                return
            header = _parsed(first)
            if header is None or "sweep" not in header:
                raise UsageError(
                    f"{self.path}: is damaged in its first line, or no sweep's journal; remove it, or choose "
                    "another folder with --out"
                )
            if header["sweep"] != fingerprint:
                raise UsageError(
                    f"{self.path.parent}: holds an unfinished sweep of something else "
                    f"({header.get('about')}); run that again to finish it, remove {self.path.name}, "
                    "or choose another folder with --out"
                )
            whole = len(first)
            chunks: list[Chunk] = []
            for line in lines:
                chunk = self._chunk(line)
                if chunk is None:
                    self.dropped += 1
                else:
                    chunks.append(chunk)
                if line.endswith(b"\n"):
                    whole += len(line)
        os.ftruncate(self._handle, whole)  # what is appended begins a line
        at = 0
        for chunk in sorted(chunks, key=lambda chunk: chunk.start):
            if chunk.start < at:
                self.dropped += 1
            else:
                self.found.append(chunk)
                at = chunk.stop
        self.empty = not self.found

    def _begin(self, first: bytes) -> None:
        os.ftruncate(self._handle, 0)
        try:
            self._write(first)
        except OSError as reason:
            self.remove()
            raise JournalError(
                f"{self.path}: cannot be written ({reason.strerror}); make room, or choose another folder "
                "with --out"
            ) from reason

    def _chunk(self, line: bytes) -> Chunk | None:
        """The chunk of a line, None if it is damaged."""
        known = _parsed(line)
        if known is None:
            return None
        try:
            start, stop = int(known["start"]), int(known["stop"])
            ticks = np.frombuffer(zlib.decompress(base64.b64decode(known["ticks"])), _packed(self._job))
            sums = np.array(known["sums"], dtype=np.int64)
            points = (stop - 1) // self._job.trials - start // self._job.trials + 1
        except (KeyError, ValueError, TypeError, zlib.error):
            return None
        fits = 0 <= start < stop <= self._job.total and ticks.shape == (stop - start,)
        if not fits or sums.shape != (points, len(SUMS)):
            return None
        return Chunk(start, stop, ticks.astype(self._job.dtype), sums)


@contextmanager
def open_journal(folder: Path, job: Job, fingerprint: str, about: str) -> Iterator[Journal]:
    """The journal in a folder: of this very job, with what was done before, or a new one.

    Args:
        fingerprint: a hash of all that decides the results.
        about: the job in words, for whoever finds the journal.

    Raises:
        UsageError: it is another job's or no journal, or another process is writing it.
        JournalError: it cannot be written.
    """
    path = folder / JOURNAL
    handle = _locked(path)
    try:
        journal = Journal(path, handle, job)
        journal._start(fingerprint, about)
        yield journal
    finally:
        os.close(handle)


def _locked(path: Path) -> int:
    """The file, made if need be, open and locked by this process."""
    while True:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o666)
        except OSError as reason:
            raise JournalError(
                f"{path}: cannot be written ({reason.strerror}); choose another folder with --out"
            ) from reason
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if _is_there(handle, path):
                return handle
        except BlockingIOError:
            os.close(handle)
            raise UsageError(
                f"{path.parent}: another sweep is being written there; choose another folder with --out"
            ) from None
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)


def _is_there(handle: int, path: Path) -> bool:
    """Whether it is this file; a process that was done may have removed it before it was locked."""
    try:
        return os.path.samestat(os.fstat(handle), os.stat(path))
    except FileNotFoundError:
        return False


def _line(known: dict[str, object]) -> bytes:
    """A line: the CRC-32 of what follows, and that as JSON."""
    content = json.dumps(known).encode()
    return b"%08x %b\n" % (zlib.crc32(content), content)


def _parsed(line: bytes) -> dict[str, Any] | None:
    """A line's object, None if it is damaged."""
    checksum, _, content = line.partition(b" ")
    if not line.endswith(b"\n") or checksum != b"%08x" % zlib.crc32(content[:-1]):
        return None
    try:
        known = json.loads(content)
    except ValueError:
        return None
    return known if isinstance(known, dict) else None


def _packed(job: Job) -> np.dtype[np.unsignedinteger]:
    """How ticks are written, on whatever machine."""
    return np.dtype(job.dtype).newbyteorder("<")
