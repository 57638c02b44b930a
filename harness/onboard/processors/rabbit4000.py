"""A Rabbit 4000, simulated by ucsim, which counts its clocks and bus accesses; driven over its console."""

from __future__ import annotations

import os
import re
import select
import subprocess
import time
import weakref
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from codegen.cache import stored
from codegen.firmware.bundle import recorded
from codegen.firmware.image import Image, with_key
from codegen.firmware.key import SIMULATION_KEY, Key
from codegen.firmware.navigation import DEFAULT, Navigation
from codegen.firmware.rabbit4000 import rabbit4000_image
from codegen.firmware.targets import Target
from codegen.scratch import Scratch
from codegen.toolchains.compiler import NUMERICS, WARNINGS, build_library, compiler_version, this_platform
from codegen.toolchains.sdcc import home
from harness.onboard.processors.processor import (
    COUNTS,
    MAX_BYTES,
    Cost,
    Mailbox,
    ProcessorError,
    Received,
    Reply,
)

LIMIT = 5_000_000  # bus accesses from one stop to the next: 200 ms at 58.98 MHz
PATIENCE = 60.0  # s for an answer of the console; LIMIT takes about half a second
LINE = 24  # bytes set by one line: longer ones hang the console
PAINT = 0xA5
TOP = 0x10000  # of the stack
STOPPED = re.compile(rb"Stop at 0x([0-9a-f]+): (.*)\n(?:.*\n)*?F 0x[0-9a-f]+\n")
STATE = re.compile(
    rb"Inst= (\d+) Fetch= (\d+) Read= (\d+) Write= (\d+)\n.*\((\d+) clks\)\n(?:.*\n)*?Runtime: .*\n"
)
BREAKPOINT = re.compile(rb"Breakpoint \d+ at .*\n.*\n")
NOTHING = re.compile(b"")
DATA, EXTENDED = 0, 4  # kinds of records in an Intel hex file
POINTER = re.compile(rb"^SP= 0x([0-9a-f]{4})", re.M)


def left_out(path: Path) -> Iterator[tuple[int, bytes]]:
    """The parts of an Intel hex file, with their addresses, that the simulator leaves out when it loads it.

    It reads as far as the first address beyond 64 kB.
    """
    base = None
    for line in path.read_text().split():
        count, high, low, kind, *data = bytes.fromhex(line.removeprefix(":"))
        if kind == EXTENDED:
            base = int.from_bytes(data[:count]) << 16
        elif kind == DATA and base is not None:
            yield base + (high << 8 | low), bytes(data[:count])


class Console:
    """A simulator with a program, at its command line.

    No line may be sent while the program runs, since any line stops it.
    """

    def __init__(self, image: Image) -> None:
        command = [str(home() / "bin" / "ucsim_rxk"), "-q", "-P", "-b", "-t", "R4K", str(image.path)]
        try:
            self._process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, bufsize=0,
                # Ctrl-C is for the harness
                start_new_session=True,
                env=os.environ | {"LD_PRELOAD": str(_wait_library())},
            )  # fmt: skip
        except OSError as reason:
            raise ProcessorError(f"rabbit4000: the simulator cannot be started: {reason}") from None
        self.close = weakref.finalize(self, _end, self._process)  # at exit, too
        self._held = b""
        for address, data in left_out(image.path):
            self.write(address, data, "rom_chip")

    def ask(self, line: str, answer: re.Pattern[bytes]) -> re.Match[bytes]:
        """Send a command and wait for the answer. The console loses lines that come too early."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(f"{line}\n".encode())
        except OSError:
            raise self._ended() from None
        self.until(re.compile(re.escape(line.encode()) + rb"\n"))  # the console repeats it
        return self.until(answer)

    def until(self, pattern: re.Pattern[bytes]) -> re.Match[bytes]:
        """Wait for a match in the simulator's output, and drop the output up to its end."""
        end = time.monotonic() + PATIENCE
        while (match := pattern.search(self._held)) is None:
            self._read(end, pattern.pattern.decode())
        self._held = self._held[match.end() :]
        return match

    def write(self, address: int, data: bytes, memory: str = "rom") -> None:
        """Set bytes from an address on: a logical one, or of another of the simulator's memories."""
        for i in range(0, len(data), LINE):
            part = data[i : i + LINE]
            last = address + i + (len(part) - 1) // 8 * 8  # it repeats the bytes, 8 on a line
            line = f"set memory {memory} {address + i:#06x} {' '.join(str(b) for b in part)}"
            self.ask(line, re.compile(rb"0x0*%x .*\n" % last))

    def memory(self, address: int, size: int) -> bytes:
        """Bytes from a logical address on."""
        self.ask(f"dump /b rom {address:#06x} {address + size - 1:#06x}", NOTHING)
        end = time.monotonic() + PATIENCE
        while len(self._held) < size:
            self._read(end, f"{size} bytes")
        data, self._held = self._held[:size], self._held[size:]
        return data

    def _read(self, end: float, expected: str) -> None:
        assert self._process.stdout is not None
        ready, _, _ = select.select([self._process.stdout], [], [], max(0.0, end - time.monotonic()))
        if not ready:
            raise ProcessorError(
                f"rabbit4000: the simulator had no answer after {PATIENCE:g} s, expected {expected!r}"
            )
        data = os.read(self._process.stdout.fileno(), 1 << 16)
        if not data:
            raise self._ended()
        self._held += data

    def _ended(self) -> ProcessorError:
        return ProcessorError(f"rabbit4000: the simulator ended by itself, status {self._process.wait()}")


