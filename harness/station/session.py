"""A station at work: a port, the conduct of a trial, and the sink."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from typing import Any

import orjson

from codegen.firmware.key import Key
from codegen.firmware.telemetry import Flag, Refusal, Telemetry
from harness.log.log import LogError
from harness.onboard.radio import Link, Mission, RadioError
from harness.onboard.tones import commands
from harness.station.alarms import Alarm, Alarms
from harness.station.conduct import Conduct
from harness.station.draft import Draft, as_json
from harness.station.events import Event, Level
from harness.station.history import History
from harness.station.ports import Port, PortError
from harness.station.shown import TRACK, News, event_message, hello
from harness.station.sink import Sink, values_of
from models.commands import Command
from models.errors import CanineError, UsageError

SHOW_S = 0.04  # s between two states that are shown, at least
IDLE_S = 0.5  # and at most
REOPEN_S = 2.0  # s between two tries to open a port that is gone
EVENTS = 500  # that are kept for who joins late
POLL_S = 0.01  # s between two looks at the port
THRESHOLDS = (
    "moving_deviation",
    "stop_deviation",
    "capture_radius",
    "stopped_speed",
    "stop_hold",
    "turn_timeout",
)


@dataclass(frozen=True)
class About:
    """What is known of a vest before it is heard.

    Attributes:
        source: where its bytes come from, in words.
        parameters: `component.name` to its value (SI), as text.
        mission: the scenario's own, of a simulated vest.
    """

    source: str
    parameters: Mapping[str, str]
    mission: Draft = field(default_factory=Draft)


class Session:
    """A station at work.

    Args:
        port: the vest's radio.
        key: of the vest; None for one that was built without.
        sink: what records it.
        about: what is known of the vest.
        reopen: opens the port anew once it is gone; None if it cannot be.
        clock: gives s that only grow.
    """

    def __init__(
        self,
        port: Port,
        key: Key | None,
        sink: Sink,
        about: About,
        *,
        reopen: Callable[[], Port] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.about = about
        self.conduct, self._alarms = Conduct(Link(key)), Alarms()
        self._port: Port | None = port
        self._reopen, self._clock, self._begun = reopen, clock, clock()
        self._sink: Sink | None = sink
        self._log_clock = sink.clock
        self._events: deque[Event] = deque(maxlen=EVENTS)
        self._new: list[Event] = []
        self._history = History(TRACK)
        self._dirty = True
        self._shown_at = 0.0
        self._recorded: Mission | None = None
        self._pool = ThreadPoolExecutor(1, "station-port")
        self._opening: Future[Port] | None = None
        self._failed_at = 0.0
        self._lost = ""  # why nothing is recorded any more
        self._held: str | None = None

    @property
    def now(self) -> float:
        """s since the station began."""
        return self._clock() - self._begun

    def join(self, operator: int) -> list[bytes]:
        """As `Shown`."""
        self.conduct.desk.join(operator)
        self._dirty = True
        first = hello(
            operator,
            commander=self.conduct.desk.commander,
            insecure=self.is_insecure,
            replay=None,
            thresholds=thresholds(self.about.parameters),
            cues=cues(self.about.parameters),
            source=self.about.source,
            scenario=as_json(self.about.mission) if self.about.mission.home else None,
        )
        events = [event_message(event) for event in self._events]
        past = {"is": "history", "columns": self._history.columns(), "events": events}
        return [orjson.dumps(first), orjson.dumps(past)]

    def leave(self, operator: int) -> None:
        """As `Shown`."""
        self.conduct.leave(self.now, operator)
        self._act(self.now)

    def order(self, operator: int, order: dict[str, Any]) -> None:
        """As `Shown`: it is carried out, and sent, at once."""
        now = self.now
        self.conduct.order(now, operator, order)
        if self._sink and self._is_worth_noting(order):
            self._record(lambda sink: sink.order(now, operator, order))
        self._act(now)

    def _is_worth_noting(self, order: Mapping[str, Any]) -> bool:
        """Signs of life, and the repetitions of a hold, would fill the log."""
        name = order["do"]
        held, self._held = self._held, order.get("command") if name == "hold" else self._held
        if name == "release":
            self._held = None
        return name not in ("alive", "draft") and not (name == "hold" and held == self._held)

    def poll(self) -> News:
        """As `Shown`."""
        now = self.now
        data = self._read(now)
        if data:
            self._record(lambda sink: sink.receive(now, data))
            for telemetry in self.conduct.receive(now, data):
                self._hear(now, telemetry)
        self._act(now)
        self._record(lambda sink: sink.step(now))
        events, self._new = tuple(self._new), []
        waited = now - self._shown_at
        if waited < SHOW_S or not (self._dirty or waited >= IDLE_S):
            return News(None, events)
        self._dirty, self._shown_at = False, now
        state = orjson.dumps(self.state(now))
        self._record(lambda sink: sink.show(now, state))
        return News(state, events)

    def _hear(self, now: float, telemetry: Telemetry) -> None:
        override = Command.STOP if self.conduct.latched else self.conduct.holding or Command.NONE
        self._record(lambda sink: sink.tell(now, telemetry, override))
        if Flag.FIXED in Flag(telemetry.flags):
            place = {"latitude": telemetry.latitude * 1e-7, "longitude": telemetry.longitude * 1e-7}
            self._history.add(values_of(telemetry) | place | {"time": self._log_clock.at(now)})
        self._dirty = True

    def _act(self, now: float) -> None:
        """Send what is due, and note what happened."""
        frames = self.conduct.step(now)
        if frames and self._port:
            self._record(lambda sink: sink.send(now, frames))
            try:
                self._port.write(frames)
            except PortError as reason:
                self._lose_port(now, reason)
        if self.conduct.on_board is not self._recorded:
            self._recorded = mission = self.conduct.on_board
            if mission:
                self._record(lambda sink: sink.take_mission(mission))
        for level, text in self.conduct.take_events():
            self._tell(now, level, text)

    def _tell(self, now: float, level: Level, text: str) -> None:
        event = Event(self._log_clock.at(now), level, text)
        self._events.append(event)
        self._new.append(event)
        self._dirty = True
        self._record(lambda sink: sink.event(event))

    def _record(self, write: Callable[[Sink], None]) -> None:
        """Write to the log. If it cannot be written the station goes on: the vest must be reached."""
        if self._sink is None:
            return
        try:
            write(self._sink)
        except LogError as reason:
            self._sink, self._lost = None, str(reason)
            self._tell(self.now, Level.WARNING, f"nothing is recorded any more: {reason}")

    def _read(self, now: float) -> bytes:
        if self._port is None:
            self._port = self._reopened(now)
        if self._port is None:
            return b""
        try:
            return self._port.read()
        except PortError as reason:
            self._lose_port(now, reason)
            return b""

    def _lose_port(self, now: float, reason: PortError) -> None:
        if self._port:
            self._port.close()
        self._port, self._failed_at = None, now
        self._tell(now, Level.WARNING, str(reason))

    def _reopened(self, now: float) -> Port | None:
        """The port, once it can be opened again; opening may take seconds, so another thread does it."""
        if self._reopen is None or now - self._failed_at < REOPEN_S:
            return None
        if self._opening is None:
            self._opening = self._pool.submit(self._reopen)
        if not self._opening.done():
            return None
        opening, self._opening, self._failed_at = self._opening, None, now
        with suppress(UsageError):
            port = opening.result()
            self._tell(now, Level.ADVISORY, "the port is there again")
            return port
        return None

    @property
    def is_insecure(self) -> bool:
        """Frames are not verified."""
        telemetry, key = self.conduct.telemetry, self.conduct.link.key
        return key is None or (telemetry is not None and Flag.INSECURE in Flag(telemetry.flags))

    def alarms(self, now: float) -> list[Alarm]:
        """What is wrong now."""
        alarms = self._alarms.at(now, self.conduct, self._log_clock.at(now))
        if self._lost:
            alarms.insert(0, Alarm("log", Level.WARNING, f"nothing is recorded: {self._lost}", 0.0))
        return alarms

    def state(self, now: float) -> dict[str, Any]:
        """What is shown, as harness/station/README.md lists it."""
        conduct, desk = self.conduct, self.conduct.desk
        telemetry = conduct.telemetry
        flags = Flag(telemetry.flags) if telemetry else Flag(0)
        refusal = telemetry.refused if telemetry else Refusal.NONE
        place = on_board = None
        if telemetry and Flag.FIXED in flags:
            place = [telemetry.latitude * 1e-7, telemetry.longitude * 1e-7]
        if telemetry and Flag.LOADED in flags:
            ours = conduct.on_board
            mission = as_json(Draft(ours.home, ours.waypoints, ours.fence)) if ours else None
            on_board = {"id": telemetry.mission_id, "mission": mission}
        return {
            "is": "state",
            "time": self._log_clock.at(now),
            "link": conduct.state(now),
            "telemetry": values_of(telemetry) if telemetry else None,
            "place": place,
            "missing": conduct.missing(now),
            "refusal": refusal.words if refusal else None,
            "draft": as_json(conduct.draft),
            "draft_id": conduct.draft_id,
            "on_board": on_board,
            "stop_latched": conduct.latched,
            "holding": conduct.holding.name if conduct.holding is not None else None,
            **conduct.pending(),
            "commander": desk.commander,
            "commander_alive": desk.lives(now),
            "offered": desk.offered,
            "operators": sorted(desk.operators),
            "link_quality": asdict(conduct.quality.at(now)),
            "alarms": [asdict(alarm) for alarm in self.alarms(now)],
        }

    def close(self) -> None:
        """End: a mission that is under way is aborted, for nobody would renew a STOP. Twice does no harm."""
        now = self.now
        if self._dirty:  # a replay ends as the screen would have
            self._record(lambda sink: sink.show(now, orjson.dumps(self.state(now))))
        for frames in self._last_frames():
            self._record(lambda sink, frames=frames: sink.send(now, frames))  # type: ignore[misc]
            if self._port:
                with suppress(PortError):
                    self._port.write(frames)
        self._pool.shutdown(wait=False, cancel_futures=True)
        if self._port:
            self._port.close()
        self._record(lambda sink: sink.close())
        self._sink = self._port = None

    def _last_frames(self) -> list[bytes]:
        if not self.conduct.is_under_way:
            return []
        try:
            return self.conduct.farewell()
        except RadioError:
            return []


def thresholds(parameters: Mapping[str, str]) -> dict[str, float]:
    """What the controller decides by, as far as the parameters tell; SI."""
    stated = {name: parameters.get(f"controller.{name}") for name in THRESHOLDS}
    return {name: float(value) for name, value in stated.items() if value is not None}


def cues(parameters: Mapping[str, str]) -> dict[str, dict[str, float | bool]]:
    """What the animal hears and feels of each command, by its name."""
    prefix = "command_module."
    stated = {
        name.removeprefix(prefix): float(x) for name, x in parameters.items() if name.startswith(prefix)
    }
    return {
        command.name: {"tone_hz": tone, "vibrate_left": left, "vibrate_right": right}
        for (tone, left, right), command in commands(stated).items()
    }


def failure(reason: CanineError) -> bytes:
    """An order that cannot be carried out, as a browser gets it."""
    return orjson.dumps({"is": "error", "text": str(reason)})
