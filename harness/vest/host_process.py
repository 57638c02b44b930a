"""The program of `canine firmware --target host`, compiled and started as a process of its own.

Its three lines are pseudo-terminals. Its clock is a file that counts with the ticks of the trial. So both
have one time, however fast that runs, and a tick ends when the program has made it. What it plays comes on a
pipe.
"""

from __future__ import annotations

import ctypes
import mmap
import os
import select
import shutil
import subprocess
import time
from contextlib import suppress

from codegen.firmware.bundle import bundle, recorded
from codegen.firmware.image import Image, host_program, with_key
from codegen.firmware.key import SIMULATION_KEY, Key
from codegen.firmware.navigation import DEFAULT, Navigation
from codegen.firmware.targets import find_target
from codegen.scratch import Scratch
from harness.onboard.processors import ProcessorError, Received, Reply
from harness.onboard.processors.child import tied
from harness.onboard.processors.processor import SOURCES
from harness.vest.pty_port import READ, Pty
from models.kit.link import Values
from models.kit.timing import TICK

TICK_MS = round(1000 * TICK)
PATIENCE_S = 20.0  # for its first tick, on the busiest machine
NAP_S = 0.0002  # while it makes a tick
EXECUTABLE = 0o700


class Clock(ctypes.Structure):
    """The file of VEST_CLOCK (see port.c for the host), ms."""

    _fields_ = [("now", ctypes.c_uint32), ("done", ctypes.c_uint32)]
    now: int
    done: int


class HostProcess:
    """The program in its own process. What it remembers is not known: its record is 0.

    Args:
        image: its executable file; the process runs a copy of it.

    Raises:
        ProcessorError: it cannot be started.
    """

    def __init__(self, image: Image, navigation: Navigation = DEFAULT) -> None:
        self.image, self._name = image, f"host {image.path.name}"
        self.start = bytes(4 * len(recorded(navigation)))
        self._scratch = Scratch()
        self._lines = {source: Pty(held=True) for source in SOURCES}
        clock = self._scratch.path / "clock"
        clock.write_bytes(bytes(ctypes.sizeof(Clock)))
        with clock.open("r+b") as file:
            self._map = mmap.mmap(file.fileno(), ctypes.sizeof(Clock))
        self._clock = Clock.from_buffer(self._map)
        program = shutil.copy(image.path, self._scratch.path / image.path.name)
        os.chmod(program, EXECUTABLE)
        self._command = tied([str(program)])
        self._environment = {f"VEST_{name.upper()}": line.address for name, line in self._lines.items()}
        self._environment |= {"VEST_CLOCK": str(clock), "VEST_PLAYS": "/dev/stdout"}
        self._process: subprocess.Popen[bytes] | None = None
        self._played, self._half = (0, False, False), b""

    def reset(self, session: int) -> None:
        """Start the program anew; it draws the number of its session itself.

        Raises:
            ProcessorError: it does not come to its first tick.
        """
        self._end()
        for line in self._lines.values():
            line.flush()
        self._clock.now = self._clock.done = 0
        self._played, self._half = (0, False, False), b""
        try:
            self._process = subprocess.Popen(
                self._command, env=self._environment, stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                start_new_session=True,  # Ctrl-C is for the harness
            )  # fmt: skip
        except OSError as reason:
            raise ProcessorError(f"{self._name}: cannot be started: {reason.strerror}") from None
        assert self._process.stdout is not None
        self._output = self._process.stdout.fileno()
        os.set_blocking(self._output, False)
        if not select.select([self._output], [], [], PATIENCE_S)[0]:
            raise ProcessorError(f"{self._name}: made no tick within {PATIENCE_S:g} s after its start")
        self._listen()

    def tick(self, received: Received) -> Reply:
        """Give the program the bytes of a tick, let its clock go on by one, and wait until it has made it.

        Raises:
            ProcessorError: the process has ended, or makes none.
        """
        assert self._process is not None
        for source, line in self._lines.items():
            if data := getattr(received, source):
                line.write(data)
        self._clock.now += TICK_MS
        end = time.monotonic() + PATIENCE_S
        while self._clock.done != self._clock.now:
            if time.monotonic() > end:
                raise ProcessorError(f"{self._name}: made no tick within {PATIENCE_S:g} s")
            if self._process.poll() is not None:
                break
            time.sleep(NAP_S)
        self._listen()
        return Reply(self.start, self._lines["radio"].read(), *self._played)

    def _listen(self) -> None:
        """Take what the program has written about what it plays: ms, Hz, left, right on each line."""
        assert self._process is not None
        with suppress(BlockingIOError):
            written = os.read(self._output, READ)
            *lines, self._half = (self._half + written).split(b"\n")
            if lines:
                tone, left, right = (int(word) for word in lines[-1].split()[1:])
                self._played = tone, bool(left), bool(right)
            if not written:  # its end is closed: it ends
                with suppress(subprocess.TimeoutExpired):
                    self._process.wait(PATIENCE_S)
        if self._process.poll() is not None:
            assert self._process.stderr is not None
            words = self._process.stderr.read(READ).decode(errors="replace").strip()
            raise ProcessorError(
                f"{self._name}: the program ended by itself, status {self._process.returncode}: "
                f"{words or 'without a word'}"
            )

    def stack(self) -> int | None:
        """Unknown."""
        return None

    def _end(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            for pipe in (self._process.stdout, self._process.stderr):
                if pipe is not None:
                    pipe.close()
            self._process = None

    def close(self) -> None:
        """End the process, and give back its lines."""
        self._end()
        for line in self._lines.values():
            line.close()
        del self._clock  # which the map may not outlive
        self._map.close()
        self._scratch.close()


def open_host_process(target: str, values: Values, navigation: Navigation, key: Key | None) -> HostProcess:
    """The program with these parameters and this key, in its own process; `reset` starts it.

    Raises:
        CompileError: the compiler refuses the program.
        ProcessorError: it cannot be started.
    """
    host = find_target(target)
    files = bundle(host, values, navigation, key=key and SIMULATION_KEY)
    with Scratch() as folder:
        return HostProcess(with_key(host_program(host, files), key or SIMULATION_KEY, folder), navigation)
