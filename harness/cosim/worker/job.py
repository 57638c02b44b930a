"""What a worker does, and what it has for that."""

from __future__ import annotations

import os
from contextlib import ExitStack
from typing import Any, Protocol

from harness.cosim.walk import Guard
from harness.cosim.worker.shared import Channel, SharedMemory, Sizes


class Worker:
    """What a job has in the worker.

    Attributes:
        channel: to the parent.
        memory: of this job.
        guard: restores how sums are rounded; None if its C cannot be compiled here.
    """

    def __init__(self, channel: Channel, memory: SharedMemory, guard: Guard | None) -> None:
        self.channel, self.memory, self.guard = channel, memory, guard

    def tell(self, kind: str, **values: Any) -> None:
        """Tell the parent. A worker that it does not hear any more ends."""
        try:
            self.channel.tell(kind, **values)
        except OSError:
            self.memory.flight.is_unheard = 1
            os._exit(1)

    def mark(self, component: str, what: str) -> None:
        """A call begins; or it is over, with two empty texts."""
        flight = self.memory.flight
        if self.guard is not None and self.guard():
            self.tell("restored", where=flight.where.decode(errors="replace"))
        flight.mark(component, what)


class Job(Protocol):
    """Made in the parent and pickled; paths are absolute."""

    @property
    def sizes(self) -> Sizes:
        """Of the memory that it needs."""

    def carry_out(self, worker: Worker, stack: ExitStack) -> Any:
        """Do it, in the worker; the answer goes into JSON. The stack frees what it leaves.

        Raises:
            CanineError: told to the parent, as any other is.
        """
