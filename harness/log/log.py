"""The log of a run: an MCAP file that viewers open, that outlives a killed run and reads back bit for bit.

One topic per component, `/plant` and so on, holds its whole signal set as JSON, one message a tick; its JSON
Schema carries each signal's type, unit and meaning. `foxglove` adds the topics that viewers draw. Log time
and publish time are trial time in ns: nothing comes from a clock, and the same run writes the same bytes.
`rows` spells the values; every NaN reads back as the one quiet NaN. `writer` says when the file is flushed.
"""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from io import BytesIO
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, cast

import numpy as np
import numpy.typing as npt
import orjson
import zstandard
from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC

from harness.files import nearest_file
from harness.log.route import Route
from models.errors import CanineError, UsageError, nearest, printable

if TYPE_CHECKING:
    import pandas

PROFILE = "guided-canine"  # in the header of every log: what tells ours from others
FORMAT = "2"  # "1" had no checksums of metadata and file; it is read too
OWN_RECORD = "log"  # metadata of the log itself: format and origin
CHECK_RECORD = "crc32"  # metadata with the checksums of the other metadata and the attachments
END_RECORD = "ended"  # metadata of a run that a fault ended
JSON_TYPES = {"Real": "number", "Integer": "integer", "Boolean": "boolean"}
TYPES = {json_type: name for name, json_type in JSON_TYPES.items()}
SECOND = 1_000_000_000  # ns
LATEST = 2**53  # ns: float64 tells the ticks of 104 days apart

# What a crafted log may cost. A trial's chunk is a second of it, 55 kB; logs pack to a sixth.
MAX_RECORD = 512 * 2**20  # bytes: an attached package is as large at most (MAX_BYTES in cosim/archive)
MAX_CHUNK = 128 * 2**20  # bytes unpacked: a second of 3,000 signals at 1 kHz
MAX_ROW = 4 * 2**20  # bytes: 100,000 signals; JSON takes up to 20 times as much when it is read
MAX_RATIO = 1000  # of all chunks unpacked to the file

Array = npt.NDArray[np.float64]


class LogError(CanineError):
    """A log cannot be written, or a file cannot be read as a log."""


class NoLogError(LogError, UsageError):
    """There is no file of this name that can be opened."""


@dataclass(frozen=True)
class Channel:
    """A component's signals, inputs then outputs: names, units, types (Real, Integer, Boolean), meanings."""

    component: str
    block: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    types: tuple[str, ...]
    meanings: tuple[str, ...]

    def schema(self) -> bytes:
        """The JSON Schema of a row."""
        signals = zip(self.names, self.units, self.types, self.meanings, strict=True)
        properties = {
            name: {"type": JSON_TYPES[kind], "unit": unit, "description": meaning}
            for name, unit, kind, meaning in signals
        }
        return json.dumps({"title": self.block, "type": "object", "properties": properties}).encode()

    @classmethod
    def from_schema(cls, component: str, block: str, schema: bytes) -> Channel:
        """What `schema` stated.

        Raises:
            ValueError: it is no schema of a row.
        """
        try:
            properties = orjson.loads(schema)["properties"]
            columns = [(p["unit"], TYPES[p["type"]], p["description"]) for p in properties.values()]
        except (orjson.JSONDecodeError, KeyError, TypeError, AttributeError):
            raise ValueError(f'the schema of "{component:.80}" does not describe rows') from None
        if not all(isinstance(text, str) for column in columns for text in column):
            raise ValueError(f'the schema of "{component:.80}" has a unit or a meaning that is not a text')
        units, types, meanings = zip(*columns, strict=True) if columns else ((), (), ())
        return cls(component, block, tuple(properties), units, types, meanings)


