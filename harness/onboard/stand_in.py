"""The onboard computer in the closed loop: a processor in the place of estimator, controller, command module.

The sensors' signals go to it as the bytes of a receiver and an inertial unit, the operator's wishes as radio
frames. It answers with tones and vibrations, from which the animal's command is read, and with telemetry.
Everything that it remembers is read from its memory tick by tick: that is what the log shows.

On board, north = east = 0 is the first fix; here both are the scenario's origin again.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from codegen.firmware.bundle import BLOCKS, recorded, settable
from harness.cosim.fmu import Call, FmuDescription, Quantity
from harness.log.geodesy import TangentPlane
from harness.log.log import Channel
from harness.onboard.instruments import InertialUnit, Receiver
from harness.onboard.processors import Processor, ProcessorError, Received, Reply
from harness.onboard.radio import (
    MAX_WAYPOINTS,
    Abort,
    Decoder,
    Flag,
    Message,
    Mission,
    Override,
    Position,
    Start,
    Telemetry,
    encode,
)
from models.commands import Command
from models.errors import UsageError
from models.kit.declaration import Type
from models.kit.link import Values

Live = list[tuple[list[str], npt.NDArray[Any]]]  # names, and values that change under them
ROLES = ("estimator", "controller", "command_module")  # the components whose place it takes
UNIT = math.radians(1e-7)  # of latitudes and longitudes on board
RESEND = 0.4  # s between the operator's messages; some may get lost before the vest stops
TONES = {"forward_tone": Command.FORWARD, "stop_tone": Command.STOP, "recall_tone": Command.RECALL}
# the telemetry as signals of the log: name, unit, factor to it, meaning; what has no unit is a whole number
SIGNALS: tuple[tuple[str, str, float, str], ...] = (
    ("time_ms", "s", 1e-3, "since power-up"),
    ("latitude", "rad", UNIT, "of the estimate"),
    ("longitude", "rad", UNIT, "of the estimate"),
    ("speed", "m/s", 1e-2, "estimated ground speed"),
    ("heading", "rad", 1e-4, "estimated heading, clockwise from north"),
    ("position_sd", "m", 1e-2, "standard deviation of the position"),
    ("speed_sd", "m/s", 1e-2, "standard deviation of the speed"),
    ("distance", "m", 1e-1, "distance to the target"),
    ("deviation", "rad", 1e-4, "orientation deviation from the target, right positive"),
    ("directional_commands", "", 1, "LEFT and RIGHT commands issued in this trial"),
    ("command", "", 1, "what the animal is told"),
    ("mode", "", 1, "what the controller is doing"),
    ("status", "", 1, "how the trial stands"),
    ("waypoint", "", 1, "number of waypoints reached"),
    ("anomaly", "", 1, "what keeps the controller from deciding"),
    ("flags", "", 1, "what is so on board: bits as in harness.radio.Flag"),
    ("mission_id", "", 1, "of the mission under way; else of the one held"),
    ("received", "", 1, "sequence number of the last message heard"),
    ("gps_frames", "", 1, "from the receiver, modulo 2^16"),
    ("gps_errors", "", 1, "wrong checksums"),
    ("imu_frames", "", 1, "from the inertial unit, modulo 2^16"),
    ("imu_errors", "", 1, "wrong checksums"),
    ("link_errors", "", 1, "wrong checksums"),
)


class Memory:
    """The record of a tick by names: `controller.output.distance`."""

    _kinds = recorded()
    _index = {name: i for i, name in enumerate(_kinds)}
    _real = np.array([kind is Type.REAL for kind in _kinds.values()])

    def __init__(self, record: bytes) -> None:
        words = np.frombuffer(record, "<u4")
        self.values = np.where(self._real, words.view("<f4"), words.view("<i4").astype(np.float64))

    def __getitem__(self, name: str) -> float:
        return float(self.values[self._index[name]])


class Operator:
    """The operator's laptop: keeps the vest in the state that is wished, by what the telemetry tells.

    Args:
        mission: what the vest is to do.
    """

    def __init__(self, mission: Mission) -> None:
        self.mission = mission
        self.decoder = Decoder()
        self._telemetry: Telemetry | None = None
        self._sequence = 0
        self._silent_since = -math.inf
        self._wish: tuple[bool, Command] | None = None

    def send(self, time: float, start: bool, override: Command, link_ok: bool) -> bytes:
        """What the laptop sends on a tick.

        Args:
            time: s.
            start: the trial is to be on.
            override: the operator's own command.
            link_ok: off: the radio is out of reach, and nothing passes either way.
        """
        if not link_ok:
            return b""
        wish = (start, override)
        if wish == self._wish and time < self._silent_since + RESEND - 1e-6:
            return b""
        messages: list[Message] = []
        flags = Flag(self._telemetry.flags) if self._telemetry else Flag(0)
        if self._telemetry is None or self._telemetry.mission_id != self.mission.id:
            messages.append(self.mission)
        begun = Flag.STARTED in flags or Flag.WAITING in flags
        if start and not begun:
            messages.append(Start(self.mission.id))
        if not start and (begun or wish != self._wish):
            messages.append(Abort())
        messages.append(Override(override))  # always: what got lost is said again
        self._wish, self._silent_since = wish, time
        return b"".join(self._frame(message) for message in messages)

    def _frame(self, message: Message) -> bytes:
        self._sequence += 1
        return encode(message, self._sequence)

    def receive(self, data: bytes) -> Telemetry | None:
        """The last telemetry in the bytes, if there is any."""
        found = self.decoder.receive(data)
        if found:
            self._telemetry = found[-1]
        return self._telemetry if found else None


class Onboard:
    """A processor with its instruments and its operator, in the place of the components of `ROLES`.

    Args:
        processor: what runs the onboard program.
        origin: latitude and longitude of north = east = 0 [deg].
        values: the controller's and the command module's parameters (SI) by component, mission included.
        pvt: the receiver is a newer one (see `Receiver`).

    Attributes:
        memory: all that the program remembers after the last tick.
        command: what the animal was told on it.
    """

    def __init__(
        self,
        processor: Processor,
        origin: tuple[float, float],
        values: Values,
        *,
        pvt: bool = False,
    ) -> None:
        self.processor = processor
        self.plane = TangentPlane(*(math.radians(x) for x in origin))
        self.receiver, self.unit = Receiver(self.plane, pvt), InertialUnit()
        self.operator = Operator(self._mission(values.get("controller", {})))
        self._commands = commands(values.get("command_module", {}))
        self._told: Telemetry | None = None
        self._rows: dict[float, Telemetry | None] = {}  # what was told last, by the tick's time
        self.tick = 0
        self.memory = Memory(processor.start)
        self.command = Command.NONE
        self._shift: tuple[float, float] | None = None
        self._parts: dict[str, StandIn] = {}
        self._sensors: Live = []

    def _mission(self, values: Mapping[str, float]) -> Mission:
        def position(north: str, east: str) -> Position:
            return Position(*self.plane.place(values.get(north, 0.0), values.get(east, 0.0)))

        count = min(int(values.get("waypoint_count", 1)), MAX_WAYPOINTS)
        waypoints = (position(f"waypoint_north[{i}]", f"waypoint_east[{i}]") for i in range(1, count + 1))
        return Mission(position("home_north", "home_east"), tuple(waypoints))

    def step(self, time: float, signals: Mapping[str, float], wishes: Mapping[str, float]) -> Reply:
        """One tick: the sensors' signals and the controller's free inputs in, commands and telemetry out.

        Raises:
            ProcessorError: the program runs away, or plays what is no command.
        """
        link_ok = bool(wishes.get("link_ok", 1.0))
        start, override = bool(wishes.get("start", 0.0)), Command(int(wishes.get("override", 0.0)))
        received = Received(
            self.receiver.fix(time, signals),
            self.unit.sample(self.tick, signals),
            self.operator.send(time, start, override, link_ok),
        )
        reply = self.processor.tick(received)
        self.tick += 1
        self.memory = Memory(reply.record)
        told = self.operator.receive(reply.sent) if link_ok else None
        self._told = told or self._told
        self._rows[time] = self._told
        played = (reply.tone_hz, reply.vibrate_left, reply.vibrate_right)
        if played not in self._commands:
            raise ProcessorError(
                f"{self.processor.image.path.name}: the vest plays {reply.tone_hz} Hz, left "
                f"{reply.vibrate_left}, right {reply.vibrate_right} at t = {time:.10g} s: that is no command"
            )
        self.command = self._commands[played]
        return reply

    def output(self, component: str, name: str) -> float:
        """An output of one of the components whose place it takes."""
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
                self.memory[f"local_plane.state.origin_{name}"] * UNIT for name in ("latitude", "longitude")
            )
            self._shift = self.plane.to_plane(latitude, longitude)
        return self._shift

    @staticmethod
    def channel() -> Channel:
        """How the telemetry stands in the log."""
        names = tuple(name.removesuffix("_ms") for name, *_ in SIGNALS)
        units = tuple(unit for _, unit, *_ in SIGNALS)
        kinds = tuple("Real" if unit else "Integer" for unit in units)
        return Channel("telemetry", "telemetry", names, units, kinds, tuple(m for *_, m in SIGNALS))

    def row(self, time: float) -> list[float]:
        """What the operator had been told last at the time of a tick: the log's row; zeros before."""
        told = self._rows.pop(time, None)
        return [factor * getattr(told, name, 0) for name, _, factor, _ in SIGNALS]

    def stand_ins(self, fmus: Mapping[str, FmuDescription]) -> dict[str, StandIn]:
        """What takes the places of the components' FMUs in the loop."""
        self._parts = {name: StandIn(self, name, fmus[name]) for name in ROLES}
        return self._parts

    def connect(self, sensors: Live) -> None:
        """Take the sensors' signals from where the loop puts them."""
        self._sensors = sensors

    def make_tick(self, time: float) -> None:
        """One tick of the loop, with what its other components say now."""
        self.step(time, _by_name(self._sensors), _by_name(self._parts["controller"].inputs))

    def close(self) -> None:
        """Stop the processor."""
        self.processor.close()


