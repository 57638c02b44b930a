"""The log of a run: an MCAP file that viewers open, that outlives a killed run and reads back bit for bit.

One topic per component, `/plant` and so on, holds its whole signal set as JSON, one message a tick; its JSON
Schema carries each signal's type, unit and meaning. `foxglove` adds the topics that viewers draw. Log time
and publish time are trial time in ns: nothing comes from a clock, and the same run writes the same bytes.
`rows` spells the values; every NaN reads back as the one quiet NaN. `writer` says when the file is flushed.
"""

from __future__ import annotations

import json
import struct
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
from mcap.exceptions import EndOfFile, McapError
from mcap.opcode import Opcode
from mcap.stream_reader import StreamReader, get_chunk_data_stream
from mcap.writer import MCAP0_MAGIC

from harness.files import nearest_file
from harness.log.route import Route
from models.errors import CanineError, UsageError, nearest

if TYPE_CHECKING:
    import pandas

PROFILE = "guided-canine"  # in the header of every log: what tells ours from others
FORMAT = "1"
OWN_RECORD = "log"  # metadata of the log itself: format and origin
END_RECORD = "ended"  # metadata of a run that a fault ended
JSON_TYPES = {"Real": "number", "Integer": "integer", "Boolean": "boolean"}
TYPES = {json_type: name for name, json_type in JSON_TYPES.items()}
SECOND = 1_000_000_000  # ns

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
        """What `schema` stated."""
        properties = json.loads(schema)["properties"]
        return cls(
            component,
            block,
            tuple(properties),
            tuple(p["unit"] for p in properties.values()),
            tuple(TYPES[p["type"]] for p in properties.values()),
            tuple(p["description"] for p in properties.values()),
        )


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


class _Whole:
    """A stream that gives all that was asked for or ends; mcap's reader would pass on a record cut short."""

    def __init__(self, file: IO[bytes], size: int) -> None:
        self.file, self.left = file, size

    def read(self, length: int) -> bytes:
        if length > self.left:
            raise EndOfFile
        self.left -= length
        return self.file.read(length)


class _Topic:
    """One component's rows as they are read, a chunk at a time."""

    def __init__(self, channel: Channel) -> None:
        self.channel = channel
        self.times: list[int] = []  # ns
        self.values: list[Array] = []
        self.messages: list[bytes] = []

    def decode(self) -> None:
        """Turn the messages of a chunk into values."""
        rows = orjson.loads(b"[" + b",".join(self.messages) + b"]")
        names = self.channel.names
        values = np.array([[float(row[name]) for name in names] for row in rows], dtype=np.float64)
        self.values.append(values.reshape(len(rows), len(names)))
        self.messages = []


class _Contents:
    """What a log holds, as far as it is read."""

    def __init__(self) -> None:
        self.metadata: dict[str, dict[str, str]] = {}
        self.attachments: dict[str, bytes] = {}
        self.schemas: dict[int, records.Schema] = {}
        self.topics: dict[int, _Topic] = {}

    def take(self, record: object) -> None:
        """Keep what a record says.

        Raises:
            DAMAGE: the record is damaged.
        """
        match record:
            case records.Metadata():
                self.metadata[record.name] = record.metadata
            case records.Attachment():
                self.attachments[record.name] = record.data
            case records.Schema():
                self.schemas[record.id] = record
            case records.Channel() if "component" in record.metadata and record.id not in self.topics:
                component, block = record.metadata["component"], record.metadata["block"]
                schema = self.schemas[record.schema_id].data
                self.topics[record.id] = _Topic(Channel.from_schema(component, block, schema))
            case records.Message():
                if topic := self.topics.get(record.channel_id):
                    topic.times.append(record.log_time)
                    topic.messages.append(record.data)
            case records.Chunk():
                self._take_chunk(record)

    def _take_chunk(self, chunk: records.Chunk) -> None:
        """Keep a chunk's records; its thousands of messages are not made objects one by one."""
        stream, size = get_chunk_data_stream(chunk, validate_crc=True)
        data, at = stream.read(size), 0
        while at < size:
            opcode, length = _RECORD.unpack_from(data, at)
            content, at = at + _RECORD.size, at + _RECORD.size + length
            if opcode == Opcode.MESSAGE:
                channel, time = _MESSAGE.unpack_from(data, content)
                if topic := self.topics.get(channel):
                    topic.times.append(time)
                    topic.messages.append(data[content + _MESSAGE.size : at])
            elif opcode == Opcode.SCHEMA:
                self.take(records.Schema.read(ReadDataStream(BytesIO(data[content:at]))))
            elif opcode == Opcode.CHANNEL:
                self.take(records.Channel.read(ReadDataStream(BytesIO(data[content:at]))))
        self.decode()

    def decode(self) -> None:
        """Turn the messages so far into values."""
        for topic in self.topics.values():
            topic.decode()