@dataclass(repr=False)
class Log:
    """A run that was read back: `values[component]` is (ticks, signals), `time` (ticks,) in s.

    `log["plant.north"]` is one signal, (ticks,). `broken` says why the run is not whole, and is "" if it is.
    """

    path: Path
    channels: tuple[Channel, ...]
    metadata: dict[str, dict[str, str]]
    attachments: dict[str, bytes]
    time: Array
    values: dict[str, Array]
    origin: tuple[float, float] = (0.0, 0.0)
    broken: str = ""
    _columns: dict[str, tuple[str, int]] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._columns = {
            f"{channel.component}.{name}": (channel.component, i)
            for channel in self.channels
            for i, name in enumerate(channel.names)
        }

    def __repr__(self) -> str:
        return f"Log({str(self.path)!r}, {len(self.time)} ticks of {', '.join(self.values)})"

    def __contains__(self, signal: str) -> bool:
        return signal in self._columns

    def __getitem__(self, signal: str) -> Array:
        if signal not in self._columns:
            raise LogError(f'log {self.path}: there is no signal "{signal}"{nearest(signal, self._columns)}')
        component, column = self._columns[signal]
        values: Array = self.values[component][:, column]
        return values

    def parameter(self, name: str) -> float | None:
        """The value of `component.name` that the run had (SI), or None if it had no such number."""
        try:
            return float(self.metadata.get("parameters", {})[name])
        except (KeyError, ValueError):
            return None

    def arrays(self) -> dict[str, dict[str, npt.NDArray[Any]]]:
        """All signals, (ticks,) each, by component and name; `time` has the time of the ticks in s.

        Reals are float64, where NaN stays NaN; Integers are int64, Booleans bool. An Integer with a value
        that int64 cannot hold, and an Integer or Boolean with one that is not finite, stay float64.
        """
        return {
            channel.component: {
                name: _typed(column, kind)
                for name, kind, column in zip(
                    channel.names, channel.types, self.values[channel.component].T, strict=True
                )
            }
            for channel in self.channels
        }

    def frames(self) -> dict[str, pandas.DataFrame]:
        """A pandas DataFrame for each component: a column for each signal, the time in s as index.

        Types are those of `arrays`; `frame.attrs["units"]` has the units by column.

        Raises:
            UsageError: pandas is not installed.
        """
        try:
            import pandas  # noqa: PLC0415 - an optional extra
        except ImportError:
            raise UsageError(
                "a log as DataFrames needs pandas, which is not installed; "
                'pip install "guided-canine[pandas]", or take Log.arrays()'
            ) from None
        arrays, frames = self.arrays(), {}
        for channel in self.channels:
            frame = pandas.DataFrame(arrays[channel.component], index=pandas.Index(self.time, name="time"))
            frame.attrs["units"] = dict(zip(channel.names, channel.units, strict=True))
            frames[channel.component] = frame
        return frames

    @property
    def route(self) -> Route | None:
        """The waypoints, if the controller has any."""
        return Route.of(self.metadata.get("parameters", {}))


def _typed(column: Array, kind: str) -> npt.NDArray[Any]:
    """A signal, (ticks,), in the type that its channel states, or float64 where that cannot hold it."""
    if kind == "Real" or not np.isfinite(column).all():
        return np.array(column)
    if kind == "Boolean":
        return column.astype(np.bool_)
    return np.array(column) if (np.abs(column) >= 2.0**63).any() else column.astype(np.int64)


class _DamageError(Exception):
    """What is wrong with a record."""

    def __str__(self) -> str:
        return printable(super().__str__())


_RECORD = struct.Struct("<BQ")  # opcode, length of the content
_MESSAGE = struct.Struct("<HxxxxQxxxxxxxx")  # channel, (sequence,) log time, (publish time)
# what mcap's records and the decompressors raise for bytes that they cannot read
_UNREADABLE = (McapError, zstandard.ZstdError, RuntimeError, ValueError, OverflowError, struct.error)


def checksums(records: Mapping[str, Mapping[str, str]], attachments: Mapping[str, bytes]) -> dict[str, str]:
    """CRC-32 of what is known before the first tick, by name; MCAP gives metadata none.

    They are of the content, so a tool may lay out the file anew, and a run that was killed has them too.
    """
    content = {f"metadata {name}": json.dumps(v, sort_keys=True).encode() for name, v in records.items()}
    content |= {f"attachment {name}": data for name, data in attachments.items()}
    return {name: f"{zlib.crc32(data):08x}" for name, data in content.items()}


class _Topic:
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
            _DamageError: a message is not a row of the channel; ticks go back, or some are missing.
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
        except _DamageError:
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
            raise _DamageError(f"a tick is at {latest:g} s; a log has none after {last:g} s")
        times = np.array(self.times[-1:] + moments, dtype=np.int64)
        steps = np.diff(times)
        if (steps <= 0).any():
            at = times[np.argmax(steps <= 0)] / SECOND
            raise _DamageError(f"the time does not grow after the tick at {at:g} s")
        first = np.diff((self.times[:2] + moments)[:2])
        holes = 2 * steps > 3 * first if len(first) else steps > LATEST
        if holes.any():
            before, after = times[np.argmax(holes)] / SECOND, times[np.argmax(holes) + 1] / SECOND
            raise _DamageError(f"ticks between {before:g} and {after:g} s are missing")


