"""The laptop's side of the radio to the vest: the frames of codegen/firmware/onboard/link.h.

A frame: A5 5A, type, sequence number, length of the payload, payload, CRC-16/CCITT-FALSE of type to payload.
Big-endian. An XBee in transparent mode carries bytes without bounds, acknowledgement or checksum, hence the
frame. A lost message is repeated until the telemetry shows that it arrived.
"""

from __future__ import annotations

import struct
from binascii import crc_hqx
from dataclasses import dataclass
from typing import ClassVar

from codegen.firmware.telemetry import PAYLOAD, Telemetry
from models.cmec import MAX_WAYPOINTS
from models.commands import Command
from models.errors import UsageError

SYNC = b"\xa5\x5a"
HEADER = struct.Struct(">2sBBB")  # sync, type, sequence number, length of the payload
CRC = struct.Struct(">H")
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
            RadioError: latitude or longitude is out of range.
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
    """Home and waypoints, one frame: the vest has it whole or not at all. Payload: their positions.

    While a mission is under way, or has ended without an ABORT, the vest refuses any.
    """

    type: ClassVar[int] = 1
    home: Position
    waypoints: tuple[Position, ...]

    def payload(self) -> bytes:
        """Its id, u16; home; the waypoints.

        Raises:
            RadioError: the number of waypoints is not 1 to MAX_WAYPOINTS, or a position is out of range.
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
    """Begin the mission of this id, at once or not at all. Payload: u16.

    The vest refuses if it is not ready, and the telemetry says why (`Refusal`).
    """

    type: ClassVar[int] = 2
    mission_id: int

    def payload(self) -> bytes:
        """The id."""
        return struct.pack(">H", self.mission_id)


@dataclass(frozen=True)
class Override:
    """The operator's command beats the controller's until `Command.NONE` releases it. Payload: u8.

    It holds for `watchdog.override_timeout` unless it is sent again.
    """

    type: ClassVar[int] = 3
    command: Command

    def payload(self) -> bytes:
        """The command's number."""
        return bytes([self.command])


@dataclass(frozen=True)
class Abort:
    """End the mission and the override. No payload."""

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


def encode(message: Message | Telemetry, sequence: int) -> bytes:
    """The message as a frame.

    Args:
        sequence: number of the message, counted by its sender modulo 256; the laptop begins at 1, since
            the telemetry says 0 until a message was taken.

    Raises:
        RadioError: the vest would refuse it.
    """
    payload = message.payload()
    frame = HEADER.pack(SYNC, message.type, sequence % 256, len(payload)) + payload
    return frame + CRC.pack(crc16(frame[len(SYNC) :]))


class Decoder:
    """Finds the telemetry in the radio's bytes, which may be cut, damaged or mixed with others.

    Attributes:
        frames: valid ones.
        errors: frames with a wrong CRC.
        lost: telemetry that the sequence numbers skip (modulo 256).
    """

    SIZE = HEADER.size + PAYLOAD.size + CRC.size

    def __init__(self) -> None:
        self.frames = self.errors = self.lost = 0
        self._held = b""
        self._sequence: int | None = None

    def receive(self, data: bytes) -> list[Telemetry]:
        """The telemetry that these bytes complete, in order."""
        begin = SYNC + bytes([Telemetry.type])
        self._held += data
        telemetry = []
        while (start := self._held.find(begin)) >= 0 and start + self.SIZE <= len(self._held):
            frame = self._held[start : start + self.SIZE]
            _, _, sequence, length = HEADER.unpack_from(frame)
            taken = len(SYNC)  # a false frame is searched again behind its sync
            if length == PAYLOAD.size:
                if crc16(frame[len(SYNC) :]) == 0:  # the remainder over a frame with its CRC
                    telemetry.append(Telemetry.from_payload(frame[HEADER.size : -CRC.size]))
                    self._count(sequence)
                    taken = self.SIZE
                else:
                    self.errors += 1
            self._held = self._held[start + taken :]
        self._held = self._held[start:] if start >= 0 else self._held[-len(begin) + 1 :]
        return telemetry

    def _count(self, sequence: int) -> None:
        if self._sequence is not None:
            self.lost += (sequence - self._sequence - 1) % 256
        self._sequence = sequence
        self.frames += 1
