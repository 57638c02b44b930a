"""An operator who leads the animal of a vest by its radio's port, and a clock that goes tick by tick."""

from __future__ import annotations

import math
import threading

from codegen.firmware.key import Key
from codegen.firmware.telemetry import Telemetry
from harness.log.geodesy import TangentPlane
from harness.onboard.operator import Operator
from harness.onboard.radio import Link, Mission, Position
from harness.trial.scenario import load
from harness.vest.port import Port
from harness.vest.vest import Vest
from models.commands import Command, Status

PATIENCE = 120.0  # s of the clock, on the busiest machine


def mission_of(scenario: str) -> Mission:
    """The mission that a scenario states."""
    written = load(scenario)
    plane = TangentPlane(*(math.radians(x) for x in written.origin))

    def place(north: float, east: float) -> Position:
        return Position(*plane.place(north, east))

    return Mission(place(*written.start[:2]), tuple(place(*point) for point in written.waypoints))


class Leading:
    """An operator at a port, who wishes a mission on.

    Attributes:
        told: the telemetry that was believed.
        start, override: what is wished.
    """

    def __init__(self, port: Port, mission: Mission, key: Key | None = None) -> None:
        self.port, self.operator = port, Operator(mission, Link(key))
        self.told: list[Telemetry] = []
        self.start, self.override = True, Command.NONE

    @property
    def status(self) -> Status:
        """How the mission stands."""
        return Status(self.told[-1].status) if self.told else Status.IDLE

    def turn(self, time: float) -> None:
        """What the operator does at a time [s] of the trial."""
        if telemetry := self.operator.receive(self.port.read()):
            self.told.append(telemetry)
        if frames := self.operator.send(time, self.start, self.override, True):
            self.port.write(frames)


class Steps:
    """A clock that goes on when the test says so: nothing depends on how fast the machine is.

    `now` and `sleep` are for `open_vest`.
    """

    def __init__(self) -> None:
        self.time = 0.0
        self._go, self._asleep = threading.Semaphore(0), threading.Semaphore(0)
        self._begun = False

    def now(self) -> float:
        """The time, s."""
        return self.time

    def sleep(self, stopped: threading.Event, seconds: float) -> None:
        """Let the time go on once the test does."""
        self._asleep.release()
        while not self._go.acquire(timeout=0.05):
            if stopped.is_set():
                return
        self.time += seconds

    def tick(self, vest: Vest) -> float:
        """Let a vest make a tick; the time of that, s of the trial."""
        if not self._begun:
            self._begun = self._slept(vest)
        self._go.release()
        self._slept(vest)
        return vest.state.time

    def ticks(self, vest: Vest, number: int, *operators: Leading) -> None:
        """So many ticks, on each of which the operators have their turn."""
        for _ in range(number):
            time = self.tick(vest)
            for operator in operators:
                operator.turn(time)

    def lead(self, vest: Vest, operator: Leading, most: int = 5000) -> None:
        """Ticks until the operator's mission has ended."""
        for _ in range(most):
            if operator.status not in (Status.IDLE, Status.RUNNING):
                return
            operator.turn(self.tick(vest))
        raise AssertionError(f"the mission did not end within {most} ticks: {operator.status.name}")

    def _slept(self, vest: Vest) -> bool:
        for _ in range(round(PATIENCE / 0.1)):
            if self._asleep.acquire(timeout=0.1):
                return True
            if not vest.is_running:
                raise AssertionError(f"the vest has ended: {vest.fault}")
        raise AssertionError("the vest makes no tick")
