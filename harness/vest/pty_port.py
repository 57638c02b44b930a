"""A pseudo-terminal as one end of a line: another program opens its device as it opens a modem's."""

from __future__ import annotations

import os
import pty
import select
import termios
import tty
from contextlib import suppress

READ = 65_536  # bytes at once


class Pty:
    """A pseudo-terminal; its device is set to bytes as they are.

    Args:
        held: keep the device open, for a program that is about to open it. Otherwise bytes are lost while
            nobody has it open, so that whoever opens it later gets none that are old.

    Attributes:
        address: path of the device.
    """

    def __init__(self, *, held: bool = False) -> None:
        self._file, device = pty.openpty()
        self.address = os.ttyname(device)
        tty.setraw(device)
        os.set_blocking(self._file, False)
        self._device = device if held else -1
        if not held:
            os.close(device)
        self._poll = select.poll()
        self._poll.register(self._file, 0)  # for POLLHUP alone
        self._was_open = False

    @property
    def is_open(self) -> bool:
        """Has another program opened the device?"""
        return not self._poll.poll(0)

    def read(self) -> bytes:
        """As `Port.read`."""
        with suppress(OSError):  # nothing there, or nobody
            return os.read(self._file, READ)
        return b""

    def write(self, data: bytes) -> None:
        """As `Port.write`."""
        if self.is_open:
            self._was_open = True
            with suppress(BlockingIOError):
                os.write(self._file, data)
        elif self._was_open:
            self._was_open = False
            self.flush()

    def flush(self) -> None:
        """Drop the bytes that the other program has not read; what it sent before it went is kept."""
        device = os.open(self.address, os.O_RDWR | os.O_NOCTTY)  # what it holds, it alone gives up
        termios.tcflush(device, termios.TCIFLUSH)
        os.close(device)

    def close(self) -> None:
        """Give the terminal back."""
        for file in (self._file, self._device):
            if file >= 0:
                os.close(file)
