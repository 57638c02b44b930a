"""A log that is played: the same states and events, at any speed, from any time."""

from __future__ import annotations

import math
import time
from bisect import bisect_left, bisect_right
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import orjson

from codegen.firmware.telemetry import Flag, Telemetry
from harness.log.log import Log, LogError, read_log
from harness.station.conduct import LinkState, lacking
from harness.station.desk import OrderError
from harness.station.draft import Draft, as_json
from harness.station.events import Event, Level
from harness.station.history import History
from harness.station.readings import telemetry_of
from harness.station.recorded import read_recorded
from harness.station.shown import TRACK, News, Refresh, add_to, finite, told, welcome, world_of
from models.modes import ENDED

SPEEDS = 0.1, 100.0


class _Frame(NamedTuple):
    time: float
    state: Callable[[], dict[str, Any]]


class Playback:
    """A log that is played.

    Args:
        path: of a station's log, or of a trial with the firmware on board.
        clock: gives s that only grow.

    Raises:
        LogError: it cannot be read, has no telemetry, or what it says that was shown is not that.
    """

    def __init__(self, path: Path, clock: Callable[[], float] = time.monotonic) -> None:
        self._log, self._clock = read_log(path), clock
        if "telemetry.session" not in self._log:
            raise LogError(
                f"log {path}: has no telemetry; expected one of `canine station` or `canine run --onboard`"
            )
        rows = np.flatnonzero(np.isfinite(self._log.values["telemetry"]).all(axis=1)).tolist()
        if not rows:
            raise LogError(f"log {path}: no telemetry is finite; expected numbers; take another copy")
        recorded = read_recorded(path)
        self._frames = [
            _Frame(moment, partial(orjson.loads, state)) for moment, state in recorded.states
        ] or [_Frame(float(self._log.time[row]), partial(_state_of, self._log, row)) for row in rows]
        self._times = [frame.time for frame in self._frames]
        self._begin, self._end = float(self._log.time[0]), max(float(self._log.time[-1]), self._times[-1])
        self._operators: set[int] = set()
        self._at = self._heard = self._first_heard(rows)
        self._speed, self._playing = 1.0, False
        self._looked = clock()
        self._refresh = Refresh()
        self._track = History(TRACK)
        for row in rows:
            add_to(self._track, float(self._log.time[row]), telemetry_of(self._log, row))
        self._insecure = bool(telemetry_of(self._log, rows[-1]).flags & Flag.INSECURE)
        self._parameters, odd = finite(self._log.metadata.get("parameters", {}))
        left_out = {"rows": len(self._log.time) - len(rows), "parameters": odd}
        self._events = recorded.events + [
            Event(self._begin, Level.CAUTION, f"{count} {what} are no finite numbers, and are left out")
            for what, count in left_out.items()
            if count
        ]

    def _first_heard(self, rows: list[int]) -> float:
        """When the vest is first shown as heard, s: a replay begins there, not at an empty screen."""
        heard = next((row for row in rows if self._log["telemetry.session"][row]), rows[0])
        place = bisect_left(self._times, float(self._log.time[heard]))
        return self._times[min(place, len(self._times) - 1)]

    def join(self, operator: int) -> list[bytes]:
        """As `Shown`."""
        self._operators.add(operator)
        self._refresh.stale = True
        return welcome(
            operator,
            self._parameters,
            self._track,
            self._events,
            commander=None,
            insecure=self._insecure,
            replay={"from": self._begin, "until": self._end},
            source=f"replay of {self._log.path.name}",
            scenario=None,
            world=world_of(self._log.ground, self._log.origin),
        )

    def leave(self, operator: int) -> None:
        """As `Shown`."""
        self._operators.discard(operator)

    def order(self, operator: int, order: dict[str, Any]) -> tuple[()]:
        """As `Shown`: seek, play, pause; signs of life are taken."""
        match order.get("do"):
            case "seek":
                self._at = min(max(self._number(order, "time", -math.inf, math.inf), self._begin), self._end)
            case "play":
                self._advance()
                self._speed = self._number({"speed": 1.0} | order, "speed", *SPEEDS)
                self._at = self._heard if self._at >= self._end else self._at
                self._playing = True
            case "pause":
                self._advance()
                self._playing = False
            case "alive":
                return ()
            case _:
                raise OrderError("a log is replayed: nothing can be ordered but seek, play and pause")
        self._refresh.stale = True
        return ()

    @staticmethod
    def _number(order: dict[str, Any], name: str, least: float, most: float) -> float:
        value = order.get(name)
        if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value <= most:
            limits = f" from {least:g} to {most:g}" if math.isfinite(least) else ""
            raise OrderError(f"{order['do']}: {name} is {value!r:.80}; expected a number{limits}")
        return float(value)

    def _advance(self) -> None:
        now = self._clock()
        if self._playing:
            self._at += (now - self._looked) * self._speed
            self._refresh.stale = True
            if self._at >= self._end:
                self._at, self._playing = self._end, False
        self._looked = now

    def poll(self) -> News:
        """As `Shown`."""
        self._advance()
        if not self._refresh.is_due(self._looked):
            return News(None)
        self._refresh.done(self._looked)
        place = max(bisect_right(self._times, self._at) - 1, 0)
        state = self._frames[place].state()
        replay = {"time": self._at, "playing": self._playing, "speed": self._speed}
        return News(orjson.dumps(state | {"operators": sorted(self._operators), "replay": replay}))


def _state_of(log: Log, row: int) -> dict[str, Any]:
    """A state from a row's telemetry alone, where no station recorded what it showed."""
    telemetry = telemetry_of(log, row)
    is_loaded = Flag.LOADED in Flag(telemetry.flags)
    return {
        "is": "state",
        "time": float(log.time[row]),
        "link": _link_of(telemetry),
        **told(telemetry),
        "missing": lacking(telemetry.ready),
        "draft": as_json(Draft()),
        "draft_id": None,
        "on_board": {"id": telemetry.mission_id, "mission": None} if is_loaded else None,
        "stop_latched": False,
        "holding": None,
        "uploading": False,
        "starting": False,
        "aborting": False,
        "commander": None,
        "commander_alive": False,
        "offered": False,
        "operators": [],
        "link_quality": None,
        "alarms": [],
    }


def _link_of(telemetry: Telemetry) -> LinkState:
    """How far the vest is from a trial, as far as it tells itself."""
    flags = Flag(telemetry.flags)
    if not telemetry.session:
        return LinkState.DISCONNECTED
    if Flag.STARTED in flags and telemetry.mode not in ENDED:
        return LinkState.RUNNING
    if not lacking(telemetry.ready):
        return LinkState.READY
    return LinkState.LOADED if Flag.LOADED in flags else LinkState.CONNECTED
