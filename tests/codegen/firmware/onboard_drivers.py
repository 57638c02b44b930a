"""The onboard drivers as a library, with the structs of their headers, and frames made without them."""

from __future__ import annotations

import ctypes
import os
import struct
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from pyubx2 import calc_checksum

from codegen.blocks.block_c import write_files
from codegen.firmware.bundle import headers, key_files, program
from codegen.firmware.key import SIMULATION_KEY, Key
from codegen.toolchains.compiler import NUMERICS, WARNINGS, build_library
from harness.onboard import radio
from models.commands import Command
from tests.harness.onboard.frames import encode

SOURCES = ("scanner.c", "ubx.c", "mt.c", "link.c", "siphash.c", "telemetry.c", "key.c")
TYPES: dict[str, Any] = {
    "uint8_t": ctypes.c_uint8, "uint16_t": ctypes.c_uint16, "uint32_t": ctypes.c_uint32,
    "int16_t": ctypes.c_int16, "int32_t": ctypes.c_int32, "float": ctypes.c_float, "bool": ctypes.c_bool,
    "uint8_t *": ctypes.c_void_p, "function *": ctypes.c_void_p,
}  # fmt: skip
PROJECT = Path(__file__).resolve().parents[3]
DATA = Path(os.environ.get("CANINE_DATA", PROJECT.parent / "shared" / "data"))
POSLLH, SOL, PVT, VELNED = 0x02, 0x06, 0x07, 0x12
NOTHING, FRAME, FIX = range(3)
MISSION, START, OVERRIDE, ABORT, HEARTBEAT = range(1, 6)


def _structs() -> dict[str, Any]:
    """The structs of the drivers' headers as ctypes, each behind those that it holds."""
    declared, made = headers().structs, dict[str, Any]()

    def declare(name: str) -> Any:
        if name not in made:
            kinds = [(m, TYPES.get(m.type) or declare(m.type)) for m in declared[name]]
            fields = [(m.name, kind * m.size if m.size else kind) for m, kind in kinds]
            made[name] = type(name, (ctypes.Structure,), {"_fields_": fields})
        return made[name]

    for name in ("scanner_input", "ubx", "mt", "radio_link", "telemetry"):
        declare(name)
    return made


STRUCTS = _structs()
SIZES = f"""#include "link.h"
#include "mt.h"
#include "ubx.h"

#include <stddef.h>

const size_t SIZES[] = {{{", ".join(f"sizeof({name})" for name in STRUCTS)}}};
"""

# a machine whose int has two bytes: its C sums and signs by bytes, its SipRound is the processor's own
SMALL = {
    "limits.h": "#define UINT_MAX 0xFFFFU\n",
    "sipround.c": """#include "siphash.h"
#include <string.h>
#define ROTATED(x, bits) (((x) << (bits)) | ((x) >> (64 - (bits))))
void siphash_round(siphash_word *v)
{
    uint64_t w[4];
    memcpy(w, v, sizeof(w)); /* the lowest byte first, as on this machine */
    w[0] += w[1];
    w[1] = ROTATED(w[1], 13) ^ w[0];
    w[0] = ROTATED(w[0], 32);
    w[2] += w[3];
    w[3] = ROTATED(w[3], 16) ^ w[2];
    w[0] += w[3];
    w[3] = ROTATED(w[3], 21) ^ w[0];
    w[2] += w[1];
    w[1] = ROTATED(w[1], 17) ^ w[2];
    w[2] = ROTATED(w[2], 32);
    memcpy(v, w, sizeof(w));
}
""",
}


def write_drivers(folder: Path, key: Key | None = SIMULATION_KEY) -> list[str]:
    """The sources of the drivers with their headers, into a folder; the sources' names."""
    files = {n: t for n, t in (program() | key_files(key)).items() if n.endswith(".h") or n in SOURCES}
    write_files(files, folder)
    return [name for name in SOURCES if name in files]


def library(folder: Path, key: Key | None = SIMULATION_KEY, *, small: bool = False) -> ctypes.CDLL:
    """The drivers, compiled for this machine or as for a small one, with the sizes of their structs."""
    extra = {"sizes.c": SIZES} | (SMALL if small else {})
    write_files(extra, folder)
    sources = [*write_drivers(folder, key), *(name for name in extra if name.endswith(".c"))]
    trap = ("-fsanitize=undefined", "-fsanitize-trap=undefined")  # what is undefined kills the tests
    flags = (*NUMERICS, *WARNINGS, "-Wsign-conversion", "-Wshadow", *trap, "-I.")
    path = build_library(folder, sources, folder / "drivers.so", what="drivers", flags=flags)
    return ctypes.CDLL(str(path))


