"""The telemetry, stated once: what the vest tells the operator.

From `Telemetry`, `Flag` and `Ready` come the struct and its writer in C (templates/telemetry.[hc].jinja), the
laptop's reader (harness/onboard/radio.py) and the signals of the log (harness/onboard/stand_in.py).
"""

from __future__ import annotations

import math
import struct
from dataclasses import astuple, dataclass
from enum import IntEnum, IntFlag
from itertools import accumulate
from typing import Annotated, ClassVar, Self, get_type_hints

TYPES = {"uint8_t": "B", "uint16_t": "H", "uint32_t": "I", "int16_t": "h", "int32_t": "i"}  # C: struct
POSITION_UNIT = math.radians(1e-7)  # rad: latitudes and longitudes on board and by radio
UNITS: dict[str, tuple[str, float]] = {  # by radio: SI, factor to it
    "": ("", 1),
    "ms": ("s", 1e-3),
    "ds": ("s", 1e-1),
    "1e-7 deg": ("rad", POSITION_UNIT),
    "1e-4 rad": ("rad", 1e-4),
    "cm/s": ("m/s", 1e-2),
    "cm": ("m", 1e-2),
    "dm": ("m", 1e-1),
    "mV": ("V", 1e-3),
    "0.1 degC": ("degC", 1e-1),
}


@dataclass(frozen=True)
class Wire:
    """How a field is sent.

    Attributes:
        type: of C; big-endian by radio.
        unit: of the whole number that is sent, one of UNITS; "" for a count, a choice or bits.
    """

    type: str
    unit: str
    meaning: str

    @property
    def size(self) -> int:
        """Bytes by radio."""
        return struct.calcsize(f">{TYPES[self.type]}")

    @property
    def signed(self) -> bool:
        """It can be below 0."""
        return not self.type.startswith("u")

    @property
    def si(self) -> str:
        """The unit in the log, "" for a whole number."""
        return UNITS[self.unit][0]

    @property
    def factor(self) -> float:
        """From the number by radio to the value in the log."""
        return UNITS[self.unit][1]

    @property
    def comment(self) -> str:
        """Unit and meaning, for C."""
        return f"{self.unit}: {self.meaning}" if self.unit else self.meaning


class Bits(IntFlag):
    """Bits of a field, each with its meaning."""

    meaning: str

    def __new__(cls, bit: int, meaning: str = "") -> Self:
        flag = int.__new__(cls, bit)
        flag._value_, flag.meaning = bit, meaning
        return flag

    @classmethod
    def listed(cls) -> str:
        """Their names, the lowest first."""
        return ", ".join(str(bit.name).lower() for bit in cls)


class Flag(Bits):
    """Conditions on board: the bits of `Telemetry.flags`. In C each is a bool of the struct."""

    VALID = 0x01, "the estimate may be trusted"
    IMU_OK = 0x02, "samples come"
    LINK_OK = 0x04, "the operator is heard"
    FIXED = 0x08, "there has been a fix"
    LOADED = 0x10, "a mission is held"
    STARTED = 0x20, "the mission is under way, or has ended"
    INSECURE = 0x40, "the program was built without a key: frames are not verified"


class Ready(Bits):
    """What a START needs (rule 8): the bits of `Telemetry.ready`. In C macros, READY_LINK and so on."""

    LINK = 0x001, "the operator is heard"
    IMU = 0x002, "samples come"
    FIX = 0x004, "there has been a fix"
    ACCURACY = 0x008, "the last fix is accurate to the controller's capture radius"
    ESTIMATE = 0x010, "the estimate may be trusted"
    MISSION = 0x020, "a mission is held"
    REACH = 0x040, "home and all waypoints are within the controller's range"
    LEGS = 0x080, "each waypoint is farther from the one before than the capture radius"
    FIRST_LEG = 0x100, "the first waypoint is farther from the animal than the capture radius"
    RELEASED = 0x200, "no override is in force"
    IDLE = 0x400, "the controller is idle"
    PLANNED = 0x800, "all places of the mission are projected; until then its other bits may go off"
    HEADING = 0x1000, "courses do not contradict the heading"
    FENCE = 0x2000, "home and all waypoints are inside the fence of the mission, if it has one"
    INSIDE = 0x4000, "the animal is inside that fence"
    BUDGET = 0x8000, "the window leaves something of each stimulus"
    BATTERY = 0x10000, "the battery's voltage is not below its limit, or not told by the board"
    TEMPERATURE = 0x20000, "the temperature is within its limits, or not told by the board"
    AGREEMENT = 0x40000, "the estimator has not rejected the last good fix"

    @property
    def missing(self) -> tuple[Ready, ...]:
        """The bits that are off."""
        return tuple(bit for bit in Ready if bit not in self)