def _values(channel: Channel, messages: list[bytes], times: list[int]) -> Array:
    """The values of some rows, (n, signals).

    Raises:
        _DamageError: a message is no JSON, or not a row of the channel.
    """
    try:
        rows = orjson.loads(b"[" + b",".join(messages) + b"]")
    except orjson.JSONDecodeError as reason:
        raise _DamageError(f'a row of "{channel.component}" is no JSON ({reason})') from None
    expected = dict.fromkeys(channel.names).keys()
    if len(rows) != len(messages):
        raise _DamageError(f'a message of "{channel.component}" is not one row')
    for row, time in zip(rows, times, strict=True):
        if type(row) is not dict or row.keys() != expected:
            where = f'the row of "{channel.component}" at {time / SECOND:g} s'
            if type(row) is not dict:
                raise _DamageError(f"{where} is a {type(row).__name__}; expected an object")
            missing, extra = sorted(expected - row.keys()), sorted(row.keys() - expected)
            what = f"lacks the signal {missing[0]!r:.80}" if missing else f"has a signal {extra[0]!r:.80}"
            raise _DamageError(f"{where} {what}, unlike its schema")
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
    raise _DamageError(f'"{channel.component}.{name}" is {value!r:.80}; expected a {kind}')


_PLAIN: dict[str, set[type]] = {"Real": {float, int}, "Integer": {int}, "Boolean": {bool}}
_NOT_FINITE = ("NaN", "Infinity", "-Infinity")


