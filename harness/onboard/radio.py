"""The laptop's side of the radio to the vest: the frames of codegen/firmware/onboard/link.h.

A frame: A5 5A, type, sequence number, length of the payload, payload, CRC-16/CCITT-FALSE of type to payload.
Big-endian. An XBee in transparent mode carries the bytes without bounds, acknowledgement or checksum, hence
the frame; what got lost is repeated until the telemetry shows that it arrived.
"""

from __future__ import annotations

import struct
from binascii import crc_hqx
from dataclasses import astuple, dataclass, fields
from enum import IntFlag
from typing import Annotated, ClassVar, get_type_hints

from models.commands import Command
from models.errors import UsageError

SYNC = b"\xa5\x5a"
HEADER = struct.Struct(">2sBBB")  # sync, type, sequence number, length of the payload
CRC = struct.Struct(">H")
MAX_WAYPOINTS = 16
MAX_LATITUDE, MAX_LONGITUDE = 90.0, 180.0  # deg


class RadioError(UsageError):
    """A message that the vest would refuse."""


def crc16(data: bytes) -> int:
    """CRC-16/CCITT-FALSE: polynomial 0x1021, from 0xFFFF."""
    return crc_hqx(data, 0xFFFF)


@dataclass(frozen=True)
class Position:
    """Latitude and longitude in deg; sent in units of 1e-7 deg, 1 cm on the ground."""

    latitude: float
    longitude: float

    def payload(self) -> bytes:
        """Two i32.

        Raises:
            RadioError: it is not on earth.
        """
        for name, value, limit in (
            ("latitude", self.latitude, MAX_LATITUDE),
            ("longitude", self.longitude, MAX_LONGITUDE),
        ):
            if not -limit <= value <= limit:
                raise RadioError(f"{name} is {value:g}, expected -{limit:g} to {limit:g} deg")
        return struct.pack(">ii", round(self.latitude * 1e7), round(self.longitude * 1e7))


@dataclass(frozen=True)
class Mission:
    """Home and waypoints, one frame: the vest has it whole or not at all. Payload: their positions."""

    type: ClassVar[int] = 1
    home: Position
    waypoints: tuple[Position, ...]

    def payload(self) -> bytes:
        """Its id, u16; home; the waypoints.

        Raises:
            RadioError: there are not 1 to 16 waypoints, or one is not on earth.
        """
        if not 1 <= len(self.waypoints) <= MAX_WAYPOINTS:
            raise RadioError(f"a mission has 1 to {MAX_WAYPOINTS} waypoints, got {len(self.waypoints)}")
        return struct.pack(">H", self.id) + self._positions()

    def _positions(self) -> bytes:
        return b"".join(position.payload() for position in (self.home, *self.waypoints))

    @property
    def id(self) -> int:
        """The positions' CRC, by which it is started; the telemetry shows that of the mission held."""
        return crc16(self._positions())


@dataclass(frozen=True)
class Start:
    """Begin the mission of this id; the vest refuses if it holds another. Payload: u16."""

    type: ClassVar[int] = 2
    mission_id: int

    def payload(self) -> bytes:
        """The id."""
        return struct.pack(">H", self.mission_id)


@dataclass(frozen=True)
class Override:
    """The operator's command beats the controller's until `Command.NONE` releases it. Payload: u8."""

    type: ClassVar[int] = 3
    command: Command

    def payload(self) -> bytes:
        """The command's number."""
        return bytes([self.command])


@dataclass(frozen=True)
class Abort:
    """End the mission. No payload."""

    type: ClassVar[int] = 4

    def payload(self) -> bytes:
        """Nothing."""
        return b""


@dataclass(frozen=True)
class Heartbeat:
    """The laptop is there. No payload."""

    type: ClassVar[int] = 5

    def payload(self) -> bytes:
        """Nothing."""
        return b""


Message = Mission | Start | Override | Abort | Heartbeat


class Flag(IntFlag):
    """What is so on board: bits of `Telemetry.flags`."""

    VALID = 0x01  # the estimate
    IMU_OK = 0x02  # samples come
    LINK_OK = 0x04  # the laptop is heard
    FIXED = 0x08  # there has been a fix
    LOADED = 0x10  # a mission is held
    STARTED = 0x20  # it is under way, or has ended
    WAITING = 0x40  # a START waits for a fix, or for the end of a stop


