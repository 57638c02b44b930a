"""A simulation in a worker process, as its parent sees it: `Simulation`'s methods, and its faults."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import replace
from multiprocessing import Pipe
from pathlib import Path
from typing import IO, Any, NoReturn

import numpy as np
import numpy.typing as npt

from codegen.scratch import Scratch
from harness.cosim.archive import ArchiveError, XmlError
from harness.cosim.fmu import Fault, FmuDescription, FmuError, Quantity
from harness.cosim.layout import Layout
from harness.cosim.loop import Outcome, Record, Stop
from harness.cosim.ssp import FmuSystem, SspError
from harness.cosim.stepping import DURATION, GIB, Event, Limits, Loop, Order
from harness.cosim.wiring import wire
from harness.cosim.worker.shared import UNHEARD, Channel, Companion, Job, SharedMemory
from harness.interrupts import IN_WORKER, holdable_interrupts
from models.errors import CanineError, ParameterError, UsageError, WiringError, printable
from models.kit.link import Values

POLL = 0.05  # s
BUSY = 60.0  # s that the worker may take between calls
ADDRESSES = 4  # times the memory limit: of addresses that are not used
LINES, WIDTH = 5, 200  # of what an FMU prints, that are shown
PAGE = os.sysconf("SC_PAGE_SIZE")
ERRORS: dict[str, type[CanineError]] = {
    kind.__name__: kind
    for kind in (ArchiveError, ParameterError, SspError, UsageError, WiringError, XmlError)
}


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

    def note(self, where: str) -> list[str]:
        """What the user should see of it."""
        if not self.count:
            return []
        more = f" (and {self.count - len(self.lines)} lines more)" if self.count > len(self.lines) else ""
        return [f"an FMU wrote to {where}: {' | '.join(self.lines)}{more}"]


class Contained:
    """A system's instances in a worker process; as `Simulation`.

    Args:
        fmus: what the FMUs say, by component.
        companion: makes, in the worker, what runs beside the FMUs; `width`: values in its rows.

    Attributes:
        notes: also what FMUs printed, and whose rounding was restored.

    Raises:
        WiringError: the links do not fit (see `wire`).
        FmuError: an FMU cannot be loaded, refuses to start, or ends, stops or fills the worker meanwhile.
    """

    def __init__(
        self,
        system: FmuSystem,
        fmus: Mapping[str, FmuDescription],
        values: Values | None = None,
        order: Order = "sequential",
        plants: Iterable[str] = (),
        *,
        labels: Mapping[str, str] | None = None,
        companion: Callable[[], Companion] | None = None,
        width: int = 0,
        loop: Loop = "native",
        limits: Limits | None = None,
    ) -> None:
        self.fmus, self.limits, self.notes = dict(fmus), limits or Limits(), list[str]()
        self.components = {n: (labels or {}).get(n) or f"{n} {fmu.path.name}" for n, fmu in fmus.items()}
        self.wiring = wire(system, self.fmus, order, plants)
        self._layout = Layout(system.links, self.fmus, self.wiring, order)
        self._calls: list[list[str]] = []  # of a tick: component and function
        self._restored: dict[str, int] = {}
        self._seen: tuple[object, ...] = ()
        self._looked = 0.0
        self._has_run = self._is_told = False  # of an error
        self._since = time.monotonic()
        self._limit = self.limits.start
        parts = {n: replace(p, fmu=p.fmu.resolve()) for n, p in system.components.items()}
        job = Job(
            replace(system, components=parts, files={}),
            dict(values or {}),
            order,
            tuple(plants),
            self.components,
            loop,
            ADDRESSES * self.limits.memory,
            len(self._layout.block),
            companion,
            width,
        )
        with ExitStack() as stack:
            self._open(stack, width)
            with suppress(OSError):  # it has ended: that is found out when its answer is awaited
                self._channel.give(job)
            try:
                ready = self._await("ready")
            except FmuError as error:
                stack.close()
                raise FmuError("; ".join([str(error), *self.notes]), error.fault) from None
            self._calls, self.notes = ready["calls"], ready["notes"]
            self._stack = stack.pop_all()

    def _open(self, stack: ExitStack, width: int) -> None:
        """Start the worker in a folder of its own, which is removed after it."""
        folder = self._folder = stack.enter_context(Scratch())
        (folder / "work").mkdir()
        self._memory = SharedMemory(folder / "memory", len(self._layout.block), width)
        self.companion: npt.NDArray[np.float64] = self._memory.companion
        ours, theirs = Pipe()
        self._channel = Channel(ours)
        stack.callback(self._channel.close)
        above = str(Path(__file__).parents[3])
        paths = os.pathsep.join(filter(None, [above, os.environ.get("PYTHONPATH", "")]))
        environment = os.environ | {
            "TMPDIR": str(folder),
            "PYTHONPATH": paths,
            "OPENBLAS_NUM_THREADS": "1",
            IN_WORKER: "1",
        }
        command = [sys.executable, "-P", "-m", "harness.cosim.worker"]
        with theirs:
            self._process = subprocess.Popen(
                [*command, str(theirs.fileno()), str(folder / "memory")],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                cwd=folder / "work",
                env=environment,
                pass_fds=[theirs.fileno()],
                start_new_session=True,
            )
        assert self._process.stdout is not None
        assert self._process.stderr is not None
        self._printed = {"stdout": Printed(self._process.stdout), "stderr": Printed(self._process.stderr)}
        stack.callback(self._end)

    def __enter__(self) -> Contained:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self.close(failed=kind is not None)

    def close(self, *, failed: bool = False) -> None:
        """Have the worker free all instances, and end it; one that `failed` is only ended.

        Raises:
            FmuError: an FMU goes wrong as it is freed.
        """
        with self._stack:
            if not failed and self._process.poll() is None:
                self._limit = self.limits.free
                with suppress(OSError):
                    self._channel.give("close")
                self._await("closed")

    def _end(self) -> None:
        """End the worker and all that it started; what it printed becomes notes."""
        self._kill()
        for where, printed in self._printed.items():
            printed.close()
            self.notes += printed.note(where)
        for where, times in self._restored.items():
            last = f"{times} calls, the last of them {where}," if times > 1 else where
            self.notes.append(f"{last} changed how sums are rounded, which FMUs share; it was restored")

    def columns(self, name: str) -> list[Quantity]:
        """What the rows of a component hold: its inputs, then its outputs."""
        return self._layout.columns(name)

    def run(
        self,
        events: Sequence[Event] = (),
        *,
        duration: float = DURATION,
        stop: Stop | None = None,
        record: Record | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> Outcome:
        """As `Simulation.run`; `record` gets every row that was finished, however the worker ended.

        Raises:
            FmuError: an FMU failed, ended the worker, or took too long or too much memory.
            ParameterError: the variable of an event is not a free input.
        """
        if self._has_run:
            raise RuntimeError("a simulation runs once")
        self._has_run, self._handed, is_done = True, 0, False
        self._limit = self.limits.call
        with suppress(OSError):
            self._channel.give((tuple(events), duration, stop))
        position = self._memory.recorder.position
        with holdable_interrupts() as hold:
            try:
                while True:
                    message = self._await("rows", "done")
                    if is_done := message["kind"] == "done":
                        break
                    with hold:
                        self._hand_over(message["rows"], record, progress)
            finally:
                with hold:
                    if not is_done:
                        self._end_early()
                    self._hand_over(position.rows, record, progress)
                if position.restored:
                    name, what = self._calls[position.restorer]
                    self._count_restored(f"{self.components[name]}: {what}", position.restored)
        return Outcome(**message["outcome"])

    def _hand_over(self, end: int, record: Record | None, progress: Callable[[float], None] | None) -> None:
        """Give the rows up to `end` to `record`; those at the end of the ring first."""
        recorder = self._memory.recorder
        while self._handed < end:
            at = self._handed % recorder.room
            count = min(end - self._handed, recorder.room - at)
            times = np.arange(self._handed, self._handed + count, dtype=np.float64) * self.wiring.step
            self._handed += count
            if record is not None:
                record(times, self._layout.values(recorder.rows[at : at + count]))
            self._memory.flight.taken = self._handed
            if progress is not None:
                progress(float(times[-1]))

    # --- what the worker does ---

    def _await(self, *kinds: str) -> dict[str, Any]:
        """The next message of one of these kinds.

        Raises:
            CanineError: what the worker tells of, or has ended it.
        """
        self._since = time.monotonic()
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
                self._count_restored(self._label(message["where"]), 1)

    def _count_restored(self, where: str, times: int) -> None:
        self._restored[where] = self._restored.get(where, 0) + times

    def _label(self, where: str) -> str:
        name, _, what = where.partition("\n")
        return f"{self.components.get(name, name)}: {what}" if what else "the worker"

    def _look(self, now: float) -> None:
        """Is the worker still within its limits?

        Raises:
            FmuError: it is not; it was ended.
        """
        flight, position = self._memory.flight, self._memory.recorder.position
        seen = (flight.calls, position.tick, position.call, position.rows)
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

    def _resident(self) -> int:
        """Bytes of memory that the worker has in use."""
        try:
            return int(Path(f"/proc/{self._process.pid}/statm").read_text().split()[1]) * PAGE
        except (OSError, IndexError, ValueError):
            return 0

    def _where(self) -> tuple[str, str]:
        """Component and function of the call that is being made; "" between calls."""
        flight, position = self._memory.flight, self._memory.recorder.position
        if flight.where:
            name, _, what = flight.where.decode(errors="replace").partition("\n")
            return name, what
        if 0 <= position.call < len(self._calls):
            name, what = self._calls[position.call]
            return name, what
        return "", ""

    def _end_early(self) -> None:
        """End a worker whose run is not done; one that told why frees its instances first."""
        if self._is_told and self._process.poll() is None:
            self._limit = self.limits.free
            with suppress(CanineError):
                self._await("closed")
        self._kill()

    def _kill(self) -> None:
        """End the worker, and all of its session that lives on."""
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()

    def _fail_as_it_ended(self) -> NoReturn:
        """The worker has gone, or cannot be heard any more."""
        try:
            status = self._process.wait(timeout=1.0)
        except subprocess.TimeoutExpired:
            self._kill()
            self._fail("exit", "closed the worker's connection{}")
        if status == UNHEARD:
            raise FmuError(
                f"an FMU closed files of the process that are not its own{self._moment()}; "
                f"one of {', '.join(self.components.values())}",
                Fault("exit", "", "", "", self._time()),
            )
        if status < 0:
            name = signal.strsignal(-status) or f"signal {-status}"
            self._fail("crash", f"ended the process{{}}: {name.lower()}")
        self._fail("exit", f"ended the process{{}}, with exit status {status}")

    def _fail(self, kind: str, text: str) -> NoReturn:
        """Raise the fault of the call that is being made."""
        component, call = self._where()
        what = text.format(self._moment())
        fmu = self.fmus[component].path.name if component in self.fmus else ""
        where = (
            f"{self.components.get(component, component)}: {call}"
            if component
            else "the worker, between calls,"
        )
        raise FmuError(f"{where} {what}", Fault(kind, component, fmu, call, self._time()))

    def _time(self) -> float:
        return self._memory.recorder.position.tick * self.wiring.step

    def _moment(self) -> str:
        return f" at t = {self._time():.10g} s"


def _error(message: Mapping[str, Any]) -> CanineError:
    """The error that the worker tells of."""
    text, fault = printable(message.get("text")), message.get("fault")
    if message.get("type") == "FmuError":
        return FmuError(text, Fault(**fault) if fault else None)
    return ERRORS.get(str(message.get("type")), CanineError)(text)