DAMAGE = (McapError, zstandard.ZstdError, ValueError, KeyError, TypeError, AttributeError, struct.error)
_RECORD = struct.Struct("<BQ")  # opcode, length of the content
_MESSAGE = struct.Struct("<HxxxxQxxxxxxxx")  # channel, (sequence,) log time, (publish time)


def read_log(path: Path) -> Log:
    """Read a log; of one that was cut short or damaged, everything up to there, and `broken` says so.

    Raises:
        NoLogError: there is no such file, or it cannot be opened.
        LogError: the file is no MCAP, not one of ours, or ends before its first tick.
    """
    contents = _Contents()
    broken = ""
    try:
        with path.open("rb") as file:
            size = path.stat().st_size
            if size == 0:
                raise LogError(f"log {path}: the file is empty; run the trial again")
            if not MCAP0_MAGIC.startswith(file.read(len(MCAP0_MAGIC))):
                raise LogError(f'log {path}: not an MCAP file; give a log that "canine run" wrote')
            file.seek(0)
            whole = _Whole(file, size)
            try:
                for record in StreamReader(
                    cast("IO[bytes]", whole), emit_chunks=True, validate_crcs=True, record_size_limit=size
                ).records:
                    if isinstance(record, records.Header) and record.profile != PROFILE:
                        raise LogError(
                            f'log {path}: an MCAP file with profile "{record.profile}", expected '
                            f'"{PROFILE}"; give a log that "canine run" wrote'
                        )
                    contents.take(record)
            except EndOfFile:
                broken = f"the file ends early, at byte {size}"
            except DAMAGE:
                broken = f"the file is damaged before byte {size - whole.left}"
    except (FileNotFoundError, NotADirectoryError, IsADirectoryError, PermissionError) as error:
        hint = "" if path.exists() else nearest_file(path)
        raise NoLogError(f"log {path}: cannot be read ({error.strerror}){hint}") from error
    except OSError as error:
        raise LogError(f"log {path}: cannot be read ({error.strerror})") from error
    own = contents.metadata.pop(OWN_RECORD, {})
    origin = 0.0, 0.0
    try:
        origin = float(own.get("latitude", 0)), float(own.get("longitude", 0))
        contents.decode()  # messages outside chunks
    except DAMAGE:
        broken = broken or "a message or the origin is damaged"
    topics = list(contents.topics.values())
    ticks = min((sum(map(len, topic.values)) for topic in topics), default=0)
    if ticks == 0:
        what = broken or "it was closed"
        raise LogError(f"log {path}: no tick to read, {what} before the first; run the trial again")
    time = np.array(topics[0].times[:ticks], dtype=np.float64) / SECOND
    if broken:
        broken += f": the run was killed or the file was cut; its ticks up to {time[-1]:g} s are kept"
    broken = broken or contents.metadata.pop(END_RECORD, {}).get("reason", "")
    return Log(
        path,
        tuple(topic.channel for topic in topics),
        contents.metadata,
        contents.attachments,
        time,
        {topic.channel.component: np.concatenate(topic.values)[:ticks] for topic in topics},
        origin,
        broken,
    )


def named(names: type[IntEnum], value: float) -> str:
    """The name of an enumeration's value, or the number that a foreign component gave instead."""
    return names(int(value)).name if value in set(names) else f"{value:g}"
