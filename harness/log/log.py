"""The log of a run: an MCAP file that viewers open, that outlives a killed run and reads back bit for bit.

One topic per component, `/plant` and so on, holds its whole signal set as JSON, one message a tick; its JSON
Schema carries each signal's type, unit and meaning. `harness.foxglove` adds the topics that viewers draw.
Log time and publish time are trial time in ns: nothing comes from a clock, and the same run writes the same
bytes. Reals are spelled with the fewest digits that read back to the same bits. JSON has no NaN and no
infinities: they are the strings "NaN", "Infinity" and "-Infinity" (as in protobuf's JSON), and every NaN
reads back as the one quiet NaN.

A chunk is flushed after the first tick, then with the last tick of every second of trial time (the last of a
batch as the loop hands them over): whatever ends the process, all but the last second is on disk.
"""

from __future__ import annotations

import json
import math
from array import array
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import IO, TYPE_CHECKING, Any, Self, cast

import numpy as np
import numpy.typing as npt
import zstandard
from mcap import records
from mcap.exceptions import EndOfFile, McapError
from mcap.stream_reader import StreamReader
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import MCAP0_MAGIC, Writer

from harness.log.foxglove import SECOND, Route, Views
from models.errors import CanineError, UsageError, nearest

if TYPE_CHECKING:
    import pandas

PROFILE = "guided-canine"  # in the header of every log: what tells ours from others
FORMAT = "1"
OWN_RECORD = "log"  # metadata of the log itself: format and origin
END_RECORD = "ended"  # metadata of a run that a fault ended
JSON_TYPES = {"Real": "number", "Integer": "integer", "Boolean": "boolean"}
TYPES = {json_type: name for name, json_type in JSON_TYPES.items()}
MEDIA_TYPE = "application/octet-stream"
CHUNK_SIZE = 64 << 20  # bytes, never reached: chunks are ended by time
MAX_TEXTS = 4096  # spelled values that a column type keeps, which bounds the memory

Array = npt.NDArray[np.float64]


class LogError(CanineError):
    """A log cannot be written, or a file cannot be read as a log."""


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


class _Texts(dict[float, str]):
    """Spelled values. Most signals hold their value or repeat another's, and spelling a real costs most."""

    def __init__(self, spell: Callable[[float], str]) -> None:
        super().__init__()
        self.spell = spell

    def __missing__(self, value: float) -> str:
        text = self.spell(value)
        if value > 0 or value < 0:  # 0.0 and -0.0 are one key, and a NaN is none
            if len(self) >= MAX_TEXTS:
                self.clear()
            self[value] = text
        return text


def _spell_real(value: float) -> str:
    if value - value == 0:  # finite
        return float.__repr__(float(value))
    return '"NaN"' if math.isnan(value) else '"Infinity"' if value > 0 else '"-Infinity"'


class _Rows:
    """Writes the rows of one component."""

    def __init__(self, writer: Writer, channel: Channel, texts: Mapping[str, _Texts]) -> None:
        self.writer = writer
        schema = writer.register_schema(channel.block, SchemaEncoding.JSONSchema, channel.schema())
        held_as = {"component": channel.component, "block": channel.block}
        self.channel = writer.register_channel(f"/{channel.component}", MessageEncoding.JSON, schema, held_as)
        keys = (json.dumps(name).replace("%", "%%") for name in channel.names)
        self.template = "{" + ",".join(f"{key}:%s" for key in keys) + "}"
        self.texts = [texts[kind] for kind in channel.types]

    def write(self, time: int, row: Sequence[float]) -> None:
        values = [texts[value] for texts, value in zip(self.texts, row, strict=True)]
        self.writer.add_message(self.channel, time, (self.template % tuple(values)).encode(), time)


