"""The sink: all that passes at a station, in a log that a killed station leaves readable.

| topic | what |
|---|---|
| `/telemetry` | each telemetry as it was told, as `canine run --onboard` logs it |
| `/estimator`, `/controller` | what it says of these two, by the names that the log of a trial has |
| `/radio/received`, `/radio/sent` | every byte with its time |
| `/station/state` | what was shown |
| `/station/orders`, `/station/events` | what operators ordered and wrote; what happened |

A row stands at the telemetry's own time. Where one is missing the row before is repeated. Time follows the
vest's clock while the vest is heard, and else this machine's. It leaves out the jumps of either: millions of
rows would fill them, and a reader takes a hole for the end.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import orjson

from codegen.firmware.telemetry import FIELDS, Flag, Telemetry
from harness.files import make_folder
from harness.log.channel import SECOND, Channel
from harness.log.events import ENDS_A_TRIAL
from harness.log.geodesy import TangentPlane
from harness.log.live import Viewers
from harness.log.log import FILE, LogError
from harness.log.writer import LogWriter
from harness.onboard.radio import Mission
from harness.onboard.stand_in import Onboard
from harness.station.events import Event, Level
from harness.station.readings import position_of, values_of
from models.commands import Command, Status

REPORT_S = 0.2  # between two telemetries (watchdog.report_period)
LEAST_S = 0.001  # between two rows
LONGEST_S = 0.29  # between two rows; a report waits for two ticks at most
JUMP_S = 10.0  # by which a clock may run ahead: more is a jump
SILENT_S = 0.5  # s of this machine without telemetry after which the last row is repeated
FLUSH_S = 1.0
RECEIVED, SENT, STATE = "/radio/received", "/radio/sent", "/station/state"
ORDERS, EVENTS = "/station/orders", "/station/events"
OF_ORDER = ("do", "command", "text", "seen")  # what is written of an order, beside who gave it
SCHEMAS = {  # name, and the properties of a message; viewers know foxglove.Log
    RECEIVED: ("bytes", {"bytes": "string"}),
    SENT: ("bytes", {"bytes": "string"}),
    STATE: ("state", {"link": "string", "stop_latched": "boolean", "alarms": "array"}),
    ORDERS: ("order", {"operator": "integer", "do": "string"}),
    EVENTS: (
        "foxglove.Log",
        {
            "timestamp": "object",
            "level": "integer",
            "message": "string",
            "name": "string",
            "file": "string",
            "line": "integer",
        },
    ),
}
SEVERITY = {Level.ADVISORY: 2, Level.CAUTION: 3, Level.WARNING: 4}  # of foxglove.Log: info, warning, error
ESTIMATOR = {  # by the name in a trial's log: the field of the telemetry
    "speed": "speed",
    "heading": "heading",
    "north_sd": "position_sd",
    "east_sd": "position_sd",
    "speed_sd": "speed_sd",
}
CONTROLLER = ("command", "mode", "status", "waypoint", "distance", "deviation", "directional_commands")


def channels() -> tuple[Channel, Channel, Channel]:
    """Telemetry, estimator, controller: the signals of a station's log."""
    estimator = [("north", "m", "Real", "estimated position"), ("east", "m", "Real", "estimated position")]
    estimator += [
        (name, FIELDS[field].si, "Real", FIELDS[field].meaning) for name, field in ESTIMATOR.items()
    ]
    estimator.append(("valid", "", "Boolean", Flag.VALID.meaning))
    controller = [("start", "", "Boolean", Flag.STARTED.meaning)]
    controller.append(("override", "", "Integer", "the operator's command that this station sends"))
    controller.append(("link_ok", "", "Boolean", Flag.LINK_OK.meaning))
    for name in CONTROLLER:
        wire = FIELDS[name]
        controller.append((name, wire.si, "Real" if wire.si else "Integer", wire.meaning))
    controller.append(("anomaly", "", "Integer", "reported with this telemetry for the first time"))
    return (
        Onboard.channel(),
        _channel("estimator", "telemetry", estimator),
        _channel("controller", "telemetry", controller),
    )


