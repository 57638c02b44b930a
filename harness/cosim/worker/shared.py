"""What the worker and its parent share: the memory of a job, and the messages beside it."""

from __future__ import annotations

import ctypes
import json
import mmap
import os
import pickle
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from harness.cosim.recorder import Recorder, recorder_size

TEXT = 400  # bytes for the call that is being made
UNHEARD = 77  # exit status of a worker whose connection is lost
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


def sizes_of(row_size: int, width: int = 0) -> Sizes:
    """The sizes of a ring of rows from which the parent takes them meanwhile."""
    return Sizes(row_size, width, max(FEWEST_ROWS, min(ROWS, MOST_BYTES // max(row_size, 1))))


class Flight(ctypes.Structure):
    """Which call outside of the loop is being made.

    Attributes:
        before, after: `SOUND`.
        calls: how many have begun or ended.
        taken: rows that the parent has taken.
        where: component and function, a line each; empty between calls.
    """

    _fields_ = [
        ("before", ctypes.c_int64),
        ("calls", ctypes.c_int64),
        ("taken", ctypes.c_int64),
        ("where", ctypes.c_char * TEXT),
        ("after", ctypes.c_int64),
    ]
    before: int
    calls: int
    taken: int
    where: bytes
    after: int

    def mark(self, component: str, what: str) -> None:
        """A call begins; or it is over, with two empty texts."""
        self.calls += 1
        self.where = f"{component}\n{what}".encode()[:TEXT] if component else b""

    @property
    def is_sound(self) -> bool:
        """Has nobody written over it?"""
        return self.before == self.after == SOUND


class SharedMemory:
    """The memory of a job, a file that both processes map; the parent makes it.

    Attributes:
        flight: which call is being made.
        recorder: position and rows; `companion`: (rows, width), a companion's.
    """

    def __init__(self, path: Path, sizes: Sizes) -> None:
        start, rows = ctypes.sizeof(Flight), recorder_size(sizes.row_size, sizes.room)
        size = start + rows + 8 * sizes.room * sizes.width
        is_new = not path.exists()
        if is_new:
            with path.open("xb") as file:
                file.truncate(size)
        with path.open("r+b") as file:
            self._map = mmap.mmap(file.fileno(), size)
        view = memoryview(self._map)
        self.flight = Flight.from_buffer(view[:start])
        if is_new:
            self.flight.before = self.flight.after = SOUND
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
        """Worker to parent. In JSON: what comes from a process with others' code is not executed."""
        try:
            self._connection.send_bytes(json.dumps({"kind": kind, **values}).encode())
        except OSError:  # an FMU has closed it
            os._exit(UNHEARD)

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
