"""A trial of a controller whose inputs are set by hand, or by a plant."""

from __future__ import annotations

import math
from itertools import groupby
from typing import Any

from models.cmec import Cmec
from models.commands import Command, Status
from models.kit.block import Block
from models.kit.model import Model
from models.modes import Anomaly, Mode

DEG = math.pi / 180
FAR = {"waypoint_north[1]": 1000.0}


class Trial:
    """A controller whose inputs are set by hand; the first waypoint lies far north by default."""

    def __init__(self, block: type[Block] = Cmec, /, **parameters: Any) -> None:
        self.model = Model(block, FAR | parameters.pop("route", {}) | parameters)
        self.model.initialize()
        self.model["start"] = 1
        self.model["speed"] = 5
        self.commands: list[Command] = []
        self.anomalies: list[tuple[int, Anomaly]] = []

    def tick(self, ticks: int = 1, /, **inputs: float) -> Command:
        """So many ticks with inputs that stay; `h` [deg] sets the heading for a waypoint due north."""
        if "h" in inputs:
            inputs["heading"] = -inputs.pop("h") * DEG
        for name, value in inputs.items():
            self.model[name] = value
        for _ in range(ticks):
            self.model.step()
            if anomaly := Anomaly(int(self.model["anomaly"])):
                self.anomalies.append((len(self.commands), anomaly))
            self.commands.append(Command(int(self.model["command"])))
        return self.commands[-1]

    def until(self, command: Command, limit: int = 400, /, **inputs: float) -> int:
        """The number of ticks until a command is on."""
        for k in range(1, limit + 1):
            if self.tick(**(inputs if k == 1 else {})) == command:
                return k
        raise AssertionError(f"no {command.name} within {limit} ticks, but {self.phases()}")

    def phases(self) -> list[tuple[str, int]]:
        """Commands given so far: name and ticks of each."""
        return [(c.name, len(list(group))) for c, group in groupby(self.commands)]

    @property
    def mode(self) -> Mode:
        return Mode(int(self.model["mode"]))

    @property
    def status(self) -> Status:
        return Status(int(self.model["status"]))


def led(controller: Model, plant: Model, ticks: int) -> None:
    """So many ticks of a controller that sees a plant's true motion, and of the plant that obeys it."""
    for _ in range(ticks):
        for name in ("north", "east", "speed", "heading"):
            controller[name] = plant[name]
        controller.step()
        plant["command"] = controller["command"]
        plant.step()