class _Contents:
    """What a log holds, as far as it is read."""

    def __init__(self, size: int) -> None:
        self.metadata: dict[str, dict[str, str]] = {}
        self.attachments: dict[str, bytes] = {}
        self.topics: dict[str, _Topic] = {}  # by component
        self._schemas: dict[int, records.Schema] = {}
        self._channels: dict[int, records.Channel] = {}
        self._topics: dict[int, _Topic | None] = {}  # by channel; None for those of the viewers
        self._room = max(MAX_CHUNK, MAX_RATIO * size)  # bytes that chunks may still unpack to

    def take(self, opcode: int, content: bytes) -> None:
        """Keep what a record says.

        Raises:
            _DamageError: the record is damaged.
        """
        try:
            self._take(opcode, content)
        except _UNREADABLE as reason:
            raise _DamageError(str(reason) or type(reason).__name__) from None

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
                    raise _DamageError(f'the checksum of attachment "{attachment.name:.80}" differs')
                self.attachments[attachment.name] = attachment.data
            case Opcode.SCHEMA:
                schema = records.Schema.read(stream)
                if self._schemas.setdefault(schema.id, schema) != schema:
                    raise _DamageError(f"two schemas have the number {schema.id}")
            case Opcode.CHANNEL:
                self._take_channel(records.Channel.read(stream))
            case Opcode.MESSAGE:
                self._take_message(content, 0, len(content))
            case Opcode.CHUNK:
                self._take_chunk(records.Chunk.read(stream))

    def _take_channel(self, channel: records.Channel) -> None:
        if self._channels.setdefault(channel.id, channel) != channel:
            raise _DamageError(f"two channels have the number {channel.id}")
        if channel.id in self._topics:
            return
        self._topics[channel.id] = None
        if "component" not in channel.metadata:
            return
        component, block = channel.metadata["component"], channel.metadata.get("block", "")
        if channel.schema_id not in self._schemas:
            raise _DamageError(
                f'channel "{channel.topic:.80}" names schema {channel.schema_id}, which is missing'
            )
        if component in self.topics:
            raise _DamageError(f'two channels have the rows of "{component:.80}"')
        schema = self._schemas[channel.schema_id].data
        self.topics[component] = self._topics[channel.id] = _Topic(
            Channel.from_schema(component, block, schema)
        )

    def _take_message(self, data: bytes, start: int, end: int) -> None:
        channel, time = _MESSAGE.unpack_from(data, start)
        if channel not in self._topics:
            raise _DamageError(f"a message of channel {channel}, which is missing")
        if topic := self._topics[channel]:
            if end - start > MAX_ROW:
                raise _DamageError(f"a row of {end - start} bytes; at most {MAX_ROW} are read")
            topic.moments.append(time)
            topic.messages.append(data[start + _MESSAGE.size : end])

    def _take_chunk(self, chunk: records.Chunk) -> None:
        """Keep a chunk's records; its thousands of messages are not made objects one by one."""
        data, at = self._unpacked(chunk), 0
        while at < len(data):
            opcode, length = _RECORD.unpack_from(data, at)
            start, at = at + _RECORD.size, at + _RECORD.size + length
            if at > len(data):
                raise _DamageError("a record leaves its chunk")
            if opcode == Opcode.MESSAGE:
                self._take_message(data, start, at)
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._take(opcode, data[start:at])
            else:
                raise _DamageError(f"a chunk holds a record of kind {opcode}, which has no place there")
        self.decode()

    def _unpacked(self, chunk: records.Chunk) -> bytes:
        """The records of a chunk."""
        size = chunk.uncompressed_size
        if size > min(MAX_CHUNK, self._room):
            raise _DamageError(f"a chunk unpacks to {size / 2**20:.0f} MiB, more than a log's chunk holds")
        self._room -= size
        match chunk.compression:
            case "zstd":
                stated = zstandard.get_frame_parameters(chunk.data).content_size
                if stated not in (size, zstandard.CONTENTSIZE_UNKNOWN):
                    raise _DamageError(f"a chunk of {size} bytes unpacks to {stated}")
                data = zstandard.decompress(chunk.data, max_output_size=size) if size else b""
            case "lz4":  # by a tool that wrote the log anew
                import lz4.frame  # noqa: PLC0415 - never ours

                data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=size + 1)
            case "":
                data = chunk.data
            case _:
                raise _DamageError(f'a chunk has compression "{chunk.compression:.80}"; expected zstd')
        if len(data) != size:
            raise _DamageError(f"a chunk of {size} bytes unpacks to {len(data)}")
        if chunk.uncompressed_crc not in (0, zlib.crc32(data)):
            raise _DamageError("the checksum of a chunk differs")
        return data

    def decode(self) -> None:
        """Turn the messages so far into values.

        Raises:
            _DamageError: as a topic does.
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


def read_log(path: Path) -> Log:
    """Read a log; of one that was cut short or damaged, everything up to there, and `broken` says so.

    Every checksum is tested: of chunks and attachments, of the whole file where it was closed, and of each
    record before the first tick, without which nobody could say which run it is.

    Raises:
        NoLogError: there is no such file, or it cannot be opened.
        LogError: the file is no MCAP, not one of ours, ends before its first tick, or a record that says
            which run it is is damaged.
    """
    if path.exists() and not path.is_file() and not path.is_dir():  # to open a pipe would wait for its writer
        raise NoLogError(f"log {path}: is no file")
    try:
        with path.open("rb") as file:
            size = path.stat().st_size
            contents = _Contents(size)
            broken = _read(path, file, size, contents)
    except (FileNotFoundError, NotADirectoryError, IsADirectoryError, PermissionError) as error:
        hint = "" if path.exists() else nearest_file(path)
        raise NoLogError(f"log {path}: cannot be read ({error.strerror}){hint}") from error
    except OSError as error:
        raise LogError(f"log {path}: cannot be read ({error.strerror})") from error
    try:
        contents.decode()  # messages outside chunks
    except _DamageError as damage:
        broken = f"the file is damaged ({damage})"
    ticks, complete = contents.ticks()
    if not complete:
        counts = ", ".join(
            f"{len(topic.times)} of {printable(name):.80}" for name, topic in contents.topics.items()
        )
        broken = broken or f"the file is damaged (not all components have the same ticks: {counts})"
    if not ticks:
        what = broken or "it was closed"
        raise LogError(f"log {path}: no tick to read, {what} before the first; run the trial again")
    origin = 0.0, 0.0
    own = _checked_head(path, contents)
    try:
        origin = float(own.get("latitude", 0)), float(own.get("longitude", 0))
    except ValueError:
        broken = broken or "the file is damaged (its origin is not a number)"
    time = np.array(ticks, dtype=np.float64) / SECOND
    if broken:
        broken += f"; its ticks up to {time[-1]:g} s are kept"
    broken = broken or printable(contents.metadata.pop(END_RECORD, {}).get("reason", ""))
    topics = list(contents.topics.values())
    return Log(
        path,
        tuple(topic.channel for topic in topics),
        contents.metadata,
        contents.attachments,
        time,
        {topic.channel.component: np.concatenate(topic.values)[: len(ticks)] for topic in topics},
        origin,
        broken,
    )


def _read(path: Path, file: IO[bytes], size: int, contents: _Contents) -> str:
    """Read a file's records into `contents`; why they are not all, "" if they are.

    Raises:
        LogError: the file is not one of ours.
    """
    if size == 0:
        raise LogError(f"log {path}: the file is empty; run the trial again")
    magic = file.read(len(MCAP0_MAGIC))
    if not MCAP0_MAGIC.startswith(magic):
        raise LogError(f'log {path}: not an MCAP file; give a log that "canine run" wrote')
    checksum, at = zlib.crc32(magic), len(magic)  # of the section: the data, then the summary
    ends = 0  # of sections
    early = f"the file ends early, at byte {size}: the run was killed or the file was cut"
    while True:
        head = file.read(_RECORD.size)
        if len(head) < _RECORD.size:
            return early
        opcode, length = _RECORD.unpack(head)
        if length > size - at - len(head):
            return early
        if length > MAX_RECORD:
            return f"the file is damaged at byte {at} (a record of {length} bytes; {MAX_RECORD} at most)"
        content = file.read(length)
        if at == len(MCAP0_MAGIC):
            _check_profile(path, opcode, content)
        checked = contents.metadata.get(OWN_RECORD, {}).get("format") == FORMAT
        try:
            if opcode in (Opcode.DATA_END, Opcode.FOOTER):
                covered, stated = head + content[:-4] if opcode == Opcode.FOOTER else b"", content[-4:]
                actual = zlib.crc32(covered, checksum).to_bytes(4, "little")
                if stated != actual and (checked or stated != bytes(4)):
                    raise _DamageError(
                        f"the checksum over all before is {stated.hex()}, expected {actual.hex()}"
                    )
            else:
                contents.take(opcode, content)
        except _DamageError as damage:
            return f"the file is damaged at byte {at} ({damage})"
        at += len(head) + length
        checksum = 0 if opcode == Opcode.DATA_END else zlib.crc32(content, zlib.crc32(head, checksum))
        ends += opcode == Opcode.DATA_END
        if opcode == Opcode.FOOTER:
            break
    rest = file.read(len(MCAP0_MAGIC) + 1)
    if len(rest) < len(MCAP0_MAGIC) and MCAP0_MAGIC.startswith(rest):
        return early
    if rest != MCAP0_MAGIC or not ends:
        return f"the file is damaged at byte {at} (its end is not that of an MCAP file)"
    return ""


def _check_profile(path: Path, opcode: int, content: bytes) -> None:
    """Is the first record the header of one of our logs?"""
    try:
        if opcode != Opcode.HEADER:
            raise ValueError
        profile = records.Header.read(ReadDataStream(BytesIO(content))).profile
    except _UNREADABLE:
        raise LogError(
            f"log {path}: no tick to read, the file is damaged at its first record, which is not a header; "
            "run the trial again"
        ) from None
    if profile != PROFILE:
        raise LogError(
            f'log {path}: an MCAP file with profile "{printable(profile):.80}", expected '
            f'"{PROFILE}"; give a log that "canine run" wrote'
        )


def _checked_head(path: Path, contents: _Contents) -> dict[str, str]:
    """The log's own record, out of the metadata, once all that say which run it is are known to be whole.

    Raises:
        LogError: one is missing or damaged, or the format is not known.
    """
    head = {name: values for name, values in contents.metadata.items() if name != END_RECORD}
    own, stated = contents.metadata.pop(OWN_RECORD, {}), contents.metadata.pop(CHECK_RECORD, {})
    if "format" not in own:
        raise LogError(f'log {path}: damaged, it has no metadata "{OWN_RECORD}"; take another copy')
    if own["format"] == "1" and not stated:  # written before the checksums came
        return own
    if own["format"] != FORMAT:
        raise LogError(
            f'log {path}: format "{printable(own["format"]):.80}", expected "{FORMAT}"; update canine'
        )
    head.pop(CHECK_RECORD, None)
    actual = checksums(head, contents.attachments)
    for name in {**stated, **actual}:
        if stated.get(name) != actual.get(name):
            expected, got = printable(stated.get(name, "none")), actual.get(name, "missing")
            raise LogError(
                f"log {path}: the {printable(name):.80} is damaged (its checksum is {got}, expected "
                f"{expected:.80}): which run it is cannot be told; take another copy"
            )
    return own


def named(names: type[IntEnum], value: float) -> str:
    """The name of an enumeration's value, or the number that a foreign component gave instead."""
    return names(int(value)).name if value in set(names) else f"{value:g}"
