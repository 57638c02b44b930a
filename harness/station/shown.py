"""What a browser is shown: of a station at work, of a log that is played, of a trial that runs."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from importlib.metadata import version
from typing import Any, Protocol

import orjson

from codegen.firmware.telemetry import Telemetry
from harness.log.geodesy import TangentPlane
from harness.log.ground import Ground
from harness.onboard.tones import commands
from harness.station.conduct import HOLD_S, NOTE_CHARS
from harness.station.desk import ALIVE_S
from harness.station.events import Event
from harness.station.history import History
from harness.station.readings import position_of, values_of
from models.cmec import MAX_WAYPOINTS
from models.commands import Command, Status
from models.fence import MAX_CORNERS
from models.modes import Anomaly, Mode

POLL_S = 0.01  # s between two looks at the port
SHOW_S = 0.04  # s between two states that are shown, at least
IDLE_S = 0.2  # and at most
PATIENCE_S = 3.0  # s after which a browser that hears nothing takes the station for lost
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
    "silent_s": PATIENCE_S,
}
THRESHOLDS = (
    "moving_deviation",
    "stop_deviation",
    "capture_radius",
    "stopped_speed",
    "stop_hold",
    "turn_timeout",
    "max_turns",
    "reset_turns",
)
ENUMS: Mapping[str, type[IntEnum]] = {"command": Command, "mode": Mode, "status": Status, "anomaly": Anomaly}
CUES = "command_module."
EVENTS = 500  # the last ones, that who joins late is told
TRACK = (
    "time", "latitude", "longitude", "speed", "heading", "position_sd", "deviation", "distance", "command",
    "mode", "waypoint",
)  # fmt: skip
World = dict[str, list[Any]]


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
    """A station at work, a log that is played, or a trial that runs."""

    def join(self, operator: int) -> list[bytes]:
        """An operator connects; the messages that it gets first."""

    def leave(self, operator: int) -> None:
        """An operator is gone."""

    def order(self, operator: int, order: dict[str, Any]) -> Sequence[bytes]:
        """Carry out an order; the messages that answer it. Raises OrderError."""

    def poll(self) -> News:
        """Look what has come; called each POLL_S."""


class Refresh:
    """When a state is shown: each IDLE_S at least, and if it is `stale` each SHOW_S.

    Attributes:
        stale: what is shown is no longer so.
    """

    def __init__(self) -> None:
        self.stale = True
        self._shown_at = -math.inf

    def is_due(self, now: float) -> bool:
        """Is it time to show a state?"""
        return now - self._shown_at >= (SHOW_S if self.stale else IDLE_S)

    def done(self, now: float) -> None:
        """A state is shown."""
        self.stale, self._shown_at = False, now


def welcome(
    operator: int, parameters: Mapping[str, str], track: History, events: Iterable[Event], **facts: Any
) -> list[bytes]:
    """The first messages to a browser: who it is and what holds, and what was.

    Args:
        parameters: of the vest, `component.name` to its value (SI), as text.
        track: rows of TRACK.
        events: in order; the last EVENTS are told.
        facts: further ones of `hello`.
    """
    hello = {
        "is": "hello",
        "version": version("guided-canine"),
        "you": operator,
        "limits": LIMITS,
        "enums": {name: [member.name for member in kind] for name, kind in ENUMS.items()},
        "thresholds": _thresholds(parameters),
        "cues": _cues(parameters),
    }
    last = [_as_json(event) for event in deque(events, EVENTS)]
    history = {"is": "history", "columns": track.columns(), "events": last}
    return [orjson.dumps(hello | facts), orjson.dumps(history)]


def finite(parameters: Mapping[str, str]) -> tuple[dict[str, str], int]:
    """Those of a log's parameters that `welcome` reads and that are finite; how many it reads are not."""
    thresholds = [f"controller.{name}" for name in THRESHOLDS]
    read = {name: value for name, value in parameters.items() if name.startswith(CUES) or name in thresholds}
    kept = {name: value for name, value in read.items() if _is_finite(value)}
    return kept, len(read) - len(kept)


def _is_finite(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False


def _thresholds(parameters: Mapping[str, str]) -> dict[str, float]:
    """What the controller decides by, as far as the parameters tell; SI."""
    stated = {name: parameters.get(f"controller.{name}") for name in THRESHOLDS}
    return {name: float(value) for name, value in stated.items() if value is not None}


def _cues(parameters: Mapping[str, str]) -> dict[str, dict[str, float | bool]]:
    """What the animal hears and feels of each command, by its name."""
    stated = {name.removeprefix(CUES): float(x) for name, x in parameters.items() if name.startswith(CUES)}
    return {
        command.name: {"tone_hz": tone, "vibrate_left": left, "vibrate_right": right}
        for (tone, left, right), command in commands(stated).items()
    }


def world_of(ground: Ground | None, origin: tuple[float, float]) -> World | None:
    """The world of a simulated animal as a browser draws it: `streets`, their outlines, and `poles`, in deg.

    Args:
        origin: latitude and longitude of north = east = 0, deg.
    """
    if ground is None:
        return None
    plane = TangentPlane(*map(math.radians, origin))
    streets = [[plane.place(*corner) for corner in outline] for outline in ground.outlines()]
    return {"streets": streets, "poles": [plane.place(*pole) for pole in ground.poles]}


def add_to(track: History, time: float, telemetry: Telemetry) -> None:
    """Add where the animal is, if that is known, and how it is led; `time` is that of the log, s."""
    if place := position_of(telemetry):
        latitude, longitude = place
        track.add(values_of(telemetry) | {"time": time, "latitude": latitude, "longitude": longitude})


def told(telemetry: Telemetry | None) -> dict[str, Any]:
    """What a state says of the last telemetry alone."""
    if telemetry is None:
        return {"telemetry": None, "place": None, "refusal": None}
    refusal = telemetry.refused
    return {
        "telemetry": values_of(telemetry),
        "place": position_of(telemetry),
        "refusal": refusal.words if refusal else None,
    }


def _as_json(event: Event) -> dict[str, Any]:
    return {"is": "event", "time": event.time, "level": event.level, "text": event.text}


def event_message(event: Event) -> bytes:
    """An event as a browser gets it."""
    return orjson.dumps(_as_json(event))


def error_message(text: str) -> bytes:
    """What went wrong, as a browser gets it."""
    return orjson.dumps({"is": "error", "text": text})
