"""The onboard computer in the closed loop: a processor in the place of estimator, controller, command module.

It gets the sensors' signals as the bytes of a receiver and an inertial unit, and the operator's wishes as
radio frames. It answers with tones and vibrations, from which the animal's command is read, and with
telemetry. The log shows the program's memory, read after each tick.

On board, north = east = 0 is the first fix. Outputs are shifted here: zero is the scenario's origin.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from itertools import count
from typing import Any

import numpy as np
import numpy.typing as npt

from codegen.firmware.key import SIMULATION_KEY
from codegen.firmware.navigation import DEFAULT, Navigation
from codegen.firmware.telemetry import FIELDS, POSITION_UNIT, Telemetry
from harness.cosim.fmu import Call, Clock, FmuDescription, Quantity
from harness.log.channel import Channel
from harness.log.geodesy import TangentPlane
from harness.onboard import ROLES
from harness.onboard.garbage import Garbage, Garbler
from harness.onboard.instruments import InertialUnit, Receiver
from harness.onboard.memory import Memory
from harness.onboard.operator import Operator
from harness.onboard.processors import Processor, ProcessorError, Received, Reply
from harness.onboard.radio import Link, Mission, Position
from harness.onboard.tones import commands
from models.cmec import MAX_WAYPOINTS
from models.commands import Command
from models.kit.link import Values

Live = list[tuple[list[str], npt.NDArray[Any]]]  # names, and values that change under them


class Instrumented(ABC):
    """A processor with its instruments, in the place of the components of `ROLES`.

    Who is at the other end of the radio, a subclass tells.

    Args:
        processor: a processor that runs the onboard program.
        origin: latitude and longitude of north = east = 0 [deg].
        values: the command module's parameters (SI) by component.
        pvt: the receiver is a newer one (see `Receiver`).
        navigation: of its program.
        garbage: of the bytes that it receives.

    Attributes:
        memory: the program's memory after the last tick.
        played: tone [Hz], left and right vibrator on it.
        command: the command that they stand for.
    """

    def __init__(
        self,
        processor: Processor,
        origin: tuple[float, float],
        values: Values,
        *,
        pvt: bool = False,
        navigation: Navigation = DEFAULT,
        garbage: Sequence[Garbage] = (),
    ) -> None:
        self.processor, self.navigation = processor, navigation
        self.plane = TangentPlane(*(math.radians(x) for x in origin))
        self.receiver, self.unit = Receiver(self.plane, pvt), InertialUnit()
        self._garbled = Garbler(garbage)
        self._commands = commands(values.get("command_module", {}))
        self._telemetry: Telemetry | None = None
        self._rows: dict[float, Telemetry | None] = {}  # the last telemetry by the time of each tick
        self.tick = 0
        self.memory = Memory(processor.start, navigation)
        self.played = (0, False, False)
        self.command = Command.NONE
        self._shift: tuple[float, float] | None = None
        self._stand_ins: dict[str, StandIn] = {}
        self._sensors: Live = []

    def step(self, time: float, signals: Mapping[str, float], wishes: Mapping[str, float]) -> Reply:
        """One tick: the sensors' signals and the controller's free inputs in, commands and telemetry out.

        Raises:
            ProcessorError: the program runs away, or plays something that stands for no command.
        """
        received = Received(
            self._garbled("gps", self.tick, self.receiver.fix(time, signals)),
            self._garbled("imu", self.tick, self.unit.sample(self.tick, signals)),
            self._garbled("radio", self.tick, self._hear(time, wishes)),
        )
        reply = self.processor.tick(received)
        self.tick += 1
        self.memory = Memory(reply.record, self.navigation)
        self._telemetry = self._tell(reply.sent, wishes) or self._telemetry
        self._rows[time] = self._telemetry
        self.played = (reply.tone_hz, reply.vibrate_left, reply.vibrate_right)
        if self.played not in self._commands:
            raise ProcessorError(
                f"{self.processor.image.path.name}: the vest plays {reply.tone_hz} Hz, left "
                f"{reply.vibrate_left}, right {reply.vibrate_right} at t = {time:.10g} s, "
                "expected the sound of a command"
            )
        self.command = self._commands[self.played]
        return reply

    @abstractmethod
    def _hear(self, time: float, wishes: Mapping[str, float]) -> bytes:
        """The bytes that the radio brings on a tick."""

    @abstractmethod
    def _tell(self, sent: bytes, wishes: Mapping[str, float]) -> Telemetry | None:
        """Take the bytes that the radio sends on a tick; the last telemetry that arrives, if any does."""

    def output(self, component: str, name: str) -> float:
        """An output of one of the components of `ROLES`."""
        value = self.memory[f"{component}.output.{name}"]
        if component == "controller" and name == "command":
            return float(self.command)
        if (
            component == "estimator"
            and name in ("north", "east")
            and self.memory["local_plane.state.settled"]
        ):
            return value + self._origin()[name == "east"]
        return value

    def _origin(self) -> tuple[float, float]:
        """North and east of the program's origin, m."""
        if self._shift is None:
            latitude, longitude = (
                self.memory[f"local_plane.state.origin_{name}"] * POSITION_UNIT
                for name in ("latitude", "longitude")
            )
            self._shift = self.plane.to_plane(latitude, longitude)
        return self._shift

    @staticmethod
    def channel() -> Channel:
        """The telemetry's signals in the log, in SI; those without a unit are whole numbers."""
        fields = FIELDS.values()
        return Channel(
            "telemetry",
            "telemetry",
            tuple(name.removesuffix("_ms") for name in FIELDS),
            tuple(field.si for field in fields),
            tuple("Real" if field.si else "Integer" for field in fields),
            tuple(field.meaning for field in fields),
        )

    def row(self, time: float) -> list[float]:
        """The last telemetry before the end of a tick, as the log's row; zeros until there is one."""
        telemetry = self._rows.pop(time, None)
        return [field.factor * getattr(telemetry, name, 0) for name, field in FIELDS.items()]

    def forget(self, times: Iterable[float]) -> None:
        """Drop the rows of ticks whose telemetry nobody logs."""
        for time in times:
            del self._rows[time]

    def stand_ins(self, fmus: Mapping[str, FmuDescription]) -> dict[str, StandIn]:
        """The stand-ins for the components' FMUs in the loop."""
        names = [name for name in (*self.navigation.chain, *ROLES) if name in fmus]
        self._stand_ins = {name: StandIn(self, name, fmus[name]) for name in names}
        return self._stand_ins

    def connect(self, sensors: Live) -> None:
        """Read the sensors' signals from these arrays, which the loop fills."""
        self._sensors = sensors

    def make_tick(self, time: float) -> None:
        """One tick of the loop, with the present outputs of its other components."""
        self.step(time, by_name(self._sensors), by_name(self._stand_ins["controller"].inputs))

    def close(self) -> None:
        """Stop the processor."""
        self.processor.close()


