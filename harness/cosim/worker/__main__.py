"""The worker process: `python -m harness.cosim.worker CONNECTION MEMORY`, started by `contained`."""

from __future__ import annotations

import ctypes
import os
import resource
import signal
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack, suppress
from dataclasses import asdict
from multiprocessing.connection import Connection
from pathlib import Path

from harness.cosim.calls import Instance
from harness.cosim.fmu import FmuError, describe
from harness.cosim.loop import Record, Simulation
from harness.cosim.recorder import Recorder
from harness.cosim.walk import MANY, Guard, NotNativeError
from harness.cosim.worker.shared import Channel, Flight, Job, SharedMemory
from models.errors import CanineError

PR_SET_PDEATHSIG = 1
WAIT = 5e-4  # s between looks at what the parent has taken


class WorkerSimulation(Simulation):
    """A simulation that tells its parent of rows, and waits while the ring is full."""

    channel: Channel
    flight: Flight

    def _hand_over(
        self,
        first: int,
        recorder: Recorder,
        record: Record | None,
        progress: Callable[[float], None] | None,
    ) -> None:
        rows = recorder.position.rows
        if rows > first:
            self.channel.tell("rows", rows=rows)
        while rows - self.flight.taken > recorder.room - MANY:
            time.sleep(WAIT)


def main(connection: int, path: Path) -> None:
    """Run the parent's job, and tell what comes of it."""
    with suppress(OSError, AttributeError):  # the system ends this process when its parent ends, however
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    os.set_inheritable(connection, False)  # a process that an FMU starts must not keep it open
    channel = Channel(Connection(connection))
    job: Job = channel.take()
    limit_memory(job.memory)
    memory = SharedMemory(path, job.row_size, job.width)
    with ExitStack() as stack:
        try:
            simulation = prepare(job, memory, channel, stack)
            events, duration, stop = channel.take()
            outcome = simulation.run(events, duration=duration, stop=stop, memory=memory.buffer)
            channel.tell("done", outcome=asdict(outcome))
            channel.take()
        except CanineError as error:
            flush()
            fault = error.fault if isinstance(error, FmuError) else None
            channel.tell("error", type=type(error).__name__, text=str(error), fault=fault and asdict(fault))
        except Exception as error:  # ours, or no memory left
            flush()
            channel.tell("error", type="", text=f"the worker failed: {type(error).__name__}: {error}")
    flush()
    channel.tell("closed")


def flush() -> None:
    """Send on what C code printed."""
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).fflush(None)


def prepare(job: Job, memory: SharedMemory, channel: Channel, stack: ExitStack) -> WorkerSimulation:
    """The simulation at time 0, freed by the stack."""
    flight, guard = memory.flight, guard_of()

    def mark(component: str, what: str) -> None:
        if guard is not None and guard():
            channel.tell("restored", where=flight.where.decode(errors="replace"))
        flight.mark(component, what)

    companion = job.companion() if job.companion is not None else None
    stand_ins: Mapping[str, Instance] = {}
    if companion is not None:
        stack.callback(companion.close)
        stand_ins = companion.stand_ins({n: describe(part.fmu) for n, part in job.system.components.items()})
    simulation = WorkerSimulation(
        job.system,
        job.values,
        job.order,
        job.plants,
        job.labels,
        stand_ins=stand_ins,
        loop=job.loop,
        mark=mark,
        guard=guard,
    )
    stack.enter_context(simulation)
    simulation.channel, simulation.flight = channel, flight
    if companion is not None:
        companion.connect_to(simulation, memory.companion)
    channel.tell("ready", calls=simulation.call_names, notes=simulation.notes)
    return simulation


def guard_of() -> Guard | None:
    """What restores how sums are rounded; None if its C cannot be compiled here."""
    with suppress(NotNativeError):
        return Guard()
    return None


def limit_memory(size: int) -> None:
    """Allow so many bytes of addresses, and no core files."""
    with suppress(OSError, ValueError):
        resource.setrlimit(resource.RLIMIT_AS, (size, resource.getrlimit(resource.RLIMIT_AS)[1]))
    with suppress(OSError, ValueError):
        resource.setrlimit(resource.RLIMIT_CORE, (0, resource.getrlimit(resource.RLIMIT_CORE)[1]))


if __name__ == "__main__":
    main(int(sys.argv[1]), Path(sys.argv[2]))
    os._exit(0)  # what an FMU left to be run at the end has no place here
