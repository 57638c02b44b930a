"""A simulation in a worker process: `Simulation`'s methods, and the faults of its FMUs."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from harness.cosim.fmu import FmuDescription, FmuError, Quantity
from harness.cosim.layout import Layout
from harness.cosim.loop import Outcome, Record, Stop
from harness.cosim.ssp import FmuSystem
from harness.cosim.stepping import DURATION, Event, Limits, Loop, Order
from harness.cosim.wiring import wire
from harness.cosim.worker.process import Subject, WorkerProcess
from harness.cosim.worker.shared import sizes_of
from harness.cosim.worker.simulation import Companion, SimulationJob
from harness.interrupts import holdable_interrupts
from models.kit.link import Values


class Contained:
    """A system's instances in a worker process; as `Simulation`.

    Args:
        fmus: what the FMUs say, by component.
        companion: makes, in the worker, what runs beside the FMUs; `width`: values in its rows.
        process: the worker, for more than one simulation in turn; by default its own, with `limits`.

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
        process: WorkerProcess | None = None,
    ) -> None:
        self.fmus, self.notes = dict(fmus), list[str]()
        self.components = {n: (labels or {}).get(n) or f"{n} {fmu.path.name}" for n, fmu in fmus.items()}
        self.wiring = wire(system, self.fmus, order, plants)
        self._layout = Layout(system.links, self.fmus, self.wiring, order)
        self._has_run = self._is_done = False
        self.process = process or WorkerProcess(limits)
        self._is_own = process is None
        parts = {n: replace(p, fmu=p.fmu.resolve()) for n, p in system.components.items()}
        job = SimulationJob(
            sizes_of(len(self._layout.block), width),
            replace(system, components=parts, files={}),
            dict(values or {}),
            order,
            tuple(plants),
            self.components,
            loop,
            companion,
        )
        subject = Subject(
            self.components, {n: fmu.path.name for n, fmu in self.fmus.items()}, self.wiring.step
        )
        try:
            ready = self.process.begin(job, subject)
        except FmuError as error:
            self._end(early=True)
            raise FmuError("; ".join([str(error), *self.notes]), error.fault) from None
        except BaseException:
            self._end(early=True)
            raise
        subject.calls, self.notes = ready["calls"], ready["notes"]

    def __enter__(self) -> Contained:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self.close(failed=kind is not None)

    def close(self, *, failed: bool = False) -> None:
        """Await that the worker has freed all instances; one that `failed`, or is not done, is ended.

        Raises:
            FmuError: an FMU goes wrong as it is freed.
        """
        early = failed or not self._is_done
        try:
            if not early:
                self.process.hear("closed", limit=self.process.limits.free)
        except BaseException:
            early = True
            raise
        finally:
            self._end(early=early)

    def _end(self, *, early: bool) -> None:
        """The job is over; a process of its own is ended, and so is one whose job is not done."""
        if early or self._is_own:
            self.process.end()
        self.notes += self.process.take_notes()

    @property
    def companion(self) -> npt.NDArray[np.float64]:
        """The rows of what runs beside the FMUs."""
        return self.process.memory.companion

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
        self._has_run, self._handed = True, 0
        process, position = self.process, self.process.memory.recorder.position
        process.give((tuple(events), duration, stop))
        with holdable_interrupts() as hold:
            try:
                while True:
                    message = process.hear("rows", "done", limit=process.limits.call)
                    process.check_memory()
                    if message["kind"] == "done":
                        self._is_done = True
                        break
                    with hold:
                        self._hand_over(min(message["rows"], position.rows), record, progress)
            finally:
                with hold:
                    if not self._is_done:
                        process.end_early()
                    if process.is_sound:
                        self._hand_over(position.rows, record, progress)
                if position.restored and process.is_sound:
                    name, what = process.subject.calls[position.restorer]
                    process.count_restored(f"{self.components[name]}: {what}", position.restored)
        return Outcome(**message["answer"])

    def _hand_over(self, end: int, record: Record | None, progress: Callable[[float], None] | None) -> None:
        """Give the rows up to `end` to `record`; those at the end of the ring first."""
        recorder = self.process.memory.recorder
        while self._handed < end:
            at = self._handed % recorder.room
            count = min(end - self._handed, recorder.room - at)
            times = np.arange(self._handed, self._handed + count, dtype=np.float64) * self.wiring.step
            self._handed += count
            if record is not None:
                record(times, self._layout.values(recorder.rows[at : at + count]))
            self.process.take(self._handed)
            if progress is not None:
                progress(float(times[-1]))
