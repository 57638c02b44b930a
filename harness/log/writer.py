"""Writing the log of a run: batches of rows to chunks of an MCAP file.

A chunk is flushed after the first tick, then with the last tick of every second of trial time: whatever ends
the process, all but the last second of the batches that were handed over is on disk.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self

import numpy as np
from mcap.well_known import MessageEncoding, SchemaEncoding

from harness.interrupts import held_interrupts
from harness.log.arrived import receiver
from harness.log.channel import SECOND, Array, Channel
from harness.log.container import Container, Times
from harness.log.ground import Ground
from harness.log.log import (
    CHECK_RECORD,
    END_RECORD,
    FORMAT,
    LATE_RECORD,
    OWN_RECORD,
    PROFILE,
    LogError,
    checksums,
)
from harness.log.route import Route
from harness.log.rows import Rows

if TYPE_CHECKING:
    from harness.log.live import Viewers

MEDIA_TYPE = "application/octet-stream"


class LogWriter:
    """Writes a run, some ticks at a time; as a context manager, an exception ends the log with its text.

    Args:
        path: the file, replaced if it is there.
        channels: the components, in the order they are to be listed.
        origin: latitude and longitude of north = east = 0, in degrees.
        metadata: records by name (`scenario`, `parameters`, `roles`, `versions`): text to text. The waypoints
            that are drawn come from `parameters`: `controller.waypoint_north[1]` and so on, in SI units.
            So do streets and poles: `plant.street_north[1]`.
        attachments: files by name, the .ssp.
        viewers: who are sent what is written, too.

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
        viewers: Viewers | None = None,
    ) -> None:
        self.path, self._viewers = path, viewers
        try:
            self._file = path.open("wb")
        except OSError as error:
            raise self._failure(error) from error
        try:
            self._begin(channels, origin, metadata, attachments)
        except BaseException as error:
            self._discard()
            if isinstance(error, OSError):
                raise self._failure(error) from error
            raise
        self._last = np.array([0])  # tick, ns
        self._second = np.array([-1])  # the last one that had a tick
        self._open = True

    def _begin(
        self,
        channels: Sequence[Channel],
        origin: tuple[float, float],
        metadata: Mapping[str, Mapping[str, str]],
        attachments: Mapping[str, bytes],
    ) -> None:
        """Write what comes before the first tick, through to the file."""
        from harness.log.foxglove import Views  # noqa: PLC0415 (protobuf: readers do without)

        self._container = Container(self._file, PROFILE, self._viewers)
        own = {"format": FORMAT, "latitude": repr(origin[0]), "longitude": repr(origin[1])}
        records = {OWN_RECORD: own, **metadata}
        for name, values in {**records, CHECK_RECORD: checksums(records, attachments)}.items():
            self._container.add_metadata(name, values)
        for name, data in attachments.items():
            self._container.add_attachment(name, MEDIA_TYPE, data)
        self._channels = [self._add(channel) for channel in channels]
        self._rows = Rows(channels)
        signals = {channel.component: channel.names for channel in channels}
        parameters, gps = metadata.get("parameters", {}), receiver(channels, metadata)
        route, ground = Route.of(parameters), Ground.of(parameters)
        self._views = Views(self._container, signals, origin, route, receiver=gps, ground=ground)
        self._file.flush()

    def _add(self, channel: Channel) -> int:
        schema = self._container.add_schema(channel.block, SchemaEncoding.JSONSchema, channel.schema())
        stated = {"component": channel.component, "block": channel.block}
        return self._container.add_channel(f"/{channel.component}", MessageEncoding.JSON, schema, stated)

    def add_topic(self, topic: str, schema: str, properties: Mapping[str, str]) -> int:
        """A topic of JSON messages beside the rows; its channel.

        Args:
            schema: its name, by which viewers know it.
            properties: of a message, by name their types in JSON Schema.
        """
        described = {name: {"type": kind} for name, kind in properties.items()}
        description = json.dumps({"title": schema, "type": "object", "properties": described}).encode()
        number = self._container.add_schema(schema, SchemaEncoding.JSONSchema, description)
        return self._container.add_channel(topic, MessageEncoding.JSON, number)

    def write_messages(self, messages: Sequence[tuple[int, float, bytes]]) -> None:
        """Write messages of such topics: channel, time in s, JSON. They are on disk with the next `flush`.

        Raises:
            LogError: the file cannot be written.
        """
        if messages:
            channels, times, data = zip(*messages, strict=True)
            moments = np.rint(np.array(times) * SECOND).astype(np.int64)
            try:
                self._container.add_messages(channels, moments, data)
            except OSError as error:
                raise self._failure(error) from error

    def settle(self, origin: tuple[float, float], parameters: Mapping[str, str]) -> None:
        """State the origin and parameters that became known on the way; the last statement holds.

        Raises:
            LogError: the file cannot be written.
        """
        late = {"latitude": repr(origin[0]), "longitude": repr(origin[1]), **parameters}
        try:
            self._container.add_metadata(LATE_RECORD, late)
        except OSError as error:
            raise self._failure(error) from error
        self._views.settle(origin, Route.of(parameters))

    def flush(self) -> None:
        """Hand all that was written to the operating system.

        Raises:
            LogError: the file cannot be written.
        """
        try:
            self._container.flush()
        except OSError as error:
            raise self._failure(error) from error

    def write_rows(self, times: Array, values: Mapping[str, Array]) -> None:
        """Write a batch of ticks.

        Args:
            times: (n,) in s, 0 or more, growing from batch to batch too.
            values: by component (n, signals), in the order of its channel.

        Raises:
            LogError: the file cannot be written.
        """
        if not len(times):
            return
        moments = np.rint(times * SECOND).astype(np.int64)
        before = np.concatenate([self._last, moments])
        following = 2 * moments - before[:-1]  # when the tick after each will be
        seconds = np.concatenate([self._second, following // SECOND])
        ends = moments[seconds[1:] > seconds[:-1]]  # the last tick of a second
        self._last, self._second = before[-1:], seconds[-1:]
        try:
            self._container.add_messages(*self._messages(moments, values), ends)
        except OSError as error:
            raise self._failure(error) from error

    def _messages(self, times: Times, values: Mapping[str, Array]) -> tuple[list[int], Times, list[bytes]]:
        """Channels, log times and messages of a batch of ticks."""
        messages = self._rows.encode(values)
        channels, moments = self._channels * len(times), times.repeat(len(self._channels))
        if views := self._views.encode(times, values):
            of_views, at, data = zip(*views, strict=True)
            channels += of_views
            moments = np.concatenate([moments, at])
            messages += data
        return channels, moments, messages

    def close(self) -> None:
        """Write the last chunk and the index. Closing twice does no harm."""
        with held_interrupts():
            if not self._open:
                return
            self._open = False
            try:
                with self._file:
                    self._container.finish()
            except OSError as error:
                raise self._failure(error) from error

    def abort(self, reason: str) -> None:
        """Close a log whose run a fault has ended; `Log.broken` gives a reader the `reason`.

        A log without a tick, which nobody could read, is removed.
        """
        with held_interrupts():
            if self._open and self._second[0] < 0:
                self._discard()
            if self._open:
                with suppress(OSError):  # a full disk must not hide the fault that ended the run
                    self._container.flush()
                    self._container.add_metadata(END_RECORD, {"reason": reason})
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

    def _discard(self) -> None:
        """Remove the file, in which no tick is yet."""
        self._open = False
        with suppress(OSError):
            self._file.close()
        with suppress(OSError):
            if self.path.is_file():  # no device
                self.path.unlink()

    def _failure(self, error: OSError) -> LogError:
        return LogError(
            f"log {self.path}: cannot be written ({error.strerror}); "
            "make room, or choose another folder with --out"
        )