class Driver:
    """One parser; `receive` yields its events, each while the state is as it left it."""

    def __init__(self, c: ctypes.CDLL, name: str, *arguments: Any):
        self.c, self.name = c, name
        self.state = STRUCTS[{"link": "radio_link"}.get(name, name)]()
        self._call("init", *arguments)

    def _call(self, what: str, *arguments: Any) -> int:
        function = getattr(self.c, f"{self.name}_{what}")
        function.restype = ctypes.c_bool if self.name == "mt" else ctypes.c_int
        return int(function(ctypes.byref(self.state), *arguments))

    def receive(self, data: bytes, block: int = 65535) -> Iterator[int]:
        """The events of data that comes in blocks of so many bytes."""
        for start in range(0, len(data), block):
            yield from self.receive_block(data[start : start + block])

    def receive_block(self, data: bytes) -> Iterator[int]:
        """The events of one block; all of it is read."""
        buffer = ctypes.create_string_buffer(data, len(data))
        waiting = STRUCTS["scanner_input"](ctypes.addressof(buffer), len(data))
        while event := self._call("receive", ctypes.byref(waiting)):
            yield event
        assert waiting.count == 0

    def idle(self) -> Iterator[int]:
        """The events after a long silence, until all bytes held are given up."""
        while self.state.scanner.count > 0:
            self.c.scanner_abandon(ctypes.byref(self.state.scanner))
            yield from self.receive_block(b"")

    @property
    def sample(self) -> dict[str, Any]:
        """The inertial unit's last sample by name."""
        self.c.mt_value.restype = ctypes.c_float
        values = [self.c.mt_value(ctypes.byref(self.state), i) for i in range(12)]
        vectors = {name: values[3 * i : 3 * i + 3] for i, name in enumerate(("accel", "gyro", "mag"))}
        return vectors | dict(zip(("roll", "pitch", "heading"), values[9:], strict=True))

    @property
    def frame(self) -> bytes:
        """The frame found last, until the next call."""
        return ctypes.string_at(self.state.scanner.frame, self.state.scanner.length)

    def frames(self, data: bytes, block: int = 65535) -> list[bytes]:
        """The frames in data."""
        return [self.frame for _ in self.receive(data, block)]

    @property
    def accounted(self) -> int:
        """Bytes that were skipped or are held."""
        return int(self.state.scanner.skipped + self.state.scanner.count)


def as_dict(structure: Any) -> dict[str, Any]:
    """A struct's values; arrays as lists."""
    values = {name: getattr(structure, name) for name, *_ in structure._fields_}
    return {n: list(v) if isinstance(v, ctypes.Array) else v for n, v in values.items()}


# --- frames ---


def ubx_frame(message: int, payload: bytes) -> bytes:
    """A frame of class NAV."""
    body = bytes([1, message]) + struct.pack("<H", len(payload)) + payload
    return b"\xb5\x62" + body + bytes(calc_checksum(body))


def posllh(time: int, latitude: int = 325_000_000, longitude: int = -855_000_000, h_acc: int = 2500) -> bytes:
    return ubx_frame(
        POSLLH, struct.pack("<IiiiiII", time, longitude, latitude, 200_000, 230_000, h_acc, 4000)
    )


def velned(time: int, speed: int = 112, course: int = 18_152_648, s_acc: int = 20) -> bytes:
    return ubx_frame(VELNED, struct.pack("<IiiiIIiII", time, 100, -50, 0, 112, speed, course, s_acc, 300_000))


def sol(time: int, fix: int = 3, flags: int = 0x0D) -> bytes:
    return ubx_frame(
        SOL, struct.pack("<IihBBiiiIiiiIHBBI", time, 0, 1500, fix, flags, *[0] * 8, 150, 0, 8, 0)
    )


def pvt(time: int, **values: Any) -> bytes:
    """A NAV-PVT; values by name of its fields in the receiver description."""
    v = {"valid": 7, "fix": 3, "flags": 1, "flags3": 0, "length": 92,
         "lon": -855_000_000, "lat": 325_000_000, "hAcc": 2500, "gSpeed": 1120,
         "headMot": 18_152_648, "sAcc": 200} | values  # fmt: skip
    payload = bytearray(92)
    struct.pack_into("<I", payload, 0, time)
    payload[11], payload[78] = v["valid"], v["flags3"]
    payload[20:22] = v["fix"], v["flags"]
    struct.pack_into("<ii", payload, 24, v["lon"], v["lat"])
    struct.pack_into("<I", payload, 40, v["hAcc"])
    struct.pack_into("<iiI", payload, 60, v["gSpeed"], v["headMot"], v["sAcc"])
    return ubx_frame(PVT, bytes(payload[: v["length"]]))


MT_SAMPLE = bytes.fromhex(
    "faff32323e800000bdcccccd411cf5c33c23d70abca3d70a3cf5c28f3e4ccccd00000000bf4ccccd"
    "3fc00000c00000004234000004d2d4"
)


def mt_frame(values: Sequence[float], counter: int) -> bytes:
    """An MTData of twelve floats."""
    body = struct.pack(">BBB12fH", 0xFF, 0x32, 50, *values, counter)
    return b"\xfa" + body + bytes([-sum(body) % 256])


VELNED_SAMPLE = bytes.fromhex(
    "b5620112240078e0010064000000ceffffff01000000700000007000000007c8fc0114000000f0490200bb7e"
)
FENCE = tuple(
    radio.Position(*corner)
    for corner in (
        *((32.5, -85.5), (32.7, -85.5), (32.7, -85.3), (32.5, -85.3)),
        *((32.5, -85.4), (32.6, -85.4), (32.6, -85.45)),
    )
)
MISSION_16 = radio.Mission(
    radio.Position(32.6, -85.49),
    tuple(radio.Position(32.6 + k / 1e4, -85.49 - k / 1e4) for k in range(16)),
    FENCE,
)
MESSAGES: tuple[radio.Message, ...] = (
    MISSION_16, radio.Start(MISSION_16.id), radio.Override(Command.LEFT), radio.Abort(),
    radio.Heartbeat(0xC0FFEE),
)  # fmt: skip
GOOD: dict[str, list[bytes]] = {
    "ubx": [VELNED_SAMPLE, posllh(123_000), sol(123_000), pvt(123_250)],
    "mt": [MT_SAMPLE],
    "link": [encode(message, 200 + i) for i, message in enumerate(MESSAGES)],
}
