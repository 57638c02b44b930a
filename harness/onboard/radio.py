"""The laptop's side of the radio to the vest: the frames of codegen/firmware/onboard/link.h.

A frame: A5 5A, type, length of the payload, counter u32, payload, tag of 8 bytes, CRC-16/CCITT-FALSE of type
to tag. Big-endian. An XBee in transparent mode carries bytes without bounds, acknowledgement or checksum,
hence the frame. A lost message is repeated until the telemetry shows that it arrived.

The tag is SipHash-2-4 by the vest's key over the frame from type to payload, and the session. Session and
counter make a recorded frame worthless; a nonce, which the telemetry returns, makes recorded telemetry so.
"""

from __future__ import annotations

import hmac
import secrets
import struct
from binascii import crc_hqx
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

from siphashc import siphash

from codegen.firmware.key import Key
from codegen.firmware.telemetry import PAYLOAD, Telemetry
from models.cmec import MAX_WAYPOINTS
from models.commands import Command
from models.errors import UsageError
from models.fence import fault_of

SYNC = b"\xa5\x5a"
HEADER = struct.Struct(">2sBBI")  # sync, type, length of the payload, counter
TAG = 8  # bytes
CRC = struct.Struct(">H")
ANSWERED = 8  # bits of a counter below the number of a telemetry
LAST = 2**32 - 1  # counter
MAX_LATITUDE, MAX_LONGITUDE = 90.0, 180.0  # deg
HALF_TURN = 1_800_000_000  # units of 1e-7 deg


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
    """Home, waypoints and fence, one frame: the vest has it whole or not at all.

    While a mission is under way, or has ended without an ABORT, the vest refuses any.

    Attributes:
        fence: corners of a polygon that the animal may not leave, in order (rule 7); none for no fence.
    """

    type: ClassVar[int] = 1
    home: Position
    waypoints: tuple[Position, ...]
    fence: tuple[Position, ...] = ()

    def payload(self) -> bytes:
        """Its id, u16; the number of corners, u8; the corners; home; the waypoints.

        Raises:
            RadioError: the number of waypoints is not 1 to MAX_WAYPOINTS, a position is out of range, or the
                fence is no polygon, as sent.
        """
        if not 1 <= len(self.waypoints) <= MAX_WAYPOINTS:
            raise RadioError(f"a mission has 1 to {MAX_WAYPOINTS} waypoints, got {len(self.waypoints)}")
        if self.fence and (fault := fault_of(self._corners())):
            raise RadioError(f"the fence of a mission is no polygon: {fault}")
        content = self._content()
        return struct.pack(">H", crc16(content)) + content

    def _corners(self) -> list[tuple[int, int]]:
        """The fence in units of 1e-7 deg, as it is sent; longitudes from the first, the short way round."""
        corners = [struct.unpack(">ii", position.payload()) for position in self.fence]
        _, first = corners[0]
        return [(north, (east - first + HALF_TURN) % (2 * HALF_TURN)) for north, east in corners]

    def _content(self) -> bytes:
        positions = (*self.fence, self.home, *self.waypoints)
        return bytes([len(self.fence)]) + b"".join(position.payload() for position in positions)

    @property
    def id(self) -> int:
        """The content's CRC, by which it is started; the telemetry shows that of the mission held."""
        return crc16(self._content())


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

    It holds for `watchdog.override_timeout` unless it is sent again; STOP holds until the link is lost.
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
    """The laptop is there. Payload: u32.

    Attributes:
        nonce: what the telemetry has to return; not 0.
    """

    type: ClassVar[int] = 5
    nonce: int

    def payload(self) -> bytes:
        """The nonce."""
        return struct.pack(">I", self.nonce)


Message = Mission | Start | Override | Abort | Heartbeat


@dataclass(frozen=True)
class Seal:
    """What signs the frames of a session.

    Attributes:
        key: None for a vest whose program was built without one.
    """

    key: Key | None
    session: int

    def tag(self, signed: bytes) -> bytes:
        """The tag of a frame's bytes from type to payload."""
        if self.key is None:
            return bytes(TAG)
        tag: int = siphash(self.key.data, signed + struct.pack(">I", self.session))
        return tag.to_bytes(TAG, "little")


def encode(message: Message | Telemetry, counter: int, seal: Seal) -> bytes:
    """The message as a frame.

    Raises:
        RadioError: the vest would refuse it.
    """
    payload = message.payload()
    signed = HEADER.pack(SYNC, message.type, len(payload), counter)[len(SYNC) :] + payload
    body = signed + seal.tag(signed)
    return SYNC + body + CRC.pack(crc16(body))


