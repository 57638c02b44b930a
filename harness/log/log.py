"""The log of a run: an MCAP file that viewers open, that outlives a killed run and reads back bit for bit.

One topic per component, `/plant` and so on, holds its whole signal set as JSON, one message a tick; its JSON
Schema carries each signal's type, unit and meaning. `foxglove` adds the topics that viewers draw. Log time
and publish time are trial time in ns: nothing comes from a clock, and the same run writes the same bytes.
`rows` spells the values; every NaN reads back as the one quiet NaN. `writer` says when the file is flushed.
"""

from __future__ import annotations

import json
import math
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from io import BytesIO
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC

from harness.files import is_pipe, nearest_file
from harness.log.channel import SECOND, Array, Channel
from harness.log.contents import RECORD, UNREADABLE, Contents, DamageError
from harness.log.ground import Ground
from harness.log.route import Route
from models.errors import CanineError, UsageError, nearest, printable

if TYPE_CHECKING:
    import pandas

FILE = "trial.mcap"  # in the folder of a run
PROFILE = "guided-canine"  # in the header of every log: what tells ours from others
FORMAT = "2"  # "1" had no checksums of metadata and file; it is read too
OWN_RECORD = "log"  # metadata of the log itself: format and origin
CHECK_RECORD = "crc32"  # metadata with the checksums of the other metadata and the attachments
END_RECORD = "ended"  # metadata of a run that a fault ended
LATE_RECORD = "settled"  # metadata of what a run learned on its way, parameters and origin; the last holds
MAX_RECORD = 512 * 2**20  # bytes: an attached package is as large at most (MAX_BYTES in cosim/archive)


class LogError(CanineError):
    """A log cannot be written, or a file cannot be read as a log."""


class NoLogError(LogError, UsageError):
    """There is no file of this name that can be opened."""


@dataclass(repr=False)
class Log:
    """A run that was read back: `values[component]` is (ticks, signals), `time` (ticks,) in s.

    `log["plant.north"]` is one signal, (ticks,). `broken` says why the run is not whole, and is "" if it is;
    `damage` is "" too if a fault or the user ended the run and the file itself is whole.
    """

    path: Path
    channels: tuple[Channel, ...]
    metadata: dict[str, dict[str, str]]
    attachments: dict[str, bytes]
    time: Array
    values: dict[str, Array]
    origin: tuple[float, float] = (0.0, 0.0)
    broken: str = ""
    damage: str = ""
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
    def units(self) -> dict[str, str]:
        """The unit of each signal, by `component.signal`."""
        return {
            f"{channel.component}.{name}": unit
            for channel in self.channels
            for name, unit in zip(channel.names, channel.units, strict=True)
        }

    @property
    def route(self) -> Route | None:
        """The waypoints, if the controller has any."""
        return Route.of(self.metadata.get("parameters", {}))

    @property
    def ground(self) -> Ground | None:
        """Streets and poles, if there were any."""
        return Ground.of(self.metadata.get("parameters", {}))


def _typed(column: Array, kind: str) -> npt.NDArray[Any]:
    """A signal, (ticks,), in the type that its channel states, or float64 where that cannot hold it."""
    if kind == "Real" or not np.isfinite(column).all():
        return np.array(column)
    if kind == "Boolean":
        return column.astype(np.bool_)
    return np.array(column) if (np.abs(column) >= 2.0**63).any() else column.astype(np.int64)


def checksums(records: Mapping[str, Mapping[str, str]], attachments: Mapping[str, bytes]) -> dict[str, str]:
    """CRC-32 of what is known before the first tick, by name; MCAP gives metadata none.

    They are of the content, so a tool may lay out the file anew, and a run that was killed has them too.
    """
    content = {f"metadata {name}": json.dumps(v, sort_keys=True).encode() for name, v in records.items()}
    content |= {f"attachment {name}": data for name, data in attachments.items()}
    return {name: f"{zlib.crc32(data):08x}" for name, data in content.items()}


def log_of(path: Path) -> Path:
    """The log that a path names: itself, or the one in the folder of a run."""
    return path / FILE if path.is_dir() else path