class LogWriter:
    """Writes a run, tick by tick; as a context manager, an exception ends the log with its text.

    Args:
        path: the file, replaced if it is there.
        channels: the components, in the order they are to be listed.
        origin: latitude and longitude of north = east = 0, in degrees.
        metadata: records by name (`scenario`, `parameters`, `roles`, `versions`): text to text. The waypoints
            that are drawn come from `parameters`: `controller.waypoint_north[1]` and so on, in SI units.
        attachments: files by name, the .ssp.

    Raises:
        LogError: the file cannot be written.
    """

    def __init__(
        self,
        path: Path,
        channels: Sequence[Channel],
        *,
        origin: tuple[float, float],
        metadata: Mapping[str, Mapping[str, str]],
        attachments: Mapping[str, bytes],
    ) -> None:
        self.path = path
        try:
            self._file = path.open("wb")
        except OSError as error:
            raise self._failure(error) from error
        self._writer: Any = Writer(self._file, chunk_size=CHUNK_SIZE)
        try:
            self._begin(channels, origin, metadata, attachments)
        except OSError as error:
            with suppress(OSError):
                self._file.close()
            with suppress(OSError):
                if self.path.is_file():  # no device; and nothing of the run is in it yet
                    self.path.unlink()
            raise self._failure(error) from error
        self._last, self._flush_due = 0, 0  # ns
        self._open = True

    def _begin(
        self,
        channels: Sequence[Channel],
        origin: tuple[float, float],
        metadata: Mapping[str, Mapping[str, str]],
        attachments: Mapping[str, bytes],
    ) -> None:
        """Write what comes before the first tick, through to the file."""
        self._writer.start(PROFILE, PROFILE)
        own = {"format": FORMAT, "latitude": repr(origin[0]), "longitude": repr(origin[1])}
        for name, values in {OWN_RECORD: own, **metadata}.items():
            self._writer.add_metadata(name, dict(values))
        for name, data in attachments.items():
            self._writer.add_attachment(0, 0, name, MEDIA_TYPE, data)
        texts = {
            "Real": _Texts(_spell_real),
            "Integer": _Texts(lambda value: repr(int(value))),
            "Boolean": _Texts(lambda value: "true" if value else "false"),
        }
        self._rows = [(c.component, _Rows(self._writer, c, texts)) for c in channels]
        signals = {channel.component: channel.names for channel in channels}
        self._views = Views(self._writer, signals, origin, Route.of(metadata.get("parameters", {})))
        self._file.flush()

    def write(self, time: float, rows: Mapping[str, Sequence[float]]) -> None:
        """Write the tick at `time` (s, 0 or more, growing): each component's values in its channel's order.

        Raises:
            LogError: the file cannot be written.
        """
        nanoseconds = round(time * SECOND)
        try:
            for component, writer in self._rows:
                writer.write(nanoseconds, rows[component])
            self._views.write(nanoseconds, rows)
            following = 2 * nanoseconds - self._last  # when the next tick will be
            if following >= self._flush_due:
                self._writer.flush()
                self._flush_due = (following // SECOND + 1) * SECOND
            self._last = nanoseconds
        except OSError as error:
            raise self._failure(error) from error

    def close(self) -> None:
        """Write the last chunk and the index. Closing twice does no harm."""
        if not self._open:
            return
        self._open = False
        try:
            with self._file:
                self._writer.finish()
        except OSError as error:
            raise self._failure(error) from error

    def abort(self, reason: str) -> None:
        """Close a log whose run a fault has ended; `reason` is what a reader is told (`Log.broken`)."""
        if self._open:
            with suppress(OSError):  # a full disk must not hide the fault that ended the run
                self._writer.flush()
                self._writer.add_metadata(END_RECORD, {"reason": reason})
        with suppress(LogError):
            self.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is None or isinstance(error, LogError):
            self.close()
        else:
            self.abort(str(error) or type(error).__name__)

    def _failure(self, error: OSError) -> LogError:
        return LogError(
            f"log {self.path}: cannot be written ({error.strerror}); "
            "make room, or choose another folder with --out"
        )


@dataclass
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

        Reals are float64, where NaN stays NaN; Integers are int64, Booleans bool.
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
    """A signal, (ticks,), in the type that its channel states."""
    if kind == "Real" or not np.isfinite(column).all():
        return np.array(column)
    return column.astype(np.bool_ if kind == "Boolean" else np.int64)


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
    """One component's rows as they are read."""

    def __init__(self, channel: Channel) -> None:
        self.channel, self.time, self.values = channel, array("q"), array("d")

    def add(self, message: records.Message) -> None:
        row = json.loads(message.data)
        self.values.extend([float(row[name]) for name in self.channel.names])
        self.time.append(message.log_time)


def read_log(path: Path) -> Log:
    """Read a log; of one that was cut short or damaged, everything up to there, and `broken` says so.

    Raises:
        LogError: the file is not there, no MCAP, not one of ours, or ends before its first tick.
    """
    metadata: dict[str, dict[str, str]] = {}
    attachments: dict[str, bytes] = {}
    schemas: dict[int, records.Schema] = {}
    tables: dict[int, _Topic] = {}
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
                    cast("IO[bytes]", whole), validate_crcs=True, record_size_limit=size
                ).records:
                    match record:
                        case records.Header() if record.profile != PROFILE:
                            raise LogError(
                                f'log {path}: an MCAP file with profile "{record.profile}", expected '
                                f'"{PROFILE}"; give a log that "canine run" wrote'
                            )
                        case records.Metadata():
                            metadata[record.name] = record.metadata
                        case records.Attachment():
                            attachments[record.name] = record.data
                        case records.Schema():
                            schemas[record.id] = record
                        case records.Channel() if "component" in record.metadata and record.id not in tables:
                            held_as = record.metadata
                            schema = schemas[record.schema_id].data
                            channel = Channel.from_schema(held_as["component"], held_as["block"], schema)
                            tables[record.id] = _Topic(channel)
                        case records.Message() if record.channel_id in tables:
                            tables[record.channel_id].add(record)
            except EndOfFile:
                broken = f"the file ends early, at byte {size}"
            except (McapError, zstandard.ZstdError, ValueError, KeyError):
                broken = f"the file is damaged before byte {size - whole.left}"
    except OSError as error:
        raise LogError(f"log {path}: cannot be read ({error.strerror})") from error
    ticks = min((len(table.time) for table in tables.values()), default=0)
    if ticks == 0:
        what = broken or "it was closed"
        raise LogError(f"log {path}: no tick to read, {what} before the first; run the trial again")
    time = np.array(next(iter(tables.values())).time[:ticks], dtype=np.float64) / SECOND
    if broken:
        broken += f": the run was killed or the file was cut; its ticks up to {time[-1]:g} s are kept"
    own = metadata.pop(OWN_RECORD, {})
    broken = broken or metadata.pop(END_RECORD, {}).get("reason", "")
    return Log(
        path,
        tuple(table.channel for table in tables.values()),
        metadata,
        attachments,
        time,
        {t.channel.component: _values(t, ticks) for t in tables.values()},
        (float(own.get("latitude", 0)), float(own.get("longitude", 0))),
        broken,
    )


def _values(table: _Topic, ticks: int) -> Array:
    width = len(table.channel.names)
    return np.array(table.values[: ticks * width], dtype=np.float64).reshape(ticks, width)
