"""A conduct and the real program on board, tick by tick, without clock and sockets."""

from __future__ import annotations

import json
from collections.abc import Callable
from itertools import count
from typing import Any

from codegen.firmware.key import SIMULATION_KEY
from codegen.firmware.telemetry import Flag
from harness.onboard.processors import Received, Reply
from harness.onboard.processors.host import Host
from harness.onboard.radio import CRC, HEADER, TAG, Link
from harness.station.conduct import Conduct
from harness.station.draft import Draft, as_json
from harness.station.events import Level
from models.commands import Command
from models.kit.timing import TICK
from tests.harness.onboard.vest import Vest, place, program

HOME = place(0, 0)
MISSION = Draft(HOME, (place(40, 0), place(40, 40)))
OTHER = Draft(HOME, (place(60, 0),))


class Hands:
    """A clock that the test lets go on, s."""

    now = 0.0

    def __call__(self) -> float:
        return self.now


class Tapped(Host):
    """The program on this machine; what it sends by radio can be had."""

    sent = b""

    def tick(self, received: Received) -> Reply:
        reply = super().tick(received)
        self.sent = reply.sent
        return reply


def frames(sent: bytes) -> list[bytes]:
    """The frames that were sent at once."""
    found = []
    while sent:
        size = HEADER.size + sent[3] + TAG + CRC.size
        found.append(sent[:size])
        sent = sent[size:]
    return found


class Rig:
    """An operator's side and a vest whose animal stands at home; the radio can be cut.

    Attributes:
        now: s.
        sent: what the station sent on the last tick.
        alive: the operators whose browsers live, and show it on each fifth of a second.
        lost: types of messages that get lost on their way to the vest.
        pace: the vest's time over the station's.
    """

    def __init__(self, first: int = 1) -> None:
        self.conduct = Conduct(Link(SIMULATION_KEY, count(first).__next__))
        self._reset()
        self.now = 0.0
        self.sent = b""
        self.uplink = self.downlink = True
        self.lost: set[int] = set()
        self.pace = 1.0
        self.alive: set[int] = set()
        self.events: list[tuple[Level, str]] = []

    def _reset(self) -> None:
        self.processor = Tapped(program())
        self.vest = Vest(self.processor)

    def reset(self) -> None:
        """The vest begins anew, with another session."""
        session = self.vest.inside.radio.session
        self._reset()
        self.vest.inside.radio.session = session + 1

    def order(self, name: str, operator: int = 1, **content: Any) -> None:
        self.conduct.order(self.now, operator, json.loads(json.dumps({"do": name, **content})))

    def tick(self) -> Command:
        """One tick; the command that is played on it."""
        if self.vest.k % 5 == 0:
            for operator in self.alive:
                self.order("alive", operator)
        self.sent = self.conduct.step(self.now)
        passing = b"".join(frame for frame in frames(self.sent) if frame[2] not in self.lost)
        self.vest.tick(passing if self.uplink else b"")
        self.now += TICK / self.pace
        if self.processor.sent and self.downlink:
            self.conduct.receive(self.now, self.processor.sent)
        self.events += self.conduct.take_events()
        return self.vest.played[-1]

    def run(self, seconds: float) -> list[Command]:
        """The commands that are played meanwhile."""
        return [self.tick() for _ in range(round(seconds / TICK))]

    def until(self, is_so: Callable[[], bool], longest: float = 10.0) -> None:
        end = self.now + longest
        while not is_so():
            assert self.now < end, (self.events, self.conduct.missing(self.now))
            self.tick()

    def take(self, operator: int = 1) -> None:
        """An operator connects, and commands."""
        self.conduct.desk.join(operator)
        self.order("take", operator)
        self.alive.add(operator)

    def load(self) -> None:
        """Operator 1 commands, and has a mission on board."""
        self.take()
        self.order("draft", mission=as_json(MISSION))
        self.run(1)
        self.order("upload")
        self.until(lambda: self.conduct.on_board is not None)

    @property
    def is_started(self) -> bool:
        return Flag.STARTED in Flag(self.vest.telemetry.flags)

    def texts(self) -> str:
        return "\n".join(text for _, text in self.events)


def connected() -> Rig:
    """Operator 1 commands a vest that is heard."""
    rig = Rig()
    rig.take()
    rig.run(1)
    return rig


def drawn() -> Rig:
    """A mission is on screen, too."""
    rig = connected()
    rig.order("draft", mission=as_json(MISSION))
    return rig


def ready() -> Rig:
    """A mission is on board, and nothing is missing for a START."""
    rig = Rig()
    rig.load()
    rig.until(lambda: not rig.conduct.missing(rig.now))
    return rig


def under_way() -> Rig:
    """A mission is under way."""
    rig = ready()
    rig.order("start")
    rig.until(lambda: rig.conduct.is_under_way)
    return rig
