"""An STM32F405 that runs the firmware in real time: QEMU's netduinoplus2, its serial lines as TCP ports.

The program is the one that a board is flashed with: main, port, interrupts and all. QEMU models the
processor, USARTs and timers, but no pins: what the vibrators do is read from the port's memory.
"""

from __future__ import annotations

import json
import os
import secrets
import select
import shutil
import subprocess
import tempfile
import time
import weakref
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, Self

from codegen.firmware.bundle import bundle
from codegen.firmware.cortex_m4f import board_image
from codegen.firmware.image import Image, with_key
from codegen.firmware.key import SIMULATION_KEY, Key
from codegen.firmware.navigation import DEFAULT, Navigation
from codegen.firmware.targets import find_target
from codegen.scratch import Scratch
from harness.onboard.processors.child import tied
from harness.onboard.processors.processor import ProcessorError
from models.kit.link import Values

NAME = "stm32f405"
QEMU, PACKAGE, MACHINE = "qemu-system-arm", "qemu-system-arm", "netduinoplus2"
PATIENCE = 60.0  # s for an answer
# the lines of port.c, by number of the USART from 1; QEMU's are 1 to 6, in the order of its -serial
LINES = {"imu": 1, "radio": 3, "gps": 6}
TIMER = 0x40000800  # TIM4
PRESCALER, RELOAD, COMPARE = 0x28, 0x2C, 0x3C  # its registers; COMPARE is channel 3's
TIMER_HZ = 84_000_000
LEFT, RIGHT = 1 << 3, 1 << 2  # pins of port C, as the port's `vibrating` has them


@dataclass(frozen=True)
class Playing:
    """What speaker and vibrators do.

    Attributes:
        tone_hz: 0 for none.
    """

    tone_hz: int
    vibrate_left: bool
    vibrate_right: bool


class Board:
    """A board with its program, running from its reset on. To be closed; a context manager.

    A line is a TCP server on this machine, for one client at a time. What the program sends while there is
    none is lost. QEMU stops while a client does not read what is sent to it.

    QEMU ends with the process that opened the board. On Linux it ends with the thread, too: open it from one
    that lives as long.

    Args:
        image: of the program.
        log: a file for QEMU's words about registers that it does not model; None for no such words.

    Attributes:
        ports: TCP ports on 127.0.0.1, by source: gps, imu, radio.
    """

    def __init__(self, image: Image, log: Path | None = None) -> None:
        self.image, self._held = image, b""
        command = _command(image, log)
        self._errors: BinaryIO = tempfile.TemporaryFile()  # noqa: SIM115 - _end closes it
        try:
            self._process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._errors,
                # Ctrl-C is for the harness
                start_new_session=True, bufsize=0,
            )  # fmt: skip
        except OSError as reason:
            self._errors.close()
            raise ProcessorError(f"{NAME}: QEMU cannot be started: {reason}") from None
        self.close = weakref.finalize(self, _end, self._process, self._errors)  # at exit, too
        try:
            self._read()  # its greeting
            self._ask("qmp_capabilities")
            self.ports = self._find_ports()
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def is_running(self) -> bool:
        """QEMU has not ended."""
        return self._process.poll() is None

    def playing(self) -> Playing:
        """What is played now.

        Raises:
            ProcessorError: QEMU has ended, or does not answer.
        """
        timer = {register: self.word(TIMER + register) for register in (PRESCALER, RELOAD, COMPARE)}
        period = (timer[PRESCALER] + 1) * (timer[RELOAD] + 1)
        vibrating = self.word(self.image.symbols["vibrating"])
        return Playing(
            round(TIMER_HZ / period) if timer[COMPARE] else 0, bool(vibrating & LEFT), bool(vibrating & RIGHT)
        )

    def reset(self) -> None:
        """Press its reset button: the program runs from its start, in another session; clients stay.

        Raises:
            ProcessorError: QEMU has ended, or does not answer.
        """
        self._ask("system_reset")

    def word(self, address: int) -> int:
        """32 bits of memory, or a register.

        Raises:
            ProcessorError: QEMU has ended or does not answer, or there is nothing.
        """
        answer = self._ask("human-monitor-command", {"command-line": f"xp /1wx {address:#x}"})
        _, _, value = str(answer).partition(": ")
        try:
            return int(value, 16)
        except ValueError:
            raise ProcessorError(f"{NAME}: nothing can be read at {address:#010x}: {answer}") from None

    def _find_ports(self) -> dict[str, int]:
        """The ports that QEMU has chosen."""
        addresses = {line["label"]: line["filename"] for line in self._ask("query-chardev")}
        return {source: int(addresses[source].split(",")[0].rpartition(":")[2]) for source in LINES}

    def _ask(self, command: str, arguments: Mapping[str, object] | None = None) -> Any:
        """Give a command of QEMU's monitor protocol; its answer."""
        request = {"execute": command, "arguments": arguments or {}}
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps(request).encode() + b"\n")
        except OSError:
            raise self._ended() from None
        while "return" not in (message := self._read()):
            if "error" in message:
                raise ProcessorError(f"{NAME}: QEMU refuses {request}: {message['error']['desc']}")
        return message["return"]

    def _read(self) -> dict[str, Any]:
        """QEMU's next message."""
        assert self._process.stdout is not None
        end = time.monotonic() + PATIENCE
        while b"\n" not in self._held:
            ready, _, _ = select.select([self._process.stdout], [], [], max(0.0, end - time.monotonic()))
            if not ready:
                raise ProcessorError(
                    f"{NAME}: QEMU had no answer after {PATIENCE:g} s; it waits while a client does not "
                    "read the radio"
                )
            data = os.read(self._process.stdout.fileno(), 1 << 16)
            if not data:
                raise self._ended()
            self._held += data
        line, _, self._held = self._held.partition(b"\n")
        message: dict[str, Any] = json.loads(line)
        return message

    def _ended(self) -> ProcessorError:
        status = self._process.wait()
        self._errors.seek(0)
        words = self._errors.read().decode(errors="replace").strip()
        return ProcessorError(f"{NAME}: QEMU ended by itself, status {status}: {words or 'without a word'}")


