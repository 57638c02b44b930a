"""The worker process: `python -m harness.cosim.worker CONNECTION BYTES`, started by `process`."""

from __future__ import annotations

import ctypes
import os
import resource
import signal
import sys
from contextlib import ExitStack, suppress
from dataclasses import asdict
from multiprocessing.connection import Connection

from harness.cosim.fmu import FmuError
from harness.cosim.walk import Guard, NotNativeError
from harness.cosim.worker.job import Job, Worker
from harness.cosim.worker.shared import Channel, SharedMemory
from models.errors import CanineError

PR_SET_PDEATHSIG = 1


def main(connection: int, memory: int) -> None:
    """Do the parent's jobs, and tell what comes of them.

    Args:
        connection: the file descriptor of the connection to it.
        memory: bytes of address space that this process may have.
    """
    with suppress(OSError, AttributeError):  # the system ends this process when its parent ends, however
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    os.set_inheritable(connection, False)  # a process that an FMU starts must not keep it open
    channel, folder, guard = Channel(Connection(connection)), os.getcwd(), guard_of()
    limit_memory(memory)
    with suppress(EOFError):  # the parent has closed the connection
        while True:
            job, path = channel.take()
            os.chdir(folder)
            carry_out(job, Worker(channel, SharedMemory(path, job.sizes), guard))


def carry_out(job: Job, worker: Worker) -> None:
    """Do a job and tell what comes of it; then free what it left, and tell that."""
    channel = worker.channel
    with ExitStack() as stack:
        try:
            channel.tell("done", answer=job.carry_out(worker, stack))
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


def guard_of() -> Guard | None:
    """What restores how sums are rounded; None if its C cannot be compiled here."""
    with suppress(NotNativeError):
        return Guard()
    return None


def limit_memory(size: int) -> None:
    """Allow so many bytes of addresses, and no core files."""
    for limit, most in ((resource.RLIMIT_AS, size), (resource.RLIMIT_CORE, 0)):
        with suppress(OSError, ValueError):
            resource.setrlimit(limit, (most, resource.getrlimit(limit)[1]))


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
    os._exit(0)  # what an FMU left to be run at the end has no place here