def commands(values: Mapping[str, float]) -> dict[tuple[int, bool, bool], Command]:
    """What the vest plays for each command.

    Raises:
        UsageError: two commands sound alike, or one is no whole number of Hz.
    """
    found = {(0, False, False): Command.NONE, (0, True, False): Command.LEFT, (0, False, True): Command.RIGHT}
    declared = settable(BLOCKS["command_module"])
    for name, command in TONES.items():
        tone = values.get(name, declared[name].start[0])
        played = (int(tone), False, False)
        if played in found or tone != played[0]:
            wrong = f"as for {found[played].name}" if played in found else "no whole number"
            raise UsageError(
                f"command_module.{name} is {tone:g} Hz, {wrong}; "
                "expected a tone of its own, since the animal hears nothing else"
            )
        found[played] = command
    return found


class StandIn:
    """A component of the loop that is a part of the onboard computer: the first of them makes its tick."""

    def __init__(self, onboard: Onboard, name: str, description: FmuDescription) -> None:
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
        """As of an FMU: inputs are read from there when the tick is made."""
        self.inputs.append(([q.name for q in quantities], _values(quantities, address)))
        return _nothing, (object(),)  # arguments of its own: by them the loop tells calls apart

    def getting(self, quantities: Sequence[Quantity], address: int) -> Call:
        """As of an FMU."""
        return self._answer, ([q.name for q in quantities], _values(quantities, address))

    def _answer(self, names: Iterable[str], values: npt.NDArray[Any]) -> None:
        values[:] = [self.onboard.output(self.name, name) for name in names]

    def stepping(self, time: Any, step: float, ended: int) -> Call:
        """As of an FMU; `time` is a ctypes double."""
        return (self._tick if self.name == "estimator" else _nothing), (time,)

    def _tick(self, time: Any) -> None:
        self.onboard.make_tick(time.value)

    def check(self, status: int, what: str, time: float) -> None:
        """Nothing of it returns a status."""

    def close(self) -> None:
        """Nothing is its own."""


def _by_name(live: Live) -> dict[str, float]:
    return {n: float(v) for names, values in live for n, v in zip(names, values, strict=True)}


def _values(quantities: Sequence[Quantity], address: int) -> npt.NDArray[Any]:
    kind: Any = np.ctypeslib.as_ctypes_type(np.dtype(quantities[0].access.dtype).str)
    return np.ctypeslib.as_array((kind * len(quantities)).from_address(address))


def _nothing(_: Any) -> None:
    pass
