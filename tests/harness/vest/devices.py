"""The laptop's end of a radio that other programs reach, by a serial device or TCP; QEMU's absence."""

from __future__ import annotations

import os
import select
import shutil
import socket
from contextlib import suppress
from types import TracebackType
from typing import Self
from urllib.parse import urlsplit

import pytest

from harness.onboard.processors.stm32f405 import PACKAGE, QEMU

READ = 65_536


def require_qemu() -> None:
    """Skip the test on a machine without QEMU."""
    if shutil.which(QEMU) is None:
        (pytest.fail if os.environ.get("CI") == "true" else pytest.skip)(
            f"{QEMU} is missing: apt install {PACKAGE}"
        )


class Device:
    """A serial device, as a program opens it that sets nothing."""

    def __init__(self, path: str) -> None:
        self._file = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        os.close(self._file)

    def read(self) -> bytes:
        """What has come."""
        with suppress(BlockingIOError):
            return os.read(self._file, READ)
        return b""

    def write(self, data: bytes) -> None:
        """Send."""
        os.write(self._file, data)


class Connection:
    """A connection to `tcp://host:port`."""

    def __init__(self, address: str) -> None:
        place = urlsplit(address)
        assert place.hostname
        assert place.port
        self._socket = socket.create_connection((place.hostname, place.port), timeout=20)
        self._socket.setblocking(False)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._socket.close()

    def read(self) -> bytes:
        """What has come."""
        with suppress(BlockingIOError):
            return self._socket.recv(READ)
        return b""

    def is_hung_up(self, seconds: float = 20.0) -> bool:
        """Has the other end hung up? It waits for something to come."""
        assert select.select([self._socket], [], [], seconds)[0], "nothing comes"
        try:
            return self._socket.recv(READ) == b""
        except ConnectionResetError:
            return True

    def write(self, data: bytes) -> None:
        """Send."""
        self._socket.sendall(data)
