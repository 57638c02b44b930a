"""What a processor is to the loop: given the bytes of a tick, it answers with what the vest does."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Protocol

from codegen.firmware import bundle
from codegen.firmware.image import Image
from codegen.firmware.targets import Target, find_target
from models.errors import CanineError
from models.kit.link import Values

MAX_BYTES = 512  # from one source in a tick, or sent in one: the mailbox's PIL_SIZE
SOURCES = ("gps", "imu", "radio")  # in the order of port.h
COUNTS = struct.Struct(f"<{len(SOURCES)}H")  # how the mailbox holds how many bytes of each wait


class ProcessorError(CanineError):
    """A processor cannot be started, or its program ran away."""


@dataclass(frozen=True)
class Received:
    """The bytes that came from each source in a tick."""

    gps: bytes = b""
    imu: bytes = b""
    radio: bytes = b""


@dataclass(frozen=True)
class Cost:
    """What a tick took.

    Attributes:
        instructions: executed.
        clocks: of the processor without wait states; 0 where the simulator does not count them.
        accesses: to the bus, each of which takes a wait state more on slow memory.
    """

    instructions: int
    clocks: int = 0
    accesses: int = 0


@dataclass(frozen=True)
class Reply:
    """What the program did in a tick.

    Attributes:
        record: all that it remembers: 32-bit words, little-endian, named by `codegen.firmware.recorded`.
        sent: bytes to the operator.
        cost: None on the host.
    """

    record: bytes
    sent: bytes
    tone_hz: int
    vibrate_left: bool
    vibrate_right: bool
    cost: Cost | None = None


class Processor(Protocol):
    """A processor with the onboard program, started. To be closed.

    Attributes:
        image: what it runs.
        start: the record before the first tick.
    """

    image: Image
    start: bytes

    def tick(self, received: Received) -> Reply:
        """One tick of the program.

        Raises:
            ProcessorError: more than MAX_BYTES from a source, or the program does not come back.
        """
        ...

    def stack(self) -> int | None:
        """Most bytes of stack used so far; None where that is not known."""
        ...

    def close(self) -> None:
        """Stop it."""
        ...


def open_processor(target: str, values: Values | None = None, *, constants: bool = False) -> Processor:
    """A processor that runs the onboard program with these parameters (see `bundle.library`).

    Raises:
        UsageError: there is no such target.
        CompileError: the toolchain refuses the program, or is not here.
        ProcessorError: the simulator cannot be started.
    """
    found = find_target(target)
    files = bundle.library(values, constants=constants) | bundle.processor_in_the_loop()
    # not every user needs every simulator
    module = import_module(f"harness.onboard.processors.{found.folder}")
    start: Callable[[Target, Mapping[str, str]], Processor] = module.start
    return start(found, files)


class Mailbox:
    """What waits for the program: what it leaves is there in the next tick as well, as in a board's buffers.

    Attributes:
        contents: bytes from each source, in the order of port.h.
    """

    def __init__(self) -> None:
        self.contents = [b"" for _ in SOURCES]

    def put(self, received: Received, left: Sequence[int]) -> list[bytes]:
        """Put bytes behind those that are left, so many from each source; the contents then.

        Raises:
            ProcessorError: there is no room, naming the source.
        """
        for i, source in enumerate(SOURCES):
            waiting = self.contents[i][len(self.contents[i]) - left[i] :]
            self.contents[i] = waiting + getattr(received, source)
            if len(self.contents[i]) > MAX_BYTES:
                raise ProcessorError(
                    f"{source}: {len(self.contents[i])} bytes wait, expected at most {MAX_BYTES}"
                )
        return self.contents
