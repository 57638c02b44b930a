"""The ends of a radio line: bytes in, bytes out, and nothing waits."""

from __future__ import annotations

from collections import deque
from threading import Lock
from typing import Protocol

ROOM = 65_536  # bytes on their way to an end that nobody reads: more are lost


class Port(Protocol):
    """One end of a line."""

    def read(self) -> bytes:
        """The bytes that have come; b"" if none have."""
        ...

    def write(self, data: bytes) -> None:
        """Send bytes. What the line does not take at once is lost, as on the air."""
        ...


class Line:
    """Bytes in one direction, from one thread to another."""

    def __init__(self) -> None:
        self._held: deque[bytes] = deque()
        self._count = 0
        self._lock = Lock()

    def put(self, data: bytes) -> None:
        """Add bytes, those for which there is room."""
        with self._lock:
            if data := data[: ROOM - self._count]:
                self._held.append(data)
                self._count += len(data)

    def take(self) -> bytes:
        """All bytes that are there."""
        with self._lock:
            data = b"".join(self._held)
            self._held.clear()
            self._count = 0
            return data


class WireEnd:
    """One end of a wire within this process."""

    def __init__(self, incoming: Line, outgoing: Line) -> None:
        self._incoming, self._outgoing = incoming, outgoing

    def read(self) -> bytes:
        """As `Port.read`."""
        return self._incoming.take()

    def write(self, data: bytes) -> None:
        """As `Port.write`."""
        self._outgoing.put(data)


def wire() -> tuple[WireEnd, WireEnd]:
    """A wire within this process: its two ends."""
    there, back = Line(), Line()
    return WireEnd(there, back), WireEnd(back, there)