class Refusal(IntEnum):
    """Why the last START was refused, in words; NONE once one was accepted.

    From NOT_READY on it is the first bit of `Ready` that was missing: each reason is its number from there.
    """

    words: str

    def __new__(cls, number: int, words: str = "") -> Self:
        refusal = int.__new__(cls, number)
        refusal._value_, refusal.words = number, words
        return refusal

    NONE = 0, "none was refused"
    OTHER_MISSION = 1, "the vest holds another mission"
    NO_LINK = 2, "the vest does not hear the operator"
    NO_IMU = 3, "the inertial unit is silent"
    NO_FIX = 4, "there has been no fix"
    NOT_ACCURATE = 5, "the last fix is not accurate to the controller's capture radius"
    NO_ESTIMATE = 6, "the estimate cannot be trusted"
    NO_MISSION = 7, "the vest holds no mission"
    OUT_OF_REACH = 8, "home or a waypoint is beyond the controller's range"
    SHORT_LEG = 9, "two waypoints in a row are closer than the capture radius"
    SHORT_FIRST_LEG = 10, "the animal is closer to the first waypoint than the capture radius"
    OVERRIDDEN = 11, "an override is in force"
    NOT_IDLE = 12, "a trial is under way, or has ended without an ABORT, or its stop is still held"
    NOT_PLANNED = 13, "the vest has not yet projected all places of the mission, one on a tick"
    CONTRADICTED = 14, "courses contradict the heading"
    OUTSIDE_FENCE = 15, "home or a waypoint is outside the fence"
    ANIMAL_OUTSIDE = 16, "the animal is outside the fence"
    WINDOW_SPENT = 17, "what may be spent in the window is spent: wait"
    LOW_BATTERY = 18, "the battery's voltage is below its limit"
    BAD_TEMPERATURE = 19, "the pack is too cold or too hot"
    FIX_REJECTED = 20, "the last fix contradicts the estimate"


NOT_READY = 2  # number of the refusal for the lowest bit of `Ready`


