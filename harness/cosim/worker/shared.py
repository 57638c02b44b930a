"""What the worker and its parent share: the memory of a run, and the messages beside it."""

from __future__ import annotations

import ctypes
import json
import mmap
import os
import pickle
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from harness.cosim.calls import Instance
from harness.cosim.fmu import FmuDescription
from harness.cosim.recorder import Recorder, recorder_size
from harness.cosim.ssp import FmuSystem
from harness.cosim.stepping import Loop, Order
from models.kit.link import Values

TEXT = 400  # bytes for the call that is being made
UNHEARD = 77  # exit status of a worker whose connection is lost
ROWS, FEWEST_ROWS, MOST_BYTES = 4000, 200, 2**26  # rows that are kept for the parent, and their memory


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


@dataclass(frozen=True)
class Job:
    """What the worker runs; paths are absolute.

    Attributes:
        memory: bytes of address space that the worker may have.
        row_size: bytes of a row.
        companion: makes what runs beside the FMUs; `width`: values in its rows.
    """

    system: FmuSystem
    values: Values
    order: Order
    plants: Sequence[str]
    labels: Mapping[str, str]
    loop: Loop
    memory: int
    row_size: int
    companion: Callable[[], Companion] | None = None
    width: int = 0


class Flight(ctypes.Structure):
    """Which call outside of the loop is being made.

    Attributes:
        calls: how many have begun or ended.
        taken: rows that the parent has taken.
        where: component and function, a line each; empty between calls.
    """

    _fields_ = [("calls", ctypes.c_int64), ("taken", ctypes.c_int64), ("where", ctypes.c_char * TEXT)]
    calls: int
    taken: int
    where: bytes

    def mark(self, component: str, what: str) -> None:
        """A call begins; or it is over, with two empty texts."""
        self.calls += 1
        self.where = f"{component}\n{what}".encode()[:TEXT] if component else b""


class SharedMemory:
    """The memory of a run, a file that both processes map.

    Args:
        row_size: bytes of a row.
        width: values in the companion's rows.

    Attributes:
        recorder: position and rows; `companion`: (rows, width), the companion's.
    """

    def __init__(self, path: Path, row_size: int, width: int = 0) -> None:
        room = max(FEWEST_ROWS, min(ROWS, MOST_BYTES // max(row_size, 1)))
        start, rows = ctypes.sizeof(Flight), recorder_size(row_size, room)
        size = start + rows + 8 * room * width
        if not path.exists():
            with path.open("xb") as file:
                file.truncate(size)
        with path.open("r+b") as file:
            self._map = mmap.mmap(file.fileno(), size)
        view = memoryview(self._map)
        self.flight = Flight.from_buffer(view[:start])
        self.buffer = view[start : start + rows]
        self.companion: npt.NDArray[np.float64] = np.frombuffer(view[start + rows :], np.float64)
        self.companion = self.companion.reshape(room, width)
        self.recorder = Recorder(row_size, self.buffer)


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
