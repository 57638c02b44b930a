"""The worker process: it does one job after the other."""

from __future__ import annotations

import ctypes
import os
import resource
import signal
from contextlib import ExitStack, suppress
from dataclasses import asdict
from multiprocessing.connection import Connection

from harness.cosim.fmu import FmuError
from harness.cosim.walk import Guard, NotNativeError
from harness.cosim.worker.job import Job, Worker
from harness.cosim.worker.shared import Channel, SharedMemory, mapped
from models.errors import CanineError


def main(connection: int, memory: int, size: int) -> None:
    """Do the parent's jobs, and tell what comes of them.

    Args:
        connection: the file descriptor of the connection to it.
        memory: that of the memory that both share.
        size: bytes of address space that this process may have.
    """
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # one that an FMU raises ends it at once
    os.set_inheritable(connection, False)  # a process that an FMU starts must not keep it open
    channel, shared, guard = Channel(Connection(connection)), mapped(memory), guard_of()
    limit_memory(size)
    with suppress(EOFError):  # the parent has closed the connection
        while True:
            job, folder = channel.take()
            os.chdir(folder)
            carry_out(job, Worker(channel, SharedMemory(shared, job.sizes), guard))


def carry_out(job: Job, worker: Worker) -> None:
    """Do a job and tell what comes of it; then free what it left, and tell that."""
    with ExitStack() as stack:
        try:
            worker.tell("done", answer=job.carry_out(worker, stack))
        except CanineError as error:
            flush()
            fault = error.fault if isinstance(error, FmuError) else None
            worker.tell("error", type=type(error).__name__, text=str(error), fault=fault and asdict(fault))
        except Exception as error:  # ours, or no memory left
            flush()
            worker.tell("error", type="", text=f"the worker failed: {type(error).__name__}: {error}")
    flush()
    worker.tell("closed")


def flush() -> None:
    """Send on what C code printed."""
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).fflush(None)


def guard_of() -> Guard | None:
    """What restores how sums are rounded; None if its C cannot be compiled here."""
    with suppress(NotNativeError):
        return Guard()
    return None


def limit_memory(size: int) -> None:
    """Allow so many bytes of addresses."""
    with suppress(OSError, ValueError):
        resource.setrlimit(resource.RLIMIT_AS, (size, resource.getrlimit(resource.RLIMIT_AS)[1]))
