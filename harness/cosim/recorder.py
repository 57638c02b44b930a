"""What a walk leaves in memory as it goes: where it is, and its last rows.

The memory may be the caller's, and shared with another process: that sees which call a walk hangs or dies in.
"""

from __future__ import annotations

import ctypes

import numpy as np
import numpy.typing as npt

Memory = bytearray | memoryview  # the `buf` of a SharedMemory is one
ROOM = 100  # rows


class Position(ctypes.Structure):
    """Where a walk is; `walk.c` has the same.

    Attributes:
        tick: the tick.
        call: the place in `Calls.tick` of the call that is being made; -1 between calls.
        rows: that are finished; row k is that of tick k.
        restored: how often a call had changed how sums are rounded; `restorer`: the last of these calls.
        time: s, of the tick, or of the step within it that is being made.
    """

    _fields_ = [
        *((name, ctypes.c_int64) for name in ("tick", "call", "rows", "restored", "restorer")),
        ("time", ctypes.c_double),
    ]
    tick: int
    call: int
    rows: int
    restored: int
    restorer: int
    time: float


def recorder_size(row_size: int, room: int = ROOM) -> int:
    """Bytes of memory for so many rows of so many bytes."""
    return ctypes.sizeof(Position) + room * row_size


class Recorder:
    """A position, and after it a ring of rows: row k lies at k modulo room.

    Args:
        row_size: bytes of a row, a multiple of 8.
        memory: as many rows are kept as it has room for; by default it is the recorder's own, with `ROOM`.

    Attributes:
        position: where the walk is.
        rows: (room, row_size) bytes.
    """

    def __init__(self, row_size: int, memory: Memory | None = None) -> None:
        buffer = memoryview(bytearray(recorder_size(row_size)) if memory is None else memory).cast("B")
        start = ctypes.sizeof(Position)
        room = (len(buffer) - start) // row_size
        if room < 1:
            raise ValueError(
                f"the memory has {len(buffer)} bytes; expected {recorder_size(row_size, 1)} or more for a row"
            )
        self.position = Position.from_buffer(buffer)
        ctypes.memset(ctypes.addressof(self.position), 0, start)
        self.position.call = -1
        self.rows: npt.NDArray[np.uint8] = np.frombuffer(buffer, np.uint8, room * row_size, start)
        self.rows = self.rows.reshape(room, row_size)

    @property
    def room(self) -> int:
        """How many rows are kept."""
        return len(self.rows)
