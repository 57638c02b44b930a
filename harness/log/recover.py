"""A log that was cut or damaged is made whole: what stands before, in an MCAP file with its end and index.

The new file has the same rows in the same chunks, so one that was cut after its last tick gets back the
bytes that it had. A chunk of which only a part was written is lost: its checksum covers the whole, and
nothing tells whether the part is right. Ticks that not all components have are left out.
"""

from __future__ import annotations

import os
import struct
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from io import BufferedReader, BytesIO, FileIO
from pathlib import Path
from typing import IO, Any

from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode

from codegen.scratch import Scratch
from harness.files import make_folder
from harness.log.channel import SECOND
from harness.log.container import Container
from harness.log.contents import MESSAGE, RECORD, Contents
from harness.log.log import END_RECORD, PROFILE, Log, LogError, read_log, read_records
from models.errors import UsageError, printable

BATCH = 2**20  # bytes of messages outside chunks that become a chunk
_CHUNK = struct.Struct("<QQ")  # its first and last log time


@dataclass(frozen=True)
class Recovery:
    """What was recovered of a log.

    Attributes:
        log: the log as it was.
        out: the file that was written; None if there was nothing to recover.
        messages: in that file, by topic.
        lost: what was written and could not be kept, in words.
        is_complete: does the file have all that the run logged?
        not_written: the file that was asked for, of a log that is whole.
    """

    log: Log
    out: Path | None = None
    messages: Mapping[str, int] | None = None
    lost: tuple[str, ...] = ()
    is_complete: bool = True
    not_written: Path | None = None

    def words(self) -> list[str]:
        """What was recovered and what was lost, line by line."""
        log = self.log
        ticks = f"{len(log.time)} ticks up to {log.time[-1]:g} s"
        if self.out is None:
            ended = f"; its run ended early: {log.broken}" if log.broken else ""
            unwritten = f", {self.not_written} is not written" if self.not_written else ""
            return [f"{log.path}: the log is whole, {ticks}: nothing to recover{unwritten}{ended}"]
        messages = ", ".join(f"{printable(topic)} {count}" for topic, count in (self.messages or {}).items())
        lost = [*self.lost, *([] if self.is_complete else ["what its run had not written yet, if anything"])]
        return [
            f"{log.path}: {log.damage}",
            f"recovered: {ticks}; messages of {messages}",
            f"lost: {'; '.join(lost) or 'nothing, the index is made anew'}",
        ]

    def facts(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "log": str(self.log.path),
            "damage": self.log.damage,
            "out": None if self.out is None else str(self.out),
            "ticks": len(self.log.time),
            "until_s": float(self.log.time[-1]),
            "messages": None if self.messages is None else dict(self.messages),
            "lost": list(self.lost),
            "complete": self.is_complete,
        }


def default_out(path: Path) -> Path:
    """Where a recovered log lies: beside the log."""
    return path.with_name(f"{path.stem}-recovered{path.suffix}")


def recover(path: Path, out: Path | None = None) -> Recovery:
    """Write what a log holds up to where it was cut or damaged to a new file, whole or not at all.

    The new log says in its metadata `ended` that it was recovered, unless it has all that the run logged.

    Args:
        out: the new file, by default beside the log.

    Raises:
        UsageError: there is something at `out` already, or its folder cannot be made.
        LogError: as `read_log` does, or the log cannot be read again or the file cannot be written.
    """
    log = read_log(path)
    if not log.damage:
        return Recovery(log, not_written=out)
    place = default_out(path) if out is None else out
    is_there = UsageError(f"--out {place}: is there already; choose another file, or remove that one")
    if place.exists():
        raise is_there
    make_folder(place.parent)
    try:
        with _open(path) as file, Scratch(beside=place.parent) as folder:
            part = folder / place.name
            with part.open("xb") as new:
                size = os.fstat(file.fileno()).st_size
                copy = _Copy(size, Container(new, PROFILE), log)
                read_records(path, file, size, copy)
                copy.finish()
                lost = _lost(file, size, copy)
            _name(part, place)
    except FileExistsError as error:
        raise is_there from error
    except OSError as error:
        raise LogError(
            f"log {place}: cannot be written ({error.strerror}); make room, or choose another file with --out"
        ) from error
    return Recovery(log, place, copy.counts, lost, copy.has_all)


def _name(part: Path, place: Path) -> None:
    """Give a file that is whole its name: in one step, where the file system has links.

    Raises:
        FileExistsError: the name was taken since.
        OSError: it cannot be given.
    """
    try:
        place.hardlink_to(part)
    except FileExistsError:
        raise
    except OSError:
        place.open("xb").close()  # takes the name, or fails
        part.replace(place)


class _Source(FileIO):
    """A log to read, whose errors are not those of the file that is written meanwhile."""

    def readinto(self, buffer: Any) -> int:
        try:
            return super().readinto(buffer)
        except OSError as error:
            raise _unreadable(self.name, error) from error


