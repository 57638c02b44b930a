"""The journal of a sweep: a line for every chunk that is done, so that an interrupted sweep goes on there.

The first line says whose it is. A line that is not whole, the last of a killed process or a full disk, is
cut off.
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

import numpy as np

from harness.chunks import SUMS, Chunk, Job
from models.errors import CanineError, UsageError

JOURNAL = "sweep.journal"


class JournalError(CanineError):
    """The journal cannot be written."""


class Journal:
    """The journal in a folder, open and locked.

    Attributes:
        found: the chunks that an earlier process has left.
        empty: it holds no chunk.
    """

    def __init__(self, path: Path, handle: int, job: Job) -> None:
        self.path, self._handle, self._job = path, handle, job
        self.found: list[Chunk] = []
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
        self.empty = False
        self._write(line)

    def remove(self) -> None:
        """The sweep is done, and its results are written."""
        self.path.unlink(missing_ok=True)

    def _write(self, line: dict[str, object]) -> None:
        rest = memoryview((json.dumps(line) + "\n").encode())
        try:
            while rest:
                rest = rest[os.write(self._handle, rest) :]
        except OSError as reason:
            raise JournalError(
                f"{self.path}: cannot be written ({reason.strerror}); the chunks before are kept: make room, "
                "and the same command goes on there"
            ) from reason

    def _start(self, fingerprint: str, about: str) -> None:
        """Read what is there, or begin."""
        with os.fdopen(os.dup(self._handle), "rb") as lines:
            first = lines.readline()
            header = _parsed(first)
            if header is None or "sweep" not in header:
                os.ftruncate(self._handle, 0)
                self._write({"sweep": fingerprint, "about": about})
                return
            if header["sweep"] != fingerprint:
                raise UsageError(
                    f"{self.path.parent}: holds an unfinished sweep of something else "
                    f"({header.get('about')}); run that again to finish it, remove {self.path.name}, "
                    "or choose another folder with --out"
                )
            whole = len(first)
            for line in lines:
                chunk = self._chunk(line)
                if chunk is None:
                    break
                self.found.append(chunk)
                self.empty = False
                whole += len(line)
        os.ftruncate(self._handle, whole)

    def _chunk(self, line: bytes) -> Chunk | None:
        """The chunk of a line, None if it is not whole."""
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
        UsageError: it is another job's, or another process is writing it.
        JournalError: it cannot be written.
    """
    path = folder / JOURNAL
    try:
        folder.mkdir(parents=True, exist_ok=True)
        handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o666)
    except OSError as reason:
        raise JournalError(
            f"{path}: cannot be written ({reason.strerror}); choose another folder with --out"
        ) from reason
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise UsageError(
                f"{folder}: another sweep is being written there; choose another folder with --out"
            ) from None
        journal = Journal(path, handle, job)
        journal._start(fingerprint, about)
        yield journal
    finally:
        os.close(handle)


def _parsed(line: bytes) -> dict[str, str] | None:
    """A whole line's object, or None."""
    try:
        known = json.loads(line) if line.endswith(b"\n") else None
    except ValueError:
        return None
    return known if isinstance(known, dict) else None


def _packed(job: Job) -> np.dtype[np.unsignedinteger]:
    """How ticks are written, on whatever machine."""
    return np.dtype(job.dtype).newbyteorder("<")
