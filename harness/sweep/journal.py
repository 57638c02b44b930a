"""The journal of a sweep: a line for each chunk that is done, so that an interrupted sweep can go on.

The first line identifies the sweep. Each line begins with its CRC-32: a line damaged by a killed process, a
full disk or a failing one is dropped, and the lines around it are kept.
"""

from __future__ import annotations

import base64
import fcntl
import json
import os
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from codegen.scratch import is_there
from harness.files import differences
from harness.sweep.chunks import SUMS, Chunk, FmuFailure, Trials
from models.errors import CanineError, UsageError

SWEEP = "sweep"  # what a journal is of


def file_of(what: str) -> str:
    """The name of the journal of a sweep, or of what else runs in chunks."""
    return f"{what}.journal"


class JournalError(CanineError):
    """The journal cannot be written."""


class Journal:
    """The journal in a folder, open and locked.

    Attributes:
        chunks: those that earlier processes left; they do not overlap.
        dropped: number of lines left out: damaged, or with trials that another line has.
        empty: the journal holds no chunk.
    """

    def __init__(self, path: Path, handle: int, job: Trials) -> None:
        self._what = path.stem
        self.path, self._handle, self._job = path, handle, job
        self.chunks: list[Chunk] = []
        self.dropped = 0
        self.empty = True

    def append(self, chunk: Chunk) -> None:
        """Write a chunk's line; when this returns, the operating system has it.

        Raises:
            JournalError: the disk has no room.
        """
        packed = base64.b64encode(zlib.compress(chunk.ticks.astype(_packed(self._job)).tobytes(), 1))
        line: dict[str, object] = {
            "start": chunk.start,
            "stop": chunk.stop,
            "sums": chunk.sums.tolist(),
            "ticks": packed.decode(),
        }
        if chunk.fmu_failures or chunk.gave_up or chunk.notes:
            failures = [asdict(failure) for failure in chunk.fmu_failures]
            line |= {"fmu_failures": failures, "gave_up": chunk.gave_up, "notes": chunk.notes}
        try:
            self._write(_line(line))
        except OSError as reason:
            advice = (
                "make room, and give the command again"
                if self.empty
                else "the chunks before are kept: make room, and the same command goes on there"
            )
            raise JournalError(f"{self.path}: cannot be written ({reason.strerror}); {advice}") from reason
        self.empty = False

    def remove(self) -> None:
        """Delete the journal once the sweep's results are written."""
        self.path.unlink(missing_ok=True)

    def _write(self, line: bytes) -> None:
        rest = memoryview(line)
        while rest:
            rest = rest[os.write(self._handle, rest) :]

    def _start(self, fingerprint: str, about: str, identity: Mapping[str, Any]) -> None:
        """Read the chunks of an earlier process, or begin a new journal."""
        ours = _line({"sweep": fingerprint, "about": about, "identity": identity})
        with os.fdopen(os.dup(self._handle), "rb") as lines:
            first = lines.readline()
            if first != ours and ours.startswith(first):  # an empty file, or a first line cut by a full disk
                self._begin(ours)
                return
            header = _parsed(first)
            if header is None or "sweep" not in header:
                raise UsageError(
                    f"{self.path}: its first line is damaged, or it is not a {self._what}'s journal; "
                    "remove it, or choose another folder with --out"
                )
            if header["sweep"] != fingerprint:
                held = header.get("identity")
                others = list(differences(held, identity)) if isinstance(held, dict) else []
                differs = ", ".join(others) or "another version of the program or its models"
                raise UsageError(
                    f"{self.path.parent}: holds another unfinished {self._what} ({header.get('about')}); it "
                    f"differs in {differs}. Run that again to finish it, remove {self.path.name}, or choose "
                    "another folder with --out"
                )
            size = len(first)  # of the whole lines
            chunks: list[Chunk] = []
            for line in lines:
                chunk = self._chunk(line)
                if chunk is None:
                    self.dropped += 1
                else:
                    chunks.append(chunk)
                if line.endswith(b"\n"):
                    size += len(line)
        os.ftruncate(self._handle, size)  # so that the next chunk begins a line
        covered = 0
        for chunk in sorted(chunks, key=lambda chunk: chunk.start):
            if chunk.start < covered:
                self.dropped += 1
            else:
                self.chunks.append(chunk)
                covered = chunk.stop
        self.empty = not self.chunks

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
        """The chunk of a line; None if the line is damaged."""
        content = _parsed(line)
        if content is None:
            return None
        try:
            start, stop = int(content["start"]), int(content["stop"])
            ticks = np.frombuffer(zlib.decompress(base64.b64decode(content["ticks"])), _packed(self._job))
            sums = np.array(content["sums"], dtype=np.int64)
            points = (stop - 1) // self._job.trials - start // self._job.trials + 1
            failures = tuple(map(_failure, content.get("fmu_failures", ())))
        except (KeyError, ValueError, TypeError, zlib.error):
            return None
        fits = 0 <= start < stop <= self._job.total and ticks.shape == (stop - start,)
        if not fits or sums.shape != (points, len(SUMS)):
            return None
        gave_up = bool(content.get("gave_up", False))
        notes = tuple(map(str, content.get("notes", ())))
        return Chunk(start, stop, ticks.astype(self._job.dtype), sums, failures, gave_up, notes)


