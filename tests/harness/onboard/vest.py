"""The program on this machine, with its instruments and its operator, tick by tick."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

from codegen.firmware.image import Image
from codegen.firmware.key import SIMULATION_KEY
from codegen.firmware.navigation import DEFAULT, Navigation
from codegen.firmware.telemetry import FIELDS, Telemetry
from harness.log.geodesy import TangentPlane
from harness.onboard.instruments import InertialUnit, Receiver
from harness.onboard.memory import Memory
from harness.onboard.processors import Cost, Processor, Received, open_processor
from harness.onboard.processors.host import Host
from harness.onboard.radio import Decoder, Heartbeat, Mission, Position, Start
from harness.onboard.tones import commands
from models.commands import Command
from tests.harness.onboard.frames import encode
from tests.harness.onboard.inside import inside

PLANE = TangentPlane(math.radians(32.6), math.radians(-85.49))
COMMANDS = commands({})  # by tone and vibrators
HERE = Heartbeat(7)
NO_TELEMETRY = Telemetry(*[0] * len(FIELDS))


def place(north: float, east: float) -> Position:
    latitude, longitude = PLANE.from_plane(north, east)
    return Position(math.degrees(latitude), math.degrees(longitude))


@cache
def program() -> Image:
    """The program on this machine, made once."""
    processor = open_processor("host")
    processor.close()
    return processor.image


class Vest:
    """The program on this machine, at rest at home: ticks with or without a fix, and the memory after it.

    Args:
        processor: another one that runs it.
        navigation: of its program.

    Attributes:
        costs: of each tick, on a simulated processor.
        telemetry: the last.
        counter: of the last message.
        receiver: what gives the fixes.
        fix: the bytes of its last one.
        frozen: it repeats them.
        played: the commands, as the tones and vibrators of each tick tell them.
    """

    def __init__(self, processor: Processor | None = None, navigation: Navigation = DEFAULT) -> None:
        self.processor, self.decoder = processor or Host(program()), Decoder(SIMULATION_KEY)
        self.navigation = navigation
        self.costs: list[Cost | None] = []
        self.k = self.counter = self.told = 0
        self.telemetry = NO_TELEMETRY
        self.receiver, self.fix, self.frozen = Receiver(PLANE), b"", False
        self.played: list[Command] = []

    @property
    def inside(self) -> Any:
        """`vest` of onboard.h, to read and to change."""
        return inside(self.processor._library)  # type: ignore[attr-defined]

    def tick(self, *messages: Any, fix: bool | None = None, **sensed: float) -> Memory:
        """One tick: messages (or bytes) in one piece; a fix on each sixth tick unless `fix` says so."""
        signals = {f"{n}_{a}": 0.0 for n in ("accel", "gyro", "mag") for a in "xyz"}
        signals |= {
            "roll_meas": 0.0,
            "pitch_meas": 1e-3 * (self.k % 2),  # a unit that lives never repeats itself
            "heading_meas": 0.0,
            "gps_fix": 1.0,
            "gps_north": 0.0,
        }
        signals |= {"gps_east": 0.0, "gps_speed": 0.0, "gps_course": 0.0, "gps_h_acc": 3.5, "gps_s_acc": 0.1}
        signals |= sensed
        due = self.k % 6 == 5 if fix is None else fix
        if due and not self.frozen:
            self.fix = self.receiver.fix(0.04 * self.k, signals)
        reply = self.processor.tick(
            Received(
                self.fix if due else b"",
                InertialUnit().sample(self.k, signals),
                b"".join(m if isinstance(m, bytes) else self.encode(m) for m in messages),
            )
        )
        self.k += 1
        self.costs.append(reply.cost)
        self.played.append(COMMANDS[reply.tone_hz, reply.vibrate_left, reply.vibrate_right])
        for told, telemetry in self.decoder.receive(reply.sent):
            self.told, self.telemetry = told, telemetry
        return Memory(reply.record, self.navigation)

    def encode(self, message: Any) -> bytes:
        """The laptop's next frame, which answers the last telemetry."""
        self.counter = max(self.counter + 1, self.told << 8)
        return encode(message, self.counter)

    def ticks(self, number: int, *messages: Any, **sensed: float) -> Memory:
        """So many ticks, with heartbeats (or these messages) on every fifth."""
        for i in range(number):
            memory = self.tick(*(messages or (HERE,)) if i % 5 == 0 else (), fix=None, **sensed)
        return memory

    def load(self, mission: Mission) -> Memory:
        """Give a mission, and wait until all of its places are projected."""
        self.tick(mission, fix=False)
        for _ in range(len(mission.fence) + 1 + len(mission.waypoints)):
            memory = self.tick(fix=False)
        assert memory["planned"]
        return memory

    def begin(self, mission: Mission) -> Memory:
        """Give a mission, and start it once it is projected."""
        self.load(mission)
        return self.tick(Start(mission.id), fix=False)