def read_log(path: Path) -> Log:
    """Read a log; of one that was cut short or damaged, everything up to there, and `broken` says so.

    Every checksum is tested: of chunks and attachments, of the whole file where it was closed, and of each
    record before the first tick, without which nobody could say which run it is.

    Raises:
        NoLogError: there is no such file, or it cannot be opened.
        LogError: the file is no MCAP, not one of ours, ends before its first tick, or a record that says
            which run it is is damaged.
    """
    if is_pipe(path):
        raise NoLogError(f"log {path}: is no file")
    try:
        with path.open("rb") as file:
            size = path.stat().st_size
            contents = Contents(size)
            damage = read_records(path, file, size, contents)
    except (FileNotFoundError, NotADirectoryError, IsADirectoryError, PermissionError) as error:
        inside = sorted(path.glob("*.mcap")) if path.is_dir() else []
        hint = f'; did you mean "{inside[0]}"?' if inside else "" if path.exists() else nearest_file(path)
        raise NoLogError(f"log {path}: cannot be read ({error.strerror}){hint}") from error
    except OSError as error:
        raise LogError(f"log {path}: cannot be read ({error.strerror})") from error
    try:
        contents.decode()  # messages outside chunks
    except DamageError as what:
        damage = f"the file is damaged ({what})"
    ticks, complete = contents.ticks()
    if not complete:
        counts = ", ".join(
            f"{len(topic.times)} of {printable(name):.80}" for name, topic in contents.topics.items()
        )
        damage = damage or f"the file is damaged (not all components have the same ticks: {counts})"
    if not ticks:
        when = damage or "it was closed"
        raise LogError(f"log {path}: no tick to read, {when} before the first; run the trial again")
    origin = 0.0, 0.0
    own, late = _checked_head(path, contents), contents.metadata.pop(LATE_RECORD, {})
    try:
        origin = _origin({**own, **late})
    except ValueError:
        damage = damage or "the file is damaged (its origin is not a number)"
    time = np.array(ticks, dtype=np.float64) / SECOND
    if damage:
        damage += f"; its ticks up to {time[-1]:g} s are kept"
    reason = printable(contents.metadata.pop(END_RECORD, {}).get("reason", ""))
    if parameters := {name: value for name, value in late.items() if name not in _ORIGIN}:
        contents.metadata["parameters"] = contents.metadata.get("parameters", {}) | parameters
    topics = list(contents.topics.values())
    return Log(
        path,
        tuple(topic.channel for topic in topics),
        contents.metadata,
        contents.attachments,
        time,
        {topic.channel.component: np.concatenate(topic.values)[: len(ticks)] for topic in topics},
        origin,
        damage or reason,
        damage,
    )


_ORIGIN = ("latitude", "longitude")


def _origin(stated: Mapping[str, str]) -> tuple[float, float]:
    """Latitude and longitude of north = east = 0, in degrees.

    Raises:
        ValueError: one is not a finite number.
    """
    latitude, longitude = (float(stated.get(name, 0)) for name in _ORIGIN)
    if not (math.isfinite(latitude) and math.isfinite(longitude)):
        raise ValueError
    return latitude, longitude


def read_records(path: Path, file: IO[bytes], size: int, contents: Contents) -> str:
    """Read a file's records into `contents`; why they are not all, "" if they are.

    `contents.end` is then the place after the last record that is whole.

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
        head = file.read(RECORD.size)
        if len(head) < RECORD.size:
            return early
        opcode, length = RECORD.unpack(head)
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
                    raise DamageError(
                        f"the checksum over all before is {stated.hex()}, expected {actual.hex()}"
                    )
            else:
                contents.take(opcode, content)
        except DamageError as damage:
            return f"the file is damaged at byte {at} ({damage})"
        at += len(head) + length
        contents.end = at
        checksum = 0 if opcode == Opcode.DATA_END else zlib.crc32(content, zlib.crc32(head, checksum))
        ends += opcode == Opcode.DATA_END
        contents.is_complete |= opcode == Opcode.DATA_END
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
    except UNREADABLE:
        raise LogError(
            f"log {path}: no tick to read, the file is damaged at its first record, which is not a header; "
            "run the trial again"
        ) from None
    if profile != PROFILE:
        raise LogError(
            f'log {path}: an MCAP file with profile "{printable(profile):.80}", expected '
            f'"{PROFILE}"; give a log that "canine run" wrote'
        )


def _checked_head(path: Path, contents: Contents) -> dict[str, str]:
    """The log's own record, out of the metadata, once all that say which run it is are known to be whole.

    Raises:
        LogError: one is missing or damaged, or the format is not known.
    """
    late = (END_RECORD, LATE_RECORD)
    head = {name: values for name, values in contents.metadata.items() if name not in late}
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