class Onboard(Instrumented):
    """A processor with its instruments and its operator, who carries out the scenario's wishes.

    Args:
        values: the controller's parameters too, mission included; else as for `Instrumented`.
    """

    def __init__(
        self,
        processor: Processor,
        origin: tuple[float, float],
        values: Values,
        *,
        pvt: bool = False,
        navigation: Navigation = DEFAULT,
        garbage: Sequence[Garbage] = (),
    ) -> None:
        super().__init__(processor, origin, values, pvt=pvt, navigation=navigation, garbage=garbage)
        link = Link(SIMULATION_KEY, count(1).__next__)  # each trial the same
        self.operator = Operator(self._mission(values.get("controller", {})), link)

    def _mission(self, values: Mapping[str, float]) -> Mission:
        def position(north: str, east: str) -> Position:
            return Position(*self.plane.place(values.get(north, 0.0), values.get(east, 0.0)))

        used = range(1, min(int(values.get("waypoint_count", 1)), MAX_WAYPOINTS) + 1)
        waypoints = (position(f"waypoint_north[{i}]", f"waypoint_east[{i}]") for i in used)
        corners = range(1, int(values.get("fence_count", 0)) + 1)
        fence = (position(f"fence_north[{i}]", f"fence_east[{i}]") for i in corners)
        return Mission(position("home_north", "home_east"), tuple(waypoints), tuple(fence))

    def _hear(self, time: float, wishes: Mapping[str, float]) -> bytes:
        start, override = bool(wishes.get("start", 0.0)), Command(int(wishes.get("override", 0.0)))
        return self.operator.send(time, start, override, is_in_reach(wishes))

    def _tell(self, sent: bytes, wishes: Mapping[str, float]) -> Telemetry | None:
        return self.operator.receive(sent) if is_in_reach(wishes) else None


class StandIn:
    """A component of the loop that the onboard computer replaces: the first of them makes its tick."""

    def __init__(self, onboard: Instrumented, name: str, description: FmuDescription) -> None:
        self.onboard, self.name, self.description = onboard, name, description
        self.label = f"{name} on board"
        self.inputs: Live = []

    def __enter__(self) -> StandIn:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def initialize(self, values: Mapping[str, float]) -> None:
        """Its parameters are in the firmware."""

    def setting(self, quantities: Sequence[Quantity], address: int) -> Call:
        """As an FMU's: the inputs at the address are read when the tick is made."""
        self.inputs.append(([q.name for q in quantities], _values(quantities, address)))
        return _nothing, (object(),)  # the loop tells calls apart by their arguments

    def getting(self, quantities: Sequence[Quantity], address: int) -> Call:
        """As an FMU's."""
        return self._answer, ([q.name for q in quantities], _values(quantities, address))

    def _answer(self, names: Iterable[str], values: npt.NDArray[Any]) -> None:
        values[:] = [self.onboard.output(self.name, name) for name in names]

    def stepping(self, clock: Clock, size: float, count: int = 1) -> Call:
        """As an FMU's."""
        first = next(iter(self.onboard.navigation.chain))
        return (self._tick if self.name == first else _nothing), (clock.now,)

    def _tick(self, time: Any) -> None:
        self.onboard.make_tick(time.value)

    def check(self, status: int, what: str, time: float) -> None:
        """Its calls return no status."""

    def close(self) -> None:
        """The onboard computer is closed by its owner."""


def is_in_reach(wishes: Mapping[str, float]) -> bool:
    """Does the radio bring anything, either way?"""
    return bool(wishes.get("link_ok", 1.0))


def by_name(live: Live) -> dict[str, float]:
    """The values as they are now, by name."""
    return {n: float(v) for names, values in live for n, v in zip(names, values, strict=True)}


def _values(quantities: Sequence[Quantity], address: int) -> npt.NDArray[Any]:
    kind: Any = np.ctypeslib.as_ctypes_type(np.dtype(quantities[0].access.dtype).str)
    return np.ctypeslib.as_array((kind * len(quantities)).from_address(address))


def _nothing(_: Any) -> None:
    pass