class Decoder:
    """Finds the telemetry in the radio's bytes, which may be cut, damaged, forged or mixed with others.

    Args:
        key: of the vest; None takes any telemetry.

    Attributes:
        frames: with a right CRC and a right tag.
        errors: with a wrong CRC.
        forged: with a right CRC and a wrong tag.
    """

    SIZE = HEADER.size + PAYLOAD.size + TAG + CRC.size

    def __init__(self, key: Key | None) -> None:
        self.frames = self.errors = self.forged = 0
        self._key = key
        self._held = b""

    def receive(self, data: bytes) -> list[tuple[int, Telemetry]]:
        """The telemetry that these bytes complete, with its counters, in order."""
        begin = SYNC + bytes([Telemetry.type])
        self._held += data
        telemetry = []
        while (start := self._held.find(begin)) >= 0 and start + self.SIZE <= len(self._held):
            frame = self._held[start : start + self.SIZE]
            _, _, length, counter = HEADER.unpack_from(frame)
            taken = len(SYNC)  # a false frame is searched again behind its sync
            if length == PAYLOAD.size:
                if crc16(frame[len(SYNC) :]) == 0:  # the remainder over a frame with its CRC
                    taken = self.SIZE
                    telemetry += [(counter, report) for report in self._genuine(frame)]
                else:
                    self.errors += 1
            self._held = self._held[start + taken :]
        self._held = self._held[start:] if start >= 0 else self._held[-len(begin) + 1 :]
        return telemetry

    def _genuine(self, frame: bytes) -> list[Telemetry]:
        """The telemetry in a frame, if its tag is right."""
        report = Telemetry.from_payload(frame[HEADER.size : HEADER.size + PAYLOAD.size])
        tag = frame[HEADER.size + PAYLOAD.size : -CRC.size]
        expected = Seal(self._key, report.session).tag(frame[len(SYNC) : -TAG - CRC.size])
        if self._key is not None and not hmac.compare_digest(tag, expected):
            self.forged += 1
            return []
        self.frames += 1
        return [report]


def draw_nonce() -> int:
    """A number that nobody foresees, 1 to 2^32 - 1."""
    return 1 + secrets.randbelow(LAST)


class Link:
    """The laptop's end of the radio: it signs, counts, and believes only a vest that answers it.

    Telemetry is believed once it returns the nonce that was drawn when its session was first heard: a
    recording cannot. Whoever plays one drives the laptop into a wrong session, whose frames the vest does not
    obey; that is counted in `sessions` and `unanswered`.

    Args:
        key: of the vest; None for a program that was built without one.
        draw: gives a nonce, never twice the same.

    Attributes:
        decoder: with the counts of its frames.
        replayed: telemetry whose counter did not grow.
        lost: telemetry that the counters skip.
        sessions: that were begun; a vest that is reset begins another.
        unanswered: telemetry that did not return the nonce.
        counter: of the last frame sent in this session.
        nonce: of this session; 0 before telemetry was heard.
    """

    def __init__(self, key: Key | None, draw: Callable[[], int] = draw_nonce) -> None:
        self.decoder, self.key, self._draw = Decoder(key), key, draw
        self.replayed = self.lost = self.sessions = self.unanswered = 0
        self.counter = self.nonce = 0
        self._session: int | None = None
        self._heard = 0  # counter of the last telemetry

    @property
    def open(self) -> bool:
        """A session has been heard, so frames can be signed."""
        return self._session is not None

    def encode(self, message: Message) -> bytes:
        """The message as this session's next frame.

        Raises:
            RadioError: no telemetry was heard yet, the vest would refuse the message, or the session has no
                counter left.
        """
        if self._session is None:
            raise RadioError(
                "no telemetry was heard, so nothing can be signed; is the vest on, its key this one?"
            )
        counter = max(self.counter + 1, self._heard << ANSWERED)
        if counter > LAST:
            raise RadioError(
                "the vest has been on for more than 38 days, and has no counter left: restart it"
            )
        frame = encode(message, counter, Seal(self.key, self._session))
        self.counter = counter
        return frame

    def receive(self, data: bytes) -> list[Telemetry]:
        """The telemetry in these bytes that is the vest's, new, and an answer."""
        return [report for counter, report in self.decoder.receive(data) if self._believes(counter, report)]

    def _believes(self, counter: int, report: Telemetry) -> bool:
        if report.session != self._session:
            self._session, self.counter, self.nonce = report.session, 0, self._draw()
            self.sessions += 1
        elif counter <= self._heard:
            self.replayed += 1
            return False
        else:
            self.lost += counter - self._heard - 1
        self._heard = counter
        answers = report.nonce == self.nonce
        self.unanswered += not answers
        return answers
