"""The worker as its parent sees it: a process with limits, whose end, hang or fault names an FMU."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from multiprocessing import Pipe
from pathlib import Path
from typing import IO, Any, NoReturn

from codegen.scratch import Scratch
from harness.cosim.archive import ArchiveError, XmlError
from harness.cosim.fmu import Fault, FmuError
from harness.cosim.ssp import SspError
from harness.cosim.stepping import GIB, Limits
from harness.cosim.worker.job import Job
from harness.cosim.worker.shared import MOST_BYTES, Channel, SharedMemory, mapped, new_memory
from harness.cosim.worker.supervisor import descendants
from models.errors import CanineError, ParameterError, UsageError, WiringError, printable

POLL = 0.05  # s
SEARCH = 0.5  # s between searches for the processes that the worker has started
DEATH = 10.0  # s for them to end; a process may wait for a device and stay
BUSY = 60.0  # s that the worker may take between calls
ADDRESSES = 4  # times the memory limit: of addresses that are not used
LINES, WIDTH = 5, 200  # of what an FMU prints, that are shown
PAGE = os.sysconf("SC_PAGE_SIZE")
ERRORS: dict[str, type[CanineError]] = {
    kind.__name__: kind
    for kind in (ArchiveError, ParameterError, SspError, UsageError, WiringError, XmlError)
}


@dataclass
class Subject:
    """What a job runs, as errors call it.

    Attributes:
        labels: of the components; `files`: their FMUs.
        step: s, of a tick.
        calls: of a tick: component and function.
    """

    labels: Mapping[str, str]
    files: Mapping[str, str]
    step: float
    calls: Sequence[Sequence[str]] = ()


class Printed:
    """What the worker prints: its first lines, and how many there were."""

    def __init__(self, stream: IO[bytes]) -> None:
        self._stream = stream
        self.lines: list[str] = []
        self.count = 0
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        with suppress(ValueError, OSError):
            while line := self._stream.readline(2**16):
                self.count += 1
                if len(self.lines) < LINES:
                    self.lines.append(printable(line.decode(errors="replace").rstrip("\n"))[:WIDTH])

    def close(self) -> None:
        """The worker has ended; a process that it left behind may still hold the stream."""
        self._thread.join(timeout=1.0)
        if not self._thread.is_alive():
            self._stream.close()

    def take_note(self, where: str) -> list[str]:
        """What the user should see of what was printed since the last note."""
        lines, count, self.lines, self.count = self.lines, self.count, [], 0
        if not count:
            return []
        more = f" (and {count - len(lines)} lines more)" if count > len(lines) else ""
        return [f"an FMU wrote to {where}: {' | '.join(lines)}{more}"]


class WorkerProcess:
    """A process that does one job after the other; one that has ended is started anew for the next.

    A context manager: it ends the process, all that it started, and removes its folder.

    Attributes:
        memory: of the present job.
        pid: of the supervisor that was started last; `folder`: of its worker.
    """

    memory: SharedMemory
    pid: int
    folder: Path

    def __init__(self, limits: Limits | None = None) -> None:
        self.limits = limits or Limits()
        self._stack = ExitStack()
        self._process: subprocess.Popen[bytes] | None = None
        self._printed: dict[str, Printed] = {}
        self._restored: dict[str, int] = {}
        self._notes: list[str] = []

    def __enter__(self) -> WorkerProcess:
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def begin(self, job: Job, subject: Subject) -> dict[str, Any]:
        """Give the worker a job; what it tells when it is ready.

        If an earlier job's FMU has spoiled the worker for others, the job begins in a new one.

        Raises:
            CanineError: what the worker tells of, or has ended it.
        """
        self.subject = subject
        if self._process is not None and self._process.poll() is None and job.sizes.all <= len(self._shared):
            with suppress(OSError):
                try:
                    return self._begin(job)
                except CanineError:
                    if self.memory.flight.calls:  # an FMU of this job was called
                        raise
        self.end()
        self._start(max(job.sizes.all, MOST_BYTES))
        return self._begin(job)

    def _begin(self, job: Job) -> dict[str, Any]:
        """Give the worker a job, with a folder of its own.

        Raises:
            OSError: its folder cannot be made.
        """
        self._seen: tuple[object, ...] = ()
        self._looked = 0.0
        self._is_told = False  # of an error
        self._taken = 0
        self.memory = SharedMemory(self._shared, job.sizes)
        self.memory.flight.begin()
        self._work.close()
        self.give((job, self._work.enter_context(Scratch(self.folder))))
        return self.hear("ready", limit=self.limits.start)

    def _start(self, size: int) -> None:
        """Start the worker, with so many bytes of memory, in a folder of its own, removed after it."""
        stack = self._stack
        self.folder = stack.enter_context(Scratch())
        self._work = stack.enter_context(ExitStack())
        memory = new_memory(size)
        ours, theirs = Pipe()
        self._channel = Channel(ours)
        stack.callback(self._channel.close)
        above = str(Path(__file__).parents[3])
        paths = os.pathsep.join(filter(None, [above, os.environ.get("PYTHONPATH", "")]))
        environment = os.environ | {
            "TMPDIR": str(self.folder),
            "PYTHONPATH": paths,
            "OPENBLAS_NUM_THREADS": "1",
        }
        handles = [theirs.fileno(), memory]
        arguments = map(str, [*handles, ADDRESSES * self.limits.memory])
        with theirs:
            process = subprocess.Popen(
                [sys.executable, "-P", "-m", "harness.cosim.worker", *arguments],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                cwd=self.folder,
                env=environment,
                pass_fds=handles,
                start_new_session=True,
            )
        assert process.stdout is not None
        assert process.stderr is not None
        self._process, self.pid, self._shared = process, process.pid, mapped(memory)
        self._searched, self._processes = 0.0, list[int]()
        self._printed = {"stdout": Printed(process.stdout), "stderr": Printed(process.stderr)}

    def take(self, rows: int) -> None:
        """So many rows of the job are taken: the worker may put others in their places."""
        self._taken = self.memory.flight.taken = rows

    def give(self, message: object) -> None:
        """Send to the worker. If it has ended, that is found out when its answer is awaited."""
        with suppress(OSError):
            self._channel.give(message)

    def hear(self, *kinds: str, limit: float) -> dict[str, Any]:
        """The next message of one of these kinds.

        Args:
            limit: s for each call of an FMU.

        Raises:
            CanineError: what the worker tells of, or has ended it.
        """
        assert self._process is not None
        self._limit, self._since = limit, time.monotonic()
        while True:
            has_ended = self._process.poll() is not None
            try:
                message = self._channel.hear(POLL)
            except EOFError:
                self._fail_as_it_ended()
            if message is None and has_ended:  # another process that it left behind holds the connection
                self._fail_as_it_ended()
            if (now := time.monotonic()) > self._looked + POLL:
                self._looked = now
                self._look(now)
            if message is not None and message.get("kind") in kinds:
                return message
            if message is not None and message.get("kind") == "error":
                self._is_told = True
                raise _error(message)
            if message is not None and message.get("kind") == "restored":
                self.count_restored(self._label(message["where"]), 1)

    def end(self) -> None:
        """End the process and all that it started; what it printed becomes notes."""
        if self._process is None:
            return
        with self._stack:
            self._kill()
            for stream in self._printed.values():
                stream.close()
            self._take_printed()
        self._process = None

    def end_early(self) -> None:
        """End the worker in the midst of a job; one that told why frees its instances first."""
        if self._process is not None and self._is_told and self._process.poll() is None:
            with suppress(CanineError):
                self.hear("closed", limit=self.limits.free)
        self.end()

    def abandon(self) -> None:
        """End the process from another thread; the one that awaits its answer hears that it has gone."""
        process = self._process
        if process is not None:
            _let_end(process)

    def take_notes(self) -> list[str]:
        """What the user should know of the last job: what FMUs printed, whose rounding was restored."""
        self._take_printed()
        for where, times in self._restored.items():
            last = f"{times} calls, the last of them {where}," if times > 1 else where
            self._notes.append(f"{last} changed how sums are rounded, which FMUs share; it was restored")
        notes, self._notes, self._restored = self._notes, [], {}
        return notes

    def _take_printed(self) -> None:
        for where, printed in self._printed.items():
            self._notes += printed.take_note(where)

    def count_restored(self, where: str, times: int) -> None:
        """A call had changed how sums are rounded, so many times."""
        self._restored[where] = self._restored.get(where, 0) + times

    def _label(self, where: str) -> str:
        name, _, what = where.partition("\n")
        return f"{self.subject.labels.get(name, name)}: {what}" if what else "the worker"

    def _look(self, now: float) -> None:
        """Is the worker still within its limits?

        Raises:
            FmuError: it is not; it was ended.
        """
        flight, position = self.memory.flight, self.memory.recorder.position
        self.check_memory()
        seen = (flight.calls, position.tick, position.call, position.rows, position.time)
        if seen != self._seen:
            self._seen, self._since = seen, now
        component, _ = self._where()
        limit = self._limit if component else BUSY
        if now - self._since > limit:
            self._kill()
            self._fail("hang", f"did not come back within {limit:g} s{{}}")
        if (size := self._resident()) > self.limits.memory:
            self._kill()
            limit_text = f"{self.limits.memory / GIB:.3g} GiB"
            self._fail("memory", f"took {size / GIB:.3g} GiB of memory{{}}; the limit is {limit_text}")

    @property
    def is_sound(self) -> bool:
        """Can what the worker shares be as the worker left it?"""
        recorder = self.memory.recorder
        position, most = recorder.position, self._taken + recorder.room
        calls = max(1, len(self.subject.calls))
        return (
            self.memory.flight.is_sound
            and self._taken <= position.rows <= most
            and 0 <= position.tick <= most
            and -1 <= position.call < calls
            and 0 <= position.restorer < calls
            and position.restored >= 0
        )

    def check_memory(self) -> None:
        """Has an FMU written over what the worker shares?

        Raises:
            FmuError: it has; the worker was ended.
        """
        if not self.is_sound:
            self._kill()
            self._fail("overwritten", "wrote over memory that is not its own{}")

    def _resident(self) -> int:
        """Bytes of memory that the worker and the processes that it has started have in use."""
        if (now := time.monotonic()) > self._searched + SEARCH:
            self._searched, self._processes = now, descendants(self.pid)
        pages = 0
        for number in self._processes:
            with suppress(OSError, IndexError):
                pages += int(Path(f"/proc/{number}/statm").read_text().split()[1])
        return pages * PAGE

    def _where(self) -> tuple[str, str]:
        """Component and function of the call that is being made; "" between calls."""
        flight, position, calls = self.memory.flight, self.memory.recorder.position, self.subject.calls
        if not self.is_sound:
            return "", ""
        if flight.where:
            name, _, what = flight.where.decode(errors="replace").partition("\n")
            return name, what
        if 0 <= position.call < len(calls):
            name, what = calls[position.call]
            return name, what
        return "", ""

    def _kill(self) -> None:
        """End the worker and all that it has started."""
        assert self._process is not None
        _let_end(self._process)
        try:
            self._process.wait(DEATH)
        except subprocess.TimeoutExpired:
            strays = ", ".join(map(str, descendants(self.pid)))
            self._notes.append(f"processes that an FMU started cannot be ended: {strays}")

    def _fail_as_it_ended(self) -> NoReturn:
        """The worker has gone, or cannot be heard any more."""
        assert self._process is not None
        self.check_memory()
        try:
            status = self._process.wait(DEATH)
        except subprocess.TimeoutExpired:
            self._kill()
            self._fail("exit", "closed the worker's connection{}")
        if self.memory.flight.is_unheard:
            raise FmuError(
                f"an FMU closed files of the process that are not its own{self._moment()}; {self._one_of}",
                Fault("exit", "", "", "", self._time()),
            )
        if status < 0:
            name = signal.strsignal(-status) or f"signal {-status}"
            self._fail("crash", f"ended the process{{}}: {name.lower()}")
        self._fail("exit", f"ended the process{{}}, with exit status {status}")

    def _fail(self, kind: str, text: str) -> NoReturn:
        """Raise the fault of the call that is being made."""
        component, call = self._where()
        subject, what = self.subject, text.format(self._moment())
        if component in subject.labels:
            line = f"{subject.labels[component]}: {call} {what}"
        else:
            line = f"an FMU {what}, between calls; {self._one_of}"
        raise FmuError(line, Fault(kind, component, subject.files.get(component, ""), call, self._time()))

    @property
    def _one_of(self) -> str:
        return f"one of {', '.join(self.subject.labels.values())}"

    def _time(self) -> float:
        """s, of the tick or of the step within it; of the rows that were taken, if nobody can tell."""
        position, step = self.memory.recorder.position, self.subject.step
        tick, time = (position.tick, position.time) if self.is_sound else (self._taken, math.nan)
        return time if tick * step <= time <= (tick + 1) * step else tick * step

    def _moment(self) -> str:
        return f" at t = {self._time():.10g} s"


def _let_end(process: subprocess.Popen[bytes]) -> None:
    """Let go of a supervisor, which then ends its worker."""
    assert process.stdin is not None
    process.stdin.close()


def _error(message: Mapping[str, Any]) -> CanineError:
    """The error that the worker tells of."""
    text, fault = printable(message.get("text")), message.get("fault")
    if message.get("type") == "FmuError":
        return FmuError(text, Fault(**fault) if fault else None)
    return ERRORS.get(str(message.get("type")), CanineError)(text)
