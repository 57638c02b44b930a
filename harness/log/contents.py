"""What the records of a log hold: metadata, attachments and rows, checked as they are read.

A record that is damaged raises a DamageError; what was read before it is kept.
"""

from __future__ import annotations

import struct
import zlib
from io import BytesIO
from typing import cast

import numpy as np
import orjson
import zstandard
from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode

from harness.log.channel import SECOND, Array, Channel
from models.errors import printable

LATEST = 2**53  # ns: float64 tells the ticks of 104 days apart

# What a crafted log may cost. A trial's chunk is a second of it, 55 kB; logs pack to a sixth.
MAX_CHUNK = 128 * 2**20  # bytes unpacked: a second of 3,000 signals at 1 kHz
MAX_ROW = 4 * 2**20  # bytes: 100,000 signals; JSON takes up to 20 times as much when it is read
MAX_RATIO = 1000  # of all chunks unpacked to the file


class DamageError(Exception):
    """What is wrong with a record."""

    def __str__(self) -> str:
        return printable(super().__str__())


RECORD = struct.Struct("<BQ")  # opcode, length of the content
MESSAGE = struct.Struct("<HxxxxQxxxxxxxx")  # channel, (sequence,) log time, (publish time)
# what mcap's records and the decompressors raise for bytes that they cannot read
UNREADABLE = (McapError, zstandard.ZstdError, RuntimeError, ValueError, OverflowError, struct.error)


class Topic:
    """One component's rows as they are read."""

    def __init__(self, channel: Channel) -> None:
        self.channel = channel
        self.times: list[int] = []  # ns, of the ticks
        self.values: list[Array] = [np.empty((0, len(channel.names)))]
        self.messages: list[bytes] = []
        self.moments: list[int] = []  # of the messages

    def decode(self) -> None:
        """Turn the messages so far into values.

        Raises:
            DamageError: a message is not a row of the channel; ticks go back, or some are missing.
        """
        messages, moments, self.messages, self.moments = self.messages, self.moments, [], []
        start = size = 0
        for end, message in enumerate(messages, 1):
            size += len(message)
            if size >= MAX_ROW or end == len(messages):
                self._append(messages[start:end], moments[start:end])
                start, size = end, 0

    def _append(self, messages: list[bytes], moments: list[int]) -> None:
        """Append the rows of some messages, those before the first that is damaged."""
        try:
            self._check_times(moments)
            values = _values(self.channel, messages, moments)
        except DamageError:
            if len(messages) > 1:
                for message, moment in zip(messages, moments, strict=True):
                    self._append([message], [moment])
            raise
        self.values.append(values)
        self.times += moments

    def _check_times(self, moments: list[int]) -> None:
        """Times grow, and no step is longer than that of the first two ticks, but for rounding to 1 ns."""
        if max(moments, default=0) > LATEST:
            latest, last = max(moments) / SECOND, LATEST / SECOND
            raise DamageError(f"a tick is at {latest:g} s; a log has none after {last:g} s")
        times = np.array(self.times[-1:] + moments, dtype=np.int64)
        steps = np.diff(times)
        if (steps <= 0).any():
            at = times[np.argmax(steps <= 0)] / SECOND
            raise DamageError(f"the time does not grow after the tick at {at:g} s")
        first = np.diff((self.times[:2] + moments)[:2])
        holes = 2 * steps > 3 * first if len(first) else steps > LATEST
        if holes.any():
            before, after = times[np.argmax(holes)] / SECOND, times[np.argmax(holes) + 1] / SECOND
            raise DamageError(f"ticks between {before:g} and {after:g} s are missing")


def _values(channel: Channel, messages: list[bytes], times: list[int]) -> Array:
    """The values of some rows, (n, signals).

    Raises:
        DamageError: a message is no JSON, or not a row of the channel.
    """
    try:
        rows = orjson.loads(b"[" + b",".join(messages) + b"]")
    except orjson.JSONDecodeError as reason:
        raise DamageError(f'a row of "{channel.component}" is no JSON ({reason})') from None
    expected = dict.fromkeys(channel.names).keys()
    if len(rows) != len(messages):
        raise DamageError(f'a message of "{channel.component}" is not one row')
    for row, time in zip(rows, times, strict=True):
        if type(row) is not dict or row.keys() != expected:
            where = f'the row of "{channel.component}" at {time / SECOND:g} s'
            if type(row) is not dict:
                raise DamageError(f"{where} is a {type(row).__name__}; expected an object")
            missing, extra = sorted(expected - row.keys()), sorted(row.keys() - expected)
            what = f"lacks the signal {missing[0]!r:.80}" if missing else f"has a signal {extra[0]!r:.80}"
            raise DamageError(f"{where} {what}, unlike its schema")
    values = np.empty((len(rows), len(channel.names)))
    for i, (name, kind) in enumerate(zip(channel.names, channel.types, strict=True)):
        column = [row[name] for row in rows]
        if not set(map(type, column)) <= _PLAIN[kind]:
            column = [_number(channel, name, kind, value) for value in column]
        values[:, i] = column
    return values


def _number(channel: Channel, name: str, kind: str, value: object) -> float:
    if kind != "Boolean" and isinstance(value, str) and value in _NOT_FINITE:
        return float(value)
    if type(value) in _PLAIN[kind] or (kind == "Integer" and type(value) is float and value.is_integer()):
        return float(cast("float", value))
    raise DamageError(f'"{channel.component}.{name}" is {value!r:.80}; expected a {kind}')


_PLAIN: dict[str, set[type]] = {"Real": {float, int}, "Integer": {int}, "Boolean": {bool}}
_NOT_FINITE = ("NaN", "Infinity", "-Infinity")