U8 = Annotated[int, "B"]  # as struct names them
U16 = Annotated[int, "H"]
U32 = Annotated[int, "I"]
I16 = Annotated[int, "h"]
I32 = Annotated[int, "i"]


@dataclass(frozen=True)
class Telemetry:
    """How the vest and the animal are, 5 times a second. Payload: the fields in this order."""

    type: ClassVar[int] = 16
    time_ms: U32  # ms since power-up
    latitude: I32  # 1e-7 deg, estimate
    longitude: I32  # 1e-7 deg, estimate
    speed: I16  # cm/s
    heading: I16  # 1e-4 rad, clockwise from north
    position_sd: U16  # cm
    speed_sd: U16  # cm/s
    distance: U16  # dm, to the target
    deviation: I16  # 1e-4 rad, of the orientation from the target, right positive
    directional_commands: U16  # LEFT and RIGHT issued in this trial
    command: U8  # models.commands.Command
    mode: U8  # models.cmec.Mode
    status: U8  # models.commands.Status
    waypoint: U8  # number of waypoints reached
    anomaly: U8  # models.cmec.Anomaly
    flags: U8  # Flag
    mission_id: U16  # of the mission under way; else of the one held
    received: U8  # sequence number of the last message taken from the laptop
    gps_frames: U16  # modulo 2^16
    gps_errors: U16  # wrong checksums; this and the other errors stop at 65535
    imu_frames: U16  # modulo 2^16
    imu_errors: U16  # wrong checksums
    link_errors: U16  # wrong checksums

    def payload(self) -> bytes:
        """The fields packed."""
        return TELEMETRY.pack(*astuple(self))


_TYPES = get_type_hints(Telemetry, include_extras=True)
TELEMETRY = struct.Struct(">" + "".join(_TYPES[f.name].__metadata__[0] for f in fields(Telemetry)))


def encode(message: Message | Telemetry, sequence: int) -> bytes:
    """The message as a frame.

    Args:
        sequence: number of the message, counted by its sender modulo 256; the laptop begins at 1, since
            the vest tells 0 while it has taken none.

    Raises:
        RadioError: the vest would refuse it.
    """
    payload = message.payload()
    frame = HEADER.pack(SYNC, message.type, sequence % 256, len(payload)) + payload
    return frame + CRC.pack(crc16(frame[len(SYNC) :]))


class Decoder:
    """Finds the telemetry in what the radio brings, however it is cut, damaged or mixed with other bytes.

    Attributes:
        frames: found.
        errors: frames with a wrong CRC.
        lost: telemetry that the sequence numbers jumped over, as far as they tell (modulo 256).
    """

    SIZE = HEADER.size + TELEMETRY.size + CRC.size

    def __init__(self) -> None:
        self.frames = self.errors = self.lost = 0
        self._held = b""
        self._sequence: int | None = None

    def receive(self, data: bytes) -> list[Telemetry]:
        """The telemetry that these bytes complete, in order."""
        begin = SYNC + bytes([Telemetry.type])
        self._held += data
        found = []
        while (start := self._held.find(begin)) >= 0 and start + self.SIZE <= len(self._held):
            frame = self._held[start : start + self.SIZE]
            _, _, sequence, length = HEADER.unpack_from(frame)
            taken = len(SYNC)  # a false frame is searched again behind its sync
            if length == TELEMETRY.size:
                if crc16(frame[len(SYNC) :]) == 0:  # the remainder over a frame with its CRC
                    found.append(Telemetry(*TELEMETRY.unpack_from(frame, HEADER.size)))
                    self._count(sequence)
                    taken = self.SIZE
                else:
                    self.errors += 1
            self._held = self._held[start + taken :]
        self._held = self._held[start:] if start >= 0 else self._held[-len(begin) + 1 :]
        return found

    def _count(self, sequence: int) -> None:
        if self._sequence is not None:
            self.lost += (sequence - self._sequence - 1) % 256
        self._sequence = sequence
        self.frames += 1