@contextmanager
def open_journal(
    folder: Path,
    job: Trials,
    fingerprint: str,
    about: str,
    identity: Mapping[str, Any] | None = None,
    *,
    what: str = SWEEP,
) -> Iterator[Journal]:
    """Open and lock the journal in a folder: this job's, with the chunks done before, or a new one.

    Args:
        fingerprint: a hash of everything that decides the results.
        about: the job in words, for error messages about its journal.
        identity: what tells it from others, for what differs.
        what: it is.

    Raises:
        UsageError: the file is another job's journal or not a journal, another process is writing it, or the
            folder cannot be made or written into.
        JournalError: the file cannot be written.
    """
    path = folder / file_of(what)
    handle = _locked(path)
    try:
        journal = Journal(path, handle, job)
        journal._start(fingerprint, about, identity or {})
        yield journal
    finally:
        os.close(handle)


def _locked(path: Path) -> int:
    """Open the file, which is created if it is missing, and lock it for this process."""
    while True:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o666)
        except OSError as reason:
            raise UsageError(
                f"{path}: cannot be written ({reason.strerror}); choose another folder with --out"
            ) from reason
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if is_there(handle, path):
                return handle
        except BlockingIOError:
            os.close(handle)
            raise UsageError(
                f"{path.parent}: another {path.stem} is being written there; choose another folder with --out"
            ) from None
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)


def _failure(content: Mapping[str, Any]) -> FmuFailure:
    from harness.cosim.fmu import Fault  # noqa: PLC0415 - fmpy: sweeps of our own blocks do without

    return FmuFailure(content["number"], Fault(**content["fault"]), content["text"])


def _line(content: dict[str, object]) -> bytes:
    """A line: the content as JSON after its CRC-32."""
    text = json.dumps(content).encode()
    return b"%08x %b\n" % (zlib.crc32(text), text)


def _parsed(line: bytes) -> dict[str, Any] | None:
    """A line's content; None if the line is damaged."""
    checksum, _, text = line.partition(b" ")
    if not line.endswith(b"\n") or checksum != b"%08x" % zlib.crc32(text[:-1]):
        return None
    try:
        content = json.loads(text)
    except ValueError:
        return None
    return content if isinstance(content, dict) else None


def _packed(job: Trials) -> np.dtype[np.unsignedinteger]:
    """The type of ticks in the file: little-endian on every machine."""
    return np.dtype(job.dtype).newbyteorder("<")