def _open(path: Path) -> BufferedReader:
    try:
        return BufferedReader(_Source(path))
    except OSError as error:
        raise _unreadable(path, error) from error


def _unreadable(path: Any, error: OSError) -> LogError:
    return LogError(f"log {path}: cannot be read ({error.strerror})")


class _Copy(Contents):
    """Records that go into a container as they are read, as far as all components have their rows.

    Args:
        size: of the file, bytes.
        log: what was read of it before.
    """

    def __init__(self, size: int, container: Container, log: Log) -> None:
        super().__init__(size)
        self.counts: Counter[str] = Counter()
        self.dropped = 0
        self._container, self._log = container, log
        self._last = round(log.time[-1] * SECOND)  # ns
        self._new_schemas = {0: 0}  # numbers; 0 is none
        self._new_channels: dict[int, int] = {}
        self._rows: Counter[int] = Counter()
        self._messages: list[tuple[int, int, bytes]] = []
        self._bytes = 0

    @property
    def has_all(self) -> bool:
        """Does the copy have all that the writer of the log gave it?"""
        return self.is_complete and not self.dropped

    def finish(self) -> None:
        """Write what is left, and the end of the file."""
        self._flush()
        if not self.has_all and END_RECORD not in self.metadata:
            self._container.add_metadata(END_RECORD, {"reason": f"recovered, {self._log.damage}"})
        self._container.finish()

    def _take(self, opcode: int, content: bytes) -> None:
        super()._take(opcode, content)
        stream = ReadDataStream(BytesIO(content))
        match opcode:
            case Opcode.METADATA:
                metadata = records.Metadata.read(stream)
                self._container.add_metadata(metadata.name, metadata.metadata)
            case Opcode.ATTACHMENT:
                attachment = records.Attachment.read(stream)
                self._container.add_attachment(attachment.name, attachment.media_type, attachment.data)
            case Opcode.SCHEMA:
                schema = records.Schema.read(stream)
                if schema.id not in self._new_schemas:
                    number = self._container.add_schema(schema.name, schema.encoding, schema.data)
                    self._new_schemas[schema.id] = number
            case Opcode.CHUNK:
                self._flush()
            case Opcode.MESSAGE if self._bytes > BATCH:
                self._flush()

    def _take_channel(self, channel: records.Channel) -> None:
        super()._take_channel(channel)
        if channel.id not in self._new_channels:
            schema = self._new_schemas.get(channel.schema_id, 0)
            self._new_channels[channel.id] = self._container.add_channel(
                channel.topic, channel.message_encoding, schema, channel.metadata
            )

    def _take_message(self, data: bytes, start: int, end: int) -> None:
        super()._take_message(data, start, end)
        channel, time = MESSAGE.unpack_from(data, start)
        self._rows[channel] += 1
        if self._rows[channel] > len(self._log.time) if self._topics[channel] else time > self._last:
            self.dropped += 1
            return
        message = data[start + MESSAGE.size : end]
        self._messages.append((self._new_channels[channel], time, message))
        self._bytes += len(message)
        self.counts[self._channels[channel].topic] += 1

    def _flush(self) -> None:
        """Write the messages so far as a chunk."""
        if self._messages:
            self._container.add_messages(*zip(*self._messages, strict=True))
        self._container.flush()
        self._messages, self._bytes = [], 0


# records that say nothing which is not in those before them
_MADE_ANEW = {
    Opcode.MESSAGE_INDEX, Opcode.DATA_END, Opcode.STATISTICS, Opcode.CHUNK_INDEX, Opcode.ATTACHMENT_INDEX,
    Opcode.METADATA_INDEX, Opcode.SUMMARY_OFFSET, Opcode.FOOTER,
}  # fmt: skip


def _lost(file: IO[bytes], size: int, copy: _Copy) -> tuple[str, ...]:
    """What of a file could not be kept, in words."""
    lost = []
    if copy.dropped:
        messages = f"{copy.dropped} message{'s' * (copy.dropped > 1)}"
        lost.append(f"{messages} of ticks that not all components have")
    file.seek(copy.end)
    head, rest = file.read(RECORD.size), size - copy.end
    opcode, length = RECORD.unpack(head) if len(head) == RECORD.size else (0, size)
    whole = RECORD.size + length
    if rest == 0 or copy.is_complete or opcode in _MADE_ANEW:
        return tuple(lost)
    times = file.read(_CHUNK.size)
    if whole <= rest:
        lost.append(f"all from byte {copy.end} on, {rest} bytes")
    elif opcode == Opcode.CHUNK and len(times) == _CHUNK.size:
        first, last = (time / SECOND for time in _CHUNK.unpack(times))
        lost.append(f"a chunk from {first:g} to {last:g} s, of which {rest} of {whole} bytes are there")
    else:
        lost.append(f"the last {rest} bytes, part of a record")
    return tuple(lost)
