"""What the worker and its parent share: the memory of a job, and the messages beside it."""

from __future__ import annotations

import ctypes
import fcntl
import json
import mmap
import os
import pickle
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from harness.cosim.recorder import Recorder, recorder_size

TEXT = 400  # bytes for the call that is being made
ROWS, FEWEST_ROWS, MOST_BYTES = 4000, 200, 2**26  # rows that are kept for the parent, and their memory
SOUND = 0x43414E494E45  # what lies round the flight recorder, as long as nobody writes over it


class Sizes(NamedTuple):
    """The memory of a job.

    Attributes:
        row_size: bytes of a row.
        width: values in each row of a companion.
        room: rows.
    """

    row_size: int
    width: int
    room: int

    @property
    def recorder(self) -> int:
        """Bytes of position and rows."""
        return recorder_size(self.row_size, self.room)

    @property
    def all(self) -> int:
        """Bytes."""
        return ctypes.sizeof(Flight) + self.recorder + 8 * self.room * self.width


def sizes_of(row_size: int, width: int = 0) -> Sizes:
    """The sizes of a ring of rows from which the parent takes them meanwhile."""
    return Sizes(row_size, width, max(FEWEST_ROWS, min(ROWS, MOST_BYTES // max(row_size, 1))))


class Flight(ctypes.Structure):
    """Which call outside of the loop is being made.

    Attributes:
        before, after: `SOUND`.
        calls: how many have begun or ended.
        taken: rows that the parent has taken.
        is_unheard: 1 if the worker ends because its connection to the parent is lost.
        where: component and function, a line each; empty between calls.
    """

    _fields_ = [
        ("before", ctypes.c_int64),
        ("calls", ctypes.c_int64),
        ("taken", ctypes.c_int64),
        ("is_unheard", ctypes.c_int64),
        ("where", ctypes.c_char * TEXT),
        ("after", ctypes.c_int64),
    ]
    before: int
    calls: int
    taken: int
    is_unheard: int
    where: bytes
    after: int

    def mark(self, component: str, what: str) -> None:
        """A call begins; or it is over, with two empty texts."""
        self.calls += 1
        self.where = f"{component}\n{what}".encode()[:TEXT] if component else b""

    def begin(self) -> None:
        """A job begins."""
        ctypes.memset(ctypes.addressof(self), 0, ctypes.sizeof(self))
        self.before = self.after = SOUND

    @property
    def is_sound(self) -> bool:
        """Has nobody written over it?"""
        return self.before == self.after == SOUND


def new_memory(size: int) -> int:
    """A file of so many bytes, open, that both processes map. It has no name, and nobody can make it smaller:
    what is cut off a file that is mapped ends a process that reads it, the parent as well.
    """
    handle = os.memfd_create("canine-rows", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
    os.ftruncate(handle, size)
    fcntl.fcntl(handle, fcntl.F_ADD_SEALS, fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_SEAL)
    return handle


def mapped(handle: int) -> mmap.mmap:
    """The memory of an open file, which is closed."""
    try:
        return mmap.mmap(handle, os.fstat(handle).st_size)
    finally:
        os.close(handle)


class SharedMemory:
    """What a job has of the memory.

    Attributes:
        flight: which call is being made.
        recorder: position and rows; `companion`: (rows, width), a companion's.
    """

    def __init__(self, memory: mmap.mmap, sizes: Sizes) -> None:
        start, rows = ctypes.sizeof(Flight), sizes.recorder
        view = memoryview(memory)[: sizes.all]
        self.flight = Flight.from_buffer(view[:start])
        self.buffer = view[start : start + rows]
        self.companion: npt.NDArray[np.float64] = np.frombuffer(view[start + rows :], np.float64)
        self.companion = self.companion.reshape(sizes.room, sizes.width)
        self.recorder = Recorder(sizes.row_size, self.buffer)


class Channel:
    """Messages between the two: jobs to the worker, words back."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def give(self, job: object) -> None:
        """Parent to worker."""
        self._connection.send_bytes(pickle.dumps(job))

    def take(self) -> Any:
        """In the worker: what `give` sent."""
        return pickle.loads(self._connection.recv_bytes())

    def tell(self, kind: str, **values: Any) -> None:
        """Worker to parent. In JSON: what comes from a process with others' code is not executed.

        Raises:
            OSError: an FMU has closed it.
        """
        self._connection.send_bytes(json.dumps({"kind": kind, **values}).encode())

    def hear(self, timeout: float) -> dict[str, Any] | None:
        """In the parent: what `tell` sent; None if nothing comes for so long [s].

        Raises:
            EOFError: the worker has gone, or sends what is no message.
        """
        try:
            if not self._connection.poll(timeout):
                return None
            message = json.loads(self._connection.recv_bytes())
        except (OSError, ValueError) as error:
            raise EOFError from error
        if not isinstance(message, dict):
            raise EOFError
        return message

    def close(self) -> None:
        """Nothing more is sent or read."""
        self._connection.close()