class Contents:
    """What a log holds, as far as it is read.

    Attributes:
        end: the place in the file after the last record that was read.
        is_complete: did the data come to the end that their writer set?
    """

    def __init__(self, size: int) -> None:
        self.metadata: dict[str, dict[str, str]] = {}
        self.attachments: dict[str, bytes] = {}
        self.topics: dict[str, Topic] = {}  # by component
        self.end = 0
        self.is_complete = False
        self._schemas: dict[int, records.Schema] = {}
        self._channels: dict[int, records.Channel] = {}
        self._topics: dict[int, Topic | None] = {}  # by channel; None for those of the viewers
        self._room = max(MAX_CHUNK, MAX_RATIO * size)  # bytes that chunks may still unpack to

    def take(self, opcode: int, content: bytes) -> None:
        """Keep what a record says.

        Raises:
            DamageError: the record is damaged.
        """
        try:
            self._take(opcode, content)
        except UNREADABLE as reason:
            raise DamageError(str(reason) or type(reason).__name__) from None

    def _take(self, opcode: int, content: bytes) -> None:
        stream = ReadDataStream(BytesIO(content))
        match opcode:
            case Opcode.METADATA:
                metadata = records.Metadata.read(stream)
                self.metadata[metadata.name] = metadata.metadata
            case Opcode.ATTACHMENT:
                attachment = records.Attachment.read(stream)
                stated = int.from_bytes(content[-4:], "little")
                if stated not in (0, zlib.crc32(content[:-4])):
                    raise DamageError(f'the checksum of attachment "{attachment.name:.80}" differs')
                self.attachments[attachment.name] = attachment.data
            case Opcode.SCHEMA:
                schema = records.Schema.read(stream)
                if self._schemas.setdefault(schema.id, schema) != schema:
                    raise DamageError(f"two schemas have the number {schema.id}")
            case Opcode.CHANNEL:
                self._take_channel(records.Channel.read(stream))
            case Opcode.MESSAGE:
                self._take_message(content, 0, len(content))
            case Opcode.CHUNK:
                self._take_chunk(records.Chunk.read(stream))

    def _take_channel(self, channel: records.Channel) -> None:
        if self._channels.setdefault(channel.id, channel) != channel:
            raise DamageError(f"two channels have the number {channel.id}")
        if channel.id in self._topics:
            return
        self._topics[channel.id] = None
        if "component" not in channel.metadata:
            return
        component, block = channel.metadata["component"], channel.metadata.get("block", "")
        if channel.schema_id not in self._schemas:
            raise DamageError(
                f'channel "{channel.topic:.80}" names schema {channel.schema_id}, which is missing'
            )
        if component in self.topics:
            raise DamageError(f'two channels have the rows of "{component:.80}"')
        schema = self._schemas[channel.schema_id].data
        self.topics[component] = self._topics[channel.id] = Topic(
            Channel.from_schema(component, block, schema)
        )

    def _take_message(self, data: bytes, start: int, end: int) -> None:
        channel, time = MESSAGE.unpack_from(data, start)
        if channel not in self._topics:
            raise DamageError(f"a message of channel {channel}, which is missing")
        if topic := self._topics[channel]:
            if end - start > MAX_ROW:
                raise DamageError(f"a row of {end - start} bytes; at most {MAX_ROW} are read")
            topic.moments.append(time)
            topic.messages.append(data[start + MESSAGE.size : end])

    def _take_chunk(self, chunk: records.Chunk) -> None:
        """Keep a chunk's records; its thousands of messages are not made objects one by one."""
        data, at = self._unpacked(chunk), 0
        while at < len(data):
            opcode, length = RECORD.unpack_from(data, at)
            start, at = at + RECORD.size, at + RECORD.size + length
            if at > len(data):
                raise DamageError("a record leaves its chunk")
            if opcode == Opcode.MESSAGE:
                self._take_message(data, start, at)
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._take(opcode, data[start:at])
            else:
                raise DamageError(f"a chunk holds a record of kind {opcode}, which has no place there")
        self.decode()

    def _unpacked(self, chunk: records.Chunk) -> bytes:
        """The records of a chunk."""
        size = chunk.uncompressed_size
        if size > min(MAX_CHUNK, self._room):
            raise DamageError(f"a chunk unpacks to {size / 2**20:.0f} MiB, more than a log's chunk holds")
        self._room -= size
        match chunk.compression:
            case "zstd":
                stated = zstandard.get_frame_parameters(chunk.data).content_size
                if stated not in (size, zstandard.CONTENTSIZE_UNKNOWN):
                    raise DamageError(f"a chunk of {size} bytes unpacks to {stated}")
                data = zstandard.decompress(chunk.data, max_output_size=size) if size else b""
            case "lz4":  # by a tool that wrote the log anew
                import lz4.frame  # noqa: PLC0415 - never ours

                data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=size + 1)
            case "":
                data = chunk.data
            case _:
                raise DamageError(f'a chunk has compression "{chunk.compression:.80}"; expected zstd')
        if len(data) != size:
            raise DamageError(f"a chunk of {size} bytes unpacks to {len(data)}")
        if chunk.uncompressed_crc not in (0, zlib.crc32(data)):
            raise DamageError("the checksum of a chunk differs")
        return data

    def decode(self) -> None:
        """Turn the messages so far into values.

        Raises:
            DamageError: as a topic does.
        """
        for topic in self.topics.values():
            topic.decode()

    def ticks(self) -> tuple[list[int], bool]:
        """The times (ns) of the ticks that all components have; are they all that there are?"""
        times = [topic.times for topic in self.topics.values()]
        count = 0
        for moments in zip(*times, strict=False):
            if len(set(moments)) > 1:
                break
            count += 1
        return times[0][:count] if times else [], all(len(t) == count for t in times)
