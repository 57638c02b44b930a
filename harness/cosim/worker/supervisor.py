"""The worker's parent: it ends all processes that FMUs have started, whatever they have made of themselves.

The system gives it, as their subreaper, each process whose own parent has ended. So all are its descendants,
in whatever session, under whatever name and with whatever environment they run.
"""

from __future__ import annotations

import ctypes
import os
import resource
import signal
import threading
from collections.abc import Iterable
from contextlib import suppress

PR_SET_PDEATHSIG, PR_SET_CHILD_SUBREAPER = 1, 36


def supervise(handles: Iterable[int]) -> None:
    """Come back in a new process, the worker; in this one await its end, and end in the same way.

    When nobody holds the other end of standard input any more, the worker is ended. A process that ends
    however leaves nobody there.

    Args:
        handles: open files that are the worker's alone.
    """
    _control(PR_SET_CHILD_SUBREAPER, 1)
    resource.setrlimit(resource.RLIMIT_CORE, (0, resource.getrlimit(resource.RLIMIT_CORE)[1]))
    worker = os.fork()
    if not worker:
        _control(PR_SET_PDEATHSIG, signal.SIGKILL)
        os.setsid()  # signals to its group are not for this process
        os.dup2(os.open(os.devnull, os.O_RDWR), 0)
        return
    for handle in handles:
        os.close(handle)
    threading.Thread(target=_end_with_parent, args=[worker], daemon=True).start()
    ended = 0
    while ended != worker:
        ended, status = os.wait()
    with suppress(ChildProcessError):  # all have ended
        while True:
            for number in descendants(os.getpid()):
                with suppress(ProcessLookupError, PermissionError):
                    os.kill(number, signal.SIGKILL)
            os.wait()
    code = os.waitstatus_to_exitcode(status)
    if code < 0:
        with suppress(OSError):  # SIGKILL cannot be handled
            signal.signal(-code, signal.SIG_DFL)
        signal.raise_signal(-code)
    os._exit(code)


def descendants(process: int) -> list[int]:
    """The processes that a process has started, and those that these have started."""
    children: dict[int, list[int]] = {}
    for name in os.listdir("/proc") if os.path.isdir("/proc") else ():
        if name.isdecimal():
            with suppress(OSError), open(f"/proc/{name}/stat", "rb") as file:
                parent = int(file.read().rpartition(b")")[2].split()[1])
                children.setdefault(parent, []).append(int(name))
    processes = [process]
    for number in processes:
        processes += children.get(number, [])
    return processes[1:]


def _end_with_parent(worker: int) -> None:
    os.read(0, 1)
    with suppress(ProcessLookupError):
        os.kill(worker, signal.SIGKILL)


def _control(option: int, value: int) -> None:
    with suppress(OSError, AttributeError):  # Linux has it
        ctypes.CDLL(None).prctl(option, value)
