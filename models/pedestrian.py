"""The pedestrian who carried the system in the first tests, and obeys at once (4.1.5)."""

from __future__ import annotations

from models.commands import Command
from models.kit.declaration import Parameter
from models.kit.geometry import any_of, where
from models.kit.units import DEG
from models.plant import Guided


class Pedestrian(Guided):
    """A person who carries the system and obeys its commands."""

    source = "Miller 2010, 4.1.5"

    walking_speed = Parameter("m/s", "speed on FORWARD and RECALL", start=1.4, min=0)
    walking_acceleration = Parameter("m/s2", "acceleration and deceleration", start=2.0, min=0)
    turning_rate = Parameter("rad/s", "turn rate on LEFT and RIGHT", start=60 * DEG, min=0)

    def initialize(m) -> None:
        """Stand at the start."""
        m._place()

    def move(m) -> None:
        """Walk on FORWARD and RECALL, turn on LEFT and RIGHT, slow down on all but the first two."""
        walking = any_of(m.command == Command.FORWARD, m.command == Command.RECALL)
        turn = where(m.command == Command.RIGHT, m.turning_rate, 0)
        turn = where(m.command == Command.LEFT, -m.turning_rate, turn)
        m._move(where(walking, 1, -1) * m.walking_acceleration, m.walking_speed, turn)

    def output(m) -> None:
        """The person's motion; the pack stays level."""
        m._report()
