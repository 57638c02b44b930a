"""A trial in the browser while it runs: its page grows by the clock, and is trial.html at the end."""

from __future__ import annotations

import asyncio
import math
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import orjson
import uvicorn

from harness.addresses import LOCALHOST
from harness.log.channel import Array, Channel
from harness.log.live import Pace
from harness.log.log import Log
from harness.report.page import render
from harness.station.desk import OrderError
from harness.station.guard import Guard
from harness.station.server import address_of, listening, serve
from harness.station.shown import News
from harness.trial.events import events
from harness.trial.page import MOST_EVENTS, marks, trial_data

SHOW_S = 0.2  # between two states
LAST_S = 5.0  # for a browser to take the page of the trial at the end
POLL_S = 0.05


class Live:
    """A trial that runs, as browsers are shown it (`Shown`) and as it is told how it goes (`Audience`).

    Rows come by seconds; browsers get them when their time has come.

    Args:
        title: of the page.
        pace: the trial's time by the clock.
    """

    def __init__(self, title: str, pace: Pace) -> None:
        self._title, self._pace = title, pace
        self._lock = threading.Lock()
        self._watched = threading.Event()  # a browser is there
        self._taken = threading.Event()  # one has taken the page of the trial
        self._operators: set[int] = set()
        self._log: Log | None = None  # what the rows are of; none are in it
        self._times: list[Array] = []
        self._rows: list[Mapping[str, Array]] = []
        self._report: bytes | None = None
        self._shown_at = -math.inf

    # The trial's side.

    def begin(
        self,
        channels: Sequence[Channel],
        origin: tuple[float, float],
        records: Mapping[str, Mapping[str, str]],
    ) -> None:
        """As `Audience`: the trial begins once a browser is there."""
        metadata = {name: dict(values) for name, values in records.items()}
        with self._lock:
            self._log = Log(Path("trial"), tuple(channels), metadata, {}, np.empty(0), {}, origin)
        self._watched.wait()

    def take(self, times: Array, rows: Mapping[str, Array]) -> None:
        """As `Audience`: rows are kept until their time comes."""
        if not len(times):
            return
        with self._lock:
            self._times.append(times.copy())
            self._rows.append({name: values.copy() for name, values in rows.items()})
        for moment in (times[0], times[-1]):
            self._pace.keep(float(moment))

    def finish(self, report: bytes) -> None:
        """The trial is over; browsers are given its page, and have LAST_S to take it."""
        is_watched = bool(self._operators)
        self._report = report
        end = time.monotonic() + LAST_S
        while is_watched and time.monotonic() < end and (self._operators or not self._taken.is_set()):
            time.sleep(POLL_S)

    # The browsers' side.

    def page(self) -> bytes:
        """The page: of the trial that runs, or of the trial that has ended."""
        if self._report is not None:
            self._taken.set()
            return self._report
        return render("live.html.jinja", self._title, None, ("answer.js", "live.js"), speaks=True)

    def join(self, operator: int) -> list[bytes]:
        """As `Shown`."""
        self._operators.add(operator)
        self._watched.set()
        return [orjson.dumps({"is": "hello", "title": self._title})]

    def leave(self, operator: int) -> None:
        """As `Shown`."""
        self._operators.discard(operator)

    def order(self, operator: int, order: dict[str, Any]) -> list[bytes]:
        """As `Shown`: a browser asks for the rows behind those that it has."""
        ticks, signals = (order.get(name) for name in ("ticks", "signals"))
        if order.get("do") != "rows" or not (isinstance(ticks, int) and isinstance(signals, int)):
            raise OrderError(
                'a trial runs: nothing can be ordered but {"do": "rows", "ticks": n, "signals": n}'
            )
        log = self._so_far()
        if log is None:
            return []
        happened = events(log)[-MOST_EVENTS:]
        data = trial_data(log, (min(max(ticks, 0), len(log.time)), signals)) | {
            "marks": marks(happened),
            "events": [event.time for event in happened],
        }
        rows = {"is": "rows", "data": data, "happened": [asdict(event) for event in happened]}
        return [orjson.dumps(rows)]

    def _so_far(self) -> Log | None:
        """The trial up to now; None before its first row."""
        with self._lock:
            log, times, rows = self._log, list(self._times), list(self._rows)
        if log is None or not times:
            return None
        ticks = self._ticks(times)
        values = {name: np.concatenate([part[name] for part in rows])[:ticks] for name in rows[0]}
        moments = np.concatenate(times)[:ticks]
        return Log(log.path, log.channels, log.metadata, {}, moments, values, log.origin)

    def _ticks(self, times: Sequence[Array]) -> int:
        """So many rows whose time has come; the first one's has."""
        return max(int(np.searchsorted(np.concatenate(times), self._pace.now, side="right")), 1)

    def poll(self) -> News:
        """As `Shown`."""
        now = time.monotonic()
        if now - self._shown_at < SHOW_S:
            return News(None)
        self._shown_at = now
        if self._report is not None:
            return News(orjson.dumps({"is": "end"}))
        with self._lock:
            ticks = self._ticks(self._times) if self._times else 0
        return News(orjson.dumps({"is": "state", "ticks": ticks}))

    def close(self) -> None:
        """Nobody is served any more, nor waited for."""
        self._watched.set()


@contextmanager
def live(title: str, pace: Pace, ready: Callable[[str], None]) -> Iterator[Live]:
    """A trial in browsers on this machine, served by a thread until the context ends.

    Args:
        ready: is given the address, once a browser can open it.
    """
    shown, guard = Live(title, pace), Guard.of(LOCALHOST)
    servers: list[uvicorn.Server] = []
    with listening(LOCALHOST, 0) as listener:

        def answers(server: uvicorn.Server) -> None:
            servers.append(server)
            ready(address_of(listener, guard))

        def run() -> None:
            try:
                asyncio.run(serve(shown, guard, listener, answers, shown.page))
            finally:
                shown.close()

        thread = threading.Thread(target=run, daemon=True)
        thread.start()
        try:
            yield shown
        finally:
            while thread.is_alive() and not servers:
                thread.join(POLL_S)
            for server in servers:
                server.should_exit = True
            thread.join()
