"""A mission without a browser: this program commands, from the upload to the end."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import orjson

from codegen.firmware.telemetry import Ready
from harness.station.conduct import Conduct, LinkState, lacking
from harness.station.desk import OrderError
from harness.station.draft import Draft, as_json
from harness.station.events import Event
from harness.station.session import Session
from harness.station.shown import POLL_S
from models.errors import CanineError

HEARD_S, READY_S = 30.0, 120.0  # s within which the vest is to be heard, and to be ready
SEEN_S = 3.0  # s after the upload from which telemetry is of this mission
ALIVE_S = 0.2  # s between two signs of life
OF_ROUTE = Ready.REACH | Ready.LEGS | Ready.FENCE  # of what no time mends
OPERATOR = 0


class HeadlessError(CanineError):
    """A mission could not be begun."""


class Headless:
    """The one operator of a session.

    Args:
        session: a station at work.
        tell: is given each event.
        sleep: waits for so many s.
    """

    def __init__(
        self,
        session: Session,
        tell: Callable[[Event], None] = lambda event: None,
        sleep: Callable[[float], object] = time.sleep,
    ) -> None:
        self.session, self._tell, self._sleep = session, tell, sleep
        self._alive_at = 0.0
        session.join(OPERATOR)
        self._order("take")

    def lead(self, mission: Draft, *, start: bool) -> None:
        """Upload a mission; start it, and wait for its end.

        Raises:
            HeadlessError: the vest is not heard, does not take the mission, or is not ready to start.
        """
        self._order("draft", mission=as_json(mission))
        self._wait_until_heard()
        self._upload()
        if not start:
            return
        self._wait_until_ready()
        self._order("start")
        self._wait(lambda: not self._conduct.pending()["starting"], READY_S, "START was not answered")
        if self._state is not LinkState.RUNNING:
            raise HeadlessError(f"the mission has not begun: {self._missing()}")
        self._wait(lambda: not self._conduct.is_under_way)

    def _upload(self) -> None:
        """Upload the mission on screen; an ABORT makes room where another has ended without one.

        Raises:
            OrderError: it is no mission, or one is under way.
        """
        if self._state is LinkState.RUNNING:
            raise OrderError("upload: a mission is under way on the vest; ABORT it at its station first")
        self._order("abort")
        self._wait(lambda: not self._conduct.pending()["aborting"], HEARD_S, "ABORT was not answered")
        deadline = self.session.now + READY_S
        while not self._is_on_board():
            if self.session.now > deadline:
                raise HeadlessError(f"the vest did not take the mission within {READY_S:g} s")
            self._wait_until_heard()
            self._order("upload")
            self._wait(lambda: not self._conduct.pending()["uploading"], HEARD_S, "no answer")

    def _wait_until_heard(self) -> None:
        self._wait(lambda: self._conduct.is_heard(self.session.now), HEARD_S, "the vest was not heard")

    def _wait_until_ready(self) -> None:
        """Wait until a START is taken; not for what no time mends.

        Raises:
            HeadlessError: the mission cannot be led, or it takes too long.
        """
        uploaded = self.session.now

        def is_settled() -> bool:
            is_seen = self.session.now - uploaded > SEEN_S
            return self._state is LinkState.READY or (is_seen and self._unfit() != "")

        self._wait(is_settled, READY_S, "the vest was not ready")
        if self._state is not LinkState.READY:
            raise HeadlessError(f"the vest cannot lead this mission: {self._unfit()}")

    def _unfit(self) -> str:
        """What of the route itself a START lacks, in words; "" if nothing, or not yet known."""
        telemetry = self._conduct.telemetry
        if telemetry is None or Ready.PLANNED not in Ready(telemetry.ready):
            return ""
        of_route = Ready(telemetry.ready | ~OF_ROUTE)
        return "; ".join(reason["words"] for reason in lacking(of_route))

    def _is_on_board(self) -> bool:
        """Does the vest hold the mission on screen, and not only one from before?"""
        held = self._conduct.on_board
        return held is not None and held.id == self._conduct.draft_id

    @property
    def _conduct(self) -> Conduct:
        return self.session.conduct

    @property
    def _state(self) -> LinkState:
        return self._conduct.state(self.session.now)

    def _missing(self) -> str:
        return "; ".join(reason["words"] for reason in self._conduct.missing(self.session.now))

    def _order(self, name: str, **content: Any) -> None:
        self.session.order(OPERATOR, orjson.loads(orjson.dumps({"do": name, **content})))

    def _wait(self, until: Callable[[], bool], longest: float | None = None, what: str = "") -> None:
        """Look at the port until something is so."""
        begun = self.session.now
        while not until():
            now = self.session.now
            if longest is not None and now - begun > longest:
                raise HeadlessError(f"{what} within {longest:g} s: {self._missing() or 'no answer'}")
            if now - self._alive_at >= ALIVE_S:
                self._alive_at = now
                self._order("alive")
            for event in self.session.poll().events:
                self._tell(event)
            self._sleep(POLL_S)
