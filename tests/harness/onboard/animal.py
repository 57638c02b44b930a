"""A scripted animal that wears the program on board: it carries out commands, or does what it likes."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from harness.onboard.memory import Memory
from models.commands import Command
from models.kit.timing import TICK
from models.kit.units import DEG
from tests.harness.onboard.vest import Vest

GRAVITY = 9.81  # m/s2
TURN_RATE = {Command.RIGHT: 60 * DEG, Command.LEFT: -60 * DEG}  # rad/s
Motion = tuple[float, float]  # speed [m/s], turn rate [rad/s]
Behaviour = Callable[[Command], Motion]


def obedient(command: Command) -> Motion:
    """Goes at 2 m/s on FORWARD and RECALL, turns on the spot."""
    return 2.0 * (command in (Command.FORWARD, Command.RECALL)), TURN_RATE.get(command, 0.0)


class Animal:
    """An animal and its vest.

    Attributes:
        north, east: m.
        heading: of the body, rad clockwise from north.
        course_off: the course less the heading, rad: pi if the inertial unit is mounted backwards.
        sensed: signals of the sensors that are other than its motion makes them.
        fix_ticks: from fix to fix, about 4 Hz.
    """

    def __init__(self, vest: Vest, heading: float = 0.0) -> None:
        self.vest = vest
        self.north = self.east = self.speed = 0.0
        self.heading = heading
        self.course_off = 0.0
        self.sensed: dict[str, float] = {}
        self.fix_ticks = 6

    def tick(
        self, behaviour: Behaviour = obedient, *messages: Any, fix: bool | None = None
    ) -> tuple[Command, Memory]:
        """One tick; what was played on it, and the program's memory behind it."""
        command = self.vest.played[-1] if self.vest.played else Command.NONE
        speed, turn_rate = behaviour(command)
        acceleration, self.speed = (speed - self.speed) / TICK, speed
        self.heading = math.remainder(self.heading + turn_rate * TICK, 2 * math.pi)
        if command == Command.RECALL and speed > 0:
            home = math.atan2(-self.east, -self.north)
            self.heading = math.remainder(home - self.course_off, 2 * math.pi)
        course = self.heading + self.course_off
        self.north += speed * TICK * math.cos(course)
        self.east += speed * TICK * math.sin(course)
        shake = 0.01 * (self.vest.k % 7 - 3)  # no two samples in a row are the same
        signals = {
            "accel_x": acceleration * math.cos(self.course_off) + shake,
            "accel_z": -GRAVITY + shake,
            "gyro_z": turn_rate + 0.01 * shake,
            "heading_meas": self.heading,
            "gps_north": self.north,
            "gps_east": self.east,
            "gps_speed": speed,
            "gps_course": math.remainder(course, 2 * math.pi),
        }
        fix = self.vest.k % self.fix_ticks == self.fix_ticks - 1 if fix is None else fix
        memory = self.vest.tick(*messages, fix=fix, **(signals | self.sensed))
        return self.vest.played[-1], memory

    def ticks(
        self, seconds: float, behaviour: Behaviour = obedient, *messages: Any, fix: bool | None = None
    ) -> list[Command]:
        """So many seconds, with these messages five times a second; what was played."""
        for k in range(round(seconds / TICK)):
            self.tick(behaviour, *(messages if k % 5 == 0 else ()), fix=fix)
        return self.vest.played[len(self.vest.played) - round(seconds / TICK) :]