def _wait_library() -> Path:
    source = Path(__file__).with_name("ucsim_wait.c")
    flags = (*NUMERICS, "-D_POSIX_C_SOURCE=200809L", *WARNINGS, "-fno-sanitize=all", "-g0")
    return stored(
        "firmware/ucsim_wait.so",
        (source.read_bytes(), compiler_version(), this_platform(), flags),
        lambda path: build_library(source.parent, [source.name], path, what=source.stem, flags=flags),
    )


def _end(process: subprocess.Popen[bytes]) -> None:
    process.kill()
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            pipe.close()
    process.wait()


class Machine:
    """The processor from its reset on, stopped where its program calls pil_wait."""

    def __init__(self, image: Image) -> None:
        self.image = image
        self._console = Console(image)
        try:
            self._reset()
        except BaseException:
            self.close()
            raise

    def _reset(self) -> None:
        at = self.image.symbols
        self._console.ask(f"break {at['main']:#06x}", BREAKPOINT)
        top = int(_group(POINTER.search(self.run_to("main")), 1), 16)
        self._room = at["s__DATA"] + at["l__DATA"] + at["l__INITIALIZED"], top
        self._console.ask("delete 1", NOTHING)  # main may begin with a loop
        for name in ("pil_wait", "pil_done"):
            self._console.ask(f"break {at[name]:#06x}", BREAKPOINT)
        self._console.ask(f"fill rom {self._room[0]:#06x} {top - 1:#06x} {PAINT:#04x}", NOTHING)
        self.run_to("pil_wait")

    def run_to(self, name: str, limit: int = LIMIT) -> bytes:
        """Run until a function with a breakpoint is entered; the simulator's message.

        Raises:
            ProcessorError: it stops elsewhere, or not within `limit` bus accesses.
        """
        stop = self._console.ask(f"step {limit} vclk", STOPPED)
        pc = int(stop[1], 16)
        if pc != self.image.symbols[name]:
            raise ProcessorError(
                f"rabbit4000: the program stopped at {self.place(pc)}, expected it at {name} "
                f"within {limit} bus accesses"
            )
        return stop[0]

    def place(self, pc: int) -> str:
        """An address, with the last global symbol at or before it."""
        before = [
            (a, n) for n, a in self.image.symbols.items() if a <= pc and not n.startswith(("s__", "l__"))
        ]
        address, name = max(before, default=(pc, "nowhere"))
        return f"{pc:#06x} ({name} + {pc - address:#x})"

    def cost(self) -> Cost:
        """Since the reset."""
        state = self._console.ask("state", STATE)
        instructions, *accesses, clocks = (int(n) for n in state.groups())
        return Cost(instructions, clocks, sum(accesses))

    def write(self, address: int, data: bytes) -> None:
        """Set bytes from a logical address on."""
        self._console.write(address, data)

    def memory(self, address: int, size: int) -> bytes:
        """Bytes from a logical address on."""
        return self._console.memory(address, size)

    def stack(self) -> int | None:
        """Most bytes of stack used so far, including the start-up's.

        Raises:
            ProcessorError: all of its room is used, so perhaps more.
        """
        bottom, top = self._room
        room = self.memory(bottom, top - bottom)
        left = len(room) - len(room.lstrip(bytes([PAINT])))
        if left == 0:
            raise ProcessorError(f"rabbit4000: the stack has used all of its {TOP - bottom} bytes")
        return TOP - bottom - left

    def close(self) -> None:
        """Stop it."""
        self._console.close()


class Rabbit4000(Machine):
    """The processor with the onboard program, stopped before each tick."""

    def __init__(self, image: Image, navigation: Navigation = DEFAULT) -> None:
        super().__init__(image)
        self.mailbox = Mailbox()
        self._record_bytes = 4 * len(recorded(navigation))
        self.start = self._word_bytes("pil_recorded", self._record_bytes)

    def tick(self, received: Received) -> Reply:
        """One tick of the program."""
        at = self.image.symbols
        waiting = self.mailbox.put(received, COUNTS.unpack(self._word_bytes("pil_counts", COUNTS.size)))
        for i, data in enumerate(waiting):
            self.write(at["pil_received"] + i * MAX_BYTES, data)
        self.write(at["pil_counts"], COUNTS.pack(*map(len, waiting)))
        before = self.cost()
        self.run_to("pil_done")
        after = self.cost()
        self.run_to("pil_wait")
        count, tone = (self._word("pil_sent_count"), self._word("pil_tone_hz"))
        left, right = (self._word_bytes(f"pil_vibrate_{side}", 1) != b"\0" for side in ("left", "right"))
        return Reply(
            self._word_bytes("pil_recorded", self._record_bytes),
            self._word_bytes("pil_sent", count) if count else b"",
            tone,
            left,
            right,
            Cost(
                after.instructions - before.instructions,
                after.clocks - before.clocks,
                after.accesses - before.accesses,
            ),
        )

    def _word_bytes(self, name: str, size: int) -> bytes:
        return self.memory(self.image.symbols[name], size)

    def _word(self, name: str) -> int:
        return int.from_bytes(self._word_bytes(name, 2), "little")


def _group(match: Any, number: int) -> bytes:
    group: bytes = match[number]
    return group


def start(
    target: Target,
    files: Mapping[str, str],
    navigation: Navigation = DEFAULT,
    key: Key = SIMULATION_KEY,
) -> Rabbit4000:
    """The processor with a program of these sources, and this key in the place of the simulation's."""
    with Scratch() as folder:
        return Rabbit4000(with_key(rabbit4000_image(target, files), key, folder), navigation)
