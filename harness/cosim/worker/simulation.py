"""The job of a worker that runs a system."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from harness.cosim.calls import Instance
from harness.cosim.fmu import FmuDescription, describe
from harness.cosim.loop import Record, Simulation
from harness.cosim.recorder import Recorder
from harness.cosim.ssp import FmuSystem
from harness.cosim.stepping import Loop, Order
from harness.cosim.walk import MANY
from harness.cosim.worker.job import Worker
from harness.cosim.worker.shared import Sizes
from models.kit.link import Values

WAIT = 5e-4  # s between looks at what the parent has taken


class Companion(Protocol):
    """What runs beside the FMUs in the worker, as firmware on board does, with rows of its own.

    Attributes:
        width: values in one of its rows.
    """

    width: int

    def stand_ins(self, fmus: Mapping[str, FmuDescription]) -> Mapping[str, Instance]: ...

    def connect_to(self, simulation: Any, rows: npt.NDArray[np.float64]) -> None:
        """Take signals from the simulation; leave the row of tick k in `rows[k % len(rows)]`."""

    def close(self) -> None: ...


class WorkerSimulation(Simulation):
    """A simulation that tells its parent of rows, and waits while the ring is full."""

    worker: Worker

    def _hand_over(
        self,
        first: int,
        recorder: Recorder,
        record: Record | None,
        progress: Callable[[float], None] | None,
    ) -> None:
        rows, worker = recorder.position.rows, self.worker
        if rows > first:
            worker.tell("rows", rows=rows)
        while rows - worker.memory.flight.taken > recorder.room - MANY:
            time.sleep(WAIT)


@dataclass(frozen=True)
class SimulationJob:
    """Prepare a system, tell that it is ready, take events, duration and stop condition, and run it.

    Attributes:
        companion: makes what runs beside the FMUs.
    """

    sizes: Sizes
    system: FmuSystem
    values: Values
    order: Order
    plants: Sequence[str]
    labels: Mapping[str, str]
    loop: Loop
    companion: Callable[[], Companion] | None = None

    def carry_out(self, worker: Worker, stack: ExitStack) -> dict[str, Any]:
        """As `Job`."""
        simulation = self._prepare(worker, stack)
        worker.tell("ready", calls=simulation.call_names, notes=simulation.notes)
        events, duration, stop = worker.channel.take()
        outcome = simulation.run(events, duration=duration, stop=stop, memory=worker.memory.buffer)
        return asdict(outcome)

    def _prepare(self, worker: Worker, stack: ExitStack) -> WorkerSimulation:
        """The simulation at time 0."""
        companion = self.companion() if self.companion is not None else None
        stand_ins: Mapping[str, Instance] = {}
        if companion is not None:
            stack.callback(companion.close)
            stand_ins = companion.stand_ins({n: describe(p.fmu) for n, p in self.system.components.items()})
        simulation = WorkerSimulation(
            self.system,
            self.values,
            self.order,
            self.plants,
            self.labels,
            stand_ins=stand_ins,
            loop=self.loop,
            mark=worker.mark,
            guard=worker.guard,
        )
        stack.enter_context(simulation)
        simulation.worker = worker
        if companion is not None:
            companion.connect_to(simulation, worker.memory.companion)
        return simulation
