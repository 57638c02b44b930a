"""Frames for a simulated vest in its first session."""

from __future__ import annotations

from codegen.firmware.key import SIMULATION_KEY
from codegen.firmware.telemetry import Telemetry
from harness.onboard import radio

SESSION = 1
SEAL = radio.Seal(SIMULATION_KEY, SESSION)


def encode(message: radio.Message | Telemetry, counter: int, seal: radio.Seal = SEAL) -> bytes:
    """The message as a frame; with a counter below 256 it answers no telemetry."""
    return radio.encode(message, counter, seal)


def answering(tick: int) -> int:
    """A counter for a frame of a tick, one in each at most, that answers a telemetry told by then."""
    return max(0, tick // 5 - 2) * 256 + tick % 5 + 1


def raw_frame(kind: int, payload: bytes, counter: int = 77, seal: radio.Seal = SEAL) -> bytes:
    """Any payload, signed, as a frame: A5 5A, type, length, counter, payload, tag, CRC."""
    signed = bytes([kind, len(payload)]) + counter.to_bytes(4, "big") + payload
    return with_crc(signed + seal.tag(signed))


def with_crc(body: bytes) -> bytes:
    """What stands between sync and CRC, with both."""
    return b"\xa5\x5a" + body + radio.crc16(body).to_bytes(2, "big")