def _channel(component: str, block: str, signals: list[tuple[str, str, str, str]]) -> Channel:
    names, units, types, meanings = zip(*signals, strict=True)
    return Channel(component, block, names, units, types, meanings)


class MovedLogError(LogError):
    """The log has no longer its name; it is written nevertheless."""


class Clock:
    """The time of the log: the vest's clock while the vest is heard, and else this machine's.

    Args:
        speed: trial time over this machine's, of a simulated vest.

    Attributes:
        jump: s by which the vest's clock jumped with the last telemetry; 0 if it did not.
    """

    def __init__(self, speed: float = 1.0) -> None:
        self._speed, self.jump = speed, 0.0
        self._log = self._now = 0.0  # the same moment by both clocks
        self._latest = 0.0  # s, of the times that were given: a telemetry may show that ours ran ahead
        self._session: int | None = None
        self._shift = 0.0  # s, of the log's time over the vest's

    def at(self, now: float) -> float:
        """The log's time at a time of this machine; it never goes back."""
        self._latest = max(self._latest, self._ours(now))
        return self._latest

    def _ours(self, now: float) -> float:
        return self._log + max(0.0, now - self._now) * self._speed

    def leave_out(self, seconds: float) -> None:
        """This machine stood still for some time, which does not count."""
        self._now += seconds

    def follow(self, now: float, telemetry: Telemetry) -> float:
        """The log's time of a telemetry that comes now; it never goes back."""
        time, expected, self.jump = telemetry.time_ms / 1000, self._ours(now), 0.0
        if telemetry.session != self._session:
            self._session, self._shift = telemetry.session, expected - time
        ahead = time + self._shift - expected
        if time + self._shift < self._log or ahead > JUMP_S * max(self._speed, 1.0):
            self.jump, self._shift = ahead, expected - time
        self._log, self._now = time + self._shift, now
        return self._log