def _command(image: Image, log: Path | None) -> list[str]:
    """QEMU with a program; its monitor protocol is on the standard streams.

    Raises:
        ProcessorError: it is not installed.
    """
    program = shutil.which(QEMU)
    if program is None:
        raise ProcessorError(f"{NAME}: {QEMU} is missing; on Debian: apt install {PACKAGE}")
    command = [program, "-M", MACHINE, "-kernel", str(image.path), "-display", "none", "-nodefaults"]
    command += ["-qmp", "stdio"]
    sources = {number: source for source, number in LINES.items()}
    for number in range(1, max(sources) + 1):
        source = sources.get(number)
        if source:
            command += ["-chardev", f"socket,id={source},host=127.0.0.1,port=0,server=on,wait=off,nodelay=on"]
        command += ["-serial", f"chardev:{source}" if source else "null"]
    # where a chip draws noise for its session, the program counts resets from this word on
    session = f"loader,addr={image.symbols['first_session']:#x},data={secrets.randbits(32)},data-len=4"
    command += ["-device", session]
    if log is not None:
        command += ["-d", "unimp", "-D", str(log)]
    return tied(command)


def _end(process: subprocess.Popen[bytes], errors: BinaryIO) -> None:
    process.kill()
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            pipe.close()
    process.wait()
    errors.close()


@contextmanager
def open_board(
    values: Values | None = None, navigation: Navigation = DEFAULT, *, key: Key | None = SIMULATION_KEY
) -> Iterator[Board]:
    """A board that runs the program with these parameters and this key (see `bundle.library`).

    Args:
        key: of a vest, or None for a program without one.

    Raises:
        CompileError: with the compiler's own words.
        ProcessorError: QEMU is missing, or cannot be started.
    """
    target = find_target(NAME)
    image = board_image(target, bundle(target, values, navigation, key=key and SIMULATION_KEY))
    with Scratch() as folder, Board(with_key(image, key, folder) if key else image) as board:
        yield board
