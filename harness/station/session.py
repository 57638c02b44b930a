"""A station at work: a port, the conduct of a trial, and the sink."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from typing import Any

import orjson

from codegen.firmware.key import Key
from codegen.firmware.telemetry import Flag, Telemetry
from harness.log.log import LogError
from harness.onboard.radio import Link, Mission, RadioError
from harness.station.alarms import Alarm, Alarms
from harness.station.conduct import ORDERS, Conduct
from harness.station.desk import OrderError
from harness.station.draft import Draft, as_json
from harness.station.events import Event, Level
from harness.station.history import History
from harness.station.ports import Port, PortError
from harness.station.shown import EVENTS, SHOW_S, TRACK, News, Refresh, World, add_to, told, welcome
from harness.station.sink import JUMP_S, MovedLogError, Sink
from models.commands import Command
from models.errors import UsageError, printable

REOPEN_S = 2.0  # s between two tries to open a port that is gone
UNRECORDED = ("alive", "draft")  # orders that would fill the log, as the repetitions of a hold would
OLD_S = 2.0  # s after which it is too late to answer a state; the vest waits as long for its operator
OLD_HOLD_S = 0.7  # as OLD_S, of a hold: a round trip of 0.4 s, the 0.2 s between two states, and some jitter
AT_ANY_TIME = ("stop", "abort", "release", "note")  # orders that are right however late they come


def _longest(do: str) -> float:
    """The age of a state that an order may answer, s."""
    return OLD_HOLD_S if do == "hold" else OLD_S


@dataclass(frozen=True)
class About:
    """What is known of a vest before it is heard.

    Attributes:
        source: where its bytes come from, in words.
        parameters: `component.name` to its value (SI), as text.
        mission: the scenario's own, of a simulated vest.
        world: streets and poles of a simulated animal, in deg; they are not on board. None without any.
    """

    source: str
    parameters: Mapping[str, str]
    mission: Draft = field(default_factory=Draft)
    world: World | None = None


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
        self._track = History(TRACK)
        self._refresh = Refresh()
        # when states were shown: the log's time, ours; as many as can be young enough
        self._seen: deque[tuple[float, float]] = deque(maxlen=1 + math.ceil(OLD_S / SHOW_S))
        self._recorded: Mission | None = None
        self._pool = ThreadPoolExecutor(1, "station-port")
        self._opening: Future[Port] | None = None
        self._failed_at, self._looked = 0.0, math.inf  # before the first look nothing stood still
        self._log_fault = ""  # what is wrong with the log

    @property
    def now(self) -> float:
        """s since the station began."""
        return self._clock() - self._begun

    def join(self, operator: int) -> list[bytes]:
        """As `Shown`."""
        self.conduct.desk.join(operator)
        self._refresh.stale = True
        return welcome(
            operator,
            self.about.parameters,
            self._track,
            self._events,
            commander=self.conduct.desk.commander,
            insecure=self.is_insecure,
            replay=None,
            source=self.about.source,
            scenario=as_json(self.about.mission) if self.about.mission.home else None,
            world=self.about.world,
        )

    def leave(self, operator: int) -> None:
        """As `Shown`."""
        self.conduct.leave(self.now, operator)
        self._act(self.now)

    def order(self, operator: int, order: dict[str, Any]) -> tuple[()]:
        """As `Shown`: it is carried out, and sent, at once, unless it comes too late."""
        now, held = self.now, self.conduct.holding
        if not self._is_timely(now, order):
            if order["do"] == "alive":  # a sign of life that is old is none
                return ()
            raise OrderError(
                f"{order['do']}: came {_longest(order['do']):g} s or more after what it answers was shown, "
                "as out of a network that was lost or is slow, and is not carried out; order it again"
            )
        self.conduct.order(now, operator, order)
        is_renewed = order["do"] == "hold" and self.conduct.holding is held
        if not is_renewed and order["do"] not in UNRECORDED:
            self._record(lambda sink: sink.order(now, operator, order))
        self._act(now)
        return ()

    def _is_timely(self, now: float, order: Mapping[str, Any]) -> bool:
        """May it act now? What a network held back would act on an animal that nobody has seen since."""
        if "seen" not in order or order.get("do") not in ORDERS or order["do"] in AT_ANY_TIME:
            return True
        return any(order["seen"] == time and now - at <= _longest(order["do"]) for time, at in self._seen)

    def poll(self) -> News:
        """As `Shown`."""
        now = self.now
        if (stood := now - self._looked) > JUMP_S:
            self._log_clock.leave_out(stood)
            self._tell(
                now, Level.CAUTION, f"the station stood still for {stood:.0f} s, which the log leaves out"
            )
        self._looked = now
        data = self._read(now)
        if data:
            self._record(lambda sink: sink.receive(now, data))
            for telemetry in self.conduct.receive(now, data):
                self._hear(now, telemetry)
        self._act(now)
        self._record(lambda sink: sink.step(now))
        events, self._new = tuple(self._new), []
        return News(self._show(now) if self._refresh.is_due(now) else None, events)

    def _show(self, now: float) -> bytes:
        self._refresh.done(now)
        content = self.state(now)
        if self._seen:  # the log's time may stand, and `seen` names a state by its time
            content["time"] = max(content["time"], math.nextafter(self._seen[-1][0], math.inf))
        self._seen.append((content["time"], now))
        state = orjson.dumps(content)
        self._record(lambda sink: sink.show(now, state))
        return state

    def _hear(self, now: float, telemetry: Telemetry) -> None:
        override = Command.STOP if self.conduct.latched else self.conduct.holding or Command.NONE
        self._record(lambda sink: sink.tell(now, telemetry, override))
        if self._sink and (jump := self._log_clock.jump):
            self._tell(now, Level.CAUTION, f"the vest's clock jumped by {jump:+.1f} s: time goes on by ours")
        if self._sink and self._sink.unknown is not None:
            text = f"mission {self._sink.unknown:04x} is under way, which this station did not give"
            self._tell(now, Level.CAUTION, f"{text}: the log does not have its places")
        add_to(self._track, self._log_clock.at(now), telemetry)
        self._refresh.stale = True

    def _act(self, now: float) -> None:
        """Send what is due, and note what happened."""
        if frames := self.conduct.step(now):
            self._send(now, frames)
        if self.conduct.on_board is not self._recorded:
            self._recorded = mission = self.conduct.on_board
            if mission:
                self._record(lambda sink: sink.take_mission(mission))
        for level, text in self.conduct.take_events():
            self._tell(now, level, text)

    def _send(self, now: float, frames: bytes) -> None:
        if self._port:
            self._record(lambda sink: sink.send(now, frames))
            try:
                self._port.write(frames)
            except PortError as reason:
                self._lose_port(now, reason)

    def _tell(self, now: float, level: Level, text: str) -> None:
        event = Event(self._log_clock.at(now), level, text)
        self._events.append(event)
        self._new.append(event)
        self._refresh.stale = True
        self._record(lambda sink: sink.event(event))

    def _record(self, write: Callable[[Sink], None]) -> None:
        """Write to the log. Whatever fails in that, the station goes on: the vest must be reached."""
        if self._sink is None:
            return
        try:
            write(self._sink)
        except MovedLogError as reason:
            self._warn_of_log(str(reason))
        except LogError as reason:
            self._lose_log(str(reason))
        except Exception as fault:  # a fault of ours, too, must not cost the vest its operator
            self._lose_log(f"{self._sink.path}: {type(fault).__name__}: {printable(str(fault))}")

    def _lose_log(self, reason: str) -> None:
        self._sink = None
        self._warn_of_log(f"nothing is recorded any more: {reason}")

    def _warn_of_log(self, fault: str) -> None:
        self._log_fault = fault
        self._tell(self.now, Level.WARNING, fault)

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
        if self._log_fault:
            alarms.insert(0, Alarm("log", Level.WARNING, self._log_fault, 0.0))
        return alarms

    def state(self, now: float) -> dict[str, Any]:
        """What is shown, as harness/station/README.md lists it."""
        conduct, desk = self.conduct, self.conduct.desk
        return {
            "is": "state",
            "time": self._log_clock.at(now),
            "link": conduct.state(now),
            **told(conduct.telemetry),
            "missing": conduct.missing(now),
            "draft": as_json(conduct.draft),
            "draft_id": conduct.draft_id,
            "on_board": self._on_board(),
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

    def _on_board(self) -> dict[str, Any] | None:
        """The mission that the vest holds; its places, if this station gave it in this session."""
        telemetry, ours = self.conduct.telemetry, self.conduct.on_board
        if telemetry is None or Flag.LOADED not in Flag(telemetry.flags):
            return None
        mission = as_json(Draft(ours.home, ours.waypoints, ours.fence)) if ours else None
        return {"id": telemetry.mission_id, "mission": mission}

    def close(self) -> None:
        """End: a mission that is under way is aborted, which else would end once the vest misses us.

        Twice does no harm.
        """
        now = self.now
        if self._refresh.stale:  # a replay ends as the screen would have
            self._show(now)
        if self.conduct.is_under_way:
            with suppress(RadioError):
                for frames in self.conduct.farewell():
                    self._send(now, frames)
        self._pool.shutdown(wait=False, cancel_futures=True)
        if self._port:
            self._port.close()
        self._record(lambda sink: sink.close())
        self._sink = self._port = None