@dataclass(frozen=True)
class Telemetry:
    """State of the vest and the animal. Payload: the fields in this order.

    `command`, `mode`, `status` and `anomaly` are numbers of the controller's enumerations of these names.
    The counts of errors stop at 65535, or 255; `rejected_fixes` stops at 30000.
    """

    type: ClassVar[int] = 16
    time_ms: Annotated[int, Wire("uint32_t", "ms", "since power-up")]
    latitude: Annotated[int, Wire("int32_t", "1e-7 deg", "of the estimate")]
    longitude: Annotated[int, Wire("int32_t", "1e-7 deg", "of the estimate")]
    speed: Annotated[int, Wire("int16_t", "cm/s", "estimated ground speed")]
    heading: Annotated[int, Wire("int16_t", "1e-4 rad", "estimated heading, clockwise from north")]
    position_sd: Annotated[int, Wire("uint16_t", "cm", "standard deviation of the position")]
    speed_sd: Annotated[int, Wire("uint16_t", "cm/s", "standard deviation of the speed")]
    distance: Annotated[int, Wire("uint16_t", "dm", "distance to the target")]
    deviation: Annotated[
        int, Wire("int16_t", "1e-4 rad", "orientation deviation from the target, right positive")
    ]
    directional_commands: Annotated[int, Wire("uint16_t", "", "LEFT and RIGHT commands issued in this trial")]
    command: Annotated[int, Wire("uint8_t", "", "what the animal is told")]
    mode: Annotated[int, Wire("uint8_t", "", "what the controller is doing")]
    status: Annotated[int, Wire("uint8_t", "", "how the trial stands")]
    waypoint: Annotated[int, Wire("uint8_t", "", "number of waypoints reached")]
    anomaly: Annotated[int, Wire("uint8_t", "", "what keeps the controller from deciding")]
    last_anomaly: Annotated[
        int, Wire("uint8_t", "", "the controller's last one since START, such as a limit broken")
    ]
    issues_left: Annotated[
        int, Wire("uint16_t", "", "LEFT and RIGHT that may be issued, 65535 without limits")
    ]
    vibration_left: Annotated[int, Wire("uint16_t", "ds", "that the budget leaves, 6553.5 s without limits")]
    tone_left: Annotated[int, Wire("uint16_t", "ds", "that the budget leaves, 6553.5 s without limits")]
    flags: Annotated[int, Wire("uint8_t", "", f"conditions on board, the lowest bit first: {Flag.listed()}")]
    ready: Annotated[int, Wire("uint32_t", "", f"what a START needs, the lowest bit first: {Ready.listed()}")]
    refusal: Annotated[int, Wire("uint8_t", "", "why the last START was refused, 0 once one was accepted")]
    mission_id: Annotated[int, Wire("uint16_t", "", "of the mission held; while one is under way that is it")]
    session: Annotated[int, Wire("uint32_t", "", "number of the vest's session, another after each reset")]
    received: Annotated[int, Wire("uint32_t", "", "counter of the last frame accepted, 0 before the first")]
    nonce: Annotated[int, Wire("uint32_t", "", "of the last HEARTBEAT, 0 before the first")]
    gps_frames: Annotated[int, Wire("uint16_t", "", "from the receiver, modulo 2^16")]
    gps_errors: Annotated[int, Wire("uint16_t", "", "wrong checksums")]
    imu_frames: Annotated[int, Wire("uint16_t", "", "from the inertial unit, modulo 2^16")]
    imu_errors: Annotated[int, Wire("uint16_t", "", "wrong checksums")]
    link_errors: Annotated[int, Wire("uint16_t", "", "wrong checksums")]
    link_forged: Annotated[int, Wire("uint16_t", "", "frames with a wrong tag")]
    link_replayed: Annotated[int, Wire("uint16_t", "", "frames that came before, or too late")]
    rejected_fixes: Annotated[int, Wire("uint16_t", "", "fixes that the estimator rejected")]
    jumps: Annotated[int, Wire("uint8_t", "", "corrections that moved the position by more than allowed")]
    recoveries: Annotated[int, Wire("uint8_t", "", "times that the estimator began anew")]
    battery: Annotated[int, Wire("uint16_t", "mV", "of the board's battery, 0 if it does not tell")]
    temperature: Annotated[int, Wire("int16_t", "0.1 degC", "of the pack, -32768 if it does not tell")]

    @property
    def refused(self) -> Refusal:
        """Why the last START was refused; NONE too for a number that is none of ours."""
        return Refusal(self.refusal) if self.refusal in set(Refusal) else Refusal.NONE

    def payload(self) -> bytes:
        """The fields packed."""
        return PAYLOAD.pack(*astuple(self))

    @classmethod
    def from_payload(cls, data: bytes) -> Telemetry:
        """The fields unpacked, of PAYLOAD.size bytes."""
        return cls(*PAYLOAD.unpack(data))


FIELDS: dict[str, Wire] = {
    name: hint.__metadata__[0]
    for name, hint in get_type_hints(Telemetry, include_extras=True).items()
    if hasattr(hint, "__metadata__")
}
OFFSETS = dict(zip(FIELDS, accumulate((wire.size for wire in FIELDS.values()), initial=0), strict=False))
PAYLOAD = struct.Struct(">" + "".join(TYPES[wire.type] for wire in FIELDS.values()))
