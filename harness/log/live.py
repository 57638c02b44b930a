"""The topics of a log while they are written, for viewers such as Foxglove and Lichtblick.

Viewers connect to a WebSocket on this machine, by foxglove-sdk's protocol `foxglove.sdk.v1`. What they are
sent are the messages of the log, with their times in it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from types import TracebackType
from typing import Any, Self

from mcap import records

from harness.addresses import LOCALHOST
from harness.log.channel import SECOND
from models.errors import UsageError

POLL_S = 0.05
AGAIN_S = 1.0  # between two times that the same scene is sent
LASTING = ("/3d/scene",)  # topics whose last message holds until the next


class Pace:
    """Trial time by the clock, at a speed, from the first moment on that is kept."""

    def __init__(self, speed: float = 1.0) -> None:
        self._speed = speed
        self._began: float | None = None

    @property
    def now(self) -> float:
        """The trial's time, s; 0 before it begins."""
        return 0.0 if self._began is None else (time.monotonic() - self._began) * self._speed

    def keep(self, moment: float) -> None:
        """Wait until a moment of the trial [s] has come."""
        if self._began is None:
            self._began = time.monotonic() - moment / self._speed
        if (left := (moment - self.now) / self._speed) > 0:
            time.sleep(left)


class Viewers:
    """Sends what a log is given to all viewers that are connected; as a context manager it ends the server.

    Args:
        port: to listen on; 0 for any that is free, which `port` then has.
        pace: send each message when its time has come: for a trial that is computed faster than it happens.

    Raises:
        UsageError: foxglove-sdk is not installed, or nothing can listen there.
    """

    def __init__(self, port: int, *, pace: Pace | None = None) -> None:
        try:
            import foxglove  # noqa: PLC0415 - an optional extra
        except ImportError:
            raise UsageError(
                "--foxglove needs foxglove-sdk, which is not installed; pip install 'guided-canine[foxglove]'"
            ) from None
        self._sdk: Any = foxglove
        self._context = foxglove.Context()
        self._channels: dict[int, Any] = {}
        self._lasting: dict[int, tuple[bytes, int] | None] = {}  # by topic: the last message, and its time
        self._again = time.monotonic() + AGAIN_S
        self._pace = pace
        try:
            self._server: Any = foxglove.start_server(
                name="Guided Canine", host=LOCALHOST, port=port, context=self._context
            )
        except RuntimeError as error:
            raise UsageError(f"--foxglove {port}: cannot listen on {LOCALHOST}:{port} ({error})") from error
        self.port: int = self._server.port

    @property
    def address(self) -> str:
        """What a viewer opens."""
        return f"ws://localhost:{self.port}"

    def wait(self) -> None:
        """Wait until a viewer asks for a topic."""
        while not any(channel.has_sinks() for channel in self._channels.values()):
            time.sleep(POLL_S)

    def add_channel(self, channel: records.Channel, schema: records.Schema) -> None:
        """A topic of the log, before its first message."""
        if channel.topic in LASTING:
            self._lasting[channel.id] = None
        stated = self._sdk.Schema(name=schema.name, encoding=schema.encoding, data=schema.data)
        self._channels[channel.id] = self._sdk.Channel(
            channel.topic, schema=stated, message_encoding=channel.message_encoding, context=self._context
        )

    def send(self, channels: Sequence[int], times: Sequence[int], messages: Sequence[bytes]) -> None:
        """Messages in the order of their times, ns."""
        for number, moment, message in zip(channels, times, messages, strict=True):
            if self._pace is not None:
                self._pace.keep(moment / SECOND)
            if number in self._lasting:
                self._lasting[number] = message, moment
            self._channels[number].log(message, log_time=moment)
        if time.monotonic() >= self._again:
            self._say_again()

    def _say_again(self) -> None:
        """Send the scene to viewers that came since it was drawn, too.

        foxglove-sdk could tell when one comes, but from a thread of its own that may wait for this one.
        """
        self._again = time.monotonic() + AGAIN_S
        for number, last in self._lasting.items():
            if last is not None:
                message, moment = last
                self._channels[number].log(message, log_time=moment)

    def close(self) -> None:
        """End the server."""
        self._server.stop()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


@contextmanager
def viewers_at(
    port: int | None, note: Callable[[str], None], *, pace: Pace | None = None
) -> Iterator[Viewers | None]:
    """Viewers at a port, with a note of their address; None without one. Raises UsageError as `Viewers`."""
    if port is None:
        yield None
        return
    with Viewers(port, pace=pace) as viewers:
        begin = "; the trial begins when one of them asks for a topic" if pace else ""
        note(f"Foxglove and Lichtblick open {viewers.address}{begin}")
        yield viewers
