"""The interface of a processor: the bytes of a tick in; tone, vibrators and telemetry out."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Protocol

from codegen.firmware import bundle
from codegen.firmware.image import Image
from codegen.firmware.key import SIMULATION_KEY, Key
from codegen.firmware.navigation import DEFAULT, Navigation
from codegen.firmware.targets import Target, find_in_the_loop
from models.errors import CanineError
from models.kit.link import Values

MAX_BYTES = 512  # from one source in a tick, or sent in one: the mailbox's PIL_SIZE
SOURCES = ("gps", "imu", "radio")  # in the order of port.h
COUNTS = struct.Struct(f"<{len(SOURCES)}H")  # of the mailbox: bytes of each source that wait


class ProcessorError(CanineError):
    """A processor cannot be started, or its program runs away."""


@dataclass(frozen=True)
class Received:
    """The bytes that came from each source in a tick."""

    gps: bytes = b""
    imu: bytes = b""
    radio: bytes = b""


@dataclass(frozen=True)
class Cost:
    """The cost of a tick.

    Attributes:
        instructions: executed.
        clocks: of the processor without wait states; 0 where the simulator does not count them.
        accesses: to the bus; slow memory adds wait states to each.
    """

    instructions: int
    clocks: int = 0
    accesses: int = 0


@dataclass(frozen=True)
class Reply:
    """The program's answer to a tick.

    Attributes:
        record: its memory as 32-bit words, little-endian, named by `codegen.firmware.bundle.recorded`.
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
        image: of its program.
        start: the record before the first tick.
    """

    image: Image
    start: bytes

    def tick(self, received: Received) -> Reply:
        """One tick of the program.

        Raises:
            ProcessorError: a source has more than MAX_BYTES, or the program does not come back.
        """
        ...

    def stack(self) -> int | None:
        """Most bytes of stack used so far; None if unknown."""
        ...

    def close(self) -> None:
        """Stop it."""
        ...


class Resettable(Processor, Protocol):
    """A processor that can be reset."""

    def reset(self, session: int) -> None:
        """Run the program from its start, in a session of this number; `start` is the record then.

        Raises:
            ProcessorError: it does not come to its first tick.
        """
        ...


def open_processor(
    target: str,
    values: Values | None = None,
    navigation: Navigation = DEFAULT,
    *,
    constants: bool = False,
    key: Key | None = SIMULATION_KEY,
) -> Processor:
    """A processor that runs the onboard program with these parameters and this key (see `bundle.library`).

    Raises:
        UsageError: the target is unknown, or does not run in the loop.
        CompileError: the toolchain refuses the program, or is missing.
        ProcessorError: the simulator cannot be started.
    """
    chosen = find_in_the_loop(target)
    files = bundle.library(
        values,
        navigation,
        constants=constants,
        addressed=chosen.addressed,
        banked=chosen.banked,
        key=key and SIMULATION_KEY,
    )
    files |= bundle.processor_in_the_loop(navigation)
    # imported here: only users of a simulator need it
    module = import_module(f"harness.onboard.processors.{chosen.folder}")
    start: Callable[[Target, Mapping[str, str], Navigation, Key], Processor] = module.start
    return start(chosen, files, navigation, key or SIMULATION_KEY)


class Mailbox:
    """The bytes that wait for the program; as in a board's buffers, unread ones wait for the next tick.

    Attributes:
        contents: bytes from each source, in the order of port.h.
    """

    def __init__(self) -> None:
        self.contents = [b"" for _ in SOURCES]

    def put(self, received: Received, left: Sequence[int]) -> list[bytes]:
        """Keep the last `left` bytes of each source and add those received; the contents then.

        Raises:
            ProcessorError: a source has more than MAX_BYTES, naming it.
        """
        for i, source in enumerate(SOURCES):
            waiting = self.contents[i][len(self.contents[i]) - left[i] :]
            self.contents[i] = waiting + getattr(received, source)
            if len(self.contents[i]) > MAX_BYTES:
                raise ProcessorError(
                    f"{source}: {len(self.contents[i])} bytes wait, expected at most {MAX_BYTES}"
                )
        return self.contents