class Sink:
    """Writes a station's log.

    Args:
        folder: it is made if need be; an earlier log in it is replaced.
        metadata: of the log, by record; `parameters` are those of the vest, if they are known.
        speed: trial time over this machine's, of a simulated vest.
        origin: latitude and longitude of north = east = 0 in degrees; None for the first fix.
        viewers: who are shown what is logged.

    Attributes:
        unknown: id of the mission that was begun with the last telemetry, if its places are not known here.

    Raises:
        UsageError: the folder cannot be made.
        MovedLogError: once, if the log was moved, removed or replaced; all is written nevertheless.
        LogError: from every method, if the log cannot be written.
    """

    def __init__(
        self,
        folder: Path,
        metadata: Mapping[str, Mapping[str, str]],
        *,
        speed: float = 1.0,
        origin: tuple[float, float] | None = None,
        viewers: Viewers | None = None,
    ) -> None:
        make_folder(folder)
        self.path, self.clock = folder / FILE, Clock(speed)
        self._speed = speed
        self._parameters = dict(metadata.get("parameters", {}))
        versions = {"guided-canine": version("guided-canine"), "numpy": version("numpy")}
        self._writer = LogWriter(
            self.path,
            channels(),
            origin=origin or (0.0, 0.0),
            metadata={"versions": versions, **metadata},
            attachments={},
            viewers=viewers,
        )
        self._file, self._is_moved = self.path.stat(), False
        self._topics = {topic: self._writer.add_topic(topic, *stated) for topic, stated in SCHEMAS.items()}
        self._messages: list[tuple[int, float, bytes]] = []
        self._rows: list[tuple[float, dict[str, list[float]]]] = []
        self.origin: tuple[float, float] | None = None
        self._plane: TangentPlane | None = None
        if origin:
            self._plane_at(origin)
        self._before: Telemetry | None = None
        self._mission: Mission | None = None  # on board, and not stated yet
        self._stated: int | None = None  # id of the mission that is stated
        self.unknown: int | None = None
        self._is_led = False  # a mission was begun
        self._last = 0.0  # s, of the last row
        self._row = self._values(None, Command.NONE)
        self._write_row(0.0, self._row)
        self._write_row(REPORT_S, self._row)  # a reader takes a step much longer than this for a hole
        self._flushed = 0.0

    def receive(self, now: float, data: bytes) -> None:
        """Bytes came by radio."""
        self._write(RECEIVED, self.clock.at(now), {"bytes": data.hex()})

    def send(self, now: float, data: bytes) -> None:
        """Bytes went by radio."""
        self._write(SENT, self.clock.at(now), {"bytes": data.hex()})

    def order(self, now: float, operator: int, order: Mapping[str, Any]) -> None:
        """An operator ordered something."""
        stated = {name: order[name] for name in OF_ORDER if isinstance(order.get(name), str | int | float)}
        self._write(ORDERS, self.clock.at(now), {"operator": operator, **stated})

    def show(self, now: float, state: bytes) -> None:
        """A state was shown, JSON."""
        self._messages.append((self._topics[STATE], self.clock.at(now), state))

    def event(self, event: Event) -> None:
        """Something happened."""
        seconds, rest = divmod(round(event.time * SECOND), SECOND)
        stamp = {"sec": seconds, "nsec": rest}
        what = {"level": SEVERITY[event.level], "message": event.text, "name": "station"}
        self._write(EVENTS, event.time, {"timestamp": stamp, **what, "file": "", "line": 0})

    def tell(self, now: float, telemetry: Telemetry, override: Command) -> None:
        """A telemetry that can be believed: a row, and the rows that are missing before it."""
        time = max(self.clock.follow(now, telemetry), self._last + LEAST_S)
        if self._plane is None and (place := position_of(telemetry)):
            self._plane_at(place)
            self._settle()
        self._fill(time)
        self._row = self._values(telemetry, override)
        self._write_row(time, self._row)
        self._row["controller"][-1] = 0.0  # an anomaly is reported once
        self._lead(telemetry)
        self._before = telemetry

    def take_mission(self, mission: Mission) -> None:
        """A mission is on board. Once one was begun, another is stated when it begins."""
        self._mission = mission
        if not self._is_led:
            self._state_mission(mission)

    def step(self, now: float) -> None:
        """Repeat the last row while the vest is silent; flush each second."""
        time = self.clock.at(now)
        if time - self._last > SILENT_S * max(self._speed, 1.0):
            self._fill(time)
        if now - self._flushed >= FLUSH_S:
            self._flushed = now
            self.flush()

    def flush(self) -> None:
        """Hand all so far to the operating system."""
        self._flush_rows()
        self._writer.write_messages(self._messages)
        self._messages = []
        self._writer.flush()
        if not self._is_moved and not self._is_there():
            self._is_moved = True
            raise MovedLogError(
                f"log {self.path}: was moved, removed or replaced; what was moved is written on. "
                "Start the station again when the mission has ended"
            )

    def _is_there(self) -> bool:
        """Is the file of this name still the one that is written?"""
        try:
            return os.path.samestat(self._file, self.path.stat())
        except FileNotFoundError:
            return False
        except OSError:  # a share that does not answer now says nothing of it
            return True

    def close(self) -> None:
        """Write what is left, and the log's end."""
        try:
            self.flush()
        finally:
            self._writer.close()

    def _plane_at(self, place: tuple[float, float]) -> TangentPlane:
        """The plane of north and east; this place, deg, becomes its origin if there is none yet."""
        if self._plane is None:
            self.origin, self._plane = place, TangentPlane(*map(math.radians, place))
        return self._plane

    def _lead(self, telemetry: Telemetry) -> None:
        """State the mission that is under way, if it is the one on board; it may be another station's."""
        self.unknown = None
        if Flag.STARTED not in Flag(telemetry.flags):
            return
        self._is_led = True
        led, before = telemetry.mission_id, self._before
        if self._mission and self._mission.id == led:
            self._state_mission(self._mission)
        was_led = before and Flag.STARTED in Flag(before.flags) and before.mission_id == led
        if not was_led and self._stated != led:
            self.unknown = led

    def _state_mission(self, mission: Mission) -> None:
        """State waypoints, home and fence as parameters of the controller."""
        plane = self._plane_at((mission.home.latitude, mission.home.longitude))
        self._parameters |= mission_parameters(mission, plane)
        self._mission, self._stated = None, mission.id
        self._flush_rows()
        self._settle()

    def _settle(self) -> None:
        """State the origin and the mission, which became known on the way."""
        assert self.origin is not None
        self._writer.settle(self.origin, self._parameters)

    def _fill(self, until: float) -> None:
        """Repeat the last row, so that no step up to a time is longer than LONGEST_S."""
        while until - self._last > LONGEST_S:
            self._write_row(self._last + REPORT_S, self._row)

    def _values(self, telemetry: Telemetry | None, override: Command) -> dict[str, list[float]]:
        """A row, by component; zeros before the first telemetry, but for the position, which is not known."""
        or_zeros = telemetry or Telemetry(*[0] * len(FIELDS))
        numbers, flags = values_of(or_zeros), Flag(or_zeros.flags)
        north = east = math.nan
        if telemetry and self._plane and Flag.FIXED in flags:
            north, east = self._plane.to_plane(numbers["latitude"], numbers["longitude"])
        estimator = [north, east, *(numbers[field] for field in ESTIMATOR.values()), Flag.VALID in flags]
        controller: list[float] = [Flag.STARTED in flags, override, Flag.LINK_OK in flags]
        controller += [numbers[name] for name in CONTROLLER]
        controller.append(self._anomaly(telemetry) if telemetry else 0)
        rows: dict[str, list[float]] = {
            "telemetry": list(numbers.values()),
            "estimator": estimator,
            "controller": controller,
        }
        return {name: [float(value) for value in row] for name, row in rows.items()}

    def _anomaly(self, told: Telemetry) -> int:
        """What the controller noticed since the telemetry before, as far as that is told."""
        before = self._before
        ends = told.status == Status.STOPPED and (before is None or before.status != Status.STOPPED)
        if ends and told.last_anomaly in ENDS_A_TRIAL:
            return told.last_anomaly
        if before is None or before.session != told.session or told.last_anomaly != before.last_anomaly:
            return told.last_anomaly
        return told.anomaly if told.anomaly != before.anomaly else 0

    def _write_row(self, time: float, row: dict[str, list[float]]) -> None:
        self._rows.append((time, {name: list(values) for name, values in row.items()}))
        self._last = time

    def _flush_rows(self) -> None:
        if self._rows:
            times = np.array([time for time, _ in self._rows])
            self._writer.write_rows(
                times, {name: np.array([row[name] for _, row in self._rows]) for name in self._row}
            )
            self._rows = []

    def _write(self, topic: str, time: float, content: Mapping[str, Any]) -> None:
        self._messages.append((self._topics[topic], time, orjson.dumps(content)))


def mission_parameters(mission: Mission, plane: TangentPlane) -> dict[str, str]:
    """A mission as the parameters of a controller, as the log of a trial states them."""
    places = {"home": [mission.home], "waypoint": mission.waypoints, "fence": mission.fence}
    numbers: dict[str, float] = {
        "waypoint_count": len(mission.waypoints),
        "fence_count": len(mission.fence),
    }
    for kind, positions in places.items():
        for i, position in enumerate(positions, 1):
            at = "" if kind == "home" else f"[{i}]"
            north, east = plane.to_plane(math.radians(position.latitude), math.radians(position.longitude))
            numbers |= {f"{kind}_north{at}": float(north), f"{kind}_east{at}": float(east)}
    return {f"controller.{name}": repr(value) for name, value in numbers.items()}
