"""What a browser is shown: the same of a station at work and of a log that is played."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from importlib.metadata import version
from typing import Any, Protocol

from harness.station.conduct import HOLD_S, NOTE_CHARS
from harness.station.desk import ALIVE_S
from harness.station.events import Event
from models.cmec import MAX_WAYPOINTS
from models.commands import Command, Status
from models.fence import MAX_CORNERS
from models.modes import Anomaly, Mode

MESSAGE_BYTES = 65536  # of a browser's message, at most
MESSAGES_PER_S = 50
LIMITS = {
    "message_bytes": MESSAGE_BYTES,
    "messages_per_s": MESSAGES_PER_S,
    "waypoints": MAX_WAYPOINTS,
    "corners": MAX_CORNERS,
    "note_chars": NOTE_CHARS,
    "hold_s": HOLD_S,
    "alive_s": ALIVE_S,
}
ENUMS: Mapping[str, type[IntEnum]] = {"command": Command, "mode": Mode, "status": Status, "anomaly": Anomaly}
TRACK = (
    "time", "latitude", "longitude", "speed", "heading", "position_sd", "deviation", "distance", "command",
    "mode", "waypoint",
)  # fmt: skip


@dataclass(frozen=True)
class News:
    """What a look at the port brought.

    Attributes:
        state: to be shown to all; None if it is the same.
        events: that happened.
    """

    state: bytes | None
    events: tuple[Event, ...] = ()


class Shown(Protocol):
    """A station at work, or a log that is played."""

    def join(self, operator: int) -> list[bytes]:
        """An operator connects; the messages that it gets first."""

    def leave(self, operator: int) -> None:
        """An operator is gone."""

    def order(self, operator: int, order: dict[str, Any]) -> None:
        """Carry out an order. Raises OrderError."""

    def poll(self) -> News:
        """Look what has come; called a hundred times a second."""

    def close(self) -> None:
        """The end."""


def hello(operator: int, **facts: Any) -> dict[str, Any]:
    """The first message to a browser."""
    enums = {name: [member.name for member in kind] for name, kind in ENUMS.items()}
    first = {"is": "hello", "version": version("guided-canine"), "you": operator}
    return first | {"limits": LIMITS, "enums": enums} | facts


def event_message(event: Event) -> dict[str, Any]:
    """An event as a browser gets it."""
    return {"is": "event", "time": event.time, "level": event.level, "text": event.text}
