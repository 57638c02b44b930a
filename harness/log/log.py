"""The log of a run: an MCAP file that viewers open, that outlives a killed run and reads back bit for bit.

One topic per component, `/plant` and so on, holds its whole signal set as JSON, one message a tick; its JSON
Schema carries each signal's type, unit and meaning. `foxglove` adds the topics that viewers draw. Log time
and publish time are trial time in ns: nothing comes from a clock, and the same run writes the same bytes.
`rows` spells the values; every NaN reads back as the one quiet NaN. `writer` says when the file is flushed.
"""

from __future__ import annotations

import json
from array import array
from dataclasses import dataclass, field
from enum import IntEnum
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, cast

import numpy as np
import numpy.typing as npt
import zstandard
from mcap import records
from mcap.exceptions import EndOfFile, McapError
from mcap.stream_reader import StreamReader
from mcap.writer import MCAP0_MAGIC

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


def named(names: type[IntEnum], value: float) -> str:
    """The name of an enumeration's value, or the number that a foreign component gave instead."""
    return names(int(value)).name if value in set(names) else f"{value:g}"
